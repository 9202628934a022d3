"""Smaller problems whose plans are plans for the original: they offer fewer interchangeable objects."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

from socialbot.planning.pddl.domain import PddlDomain, PddlProblem
from socialbot.planning.pddl.formulas import Predicate, conjuncts
from socialbot.planning.pddl.state import PddlState

LARGE = 100_000
"""Number of possible ground actions from which a problem is reduced."""
KEPT = 2
"""Number of objects that keep an option."""


def with_fewer_options(domain: PddlDomain, problem: PddlProblem) -> PddlProblem | None:
    """Return a large problem in which only some objects keep an option, such as a stack that takes boxes.

    An option is a predicate of one object that no action changes and that conditions only ask to be true. It stays for
    the objects of which the fewest facts hold. Each plan for the result is a plan for the original, but the result may
    have none.

    Returns:
        The reduced problem; None if the problem is not large or has no options.
    """
    if _ground_actions(domain, problem) < LARGE:
        return None
    degrees = Counter(term for fact in problem.facts for term in fact.terms)
    dropped: set[Predicate] = set()
    for name in sorted(_options(domain, problem)):
        holders = sorted(
            (fact for fact in problem.facts if fact.name == name), key=lambda fact: (degrees[fact.terms[0]], fact.terms)
        )
        dropped.update(holders[KEPT:])
    return replace(problem, facts=problem.facts - dropped, text="") if dropped else None


def _ground_actions(domain: PddlDomain, problem: PddlProblem) -> int:
    state = PddlState.of(problem, domain)
    return sum(
        math.prod(len(state.objects(typed.types)) for typed in action.parameters) for action in domain.actions.values()
    )


def _options(domain: PddlDomain, problem: PddlProblem) -> set[str]:
    """Return the predicates of one object that occur only as positive conditions of actions."""
    found = {name for name, signature in domain.predicates.items() if len(signature.parameters) == 1}
    elsewhere: list[Any] = [problem.goal, *problem.timed, *(formula for _, formula in domain.derived.values())]
    required: set[str] = set()
    for action in domain.actions.values():
        elsewhere += action.effects
        for condition in action.conditions:
            for part in conjuncts(condition.formula):
                if isinstance(part, Predicate):
                    required.add(part.name)
                else:
                    elsewhere.append(part)
    return (found & required) - {name for part in elsewhere for name in _names(part)}


def _names(part: Any) -> Iterator[str]:
    """Yield the names of all predicates in a formula or effect."""
    if isinstance(part, Predicate):
        yield part.name
    elif isinstance(part, tuple):
        for one in part:
            yield from _names(one)
    elif is_dataclass(part):
        for one in fields(part):
            yield from _names(getattr(part, one.name))
