"""Changed problems whose plans are plans for the original: without some actions, or with fewer options.

Actions are left out that touch facts of a silent sensor, and steps that keep failing. Large problems offer fewer
interchangeable objects.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

from socialbot.planning.pddl._parser import SexpGroup, SexpWord, read_sexpression
from socialbot.planning.pddl.domain import PddlAction, PddlDomain, PddlProblem, PlanStep
from socialbot.planning.pddl.formulas import Fluent, Key, Not, Predicate, TypedName, conjuncts, typed_text
from socialbot.planning.pddl.reader import read_domain
from socialbot.planning.pddl.semantics import GroundAction
from socialbot.planning.pddl.state import PddlState

_CONDITION = {":action": ":precondition", ":durative-action": ":condition"}


def touches(action: GroundAction, patterns: Sequence[Key]) -> bool:
    """Return whether conditions or effects of an action mention a part of the state; ``*`` stands for any object."""
    return any(
        _matches(key.terms, pattern.terms)
        for key in _keys((action.conditions, action.effects))
        for pattern in patterns
        if (type(key), key.name) == (type(pattern), pattern.name)
    )


def restricted(
    domain: PddlDomain, problem: PddlProblem, unavailable: Sequence[Key], avoided: Sequence[PlanStep] = ()
) -> tuple[PddlDomain, PddlProblem]:
    """Return the domain and problem without the actions that touch ``unavailable`` parts of the state.

    Each plan for the result is a plan for the original. An action that may touch such a part under a quantifier, or by
    a derived predicate, is left out for all objects.

    Args:
        unavailable: Predicates and functions; ``*`` stands for any object.
        avoided: Steps whose actions are left out for their objects.
    """
    left_out: set[str] = set()
    conditions: dict[str, list[Predicate]] = {}
    marks: dict[str, Key] = {f"unavailable-{number}": key for number, key in enumerate(unavailable)}
    for action in domain.actions.values():
        variables = {typed.name for typed in action.parameters}
        for mark, pattern in marks.items():
            for key in _touching(domain, action, pattern):
                if key is None or set(pattern.terms) <= {"*"} or _variables(key) - variables:
                    left_out.add(action.name)
                else:
                    conditions.setdefault(action.name, []).append(Predicate(mark, key.terms))
    state = PddlState.of(problem, domain)
    facts = {Predicate(mark, terms) for mark, key in marks.items() for terms in _instances(domain, state, key)}
    signatures = {
        mark: (domain.predicates if isinstance(key, Predicate) else domain.functions)[key.name].parameters
        for mark, key in marks.items()
    }
    for name in dict.fromkeys(step.action for step in avoided):
        mark, parameters = f"avoided-{name}", domain.actions[name].parameters
        signatures[mark] = parameters
        conditions.setdefault(name, []).append(Predicate(mark, tuple(typed.name for typed in parameters)))
    facts |= {Predicate(f"avoided-{step.action}", step.args) for step in avoided}
    text = _restricted_text(domain, left_out, conditions, signatures)
    return read_domain(text, where=domain.where), replace(problem, facts=problem.facts | facts, text="")


def _touching(domain: PddlDomain, action: PddlAction, pattern: Key) -> Iterator[Key | None]:
    """Yield the keys of an action that a pattern may fit; None for a derived predicate that depends on such a key."""
    for key in _keys((action.conditions, action.effects)):
        if (type(key), key.name) == (type(pattern), pattern.name):
            yield key
        elif isinstance(key, Predicate) and _depends(domain, key.name, pattern.name, set()):
            yield None


def _depends(domain: PddlDomain, derived: str, name: str, seen: set[str]) -> bool:
    if derived not in domain.derived or derived in seen:
        return False
    inner = {key.name for key in _keys(domain.derived[derived][1])}
    return name in inner or any(_depends(domain, other, name, seen | {derived}) for other in inner)


def _keys(part: Any) -> Iterator[Key]:
    """Yield the predicates and functions in conditions and effects."""
    if isinstance(part, Predicate | Fluent):
        yield part
    elif isinstance(part, tuple):
        for one in part:
            yield from _keys(one)
    elif is_dataclass(part):
        for one in fields(part):
            yield from _keys(getattr(part, one.name))


def _variables(key: Key) -> set[str]:
    return {term for term in key.terms if term.startswith("?")}


def _matches(terms: tuple[str, ...], patterns: tuple[str, ...]) -> bool:
    """Return whether objects fit patterns; a variable fits any."""
    return len(terms) == len(patterns) and all(
        term.startswith("?") or fnmatchcase(term, pattern) for term, pattern in zip(terms, patterns, strict=True)
    )


def _instances(domain: PddlDomain, state: PddlState, key: Key) -> Iterator[tuple[str, ...]]:
    """Yield the objects for which a pattern is unavailable."""
    if set(key.terms) <= {"*"}:
        return
    signature = (domain.predicates if isinstance(key, Predicate) else domain.functions)[key.name]
    possible = [
        [name for name in state.objects(typed.types) if fnmatchcase(name, pattern)]
        for typed, pattern in zip(signature.parameters, key.terms, strict=True)
    ]
    yield from itertools.product(*possible)


def _restricted_text(
    domain: PddlDomain,
    left_out: set[str],
    conditions: dict[str, list[Predicate]],
    signatures: dict[str, tuple[TypedName, ...]],
) -> str:
    declared = tuple(_written(f"({mark} {typed_text(parameters)})") for mark, parameters in signatures.items())
    whole, items = read_sexpression(domain.text, where=domain.where or domain.name), []
    is_declared = False
    for item in whole.items:
        head = item.head if isinstance(item, SexpGroup) else ""
        name = str(item.items[1]) if isinstance(item, SexpGroup) and head in _CONDITION else ""
        if name in left_out:
            continue
        if isinstance(item, SexpGroup) and head == ":requirements":
            item = SexpGroup((*item.items, _written(":negative-preconditions")), item.line)
        elif isinstance(item, SexpGroup) and head == ":predicates" and not is_declared:
            item, is_declared = SexpGroup((*item.items, *declared), item.line), True
        elif isinstance(item, SexpGroup) and name in conditions:
            item = _with_conditions(item, conditions[name])
        items.append(item)
    if not is_declared:
        place = next(n for n, item in enumerate(items) if isinstance(item, SexpGroup) and item.head in _CONDITION)
        items.insert(place, SexpGroup((_written(":predicates"), *declared), whole.line))
    return str(SexpGroup(tuple(items), whole.line))


def _with_conditions(action: SexpGroup, unavailable: list[Predicate]) -> SexpGroup:
    """Return an action with the condition that its objects are available."""
    keyword = _CONDITION[action.head]
    needed = [str(Not(one)) for one in dict.fromkeys(unavailable)]
    if keyword == ":condition":
        needed = [f"(at start {one})" for one in needed]
    words = [str(item) for item in action.items]
    if keyword not in words:
        words[2:2] = [keyword, "()"]
    place = words.index(keyword) + 1
    words[place] = f"(and {' '.join([words[place].removeprefix('()'), *needed]).strip()})"
    return SexpGroup(tuple(map(_written, words)), action.line)


def _written(text: str) -> SexpWord:
    """Return PDDL to be printed as it is."""
    return SexpWord(text, 0)


LARGE = 100_000
"""Number of possible ground actions from which a problem is reduced."""
KEPT_OPTIONS = (1, 2)
"""Numbers of objects that keep an option, in the order in which they are tried."""


def with_fewer_options(domain: PddlDomain, problem: PddlProblem, kept: int) -> PddlProblem | None:
    """Return a large problem in which only ``kept`` objects have an option, such as a stack that takes boxes.

    An option is a predicate of one object that no action changes and that conditions only ask to be true. The objects
    of which the fewest facts hold keep it. Each plan for the result is a plan for the original, but the result may
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
        dropped.update(holders[kept:])
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
    return (found & required) - {key.name for key in _keys(tuple(elsewhere))}
