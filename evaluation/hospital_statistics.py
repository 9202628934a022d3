"""The statistics of the hospital's experiments: intervals of 95 % throughout, of shares, counts, means and slopes."""

from __future__ import annotations

import math
import random
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

COVERAGE = 0.95
DRAWS = 2000
_Z = statistics.NormalDist().inv_cdf((1.0 + COVERAGE) / 2.0)


class Interval(NamedTuple):
    """From ``low`` to ``high``."""

    low: float
    high: float

    def __contains__(self, value: object) -> bool:
        return isinstance(value, (int, float)) and self.low <= value <= self.high


def wilson(count: int, of: int) -> Interval:
    """Wilson's interval of a share of which ``count`` of so many are known. Raises ValueError for none."""
    if not 0 <= count <= of or of < 1:
        raise ValueError(f"no share: {count} of {of}")
    share, z2 = count / of, _Z * _Z
    middle = (share + z2 / (2 * of)) / (1 + z2 / of)
    half = _Z / (1 + z2 / of) * math.sqrt(share * (1 - share) / of + z2 / (4 * of * of))
    low = 0.0 if count == 0 else middle - half
    return Interval(low, 1.0 if count == of else middle + half)


def binomial(share: float, of: int) -> Interval:
    """The counts to be expected when each of so many is one with this chance: outside, on either side, is 2.5 %."""
    outside, below, counts = (1.0 - COVERAGE) / 2.0, 0.0, []
    for count in range(of + 1):
        upto = below + math.comb(of, count) * share**count * (1.0 - share) ** (of - count)
        if upto > outside and below < 1.0 - outside:
            counts.append(count)
        below = upto
    return Interval(counts[0], counts[-1])


def t_quantile(freedom: int) -> float:
    """Student's t that 95 % lie within, by an expansion that is right to 1 % from 3 degrees of ``freedom`` on.

    Raises ValueError for less.
    """
    if freedom < 3:
        raise ValueError(f"too few degrees of freedom: {freedom}")
    z, n = _Z, freedom
    return (
        z
        + (z**3 + z) / (4 * n)
        + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * n**2)
        + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * n**3)
    )


def mean_interval(values: Sequence[float]) -> Interval | None:
    """The interval of the mean; None with less than four values."""
    if len(values) < 4:
        return None
    mean = statistics.fmean(values)
    half = t_quantile(len(values) - 1) * statistics.stdev(values) / math.sqrt(len(values))
    return Interval(mean - half, mean + half)


@dataclass(frozen=True)
class Line:
    """A straight line by least squares: ``start`` where x is 0, and its ``slope`` with the interval of that."""

    start: float
    slope: float
    interval: Interval


def fit(points: Sequence[tuple[float, float]]) -> Line | None:
    """The line through ``points`` (x, y); None with less than five of them, or where all have the same x."""
    xs = [x for x, _ in points]
    if len(points) < 5 or len(set(xs)) < 2:
        return None
    slope, start = statistics.linear_regression(xs, [y for _, y in points])
    freedom = len(points) - 2
    rest = sum((y - start - slope * x) ** 2 for x, y in points)
    spread = sum((x - statistics.fmean(xs)) ** 2 for x in xs)
    half = t_quantile(freedom) * math.sqrt(rest / freedom / spread)
    return Line(start, slope, Interval(slope - half, slope + half))


def weighted(without: Sequence[float], with_: Sequence[float], share: float) -> float:
    """The mean where a ``share`` has a problem. Raises StatisticsError where one of the two is empty."""
    return (1.0 - share) * statistics.fmean(without) + share * statistics.fmean(with_)


def growth(without: Sequence[float], with_: Sequence[float], first: float, last: float) -> float:
    """By how much, in %, the mean grows from where a share ``first`` has a problem to where ``last`` has one."""
    return 100.0 * (weighted(without, with_, last) / weighted(without, with_, first) - 1.0)


def growth_interval(without: Sequence[float], with_: Sequence[float], first: float, last: float) -> Interval | None:
    """The interval of `growth` by a bootstrap, the same for the same values; None with less than four of either."""
    if min(len(without), len(with_)) < 4:
        return None
    chance = random.Random("growth")
    found = sorted(
        growth(chance.choices(without, k=len(without)), chance.choices(with_, k=len(with_)), first, last)
        for _ in range(DRAWS)
    )
    outside = (1.0 - COVERAGE) / 2.0
    return Interval(found[int(outside * DRAWS)], found[int((1.0 - outside) * DRAWS) - 1])
