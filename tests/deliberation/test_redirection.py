"""Running steps that have become pointless: a new plan redirects or stops them."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from socialbot.deliberation.messages import Desire, Fact
from socialbot.planning.pddl.reader import read_domain
from socialbot.planning.planners.engines import make_planner
from tests.deliberation.domains import p
from tests.deliberation.office import Office
from tests.deliberation.stage import Behaviour

YARD = read_domain(
    """
    (define (domain yard)
      (:requirements :typing :durative-actions :fluents)
      (:types robot place box - object)
      (:predicates (at ?r - robot ?p - place) (in ?b - box ?p - place) (has ?r - robot) (road ?a ?b - place)
                   (seen ?p - place) (warm))
      (:functions (distance ?a ?b - place))
      (:durative-action move :parameters (?r - robot ?a ?b - place) :duration (= ?duration (distance ?a ?b))
        :condition (and (at start (at ?r ?a)) (at start (road ?a ?b)))
        :effect (and (at start (not (at ?r ?a))) (at end (at ?r ?b)) (at end (seen ?b))))
      (:durative-action pick :parameters (?r - robot ?b - box ?p - place) :duration (= ?duration 3)
        :condition (and (at start (in ?b ?p)) (over all (at ?r ?p)))
        :effect (and (at end (not (in ?b ?p))) (at end (has ?r))))
      (:durative-action heat :parameters () :duration (= ?duration 6)
        :condition () :effect (at end (warm)))
      (:durative-action share :parameters (?r ?s - robot) :duration (= ?duration 2)
        :condition (at start (has ?s)) :effect (at end (has ?r))))
    """,
    where="yard",
)
BELIEFS = """
instance r1 robot; instance home place; instance shop place; instance yard place; instance b1 box; instance b2 box
at r1 home; in b1 shop
"""
TRIANGLE = {"home shop": 10, "home yard": 11, "shop yard": 10}
TO_SHOP, TO_YARD = "(move r1 home shop)", "(move r1 home yard)"


def yard(roads: Mapping[str, float], *beliefs: str, sensed: bool = False, **options) -> Office:
    """A yard whose places are so many seconds apart. Moves take 10 s."""
    texts = [BELIEFS, *beliefs]
    for road, seconds in roads.items():
        one, other = road.split()
        texts.append(f"road {one} {other}; road {other} {one}")
        texts.append(f"distance {one} {other} = {seconds}; distance {other} {one} = {seconds}")
    office = Office(
        beliefs="\n".join(texts),
        domain=YARD,
        planner=make_planner("kairos"),
        is_sensed=lambda name, objects: sensed and name == "at",
        patience_s=0.5,
        **options,
    )
    office.lasts_s.update(move=10.0, pick=3.0, heat=6.0, share=2.0)
    return office


def fetch(office: Office, *more: Fact, until: float) -> Office:
    """Let robot r1 fetch a box; box b1 vanishes at a time (s)."""
    office.want(Desire(name="fetch", deadline=200.0, value=(p("has", "r1"), *more)))
    office.until(until)
    assert (0.0, TO_SHOP) in office.begun()
    office.forget("in b1 shop")
    return office


def calls(office: Office) -> list[str]:
    return [call for _, call in office.begun()]


# Redirected


def test_a_walk_to_a_vanished_box_is_redirected_to_another_one():
    office = fetch(yard(TRIANGLE, "in b2 yard"), until=2.0)
    office.until(60)
    assert office.begun() == [(0.0, TO_SHOP), (2.5, TO_YARD), (12.5, "(pick r1 b2 yard)")]
    assert (2.5, "is asked to stop", TO_SHOP) in office.timeline
    (end, _, _) = office.found("step_end")
    assert (end.detail["outcome"], end.detail["message"]) == ("cancelled", f"{TO_YARD} takes its place")
    assert office.plans() == [("fetch", "aborted"), ("fetch", "succeeded")]
    assert office.ends == [("fetch", "fulfilled", "")]


def test_a_robot_that_is_between_two_places_is_redirected():
    office = yard(TRIANGLE, "in b2 yard", sensed=True)
    office.want(Desire(name="fetch", deadline=200.0, value=(p("has", "r1"),)))
    office.until(0.5)
    office.forget("at r1 home")
    office.until(2.0)
    office.forget("in b1 shop")
    office.until(12.6)
    office.believe("at r1 yard")
    office.until(60)
    assert calls(office) == [TO_SHOP, TO_YARD, "(pick r1 b2 yard)"]
    assert office.begun()[1][0] == 2.5
    assert office.ends == [("fetch", "fulfilled", "")]


def test_the_redirected_step_waits_until_the_former_one_has_stopped():
    office = yard(TRIANGLE, "in b2 yard")
    office.behaviour[TO_SHOP] = Behaviour(lasts_s=10.0, stop_s=2.0)
    fetch(office, until=2.0).until(60)
    assert office.begun()[1] == (4.5, TO_YARD)
    assert office.ends == [("fetch", "fulfilled", "")]


# Not redirected


def test_a_walk_goes_on_where_no_road_leads_elsewhere():
    office = fetch(yard({"home shop": 10, "shop yard": 10}, "in b2 yard"), until=2.0)
    office.until(60)
    assert calls(office) == [TO_SHOP, "(move r1 shop yard)", "(pick r1 b2 yard)"]
    assert office.ends == [("fetch", "fulfilled", "")]


def test_a_walk_goes_on_where_the_way_through_its_end_is_shorter():
    office = fetch(yard({"home shop": 10, "home yard": 12, "shop yard": 3}, "in b2 yard"), until=9.0)
    office.until(60)
    assert calls(office) == [TO_SHOP, "(move r1 shop yard)", "(pick r1 b2 yard)"]


def test_a_walk_goes_on_that_the_desire_needs_otherwise():
    office = fetch(yard(TRIANGLE, "in b2 yard"), p("seen", "shop"), until=2.0)
    office.until(60)
    assert calls(office) == [TO_SHOP, "(move r1 shop yard)", "(pick r1 b2 yard)"]
    assert office.ends == [("fetch", "fulfilled", "")]


# Stopped


def test_a_walk_that_the_new_plan_does_not_need_is_stopped():
    office = yard({"home shop": 1}, "instance r2 robot; at r2 yard; in b2 yard")
    fetch(office, until=2.0).until(60)
    assert calls(office) == [TO_SHOP, "(pick r2 b2 yard)", "(share r1 r2)"]
    assert (2.5, "is asked to stop", TO_SHOP) in office.timeline
    assert office.ends == [("fetch", "fulfilled", "")]


def test_a_robot_that_has_left_its_place_is_not_stopped_on_its_way():
    office = yard({"home shop": 1}, "instance r2 robot; at r2 yard; in b2 yard", sensed=True)
    office.want(Desire(name="fetch", deadline=200.0, value=(p("has", "r1"),)))
    office.until(0.5)
    office.forget("at r1 home", "in b1 shop")
    office.until(9.0)
    office.believe("at r1 shop")
    office.until(60)
    assert calls(office) == [TO_SHOP, "(pick r2 b2 yard)", "(share r1 r2)"]
    assert (10.0, "ends", TO_SHOP) in office.timeline
    assert office.ends == [("fetch", "fulfilled", "")]


def test_a_walk_is_stopped_when_it_is_proved_that_nothing_can_be_fetched():
    office = fetch(yard(TRIANGLE), until=2.0)
    office.until(3.0)
    assert (2.5, "is asked to stop", TO_SHOP) in office.timeline
    assert office.wants == ["fetch"]
    office.believe("in b1 shop")
    office.until(60)
    assert office.ends == [("fetch", "fulfilled", "")]


def test_useful_steps_of_a_plan_end_before_it_is_given_up():
    office = fetch(yard(TRIANGLE, comp_plan_tries=1), p("warm"), until=2.0)
    office.until(60)
    assert (6.0, "ends", "(heat)") in office.timeline
    assert (6.0, "is asked to stop", TO_SHOP) in office.timeline
    ((name, how, reason),) = office.ends
    assert (name, how) == ("fetch", "dropped")
    assert "nothing can make (has r1) true" in reason


def test_a_proof_does_not_count_once_the_condition_holds_again():
    office = fetch(yard(TRIANGLE), p("warm"), until=2.0)
    office.until(4.0)
    office.believe("in b1 shop")
    office.until(60)
    assert sorted(calls(office)) == ["(heat)", TO_SHOP, "(pick r1 b1 shop)"]
    assert office.ends == [("fetch", "fulfilled", "")]


@pytest.mark.parametrize("at_s", [1.0, 5.0, 9.4])
def test_a_walk_is_redirected_at_any_time(at_s):
    office = fetch(yard({**TRIANGLE, "shop yard": 30}, "in b2 yard"), until=at_s)
    office.until(60)
    assert calls(office) == [TO_SHOP, TO_YARD, "(pick r1 b2 yard)"]
    assert office.begun()[1][0] == pytest.approx(at_s + 0.5)


def test_a_step_whose_effects_are_seen_ends_by_itself():
    office = yard({"home shop": 1}, "instance r2 robot; at r2 yard; in b2 yard", sensed=True)
    office.want(Desire(name="fetch", deadline=200.0, value=(p("has", "r1"),)))
    office.until(2.0)
    office.forget("at r1 home", "in b1 shop")
    office.believe("at r1 shop")
    office.until(60)
    assert (10.0, "ends", TO_SHOP) in office.timeline
    assert office.ends == [("fetch", "fulfilled", "")]
