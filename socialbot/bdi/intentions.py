"""Intentions: stacks of plans on the heap, each plan knowing its next step."""

from __future__ import annotations

from dataclasses import dataclass

from socialbot.bdi.beliefs import Held
from socialbot.bdi.literals import Goal
from socialbot.bdi.rules import Rule, Step
from socialbot.bdi.terms import Bindings


@dataclass(slots=True, eq=False)
class Frame:
    """A plan being carried out: the rule, its variables, its record in the trace, the goal it serves."""

    rule: Rule
    bindings: Bindings
    record: str
    goal: Goal | None
    position: int = 0

    @property
    def finished(self) -> bool:
        """Whether all steps have been made."""
        return self.position >= len(self.rule.body)

    def advance(self) -> Step | None:
        """The next step, which counts as made; None when there is none."""
        if self.finished:
            return None
        self.position += 1
        return self.rule.body[self.position - 1]


@dataclass(slots=True, eq=False)
class Intention:
    """What the agent is doing about one event or goal: the plan at the top serves the one below."""

    frames: list[Frame]

    def __str__(self) -> str:
        return " < ".join(str(frame.rule.event) for frame in reversed(self.frames))


@dataclass(frozen=True, slots=True)
class Mind:
    """What an agent believes, desires and intends at one moment."""

    beliefs: tuple[Held, ...]
    desires: tuple[Goal, ...]
    intentions: tuple[Intention, ...]
