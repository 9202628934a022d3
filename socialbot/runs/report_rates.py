"""Curves of precision and recall over the distance (SVG)."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from socialbot.runs.report_page import wide

LEFT, TOP, WIDTH, HEIGHT, BOTTOM, RIGHT = 40.0, 14.0, 420.0, 170.0, 34.0, 96.0
SHOWN = ("precision", "recall", "f1")


def rates_chart(bands: Mapping[str, Mapping[str, Any]]) -> str:
    """A line for each of `SHOWN` over bands of distance such as ``2-10 m``; empty with fewer than two of them."""
    told = {name: band for name, band in bands.items() if band["tp"] + band["fn"] + band["fp"]}
    if len(told) < 2:
        return ""
    xs = {name: LEFT + WIDTH * (n + 0.5) / len(told) for n, name in enumerate(told)}
    size = f'viewBox="0 0 {LEFT + WIDTH + RIGHT:.0f} {TOP + HEIGHT + BOTTOM:.0f}"'
    parts = [f'<svg class="rates" role="img" {size}><title>Precision, recall and F1 over the distance</title>']
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        y = _y(tick)
        parts.append(f'<line class="tick" x1="{LEFT}" x2="{LEFT + WIDTH}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>')
    for name, x in xs.items():
        parts.append(f'<text x="{x:.1f}" y="{TOP + HEIGHT + 18}" text-anchor="middle">{escape(name)}</text>')
    ends = []
    for number, rate in enumerate(SHOWN):
        points = [(xs[name], _y(band[rate]), band[rate]) for name, band in told.items() if band[rate] is not None]
        line = "L".join(f"{x:.1f} {y:.1f}" for x, y, _ in points)
        parts.append(f'<g class="r{number}"><path d="M{line}"/>' if points else "<g>")
        parts += [
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5"><title>{rate} {value:.3f}</title></circle>'
            for x, y, value in points
        ]
        parts.append("</g>")
        if points:
            ends.append((points[-1][1], points[-1][0], number, "F1" if rate == "f1" else rate))
    parts += _names(ends)
    return wide("".join([*parts, "</svg>"]))


def _names(ends: list[tuple[float, float, int, str]]) -> list[str]:
    """The names of lines beside their ends, none upon another."""
    parts, free = [], 0.0
    for y, x, number, name in sorted(ends):
        at = max(y + 4, free)
        free = at + 13
        parts.append(f'<g class="r{number}"><text x="{x + 9:.1f}" y="{at:.1f}">{name}</text></g>')
    return parts


def _y(rate: float) -> float:
    return TOP + (1 - rate) * HEIGHT
