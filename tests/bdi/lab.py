"""A small vocabulary, and an engine with its clock, its trace and a list of what it has done."""
# ruff: noqa: N801 - beliefs, goals and actions are written as agents write them

from __future__ import annotations

from typing import Any

from socialbot.bdi import (
    Action,
    Belief,
    Engine,
    Goal,
    Inference,
    Library,
    Plan,
    Reactor,
    Record,
    SingletonBelief,
    Sleep,
    variables,
)
from socialbot.bdi.literals import Change, Event
from socialbot.core.clock import SECOND, ManualClock

S, X, Y, Z, _ = variables("S X Y Z _")


class p(Belief): ...


class q(Belief): ...


class r(Belief):
    """A belief that rules infer."""


class mood(SingletonBelief): ...


class ping(Reactor): ...


class go(Goal): ...


class sub(Goal): ...


class deep(Goal): ...


class do(Action):
    def execute(self, *what: Any) -> None:
        self.engine.robot.note(what[0] if len(what) == 1 else what)


class crash(Action):
    def execute(self, what: str = "broken") -> None:
        raise ZeroDivisionError(what)


class nap(Action):
    """The action ``wait``, under a name that AgentSpeak has no other word for."""

    def execute(self, seconds: float) -> Any:
        return Sleep(seconds)


class Lab:
    """An engine in simulated time; ``done`` is what its actions did, ``timeline`` with the seconds at which."""

    def __init__(
        self,
        *rules: Plan | Inference | list[Plan],
        name: str = "lab",
        start: float = 0.0,
        library: Library | None = None,
    ) -> None:
        self.clock = ManualClock(round(start * SECOND))
        self.trace: list[Record] = []
        self.timeline: list[tuple[float, Any]] = []
        self.engine = Engine(name, self.clock, robot=self, sink=self.trace.append, library=library)
        self.engine.add_rules(*rules)

    def note(self, what: Any) -> None:
        self.timeline.append((self.clock.now() / SECOND, what))

    @property
    def done(self) -> list[Any]:
        return [what for _, what in self.timeline]

    @property
    def beliefs(self) -> list[str]:
        return [str(held.belief) for held in self.engine.beliefs]

    def post(self, *items: Event | Goal) -> None:
        for item in items:
            if isinstance(item, Goal):
                self.engine.achieve(item)
            elif isinstance(item.literal, Belief):
                (self.engine.believe if item.change is Change.ADDED else self.engine.forget)(item.literal)

    def tell(self, *items: Event | Goal) -> None:
        """Posts beliefs (+b), their end (-b) and goals, and lets the engine think."""
        self.post(*items)
        assert not self.engine.run_until_idle()

    def until(self, seconds: float) -> None:
        """Advance the time from wakeup to wakeup, as a host does."""
        end = round(seconds * SECOND)
        self.engine.run_until_idle()
        while (due := self.engine.next_wakeup()) is not None and due <= end:
            self.clock.set(max(due, self.clock.now()))
            self.engine.run_until_idle()
        self.clock.set(end)
        self.engine.run_until_idle()

    def kinds(self, kind: str) -> list[str]:
        return [record.what for record in self.trace if record.kind == kind]


def ends(lab: Lab) -> list[tuple[str, object]]:
    """Return the outcomes of actions."""
    return [(record.what, record.detail["outcome"]) for record in lab.trace if record.kind == "action_end"]
