"""Draw the packages of socialbot and their imports, floor by floor: ``python tools/house.py``."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from html import escape
from pathlib import Path
from textwrap import wrap

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "socialbot"
PICTURE = ROOT / "docs" / "pictures" / "house.svg"

WIDTH, MARGIN, GAP = 1000, 20, 12
LINE = 17
"""Line height (px)."""
LETTER = 6.3
"""Approximate width of a letter at a font size of 12 px."""
COLOURS = ("#dbe9f6", "#e3f1dc", "#fbeecb", "#f8dfd3", "#ebe0f3", "#d9eeee")


def rooms() -> tuple[str, ...]:
    """Return the packages directly inside socialbot."""
    return tuple(sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py")))


def used_rooms(path: Path) -> Iterator[str]:
    """Yield the first name of each module of socialbot that a file imports, also inside functions."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        yield from (name.split(".")[1] for name in names if name.startswith("socialbot."))


@cache
def uses() -> Mapping[str, frozenset[str]]:
    """Return the imported packages of each package, without itself."""
    found: dict[str, set[str]] = defaultdict(set)
    for room in rooms():
        for path in (PACKAGE / room).rglob("*.py"):
            found[room].update(used_rooms(path))
    return {room: frozenset(used & found.keys() - {room}) for room, used in sorted(found.items())}


def reached(room: str, graph: Mapping[str, frozenset[str]]) -> frozenset[str]:
    """Return the packages that ``room`` imports directly or indirectly."""
    seen: set[str] = set()
    ahead = [room]
    while ahead:
        new = graph[ahead.pop()] - seen
        seen |= new
        ahead.extend(new)
    return frozenset(seen)


def floors(graph: Mapping[str, frozenset[str]]) -> list[tuple[str, ...]]:
    """Return the packages by floor from the lowest. Packages with circular imports share a floor."""
    beneath = {room: reached(room, graph) for room in graph}
    height: dict[str, int] = {}
    for room in sorted(graph, key=lambda room: len(beneath[room] - {room})):
        lower = (height[other] + 1 for other in beneath[room] if room not in beneath[other])
        height[room] = max(lower, default=0)
    return [tuple(room for room in graph if height[room] == floor) for floor in sorted(set(height.values()))]


def summary(room: str) -> str:
    """Return the first line of a package's docstring."""
    text = ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text("utf-8"))) or ""
    return text.partition("\n")[0].rstrip(".")


def text_lines(lines: Iterable[str], x: float, y: float, style: str) -> str:
    """Return SVG text from ``y`` downwards, centred on ``x``."""
    return "".join(
        f'<text class="{style}" x="{x:.0f}" y="{y + LINE * number:.0f}">{escape(line)}</text>\n'
        for number, line in enumerate(lines)
    )


def box(room: str, used: Iterable[str], corner: tuple[float, float], width: float, colour: str) -> tuple[str, float]:
    """Return the SVG of one package with a placeholder HEIGHT, and the height it needs (px)."""
    (left, top), columns = corner, int((width - 24) / LETTER)
    about = wrap(summary(room), columns)
    below = wrap(f"uses {', '.join(sorted(used))}", columns) if used else []
    middle = left + width / 2
    drawn = (
        f'<rect x="{left:.0f}" y="{top:.0f}" width="{width:.0f}" height="HEIGHT" rx="6" fill="{colour}"/>\n'
        + text_lines([room], middle, top + 22, "name")
        + text_lines(about, middle, top + 22 + LINE, "about")
        + text_lines(below, middle, top + 22 + LINE * (1 + len(about)), "uses")
    )
    return drawn, LINE * (len(about) + len(below) + 1) + 24


def floor_boxes(
    names: tuple[str, ...], graph: Mapping[str, frozenset[str]], top: float, colour: str
) -> tuple[str, float]:
    """Return the SVG of one floor with packages of equal width, and its height (px)."""
    width = (WIDTH - 2 * MARGIN - GAP * (len(names) - 1)) / len(names)
    drawn = [
        box(name, graph[name], (MARGIN + number * (width + GAP), top), width, colour)
        for number, name in enumerate(names)
    ]
    height = max(height for _, height in drawn)
    return "".join(text.replace("HEIGHT", f"{height:.0f}") for text, _ in drawn), height


def house() -> str:
    """Return the picture as SVG."""
    graph = uses()
    parts, top = [], 88.0
    for number, names in enumerate(reversed(floors(graph))):
        drawn, height = floor_boxes(names, graph, top, COLOURS[number % len(COLOURS)])
        parts.append(drawn)
        top += height + GAP
    bottom = top - GAP + MARGIN
    roof = f"{WIDTH / 2:.0f},14 {WIDTH - MARGIN},76 {MARGIN},76"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {bottom:.0f}" font-family="sans-serif" '
        'role="img" aria-label="The packages of socialbot by floor, each with the packages it uses">\n'
        "<style>text{text-anchor:middle;font-size:12px;fill:#222}.name{font-size:15px;font-weight:bold}"
        ".uses{fill:#555;font-style:italic}rect{stroke:#bbb}</style>\n"
        f'<rect width="{WIDTH}" height="{bottom:.0f}" fill="#fff"/>\n'
        f'<polygon points="{roof}" fill="#c96f4a"/>\n'
        f'<text x="{WIDTH / 2:.0f}" y="60" style="fill:#fff;font-size:20px;font-weight:bold">socialbot</text>\n'
        + "".join(parts)
        + "</svg>\n"
    )


if __name__ == "__main__":
    PICTURE.write_text(house(), "utf-8")
    print(PICTURE.relative_to(ROOT))
