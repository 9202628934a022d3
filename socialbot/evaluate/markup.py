"""Pieces of the page: its style, its tables."""

from __future__ import annotations

from collections.abc import Container, Iterable
from html import escape

from socialbot.evaluate.scores import Interval
from socialbot.report.page import wide

__all__ = ["STYLE", "bar", "cell", "interval", "key", "row", "table"]

STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#1b1f23;background:#fff}
body{margin:2rem auto;max-width:1060px;padding:0 1.2rem}
h1{font-size:1.6rem;margin:0}
h2{font-size:1.2rem;margin:2.2rem 0 .4rem;border-bottom:1px solid #ddd}
h3{font-size:1rem;margin:1.1rem 0 .3rem}
p.note,li{color:#4a5560;font-size:13.5px;max-width:52rem}
table{border-collapse:collapse;margin:.6rem 0;font-size:14px}
th,td{padding:.18rem .6rem;text-align:right;border-bottom:1px solid #ececec;font-variant-numeric:tabular-nums}
th{font-weight:600;color:#4a5560}
th.l,td.l{text-align:left}
th.g{text-align:center;border-bottom:none;padding-top:.5rem}
td.n,th.n{padding-left:1.4rem}
tr.first td{border-top:2px solid #c9d1d8}
tr.paper td{color:#6a737d;font-style:italic}
td.best{font-weight:700}
td small{color:#6a737d}
.wide{overflow-x:auto}
.charts{display:flex;flex-wrap:wrap;gap:.4rem 1rem}
.chart text,.timeline text{font-size:11px;fill:#4a5560}
.chart .head{font-size:13px;font-weight:600;fill:#1b1f23}
.timeline{width:100%;margin:.2rem 0 .8rem}
.timeline .letter{fill:#fff;font-weight:700}
.shots{display:flex;flex-wrap:wrap;gap:.9rem}
.shots figure{margin:0;width:320px}
.shot{width:100%;display:block;border-radius:3px}
.shots figcaption{font-size:12.5px;color:#4a5560}
.key span{display:inline-block;margin-right:1.1rem}
.key i{display:inline-block;width:12px;height:12px;border-radius:6px;margin-right:.35rem;vertical-align:-1px}
.bar{display:inline-block;height:9px;border-radius:2px;margin:0 .4rem}
.room{display:inline-block;text-align:left}
.wide table{font-size:13px}
.wide th,.wide td{padding:.18rem .42rem}
.wide td.n{padding-left:1.5rem}
@media(prefers-color-scheme:dark){:root{color-scheme:dark}body{color:#e6e9ec;background:#14181c}
p.note,li,th,td small,tr.paper td,.shots figcaption{color:#a9b3bd}h2{border-color:#3a434c}
th,td{border-color:#2c343c}tr.first td{border-color:#55606b}
.chart,.timeline{background:#fff;border-radius:4px}}
@media(max-width:600px){body{margin:1rem auto}.chart{max-width:100%;height:auto}
.shots figure{width:100%}}
@media print{.wide{overflow:visible}tr,figure,.chart{break-inside:avoid}}
"""


def interval(value: Interval | None) -> str:
    """An interval as people read it; nothing for none."""
    return "" if value is None else f"{value[0]:.2f}-{value[1]:.2f}"


def table(
    heads: Iterable[str], rows: Iterable[str], *, left: Container[int], groups: Iterable[tuple[str, int]] = ()
) -> str:
    """A table; the heads of the columns numbered in ``left`` are set to the left.

    ``groups`` stand above the ``heads``: a word, and how many columns it is for.
    """
    above = "".join(f'<th class="g" colspan="{count}">{escape(word)}</th>' for word, count in groups)
    cells = "".join(
        f'<th class="{"l" if number in left else ""}">{escape(head)}</th>' for number, head in enumerate(heads)
    )
    head = f"<thead>{above and f'<tr>{above}</tr>'}<tr>{cells}</tr></thead>"
    return wide(f"<table>{head}<tbody>{''.join(rows)}</tbody></table>")


def row(cells: Iterable[str], kind: str = "") -> str:
    """A row of a table from its cells."""
    return f'<tr class="{kind}">{"".join(cells)}</tr>'


def cell(text: str, kind: str = "") -> str:
    """A cell with ``text``, which may hold any sign."""
    return f'<td class="{kind}">{escape(text)}</td>'


def bar(width: float, colour: str, room: float) -> str:
    """A bar ``width`` pixels long, with ``room`` for as many."""
    drawn = f'<span class="bar" style="width:{width:.0f}px;background:{colour}"></span>'
    return f'<span class="room" style="width:{room + 16:.0f}px">{drawn}</span>'


def key(entries: Iterable[tuple[str, str]], more: str = "") -> str:
    """What the colours mean: name and colour of each, and a word about what has none."""
    spans = [f'<span><i style="background:{colour}"></i>{escape(name)}</span>' for name, colour in entries]
    return f'<p class="key">{"".join(spans)}{f"<span>{escape(more)}</span>" if more else ""}</p>'
