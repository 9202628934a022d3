"""Find goals that no plan can reach: relaxed reachability, without delete effects and with any number.

Everything that a plan can reach is reachable. A goal that is not reachable proves that there is no plan.
"""

from __future__ import annotations

import bisect
import itertools
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Literal

from socialbot.planning.pddl.domain import PddlAction, PddlDomain, PddlPlan, PddlProblem, PlanStep, Signature
from socialbot.planning.pddl.formulas import (
    Add,
    And,
    ConditionalEffect,
    Delete,
    Effect,
    Equality,
    Fluent,
    Formula,
    Not,
    NumericComparison,
    NumericEffect,
    Or,
    Predicate,
    UniversalEffect,
    conjuncts,
    simple_effects,
)
from socialbot.planning.pddl.semantics import Binding, bindings, changes, fluents, ground, holds, substitute
from socialbot.planning.pddl.state import PddlState

MAX_BINDINGS = 300_000
"""Number of bindings of conditions and parameters after which the search ends without a result."""
_Edge = Literal["start", "end"]
_EDGES: tuple[_Edge, ...] = ("start", "end")
MAX_REASONS = 5
"""Number of conditions that a reason lists."""


@dataclass(frozen=True)
class UnreachableGoal:
    """A part of a goal that no plan reaches, and the reason as a text."""

    goal: Formula
    reason: str

    def __str__(self) -> str:
        return self.reason


def unreachable_goals(domain: PddlDomain, problem: PddlProblem) -> tuple[UnreachableGoal, ...]:
    """Return the parts of the goal that nothing can make true; none for a problem of more than `MAX_BINDINGS`."""
    goals = [] if problem.goal is None else list(conjuncts(problem.goal))
    try:
        relaxed = _Relaxation(domain, problem)
    except _TooLargeError:
        return ()
    missing = [goal for goal in goals if not relaxed.may_hold(goal)]
    return tuple(UnreachableGoal(goal, relaxed.reason(goal)) for goal in missing)


def functions_without_values(domain: PddlDomain, problem: PddlProblem) -> tuple[Signature, ...]:
    """Return the functions that actions or the goal read, and that have no value for any objects, now or later."""
    effects = [timed.effect for action in domain.actions.values() for timed in action.effects]
    changes = simple_effects((*effects, *(timed.effect for timed in problem.timed)))
    assigned = {one.fluent.name for one in changes if isinstance(one, NumericEffect) and one.operator == "assign"}
    known = assigned | {fluent.name for fluent in problem.values}
    read = set(_functions_in((*domain.actions.values(), *domain.derived.values(), problem.goal)))
    return tuple(signature for name, signature in domain.functions.items() if name in read - known)


def _functions_in(part: object) -> Iterator[str]:
    if isinstance(part, Fluent):
        yield part.name
    elif isinstance(part, tuple):
        for each in part:
            yield from _functions_in(each)
    elif is_dataclass(part):
        for each in fields(part):
            yield from _functions_in(getattr(part, each.name))


def losing_step(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan, goals: Iterable[Formula]) -> PlanStep | None:
    """Return the first step of a plan after which one of some goals is out of reach that was not before it.

    Raises PlanningError for a step that cannot be applied.
    """
    out_of_reach = {one.goal for one in unreachable_goals(domain, replace(problem, goal=And(tuple(goals))))}
    kept = And(tuple(goal for goal in goals if goal not in out_of_reach))
    state, steps, states = PddlState.of(problem, domain), sorted(plan.steps, key=lambda step: step.end_s), []
    for step in steps:
        action = ground(domain.actions[step.action], step.args)
        for when in ("start", "end"):
            state.apply(changes(action.effects_at(when), state, duration=step.duration_s))
        states.append(state.copy())
    # What is out of reach stays so.
    first = bisect.bisect_left(states, True, key=lambda state: bool(unreachable_goals(domain, state.problem(kept))))
    return steps[first] if first < len(steps) else None


class _TooLargeError(Exception):
    """The problem has too many ground actions."""


class _Relaxation:
    """The predicates that a plan may make true, as far as they are known from the start on."""

    def __init__(self, domain: PddlDomain, problem: PddlProblem) -> None:
        self.state = PddlState.of(problem, domain)
        self.domain = domain
        self._bindings = 0
        self._most: float = MAX_BINDINGS
        self.reached: dict[str, set[tuple[str, ...]]] = {}
        self._index: dict[tuple[str, int, str], set[tuple[str, ...]]] = {}
        effects = [effect.effect for action in domain.actions.values() for effect in action.effects]
        changes = list(simple_effects([*effects, *(timed.effect for timed in problem.timed)]))
        self._deleted = {effect.predicate.name for effect in changes if isinstance(effect, Delete)}
        self._changed = {effect.fluent.name for effect in changes if isinstance(effect, NumericEffect)}
        for predicate in problem.facts:
            self._reach(predicate)
        for timed in problem.timed:
            if isinstance(timed.effect, Add):
                self._reach(timed.effect.predicate)
        while sum(self._apply(action) for action in domain.actions.values()):
            pass
        self._most = math.inf  # reasons look at few

    def may_hold(self, formula: Formula, binding: Binding | None = None) -> bool:
        """Return False only for a ground formula that never holds."""
        bound = binding or {}
        match formula:
            case Predicate(name, terms):
                if name in self.domain.derived:
                    return True
                return tuple(bound.get(term, term) for term in terms) in self.reached.get(name, ())
            case And(parts):
                return all(self.may_hold(part, bound) for part in parts)
            case Or(parts):
                return any(self.may_hold(part, bound) for part in parts)
            case Not(Predicate(name)):
                return name in self._deleted or name in self.domain.derived or holds(formula, self.state, bound)
            case NumericComparison(_, left, right):
                names = {fluent.name for side in (left, right) for fluent in fluents(side)}
                return bool(names & self._changed) or holds(formula, self.state, bound)
            case Equality() | Not(Equality()):
                return holds(formula, self.state, bound)
            case _:
                return True

    def reason(self, goal: Formula) -> str:
        """Return why a formula never holds: the chain of conditions that lack something, as a text."""
        chain, missing = [str(goal)], next((part for part in _atoms(goal) if not self._matches(part)), None)
        while missing is not None and len(chain) <= MAX_REASONS:
            if chain[-1] != str(missing):
                chain.append(str(missing))
            missing = self._missing_for(missing, chain)
        return f"nothing can make {chain[0]} true" + "".join(f", which needs {need}" for need in chain[1:])

    def _missing_for(self, wanted: Predicate, seen: list[str]) -> Predicate | None:
        """Return a condition that never holds of an action that would bring about ``wanted``."""
        for action in self.domain.actions.values():
            for timed, effect in ((one, part) for one in action.effects for part in simple_effects((one.effect,))):
                binding = _unified(effect.predicate, wanted) if isinstance(effect, Add) else None
                if binding is None:
                    continue
                for condition in _conditions(action, timed.when):
                    for part in _atoms(condition):
                        need = substitute(part, binding)
                        if _shape(str(need)) not in map(_shape, seen) and not self._matches(need):
                            return need
        return None

    def _matches(self, pattern: Predicate) -> bool:
        return pattern.name in self.domain.derived or any(True for _ in self._matching(pattern, {}))

    def _reach(self, predicate: Predicate) -> bool:
        known = self.reached.setdefault(predicate.name, set())
        if predicate.terms in known:
            return False
        known.add(predicate.terms)
        for place, term in enumerate(predicate.terms):
            self._index.setdefault((predicate.name, place, term), set()).add(predicate.terms)
        return True

    def _apply(self, action: PddlAction) -> bool:
        """Reach what the start and the end of an action bring about; return whether that is new."""
        edges: list[_Edge] = [edge for edge in _EDGES if any(one.when == edge for one in action.effects)]
        return sum(self._apply_at(action, edge) for edge in edges) > 0

    def _apply_at(self, action: PddlAction, edge: _Edge) -> bool:
        conditions = list(_conditions(action, edge))
        atoms = [part for part in conditions if isinstance(part, Predicate) and part.name not in self.domain.derived]
        others = [part for part in conditions if part not in atoms]
        adds = [effect.effect for effect in action.effects if effect.when == edge]
        found = [
            predicate
            for binding in self._joined(atoms, {})
            for full in self._completed(action, binding)
            if all(self.may_hold(other, full) for other in others)
            for predicate in self._added(adds, full)
        ]
        return sum(self._reach(predicate) for predicate in found) > 0

    def _joined(self, atoms: list[Predicate], binding: dict[str, str]) -> Iterator[dict[str, str]]:
        """Yield the bindings for which all atoms are reached; the atom with the fewest matches comes first."""
        if not atoms:
            yield binding
            return
        first = min(atoms, key=lambda atom: len(self._candidates(atom, binding)))
        rest = [atom for atom in atoms if atom is not first]
        for found in self._matching(first, binding):
            yield from self._joined(rest, found)

    def _matching(self, atom: Predicate, binding: dict[str, str]) -> Iterator[dict[str, str]]:
        for terms in self._candidates(atom, binding):
            found = dict(binding)
            self._count()
            if all(_bind(found, term, value) for term, value in zip(atom.terms, terms, strict=True)):
                yield found

    def _candidates(self, atom: Predicate, binding: dict[str, str]) -> set[tuple[str, ...]]:
        sets = [self.reached.get(atom.name, set())]
        for place, term in enumerate(atom.terms):
            value = binding.get(term, term)
            if not value.startswith("?"):
                sets.append(self._index.get((atom.name, place, value), set()))
        return min(sets, key=len)

    def _completed(self, action: PddlAction, binding: dict[str, str]) -> Iterator[dict[str, str]]:
        """Yield the binding with objects of the right types for all parameters."""
        possible = [self.state.objects(parameter.types) for parameter in action.parameters]
        names = [
            tuple(name for name in objects if binding.get(parameter.name, name) == name)
            for parameter, objects in zip(action.parameters, possible, strict=True)
        ]
        for objects in itertools.product(*names):
            self._count()
            yield {parameter.name: name for parameter, name in zip(action.parameters, objects, strict=True)}

    def _count(self) -> None:
        self._bindings += 1
        if self._bindings > self._most:
            raise _TooLargeError

    def _added(self, effects: Iterable[Effect], binding: Binding) -> Iterator[Predicate]:
        for effect in effects:
            match effect:
                case Add(predicate):
                    yield substitute(predicate, binding)
                case ConditionalEffect(_, inside):
                    yield from self._added(inside, binding)
                case UniversalEffect(variables, inside):
                    for one in bindings(variables, self.state, binding):
                        self._count()
                        yield from self._added(inside, one)
                case _:
                    pass


def _shape(text: str) -> str:
    """Return a predicate as a text without the names of its variables."""
    return re.sub(r"\?[^\s)]+", "?", text)


def _bind(binding: dict[str, str], term: str, value: str) -> bool:
    """Bind a term to a value; return False if it has another one."""
    return (binding.setdefault(term, value) if term.startswith("?") else term) == value


def _unified(added: Predicate, wanted: Predicate) -> dict[str, str] | None:
    """Return the binding with which an added predicate is the wanted one, whose own variables stay open."""
    if added.name != wanted.name:
        return None
    binding: dict[str, str] = {}
    for term, value in zip(added.terms, wanted.terms, strict=True):
        if value.startswith("?"):
            continue
        if not _bind(binding, term, value):
            return None
    return binding


def _atoms(formula: Formula) -> Iterator[Predicate]:
    """Yield the predicates that must hold for a formula to hold."""
    return (part for part in conjuncts(formula) if isinstance(part, Predicate))


def _conditions(action: PddlAction, edge: _Edge) -> Iterator[Formula]:
    """Yield the conditions of the start or end of an action. The start only has its own: others may help it to end."""
    for condition in action.conditions:
        if edge == "end" or condition.when == "start":
            yield from conjuncts(condition.formula)
