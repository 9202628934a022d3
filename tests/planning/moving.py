"""A small domain for the tests of planners: a robot carries things between rooms, one at a time."""

from __future__ import annotations

from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.planners.planner import PlannerAnswer

DOMAIN = """
(define (domain moving)
  (:requirements :typing :durative-actions :fluents)
  (:types robot thing - object room)
  (:predicates (at ?r - robot ?x - room) (lies ?t - thing ?x - room) (has ?r - robot ?t - thing))
  (:functions (carried ?r - robot))
  (:durative-action go
    :parameters (?r - robot ?from - room ?to - room)
    :duration (= ?duration 5)
    :condition (at start (at ?r ?from))
    :effect (and (at start (not (at ?r ?from))) (at end (at ?r ?to))))
  (:durative-action take
    :parameters (?r - robot ?t - thing ?x - room)
    :duration (= ?duration 2)
    :condition (and (at start (lies ?t ?x)) (over all (at ?r ?x)) (at start (< (carried ?r) 1)))
    :effect (and (at start (not (lies ?t ?x))) (at start (increase (carried ?r) 1)) (at end (has ?r ?t))))
  (:durative-action put
    :parameters (?r - robot ?t - thing ?x - room)
    :duration (= ?duration 2)
    :condition (and (at start (has ?r ?t)) (over all (at ?r ?x)))
    :effect (and (at start (not (has ?r ?t))) (at end (lies ?t ?x)) (at end (decrease (carried ?r) 1)))))
"""

PROBLEM = """
(define (problem tea)
  (:domain moving)
  (:objects rob - robot cup - thing kitchen hall - room)
  (:init (at rob hall) (lies cup kitchen) (= (carried rob) 0))
  (:goal (lies cup hall)))
"""

PLAN = """
0.000: (go rob hall kitchen) [5.000]
5.001: (take rob cup kitchen) [2.000]
7.002: (go rob kitchen hall) [5.000]
12.003: (put rob cup hall) [2.000]
"""
"""A plan for PROBLEM, 14.003 s."""

HARD_DOMAIN = """
(define (domain hard)
  (:predicates (p ?a ?b ?c) (q ?a))
  (:functions (n))
  (:durative-action twist
    :parameters (?a ?b ?c ?d)
    :duration (= ?duration 1)
    :condition (and (at start (p ?a ?b ?c)) (at start (q ?d)))
    :effect (and (at end (not (p ?a ?b ?c))) (at end (p ?b ?c ?d)) (at end (increase (n) 1)))))
"""


def domain() -> PddlDomain:
    """The domain, read."""
    return read_domain(DOMAIN, where="moving.pddl")


def problem(goal: str = "(lies cup hall)") -> PddlProblem:
    """The problem, with another goal perhaps."""
    return read_problem(PROBLEM.replace("(lies cup hall))", f"{goal})"), domain(), where="tea.pddl")


def plan_of(answer: PlannerAnswer) -> PddlPlan:
    """The plan that came of planning; an AssertionError with the message if there is none."""
    assert answer.plan is not None, f"{answer.verdict}: {answer.message}"
    return answer.plan


def hard() -> tuple[PddlDomain, PddlProblem]:
    """A problem that keeps any planner busy for long: millions of actions, and a goal far away."""
    known = read_domain(HARD_DOMAIN, where="hard.pddl")
    names = [f"o{number}" for number in range(40)]
    text = f"""(define (problem far) (:domain hard) (:objects {" ".join(names)})
      (:init (p o0 o1 o2) (= (n) 0) {" ".join(f"(q {name})" for name in names)})
      (:goal (and (p o39 o38 o37) (> (n) 5000))))"""
    return known, read_problem(text, known, where="far.pddl")
