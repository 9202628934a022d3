"""Time is given, never taken: everything that needs the time asks one of these clocks."""

from __future__ import annotations

import time
from typing import Protocol

SECOND = 1_000_000_000
"""Nanoseconds in a second; stamps are integer nanoseconds, durations in the API float seconds."""


class Clock(Protocol):
    """Anything that tells the time."""

    def now(self) -> int:
        """Nanoseconds since the epoch of this clock."""
        ...


class WallClock:
    """The computer's own time of day."""

    now = staticmethod(time.time_ns)


class ManualClock:
    """A clock that stands still until told otherwise: simulated time, bags and tests."""

    def __init__(self, now: int = 0) -> None:
        self._now = now

    def now(self) -> int:
        """The time that it was set to (ns)."""
        return self._now

    def set(self, now: int) -> None:
        """Moves to ``now`` (ns). Raises ValueError when that lies in the past."""
        if now < self._now:
            raise ValueError(f"time cannot go back from {self._now} to {now} ns")
        self._now = now

    def advance(self, seconds: float) -> None:
        """Moves on by ``seconds``."""
        self.set(self._now + nanoseconds(seconds))


def nanoseconds(seconds: float) -> int:
    """Seconds as integer nanoseconds, rounded. Raises TypeError for what is no number."""
    if not isinstance(seconds, (int, float)):
        raise TypeError(f"expected seconds as a number, got {seconds!r}")
    return round(seconds * SECOND)
