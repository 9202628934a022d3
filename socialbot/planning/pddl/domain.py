"""PDDL 2.1 domains, problems and plans as data, and problems as text."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.formulas import (
    Effect,
    Expression,
    Fluent,
    Formula,
    Predicate,
    TypedName,
    number_text,
    typed_text,
)

OBJECT = "object"
"""The type of everything."""

TimeSpecifier = Literal["start", "over all", "end"]


@dataclass(frozen=True, slots=True)
class Signature:
    """The name and the parameters of a predicate or function."""

    name: str
    parameters: tuple[TypedName, ...] = ()

    def __str__(self) -> str:
        return f"({' '.join((self.name, typed_text(self.parameters))).rstrip()})"


@dataclass(frozen=True, slots=True)
class TimedCondition:
    """A formula that has to hold when an action starts, while it lasts (between start and end), or when it ends."""

    when: TimeSpecifier
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
class PddlAction:
    """An action; without ``duration`` it is instantaneous, and all is at its start."""

    name: str
    parameters: tuple[TypedName, ...] = ()
    duration: DurationBounds | None = None
    conditions: tuple[TimedCondition, ...] = ()
    effects: tuple[TimedEffect, ...] = ()
    line: int = 0


@dataclass(frozen=True)
class PddlDomain:
    """What can be and what can be done. ``text`` is the PDDL it was read from, which planners are given.

    ``types`` maps each type to its parents (`OBJECT` itself has none); ``derived`` predicates follow from formulas.
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
class PddlProblem:
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


_LINE = re.compile(r"\s*([0-9.eE+-]+)\s*:\s*\(([^()]*)\)\s*(?:\[\s*([0-9.eE+-]+)\s*\]\s*)?(?:;.*)?$")

SEPARATION_S = 0.001
"""How far planners keep steps apart that must not coincide; plans may be late by as much for every step."""


@dataclass(frozen=True, slots=True, order=True)
class PlanStep:
    """An action with its objects, when to begin it (s from the start of the plan) and how long it lasts (s)."""

    start_s: float
    action: str
    args: tuple[str, ...] = ()
    duration_s: float = 0.0

    @property
    def end_s(self) -> float:
        """When it ends, s."""
        return self.start_s + self.duration_s

    @property
    def call(self) -> str:
        """The action with its objects, as PDDL writes it: ``(carrier_move carrier_a base deposit)``."""
        return f"({' '.join((self.action, *self.args))})"

    def __str__(self) -> str:
        return f"{self.start_s:.3f}: {self.call} [{self.duration_s:.3f}]"


@dataclass(frozen=True, slots=True)
class PddlPlan:
    """Steps in the order of their starts."""

    steps: tuple[PlanStep, ...] = ()

    @property
    def makespan_s(self) -> float:
        """When the last step ends, s."""
        return max((step.end_s for step in self.steps), default=0.0)

    def __str__(self) -> str:
        return "".join(f"{step}\n" for step in self.steps)


def in_time(plan: PddlPlan, makespan_s: float) -> bool:
    """Whether a plan ends in time, but for what keeps its steps apart."""
    return plan.makespan_s <= makespan_s + SEPARATION_S * (len(plan.steps) + 1)


def parse_plan(text: str, *, where: str = "plan") -> PddlPlan:
    """The plan that ``text`` holds, a step a line as planners print it. Raises PlanningError with the line.

    Empty lines and comments (``;``) are left out; a step without a duration lasts 0 s.
    """
    steps = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith(";"):
            continue
        found = _LINE.match(line)
        if found is None or not found[2].strip():
            raise PlanningError(
                f"no step of a plan: {line.strip()!r}",
                where=f"{where}:{number}",
                remedy="write 0.000: (go a b) [5.000]",
            )
        name, *args = found[2].lower().split()
        try:
            steps.append(PlanStep(float(found[1]), name, tuple(args), float(found[3] or 0.0)))
        except ValueError as error:
            raise PlanningError(f"no number: {error}", where=f"{where}:{number}") from error
    return PddlPlan(tuple(sorted(steps, key=lambda step: step.start_s)))


def problem_text(problem: PddlProblem, constants: Container[str] = ()) -> str:
    """The problem in PDDL, the same text for equal problems; ``constants``, which the domain declares, are left out.

    Without a goal there is no ``:goal``, which planners may not take.
    """
    objects = (TypedName(name, types) for name, types in problem.objects.items() if name not in constants)
    values = [f"(= {fluent} {number_text(value)})" for fluent, value in problem.values.items()]
    lines = [
        f"(define (problem {problem.name})",
        f"  (:domain {problem.domain})",
        _section(":objects", (typed_text([one]) for one in sorted(objects, key=lambda one: (one.types, one.name)))),
        _section(":init", [*sorted(map(str, problem.facts)), *sorted(values)]),
    ]
    if problem.goal is not None:
        lines.append(f"  (:goal {problem.goal})")
    if problem.metric is not None:
        lines.append(f"  (:metric {problem.metric})")
    return "\n".join(lines) + ")\n"


def _section(name: str, items: Iterable[str]) -> str:
    return "\n    ".join((f"  ({name}", *items)) + ")"
