"""Charts as SVG: curves of precision and recall, bars, and what happened when.

Plain text, so that the page needs no drawing library, no script and no network, and stays small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from socialbot.vision.metrics.scores import PrecisionRecallCurve

__all__ = ["COLOURS", "Line", "Mark", "Point", "Track", "curves_chart", "sheet", "timeline"]

COLOURS = ("#0b7fb0", "#c06a10", "#4f8a2a", "#a558a0", "#8a7015")
"""Those of the detectors, in their order; to be told from white as from black."""
SHEET_STYLE = (
    "text{font:11px sans-serif;fill:#4a5560}.head{font-size:13px;font-weight:600;fill:#1b1f23}.grid{stroke:#e3e3e3}"
    ".axes{fill:none;stroke:#999}.point{stroke:#fff}.paper{fill:#fff;stroke:#444}"
)
"""What is the page's to say of charts, for those that stand in a file of their own."""

Point = tuple[float, float]
"""Recall and precision."""

_SIZE, _LEFT, _TOP, _RIGHT, _BOTTOM = 230, 38, 26, 10, 34


@dataclass(frozen=True)
class Line:
    """A detector in a chart: its curve, and the ``point`` at which the pipeline works."""

    name: str
    colour: str
    curve: PrecisionRecallCurve | None
    point: Point | None


def curves_chart(title: str, lines: Sequence[Line], paper: Point | None) -> str:
    """Precision over recall, both from 0 to 1; the ``paper``'s point is a diamond."""
    parts = [_axes(title)]
    parts += [
        f'<path d="{_steps(line.curve)}" fill="none" stroke="{line.colour}" stroke-width="1.8"/>'
        for line in lines
        if line.curve is not None and len(line.curve.recall)
    ]
    for line in lines:
        if line.point is not None:
            x, y = _at(*line.point)
            label = f"{line.name}: recall {line.point[0]:.3f}, precision {line.point[1]:.3f}"
            parts.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="{line.colour}" class="point" stroke-width="1.5">'
                f"<title>{escape(label)}</title></circle>"
            )
    if paper is not None:
        x, y = _at(*paper)
        parts.append(
            f'<path d="M{x:.1f} {y - 6:.1f}l6 6l-6 6l-6-6z" class="paper" stroke-width="1.8">'
            f"<title>the paper: recall {paper[0]:.3f}, precision {paper[1]:.3f}</title></path>"
        )
    width, height = _LEFT + _SIZE + _RIGHT, _TOP + _SIZE + _BOTTOM
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    label = f"Precision over recall: {title}"
    return f'<svg class="chart" {size} role="img" aria-label="{escape(label)}">{"".join(parts)}</svg>'


def sheet(charts: Sequence[str], colours: Sequence[tuple[str, str]], columns: int) -> str:
    """``charts`` of `curves_chart` in rows of so many ``columns`` as a file of its own, with a key of ``colours``."""
    width, height, top = _LEFT + _SIZE + _RIGHT + 8, _TOP + _SIZE + _BOTTOM + 8, 26
    rows = -(-len(charts) // columns)
    parts = [f"<style>{SHEET_STYLE}</style>", '<rect width="100%" height="100%" fill="#fff"/>']
    for number, (name, colour) in enumerate(colours):
        x = _LEFT + 130 * number
        parts.append(f'<circle cx="{x + 5}" cy="13" r="5" fill="{colour}"/>')
        parts.append(f'<text x="{x + 16}" y="17">{escape(name)}</text>')
    for number, chart in enumerate(charts):
        x, y = number % columns * width, top + number // columns * height
        parts.append(chart.replace("<svg ", f'<svg x="{x}" y="{y}" ', 1))
    size = f'width="{columns * width}" height="{top + rows * height}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{"".join(parts)}</svg>\n'


def _at(recall: float, precision: float) -> Point:
    return _LEFT + recall * _SIZE, _TOP + (1 - precision) * _SIZE


def _axes(title: str) -> str:
    parts = [f'<text x="{_LEFT}" y="16" class="head">{escape(title)}</text>']
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        x, y = _at(tick, tick)
        parts.append(f'<path d="M{x:.1f} {_TOP}V{_TOP + _SIZE}M{_LEFT} {y:.1f}H{_LEFT + _SIZE}" class="grid"/>')
        parts.append(f'<text x="{x:.1f}" y="{_TOP + _SIZE + 14}" text-anchor="middle">{tick:g}</text>')
        parts.append(f'<text x="{_LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>')
    parts.append(f'<rect x="{_LEFT}" y="{_TOP}" width="{_SIZE}" height="{_SIZE}" class="axes"/>')
    middle = _TOP + _SIZE / 2
    parts.append(f'<text x="{_LEFT + _SIZE / 2}" y="{_TOP + _SIZE + 29}" text-anchor="middle">recall</text>')
    parts.append(f'<text transform="translate(10 {middle}) rotate(-90)" text-anchor="middle">precision</text>')
    return "".join(parts)


def _steps(curve: PrecisionRecallCurve) -> str:
    """The points of the curve, without those on a straight line between others."""
    points = [
        _at(float(recall), float(precision)) for recall, precision in zip(curve.recall, curve.precision, strict=True)
    ]
    kept = [points[0]]
    for point in points[1:]:
        if np.hypot(point[0] - kept[-1][0], point[1] - kept[-1][1]) >= 0.7:
            kept.append(point)
    if kept[-1] != points[-1]:
        kept.append(points[-1])
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in kept)


@dataclass(frozen=True)
class Mark:
    """Something that happened at ``time`` (s): a letter in a circle, and what a pointer is told."""

    time: float
    letter: str
    colour: str
    told: str


@dataclass(frozen=True)
class Track:
    """A row of a timeline: bars from and to a time (s), and marks."""

    name: str
    bars: tuple[tuple[float, float, str], ...] = ()
    marks: tuple[Mark, ...] = ()


def timeline(seconds: float, tracks: Sequence[Track]) -> str:
    """What happened when, a row for each track, from 0 to ``seconds``."""
    left, width, row = 110, 800, 24
    height = row * len(tracks) + 26
    scale = (width - 20) / max(seconds, 1e-9)
    parts = []
    step = next((step for step in (1, 2, 5, 10, 20, 60, 120, 300, 600) if seconds / step <= 12), 3600)
    for tick in range(0, int(seconds) + 1, step):
        x = left + tick * scale
        parts.append(f'<path d="M{x:.1f} 0V{height - 20}" class="grid"/>')
        parts.append(f'<text x="{x:.1f}" y="{height - 6}" text-anchor="middle">{tick} s</text>')
    for number, track in enumerate(tracks):
        middle = row * number + row / 2
        parts.append(f'<text x="{left - 8}" y="{middle + 4:.1f}" text-anchor="end">{escape(track.name)}</text>')
        for begin, end, told in track.bars:
            at, long = left + begin * scale, max((end - begin) * scale, 2)
            parts.append(
                f'<rect x="{at:.1f}" y="{middle - 5:.1f}" width="{long:.1f}" height="10" rx="2" class="there">'
                f"<title>{escape(told)}</title></rect>"
            )
        for mark in track.marks:
            x = left + mark.time * scale
            parts.append(
                f"<g><title>{escape(mark.told)}</title>"
                f'<circle cx="{x:.1f}" cy="{middle:.1f}" r="8" fill="{mark.colour}"/><text x="{x:.1f}" '
                f'y="{middle + 4:.1f}" text-anchor="middle" class="letter">{escape(mark.letter)}</text></g>'
            )
    size = f'viewBox="0 0 {left + width} {height}"'
    return f'<svg class="timeline" {size} role="img" aria-label="What happened when">{"".join(parts)}</svg>'
