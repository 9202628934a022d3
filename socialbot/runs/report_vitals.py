"""How nodes fared in the course of a run: small charts (SVG) of rates, latency, processor share and memory."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape

from socialbot.graph.status import SILENT_S
from socialbot.runs.record import NodeTold
from socialbot.runs.report_curves import Curve, path

Told = Mapping[str, Sequence[tuple[float, NodeTold]]]
"""What each node told of itself, and when (s), in order."""

WIDTH, HEIGHT = 220.0, 46.0
FEWEST = 3
"""So many times a node must have told of itself before there is a curve."""


@dataclass(frozen=True)
class Measure:
    """What is measured, in which unit, and the values that nodes tell of it, by what they are called here.

    One that is ``of_process`` is the same for all nodes of a process, and its charts have the same scale.
    """

    title: str
    unit: str
    keys: Mapping[str, str]
    of_process: bool = False


MEASURES = (
    Measure("Messages a second", "Hz", {"call_hz": "taken", "publish_hz": "published"}),
    Measure("Latency", "ms", {"age_p99_ms": "99 % of messages are no older when they are dealt with",
                              "call_p99_ms": "99 % of calls take no longer"}),
    Measure("Processor, of one core", "%", {"cpu_percent": ""}, of_process=True),
    Measure("Memory", "MB", {"rss_mb": ""}, of_process=True),
)  # fmt: skip
KINDS = ("first", "second")


@dataclass
class _Chart:
    """One small chart: the curves of ``names``, and when what they are called after began anew (s)."""

    names: list[str]
    curves: list[Curve]
    restarts: list[float] = field(default_factory=list)

    @property
    def peak(self) -> float:
        return max((value for curve in self.curves for _, value in curve.points if value is not None), default=0.0)


def vitals_charts(told: Told) -> str:
    """Charts for each of `MEASURES`, one for each node or process; empty where nodes have told too little."""
    told = {name: course for name, course in told.items() if len(course) >= FEWEST}
    if not told:
        return ""
    begin_s = min(course[0][0] for course in told.values())
    end_s = max(course[-1][0] for course in told.values())
    parts = []
    for measure in MEASURES:
        charts = [chart for chart in _charts(measure, told) if chart.peak]
        if charts:
            most = max(chart.peak for chart in charts)
            drawn = "".join(
                _drawn(chart, measure, (begin_s, end_s), most if measure.of_process else chart.peak) for chart in charts
            )
            parts.append(f'<h3>{measure.title}</h3>{_key(measure)}<div class="vitals">{drawn}</div>')
    return "".join(parts)


def _charts(measure: Measure, told: Told) -> Iterator[_Chart]:
    groups: dict[object, list[str]] = {}
    for name, course in told.items():
        last = course[-1][1].values
        is_shared = measure.of_process and "pid" in last
        groups.setdefault((last.get("machine"), last["pid"]) if is_shared else name, []).append(name)
    for names in groups.values():
        course = told[names[0]]
        curves = [
            Curve(called, kind, list(_points(course, key)))
            for kind, (key, called) in zip(KINDS, measure.keys.items(), strict=False)
        ]
        yield _Chart(names, curves, list(_restarts(course)))


def _points(course: Sequence[tuple[float, NodeTold]], key: str) -> Iterator[tuple[float, float | None]]:
    """The values by time, with none where the node was silent for too long."""
    before_s = -math.inf
    for at_s, node in course:
        if SILENT_S < at_s - before_s < math.inf:
            yield (before_s + at_s) / 2, None
        yield at_s, _number(node.values.get(key, ""))
        before_s = at_s


def _restarts(course: Iterable[tuple[float, NodeTold]]) -> Iterator[float]:
    known: str | None = None
    for at_s, node in course:
        process = node.values.get("pid")
        if process and known not in (None, process):
            yield at_s
        known = process or known


def _drawn(chart: _Chart, measure: Measure, span: tuple[float, float], most: float) -> str:
    begin_s, end_s = span
    scale = WIDTH / max(end_s - begin_s, 1e-3)

    def place(at_s: float, value: float) -> tuple[float, float]:
        return (at_s - begin_s) * scale, HEIGHT - 1 - (HEIGHT - 3) * value / most

    names = ", ".join(chart.names)
    label = f"{names}: {measure.title}, {measure.unit}"
    again = "".join(
        f'<path class="again" d="M{(at_s - begin_s) * scale:.1f} 0V{HEIGHT:g}"><title>started again at {at_s:.1f} s'
        "</title></path>"
        for at_s in chart.restarts
    )
    lines = "".join(
        f'<g class="curve c-{curve.kind}"><path d="{path(_envelope(curve.points, 1 / scale), place)}"/></g>'
        for curve in chart.curves
    )
    return (
        f"<figure><figcaption><b>{escape(names)}</b> up to {_short(chart.peak)} {measure.unit}</figcaption>"
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" preserveAspectRatio="none" role="img" aria-label="{escape(label)}">'
        f'<path class="axes" d="M0 {HEIGHT - 0.5:g}H{WIDTH:g}"/>{again}{lines}</svg></figure>'
    )


def _envelope(points: Iterable[tuple[float, float | None]], step_s: float) -> Iterator[tuple[float, float | None]]:
    """Of all points within ``step_s`` the least and the greatest: many hours must not take more room than a minute."""
    step: list[tuple[float, float]] = []
    for at_s, value in points:
        if step and (value is None or at_s - step[0][0] >= step_s):
            yield from sorted({min(step, key=lambda point: point[1]), max(step, key=lambda point: point[1])})
            step = []
        if value is None:
            yield at_s, None
        else:
            step.append((at_s, value))
    yield from sorted({min(step, key=lambda point: point[1]), max(step, key=lambda point: point[1])} if step else ())


def _key(measure: Measure) -> str:
    named = [
        f'<span class="c-{kind}"><svg class="line" viewBox="0 0 14 4" aria-hidden="true"><path d="M0 2h14"/></svg>'
        f"{escape(called)}</span>"
        for kind, called in zip(KINDS, measure.keys.values(), strict=False)
        if called
    ]
    return f'<p class="key">{"".join(named)}</p>' if named else ""


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
