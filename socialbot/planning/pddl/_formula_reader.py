"""Readers of formulas, numeric expressions, effects and actions of PDDL 2.1."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal, cast

from socialbot.planning.pddl._parser import Scope, SexpGroup, Sexpression, SexpWord, Vocabulary, is_number
from socialbot.planning.pddl.domain import DurationBounds, PddlAction, TimedCondition, TimedEffect, TimeSpecifier
from socialbot.planning.pddl.formulas import (
    Add,
    And,
    Arithmetic,
    Comparator,
    ConditionalEffect,
    Delete,
    Duration,
    Effect,
    Equality,
    Expression,
    Fluent,
    Formula,
    Not,
    Number,
    NumericComparison,
    NumericEffect,
    Or,
    Predicate,
    Quantified,
    TypedName,
    UniversalEffect,
)

COMPARATORS = frozenset({"<", "<=", "=", ">=", ">"})
CHANGES = frozenset({"assign", "increase", "decrease", "scale-up", "scale-down"})
PREFERENCES = frozenset({
    "preference", "always", "sometime", "within", "at-most-once", "sometime-after", "sometime-before",
    "always-within", "hold-during", "hold-after",
})  # fmt: skip
_AT_ONCE = "write (at start ...) or (at end ...) with the whole change"
NO_PREFERENCES = "state it as a condition or a goal, or leave it out; wishes are desires with priorities"
_INSTANTANEOUS = (":parameters", ":vars", ":precondition", ":effect")
_DURATIVE = (":parameters", ":vars", ":duration", ":condition", ":effect")
_TIMES: dict[str, TimeSpecifier] = {"at start": "start", "over all": "over all", "at end": "end"}


class FormulaReader:
    """Converts S-expressions to formulas, effects and actions, and checks all names. Raises PlanningError."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.names = vocabulary

    def formula(self, item: Sexpression, scope: Scope) -> Formula:
        """Read a formula; an empty group is true."""
        group = self.names.group(item, "a condition")
        if not group.items:
            return And()
        match group.head:
            case "and" | "or" as word:
                return (And if word == "and" else Or)(tuple(self.formula(part, scope) for part in group.rest))
            case "not":
                (part,) = self.names.parts(group, 1)
                return Not(self.formula(part, scope))
            case "imply":
                left, right = self.names.parts(group, 2)
                return Or((Not(self.formula(left, scope)), self.formula(right, scope)))
            case "forall" | "exists" as quantifier:
                variables, part, inner = self._quantified(group, scope)
                return Quantified(quantifier, variables, self.formula(part, inner))
            case head if head in COMPARATORS:
                left, right = self.names.parts(group, 2)
                if head == "=" and self._is_term(left) and self._is_term(right):
                    return Equality(self.names.term(left, scope), self.names.term(right, scope))
                sides = self.expression(left, scope), self.expression(right, scope)
                return NumericComparison(cast("Comparator", head), *sides)
            case _:
                return self.predicate(group, scope)

    def predicate(self, item: Sexpression, scope: Scope) -> Predicate:
        group = self.names.group(item, "a predicate")
        word = self.names.word(group.items, 0, "the name of a predicate", group)
        if word.text in PREFERENCES and word.text not in self.names.domain.predicates:
            raise self.names.unsupported(f"preferences and constraints ({word})", word, NO_PREFERENCES)
        return Predicate(word.text, self.names.terms(word, group, scope, "predicate"))

    def _quantified(self, group: SexpGroup, scope: Scope) -> tuple[tuple[TypedName, ...], Sexpression, Scope]:
        listed, part = self.names.parts(group, 2)
        variables = self.names.variables(self.names.group(listed, "variables").items)
        return variables, part, scope.within(variables, quantified=True)

    def _is_term(self, item: Sexpression) -> bool:
        return (
            isinstance(item, SexpWord)
            and item.text != "?duration"
            and not is_number(item)
            and (item.text in self.names.objects or item.text not in self.names.domain.functions)
        )

    def expression(self, item: Sexpression, scope: Scope) -> Expression:
        """Read a numeric expression."""
        if is_number(item):
            return Number(self.number(item))
        if isinstance(item, SexpGroup):
            word = self.names.word(item.items, 0, "a number or function", item)
            if word.text not in ("+", "-", "*", "/"):
                return self.fluent(item, scope)
            parts = tuple(self.expression(part, scope) for part in item.rest)
            if len(parts) < 2 and not (word.text == "-" and parts):
                raise self.names.error(f"{word} takes two numbers: {item}", item)
            if word.text in "-/" and len(parts) > 2:
                raise self.names.error(f"{word} takes two numbers, not {len(parts)}: {item}", item)
            return Arithmetic(word.text, parts)
        if item.text == "#t":
            raise self.names.unsupported("continuous effects (#t)", item, _AT_ONCE)
        if item.text != "?duration":
            return self.fluent(item, scope)
        if not scope.duration:
            raise self.names.error("?duration has no meaning here", item, "use it in effects of durative actions")
        return Duration()

    def number(self, item: Sexpression) -> float:
        if not is_number(item):
            raise self.names.error(f"expected a number, found {item}", item)
        value = float(str(item))
        if not math.isfinite(value):
            raise self.names.error(f"{item} is too large a number", item)
        return value

    def fluent(self, item: Sexpression, scope: Scope) -> Fluent:
        """Read a declared function with matching terms; without parameters its name is enough."""
        group = SexpGroup((item,), item.line) if isinstance(item, SexpWord) else item
        word = self.names.word(group.items, 0, "the name of a function", group)
        return Fluent(word.text, self.names.terms(word, group, scope, "function"))

    def conditions(self, item: Sexpression, scope: Scope, time: TimeSpecifier | None) -> tuple[TimedCondition, ...]:
        """Read conditions at a time, or each with its own; conjunctions are split, so that errors name a part."""
        if time is not None:
            return _split(time, self.formula(item, scope))
        group = self.names.group(item, "a condition")
        if not group.items:
            return ()
        if group.head == "and":
            return tuple(condition for part in group.rest for condition in self.conditions(part, scope, None))
        if group.head == "forall":
            variables, part, inner = self._quantified(group, scope)
            return tuple(
                TimedCondition(condition.when, Quantified("forall", variables, condition.formula))
                for condition in self.conditions(part, inner, None)
            )
        if group.head in PREFERENCES:
            raise self.names.unsupported(f"preferences and constraints ({group.head})", group, NO_PREFERENCES)
        when, part = self._time(group)
        return self.conditions(part, scope, when)

    def effects(self, item: Sexpression, scope: Scope, time: Literal["start", "end"] | None) -> tuple[TimedEffect, ...]:
        """Read effects at a time, or each with its own, as a flat sequence."""
        group = self.names.group(item, "an effect")
        if not group.items:
            return ()
        match group.head:
            case "and":
                return tuple(effect for part in group.rest for effect in self.effects(part, scope, time))
            case "forall":
                variables, part, inner = self._quantified(group, scope)
                by_time = _by_time(self.effects(part, inner, time))
                return tuple(TimedEffect(when, UniversalEffect(variables, effects)) for when, effects in by_time)
            case "when":
                condition, part = self.names.parts(group, 2)
                conditions = self.conditions(condition, scope, time)
                by_time = _by_time(self.effects(part, scope, time))
                if any(one.when != when for one in conditions for when, _ in by_time):
                    what = f"an effect at another time than its condition: {group}"
                    raise self.names.unsupported(what, group, "give both the same time, at start or at end")
                formulas = tuple(one.formula for one in conditions)
                formula = formulas[0] if len(formulas) == 1 else And(formulas)
                return tuple(TimedEffect(when, ConditionalEffect(formula, inside)) for when, inside in by_time)
        if time is not None:
            return (TimedEffect(time, self._effect(group, scope)),)
        if group.head in CHANGES:
            what = f"continuous effects, or an effect without a time: {group}"
            raise self.names.unsupported(what, group, _AT_ONCE)
        when, part = self._time(group)
        if when == "over all":
            raise self.names.unsupported("effects over all the duration of an action", group, _AT_ONCE)
        return self.effects(part, scope, when)

    def _effect(self, group: SexpGroup, scope: Scope) -> Effect:
        if group.head in CHANGES:
            left, right = self.names.parts(group, 2)
            changed, amount = self.fluent(left, scope), self.expression(right, scope)
            return NumericEffect(group.head, changed, amount)  # pyright: ignore[reportArgumentType]
        deletes = group.head == "not"
        (item,) = self.names.parts(group, 1) if deletes else (group,)
        predicate = self.predicate(item, scope)
        if predicate.name in self.names.domain.derived:
            raise self.names.error(f"{predicate.name} is derived: no action can change it", item)
        return (Delete if deletes else Add)(predicate)

    def _time(self, group: SexpGroup) -> tuple[TimeSpecifier, Sexpression]:
        time = _TIMES.get(" ".join(map(str, group.items[:2])))
        if time is None or len(group.items) != 3:
            raise self.names.error(
                f"expected when: {group}", group, "write (at start ...), (over all ...) or (at end ...) with one part"
            )
        return time, group.items[2]

    def action(self, group: SexpGroup) -> PddlAction:
        durative = group.head == ":durative-action"
        keys = _DURATIVE if durative else _INSTANTANEOUS
        name = self.names.new_name(self.names.word(group.items, 1, "the name of the action", group), "an action")
        fields: dict[str, Sexpression] = {}
        items = iter(group.items[2:])
        for item in items:
            if isinstance(item, SexpGroup) or not item.text.startswith(":"):
                raise self.names.error(f"expected one of {', '.join(keys)} in the action {name}, found {item}", item)
            if item.text not in keys:
                raise self.names.unknown(f"part of {group.head}", item.text, keys, item)
            if item.text in fields:
                raise self.names.error(f"{item} is there twice in the action {name}", item)
            value = next(items, None)
            if value is None:
                raise self.names.error(f"no value after {item} in the action {name}", item)
            fields[item.text] = value
        if durative and ":duration" not in fields:
            raise self.names.error(f"the action {name} has no :duration", group, "add :duration (= ?duration 5)")
        empty = SexpGroup((), group.line)
        # Planners treat the :vars of early PDDL as further parameters.
        parameters, more = (
            self.names.variables(self.names.group(fields.get(key, empty), "parameters").items)
            for key in (":parameters", ":vars")
        )
        if again := {typed.name for typed in parameters} & {typed.name for typed in more}:
            raise self.names.error(f"the variable {min(again)} is declared twice", fields[":vars"])
        parameters += more
        scope, time = Scope().within(parameters), None if durative else "start"
        return PddlAction(
            name,
            parameters,
            self._bounds(fields[":duration"], scope) if durative else None,
            self.conditions(fields[keys[-2]], scope, time) if keys[-2] in fields else (),
            self.effects(fields.get(":effect", empty), replace(scope, duration=durative), time),
            group.line,
        )

    def _bounds(self, item: Sexpression, scope: Scope) -> DurationBounds:
        found = DurationBounds(None, None)
        for part in self._duration_parts(item):
            left, right = self.names.parts(part, 2)
            if str(left) != "?duration" or part.head not in ("=", "<=", ">="):
                raise self.names.error(
                    f"no bound of a duration: {part}", part, "write (= ?duration 5), with =, <= or >="
                )
            bound = self.expression(right, scope)
            for side, comparator in (("least", ">="), ("most", "<=")):
                if part.head in ("=", comparator):
                    if getattr(found, side) is not None:
                        raise self.names.error(f"the duration is bounded twice: {part}", part)
                    found = replace(found, **{side: bound})
        return found

    def _duration_parts(self, item: Sexpression) -> list[SexpGroup]:
        group = self.names.group(item, "a bound of the duration")
        if group.head == "and":
            return [bound for part in group.rest for bound in self._duration_parts(part)]
        if group.head == "at":
            time, part = self._time(group)
            if time == "end":
                what = "bounds of a duration that are taken at its end"
                raise self.names.unsupported(what, group, "write (at start ...), or the bound alone")
            return self._duration_parts(part)
        return [group] if group.items else []


def _split(time: TimeSpecifier, formula: Formula) -> tuple[TimedCondition, ...]:
    if isinstance(formula, And):
        return tuple(condition for part in formula.parts for condition in _split(time, part))
    return (TimedCondition(time, formula),)


def _by_time(effects: tuple[TimedEffect, ...]) -> list[tuple[Literal["start", "end"], tuple[Effect, ...]]]:
    parted: dict[Literal["start", "end"], tuple[Effect, ...]] = {}
    for effect in sorted(effects, key=lambda one: one.when == "end"):
        parted[effect.when] = (*parted.get(effect.when, ()), effect.effect)
    return list(parted.items())
