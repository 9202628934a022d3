"""Draws the house, socialbot's folders and who uses whom, from the imports: ``python tools/house.py``."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from html import escape
from pathlib import Path
from textwrap import wrap

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "socialbot"
PICTURE = ROOT / "docs" / "pictures" / "house.svg"

WIDTH, MARGIN, GAP = 1000, 20, 12
LINE = 17
"""Pixels from one line of text to the next."""
LETTER = 6.3
"""How wide a letter of 12 pixels is, about."""
COLOURS = ("#dbe9f6", "#e3f1dc", "#fbeecb", "#f8dfd3", "#ebe0f3", "#d9eeee")


def part_of(path: Path) -> str:
    """The folder of the package, or the module beside the folders, to which ``path`` belongs."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def used_parts(path: Path) -> Iterator[str]:
    """The parts of the package that a file imports, also inside functions."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        yield from (name.split(".")[1] for name in names if name.startswith("socialbot."))


def uses() -> Mapping[str, frozenset[str]]:
    """For each part of the package, the other parts that it imports."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in PACKAGE.rglob("*.py"):
        found[part_of(path)].update(used_parts(path))
    found.pop("__init__", None)
    return {part: frozenset(used & found.keys() - {part}) for part, used in sorted(found.items())}


def reached(part: str, graph: Mapping[str, frozenset[str]]) -> frozenset[str]:
    """The parts that ``part`` uses, and those that these use, and so on."""
    seen: set[str] = set()
    ahead = [part]
    while ahead:
        new = graph[ahead.pop()] - seen
        seen |= new
        ahead.extend(new)
    return frozenset(seen)


def folders() -> tuple[str, ...]:
    """The parts that are folders with modules."""
    return tuple(sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py")))


def ground(graph: Mapping[str, frozenset[str]]) -> tuple[str, ...]:
    """The modules that stand on no folder."""
    rooms = set(folders())
    return tuple(part for part in graph if part not in rooms and not reached(part, graph) & rooms)


def floors(graph: Mapping[str, frozenset[str]]) -> list[tuple[str, ...]]:
    """The folders floor by floor from the lowest: each uses what is below, or beside where both use each other."""
    rooms = folders()
    plan = {room: graph[room] & set(rooms) for room in rooms}
    beneath = {room: reached(room, plan) for room in rooms}
    height: dict[str, int] = {}
    for room in sorted(rooms, key=lambda room: len(beneath[room] - {room})):
        lower = (height[other] + 1 for other in beneath[room] if room not in beneath[other])
        height[room] = max(lower, default=0)
    return [tuple(room for room in rooms if height[room] == floor) for floor in sorted(set(height.values()))]


def noun(folder: str) -> str:
    """What a folder is for: the beginning of its docstring."""
    text = ast.get_docstring(ast.parse((PACKAGE / folder / "__init__.py").read_text("utf-8"))) or ""
    return text.partition("\n")[0].rstrip(".")


def text_lines(lines: Iterable[str], x: float, y: float, look: str) -> str:
    """Lines of text from ``y`` downwards, centred on ``x``."""
    return "".join(
        f'<text class="{look}" x="{x:.0f}" y="{y + LINE * number:.0f}">{escape(line)}</text>\n'
        for number, line in enumerate(lines)
    )


def room(name: str, used: Iterable[str], corner: tuple[float, float], width: float, colour: str) -> tuple[str, float]:
    """A box with a name, what it is for and what it uses; and its height (pixels)."""
    (left, top), columns = corner, int((width - 24) / LETTER)
    about = wrap(noun(name), columns)
    below = wrap(f"uses {', '.join(sorted(used))}", columns) if used else []
    height = LINE * (len(about) + len(below) + 1) + 24
    middle = left + width / 2
    drawn = (
        f'<rect x="{left:.0f}" y="{top:.0f}" width="{width:.0f}" height="HEIGHT" rx="6" fill="{colour}"/>\n'
        + text_lines([name], middle, top + 22, "name")
        + text_lines(about, middle, top + 22 + LINE, "about")
        + text_lines(below, middle, top + 22 + LINE * (1 + len(about)), "uses")
    )
    return drawn, height


def storey(rooms: tuple[str, ...], graph: Mapping[str, frozenset[str]], top: float, colour: str) -> tuple[str, float]:
    """One floor, its rooms as wide as each other; and its height (pixels)."""
    stand_on = {*ground(graph)}
    width = (WIDTH - 2 * MARGIN - GAP * (len(rooms) - 1)) / len(rooms)
    corners = [(MARGIN + number * (width + GAP), top) for number in range(len(rooms))]
    drawn = [
        room(name, graph[name] - stand_on, corner, width, colour) for name, corner in zip(rooms, corners, strict=True)
    ]
    height = max(height for _, height in drawn)
    return "".join(text.replace("HEIGHT", f"{height:.0f}") for text, _ in drawn), height


def slab(title: str, names: Iterable[str], top: float) -> tuple[str, float]:
    """A box as wide as the house, with the modules in it; and its height (pixels)."""
    lines = wrap(", ".join(names), int((WIDTH - 2 * MARGIN - 24) / LETTER))
    height = LINE * (len(lines) + 1) + 24
    box = f'<rect x="{MARGIN}" y="{top:.0f}" width="{WIDTH - 2 * MARGIN}" height="{height}" rx="6" fill="#e4e4e4"/>\n'
    return (
        box + text_lines([title], WIDTH / 2, top + 22, "name") + text_lines(lines, WIDTH / 2, top + 22 + LINE, "about"),
        height,
    )


def house() -> str:
    """The picture as SVG."""
    graph = uses()
    below = ground(graph)
    above = [part for part in graph if part not in below and part not in folders() and part != "__main__"]
    drawn, height = slab("commands and runs, which use all below", above, 88)
    parts, top = [drawn], 88 + height + GAP
    for number, rooms in enumerate(reversed(floors(graph))):
        drawn, height = storey(rooms, graph, top, COLOURS[number % len(COLOURS)])
        parts.append(drawn)
        top += height + GAP
    drawn, height = slab("the ground, which any part may stand on", below, top)
    parts.append(drawn)
    bottom = top + height + MARGIN
    roof = f'<path d="M {MARGIN} 76 L {WIDTH / 2:.0f} 14 L {WIDTH - MARGIN} 76 Z" fill="#c96f4a"/>\n'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {bottom:.0f}" role="img" '
        'aria-label="The folders of socialbot, floor by floor, each with what it uses">\n'
        "<style>text { font: 12px system-ui, sans-serif; text-anchor: middle; fill: #222 } "
        ".name { font-weight: 700; font-size: 14px } .uses { fill: #555; font-style: italic } "
        ".roof { fill: #fff; font-weight: 700; font-size: 18px } rect { stroke: #0003 }</style>\n"
        f'<rect width="{WIDTH}" height="{bottom:.0f}" fill="#fff" stroke="none"/>\n'
        f"{roof}{text_lines(['socialbot'], WIDTH / 2, 58, 'roof')}{''.join(parts)}</svg>\n"
    )


if __name__ == "__main__":
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    PICTURE.write_text(house(), encoding="utf-8")
