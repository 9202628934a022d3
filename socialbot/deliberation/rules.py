"""Rules that turn what is believed into other beliefs and into desires."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import msgspec

from socialbot.core.errors import PlanningError
from socialbot.deliberation._fact_index import FactIndex, filled, has_wildcards, signature_of, variable_of, variables_in
from socialbot.deliberation._matching import (
    CompiledClause,
    CompiledCondition,
    Match,
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
    """A belief or a desire to add or to delete; variables of the rule's condition may stand in its names.

    To be deleted, a belief may have wildcards, and so may the name of a desire, which is all that counts of it then.
    """

    operation: Literal["ADD", "DEL"]
    fact: Fact | None = None
    desire: Desire | None = None

    def __post_init__(self) -> None:
        if (self.fact is None) == (self.desire is None):
            raise PlanningError("an effect is a belief or a desire", remedy="give fact= or desire=, and not both")

    @property
    def set(self) -> Literal["belief", "desire"]:
        """What it changes."""
        return "belief" if self.desire is None else "desire"

    def __str__(self) -> str:
        return f"{self.operation} {self.set} {self.fact if self.desire is None else self.desire.name}"


@dataclass(frozen=True)
class ReactiveRule:
    """What follows, each time that its condition holds in a way in which it did not before."""

    name: str
    condition: Dnf
    effects: tuple[RuleEffect, ...]


@dataclass(frozen=True, kw_only=True)
class Reaction(RuleEffect):
    """An effect for one match of a rule's condition; ``cause`` is the trace record of the change that made it hold."""

    rule: str
    match: Match
    cause: str = ""

    __str__ = RuleEffect.__str__


class RuleBook:
    """The rules of an agent; they may come and go while it runs.

    A rule fires once for each new match: other objects for its variables, or another value of a fluent that it
    compares. A match that held no longer when `react` was called is new when it holds again.
    """

    def __init__(self, facts: FactBase) -> None:
        self._facts = facts
        self._watches: dict[str, _Watch] = {}
        self._touched: dict[_Watch, None] = {}
        self._count = 0
        self._readers: dict[tuple[int, str], list[_Reader]] = {}
        self._wild: list[_Reader] = []
        self._changed: dict[tuple[int, str, tuple[str, ...]], str] = {}
        facts.watch(self._note)

    def __iter__(self) -> Iterator[ReactiveRule]:
        return iter([watch.rule for watch in self._watches.values()])

    def __len__(self) -> int:
        return len(self._watches)

    def __contains__(self, name: object) -> bool:
        return name in self._watches

    def add(self, rule: ReactiveRule) -> None:
        """Adds a rule, which fires for what holds already, too, when `react` is called.

        Raises PlanningError when its name is taken, or it does not fit the domain.
        """
        if rule.name in self._watches:
            raise PlanningError("there is a rule of this name", where=f"rule {rule.name}", remedy="remove that first")
        reason = misfit(rule, self._facts)
        if reason is not None:
            raise PlanningError(reason, where=f"rule {rule.name}")
        self._count += 1
        watch = self._watches[rule.name] = _Watch(rule, self._count, self._facts)
        self._touched[watch] = None
        for reader in watch.readers:
            self._shelf(reader).append(reader)

    def remove(self, name: str) -> bool:
        """Removes a rule; what it has done stays done. False when there is none of that name."""
        watch = self._watches.pop(name, None)
        if watch is None:
            return False
        self._touched.pop(watch, None)
        for reader in watch.readers:
            self._shelf(reader).remove(reader)
        return True

    def react(self) -> list[Reaction]:
        """What follows from the changes since the last call: rule by rule, match by match, in a fixed order.

        A belief that does not fit the domain is left out; that goes on the trace.
        """
        changed, self._changed = self._changed, {}
        touched, self._touched = self._touched, {}
        for identity, cause in reversed(changed.items()):  # The last change that a match needed is its cause.
            pddl_type, name, params = identity
            known = self._readers.get((pddl_type, "" if pddl_type == INSTANCE else name), ())
            for reader in (*known, *self._wild):
                if reader.part.reads(pddl_type, name):
                    seed = reader.part.bind((name,) if pddl_type == INSTANCE else params, {})
                    if seed is not None:
                        reader.update(seed, self._facts, cause)
                        touched[reader.watch] = None
        reactions: list[Reaction] = []
        for watch in sorted(touched, key=lambda watch: watch.number):
            for match, cause in watch.fired():
                reactions += (self._reaction(watch.rule, effect, match, cause) for effect in watch.rule.effects)
        return [reaction for reaction in reactions if self._fits(reaction)]

    def _note(self, fact: Fact, held: bool, cause: str) -> None:
        self._changed.pop(fact.identity, None)
        self._changed[fact.identity] = cause

    def _shelf(self, reader: _Reader) -> list[_Reader]:
        part = reader.part
        return self._wild if has_wildcards(part.name) else self._readers.setdefault((part.pddl_type, part.name), [])

    def _reaction(self, rule: ReactiveRule, effect: RuleEffect, match: Match, cause: str) -> Reaction:
        filled = _filled(effect, match.binding)
        return Reaction(
            operation=effect.operation,
            fact=filled.fact,
            desire=filled.desire,
            rule=rule.name,
            match=match,
            cause=cause,
        )

    def _fits(self, reaction: Reaction) -> bool:
        fact = reaction.fact
        if fact is None:
            return True
        reason = self._facts.unfit(fact) if reaction.operation == "ADD" else self._facts.unfit_pattern(fact)
        if reason is None:
            return True
        self._facts.engine.record(
            "failure", f"rule {reaction.rule}", reaction.cause, reason="no_fact", message=f"{reaction}: {reason}"
        )
        return False


class _Reader:
    """A literal of a rule's condition, and the matches of its conjunction by what its variables stand for."""

    __slots__ = ("_group", "_groups", "clause", "part", "watch")

    def __init__(
        self, watch: _Watch, clause: CompiledClause, part: CompiledCondition, group: _Group, groups: tuple[_Group, ...]
    ) -> None:
        self.watch = watch
        self.clause = clause
        self.part = part
        self._group = group
        self._groups = groups

    def update(self, seed: dict[str, str], facts: FactIndex, cause: str) -> None:
        """Finds anew the matches that agree with ``seed``, which gives each variable of the literal an object."""
        found = dict.fromkeys(self.clause.solve(facts, seed))
        before = self._group.of(seed)
        for match in [match for match in before if match not in found]:
            for group in self._groups:
                group.leave(match)
            self.watch.count(match, -1, cause)
        for match in [match for match in found if match not in before]:
            for group in self._groups:
                group.enter(match)
            self.watch.count(match, +1, cause)


class _Group:
    """Matches by what some variables stand for."""

    __slots__ = ("_matches", "_names")

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._matches: dict[tuple[str, ...], dict[Match, None]] = {}

    def of(self, binding: dict[str, str]) -> dict[Match, None]:
        return self._matches.get(self._key(binding), {})

    def enter(self, match: Match) -> None:
        self._matches.setdefault(self._key(match.binding), {})[match] = None

    def leave(self, match: Match) -> None:
        key = self._key(match.binding)
        del self._matches[key][match]
        if not self._matches[key]:
            del self._matches[key]

    def _key(self, binding: dict[str, str]) -> tuple[str, ...]:
        return tuple(binding[name] for name in self._names)


class _Watch:
    """A rule, and the ways in which its condition holds."""

    def __init__(self, rule: ReactiveRule, number: int, facts: FactIndex) -> None:
        self.rule = rule
        self.number = number
        self.readers: list[_Reader] = []
        self._counts: dict[Match, int] = {}
        self._before: dict[Match, tuple[int, str]] = {}
        also = tuple(each_of(name, kinds) for name, kinds in _typed_in(rule, facts.domain))
        for clause in clauses_of(rule.condition, facts.domain, also):
            groups = tuple(_Group(tuple(sorted(part.names()))) for part in clause.literals)
            for part, group in zip(clause.literals, groups, strict=True):
                self.readers.append(_Reader(self, clause, part, group, groups))
            for match in dict.fromkeys(clause.solve(facts)):
                for group in groups:
                    group.enter(match)
                self.count(match, +1, "")

    def count(self, match: Match, change: int, cause: str) -> None:
        """Notes that one conjunction more, or less, holds in this way."""
        count = self._counts.pop(match, 0)
        self._before.setdefault(match, (count, cause))
        if count + change:
            self._counts[match] = count + change

    def fired(self) -> list[tuple[Match, str]]:
        """The matches that are new since the last call, in order, and what made them hold."""
        before, self._before = self._before, {}
        new = [(match, cause) for match, (count, cause) in before.items() if not count and match in self._counts]
        return sorted(new, key=lambda item: item[0].order)


def misfit(rule: ReactiveRule, facts: FactIndex) -> str | None:
    """Why a rule can never do what it says; None when it can."""
    for condition in conditions_in(rule.condition):
        reason = unfit_condition(condition, facts)
        if reason is not None:
            return reason
    for effect in rule.effects:
        reason = unfit_effect(effect, facts)
        if reason is not None:
            return reason
    return unbound(rule, facts.domain)


def unfit_effect(effect: RuleEffect, facts: FactIndex) -> str | None:
    """Why an effect can never be; None when it can."""
    desire, adds = effect.desire, effect.operation == "ADD"
    checks = () if desire is None else desire.wanted
    wanted = [check.condition_to_check for check in checks] if effect.fact is None else [effect.fact]
    if adds:
        if desire is not None and not checks:
            return f"the desire {desire.name} wants nothing; give it a value, or conditions"
        for name in (
            "" if desire is None else desire.name,
            *(term for fact in wanted for term in (fact.name, *fact.params)),
        ):
            if has_wildcards(name):
                return f"what is added needs names, not {name!r}; let a variable stand for it"
        if desire is not None and out_of_range(desire):
            return out_of_range(desire)
    return next(filter(None, (*map(mismatch, checks), *map(facts.unfit_pattern, wanted))), None)


def unbound(rule: ReactiveRule, domain: PddlDomain) -> str | None:
    """Which variable stands for nothing; None when each stands for something, whatever conjunction holds."""
    typed = {name for name, _ in _typed_in(rule, domain)}
    for number, clause in enumerate(rule.condition.clauses or (None,), 1):
        bound = {name for literal in (clause.literals if clause else ()) for name in _variables(literal)}
        for effect in rule.effects:
            for name in sorted(_variables(effect) - bound - typed):
                return f"nothing says what {{{name}}} stands for in {effect} (conjunction {number} of the condition)"
    return None


def conditions_in(dnf: Dnf) -> Iterator[FactCondition]:
    """All conditions of a DNF."""
    return (literal for clause in dnf.clauses for literal in clause.literals)


def _typed_in(rule: ReactiveRule, domain: PddlDomain) -> Iterator[tuple[str, tuple[str, ...]]]:
    """The variables among the parameters of the effects, with the types that the domain asks for there."""
    for effect in rule.effects:
        for fact in (effect.fact,) if effect.desire is None else effect.desire.value:
            signature = None if fact is None or fact.pddl_type == INSTANCE else signature_of(domain, fact)[0]
            if fact is not None and signature is not None:
                for term, parameter in zip(fact.params, signature.parameters, strict=True):
                    name = variable_of(term)
                    if name is not None:
                        yield name, parameter.types


def _variables(part: Any) -> set[str]:
    """The variables in the texts of an effect or condition."""
    return set(variables_in(msgspec.json.encode(part).decode()))


def _filled(part: T, binding: dict[str, str]) -> T:
    """An effect, or a part of it, with the objects in the place of the variables."""
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
