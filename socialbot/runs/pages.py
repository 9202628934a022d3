"""Self-contained HTML pages: Jinja2 templates, tables, charts and the bundled modules of the run page."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, TypeVar

import cv2
import msgspec
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from rich.table import Table as TerminalTable
from rich.text import Text

from socialbot.bags.image_files import decode_image
from socialbot.core.errors import ImageError
from socialbot.core.paths import replace_file, writing

T = TypeVar("T")

PAGE = Path(str(files("socialbot.runs"))) / "page"

Cell = str | float | tuple[str, str]
"""Text, number (right-aligned), or text with a style: "", r (right), good, bad, best, code."""

_TERMINAL_STYLES = {"good": "green", "bad": "red", "best": "bold"}
_FROZEN_ONLY = {"frozen.js", "document.js", "main.js"}
_FEWEST_POINTS = 3
_THUMBNAIL_WIDTH = 480
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_IMPORT = re.compile(r"""(?<=from )'\./([\w-]+\.js)'|(?<=import )'\./([\w-]+\.js)'""")

_environment = Environment(
    loader=PackageLoader("socialbot.runs"),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=StrictUndefined,
)


class Series(msgspec.Struct, frozen=True, omit_defaults=True):
    """One series of a chart.

    Args:
        name: Label in the legend.
        points: Pairs of x and y, ascending in x for lines; None as y interrupts the line.
        colour: Index of a page colour (0 to 5), "good", "bad", "soft" or a CSS colour.
        style: Line, dots or diamonds.
        dash: Whether the line is dashed.
    """

    name: str
    points: Sequence[tuple[float, float | None]]
    colour: int | str = 0
    style: Literal["line", "points", "diamonds"] = "line"
    dash: bool = False


class Chart(msgspec.Struct, frozen=True, omit_defaults=True):
    """Chart that uPlot draws in the page.

    Args:
        title: Heading, also the accessible name.
        series: Series that share the axes.
        x_label: Unit or name of the x axis.
        y_label: Unit or name of the y axis.
        x_range: Fixed limits of the x axis.
        y_range: Fixed limits of the y axis; from 0 to the largest value by default.
        categories: Labels of x = 0, 1, ... instead of numbers.
        marks: Vertical lines: x and text.
    """

    title: str
    series: Sequence[Series]
    x_label: str = "s"
    y_label: str = ""
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    categories: Sequence[str] = ()
    marks: Sequence[tuple[float, str]] = ()


@dataclass(frozen=True)
class Section:
    """Titled part of a page with a note on how to read it."""

    title: str
    content: str
    note: str = ""


@dataclass(frozen=True)
class Page:
    """Document with figures (``tiles``), warnings at the top and sections; empty sections are left out."""

    title: str
    lead: str = ""
    verdict: str = ""
    good: bool = True
    warnings: Sequence[str] = ()
    tiles: Sequence[tuple[str, str]] = ()
    sections: Sequence[Section] = ()

    def html(self) -> str:
        """Return the page as one HTML document without external files."""
        sections = [section for section in self.sections if section.content]
        contents = "".join(section.content for section in sections)
        return render_document(
            "document.html",
            page=self,
            sections=sections,
            bundle=bundle("document.js", charts='class="plot"' in contents),
            is_drawn='class="plot"' in contents or 'class="timeline"' in contents,
        )

    def write(self, path: Path) -> Path:
        """Write the page to ``path``.

        Raises:
            ParameterError: The file cannot be written.
        """
        return write_file(path, self.html())


@dataclass(frozen=True)
class Bundle:
    """Style sheets and scripts of a page, to be embedded in it."""

    style: Markup
    charts: Markup
    imports: Markup
    entry: str


def write_file(path: Path, content: str | bytes) -> Path:
    """Write a file and create its folder.

    Raises:
        ParameterError: The file cannot be written.
    """
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, content.encode() if isinstance(content, str) else content)
    return path


def render(template: str, **values: Any) -> Markup:
    """Render a template of ``socialbot/runs/templates``."""
    return Markup(_environment.get_template(template).render(**values))


POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'nonce-{nonce}'",
        "style-src 'nonce-{nonce}'",
        "style-src-attr 'unsafe-inline'",
        "img-src data: blob:",
        "media-src data: blob:",
        "base-uri 'none'",
        "form-action 'none'",
    )
)
"""Content security policy of a self-contained page: its own scripts and styles, images and sounds in the page only."""


def render_document(template: str, **values: Any) -> Markup:
    """Render a self-contained page, which runs its own scripts only and loads nothing.

    The nonce of its scripts is a digest of the page. So equal pages are equal files, and no text of a run can hold it.
    """
    digest = hashlib.sha256(render(template, **values, nonce="", policy="").encode("utf-8", "replace")).digest()
    nonce = base64.b64encode(digest).decode()
    return render(template, **values, nonce=nonce, policy=POLICY.format(nonce=nonce))


@cache
def live_page() -> Markup:
    """Return the run page that loads its data from the server."""
    modules = sorted(path.name for path in PAGE.glob("*.js") if path.name not in _FROZEN_ONLY)
    return render("run.html", report=None, modules=modules, nonce="", policy="")


@dataclass(frozen=True)
class Table:
    """Table for pages, terminals and Markdown. ``groups`` are headings above the columns, with their column counts."""

    heads: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    title: str = ""
    groups: Sequence[tuple[str, int]] = ()

    def cells(self) -> list[list[tuple[str, str]]]:
        """Return the text and style of each cell."""
        return [[_styled(cell) for cell in row] for row in self.rows]

    def right(self) -> list[int]:
        """Return the numbers of the right-aligned columns."""
        columns = zip(*self.cells(), strict=True)
        return [number for number, column in enumerate(columns) if {"r", "best"} & {style for _, style in column}]

    def html(self) -> Markup:
        """Return the table as HTML; empty without rows."""
        return part("table", self.heads, self.cells(), self.right(), self.groups) if self.rows else Markup()

    def terminal(self, most: int | None = None) -> TerminalTable:
        """Return the table for a terminal, with the first ``most`` rows, by default all."""
        shown = TerminalTable(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
        above = [word for group, count in self.groups for word in (group, *[""] * (count - 1))]
        right = self.right()
        for number, head in enumerate(self.heads):
            heading = f"{above[number]}\n{head}" if above and number in right else head.replace(", ", "\n")
            justify = "right" if number in right else "left"
            shown.add_column(Text(heading), justify=justify, no_wrap=number in right, overflow="fold")
        for row in self.cells()[:most]:
            shown.add_row(*(Text(text, _TERMINAL_STYLES.get(style, "")) for text, style in row))
        if most is not None and len(self.rows) > most:
            shown.add_row("...", *("" for _ in self.heads[1:]))
        return shown


def _styled(cell: Cell) -> tuple[str, str]:
    return cell if isinstance(cell, tuple) else (cell, "") if isinstance(cell, str) else (str(cell), "r")


def table(heads: Sequence[str], rows: Sequence[Sequence[Cell]]) -> Markup:
    """Return a table as HTML; empty without rows."""
    return Table(heads, rows).html()


def rate(value: float | None) -> str:
    """Return a rate as text; "-" for None."""
    return "-" if value is None else f"{value:.3f}"


def settings(values: Mapping[str, object]) -> Markup:
    """Return a table of names and values; empty without any."""
    return table(("", ""), [(name, (str(value), "code")) for name, value in values.items()])


@dataclass(frozen=True)
class LabelledBox:
    """Box in pixels with a label. ``kind``: seen, missed, false, truth or ignored."""

    x: float
    y: float
    w: float
    h: float
    text: str = ""
    kind: str = "seen"


@dataclass(frozen=True)
class Still:
    """Image as a data URL with its original size in pixels, boxes and caption."""

    picture: str
    width: int
    height: int
    boxes: Sequence[LabelledBox] = ()
    caption: str = ""


def thumbnail(image: bytes | np.ndarray, boxes: Sequence[LabelledBox] = (), caption: str = "") -> Still | None:
    """Return a small copy of an image, which may be encoded; None for a damaged image."""
    try:
        pixels = decode_image(image, where="image") if isinstance(image, bytes) else image
    except ImageError:
        return None
    height, width = pixels.shape[:2]
    if width > _THUMBNAIL_WIDTH:
        size = (_THUMBNAIL_WIDTH, max(1, round(height * _THUMBNAIL_WIDTH / width)))
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 75])
    return Still(f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}", width, height, boxes, caption)


def spread(candidates: Iterable[T], most: int, are_near: Callable[[T, T], bool]) -> list[T]:
    """Return the first ``most`` candidates that are not near an earlier one."""
    chosen: list[T] = []
    for candidate in candidates:
        if len(chosen) < most and not any(are_near(candidate, other) for other in chosen):
            chosen.append(candidate)
    return chosen


def folded(summary: str, content: str, *, opened: bool = False) -> Markup:
    """Return ``content`` (HTML) that a click on ``summary`` unfolds."""
    return part("folded", summary, Markup(content), opened)


def charts(drawn: Iterable[Chart]) -> Markup:
    """Return a grid of charts; empty without any."""
    return part("charts", [(chart.title, json_script(chart)) for chart in drawn])


def series_charts(rows: Mapping[str, Mapping[str, object]]) -> Markup:
    """Return one chart per numeric column of a table whose row names are ascending numbers; empty for other tables."""
    found = [_NUMBER.match(name) for name in rows]
    along = [float(each[0]) for each in found if each is not None]
    if len(along) < _FEWEST_POINTS or len(along) != len(found) or sorted(set(along)) != along:
        return Markup()
    drawn = []
    for column in dict.fromkeys(column for row in rows.values() for column in row):
        values = [row.get(column) for row in rows.values()]
        points = [
            (x, float(y))
            for x, y in zip(along, values, strict=True)
            if isinstance(y, int | float) and not isinstance(y, bool)
        ]
        if len(points) >= _FEWEST_POINTS and len({y for _, y in points}) > 1:
            drawn.append(Chart(column, (Series(column, points),), x_label=""))
    return charts(drawn)


def timeline(lanes: Sequence[Any], end_s: float, at_s: float | None = None) -> Markup:
    """Return the timeline component with ``lanes`` (`socialbot.runs.timeline.Lane`) and a cursor at ``at_s``."""
    return part("timeline", json_script({"lanes": lanes, "end": end_s, "at": at_s})) if lanes else Markup()


def json_script(content: Any) -> Markup:
    """Return ``content`` as JSON that is safe inside a script element."""
    return Markup(msgspec.json.encode(content).decode().replace("<", "\\u003c"))


@cache
def bundle(entry: str, *, charts: bool, instead: tuple[tuple[str, str], ...] = ()) -> Bundle:
    """Embed a module of the page with all modules that it imports.

    Modules become data URLs in an import map, so that the page works from a file and needs no build tool.

    Args:
        entry: File name of the module to start.
        charts: Whether the chart library is needed.
        instead: Pairs of file names: the second module answers to the name of the first.
    """
    replaced = dict(instead)
    found: dict[str, str] = {}
    pending = [entry]
    while pending:
        name = pending.pop()
        if name not in found:
            source = (PAGE / replaced.get(name, name)).read_text("utf-8")
            pending += ["".join(match) for match in _IMPORT.findall(source)]
            found[name] = _IMPORT.sub(lambda match: f"'page/{match[1] or match[2]}'", source)
    imports = {
        f"page/{name}": f"data:text/javascript;base64,{base64.b64encode(source.encode()).decode()}"
        for name, source in sorted(found.items())
    }
    styles = ["style.css", "document.css", *(["vendor/uPlot.min.css"] if charts else [])]
    return Bundle(
        style=Markup("\n".join((PAGE / name).read_text("utf-8") for name in styles)),
        charts=Markup((PAGE / "vendor/uPlot.iife.min.js").read_text("utf-8") if charts else ""),
        imports=Markup(json.dumps({"imports": imports}, separators=(",", ":"))),
        entry=f"page/{entry}",
    )


def part(name: str, *values: Any) -> Markup:
    """Render a macro of ``templates/parts.html``."""
    return getattr(_environment.get_template("parts.html").module, name)(*values)
