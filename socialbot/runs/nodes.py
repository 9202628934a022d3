"""How the nodes of a run were at any time, from what they have told."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from socialbot.core.messages import Health
from socialbot.graph.status import NodeStatus, RollCall
from socialbot.runs.record import NodeTold

T = TypeVar("T")


@dataclass
class _Course(Generic[T]):
    """What somebody has told, and when (s)."""

    times: list[float] = field(default_factory=list)
    told: list[T] = field(default_factory=list)

    def note(self, at_s: float, told: T) -> None:
        place = bisect_right(self.times, at_s)
        self.times.insert(place, at_s)
        self.told.insert(place, told)

    def forget(self, at_s: float) -> None:
        count = max(0, bisect_right(self.times, at_s) - 1)
        del self.times[:count], self.told[:count]

    def before(self, at_s: float) -> tuple[float, T] | None:
        place = bisect_right(self.times, at_s)
        return (self.times[place - 1], self.told[place - 1]) if place else None


class NodesThen:
    """The nodes with these ``names`` in the course of a run. Times are s from its start."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._health: dict[str, _Course[Health]] = {}
        self._told: dict[str, _Course[NodeTold]] = {}

    def take(self, at_s: float, told: Health | NodeTold) -> None:
        """Takes what a node tells."""
        if isinstance(told, Health):
            self._health.setdefault(told.node, _Course()).note(at_s, told)
        else:
            self._told.setdefault(told.name, _Course()).note(at_s, told)

    def forget(self, at_s: float) -> None:
        """Forgets what was told before, but for what each of them had told last by ``at_s``."""
        for course in (*self._health.values(), *self._told.values()):
            course.forget(at_s)

    @property
    def health(self) -> list[tuple[float, Health]]:
        """What they said of their health, and when, in order."""
        said = (pair for course in self._health.values() for pair in zip(course.times, course.told, strict=True))
        return sorted(said, key=lambda pair: pair[0])

    @property
    def told(self) -> Mapping[str, Sequence[tuple[float, NodeTold]]]:
        """What each of them told on /diagnostics, and when, in order."""
        return {name: list(zip(course.times, course.told, strict=True)) for name, course in self._told.items()}

    @property
    def machines(self) -> Mapping[str, str]:
        """The machines of the nodes that have told theirs."""
        return {name: course.told[-1].values.get("machine", "") for name, course in self._told.items()}

    def at(self, now: float, fates: Mapping[str, Any]) -> tuple[NodeStatus, ...]:
        """How they were at ``now``. ``fates`` is how they fared in the end, for those of the inline runner."""
        if not self._told:
            return tuple(self._inline(now, name, fates.get(name, {})) for name in fates or self._names)
        roll = RollCall(dict.fromkeys(self._names, ""))
        for name in self._names:
            told, health = self._said(self._told, name, now), self._said(self._health, name, now)
            if told is not None:
                roll.note(name, told[1].values, told[0])
            if health is not None:
                roll.note_health(health[1], now)  # said again and again, kept once
        return tuple(roll.statuses(now))

    def _inline(self, now: float, name: str, fate: Mapping[str, Any]) -> NodeStatus:
        health = self._said(self._health, name, now)
        said = health[1] if health is not None else None
        return NodeStatus(
            name,
            state="active",
            heard_s=0.0,
            health=said.state if said else "",
            reason=said.reason if said else "",
            silent=said.silent if said else (),
            failures=fate.get("failures", 0),
            first_failure=fate.get("first_failure", ""),
        )

    @staticmethod
    def _said(courses: Mapping[str, _Course[T]], name: str, now: float) -> tuple[float, T] | None:
        course = courses.get(name)
        return None if course is None else course.before(now)
