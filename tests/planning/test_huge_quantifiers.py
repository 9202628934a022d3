"""Quantifiers over so many combinations of objects that a look at all of them would not end."""

from __future__ import annotations

import time

import pytest

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.reachability import unreachable_goals
from socialbot.planning.pddl.reader import read_domain, read_problem

MANY = " ".join(f"?v{number} - thing" for number in range(10))


def domain(*, condition: str = "()", effect: str = "(p)", derived: str = "") -> str:
    return f"""(define (domain d) (:types thing)
        (:predicates (p) (g) (q ?a - thing) (r ?a ?b - thing)) {derived}
        (:action a :parameters () :precondition {condition} :effect {effect}))"""


def problem(goal: str = "(g)", count: int = 30) -> str:
    objects = " ".join(f"o{number}" for number in range(count))
    return f"(define (problem x) (:domain d) (:objects {objects} - thing) (:init) (:goal {goal}))"


NESTED = "(q ?e)"
for variable in "edcbaedcba":
    NESTED = f"(forall (?{variable} - thing) (or (p) {NESTED}))"


@pytest.mark.parametrize(
    ("texts", "what"),
    [
        ((domain(), problem(f"(forall ({MANY}) (or (p) (q ?v0)))")), "the goal"),
        ((domain(), problem(NESTED)), "the goal"),
        ((domain(condition=f"(exists ({MANY}) (q ?v0))"), problem()), "the condition of the action a"),
        ((domain(effect=f"(forall ({MANY}) (q ?v0))"), problem()), "the effect of the action a"),
        ((domain(effect=f"(when (forall ({MANY}) (q ?v0)) (p))"), problem()), "the effect of the action a"),
        (
            (domain(derived=f"(:derived (r ?a ?b - thing) (exists ({MANY}) (r ?a ?v0)))"), problem()),
            "the condition of the derived predicate r",
        ),
    ],
)
def test_too_many_combinations_are_refused(texts: tuple[str, str], what: str) -> None:
    text, asked = texts
    begun = time.process_time()
    with pytest.raises(PlanningError, match=rf"{what} has \d\.\de\+\d+ combinations of objects, more than"):
        read_problem(asked, read_domain(text))
    read_problem(problem(count=2), read_domain(text))
    assert time.process_time() - begun < 1.0


def test_reachability_ends_without_a_result_for_a_large_effect() -> None:
    known = read_domain(domain(effect="(forall (?a ?b - thing) (r ?a ?b))"))
    begun = time.process_time()
    assert unreachable_goals(known, read_problem(problem(count=900), known)) == ()
    assert time.process_time() - begun < 5.0
    assert len(unreachable_goals(known, read_problem(problem(count=30), known))) == 1
