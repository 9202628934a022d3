"""Events: what plans react to; and changes of belief, which are events as steps of a body."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from socialbot.bdi.conditions import NOTHING, Conjunction, conjunction
from socialbot.bdi.literals import Belief, Literal, Seconds
from socialbot.bdi.terms import Pattern, show
from socialbot.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.plans import Plan


class Change(enum.Enum):
    """What can happen to a belief or goal; the values are AgentSpeak's signs."""

    ADDED = "+"
    REMOVED = "-"
    HELD = "held "
    CHANGED = "changed "
    WANTED = "+!"
    FAILED = "-!"
    ASKED = "+?"
    UNANSWERED = "-?"


SIGNS = {Change.WANTED: "", Change.FAILED: "-", Change.ASKED: "?", Change.UNANSWERED: "-?"}


@dataclass(eq=False, repr=False)
class Event(Pattern):
    """A change of a belief or goal: the head of a plan or, for beliefs, a step of its body."""

    change: Change
    literal: Literal
    seconds: Seconds = 0.0

    def names(self) -> set[str]:
        return self.literal.names()

    @property
    def key(self) -> str:
        """By this the engine finds the plans that may react, as in ``+!at/2``."""
        if self.change is Change.CHANGED:
            return f"{self.change.value}{self.literal.functor}/{len(self.literal.args) // 2}"
        return self.change.value + self.literal.key

    def __truediv__(self, condition: object) -> Head:
        return Head(self, conjunction(condition))

    def __rshift__(self, body: Iterable[object]) -> Plan:
        return Head(self, NOTHING) >> body

    def __str__(self) -> str:
        if self.change is Change.HELD:
            seconds = self.seconds if isinstance(self.seconds, (int, float)) else "..."
            return f"+{self.literal}.held_for({seconds})"
        if self.change is Change.CHANGED:
            half = len(self.literal.args) // 2
            now, before = self.literal.with_(args=self.literal.args[:half]), self.literal.args[half:]
            return f"{now}.changed({', '.join(map(show, before))})"
        return f"{SIGNS.get(self.change, self.change.value)}{self.literal}"


@dataclass(eq=False, repr=False)
class Held:
    """A belief and how long it has to be held; ``+`` makes the event of it."""

    belief: Belief
    seconds: Seconds

    def __pos__(self) -> Event:
        return Event(Change.HELD, self.belief, self.seconds)

    def __str__(self) -> str:
        return str(+self)[1:]

    __repr__ = __str__


@dataclass(eq=False, repr=False)
class Head:
    """An event with a condition: half a plan, waiting for ``>> [steps]``."""

    event: Event
    condition: Conjunction

    def __rshift__(self, body: Iterable[object]) -> Plan:
        from socialbot.bdi.plans import Plan
        from socialbot.bdi.steps import body_of

        return Plan(self.event, self.condition, body_of(body)).check()

    def __and__(self, other: object) -> None:
        raise RuleError(
            f"the condition of {self.event} falls apart", remedy="put it in parentheses: event / (a & b) >> [...]"
        )
