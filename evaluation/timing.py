"""Rates of things that take turns: the least processor time of several passes, so that others do not count."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

PASSES = 7
"""So many passes are made at least."""

STABLE = 0.01
"""The measurement goes on until the last passes have improved nothing by more than this share."""

SECOND = 1_000_000_000

Pass = Callable[[], int]
"""Does the work once; returns the processor time (ns) that it took."""


@dataclass
class Passes:
    """How long to measure: ``budget_s`` ends it after `PASSES` passes, even when it is not stable by then."""

    least: int = PASSES
    budget_s: float = 20.0


@dataclass
class Timing:
    """The least processor time (ns) of each contender, for ``units`` of work."""

    units: int
    least: dict[str, int] = field(default_factory=dict)
    passes: int = 0

    def rate(self, name: str) -> float:
        """Units a second."""
        return self.units * SECOND / max(1, self.least[name])

    def ratio(self, name: str, of: str) -> float:
        """The rate of one as a share of that of another."""
        return self.least[of] / max(1, self.least[name])

    def cost_ns(self, name: str) -> float:
        """Processor time for a unit (ns)."""
        return self.least[name] / self.units


def take_turns(contenders: Mapping[str, Pass], units: int, passes: Passes) -> Timing:
    """Measures the contenders by turns, until the least times are stable or the budget is used up."""
    timing, begun, since_better = Timing(units), time.monotonic(), 0
    gc.collect()
    gc.freeze()
    try:
        while timing.passes < passes.least or (since_better < 3 and time.monotonic() - begun < passes.budget_s):
            since_better += 1
            for name, once in contenders.items():
                gc.collect()
                took = once()
                known = timing.least.get(name)
                if known is None or took < known * (1 - STABLE):
                    since_better = 0
                timing.least[name] = took if known is None else min(known, took)
            timing.passes += 1
    finally:
        gc.unfreeze()
    return timing


def timed(work: Callable[[], object]) -> int:
    """The processor time (ns) of one call."""
    begun = time.process_time_ns()
    work()
    return time.process_time_ns() - begun
