"""Draw the floor of the warehouse (SVG), and its state over a run as an animation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

from socialbot.agents.warehouse.messages import BoxPosition, BoxPositions, MoveStatus, Point
from socialbot.agents.warehouse.scenario import (
    BASE_Y,
    BOX_M,
    DECK_M,
    FOOTPRINT,
    GRIPPER,
    SHELF,
    START,
    FloorLayout,
    Scenario,
)
from socialbot.agents.warehouse.world import Warehouse
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message
from socialbot.runs.tracks import Moment, add, forget, latest, thinned

SCALE = 112.0
"""Pixels a metre."""
BOX = 34.0
"""Pixels a box is wide; more than to scale, so that its name can be read."""
LIFT = 15.0
"""Pixels by which a box on another is moved up, so that both names can be read."""
HEAD = 58.0
"""Pixels above the floor, where there is a title."""
MARGIN_M = 0.55
RAIL = 26.0
"""Pixels from the left edge to the first rail of the crane."""

COLOURS = ("#3f74a8", "#d9695f", "#3d8f5f", "#c79a2c", "#8a5fa8", "#4aa3a8")
"""Of carriers, bays, deposits and boxes, by letter."""

TONES = {
    "ink": ("#2b2f33", "#e4e7ea"),
    "soft": ("#8b9198", "#7d868f"),
    "ground": ("#eef0f1", "#1f242a"),
    "paper": ("#ffffff", "#14181c"),
    "rail": ("#d3d7da", "#3a424a"),
    "plate": ("#dfe3e6", "#2f363d"),
}
"""All other colours, light and dark."""


def _style() -> str:
    def rules(which: int) -> str:
        return "".join(
            f".floor .f-{name}{{fill:{tones[which]}}}.floor .s-{name}{{stroke:{tones[which]}}}"
            for name, tones in TONES.items()
        )

    grip = ".floor .closed,.floor .holding .open{display:none}.floor .holding .closed{display:inline}"
    return f"<style>{rules(0)}{grip}@media(prefers-color-scheme:dark){{{rules(1)}}}</style>"


def world_svg(world: Warehouse, title: str = "") -> str:
    """The floor as it is now."""
    robots = {name: world.whereabouts(name).position for name in (GRIPPER, *world.cast.carriers)}
    return floor_svg(world.cast, robots, world.boxes(), title)


def floor_svg(cast: Scenario, robots: Mapping[str, Point], boxes: Sequence[BoxPosition], title: str = "") -> str:
    """The floor with ``robots`` (the gripper, the carriers) and ``boxes`` where they are; unknown ones are left out."""
    return FloorDrawing(cast).draw(robots, boxes, title)


class FloorDrawing:
    """The picture of one cast; ``head`` are pixels above the floor, for the title."""

    def __init__(self, cast: Scenario, *, head: float = HEAD) -> None:
        self.cast = cast
        self.head = max(head, 16.0)
        self.layout = FloorLayout(cast)
        shelves = [self.layout.stored(deposit, 2 * SHELF - 1) for deposit in cast.deposits]
        points = [*self.layout.places.values(), *self.layout.deposits.values(), *shelves]
        self.left = min(point.y for point in points) - MARGIN_M
        self.top = min(point.x for point in points) - MARGIN_M
        self.width = (max(point.y for point in points) + MARGIN_M - self.left) * SCALE
        self.height = (max(point.x for point in points) + MARGIN_M - self.top) * SCALE + self.head
        self.colours = {
            name: COLOURS[number % len(COLOURS)]
            for number, group in enumerate(zip(cast.carriers, cast.bays, cast.deposits, strict=True))
            for name in (*group, *cast.loads[number])
        }

    def draw(self, robots: Mapping[str, Point], boxes: Sequence[BoxPosition], title: str = "") -> str:
        """The whole picture. What stands on the floor comes first, what hangs above it last."""
        known = sorted((box for box in boxes if box.name in self.colours), key=lambda box: (box.position.z, box.name))
        holding = any(box.holder == GRIPPER for box in known)
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" class="floor" viewBox="0 0 {self.width:.0f} {self.height:.0f}" '
            f'width="{self.width:.0f}" height="{self.height:.0f}" font-family="system-ui, sans-serif" role="img">',
            f"<title>{escape(title or 'The floor of the warehouse')}</title>{_style()}",
            _rectangle(0, 0, self.width, self.height, "f-paper"),
            _rectangle(8, self.head - 8, self.width - 16, self.height - self.head, "f-ground", rx=10),
            *([_text(20, 33, title, size=19, anchor="start", weight=600)] if title else []),
            *self._places(),
            *(self._carrier(name, robots[name]) for name in self.cast.carriers if name in robots),
            f'<g class="boxes">{"".join(map(self._box, known))}</g>',
            *(self._crane(robots[GRIPPER], holding) if GRIPPER in robots else ()),
            "</svg>",
        ]
        return "\n".join(parts) + "\n"

    def at(self, point: Point) -> tuple[float, float]:
        """Where a point of the floor is in the picture."""
        return (point.y - self.left) * SCALE, (point.x - self.top) * SCALE + self.head

    def box_at(self, box: BoxPosition) -> tuple[float, float]:
        """Where a box is in the picture: moved up when it stands on others."""
        x, y = self.at(box.position)
        if box.holder == GRIPPER:
            return x, y
        ground = DECK_M if box.holder in self.cast.carriers else 0.0
        return x, y - round((box.position.z - ground) / BOX_M - 0.5) * LIFT

    def _places(self) -> Iterator[str]:
        for bay, deposit in zip(self.layout.bays, self.layout.deposits, strict=True):
            (x, y), (end, _) = self.at(self.layout.bays[bay]), self.at(self.layout.deposits[deposit])
            for side in (-14, 14):
                yield _line(x, y + side, end, y + side, "s-rail", width=2)
            colour = self.colours[bay]
            yield _area(x, y, FOOTPRINT[1] * SCALE + 14, FOOTPRINT[0] * SCALE + 14, colour)
            yield _text(x, y + 45, bay, colour=colour)
            shelf = self.at(self.layout.stored(deposit, SHELF - 1))[0]
            first, last = end - FOOTPRINT[1] / 2 * SCALE - 10, shelf + BOX / 2 + 12
            yield _area((first + last) / 2, y, last - first, FOOTPRINT[0] * SCALE + 34, colour)
            yield _text((first + last) / 2, y + 53, deposit, colour=colour)
        for base in self.cast.bases:
            x, y = self.at(self.layout.places[base])
            yield _rectangle(x - 25, y - 25, 50, 50, "f-plate", rx=6)
            yield _text(x, y + 41, base)
        x, y = self.at(self.layout.places[START])
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="15" fill="none" class="s-soft" stroke-dasharray="4 4"/>'
        yield _text(x, y + 32, START)

    def _carrier(self, name: str, at: Point) -> str:
        wide, high, colour = FOOTPRINT[1] * SCALE, FOOTPRINT[0] * SCALE, self.colours[name]
        wheels = "".join(
            _rectangle(wheel - 9, -high / 2 - 4, 18, high + 8, "f-ink", rx=3)
            for wheel in (-wide / 2 + 20, wide / 2 - 20)
        )
        deck = _rectangle(-wide / 2, -high / 2, wide, high, "f-paper", rx=7, stroke=colour, width=3)
        letter = _text(wide / 2 - 11, 6, name.removeprefix("carrier_"), size=16, colour=colour, weight=700)
        return _group(name, *self.at(at), f"<title>{name}</title>{wheels}{deck}{letter}")

    def _box(self, box: BoxPosition) -> str:
        square = (
            f'<rect x="{-BOX / 2:.1f}" y="{-BOX / 2:.1f}" width="{BOX:.1f}" height="{BOX:.1f}" rx="4" '
            f'fill="{self.colours[box.name]}" class="s-paper" stroke-width="1.5"/>'
        )
        name = _text(0, BOX / 2 - 4, box.name.removeprefix("box_"), size=12, colour="#ffffff", weight=600)
        return _group(box.name, *self.box_at(box), square + name)

    def _crane(self, at: Point, holding: bool) -> Iterator[str]:
        x, y = self.at(at)
        right = (BASE_Y + FOOTPRINT[1] / 2 + 0.2 - self.left) * SCALE
        for rail in (RAIL, right):
            yield _line(rail, self.head + 4, rail, self.height - 20, "s-soft", width=4)
        beams = "".join(_line(RAIL, side, right, side, "s-ink", width=5, opacity=0.55) for side in (-24, 24))
        ends = "".join(_rectangle(rail - 7, -32, 14, 64, "f-ink", rx=4) for rail in (RAIL, right))
        yield _group("bridge", 0.0, y, beams + ends)
        frame = '<rect x="-24" y="-28" width="48" height="56" rx="6" fill="none" class="s-ink" stroke-width="4"/>'
        jaws = "".join(
            f'<g class="{kind}">'
            + "".join(_line(side * 24, 0, side * reach, 0, "s-ink", width=6) for side in (-1, 1))
            + "</g>"
            for kind, reach in (("open", 12), ("closed", 18))
        )
        name = _text(0, -34, GRIPPER, size=11, weight=600)
        yield _group(GRIPPER, x, y, frame + jaws + name, kind="holding" if holding else "")


def _group(name: str, x: float, y: float, content: str, *, kind: str = "") -> str:
    return f'<g data-name="{name}" class="{kind}" transform="translate({x:.1f} {y:.1f})">{content}</g>'


def _rectangle(
    x: float, y: float, wide: float, high: float, tone: str, *, rx: float = 0, stroke: str = "none", width: float = 0
) -> str:
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{wide:.1f}" height="{high:.1f}" rx="{rx}" class="{tone}" '
        f'stroke="{stroke}" stroke-width="{width}"/>'
    )


def _area(x: float, y: float, wide: float, high: float, colour: str) -> str:
    """A marked area of the floor around a point."""
    return (
        f'<rect x="{x - wide / 2:.1f}" y="{y - high / 2:.1f}" width="{wide:.1f}" height="{high:.1f}" rx="9" '
        f'fill="{colour}" fill-opacity="0.1" stroke="{colour}" stroke-width="1.5" stroke-dasharray="6 5"/>'
    )


def _line(x: float, y: float, to_x: float, to_y: float, tone: str, *, width: float, opacity: float = 1.0) -> str:
    return (
        f'<line x1="{x:.1f}" y1="{y:.1f}" x2="{to_x:.1f}" y2="{to_y:.1f}" class="{tone}" '
        f'stroke-width="{width}" stroke-linecap="round" opacity="{opacity}"/>'
    )


def _text(
    x: float, y: float, text: str, *, size: float = 12, colour: str = "", anchor: str = "middle", weight: int = 400
) -> str:
    tone = f'fill="{colour}"' if colour else 'class="f-ink"'
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" font-weight="{weight}" {tone} '
        f'text-anchor="{anchor}">{escape(text)}</text>'
    )


class Film:
    """Takes the messages of sensors as they come; `at` and `tracks` tell of them."""

    def __init__(self, cast: Scenario) -> None:
        self.cast = cast
        self._floor = FloorDrawing(cast, head=0.0)
        self._robots: dict[str, list[tuple[int, Point]]] = {}
        self._boxes: list[tuple[int, tuple[BoxPosition, ...]]] = []

    def take(self, message: Message) -> None:
        """Takes a message; those of other kinds are left alone."""
        if isinstance(message, MoveStatus):
            add(self._robots.setdefault(message.robot, []), message.stamp, message.current_pos)
        elif isinstance(message, BoxPositions):
            add(self._boxes, message.stamp, message.boxes)

    def forget(self, stamp: int) -> None:
        """Forgets what was before ``stamp`` (ns), but for where everything was by then."""
        for track in self._robots.values():
            forget(track, stamp)
        forget(self._boxes, stamp)

    def __bool__(self) -> bool:
        """Whether anything was seen."""
        return bool(self._boxes and self._robots)

    def boxes(self, stamp: int) -> tuple[BoxPosition, ...]:
        """Where the boxes were at ``stamp`` (ns)."""
        return latest(self._boxes, stamp)

    def picture(self, stamp: int, title: str = "") -> str:
        """The floor at ``stamp`` (ns), as SVG; without a title it is that of `tracks`."""
        robots = {name: latest(track, stamp) for name, track in self._robots.items()}
        floor = FloorDrawing(self.cast) if title else self._floor
        return floor.draw(robots, self.boxes(stamp), title)

    def tracks(self, start: int) -> dict[str, Any]:
        """How everything moves in the picture, for a page: by name, moments of s from ``start``, x and y (pixels).

        Those of boxes also have the height (m), to tell which covers which. ``holding`` says when the gripper has one.
        """
        moves: dict[str, list[Moment]] = {}
        for name, track in self._robots.items():
            moves[name] = thinned([((stamp - start) / SECOND, *self._floor.at(point)) for stamp, point in track])
        held: list[Moment] = []
        boxes: dict[str, list[Moment]] = {}
        for stamp, found in self._boxes:
            second = (stamp - start) / SECOND
            for box in found:
                boxes.setdefault(box.name, []).append((second, *self._floor.box_at(box), box.position.z))
            holding = float(any(box.holder == GRIPPER for box in found))
            if not held or held[-1][1] != holding:
                held.append((round(second, 2), holding))
        return {"robots": moves, "boxes": {name: thinned(track) for name, track in boxes.items()}, "holding": held}
