"""Semantics of formulas and effects of PDDL 2.1.

A comparison with an undefined function is neither true nor false (Kleene's logic), so its negation does not hold
either.
"""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass, replace
from typing import Any, TypeVar

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
    Key,
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

Changes = dict[Key, bool | float]
"""New truths of ground predicates and values of ground functions, in their order."""

T = TypeVar("T")
_NONE: Binding = {}


def change_text(key: Key, new: bool | float) -> str:
    """Return one of some `Changes` as text: ``(p a)``, ``(not (p a))`` or ``(f a) = 2``."""
    if isinstance(key, Fluent):
        return f"{key} = {new:g}"
    return str(key) if new else str(Delete(key))


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
            return world.holds(substitute(formula, binding) if binding else formula)
        case And(parts):
            return _decided((truth(part, world, binding) for part in parts), False)
        case Not(part):
            value = truth(part, world, binding)
            return None if value is None else not value
        case NumericComparison(comparator, left, right):
            one, other = evaluate(left, world, binding), evaluate(right, world, binding)
            return None if one is None or other is None else compare(comparator, one, other)
        case Equality(left, right):
            return binding.get(left, left) == binding.get(right, right)
        case Or(parts):
            return _decided((truth(part, world, binding) for part in parts), True)
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


def instance_count(part: object, world: PddlWorld) -> int:
    """Number of ground parts of a formula or effect, or of a tuple or dataclass of them: those that a look may take."""
    match part:
        case Quantified(_, variables, inside) | UniversalEffect(variables, inside):
            choices = (len(tuple(world.objects(typed.types))) for typed in variables)
            return math.prod(choices) * instance_count(inside, world)
        case tuple():
            return sum(instance_count(one, world) for one in part)
        case _ if is_dataclass(part):
            return max(1, sum(instance_count(getattr(part, name), world) for name in part.__dataclass_fields__))
    return 0


def compare(comparator: str, left: float, right: float) -> bool:
    """Compare two numbers within `TOLERANCE`."""
    if abs(left - right) <= TOLERANCE * max(1.0, abs(left), abs(right)):
        return "=" in comparator
    return left < right if "<" in comparator else left > right and ">" in comparator


def evaluate(
    expression: Expression, world: PddlWorld, binding: Binding = _NONE, duration: float | None = None
) -> float | None:
    """Return the value of an expression; None if undefined, infinite or a division by zero."""
    match expression:
        case Number(value):
            return value
        case Fluent():
            return world.value(substitute(expression, binding) if binding else expression)
        case Duration():
            return duration
        case Arithmetic(name, parts):
            first, *rest = (evaluate(part, world, binding, duration) for part in parts)
            if name == "-" and not rest:
                return None if first is None else -first
            for value in rest:
                if first is None or value is None:
                    return None
                first = _CALCULATE[name](first, value)
            return first if first is not None and math.isfinite(first) else None


def _divided(left: float, right: float) -> float:
    return left / right if right else math.inf


_CALCULATE: Mapping[str, Callable[[float, float], float]] = {
    "+": operator.add, "increase": operator.add, "-": operator.sub, "decrease": operator.sub,
    "*": operator.mul, "scale-up": operator.mul, "/": _divided, "scale-down": _divided,
}  # fmt: skip


def fluents(expression: Expression, binding: Binding = _NONE) -> Iterator[Fluent]:
    """Yield the ground functions in an expression."""
    match expression:
        case Fluent():
            yield substitute(expression, binding)
        case Arithmetic(_, parts):
            for part in parts:
                yield from fluents(part, binding)


def atoms(formula: Formula, world: PddlWorld, binding: Binding = _NONE) -> Iterator[Key]:
    """Yield the ground predicates and functions in a formula."""
    match formula:
        case Predicate():
            yield substitute(formula, binding)
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


def changes(
    effects: Iterable[Effect], world: PddlWorld, binding: Binding = _NONE, duration: float | None = None
) -> Changes:
    """Return the simultaneous changes by effects, deletions first; additions override deletions.

    Conditions and amounts are those of the world before. Several effects on one function accumulate. Raises
    PlanningError for an undefined amount or value.
    """
    deleted: Changes = {}
    added: Changes = {}
    values: dict[Key, float] = {}
    for effect in triggered(effects, world, binding):
        match effect:
            case Add(predicate):
                added[predicate] = True
            case Delete(predicate):
                deleted[predicate] = False
            case NumericEffect(_, fluent, amount):
                before = values[fluent] if fluent in values else world.value(fluent)
                values[fluent] = _changed(effect, before, evaluate(amount, world, duration=duration))
    return {**{predicate: False for predicate in deleted if predicate not in added}, **added, **values}


def triggered(
    effects: Iterable[Effect], world: PddlWorld, binding: Binding = _NONE
) -> Iterator[Add | Delete | NumericEffect]:
    """Yield the elementary effects whose conditions hold, ground."""
    for effect in effects:
        match effect:
            case UniversalEffect(variables, inside):
                for inner in bindings(variables, world, binding):
                    yield from triggered(inside, world, inner)
            case ConditionalEffect(condition, inside):
                if holds(condition, world, binding):
                    yield from triggered(inside, world, binding)
            case _:
                yield substitute(effect, binding) if binding else effect


def _changed(effect: NumericEffect, before: float | None, amount: float | None) -> float:
    what = f"{effect.operator} {effect.fluent}"
    if amount is None:
        raise PlanningError(f"{what}: the amount has no value")
    if effect.operator == "assign":
        return amount
    if before is None:
        raise PlanningError(f"{what}: it has no value yet")
    after = _CALCULATE[effect.operator](before, amount)
    if not math.isfinite(after):
        raise PlanningError(f"{what}: {before:g} cannot be changed by {amount:g}")
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
        return tuple(condition.formula for condition in self.conditions if condition.when == when)

    def effects_at(self, when: TimeSpecifier) -> tuple[Effect, ...]:
        return tuple(effect.effect for effect in self.effects if effect.when == when)


def ground(action: PddlAction, args: Iterable[str]) -> GroundAction:
    """Ground an action. Raises PlanningError for a wrong number of arguments."""
    objects = tuple(args)
    if len(objects) != len(action.parameters):
        raise PlanningError(
            f"{action.name} takes {len(action.parameters)} objects, not {len(objects)}: {' '.join(objects)}"
        )
    binding = {typed.name: name for typed, name in zip(action.parameters, objects, strict=True)}
    return GroundAction(
        action.name,
        objects,
        substitute(action.duration, binding),
        substitute(action.conditions, binding),
        substitute(action.effects, binding),
    )


def substitute(part: T, binding: Binding) -> T:
    """Replace the free variables of a formula, expression or effect, or of a tuple or dataclass of them."""
    found: Any = part
    match part:
        case Predicate() | Fluent():
            found = type(part)(part.name, tuple(binding.get(term, term) for term in part.terms))
        case Equality(left, right):
            found = Equality(binding.get(left, left), binding.get(right, right))
        case tuple():
            found = tuple(substitute(one, binding) for one in part)
        case _ if is_dataclass(part):
            if isinstance(part, Quantified | UniversalEffect):
                hidden = {typed.name for typed in part.variables}
                binding = {name: value for name, value in binding.items() if name not in hidden}
            inner = {name: substitute(getattr(part, name), binding) for name in part.__dataclass_fields__}
            found = replace(part, **inner)  # pyright: ignore[reportArgumentType]
    return found
