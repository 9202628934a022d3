"""An alarm: has somebody look again at the earliest of the times that they found to lie ahead."""

from __future__ import annotations

from collections.abc import Callable

from socialbot.bdi import Engine

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
