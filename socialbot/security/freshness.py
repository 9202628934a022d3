"""Whether a message of a known sender is new: neither late, nor from the future, nor heard before.

A stream is what one publisher has said since it began. Its messages are numbered; whatever has no higher number than
the last one heard is a replay, or the same sealed anew. So per stream one number is remembered, not all ids. Times tell
only how old they are: a clock may be set back.
"""

from __future__ import annotations

import enum
import time
from collections.abc import Callable
from dataclasses import dataclass

from socialbot.clock import SECOND

MOST_STREAMS = 256
"""So many streams are remembered before those are forgotten whose messages would be late anyway."""


class Verdict(enum.Enum):
    """What `Freshness` thinks of a message."""

    NEW = "new"
    RENEWED = "renewed"
    """Said before and sealed anew, for who joins late."""
    LATE = "late"
    EARLY = "early"
    """From the future: the clocks differ."""
    REPLAYED = "replayed"


@dataclass(frozen=True, slots=True)
class _Last:
    number: int
    time: int


class Freshness:
    """Judges the messages that come to one receiver. ``window_s``: how far (s) a message's time may be from ours.

    Nothing is believed that was sealed before the receiver began, because an earlier one, which has crashed since, may
    have heard it already; unless it ``joins_late`` to hear the last state. Times are the computer's, as simulated time
    may stand still. ``wall`` (ns) may be set right at any time; ``steady`` (ns) counts how long the receiver is there.
    """

    def __init__(
        self,
        window_s: float,
        *,
        joins_late: bool = False,
        wall: Callable[[], int] = time.time_ns,
        steady: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._window = round(window_s * SECOND)
        self._joins_late = joins_late
        self.now = wall
        self._steady = steady
        self._begun = steady()
        self._streams: dict[tuple[str, str], _Last] = {}

    @property
    def remembered(self) -> int:
        """How many streams it remembers."""
        return len(self._streams)

    def judge(self, sender: str, stream: str, number: int, time: int) -> Verdict:
        """What to think of a message, whose signature is right, that was sealed at ``time`` (ns); remembers it."""
        now = self.now()
        last = self._streams.get((sender, stream))
        if last is not None and (number < last.number or (number == last.number and _was_heard(time, last.time, now))):
            return Verdict.REPLAYED
        if time - now > self._window:
            return Verdict.EARLY
        if now - time > self._patience():
            return Verdict.LATE
        self._remember((sender, stream), _Last(number, time), now)
        return Verdict.RENEWED if last is not None and number == last.number else Verdict.NEW

    def _patience(self) -> int:
        return self._window if self._joins_late else min(self._window, self._steady() - self._begun)

    def _remember(self, stream: tuple[str, str], last: _Last, now: int) -> None:
        if stream not in self._streams and len(self._streams) >= MOST_STREAMS:
            self._streams = {key: one for key, one in self._streams.items() if now - one.time <= self._window}
        self._streams[stream] = last


def _was_heard(time: int, last: int, now: int) -> bool:
    """Whether the last message, sealed anew at ``time``, was heard then or later: at ``last``, unless a clock was set.

    After that ``last`` lies in the future.
    """
    return time == last or time < last <= now
