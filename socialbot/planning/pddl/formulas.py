"""Formulas and effects of PDDL 2.1: what conditions, goals and actions are made of.

Terms are plain strings: names of objects, or variables such as ``?box``. All names are in lower case, as PDDL
does not tell cases apart. ``str()`` of a formula, expression or effect is its PDDL.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal
from typing import Literal, Protocol

Terms = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TypedName:
    """A variable or object and its type; with ``either`` several types, it may have any of them."""

    name: str
    types: tuple[str, ...] = ("object",)


# Numbers


@dataclass(frozen=True, slots=True)
class Number:
    """A number."""

    value: float

    def __str__(self) -> str:
        return number_text(self.value)


@dataclass(frozen=True, slots=True)
class Fluent:
    """The value of a function for some objects, such as ``(stacked base_1)``."""

    function: str
    terms: Terms = ()

    def __str__(self) -> str:
        return _call(self.function, *self.terms)


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """``+``, ``-``, ``*`` or ``/`` of two or more expressions; ``-`` of one is its negative."""

    operator: Literal["+", "-", "*", "/"]
    parts: tuple[Expression, ...]

    def __str__(self) -> str:
        return _call(self.operator, *self.parts)


@dataclass(frozen=True, slots=True)
class Duration:
    """``?duration``, the duration of the action."""

    def __str__(self) -> str:
        return "?duration"


Expression = Number | Fluent | Arithmetic | Duration

Comparator = Literal["<", "<=", "=", ">=", ">"]


# Formulas


@dataclass(frozen=True, slots=True)
class Predicate:
    """A predicate about some objects, such as ``(on box_a box_b)``."""

    name: str
    terms: Terms = ()

    def __str__(self) -> str:
        return _call(self.name, *self.terms)


@dataclass(frozen=True, slots=True)
class Equality:
    """``(= ?x ?y)`` of two objects."""

    left: str
    right: str

    def __str__(self) -> str:
        return _call("=", self.left, self.right)


@dataclass(frozen=True, slots=True)
class NumericComparison:
    """Two numbers compared."""

    comparator: Comparator
    left: Expression
    right: Expression

    def __str__(self) -> str:
        return _call(self.comparator, self.left, self.right)


@dataclass(frozen=True, slots=True)
class Not:
    """A formula that shall not hold."""

    part: Formula

    def __str__(self) -> str:
        return _call("not", self.part)


@dataclass(frozen=True, slots=True)
class And:
    """All of some formulas; of none, what always holds."""

    parts: tuple[Formula, ...] = ()

    def __str__(self) -> str:
        return _call("and", *self.parts)


@dataclass(frozen=True, slots=True)
class Or:
    """At least one of some formulas; of none, what never holds. ``(imply a b)`` is read as ``(or (not a) b)``."""

    parts: tuple[Formula, ...] = ()

    def __str__(self) -> str:
        return _call("or", *self.parts)


@dataclass(frozen=True, slots=True)
class Quantified:
    """A formula for all objects of some types, or for at least one."""

    quantifier: Literal["forall", "exists"]
    variables: tuple[TypedName, ...]
    part: Formula

    def __str__(self) -> str:
        return _call(self.quantifier, f"({typed_text(self.variables)})", self.part)


Formula = Predicate | Equality | NumericComparison | Not | And | Or | Quantified


# Effects


@dataclass(frozen=True, slots=True)
class Add:
    """Makes a predicate true."""

    predicate: Predicate

    def __str__(self) -> str:
        return str(self.predicate)


@dataclass(frozen=True, slots=True)
class Delete:
    """Makes a predicate false."""

    predicate: Predicate

    def __str__(self) -> str:
        return _call("not", self.predicate)


@dataclass(frozen=True, slots=True)
class NumericEffect:
    """Changes the value of a function."""

    operator: Literal["assign", "increase", "decrease", "scale-up", "scale-down"]
    fluent: Fluent
    amount: Expression

    def __str__(self) -> str:
        return _call(self.operator, self.fluent, self.amount)


@dataclass(frozen=True, slots=True)
class UniversalEffect:
    """Effects for all objects of some types."""

    variables: tuple[TypedName, ...]
    effects: tuple[Effect, ...]

    def __str__(self) -> str:
        return _call("forall", f"({typed_text(self.variables)})", _call("and", *self.effects))


@dataclass(frozen=True, slots=True)
class ConditionalEffect:
    """Effects if a condition holds."""

    condition: Formula
    effects: tuple[Effect, ...]

    def __str__(self) -> str:
        return _call("when", self.condition, _call("and", *self.effects))


Effect = Add | Delete | NumericEffect | UniversalEffect | ConditionalEffect


class PddlWorld(Protocol):
    """What formulas are asked about: a state while a plan is checked, or what an agent believes."""

    def holds(self, predicate: Predicate) -> bool:
        """Whether a predicate without variables is true."""
        ...

    def value(self, fluent: Fluent) -> float | None:
        """The value of a function without variables; None when it has none."""
        ...

    def objects(self, types: tuple[str, ...]) -> Iterable[str]:
        """The objects of any of these types or of a sub-type, in a fixed order."""
        ...


# Text


def number_text(value: float) -> str:
    """A number as PDDL writes it: exact, without exponent."""
    text = repr(float(value))
    return (format(Decimal(text), "f") if "e" in text else text).removesuffix(".0")


def typed_text(typed: Iterable[TypedName]) -> str:
    """Variables or objects with their types, as PDDL writes them: ``?a ?b - box``."""
    words: list[str] = []
    types: tuple[str, ...] | None = None
    for one in typed:
        if types is not None and one.types != types:
            words += ["-", _types_text(types)]
        words.append(one.name)
        types = one.types
    return " ".join(words if types is None else [*words, "-", _types_text(types)])


def _types_text(types: tuple[str, ...]) -> str:
    return types[0] if len(types) == 1 else _call("either", *types)


def _call(*words: object) -> str:
    return f"({' '.join(map(str, words))})"
