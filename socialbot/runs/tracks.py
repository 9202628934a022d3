"""Piecewise linear and constant values over the time of a run, for animation."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, TypeVar

NEAR = (0.8, 0.8, 0.05)
"""Tolerance (pixels, pixels, m) for points on straight lines."""

T = TypeVar("T")

Moment = tuple[float, ...]


def add(track: list[tuple[int, T]], stamp: int, what: T) -> None:
    """Append a value from ``stamp`` (ns) on, unless it is in the past."""
    if not track or stamp > track[-1][0]:
        track.append((stamp, what))


def forget(track: list[tuple[int, T]], stamp: int) -> None:
    """Drop the values before ``stamp`` (ns), except for the current one."""
    del track[: max(bisect_right(track, stamp, key=lambda moment: moment[0]) - 1, 0)]


def latest(track: Sequence[tuple[int, Any]], stamp: int) -> Any:
    """Return the value at ``stamp`` (ns), or the first one."""
    number = bisect_right(track, stamp, key=lambda moment: moment[0])
    return track[max(number - 1, 0)][1]


def thinned(track: Sequence[Moment]) -> list[Moment]:
    """Drop the moments on a straight line between others."""
    kept: list[Moment] = []
    slopes: list[tuple[float, float]] = []
    for last, moment in pairwise(track):
        if not kept or not _lies_within(slopes, kept[-1], moment):
            kept.append(last)
            slopes = [(-math.inf, math.inf)] * (len(last) - 1)
        slopes = _narrowed(slopes, kept[-1], moment)
    return [tuple(round(value, 2) for value in moment) for moment in (*kept, *track[-1:])]


def _lies_within(slopes: Sequence[tuple[float, float]], first: Moment, moment: Moment) -> bool:
    duration = moment[0] - first[0]
    changes = zip(slopes, first[1:], moment[1:], strict=True)
    return all(low <= (there - here) / duration <= high for (low, high), here, there in changes)


def _narrowed(slopes: Sequence[tuple[float, float]], first: Moment, moment: Moment) -> list[tuple[float, float]]:
    duration = moment[0] - first[0]
    return [
        (max(low, (there - near - here) / duration), min(high, (there + near - here) / duration))
        for (low, high), here, there, near in zip(slopes, first[1:], moment[1:], NEAR, strict=False)
    ]
