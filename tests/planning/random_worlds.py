"""Random domains and plans for the property tests. Durations are free, so that plans can be stretched."""

from __future__ import annotations

import random
from collections.abc import Callable

from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem, PlanStep
from socialbot.planning.pddl.reader import read_domain, read_problem

OBJECTS = ("a", "b", "c")


def _atom(chance: random.Random) -> str:
    name = chance.choice(("p", "q", "r"))
    return f"({name} {chance.choice(('?x', *OBJECTS))})" if name != "r" else "(r)"


def _fluent(chance: random.Random) -> str:
    return chance.choice(("(n ?x)", "(n a)", "(m)"))


def formula(chance: random.Random, depth: int = 2) -> str:
    kind = chance.random()
    if kind < 0.45 or depth == 0:
        return _atom(chance)
    if kind < 0.6:
        return f"(not {_atom(chance)})"
    if kind < 0.75:
        return f"({chance.choice(('<', '<=', '=', '>=', '>'))} {_fluent(chance)} {chance.randint(-2, 3)})"
    if kind < 0.85:
        return f"(or {formula(chance, depth - 1)} {formula(chance, depth - 1)})"
    if kind < 0.9:
        return f"(exists (?y - t) (and (not (= ?y ?x)) ({chance.choice('pq')} ?y)))"
    if kind < 0.95:
        return f"(forall (?y - t) (or (= ?y ?x) ({chance.choice('pq')} ?y)))"
    return "(some ?x)"


def effect(chance: random.Random) -> str:
    kind = chance.random()
    if kind < 0.4:
        return _atom(chance)
    if kind < 0.7:
        return f"(not {_atom(chance)})"
    if kind < 0.9:
        operator = chance.choice(("increase", "decrease", "increase", "assign"))
        amount = chance.choice(("1", "2", "(m)")) if chance.random() < 0.3 else "1"
        return f"({operator} {_fluent(chance)} {amount})"
    if kind < 0.95:
        return f"(when {_atom(chance)} {_atom(chance)})"
    return f"(forall (?y - t) (when (p ?y) (not ({chance.choice('pq')} ?y))))"


def domain_text(chance: random.Random) -> str:
    actions = []
    for number in range(4):
        conditions = [
            f"({when} {formula(chance)})"
            for when in ("at start", "over all", "at end")
            for _ in range(chance.choice((0, 0, 1, 1, 2)))
        ]
        effects = [
            f"({when} {effect(chance)})" for when in ("at start", "at end") for _ in range(chance.choice((0, 1, 1, 2)))
        ]
        actions.append(
            f"(:durative-action act{number} :parameters (?x - t) :duration (>= ?duration 0.01)\n"
            f" :condition (and {' '.join(conditions)})\n :effect (and {' '.join(effects)}))"
        )
    instant = f"(:action snap :parameters (?x - t) :precondition {formula(chance)} :effect {effect(chance)})"
    return (
        "(define (domain random) (:types t) (:constants a b c - t)\n"
        "(:predicates (p ?x - t) (q ?x - t) (r) (some ?x - t))\n"
        "(:functions (n ?x - t) (m))\n(:derived (some ?x - t) (or (p ?x) (and (q ?x) (r))))\n"
        + "\n".join(actions)
        + f"\n{instant})"
    )


def problem_text(chance: random.Random) -> str:
    facts = [f"({name} {one})" for name in "pq" for one in OBJECTS if chance.random() < 0.6]
    facts += ["(r)"] if chance.random() < 0.5 else []
    facts += [f"(= {fluent} {chance.randint(-1, 2)})" for fluent in ("(n a)", "(n b)", "(n c)", "(m)")]
    return f"(define (problem random) (:domain random) (:init {' '.join(facts)}))"


def random_pair(seed: int) -> tuple[PddlDomain, PddlProblem, random.Random]:
    chance = random.Random(seed)
    domain = read_domain(domain_text(chance))
    return domain, read_problem(problem_text(chance), domain), chance


def random_plan(
    domain: PddlDomain,
    problem: PddlProblem,
    chance: random.Random,
    valid: Callable[[PddlDomain, PddlProblem, PddlPlan], bool],
    size: int,
) -> PddlPlan:
    """Steps that were tried one after the other at random times, as long as ``valid`` has nothing against them."""
    plan = PddlPlan()
    for _ in range(size * 6):
        name = chance.choice(tuple(domain.actions))
        duration = 0.0 if domain.actions[name].duration is None else chance.choice((1.0, 2.5, 4.0))
        offset = chance.random() * 0.9
        step = PlanStep(round(chance.choice((0, 1, 2, 3, 5, 8)) + offset, 3), name, (chance.choice(OBJECTS),), duration)
        longer = PddlPlan(tuple(sorted((*plan.steps, step), key=lambda one: one.start_s)))
        if len(plan.steps) < size and valid(domain, problem, longer):
            plan = longer
    return plan
