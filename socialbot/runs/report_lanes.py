"""A chart of what went on when (SVG): a lane for each sort of thing, in it bars from one time to another.

Below the lanes there may be curves on the same scale of time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

from socialbot.runs.report_curves import Plot, path
from socialbot.runs.report_page import wide

LEFT, TOP, BAR, GAP, BETWEEN = 116.0, 22.0, 17.0, 3.0, 9.0
ROOM_PX = 1100.0
LEAST_PX, MOST_PX = 6.0, 240.0
"""Pixels of a second, at least and at most; of long runs a second may have less, so that no chart is too wide."""
WIDEST_PX = 12_000.0
LETTER_PX = 6.3
DOT_PX = 5.0
PLOT, PLOT_GAP, KEY = 64.0, 18.0, 14.0
"""Height of curves, what is between them, and of a line of what they are called, pixels."""
MOST_ROWS = 12
"""So many bars of a lane may lie one below the other; what goes on at the same time besides is drawn over those."""


@dataclass(frozen=True)
class Stripe:
    """A bar from one time to another (s); one that ends as it begins is a dot.

    ``kind`` gives its colour: person, belief, goal, action, speech, head; ``more`` is what a pointer is told.
    """

    text: str
    from_s: float
    to_s: float
    kind: str
    more: str = ""
    failed: bool = False


@dataclass(frozen=True)
class Lane:
    """Bars of one sort; they may overlap."""

    name: str
    stripes: Sequence[Stripe]


@dataclass(frozen=True)
class Mark:
    """A moment (s) that is marked in all lanes."""

    at_s: float
    text: str


class Lanes:
    """The chart of some lanes, and of curves below them, from ``begin_s`` to ``end_s``."""

    def __init__(
        self,
        lanes: Sequence[Lane],
        end_s: float,
        *,
        begin_s: float = 0.0,
        marks: Sequence[Mark] = (),
        plots: Sequence[Plot] = (),
    ) -> None:
        self._begin_s = begin_s
        self._span_s = max(end_s - begin_s, 0.1)
        usual = min(max(ROOM_PX / self._span_s, LEAST_PX), MOST_PX)
        self._scale = min(usual, WIDEST_PX / self._span_s)
        self._marks = marks
        self._plots = plots
        self._rows = [(lane.name, _packed(lane.stripes, DOT_PX / self._scale)) for lane in lanes if lane.stripes]
        heights = (len(rows) * (BAR + GAP) + BETWEEN for _, rows in self._rows)
        self.height = TOP + sum(heights) + len(plots) * (PLOT + PLOT_GAP) + PLOT_GAP / 2 * bool(plots)
        self.width = LEFT + self._span_s * self._scale + 24

    def html(self, label: str) -> str:
        """The chart, for a page; ``label`` is what it is called where it cannot be seen. Empty without any content."""
        if not self._rows and not self._plots:
            return ""
        size = f'width="{self.width:.0f}" height="{self.height:.0f}" viewBox="0 0 {self.width:.0f} {self.height:.0f}"'
        parts = [f'<svg class="lanes" role="img" {size}><title>{escape(label)}</title>', *self._axis()]
        top = TOP
        for name, rows in self._rows:
            high = len(rows) * (BAR + GAP)
            parts.append(
                f'<rect class="lane" x="0" y="{top - 3:.1f}" width="{self.width:.0f}" height="{high + 3:.1f}"/>'
            )
            parts.append(f'<text class="name" x="4" y="{top + 12:.1f}">{escape(_cut(name, LEFT - 10))}</text>')
            for number, row in enumerate(rows):
                parts += self._row(row, top + number * (BAR + GAP))
            top += high + BETWEEN
        top += PLOT_GAP / 2
        for plot in self._plots:
            parts += self._plot(plot, top)
            top += PLOT + PLOT_GAP
        return wide("".join([*parts, *self._marked(), "</svg>"]))

    def _x(self, seconds: float) -> float:
        return LEFT + (min(max(seconds - self._begin_s, 0.0), self._span_s)) * self._scale

    def _axis(self) -> Iterator[str]:
        steps = (1, 2, 5, 10, 20, 60, 120, 300, 600, 1800, 3600)
        each = next((step for step in steps if step * self._scale >= 52), 7200)
        first = -int(-self._begin_s // each) * each
        for second in range(first, int(self._begin_s + self._span_s) + 1, each):
            x = self._x(second)
            yield f'<line class="tick" x1="{x:.1f}" x2="{x:.1f}" y1="16" y2="{self.height:.0f}"/>'
            yield f'<text class="axis" x="{x + 3:.1f}" y="12">{_clock(second)}</text>'

    def _row(self, row: Sequence[Stripe], y: float) -> Iterator[str]:
        for number, stripe in enumerate(row):
            x, end = self._x(stripe.from_s), self._x(stripe.to_s)
            until = self._x(row[number + 1].from_s) if number + 1 < len(row) else self.width
            told = "\n".join(filter(None, (stripe.text, _when(stripe), stripe.more)))
            kind = f"s-{stripe.kind}{' failed' if stripe.failed else ''}"
            yield f'<g class="{kind}"><title>{escape(told)}</title>'
            if end - x < DOT_PX:
                yield f'<circle cx="{x:.1f}" cy="{y + BAR / 2:.1f}" r="{DOT_PX - 0.5}"/>'
                label = _cut(stripe.text, until - x - 14)
                yield f'<text class="beside" x="{x + 8:.1f}" y="{y + 12.5:.1f}">{escape(label)}</text></g>'
            else:
                yield f'<rect x="{x:.1f}" y="{y:.1f}" width="{end - x - 0.5:.1f}" height="{BAR}" rx="3"/>'
                yield f'<text x="{x + 4:.1f}" y="{y + 12.5:.1f}">{escape(_cut(stripe.text, end - x - 8))}</text></g>'

    def _plot(self, plot: Plot, top: float) -> Iterator[str]:
        floor = top + PLOT
        yield f'<rect class="lane" x="0" y="{top - 3:.1f}" width="{self.width:.0f}" height="{PLOT + 6:.1f}"/>'
        yield f'<text class="name" x="4" y="{top + 10:.1f}">{escape(_cut(plot.name, LEFT - 24))}</text>'
        for y, value in ((top, plot.most), (floor, 0.0)):
            yield f'<line class="tick" x1="{LEFT}" x2="{self.width:.0f}" y1="{y:.1f}" y2="{y:.1f}"/>'
            yield f'<text class="axis" x="{LEFT - 4}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>'
        for number, curve in enumerate(plot.curves, 1):
            points = [point for point in curve.points if 0.0 <= point[0] - self._begin_s <= self._span_s]
            way = path(points, lambda at_s, value: (self._x(at_s), floor - PLOT * value / plot.most))
            at = top + 10 + number * KEY
            yield f'<g class="curve c-{curve.kind}"><title>{escape(curve.name)}</title><path d="{way}"/>'
            yield f'<path d="M4 {at - 4:.1f}h12"/>'
            yield f'<text class="axis" x="20" y="{at:.1f}">{escape(curve.name)}</text></g>'

    def _marked(self) -> Iterator[str]:
        for mark in self._marks:
            x = self._x(mark.at_s)
            yield f'<g class="marked"><title>{escape(mark.text)}</title>'
            yield f'<line x1="{x:.1f}" x2="{x:.1f}" y1="14" y2="{self.height:.0f}"/></g>'


def _packed(stripes: Sequence[Stripe], least_s: float) -> list[list[Stripe]]:
    """Bars in rows, so that those of a row follow each other."""
    rows: list[list[Stripe]] = []
    free: list[float] = []
    for stripe in sorted(stripes, key=lambda each: each.from_s):
        number = next((n for n, since in enumerate(free) if since <= stripe.from_s), len(rows))
        if number == len(rows) and number < MOST_ROWS:
            rows.append([])
            free.append(0.0)
        number = min(number, MOST_ROWS - 1)
        rows[number].append(stripe)
        free[number] = max(stripe.to_s, stripe.from_s + least_s)
    return rows


def _cut(text: str, room: float) -> str:
    """As much of a text as there is room for, in pixels."""
    count = int(room / LETTER_PX)
    return text if len(text) <= count else f"{text[: count - 1]}…" if count > 3 else ""


def _when(stripe: Stripe) -> str:
    if stripe.to_s == stripe.from_s:
        return f"at {stripe.from_s:.2f} s"
    return f"from {stripe.from_s:.2f} s to {stripe.to_s:.2f} s"


def _clock(second: int) -> str:
    return f"{second} s" if second < 600 else f"{second // 60}:{second % 60:02d}"
