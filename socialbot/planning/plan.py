"""Plans: which actions to begin when."""

from __future__ import annotations

import re
from dataclasses import dataclass

from socialbot.errors import PlanningError

_LINE = re.compile(r"\s*([0-9.eE+-]+)\s*:\s*\(([^()]*)\)\s*(?:\[\s*([0-9.eE+-]+)\s*\]\s*)?(?:;.*)?$")

SEPARATION_S = 0.001
"""How far planners keep steps apart that must not coincide; plans may be late by as much for every step."""


@dataclass(frozen=True, slots=True, order=True)
class Step:
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
class Plan:
    """Steps in the order of their starts."""

    steps: tuple[Step, ...] = ()

    @property
    def makespan_s(self) -> float:
        """When the last step ends, s."""
        return max((step.end_s for step in self.steps), default=0.0)

    def __str__(self) -> str:
        return "".join(f"{step}\n" for step in self.steps)


def in_time(plan: Plan, makespan_s: float) -> bool:
    """Whether a plan ends in time, but for what keeps its steps apart."""
    return plan.makespan_s <= makespan_s + SEPARATION_S * (len(plan.steps) + 1)


def parse_plan(text: str, *, where: str = "plan") -> Plan:
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
            steps.append(Step(float(found[1]), name, tuple(args), float(found[3] or 0.0)))
        except ValueError as error:
            raise PlanningError(f"no number: {error}", where=f"{where}:{number}") from error
    return Plan(tuple(sorted(steps, key=lambda step: step.start_s)))
