"""Domains and problems of PDDL 2.1 as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from socialbot.planning.formulas import Effect, Expression, Fluent, Formula, Predicate, Typed, typed_text

OBJECT = "object"
"""The type of everything."""

When = Literal["start", "over all", "end"]


@dataclass(frozen=True, slots=True)
class Signature:
    """The name and the parameters of a predicate or function."""

    name: str
    parameters: tuple[Typed, ...] = ()

    def __str__(self) -> str:
        return f"({' '.join((self.name, typed_text(self.parameters))).rstrip()})"


@dataclass(frozen=True, slots=True)
class TimedCondition:
    """A formula that has to hold when an action starts, while it lasts (between start and end), or when it ends."""

    when: When
    formula: Formula


@dataclass(frozen=True, slots=True)
class TimedEffect:
    """What an action changes when it starts, or when it ends."""

    when: Literal["start", "end"]
    effect: Effect


@dataclass(frozen=True, slots=True)
class DurationBounds:
    """Least and greatest duration, s; the same expression twice for ``(= ?duration e)``, None for no bound."""

    least: Expression | None
    most: Expression | None


@dataclass(frozen=True, slots=True)
class Action:
    """An action; without ``duration`` it is instantaneous, and all is at its start."""

    name: str
    parameters: tuple[Typed, ...] = ()
    duration: DurationBounds | None = None
    conditions: tuple[TimedCondition, ...] = ()
    effects: tuple[TimedEffect, ...] = ()
    line: int = 0


@dataclass(frozen=True)
class Domain:
    """What can be and what can be done. ``text`` is the PDDL it was read from, which planners are given.

    ``types`` maps each type to its parents (`OBJECT` itself has none); ``derived`` predicates follow from formulas.
    """

    name: str
    types: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: {OBJECT: ()})
    constants: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    predicates: Mapping[str, Signature] = field(default_factory=dict)
    functions: Mapping[str, Signature] = field(default_factory=dict)
    actions: Mapping[str, Action] = field(default_factory=dict)
    derived: Mapping[str, tuple[tuple[Typed, ...], Formula]] = field(default_factory=dict)
    requirements: frozenset[str] = frozenset()
    text: str = field(default="", compare=False, repr=False)
    where: str = field(default="", compare=False)
    """The file, for errors."""

    def is_a(self, kind: str, of: str) -> bool:
        """Whether the type ``kind`` is ``of``, or a sub-type of it."""
        return kind == of or of == OBJECT or any(self.is_a(parent, of) for parent in self.types.get(kind, ()))

    def fits(self, types: tuple[str, ...], wanted: tuple[str, ...]) -> bool:
        """Whether something of any of ``types`` is always of a ``wanted`` one."""
        return all(any(self.is_a(kind, one) for one in wanted) for kind in types)


@dataclass(frozen=True, slots=True)
class Metric:
    """What makes a plan better; ``total-time`` is a function without objects here."""

    direction: Literal["minimize", "maximize"]
    expression: Expression

    def __str__(self) -> str:
        return f"{self.direction} {self.expression}"


@dataclass(frozen=True)
class Problem:
    """What is, and what is wanted. ``objects`` maps names to types (constants of the domain need not be among them)."""

    name: str
    domain: str
    objects: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    facts: frozenset[Predicate] = frozenset()
    values: Mapping[Fluent, float] = field(default_factory=dict)
    goal: Formula | None = None
    metric: Metric | None = None
    text: str = field(default="", compare=False, repr=False)
    where: str = field(default="", compare=False)
