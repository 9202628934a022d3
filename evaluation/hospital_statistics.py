"""Intervals of 95 % for the hospital experiments: of shares, counts, means, slopes and growth."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy  # its parts are imported when they are used: `scipy.stats` takes a second

COVERAGE = 0.95
DRAWS = 2000
_SEED = 20211108


class Interval(NamedTuple):
    """From ``low`` to ``high``."""

    low: float
    high: float

    def __contains__(self, value: object) -> bool:
        return isinstance(value, (int, float)) and self.low <= value <= self.high


def wilson(count: int, of: int) -> Interval:
    """Wilson interval of the share ``count`` / ``of``.

    Raises:
        ValueError: ``count`` is not from 0 to ``of``, or ``of`` is 0.
    """
    if not 0 <= count <= of or of < 1:
        raise ValueError(f"no share: {count} of {of}")
    found = scipy.stats.binomtest(count, of).proportion_ci(COVERAGE, method="wilson")
    return Interval(float(found.low), float(found.high))


def binomial(share: float, of: int) -> Interval:
    """Interval of the expected counts in ``of`` trials with probability ``share``."""
    low, high = scipy.stats.binom.interval(COVERAGE, of, share)
    return Interval(float(low), float(high))


def t_quantile(freedom: int) -> float:
    """Two-sided quantile of Student's t for ``freedom`` degrees of freedom."""
    return float(scipy.stats.t.ppf((1.0 + COVERAGE) / 2.0, freedom))


def mean_interval(values: Sequence[float]) -> Interval | None:
    """Interval of the mean; None for fewer than four values."""
    if len(values) < 4:
        return None
    mean, half = statistics.fmean(values), t_quantile(len(values) - 1) * float(scipy.stats.sem(values))
    return Interval(mean - half, mean + half)


@dataclass(frozen=True)
class Line:
    """Least-squares line: ``start`` at x = 0, and ``slope`` with its ``interval``."""

    start: float
    slope: float
    interval: Interval


def fit(points: Sequence[tuple[float, float]]) -> Line | None:
    """The line through ``points`` (x, y); None for fewer than five, or if all have the same x."""
    xs, ys = zip(*points, strict=True) if points else ((), ())
    if len(points) < 5 or len(set(xs)) < 2:
        return None
    found: Any = scipy.stats.linregress(xs, ys)
    half = t_quantile(len(points) - 2) * found.stderr
    return Line(
        float(found.intercept), float(found.slope), Interval(float(found.slope - half), float(found.slope + half))
    )


def weighted(without: Sequence[float], with_: Sequence[float], share: float) -> float:
    """The mean duration if a ``share`` of the missions has a problem.

    Raises:
        StatisticsError: One of the samples is empty.
    """
    return (1.0 - share) * statistics.fmean(without) + share * statistics.fmean(with_)


def growth(without: Sequence[float], with_: Sequence[float], first: float, last: float) -> float:
    """Growth of the mean in %, from a share ``first`` of missions with a problem to ``last``."""
    return 100.0 * (weighted(without, with_, last) / weighted(without, with_, first) - 1.0)


def growth_interval(without: Sequence[float], with_: Sequence[float], first: float, last: float) -> Interval | None:
    """Bootstrap interval of `growth` with a fixed seed; None for fewer than four values of either sample."""
    if min(len(without), len(with_)) < 4:
        return None
    found = scipy.stats.bootstrap(
        (np.array(without), np.array(with_)),
        lambda one, other: growth(one.tolist(), other.tolist(), first, last),
        n_resamples=DRAWS,
        confidence_level=COVERAGE,
        method="percentile",
        vectorized=False,
        rng=np.random.default_rng(_SEED),
    ).confidence_interval
    return Interval(float(found.low), float(found.high))
