"""Pieces of the page: tables of figures with bars in them, keys of colours."""

from __future__ import annotations

from collections.abc import Container, Iterable
from html import escape

from socialbot.evaluate.scores import Interval
from socialbot.report.page import wide

__all__ = ["bar", "cell", "interval", "key", "row", "table"]


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
    return wide(f'<table class="scores">{head}<tbody>{"".join(rows)}</tbody></table>')


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
