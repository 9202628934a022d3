"""Formulas, numeric expressions and effects of PDDL 2.1.

Terms are strings: names of objects, or variables such as ``?box``. All names are lower case, as PDDL ignores case.
``str()`` returns the PDDL.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from decimal import Decimal
from typing import Literal, Protocol

Terms = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TypedName:
    """Variable or object with its type, or with the types of an ``either``."""

    name: str
    types: tuple[str, ...] = ("object",)


@dataclass(frozen=True, slots=True)
class Number:
    """Numeric constant."""

    value: float

    def __str__(self) -> str:
        return number_text(self.value)


@dataclass(frozen=True, slots=True)
class _Named:
    name: str
    terms: Terms = ()

    def __str__(self) -> str:
        return _call(self.name, *self.terms)


@dataclass(frozen=True, slots=True)
class Predicate(_Named):
    """Predicate of some objects, such as ``(on box_a box_b)``."""


@dataclass(frozen=True, slots=True)
class Fluent(_Named):
    """Function of some objects, such as ``(stacked base_1)``."""


Key = Predicate | Fluent
"""Part of a state: a predicate, which is true or false, or a function, which has a value."""


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """``+``, ``-``, ``*`` or ``/`` of two or more expressions; ``-`` of one is its negation."""

    operator: Literal["+", "-", "*", "/"]
    parts: tuple[Expression, ...]

    def __str__(self) -> str:
        return _call(self.operator, *self.parts)


@dataclass(frozen=True, slots=True)
class Duration:
    """The duration of the action, ``?duration``."""

    def __str__(self) -> str:
        return "?duration"


Expression = Number | Fluent | Arithmetic | Duration

Comparator = Literal["<", "<=", "=", ">=", ">"]


@dataclass(frozen=True, slots=True)
class Equality:
    """Equality ``(= ?x ?y)`` of two objects."""

    left: str
    right: str

    def __str__(self) -> str:
        return _call("=", self.left, self.right)


@dataclass(frozen=True, slots=True)
class NumericComparison:
    """Comparison of two numeric expressions."""

    comparator: Comparator
    left: Expression
    right: Expression

    def __str__(self) -> str:
        return _call(self.comparator, self.left, self.right)


@dataclass(frozen=True, slots=True)
class Not:
    """Negation."""

    part: Formula

    def __str__(self) -> str:
        return _call("not", self.part)


@dataclass(frozen=True, slots=True)
class _Junction:
    parts: tuple[Formula, ...] = ()

    def __str__(self) -> str:
        return _call(type(self).__name__.lower(), *self.parts)


@dataclass(frozen=True, slots=True)
class And(_Junction):
    """Conjunction; true without parts."""


@dataclass(frozen=True, slots=True)
class Or(_Junction):
    """Disjunction; false without parts. ``(imply a b)`` is read as ``(or (not a) b)``."""


@dataclass(frozen=True, slots=True)
class Quantified:
    """Universal or existential quantification over objects of some types."""

    quantifier: Literal["forall", "exists"]
    variables: tuple[TypedName, ...]
    part: Formula

    def __str__(self) -> str:
        return _call(self.quantifier, f"({typed_text(self.variables)})", self.part)


Formula = Predicate | Equality | NumericComparison | Not | And | Or | Quantified


@dataclass(frozen=True, slots=True)
class Add:
    """Add effect: makes a predicate true."""

    predicate: Predicate

    def __str__(self) -> str:
        return str(self.predicate)


@dataclass(frozen=True, slots=True)
class Delete:
    """Delete effect: makes a predicate false."""

    predicate: Predicate

    def __str__(self) -> str:
        return _call("not", self.predicate)


@dataclass(frozen=True, slots=True)
class NumericEffect:
    """Numeric effect on a function."""

    operator: Literal["assign", "increase", "decrease", "scale-up", "scale-down"]
    fluent: Fluent
    amount: Expression

    def __str__(self) -> str:
        return _call(self.operator, self.fluent, self.amount)


@dataclass(frozen=True, slots=True)
class UniversalEffect:
    """Effects for all objects of some types (``forall``)."""

    variables: tuple[TypedName, ...]
    effects: tuple[Effect, ...]

    def __str__(self) -> str:
        return _call("forall", f"({typed_text(self.variables)})", _call("and", *self.effects))


@dataclass(frozen=True, slots=True)
class ConditionalEffect:
    """Effects under a condition (``when``)."""

    condition: Formula
    effects: tuple[Effect, ...]

    def __str__(self) -> str:
        return _call("when", self.condition, _call("and", *self.effects))


Effect = Add | Delete | NumericEffect | UniversalEffect | ConditionalEffect


class PddlWorld(Protocol):
    """Interpretation of formulas: the state of a simulated plan, or the beliefs of an agent."""

    def holds(self, predicate: Predicate) -> bool:
        """Return whether a ground predicate is true."""
        ...

    def value(self, fluent: Fluent) -> float | None:
        """Return the value of a ground function; None if undefined."""
        ...

    def objects(self, types: tuple[str, ...]) -> Iterable[str]:
        """Return the objects of any of these types or of a sub-type, in a fixed order."""
        ...


def conjuncts(formula: Formula) -> Iterator[Formula]:
    """Yield the parts of a conjunction, also of nested ones; any other formula is its only part."""
    if isinstance(formula, And):
        for part in formula.parts:
            yield from conjuncts(part)
    else:
        yield formula


def simple_effects(effects: Iterable[Effect]) -> Iterator[Add | Delete | NumericEffect]:
    """Yield the effects that change one part of a state, also those inside of others."""
    for effect in effects:
        if isinstance(effect, UniversalEffect | ConditionalEffect):
            yield from simple_effects(effect.effects)
        else:
            yield effect


def number_text(value: float) -> str:
    """Return a number in PDDL: exact, without exponent."""
    text = repr(float(value))
    return (format(Decimal(text), "f") if "e" in text else text).removesuffix(".0")


def typed_text(typed: Iterable[TypedName]) -> str:
    """Return variables or objects with their types in PDDL: ``?a ?b - box``."""
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
