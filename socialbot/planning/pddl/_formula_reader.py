"""Readers of formulas, numeric expressions, effects and actions of PDDL 2.1."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Literal, cast

from socialbot.planning.pddl._parser import Scope, SexpGroup, Sexpression, SexpWord, Vocabulary
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
    UniversalEffect,
)

COMPARATORS = frozenset({"<", "<=", "=", ">=", ">"})
ARITHMETIC = frozenset("+-*/")
CHANGES = frozenset({"assign", "increase", "decrease", "scale-up", "scale-down"})
PREFERENCES = frozenset({
    "preference", "always", "sometime", "within", "at-most-once", "sometime-after", "sometime-before",
    "always-within", "hold-during", "hold-after",
})  # fmt: skip
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII)


def is_number(item: Sexpression) -> bool:
    """Return whether an item is a number."""
    return isinstance(item, SexpWord) and _NUMBER.fullmatch(item.text) is not None


class FormulaReader:
    """Converts S-expressions to formulas and effects, and checks all names. Raises PlanningError with the line."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.names = vocabulary

    def formula(self, item: Sexpression, scope: Scope) -> Formula:
        """Read a formula; an empty group is true."""
        group = self.names.group(item, "a condition")
        if not group.items:
            return And()
        match group.head:
            case "and":
                return And(tuple(self.formula(part, scope) for part in group.rest))
            case "or":
                return Or(tuple(self.formula(part, scope) for part in group.rest))
            case "not":
                return Not(self.formula(self._only(group), scope))
            case "imply":
                left, right = self.pair(group)
                return Or((Not(self.formula(left, scope)), self.formula(right, scope)))
            case "forall" | "exists" as quantifier:
                listed, part = self.pair(group)
                variables = self.names.variables(self.names.group(listed, "variables").items)
                return Quantified(quantifier, variables, self.formula(part, scope.within(variables)))
            case head if head in COMPARATORS:
                return self._comparison(group, scope)
            case _:
                return self.predicate(group, scope)

    def predicate(self, item: Sexpression, scope: Scope) -> Predicate:
        """Read a declared predicate with matching terms."""
        group = self.names.group(item, "a predicate")
        word = self.names.word(group.items, 0, "the name of a predicate", group)
        signature = self.names.domain.predicates.get(word.text)
        if signature is None:
            if word.text in PREFERENCES:
                raise self.names.unsupported(f"preferences and constraints ({word.text})", word)
            raise self.names.unknown("predicate", word.text, self.names.domain.predicates, word)
        return Predicate(word.text, self.names.terms(signature, group, scope, "predicate"))

    def _comparison(self, group: SexpGroup, scope: Scope) -> Formula:
        left, right = self.pair(group)
        if group.head == "=" and self._is_term(left) and self._is_term(right):
            return Equality(self.names.term(left, scope), self.names.term(right, scope))
        return NumericComparison(
            cast("Comparator", group.head), self.expression(left, scope), self.expression(right, scope)
        )

    def _is_term(self, item: Sexpression) -> bool:
        return (
            isinstance(item, SexpWord)
            and item.text != "?duration"
            and not is_number(item)
            and (item.text in self.names.objects or item.text not in self.names.domain.functions)
        )

    def expression(self, item: Sexpression, scope: Scope) -> Expression:
        """Read a numeric expression."""
        if isinstance(item, SexpWord):
            return self._number(item, scope)
        word = self.names.word(item.items, 0, "a number or function", item)
        if word.text in ARITHMETIC:
            parts = tuple(self.expression(part, scope) for part in item.rest)
            if len(parts) < 2 and not (word.text == "-" and parts):
                raise self.names.error(f"{word} takes two numbers: {item}", item)
            if word.text in "-/" and len(parts) > 2:
                raise self.names.error(f"{word} takes two numbers, not {len(parts)}: {item}", item)
            return Arithmetic(word.text, parts)  # pyright: ignore[reportArgumentType]
        return self.fluent(item, scope)

    def _number(self, word: SexpWord, scope: Scope) -> Expression:
        if is_number(word):
            value = float(word.text)
            if not math.isfinite(value):
                raise self.names.error(f"{word} is too large a number", word)
            return Number(value)
        if word.text == "?duration":
            if not scope.duration:
                raise self.names.error("?duration has no meaning here", word, "use it in effects of durative actions")
            return Duration()
        if word.text == "#t":
            raise self.names.unsupported("continuous effects (#t)", word)
        return self.fluent(SexpGroup((word,), word.line), scope)

    def fluent(self, item: Sexpression, scope: Scope) -> Fluent:
        """Read a declared function with matching terms; without parameters its name is enough."""
        group = SexpGroup((item,), item.line) if isinstance(item, SexpWord) else item
        word = self.names.word(group.items, 0, "the name of a function", group)
        signature = self.names.domain.functions.get(word.text)
        if signature is None:
            raise self.names.unknown("function", word.text, self.names.domain.functions, word)
        return Fluent(word.text, self.names.terms(signature, group, scope, "function"))

    def effects(self, item: Sexpression, scope: Scope) -> tuple[Effect, ...]:
        """Read effects as a flat sequence."""
        group = self.names.group(item, "an effect")
        if not group.items:
            return ()
        match group.head:
            case "and":
                return tuple(effect for part in group.rest for effect in self.effects(part, scope))
            case "not":
                return (Delete(self._changed(self._only(group), scope)),)
            case "forall":
                listed, part = self.pair(group)
                variables = self.names.variables(self.names.group(listed, "variables").items)
                return (UniversalEffect(variables, self.effects(part, scope.within(variables))),)
            case "when":
                condition, part = self.pair(group)
                return (ConditionalEffect(self.formula(condition, scope), self.effects(part, scope)),)
            case head if head in CHANGES:
                fluent, amount = self.pair(group)
                changed = self.fluent(fluent, scope)
                return (NumericEffect(head, changed, self.expression(amount, scope)),)  # pyright: ignore[reportArgumentType]
            case _:
                return (Add(self._changed(group, scope)),)

    def _changed(self, item: Sexpression, scope: Scope) -> Predicate:
        predicate = self.predicate(item, scope)
        if predicate.name in self.names.domain.derived:
            raise self.names.error(f"{predicate.name} is derived: no action can change it", item)
        return predicate

    def pair(self, group: SexpGroup) -> tuple[Sexpression, Sexpression]:
        """Return the two parts after the head."""
        if len(group.rest) != 2:
            raise self.names.error(f"{group.head} takes two parts, not {len(group.rest)}: {group}", group)
        return group.rest[0], group.rest[1]

    def _only(self, group: SexpGroup) -> Sexpression:
        if len(group.rest) != 1:
            raise self.names.error(f"{group.head} takes one part, not {len(group.rest)}: {group}", group)
        return group.rest[0]


INSTANTANEOUS = (":parameters", ":precondition", ":effect")
DURATIVE = (":parameters", ":duration", ":condition", ":effect")


class ActionReader:
    """Converts S-expressions to actions. Raises PlanningError with the line."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.names = vocabulary
        self.formulas = FormulaReader(vocabulary)

    def instantaneous(self, group: SexpGroup) -> PddlAction:
        """Read an ``:action``."""
        action, scope, fields = self._head(group, INSTANTANEOUS)
        condition, effect = fields.get(":precondition"), fields.get(":effect")
        return replace(
            action,
            conditions=_timed("start", self.formulas.formula(condition, scope)) if condition else (),
            effects=tuple(TimedEffect("start", one) for one in self.formulas.effects(effect, scope)) if effect else (),
        )

    def durative(self, group: SexpGroup) -> PddlAction:
        """Read a ``:durative-action``."""
        action, scope, fields = self._head(group, DURATIVE)
        if ":duration" not in fields:
            raise self.names.error(f"the action {action.name} has no :duration", group, "add :duration (= ?duration 5)")
        condition, effect = fields.get(":condition"), fields.get(":effect")
        return replace(
            action,
            duration=self._bounds(fields[":duration"], scope),
            conditions=self._conditions(condition, scope) if condition else (),
            effects=self._effects(effect, Scope(scope.variables, duration=True)) if effect else (),
        )

    def _head(self, group: SexpGroup, keys: tuple[str, ...]) -> tuple[PddlAction, Scope, dict[str, Sexpression]]:
        """Return the action without its body, the scope of its parameters, and the item after each key."""
        word = self.names.word(group.items, 1, "the name of the action", group)
        name = self.names.new_name(word, "an action")
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
                raise self.names.error(f"nothing stands after {item} in the action {name}", item)
            fields[item.text] = value
        listed = fields.get(":parameters")
        parameters = self.names.variables(self.names.group(listed, "parameters").items) if listed else ()
        return PddlAction(name, parameters, line=group.line), Scope().within(parameters), fields

    def _bounds(self, item: Sexpression, scope: Scope) -> DurationBounds:
        found = DurationBounds(None, None)
        for part in self._duration_parts(item):
            left, right = self.formulas.pair(part)
            if not isinstance(left, SexpWord) or left.text != "?duration" or part.head not in ("=", "<=", ">="):
                raise self.names.error(
                    f"no bound of a duration: {part}", part, "write (= ?duration 5), with =, <= or >="
                )
            bound = self.formulas.expression(right, scope)
            for side, comparators in (("least", ("=", ">=")), ("most", ("=", "<="))):
                if part.head not in comparators:
                    continue
                if getattr(found, side) is not None:
                    raise self.names.error(f"the duration is bounded twice: {part}", part)
                found = replace(found, **{side: bound})
        return found

    def _duration_parts(self, item: Sexpression) -> list[SexpGroup]:
        group = self.names.group(item, "a bound of the duration")
        if not group.items:
            return []
        if group.head == "and":
            return [bound for part in group.rest for bound in self._duration_parts(part)]
        if group.head == "at":
            time, part = self._time(group)
            if time == "end":
                raise self.names.unsupported("bounds of a duration that are taken at its end", group)
            return self._duration_parts(part)
        return [group]

    def _time(self, group: SexpGroup) -> tuple[TimeSpecifier, Sexpression]:
        words = tuple(item.text if isinstance(item, SexpWord) else "" for item in group.items[:2])
        times: dict[tuple[str, ...], TimeSpecifier] = {
            ("at", "start"): "start",
            ("over", "all"): "over all",
            ("at", "end"): "end",
        }
        time = times.get(words)
        if time is None or len(group.items) != 3:
            raise self.names.error(
                f"expected when: {group}", group, "write (at start ...), (over all ...) or (at end ...) with one part"
            )
        return time, group.items[2]

    def _conditions(self, item: Sexpression, scope: Scope) -> tuple[TimedCondition, ...]:
        group = self.names.group(item, "a condition")
        if not group.items:
            return ()
        if group.head == "and":
            return tuple(condition for part in group.rest for condition in self._conditions(part, scope))
        if group.head == "forall":
            listed, part = self.formulas.pair(group)
            variables = self.names.variables(self.names.group(listed, "variables").items)
            return tuple(
                TimedCondition(condition.when, Quantified("forall", variables, condition.formula))
                for condition in self._conditions(part, scope.within(variables))
            )
        if group.head in PREFERENCES:
            raise self.names.unsupported(f"preferences and constraints ({group.head})", group)
        time, part = self._time(group)
        return _timed(time, self.formulas.formula(part, scope))

    def _effects(self, item: Sexpression, scope: Scope) -> tuple[TimedEffect, ...]:
        group = self.names.group(item, "an effect")
        if not group.items:
            return ()
        match group.head:
            case "and":
                return tuple(effect for part in group.rest for effect in self._effects(part, scope))
            case "forall":
                listed, part = self.formulas.pair(group)
                variables = self.names.variables(self.names.group(listed, "variables").items)
                inside = self._effects(part, scope.within(variables))
                return tuple(
                    TimedEffect(time, UniversalEffect(variables, effects)) for time, effects in _by_time(inside)
                )
            case "when":
                condition, part = self.formulas.pair(group)
                return self._conditional(group, condition, self._effects(part, scope), scope)
            case head if head in CHANGES:
                raise self.names.unsupported(f"continuous effects, or an effect without a time: {group}", group)
            case _:
                time, part = self._time(group)
                if time == "over all":
                    raise self.names.unsupported("effects over all the duration of an action", group)
                return tuple(TimedEffect(time, effect) for effect in self.formulas.effects(part, scope))

    def _conditional(
        self, group: SexpGroup, condition: Sexpression, effects: tuple[TimedEffect, ...], scope: Scope
    ) -> tuple[TimedEffect, ...]:
        conditions = self._conditions(condition, scope)
        formula = And(tuple(one.formula for one in conditions))
        by_time = _by_time(effects)
        if any(one.when != time for one in conditions for time, _ in by_time):
            raise self.names.unsupported(f"an effect at another time than its condition: {group}", group)
        return tuple(TimedEffect(time, ConditionalEffect(formula, inside)) for time, inside in by_time)


def _timed(time: TimeSpecifier, formula: Formula) -> tuple[TimedCondition, ...]:
    """Split a conjunction, so that errors name the violated part."""
    if isinstance(formula, And):
        return tuple(condition for part in formula.parts for condition in _timed(time, part))
    return (TimedCondition(time, formula),)


def _by_time(effects: tuple[TimedEffect, ...]) -> list[tuple[Literal["start", "end"], tuple[Effect, ...]]]:
    parted: list[tuple[Literal["start", "end"], tuple[Effect, ...]]] = [
        ("start", tuple(one.effect for one in effects if one.when == "start")),
        ("end", tuple(one.effect for one in effects if one.when == "end")),
    ]
    return [(time, inside) for time, inside in parted if inside]
