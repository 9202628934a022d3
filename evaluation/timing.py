"""Rates of alternating contenders: the least processor time of several passes, to exclude other load."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

PASSES = 7
"""Minimum number of passes."""

STABLE = 0.01
"""Relative improvement below which the measurement ends."""

SECOND = 1_000_000_000

Pass = Callable[[], int]
"""Function that works once and returns its processor time (ns)."""


@dataclass
class Passes:
    """Measurement length: ``budget_s`` ends it after `PASSES` passes, even if unstable."""

    least: int = PASSES
    budget_s: float = 20.0


@dataclass
class Timing:
    """Least processor time (ns) of each contender for ``units`` of work."""

    units: int
    least: dict[str, int] = field(default_factory=dict)
    passes: int = 0

    def rate(self, name: str) -> float:
        return self.units * SECOND / max(1, self.least[name])

    def ratio(self, name: str, of: str) -> float:
        """Return the rate of a contender relative to another."""
        return self.least[of] / max(1, self.least[name])

    def cost_ns(self, name: str) -> float:
        return self.least[name] / self.units


def take_turns(contenders: Mapping[str, Pass], units: int, passes: Passes) -> Timing:
    """Run the contenders by turns, until the least times are stable or the budget is used up."""
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
    """Return the processor time (ns) of one call."""
    begun = time.process_time_ns()
    work()
    return time.process_time_ns() - begun
