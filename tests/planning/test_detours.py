"""Detours of plans are removed, and nothing else."""

from __future__ import annotations

import pytest

from socialbot.planning.pddl.causal_order import without_detours
from socialbot.planning.pddl.domain import parse_plan
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.pddl.validation import validate_plan
from socialbot.planning.planners.engines import make_planner
from socialbot.planning.planners.planner import PlannerLimits

TOWN = read_domain(
    """
    (define (domain town)
      (:requirements :typing :durative-actions :fluents)
      (:types robot place - object)
      (:predicates (at ?r - robot ?p - place) (road ?a ?b - place) (seen ?p - place) (swept ?p - place))
      (:functions (distance ?a ?b - place))
      (:durative-action drive :parameters (?r - robot ?a ?b - place) :duration (= ?duration (distance ?a ?b))
        :condition (and (at start (at ?r ?a)) (at start (road ?a ?b)))
        :effect (and (at start (not (at ?r ?a))) (at end (at ?r ?b))))
      (:durative-action look :parameters (?r - robot ?p - place) :duration (= ?duration 1)
        :condition (over all (at ?r ?p)) :effect (at end (seen ?p)))
      (:durative-action sweep :parameters (?p - place) :duration (= ?duration 3)
        :condition (at start (seen ?p)) :effect (at end (swept ?p))))
    """,
    where="town",
)
PLACES = ("a", "b", "c", "d")
DETOUR = """
0: (drive r a b) [5]
5.001: (drive r b c) [5]
10.002: (look r c) [1]
11.003: (sweep c) [3]
"""


def problem(goal: str, *missing: str, direct: float = 6.0):
    pairs = [(one, other) for one in PLACES for other in PLACES if one != other and f"{one} {other}" not in missing]
    roads = " ".join(f"(road {one} {other})" for one, other in pairs)
    far = {("a", "c"): direct}
    distances = " ".join(f"(= (distance {one} {other}) {far.get((one, other), 5)})" for one, other in pairs)
    return read_problem(
        f"(define (problem p) (:domain town) (:objects r s - robot {' '.join(PLACES)} - place)"
        f" (:init (at r a) (at s d) {roads} {distances}) (:goal (and {goal})))",
        TOWN,
    )


def calls(plan) -> list[str]:
    return [step.call for step in plan.steps]


def test_one_step_stands_for_a_detour():
    task = problem("(swept c)")
    plan = without_detours(TOWN, task, parse_plan(DETOUR))
    assert calls(plan) == ["(drive r a c)", "(look r c)", "(sweep c)"]
    assert plan.makespan_s == pytest.approx(10.002)
    assert validate_plan(TOWN, task, plan) == ()


def test_a_detour_of_several_steps_is_removed():
    plan = parse_plan(
        "0: (drive r a b) [5]\n5.001: (drive r b d) [5]\n10.002: (drive r d c) [5]\n15.003: (look r c) [1]"
    )
    assert calls(without_detours(TOWN, problem("(seen c)"), plan)) == ["(drive r a c)", "(look r c)"]


@pytest.mark.parametrize(
    ("task", "plan"),
    [
        (problem("(swept c)", "a c"), DETOUR),
        (problem("(swept c)", direct=60.0), DETOUR),
        (problem("(swept c) (seen b)"), "0: (drive r a b) [5]\n5: (look r b) [1]\n6.001: (drive r b c) [5]\n"
         "11.002: (look r c) [1]\n12.003: (sweep c) [3]"),
        (problem("(at r b) (at s c)"), "0: (drive r a b) [5]\n5.001: (drive s d c) [5]"),
    ],
    ids=["no road", "longer", "used between", "two robots"],
)  # fmt: skip
def test_other_plans_stay(task, plan):
    known = parse_plan(plan)
    assert validate_plan(TOWN, task, known) == ()
    assert without_detours(TOWN, task, known) == known


def test_the_detours_of_one_robot_are_removed_where_those_of_another_cannot():
    plan = parse_plan(DETOUR + "0: (drive s d b) [5]\n5.001: (drive s b a) [5]\n10.002: (look s a) [1]")
    task = problem("(swept c) (seen a)", "d a")
    found = without_detours(TOWN, task, plan)
    assert "(drive r a c)" in calls(found)
    assert "(drive s d b)" in calls(found)


def test_the_planner_drives_directly():
    task = problem("(seen b) (seen c) (seen d) (at r a)")
    answer = make_planner("kairos").solve(TOWN, task, PlannerLimits(5.0, 512))
    assert answer.plan is not None
    assert without_detours(TOWN, task, answer.plan) == answer.plan
