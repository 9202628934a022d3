"""Look-ahead: a later step that cannot start leads to another plan, if there is one."""

from __future__ import annotations

import pytest

from socialbot.planning.pddl.reader import read_domain
from socialbot.planning.planners.engines import make_planner
from socialbot.planning.planners.planner import PlannerAnswer, PlannerVerdict
from tests.deliberation.domains import p
from tests.deliberation.office import Office, job

ROUTES = read_domain(
    """
    (define (domain routes)
      (:requirements :typing :durative-actions :negative-preconditions)
      (:types job - object)
      (:predicates (warm) (open ?j - job) (blocked) (tools) (done ?j - job) (closed ?j - job))
      (:durative-action prepare :parameters () :duration (= ?duration 2)
        :condition () :effect (at end (warm)))
      (:durative-action light :parameters (?j - job) :duration (= ?duration 1)
        :condition (and (at start (warm)) (at start (open ?j))) :effect (at end (done ?j)))
      (:durative-action do :parameters (?j - job) :duration (= ?duration 6)
        :condition (and (at start (warm)) (at start (not (blocked)))) :effect (at end (done ?j)))
      (:durative-action clear :parameters () :duration (= ?duration 4)
        :condition (at start (tools)) :effect (at end (not (blocked))))
      (:durative-action close :parameters (?j - job) :duration (= ?duration 2)
        :condition (and (at start (warm)) (at end (open ?j))) :effect (at end (closed ?j))))
    """,
    where="routes",
)


def new_office(*, slow: bool = False) -> Office:
    return Office(
        beliefs="instance a job; open a",
        domain=ROUTES,
        planner=make_planner("kairos"),
        slow=slow,
        patience_s=0.5,
        comp_plan_tries=1,
    )


class Helpless:
    """A planner that finds no plan, and no proof that there is none."""

    name = "helpless"

    def solve(self, domain, problem, limits, cancelled=None):
        return PlannerAnswer(PlannerVerdict.GAVE_UP, message="nothing found")


@pytest.fixture
def office() -> Office:
    return new_office()


def started(office: Office) -> Office:
    """The plan is: prepare, then light, which needs an open door."""
    office.want(job("a", value=(p("done", "a"),)))
    office.until(0.2)
    return office


def test_another_plan_replaces_one_with_a_step_that_cannot_start(office):
    started(office).forget("open a")
    office.until(20)
    assert [call for _, call in office.begun()] == ["(prepare)", "(do a)"]
    (doubt,) = office.found("doubt")
    assert doubt.detail["reason"] == "(light a) cannot start: (open a) does not hold"
    assert office.wants == []


def test_a_condition_that_holds_again_in_time_raises_no_doubt(office):
    started(office).forget("open a")
    office.until(0.5)
    office.believe("open a")
    office.until(20)
    assert office.found("doubt") == []
    assert [call for _, call in office.begun()] == ["(prepare)", "(light a)"]


def test_without_another_plan_the_running_one_goes_on(office):
    office.believe("blocked")
    started(office).forget("open a")
    office.deliberator.pursuit.planner = Helpless()
    office.until(1.5)
    assert len(office.found("doubt")) == 1
    office.believe("open a")
    office.until(20)
    assert [call for _, call in office.begun()] == ["(prepare)", "(light a)"]
    assert office.wants == []


def test_a_condition_that_a_step_of_the_plan_makes_true_raises_no_doubt(office):
    office.believe("blocked", "tools")
    office.forget("open a")
    started(office).until(20)
    assert {call for _, call in office.begun()} == {"(prepare)", "(clear)", "(do a)"}
    assert office.found("doubt") == []
    assert office.wants == []


def test_conditions_of_a_step_that_runs_raise_no_doubt(office):
    office.want(job("a", value=(p("closed", "a"),)))
    office.until(1.9)
    office.forget("open a")
    office.until(3)
    assert [call for _, call in office.begun()] == ["(prepare)", "(close a)"]
    assert office.found("doubt") == []


def test_no_step_starts_while_another_plan_is_made():
    office = new_office(slow=True)
    started(office).answer()
    office.forget("open a")
    office.until(1)
    assert len(office.pending) == 1
    office.believe("open a")
    office.until(4)
    assert [call for _, call in office.begun()] == ["(prepare)"]
    office.answer()
    office.until(20)
    assert [call for _, call in office.begun()] == ["(prepare)", "(do a)"]
    assert office.wants == []
