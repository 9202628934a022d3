"""Timers of a deliberating agent: the next time to look again, and sensors that timed out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from socialbot.bdi import Engine
from socialbot.core.errors import PlanningError

NEVER = 1 << 62
"""A time (ns) that does not come."""


class Alarm:
    """Calls ``wake`` at the earliest time (ns) that `is_due` was asked about, since `begin`, before it had come."""

    def __init__(self, engine: Engine, wake: Callable[[], object]) -> None:
        self._engine = engine
        self._wake = wake
        self._next = NEVER
        self._set = NEVER

    def begin(self) -> None:
        """Begins a look at everything."""
        self._next = NEVER

    def is_due(self, time: int) -> bool:
        """Whether a time has come."""
        if time <= self._engine.clock.now():
            return True
        self._next = min(self._next, time)
        return False

    def end(self) -> None:
        """Ends the look; the next one is at the earliest time that was too early for this one."""
        if self._set <= self._engine.clock.now():
            self._set = NEVER
        if self._next < self._set:
            self._set = self._next
            self._engine.at(self._next, self._wake)


@dataclass(slots=True)
class _Gap:
    """``since`` (ns) something is waited for; perhaps for the ``first`` time, perhaps for too long already."""

    since: int
    first: bool
    overdue: bool = False


class SensorTimeouts:
    """The sensors that are silent now, in the order in which they fell silent."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._gaps: dict[str, _Gap] = {}

    def __bool__(self) -> bool:
        return bool(self._gaps)

    def expect(self, sensor: str) -> None:
        """A sensor has just been added, and has told nothing yet. Raises PlanningError for one of the same name."""
        if sensor in self._gaps:
            raise PlanningError(
                "there is another sensor of this name", where=f"sensor {sensor}", remedy="override its name"
            )
        self._gaps[sensor] = _Gap(self._engine.clock.now(), True)

    def begin(self, sensor: str) -> bool:
        """A sensor should have told something by now; False when that is known."""
        gap = self._gaps.setdefault(sensor, _Gap(self._engine.clock.now(), False))
        if gap.overdue:
            return False
        gap.overdue = True
        self._engine.record("silent", sensor, "")
        return True

    def end(self, sensor: str, cause: str) -> bool:
        """A sensor has told something; False when it was not silent. ``cause`` is the percept."""
        gap = self._gaps.pop(sensor, None)
        if gap is not None and gap.overdue:
            self._engine.record("heard", sensor, cause)
        return gap is not None

    @property
    def is_first(self) -> bool:
        """Whether there is a sensor of which nothing was ever heard."""
        return any(gap.first for gap in self._gaps.values())

    @property
    def since(self) -> int:
        """Since when (ns) it has been silent that has been longest; only while there is one."""
        return min(gap.since for gap in self._gaps.values())

    def __str__(self) -> str:
        return ", ".join(f"sensor {sensor} is silent" for sensor in self._gaps)
