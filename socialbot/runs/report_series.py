"""Figures that go with a number, such as the rate of problems or the count of robots, as small charts (SVG)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from html import escape
from typing import TypeGuard

WIDTH, HEIGHT, LEFT, TOP, RIGHT, BOTTOM = 250.0, 120.0, 48.0, 24.0, 14.0, 24.0
FEWEST = 3
"""So many points make a line, at least."""

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def series_charts(rows: Mapping[str, Mapping[str, object]]) -> str:
    """A chart for each column of numbers of a table whose rows are called by ascending numbers; empty for others."""
    xs = [_number(name) for name in rows]
    along = [x for x in xs if x is not None]
    if len(along) < FEWEST or len(along) != len(xs) or sorted(set(along)) != along:
        return ""
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))
    charts = []
    for column in columns:
        values = [row.get(column) for row in rows.values()]
        points = [(x, float(y)) for x, y in zip(along, values, strict=True) if _is_number(y)]
        if len(points) >= FEWEST and len({y for _, y in points}) > 1:
            charts.append(_chart(column, points))
    return f'<div class="series">{"".join(charts)}</div>' if charts else ""


def _chart(title: str, points: Sequence[tuple[float, float]]) -> str:
    (left, right), high = (points[0][0], points[-1][0]), max(y for _, y in points)
    low = min(0.0, *(y for _, y in points))
    spots = [
        (LEFT + (x - left) / (right - left) * WIDTH, TOP + (1 - (y - low) / (high - low)) * HEIGHT) for x, y in points
    ]
    size = f'viewBox="0 0 {LEFT + WIDTH + RIGHT:.0f} {TOP + HEIGHT + BOTTOM:.0f}"'
    floor = TOP + HEIGHT
    dots = "".join(
        f'<circle cx="{at:.1f}" cy="{up:.1f}" r="3"><title>{x:g}: {y:g}</title></circle>'
        for (at, up), (x, y) in zip(spots, points, strict=True)
    )
    return (
        f'<svg role="img" {size}><title>{escape(title)}</title><text class="head" x="0" y="13">{escape(title)}</text>'
        f'<path class="axes" d="M{LEFT} {TOP}V{floor}H{LEFT + WIDTH}"/>'
        f'<text x="{LEFT - 5}" y="{TOP + 4}" text-anchor="end">{high:.4g}</text>'
        f'<text x="{LEFT - 5}" y="{floor + 4}" text-anchor="end">{low:.4g}</text>'
        f'<text x="{LEFT}" y="{floor + 17}">{left:g}</text>'
        f'<text x="{LEFT + WIDTH}" y="{floor + 17}" text-anchor="end">{right:g}</text>'
        f'<path class="line" d="M{"L".join(f"{at:.1f} {up:.1f}" for at, up in spots)}"/>{dots}</svg>'
    )


def _number(name: str) -> float | None:
    """The number by which a row is called: 12 in ``12 rooms``."""
    found = _NUMBER.match(name)
    return None if found is None else float(found[0])


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
