"""Simulated worlds: event queue, and faults that a parameter lists."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from socialbot.core.clock import nanoseconds
from socialbot.core.errors import ParameterError

LONGEST_S = 1e6


class SimulatedWorld:
    """World with a clock of its own: `advance` runs the events that are due. Times are ns."""

    def __init__(self, start: int = 0) -> None:
        self.now = start
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._sequence = itertools.count()

    def advance(self, time: int) -> None:
        """Run all events until ``time``. A time in the past has no effect."""
        while self._events and self._events[0][0] <= time:
            due, _, happen = heapq.heappop(self._events)
            self.now = max(self.now, due)
            happen()
        self.now = max(self.now, time)

    @property
    def next_event(self) -> int | None:
        """Time of the next event, unless a command adds an earlier one."""
        return self._events[0][0] if self._events else None

    def at(self, time: int, happen: Callable[[], None]) -> None:
        """Let an event happen at ``time``."""
        heapq.heappush(self._events, (time, next(self._sequence), happen))

    def after(self, seconds: float, happen: Callable[[], None]) -> None:
        """Let an event happen after some seconds."""
        self.at(self.now + nanoseconds(seconds), happen)


@dataclass(frozen=True, slots=True)
class WorldFault:
    """Fault of a world at ``time_s`` after its start. Only lasting kinds of faults have a duration."""

    time_s: float
    kind: str
    target: str = ""
    duration_s: float | None = None

    def __str__(self) -> str:
        times = [f"{seconds!r}".removesuffix(".0") for seconds in (self.time_s, self.duration_s) if seconds is not None]
        return " ".join(filter(None, (times[0], self.kind, self.target, *times[1:])))


def parse_world_faults(
    text: str, targets: Mapping[str, Collection[str] | None], lasting: Collection[str], examples: str
) -> tuple[WorldFault, ...]:
    """Parse faults that are separated by semicolons.

    Args:
        text: The faults.
        targets: Possible targets of each kind; None for a kind without a target.
        lasting: Kinds of faults with a duration.
        examples: Faults for error messages.

    Raises:
        ParameterError: A fault is invalid.
    """
    remedy = f"write faults as: {examples}"

    def parse(words: list[str]) -> WorldFault:
        time, kind, *rest = words if len(words) > 1 else (*words, "")
        lasts, possible = kind in lasting, targets.get(kind)
        target = rest[0] if possible is not None and rest else ""
        unknown = kind not in targets or (possible is not None and target not in possible)
        if unknown or len(rest) != (possible is not None) + lasts:
            raise ParameterError(f"unknown fault {' '.join(words)!r}", where="faults", remedy=remedy)
        try:
            return WorldFault(_seconds(time), kind, target, _seconds(rest[-1]) if lasts else None)
        except ValueError as error:
            raise ParameterError(f"invalid time: {error}", where=f"fault {' '.join(words)!r}", remedy=remedy) from error

    return tuple(parse(part.split()) for part in text.split(";") if part.strip())


def _seconds(word: str) -> float:
    seconds = float(word)
    if not 0.0 <= seconds <= LONGEST_S:
        raise ValueError(f"{word} is not between 0 and {LONGEST_S:.0f} s")
    return seconds
