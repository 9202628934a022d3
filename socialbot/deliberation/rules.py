"""Reactive rules, which derive beliefs and desires from facts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import msgspec

from socialbot.core.errors import PlanningError
from socialbot.deliberation._fact_index import FactIndex, filled, has_wildcards, signature_of, variable_of, variables_in
from socialbot.deliberation._matching import (
    CompiledClause,
    CompiledCondition,
    FactMatch,
    clauses_of,
    each_of,
    mismatch,
    unfit_condition,
)
from socialbot.deliberation.facts import FactBase, out_of_range
from socialbot.deliberation.messages import INSTANCE, Desire, Dnf, Fact, FactCondition
from socialbot.planning.pddl.domain import PddlDomain

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class RuleEffect:
    """Belief or desire to add or delete, with variables of the rule.

    A belief to delete, and the name of a desire to delete, may have wildcards.
    """

    operation: Literal["ADD", "DEL"]
    fact: Fact | None = None
    desire: Desire | None = None

    def __post_init__(self) -> None:
        if (self.fact is None) == (self.desire is None):
            raise PlanningError("an effect is a belief or a desire", remedy="give fact= or desire=, and not both")

    @property
    def set(self) -> Literal["belief", "desire"]:
        return "belief" if self.desire is None else "desire"

    def __str__(self) -> str:
        return f"{self.operation} {self.set} {self.fact if self.desire is None else self.desire.name}"


@dataclass(frozen=True)
class ReactiveRule:
    """Rule that applies its effects for each new match of its condition."""

    name: str
    condition: Dnf
    effects: tuple[RuleEffect, ...]


@dataclass(frozen=True)
class Reaction:
    """Effect for one match of a rule; ``cause`` is the trace record of the last change that it needed."""

    rule: str
    effect: RuleEffect
    match: FactMatch
    cause: str = ""

    def __str__(self) -> str:
        return str(self.effect)


class RuleBook:
    """Rules of an agent with incremental matching.

    A rule fires once for each new match: other objects for its variables, or another value of a compared fluent. A
    match that has stopped holding in a call of `react` is new if it holds again.
    """

    def __init__(self, facts: FactBase) -> None:
        self._facts = facts
        self._states: dict[str, _RuleState] = {}
        self._touched: dict[_RuleState, None] = {}
        self._count = 0
        self._indexes: dict[tuple[int, str], list[_LiteralIndex]] = {}
        self._wild: list[_LiteralIndex] = []
        self._changed: dict[tuple[int, str, tuple[str, ...]], str] = {}
        facts.watch(self._on_fact)

    def __iter__(self) -> Iterator[ReactiveRule]:
        return iter([state.rule for state in self._states.values()])

    def __len__(self) -> int:
        return len(self._states)

    def __contains__(self, name: object) -> bool:
        return name in self._states

    def add(self, rule: ReactiveRule) -> None:
        """Add a rule, which also fires for current facts. Raises PlanningError for a used name or a misfit."""
        if rule.name in self._states:
            raise PlanningError("there is a rule of this name", where=f"rule {rule.name}", remedy="remove that first")
        reason = misfit(rule, self._facts)
        if reason is not None:
            raise PlanningError(reason, where=f"rule {rule.name}")
        self._count += 1
        state = self._states[rule.name] = _RuleState(rule, self._count, self._facts)
        self._touched[state] = None
        for index in state.indexes:
            self._list_of(index).append(index)

    def remove(self, name: str) -> bool:
        """Remove a rule but keep its effects; return False if there is none of that name."""
        state = self._states.pop(name, None)
        if state is None:
            return False
        self._touched.pop(state, None)
        for index in state.indexes:
            self._list_of(index).remove(index)
        return True

    def react(self) -> list[Reaction]:
        """Return the effects of all changes since the last call in a fixed order; invalid beliefs are recorded."""
        changed, self._changed = self._changed, {}
        touched, self._touched = self._touched, {}
        for identity, cause in reversed(changed.items()):  # The last change that a match needed is its cause.
            pddl_type, name, params = identity
            known = self._indexes.get((pddl_type, "" if pddl_type == INSTANCE else name), ())
            for index in (*known, *self._wild):
                if index.part.reads(pddl_type, name):
                    seed = index.part.bind((name,) if pddl_type == INSTANCE else params, {})
                    if seed is not None:
                        index.update(seed, self._facts, cause)
                        touched[index.state] = None
        reactions: list[Reaction] = []
        for state in sorted(touched, key=lambda state: state.number):
            for match, cause in state.fired():
                effects = (_filled(effect, match.binding) for effect in state.rule.effects)
                reactions += (Reaction(state.rule.name, effect, match, cause) for effect in effects)
        return [reaction for reaction in reactions if self._fits(reaction)]

    def _on_fact(self, fact: Fact, held: bool, cause: str) -> None:
        self._changed.pop(fact.identity, None)
        self._changed[fact.identity] = cause

    def _list_of(self, index: _LiteralIndex) -> list[_LiteralIndex]:
        part = index.part
        return self._wild if has_wildcards(part.name) else self._indexes.setdefault((part.pddl_type, part.name), [])

    def _fits(self, reaction: Reaction) -> bool:
        fact, facts = reaction.effect.fact, self._facts
        if fact is None:
            return True
        reason = facts.unfit(fact) if reaction.effect.operation == "ADD" else facts.unfit_pattern(fact)
        if reason is not None:
            message = f"{reaction}: {reason}"
            rule = f"rule {reaction.rule}"
            facts.engine.trace.record("failure", rule, reaction.cause, reason="no_fact", message=message)
        return reason is None


@dataclass(eq=False, slots=True)
class _LiteralIndex:
    """Literal of a rule, with the matches of its conjunction by the variables of the literal (``group``)."""

    state: _RuleState
    clause: CompiledClause
    part: CompiledCondition
    group: _MatchIndex
    groups: tuple[_MatchIndex, ...]

    def update(self, seed: dict[str, str], facts: FactIndex, cause: str) -> None:
        """Update the matches that agree with ``seed``, a binding of all variables of the literal."""
        found = dict.fromkeys(self.clause.solve(facts, seed))
        before = self.group.of(seed)
        for match in [match for match in before if match not in found]:
            for group in self.groups:
                group.leave(match)
            self.state.count(match, -1, cause)
        for match in [match for match in found if match not in before]:
            for group in self.groups:
                group.enter(match)
            self.state.count(match, +1, cause)


class _MatchIndex:
    """Matches by the binding of some variables."""

    __slots__ = ("_matches", "_names")

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._matches: dict[tuple[str, ...], dict[FactMatch, None]] = {}

    def of(self, binding: dict[str, str]) -> dict[FactMatch, None]:
        return self._matches.get(self._key(binding), {})

    def enter(self, match: FactMatch) -> None:
        self._matches.setdefault(self._key(match.binding), {})[match] = None

    def leave(self, match: FactMatch) -> None:
        key = self._key(match.binding)
        del self._matches[key][match]
        if not self._matches[key]:
            del self._matches[key]

    def _key(self, binding: dict[str, str]) -> tuple[str, ...]:
        return tuple(binding[name] for name in self._names)


class _RuleState:
    """Rule with its current matches."""

    def __init__(self, rule: ReactiveRule, number: int, facts: FactIndex) -> None:
        self.rule = rule
        self.number = number
        self.indexes: list[_LiteralIndex] = []
        self._counts: dict[FactMatch, int] = {}
        self._before: dict[FactMatch, tuple[int, str]] = {}
        also = tuple(each_of(name, kinds) for name, kinds in _typed_in(rule, facts.domain))
        for clause in clauses_of(rule.condition, facts.domain, also):
            groups = tuple(_MatchIndex(tuple(sorted(part.names()))) for part in clause.literals)
            for part, group in zip(clause.literals, groups, strict=True):
                self.indexes.append(_LiteralIndex(self, clause, part, group, groups))
            for match in dict.fromkeys(clause.solve(facts)):
                for group in groups:
                    group.enter(match)
                self.count(match, +1, "")

    def count(self, match: FactMatch, change: int, cause: str) -> None:
        count = self._counts.pop(match, 0)
        self._before.setdefault(match, (count, cause))
        if count + change:
            self._counts[match] = count + change

    def fired(self) -> list[tuple[FactMatch, str]]:
        """Return the new matches since the last call in order, with their causes."""
        before, self._before = self._before, {}
        new = [(match, cause) for match, (count, cause) in before.items() if not count and match in self._counts]
        return sorted(new, key=lambda item: item[0].order)


def misfit(rule: ReactiveRule, facts: FactIndex) -> str | None:
    """Return why a rule is invalid; None if it is valid."""
    conditions = (unfit_condition(condition, facts) for condition in conditions_in(rule.condition))
    effects = (unfit_effect(effect, facts) for effect in rule.effects)
    return next(filter(None, (*conditions, *effects)), None) or unbound(rule, facts.domain)


def unfit_effect(effect: RuleEffect, facts: FactIndex) -> str | None:
    """Return why an effect is invalid; None if it is valid."""
    desire = effect.desire
    checks = () if desire is None else desire.wanted
    facts_of_effect = [check.condition_to_check for check in checks] if effect.fact is None else [effect.fact]
    if effect.operation == "ADD":
        if desire is not None and not checks:
            return f"the desire {desire.name} wants nothing; give it a value, or conditions"
        names = [name for fact in facts_of_effect for name in (fact.name, *fact.params)]
        wild = next(filter(has_wildcards, [*([] if desire is None else [desire.name]), *names]), None)
        if wild is not None:
            return f"an added fact or desire needs names, not {wild!r}; use a variable"
        if desire is not None and out_of_range(desire):
            return out_of_range(desire)
    return next(filter(None, (*map(mismatch, checks), *map(facts.unfit_pattern, facts_of_effect))), None)


def unfit_parts(
    desire: Desire, facts: FactIndex, objection: Callable[[Fact], str | None]
) -> Iterator[tuple[object, str | None]]:
    """Yield the parts of a desire, each with the reason why it is invalid, or None.

    Args:
        objection: Returns why a fact that the desire wants or adds is invalid.
    """
    yield desire, out_of_range(desire)
    yield from ((fact, objection(fact)) for fact in desire.value)
    for check in desire.conditions:
        yield check, mismatch(check) or objection(check.condition_to_check)
    for check in (*conditions_in(desire.precondition), *conditions_in(desire.context)):
        yield check, unfit_condition(check, facts)
    yield from ((fact, objection(fact)) for fact in desire.rollback_belief_add)
    yield from ((fact, facts.unfit_pattern(fact)) for fact in desire.rollback_belief_del)


def unbound(rule: ReactiveRule, domain: PddlDomain) -> str | None:
    """Return an error for an unbound variable; None if all are bound in each conjunction."""
    typed = {name for name, _ in _typed_in(rule, domain)}
    for number, clause in enumerate(rule.condition.clauses or (None,), 1):
        bound = {name for literal in (clause.literals if clause else ()) for name in _variables(literal)}
        for effect in rule.effects:
            for name in sorted(_variables(effect) - bound - typed):
                return f"the variable {{{name}}} is not bound in {effect} (conjunction {number} of the condition)"
    return None


def conditions_in(dnf: Dnf) -> Iterator[FactCondition]:
    """Return all conditions of a DNF."""
    return (literal for clause in dnf.clauses for literal in clause.literals)


def _typed_in(rule: ReactiveRule, domain: PddlDomain) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the variables in parameters of effects with the types of the signatures."""
    for effect in rule.effects:
        for fact in (effect.fact,) if effect.desire is None else effect.desire.value:
            signature = None if fact is None or fact.pddl_type == INSTANCE else signature_of(domain, fact)[0]
            if fact is not None and signature is not None:
                for term, parameter in zip(fact.params, signature.parameters, strict=True):
                    name = variable_of(term)
                    if name is not None:
                        yield name, parameter.types


def _variables(part: Any) -> set[str]:
    return set(variables_in(msgspec.json.encode(part).decode()))


def _filled(part: T, binding: dict[str, str]) -> T:
    """Replace the variables in an effect or a part of it."""
    if isinstance(part, str):
        return filled(part, binding) if "{" in part else part  # type: ignore[return-value]
    if isinstance(part, tuple):
        return tuple(_filled(item, binding) for item in part)  # type: ignore[return-value]
    if isinstance(part, RuleEffect):
        fact, desire = _filled(part.fact, binding), _filled(part.desire, binding)
        return RuleEffect(operation=part.operation, fact=fact, desire=desire)  # type: ignore[return-value]
    if isinstance(part, msgspec.Struct):
        return type(part)(**{name: _filled(getattr(part, name), binding) for name in part.__struct_fields__})
    return part
