"""Domains, problems and plans of PDDL 2.1 as data, and problems as text."""

from __future__ import annotations

import itertools
import re
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.formulas import (
    Add,
    Delete,
    Effect,
    Expression,
    Fluent,
    Formula,
    NumericEffect,
    Predicate,
    TypedName,
    number_text,
    typed_text,
)

OBJECT = "object"
"""Root of the type hierarchy."""

TimeSpecifier = Literal["start", "over all", "end"]


@dataclass(frozen=True, slots=True)
class Signature:
    """Name and parameters of a predicate or function."""

    name: str
    parameters: tuple[TypedName, ...] = ()

    def __str__(self) -> str:
        return f"({' '.join((self.name, typed_text(self.parameters))).rstrip()})"


@dataclass(frozen=True, slots=True)
class TimedCondition:
    """Condition of an action at its start, over all of its duration, or at its end."""

    when: TimeSpecifier
    formula: Formula


@dataclass(frozen=True, slots=True)
class TimedEffect:
    """Effect of an action at its start or end."""

    when: Literal["start", "end"]
    effect: Effect


@dataclass(frozen=True, slots=True)
class DurationBounds:
    """Minimum and maximum duration (s); equal for ``(= ?duration e)``, None for no bound."""

    least: Expression | None
    most: Expression | None


@dataclass(frozen=True, slots=True)
class PddlAction:
    """Action; without ``duration`` it is instantaneous, with conditions and effects at its start."""

    name: str
    parameters: tuple[TypedName, ...] = ()
    duration: DurationBounds | None = None
    conditions: tuple[TimedCondition, ...] = ()
    effects: tuple[TimedEffect, ...] = ()
    line: int = 0


@dataclass(frozen=True)
class PddlDomain:
    """Domain of PDDL.

    Attributes:
        types: The parents of each type; `OBJECT` has none.
        derived: Parameters and formula of each derived predicate.
        text: The PDDL source, which planners get.
        where: File name for error messages.
    """

    name: str
    types: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: {OBJECT: ()})
    constants: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    predicates: Mapping[str, Signature] = field(default_factory=dict)
    functions: Mapping[str, Signature] = field(default_factory=dict)
    actions: Mapping[str, PddlAction] = field(default_factory=dict)
    derived: Mapping[str, tuple[tuple[TypedName, ...], Formula]] = field(default_factory=dict)
    requirements: frozenset[str] = frozenset()
    text: str = field(default="", compare=False, repr=False)
    where: str = field(default="", compare=False)

    def is_a(self, kind: str, of: str) -> bool:
        """Return whether a type is ``of``, or a sub-type of it."""
        return kind == of or of == OBJECT or any(self.is_a(parent, of) for parent in self.types.get(kind, ()))

    def fits(self, types: tuple[str, ...], wanted: tuple[str, ...]) -> bool:
        """Return whether all of ``types`` are sub-types of ``wanted`` ones."""
        return all(any(self.is_a(kind, one) for one in wanted) for kind in types)

    def belongs(self, types: tuple[str, ...], wanted: tuple[str, ...]) -> bool:
        """Return whether an object of all ``types`` belongs to a wanted one. Planners read ``either`` of objects so."""
        return any(self.is_a(kind, one) for kind in types for one in wanted)


TOTAL_TIME = "total-time"
"""Function of metrics: the makespan of the plan."""


@dataclass(frozen=True, slots=True)
class Metric:
    """Metric of plans; ``total-time`` is a function without parameters."""

    direction: Literal["minimize", "maximize"]
    expression: Expression

    def __str__(self) -> str:
        return f"{self.direction} {self.expression}"


@dataclass(frozen=True, slots=True)
class TimedInitialEffect:
    """Timed initial literal or fluent: a change of the world at a time (s) that no action causes."""

    time_s: float
    effect: Add | Delete | NumericEffect

    def __str__(self) -> str:
        effect = self.effect
        what = f"(= {effect.fluent} {effect.amount})" if isinstance(effect, NumericEffect) else effect
        return f"(at {number_text(self.time_s)} {what})"


@dataclass(frozen=True)
class PddlProblem:
    """Problem of PDDL: initial state and goal.

    Attributes:
        objects: Maps names to types; constants may be missing.
        timed: Timed initial literals and fluents in the order of time.
    """

    name: str
    domain: str
    objects: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    facts: frozenset[Predicate] = frozenset()
    values: Mapping[Fluent, float] = field(default_factory=dict)
    goal: Formula | None = None
    metric: Metric | None = None
    timed: tuple[TimedInitialEffect, ...] = ()
    text: str = field(default="", compare=False, repr=False)
    where: str = field(default="", compare=False)


_LINE = re.compile(r"\s*(?:([0-9.eE+-]+)\s*:\s*)?\(([^()]*)\)\s*(?:\[\s*([0-9.eE+-]+)\s*\]\s*)?(?:;.*)?$")

SEPARATION_S = 0.001
"""Separation (s) that planners put between steps; deadlines allow for it."""


@dataclass(frozen=True, slots=True, order=True)
class PlanStep:
    """Action with its objects, start time (s from the start of the plan) and duration (s)."""

    start_s: float
    action: str
    args: tuple[str, ...] = ()
    duration_s: float = 0.0

    @property
    def end_s(self) -> float:
        return self.start_s + self.duration_s

    @property
    def call(self) -> str:
        """The action with its objects in PDDL: ``(carrier_move carrier_a base deposit)``."""
        return f"({' '.join((self.action, *self.args))})"

    def __str__(self) -> str:
        return f"{_seconds(self.start_s)}: {self.call} [{_seconds(self.duration_s)}]"


def _seconds(value: float) -> str:
    """Return seconds to the nanosecond, with at least three decimals."""
    whole, _, decimals = f"{value:.9f}".partition(".")
    return f"{whole}.{decimals.rstrip('0'):0<3}"


@dataclass(frozen=True, slots=True)
class PddlPlan:
    """Plan: steps in the order of their start times."""

    steps: tuple[PlanStep, ...] = ()

    @property
    def makespan_s(self) -> float:
        """End time (s) of the last step."""
        return max((step.end_s for step in self.steps), default=0.0)

    def __str__(self) -> str:
        return "".join(f"{step}\n" for step in self.steps)


def in_time(plan: PddlPlan, makespan_s: float) -> bool:
    """Return whether a plan ends in time, apart from the separations between steps."""
    return plan.makespan_s <= makespan_s + SEPARATION_S * (len(plan.steps) + 1)


def parse_plan(text: str, *, where: str = "plan") -> PddlPlan:
    """Parse a plan with one step per line, as planners print it. Raises PlanningError with the line.

    Empty lines and comments (``;``) are ignored; the default duration is 0 s. Steps without times, as classical
    planners print them, happen one after the other, at 1 s, 2 s, and so on (as in VAL).
    """
    steps = []
    untimed = itertools.count(1)
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith(";"):
            continue
        found = _LINE.match(line)
        if found is None or not found[2].strip():
            raise PlanningError(
                f"no step of a plan: {line.strip()!r}",
                where=f"{where}:{number}",
                remedy="write 0.000: (go a b) [5.000], or (go a b) if it takes no time",
            )
        name, *args = found[2].lower().split()
        try:
            start_s = float(found[1] or next(untimed))
            steps.append(PlanStep(start_s, name, tuple(args), float(found[3] or 0.0)))
        except ValueError as error:
            raise PlanningError(f"no number: {error}", where=f"{where}:{number}") from error
    return PddlPlan(tuple(sorted(steps, key=lambda step: step.start_s)))


def problem_text(problem: PddlProblem, constants: Container[str] = ()) -> str:
    """Return a problem in PDDL without the ``constants`` of its domain; equal problems have equal texts."""
    objects = (TypedName(name, types) for name, types in problem.objects.items() if name not in constants)
    values = [f"(= {fluent} {number_text(value)})" for fluent, value in problem.values.items()]
    name = problem.name if problem.name[:1].isalpha() else f"problem-{problem.name}"  # some are numbers
    lines = [
        f"(define (problem {name})",
        f"  (:domain {problem.domain})",
        _section(":objects", (typed_text([one]) for one in sorted(objects, key=lambda one: (one.types, one.name)))),
        _section(":init", [*sorted(map(str, problem.facts)), *sorted(values), *map(str, problem.timed)]),
    ]
    if problem.goal is not None:
        lines.append(f"  (:goal {problem.goal})")
    if problem.metric is not None:
        lines.append(f"  (:metric {problem.metric})")
    return "\n".join(lines) + ")\n"


def _section(name: str, items: Iterable[str]) -> str:
    return "\n    ".join((f"  ({name}", *items)) + ")"
