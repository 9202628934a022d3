"""The reader of actions: instantaneous and durative ones."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from socialbot.planning.domain import Action, DurationBounds, TimedCondition, TimedEffect
from socialbot.planning.domain import When as Time
from socialbot.planning.formula_reader import CHANGES, PREFERENCES, FormulaReader
from socialbot.planning.formulas import And, Effect, ForEach, Formula, Quantified, When
from socialbot.planning.sexpressions import Group, Sexpression, Word
from socialbot.planning.vocabulary import Scope, Vocabulary

INSTANTANEOUS = (":parameters", ":precondition", ":effect")
DURATIVE = (":parameters", ":duration", ":condition", ":effect")


class ActionReader:
    """Makes actions of S-expressions. Raises PlanningError with the line."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.names = vocabulary
        self.formulas = FormulaReader(vocabulary)

    def instantaneous(self, group: Group) -> Action:
        """An ``:action``."""
        action, scope, fields = self._head(group, INSTANTANEOUS)
        condition, effect = fields.get(":precondition"), fields.get(":effect")
        return replace(
            action,
            conditions=_timed("start", self.formulas.formula(condition, scope)) if condition else (),
            effects=tuple(TimedEffect("start", one) for one in self.formulas.effects(effect, scope)) if effect else (),
        )

    def durative(self, group: Group) -> Action:
        """A ``:durative-action``."""
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

    def _head(self, group: Group, keys: tuple[str, ...]) -> tuple[Action, Scope, dict[str, Sexpression]]:
        """The action so far, the scope of its parameters, and what stands after each key."""
        word = self.names.word(group.items, 1, "the name of the action", group)
        name = self.names.new_name(word, "an action")
        fields: dict[str, Sexpression] = {}
        items = iter(group.items[2:])
        for item in items:
            if isinstance(item, Group) or not item.text.startswith(":"):
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
        return Action(name, parameters, line=group.line), Scope().within(parameters), fields

    # Durations

    def _bounds(self, item: Sexpression, scope: Scope) -> DurationBounds:
        found = DurationBounds(None, None)
        for part in self._duration_parts(item):
            left, right = self.formulas.pair(part)
            if not isinstance(left, Word) or left.text != "?duration" or part.head not in ("=", "<=", ">="):
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

    def _duration_parts(self, item: Sexpression) -> list[Group]:
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

    # Conditions and effects with their times

    def _time(self, group: Group) -> tuple[Time, Sexpression]:
        """The time that a condition or effect begins with, and the rest of it."""
        words = tuple(item.text if isinstance(item, Word) else "" for item in group.items[:2])
        times: dict[tuple[str, ...], Time] = {
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
                return tuple(TimedEffect(time, ForEach(variables, effects)) for time, effects in _by_time(inside))
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
        self, group: Group, condition: Sexpression, effects: tuple[TimedEffect, ...], scope: Scope
    ) -> tuple[TimedEffect, ...]:
        conditions = self._conditions(condition, scope)
        formula = And(tuple(one.formula for one in conditions))
        by_time = _by_time(effects)
        if any(one.when != time for one in conditions for time, _ in by_time):
            raise self.names.unsupported(f"an effect at another time than its condition: {group}", group)
        return tuple(TimedEffect(time, When(formula, inside)) for time, inside in by_time)


def _timed(time: Time, formula: Formula) -> tuple[TimedCondition, ...]:
    """The conjuncts of ``formula`` one by one, so that one that does not hold can be named."""
    if isinstance(formula, And):
        return tuple(condition for part in formula.parts for condition in _timed(time, part))
    return (TimedCondition(time, formula),)


def _by_time(effects: tuple[TimedEffect, ...]) -> list[tuple[Literal["start", "end"], tuple[Effect, ...]]]:
    """The effects at the start and those at the end, if there are any."""
    parted: list[tuple[Literal["start", "end"], tuple[Effect, ...]]] = [
        ("start", tuple(one.effect for one in effects if one.when == "start")),
        ("end", tuple(one.effect for one in effects if one.when == "end")),
    ]
    return [(time, inside) for time, inside in parted if inside]
