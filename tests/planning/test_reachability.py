"""Goals that nothing can make true, against plans that planners find."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest

from evaluation.warehouse_planning import first_question
from socialbot.planning.pddl import reachability
from socialbot.planning.pddl.domain import PddlProblem
from socialbot.planning.pddl.formulas import And, Predicate
from socialbot.planning.pddl.reachability import functions_without_values, unreachable_goals
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.planners.engines import make_planner
from socialbot.planning.planners.planner import PlannerLimits, PlannerVerdict
from tests.planning.random_worlds import random_pair


def without_box(problem: PddlProblem, box: str) -> PddlProblem:
    """The problem after the top box of a stack has vanished from what sensors report."""
    (below,) = (fact.terms[1] for fact in problem.facts if fact.name == "on" and fact.terms[0] == box)
    gone = frozenset(fact for fact in problem.facts if fact.name in ("on", "in", "clear") and box in fact.terms)
    facts = problem.facts - gone | {Predicate("clear", (below,))}
    return replace(problem, facts=facts)


def test_all_goals_of_a_solvable_problem_are_reachable():
    question = first_question(6)
    assert unreachable_goals(question.domain, question.problem) == ()


def test_a_vanished_box_is_the_only_unreachable_goal_and_the_reason_names_it():
    question = first_question(6)
    (goal,) = unreachable_goals(question.domain, without_box(question.problem, "box_a2"))
    assert str(goal.goal) == "(carrier_moving carrier_a box_a2)"
    assert goal.reason.startswith("nothing can make (carrier_moving carrier_a box_a2) true, which needs (holding ")
    assert "(on box_a2 " in goal.reason


CLIP = """
(define (domain clip) (:requirements :durative-actions)
  (:predicates (ready) (lit) (struck) (mended))
  (:durative-action strike :parameters () :duration (= ?duration 5)
    :condition (and (at start (ready)) (over all (lit)) (at end (mended)))
    :effect (and (at start (lit)) (at end (not (lit))) (at end (struck))))
  (:durative-action mend :parameters () :duration (= ?duration 2)
    :condition (over all (lit)) :effect (at end (mended))))
"""


def test_the_start_of_an_action_may_enable_what_its_end_needs():
    domain = read_domain(CLIP)
    for init, expected in (("(ready)", 0), ("", 1)):
        text = f"(define (problem p) (:domain clip) (:init {init}) (:goal (and (struck))))"
        problem = read_problem(text, domain)
        found = unreachable_goals(domain, problem)
        assert len(found) == expected
        solved = make_planner("kairos").solve(domain, problem, PlannerLimits())
        assert solved.verdict is (PlannerVerdict.IMPOSSIBLE if expected else PlannerVerdict.SOLVED)
    assert str(found[0]) == "nothing can make (struck) true, which needs (ready)"


def test_static_numbers_negations_and_constants_are_evaluated():
    domain = read_domain(
        """
        (define (domain shop) (:requirements :typing :fluents :negative-preconditions)
          (:types thing) (:constants lamp - thing)
          (:predicates (broken ?t - thing) (bought ?t - thing) (lit))
          (:functions (price ?t - thing) (money))
          (:action buy :parameters (?t - thing) :precondition (and (<= (price ?t) 5) (not (broken ?t)))
            :effect (bought ?t))
          (:action light :parameters () :precondition (bought lamp) :effect (lit)))
        """
    )
    init = "(= (price lamp) {}) (= (price cup) 9) (= (money) 3)"
    goal = "(:goal (and (bought cup) (lit)))"
    for price, broken, expected in ((4, "", 1), (7, "", 2), (4, "(broken lamp)", 2)):
        objects = "(:objects cup - thing)"
        text = f"(define (problem p) (:domain shop) {objects} (:init {init.format(price)} {broken}) {goal})"
        found = unreachable_goals(domain, read_problem(text, domain))
        assert len(found) == expected
        assert str(found[0].goal) == "(bought cup)"


@pytest.mark.parametrize("seed", range(60))
def test_goals_that_a_planner_reaches_are_reachable(seed):
    domain, problem, _ = random_pair(seed)
    answer = make_planner().solve(domain, problem, PlannerLimits(timeout_s=1.0))
    assert answer.verdict is not PlannerVerdict.SOLVED or unreachable_goals(domain, problem) == ()


def test_the_reason_for_24_boxes_costs_little():
    question = first_question(24)
    begun = time.process_time()
    impossible = And((question.problem.goal, Predicate("clear", ("nothing",))))  # type: ignore[arg-type]
    problem = replace(question.problem, goal=impossible)
    (goal,) = unreachable_goals(question.domain, problem)
    assert str(goal.goal) == "(clear nothing)"
    assert time.process_time() - begun < 2.0


def test_a_problem_that_is_too_large_has_no_reason(monkeypatch):
    monkeypatch.setattr(reachability, "MAX_BINDINGS", 100)
    question = first_question(6)
    assert unreachable_goals(question.domain, without_box(question.problem, "box_a2")) == ()


FUEL = """(define (domain d) (:requirements :fluents) (:predicates (done)) (:functions (fuel) (level ?x) (set) (unread))
  (:action go :parameters (?x) :precondition (and (> (fuel) 1) (> (set) 0) (> (level ?x) 0))
    :effect (and (done) (decrease (fuel) 1)))
  (:action fill :parameters () :precondition (done) :effect (assign (set) 1)))"""


@pytest.mark.parametrize(
    ("init", "named"),
    [("", ["fuel", "level"]), ("(= (fuel) 2)", ["level"]), ("(= (fuel) 2) (at 3 (= (level a) 1))", [])],
)
def test_functions_without_any_value_are_named(init: str, named: list[str]) -> None:
    domain = read_domain(FUEL)
    problem = read_problem(f"(define (problem p) (:domain d) (:objects a) (:init {init}) (:goal (done)))", domain)
    assert [one.name for one in functions_without_values(domain, problem)] == named
