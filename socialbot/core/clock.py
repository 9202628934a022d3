"""Clocks: all components read the time from one of these, never from the system."""

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
"""Monotonic clock in nanoseconds; on Linux it includes time in suspend."""

SECOND = 1_000_000_000
"""Nanoseconds in a second; stamps are integer nanoseconds, durations in the API float seconds."""


class Clock(Protocol):
    """Interface of a clock."""

    def now(self) -> int:
        """Return nanoseconds since the epoch of this clock."""
        ...


EPOCH_VARIABLE = "SOCIALBOT_EPOCH"
"""Epoch in ns that a process passes to its child processes, so that all their clocks agree."""


class WallClock:
    """Time of day that advances steadily from one reading of the system clock.

    Adjustments of the system clock, by NTP for example, affect neither timers nor the age of beliefs. Time in suspend
    counts.
    """

    def __init__(self) -> None:
        began = time.time_ns() - steady_ns()
        self._epoch = int(os.environ.setdefault(EPOCH_VARIABLE, str(began)))

    def now(self) -> int:
        """Return nanoseconds since 1970."""
        return self._epoch + steady_ns()

    @property
    def behind_s(self) -> float:
        """Offset (s) of the system clock from this clock."""
        return (time.time_ns() - self.now()) / SECOND


class SteadyStamps:
    """Stamps of messages in order, which go on with the time of their arrival where the clock of the sender is set.

    A stamp before the last one, or ahead of the time since then by more than 5 s, is that of a clock that was set.
    Messages that waited on their way, and after them others that did not, are ahead by less.

    Args:
        late_s: How far a stamp may go back, of a message that others have overtaken.
    """

    _SET_NS = 5 * SECOND

    def __init__(self, late_s: float = 0.0) -> None:
        self._late = nanoseconds(late_s)
        self._stamp: int | None = None
        self._now = self._offset = 0

    def at(self, stamp: int, now: int) -> int:
        """The time (ns) of a message with ``stamp`` that arrives ``now``, by the clock that the sender had first."""
        if self._stamp is not None:
            step, elapsed = stamp - self._stamp, max(now - self._now, 0)
            if -self._late <= step < 0:
                return stamp + self._offset
            if step < 0 or step - elapsed > self._SET_NS:
                self._offset += elapsed - step
        self._stamp, self._now = stamp, now
        return stamp + self._offset


class ForwardClock:
    """Monotonic view of a clock that may jump back, such as that of a bag played in a loop."""

    def __init__(self, now: Callable[[], int]) -> None:
        self._source = now
        self._ahead = 0
        self._last = 0
        self._looking = threading.Lock()

    def now(self) -> int:
        with self._looking:
            told = self._source()
            self._ahead = max(self._ahead, self._last - told)
            self._last = told + self._ahead
            return self._last


class ManualClock:
    """Clock with manual control for simulated time, bags and tests."""

    def __init__(self, now: int = 0) -> None:
        self._now = now

    def now(self) -> int:
        return self._now

    def set(self, now: int) -> None:
        """Set the time to ``now`` (ns). Raises ValueError for a time in the past."""
        if now < self._now:
            raise ValueError(f"time cannot go back from {self._now} to {now} ns")
        self._now = now

    def advance(self, seconds: float) -> None:
        """Advance the time by ``seconds``."""
        self.set(self._now + nanoseconds(seconds))


def nanoseconds(seconds: float) -> int:
    """Convert seconds to integer nanoseconds, rounded. Raises TypeError for any non-number."""
    if not isinstance(seconds, (int, float)):
        raise TypeError(f"expected seconds as a number, got {seconds!r}")
    return round(seconds * SECOND)
