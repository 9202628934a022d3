"""Semantics of formulas and effects of PDDL 2.1.

A comparison with an undefined function is neither true nor false (Kleene's logic), so its negation does not hold
either.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import overload

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.domain import DurationBounds, PddlAction, TimedCondition, TimedEffect, TimeSpecifier
from socialbot.planning.pddl.formulas import (
    Add,
    And,
    Arithmetic,
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
    PddlWorld,
    Predicate,
    Quantified,
    TypedName,
    UniversalEffect,
)

TOLERANCE = 1e-9
"""Relative tolerance of numeric comparisons."""

Binding = Mapping[str, str]
"""Objects by variables."""

_NONE: Binding = {}


@dataclass(frozen=True, slots=True)
class SetValue:
    """Assignment of a value to a ground function."""

    fluent: Fluent
    value: float

    def __str__(self) -> str:
        return f"{self.fluent} = {self.value:g}"


GroundChange = Add | Delete | SetValue


def holds(formula: Formula, world: PddlWorld, binding: Binding = _NONE) -> bool:
    """Return whether a formula is true in a world."""
    return truth(formula, world, binding) is True


def unmet(formulas: Iterable[Formula], world: PddlWorld, binding: Binding = _NONE) -> list[Formula]:
    """Return the formulas, or parts of conjunctions, that do not hold."""
    found: list[Formula] = []
    for formula in formulas:
        if isinstance(formula, And):
            found += unmet(formula.parts, world, binding)
        elif not holds(formula, world, binding):
            found.append(substitute(formula, binding) if binding else formula)
    return found


def truth(formula: Formula, world: PddlWorld, binding: Binding) -> bool | None:
    """Return the truth in Kleene's logic; None if undefined."""
    match formula:
        case Predicate():
            return world.holds(bound(formula, binding) if binding else formula)
        case And(parts):
            truths = (truth(part, world, binding) for part in parts)
            return _decided(truths, False)
        case Not(part):
            value = truth(part, world, binding)
            return None if value is None else not value
        case NumericComparison(comparator, left, right):
            one, other = evaluate(left, world, binding), evaluate(right, world, binding)
            return None if one is None or other is None else compare(comparator, one, other)
        case Equality(left, right):
            return binding.get(left, left) == binding.get(right, right)
        case Or(parts):
            truths = (truth(part, world, binding) for part in parts)
            return _decided(truths, True)
        case Quantified(quantifier, variables, part):
            truths = (truth(part, world, inner) for inner in bindings(variables, world, binding))
            return _decided(truths, quantifier == "exists")


def _decided(truths: Iterable[bool | None], decisive: bool) -> bool | None:
    """Return ``decisive`` if any of the truths is, else None if any is, else the opposite."""
    result: bool | None = not decisive
    for truth in truths:
        if truth is decisive:
            return decisive
        if truth is None:
            result = None
    return result


def bindings(variables: tuple[TypedName, ...], world: PddlWorld, binding: Binding = _NONE) -> Iterator[Binding]:
    """Yield a binding extended by each combination of objects for some variables."""
    names = [typed.name for typed in variables]
    for objects in itertools.product(*(tuple(world.objects(typed.types)) for typed in variables)):
        yield {**binding, **dict(zip(names, objects, strict=True))}


def compare(comparator: str, left: float, right: float) -> bool:
    """Compare two numbers within `TOLERANCE`."""
    close = abs(left - right) <= TOLERANCE * max(1.0, abs(left), abs(right))
    match comparator:
        case "<":
            return left < right and not close
        case "<=":
            return left < right or close
        case "=":
            return close
        case ">=":
            return left > right or close
        case _:
            return left > right and not close


def evaluate(
    expression: Expression, world: PddlWorld, binding: Binding = _NONE, duration: float | None = None
) -> float | None:
    """Return the value of an expression; None if undefined, infinite or a division by zero."""
    match expression:
        case Number(value):
            return value
        case Fluent():
            return world.value(bound(expression, binding) if binding else expression)
        case Duration():
            return duration
        case Arithmetic(operator, parts):
            values = [evaluate(part, world, binding, duration) for part in parts]
            known = [value for value in values if value is not None]
            return _calculated(operator, known) if len(known) == len(values) else None


def _calculated(operator: str, values: list[float]) -> float | None:
    first, *rest = values
    if operator == "-" and not rest:
        return -first
    for value in rest:
        match operator:
            case "+":
                first += value
            case "-":
                first -= value
            case "*":
                first *= value
            case _:
                if value == 0:
                    return None
                first /= value
    return first if math.isfinite(first) else None


def fluents(expression: Expression, binding: Binding = _NONE) -> Iterator[Fluent]:
    """Yield the ground functions in an expression."""
    match expression:
        case Fluent():
            yield bound(expression, binding)
        case Arithmetic(_, parts):
            for part in parts:
                yield from fluents(part, binding)
        case _:
            return


def atoms(formula: Formula, world: PddlWorld, binding: Binding = _NONE) -> Iterator[Predicate | Fluent]:
    """Yield the ground predicates and functions in a formula."""
    match formula:
        case Predicate():
            yield bound(formula, binding)
        case NumericComparison(_, left, right):
            yield from fluents(left, binding)
            yield from fluents(right, binding)
        case Not(part):
            yield from atoms(part, world, binding)
        case And(parts) | Or(parts):
            for part in parts:
                yield from atoms(part, world, binding)
        case Quantified(_, variables, part):
            for inner in bindings(variables, world, binding):
                yield from atoms(part, world, inner)
        case _:
            return


def changes(
    effects: Iterable[Effect], world: PddlWorld, binding: Binding = _NONE, duration: float | None = None
) -> list[GroundChange]:
    """Return the simultaneous changes by effects, deletions first; additions override deletions.

    Conditions and amounts are those of the world before. Several effects on one function accumulate. Raises
    PlanningError for an undefined amount or value.
    """
    deleted: dict[Predicate, Delete] = {}
    added: dict[Predicate, Add] = {}
    values: dict[Fluent, float] = {}
    for effect, inner in triggered(effects, world, binding):
        match effect:
            case Add(predicate):
                ground = bound(predicate, inner)
                added[ground] = Add(ground)
            case Delete(predicate):
                ground = bound(predicate, inner)
                deleted[ground] = Delete(ground)
            case NumericEffect(operator, fluent, amount):
                ground = bound(fluent, inner)
                before = values[ground] if ground in values else world.value(ground)
                values[ground] = _changed(operator, ground, before, evaluate(amount, world, inner, duration))
    kept = [delete for predicate, delete in deleted.items() if predicate not in added]
    return [*kept, *added.values(), *(SetValue(fluent, value) for fluent, value in values.items())]


def triggered(
    effects: Iterable[Effect], world: PddlWorld, binding: Binding = _NONE
) -> Iterator[tuple[Add | Delete | NumericEffect, Binding]]:
    """Yield the elementary effects whose conditions hold, with their bindings."""
    for effect in effects:
        match effect:
            case UniversalEffect(variables, inside):
                for inner in bindings(variables, world, binding):
                    yield from triggered(inside, world, inner)
            case ConditionalEffect(condition, inside):
                if holds(condition, world, binding):
                    yield from triggered(inside, world, binding)
            case _:
                yield effect, binding


def _changed(operator: str, fluent: Fluent, before: float | None, amount: float | None) -> float:
    if amount is None:
        raise PlanningError(f"{operator} {fluent}: the amount has no value")
    if operator == "assign":
        return amount
    if before is None:
        raise PlanningError(f"{operator} {fluent}: it has no value yet")
    match operator:
        case "increase":
            after = before + amount
        case "decrease":
            after = before - amount
        case "scale-up":
            after = before * amount
        case _:
            after = before / amount if amount else math.inf
    if not math.isfinite(after):
        raise PlanningError(f"{operator} {fluent}: {before:g} cannot be changed so by {amount:g}")
    return after


@dataclass(frozen=True, slots=True)
class GroundAction:
    """Action with objects in place of its parameters."""

    name: str
    args: tuple[str, ...]
    duration: DurationBounds | None
    conditions: tuple[TimedCondition, ...]
    effects: tuple[TimedEffect, ...]

    def conditions_at(self, when: TimeSpecifier) -> tuple[Formula, ...]:
        """Return the conditions at a time."""
        return tuple(condition.formula for condition in self.conditions if condition.when == when)

    def effects_at(self, when: TimeSpecifier) -> tuple[Effect, ...]:
        """Return the effects at a time."""
        return tuple(effect.effect for effect in self.effects if effect.when == when)

    def __str__(self) -> str:
        return f"({' '.join((self.name, *self.args))})"


def ground(action: PddlAction, args: Iterable[str]) -> GroundAction:
    """Ground an action. Raises PlanningError for a wrong number of arguments."""
    objects = tuple(args)
    if len(objects) != len(action.parameters):
        raise PlanningError(
            f"{action.name} takes {len(action.parameters)} objects, not {len(objects)}: {' '.join(objects)}"
        )
    binding = {typed.name: name for typed, name in zip(action.parameters, objects, strict=True)}
    bounds = action.duration
    return GroundAction(
        action.name,
        objects,
        bounds and DurationBounds(_optional(bounds.least, binding), _optional(bounds.most, binding)),
        tuple(TimedCondition(one.when, substitute(one.formula, binding)) for one in action.conditions),
        tuple(TimedEffect(one.when, _substituted(one.effect, binding)) for one in action.effects),
    )


def substitute(formula: Formula, binding: Binding) -> Formula:
    """Replace the free variables of a formula."""
    match formula:
        case Predicate():
            return bound(formula, binding)
        case Equality(left, right):
            return Equality(binding.get(left, left), binding.get(right, right))
        case NumericComparison(comparator, left, right):
            return NumericComparison(comparator, substitute_number(left, binding), substitute_number(right, binding))
        case Not(part):
            return Not(substitute(part, binding))
        case And(parts):
            return And(tuple(substitute(part, binding) for part in parts))
        case Or(parts):
            return Or(tuple(substitute(part, binding) for part in parts))
        case Quantified(quantifier, variables, part):
            return Quantified(quantifier, variables, substitute(part, _without(binding, variables)))


def substitute_number(expression: Expression, binding: Binding) -> Expression:
    """Replace the variables of an expression."""
    match expression:
        case Fluent():
            return bound(expression, binding)
        case Arithmetic(operator, parts):
            return Arithmetic(operator, tuple(substitute_number(part, binding) for part in parts))
        case _:
            return expression


def _substituted(effect: Effect, binding: Binding) -> Effect:
    match effect:
        case Add(predicate):
            return Add(bound(predicate, binding))
        case Delete(predicate):
            return Delete(bound(predicate, binding))
        case NumericEffect(operator, fluent, amount):
            return NumericEffect(operator, bound(fluent, binding), substitute_number(amount, binding))
        case UniversalEffect(variables, inside):
            inner = _without(binding, variables)
            return UniversalEffect(variables, tuple(_substituted(one, inner) for one in inside))
        case ConditionalEffect(condition, inside):
            return ConditionalEffect(
                substitute(condition, binding), tuple(_substituted(one, binding) for one in inside)
            )


def _optional(expression: Expression | None, binding: Binding) -> Expression | None:
    return None if expression is None else substitute_number(expression, binding)


def _without(binding: Binding, variables: tuple[TypedName, ...]) -> Binding:
    hidden = {typed.name for typed in variables}
    return {name: value for name, value in binding.items() if name not in hidden}


@overload
def bound(named: Predicate, binding: Binding) -> Predicate: ...
@overload
def bound(named: Fluent, binding: Binding) -> Fluent: ...
def bound(named: Predicate | Fluent, binding: Binding) -> Predicate | Fluent:
    """Replace the variables of a predicate or function."""
    terms = tuple(binding.get(term, term) for term in named.terms)
    return Predicate(named.name, terms) if isinstance(named, Predicate) else Fluent(named.function, terms)
