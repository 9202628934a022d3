"""Time is given, never taken: everything that needs the time asks one of these clocks."""

from __future__ import annotations

import functools
import os
import threading
import time
from collections.abc import Callable
from typing import Protocol

steady_ns: Callable[[], int] = (
    functools.partial(time.clock_gettime_ns, time.CLOCK_BOOTTIME)
    if hasattr(time, "CLOCK_BOOTTIME")
    else time.monotonic_ns
)
"""Nanoseconds by a clock that nobody can set; on Linux it goes on while the computer sleeps."""

SECOND = 1_000_000_000
"""Nanoseconds in a second; stamps are integer nanoseconds, durations in the API float seconds."""


class Clock(Protocol):
    """Anything that tells the time."""

    def now(self) -> int:
        """Nanoseconds since the epoch of this clock."""
        ...


EPOCH_VARIABLE = "SOCIALBOT_EPOCH"
"""By it a process tells those that it starts what to count the time of day from (ns): so all of them tell the same."""


class WallClock:
    """The time of day: asked of the computer once, and counted from there on.

    So it goes on evenly when somebody, or NTP, sets the computer's clock meanwhile: timers fire when they should, and
    what was believed for a minute was believed for a minute. What the computer has slept through has passed.
    """

    def __init__(self) -> None:
        began = time.time_ns() - steady_ns()
        self._epoch = int(os.environ.setdefault(EPOCH_VARIABLE, str(began)))

    def now(self) -> int:
        """Nanoseconds since 1970."""
        return self._epoch + steady_ns()

    @property
    def behind_s(self) -> float:
        """By how much (s) the computer's clock was set forward since."""
        return (time.time_ns() - self.now()) / SECOND


class ForwardClock:
    """Another clock, which may be set: when it goes back, as where a bag is played in a loop, this one goes on."""

    def __init__(self, now: Callable[[], int]) -> None:
        self._source = now
        self._ahead = 0
        self._last = 0
        self._looking = threading.Lock()

    def now(self) -> int:
        """Nanoseconds, never fewer than before."""
        with self._looking:
            told = self._source()
            self._ahead = max(self._ahead, self._last - told)
            self._last = told + self._ahead
            return self._last


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
