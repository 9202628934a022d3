"""Curves over time (SVG): lines from moment to moment, without the points that nobody could tell apart."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

from socialbot.runs.tracks import thinned

Place = tuple[float, float]
"""x and y, pixels."""


@dataclass(frozen=True)
class Curve:
    """A line by time: moments (s, ascending) with the value then, or None where there is none.

    ``kind`` gives its colour: there, found, false, precision, recall, f1, first, second.
    """

    name: str
    kind: str
    points: Sequence[tuple[float, float | None]]


@dataclass(frozen=True)
class Plot:
    """Curves with one scale, from 0 to ``most``."""

    name: str
    curves: Sequence[Curve]
    most: float


def path(points: Iterable[tuple[float, float | None]], place: Callable[[float, float], Place]) -> str:
    """The line through ``points`` as ``d`` of a path, broken where there is no value; ``place`` says where a point is.

    Points must lie one to the right of the other.
    """
    parts = []
    for is_there, run in groupby(points, key=lambda point: point[1] is not None):
        if is_there:
            places = thinned([place(at, value) for at, value in run if value is not None])
            ways = [f"{x:.1f} {y:.1f}" for x, y in places]
            parts.append(f"M{ways[0]}{''.join(f'L{way}' for way in ways[1:]) or 'h1'}")
    return "".join(parts)
