"""Drawing of the warehouse floor (SVG), and the world view of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from socialbot.agents.base import svg
from socialbot.agents.warehouse.gripper import GripperAgent, LayoutGripper
from socialbot.agents.warehouse.layout import load_layout
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
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message
from socialbot.core.registry import Film
from socialbot.graph.node import Graph
from socialbot.runs.tracks import Moment, add, forget, latest, thinned

SCALE = 112.0  # pixels a metre
BOX = 34.0  # width of a box, pixels; not to scale, so that its name can be read
LIFT = 15.0  # upward shift of a box on another one, pixels
HEAD = 58.0  # height of the title, pixels
MARGIN_M = 0.55
BRIDGE, HOLDING = "bridge", "holding"
"""Group that spans the rails, and class of a gripper with a box."""
RAIL = 26.0  # distance from the left edge to the first rail of the crane, pixels

COLOURS = ("#3f74a8", "#d9695f", "#3d8f5f", "#c79a2c", "#8a5fa8", "#4aa3a8")

TONES = {
    "ink": ("#2b2f33", "#e4e7ea"),
    "soft": ("#8b9198", "#7d868f"),
    "ground": ("#eef0f1", "#1f242a"),
    "paper": ("#ffffff", "#14181c"),
    "rail": ("#d3d7da", "#3a424a"),
    "plate": ("#dfe3e6", "#2f363d"),
}

_RULES = f".floor .closed,.floor .{HOLDING} .open{{display:none}}.floor .{HOLDING} .closed{{display:inline}}"
_STYLE = svg.style("floor", TONES, _RULES)


class FloorDrawing:
    """Drawing of one scenario; ``head`` is the height above the floor for the title, pixels."""

    def __init__(self, scenario: Scenario, *, head: float = HEAD) -> None:
        self.scenario = scenario
        self.head = max(head, 16.0)
        self.layout = FloorLayout(scenario)
        shelves = [self.layout.stored(deposit, 2 * SHELF - 1) for deposit in scenario.deposits]
        points = [*self.layout.places.values(), *self.layout.deposits.values(), *shelves]
        self.left = min(point.y for point in points) - MARGIN_M
        self.top = min(point.x for point in points) - MARGIN_M
        self.width = (max(point.y for point in points) + MARGIN_M - self.left) * SCALE
        self.height = (max(point.x for point in points) + MARGIN_M - self.top) * SCALE + self.head
        self.colours = {
            name: COLOURS[number % len(COLOURS)]
            for number, route in enumerate(scenario.routes)
            for name in (*route, *scenario.loads[number])
        }

    def draw(self, robots: Mapping[str, Point], boxes: Sequence[BoxPosition], title: str = "") -> str:
        """The complete drawing, from the floor up to the crane."""
        known = sorted((box for box in boxes if box.name in self.colours), key=lambda box: (box.position.z, box.name))
        holding = any(box.holder == GRIPPER for box in known)
        parts = [
            _STYLE,
            svg.rectangle(0, 0, self.width, self.height, "f-paper"),
            svg.rectangle(8, self.head - 8, self.width - 16, self.height - self.head, "f-ground", rx=10),
            *([svg.text(20, 33, title, size=19, anchor="start", weight=600)] if title else []),
            *self._places(),
            *(self._carrier(name, robots[name]) for name in self.scenario.carriers if name in robots),
            f'<g class="boxes">{"".join(map(self._box, known))}</g>',
            *(self._crane(robots[GRIPPER], holding) if GRIPPER in robots else ()),
        ]
        return svg.document("floor", (self.width, self.height), title or "The floor of the warehouse", parts)

    def at(self, point: Point) -> tuple[float, float]:
        """Position of a point of the floor in the drawing, pixels."""
        return (point.y - self.left) * SCALE, (point.x - self.top) * SCALE + self.head

    def box_at(self, box: BoxPosition) -> tuple[float, float]:
        """Position of a box in the drawing: moved up if it stands on others."""
        x, y = self.at(box.position)
        if box.holder == GRIPPER:
            return x, y
        ground = DECK_M if box.holder in self.scenario.carriers else 0.0
        return x, y - round((box.position.z - ground) / BOX_M - 0.5) * LIFT

    def _places(self) -> Iterator[str]:
        for bay, deposit in zip(self.layout.bays, self.layout.deposits, strict=True):
            (x, y), (end, _) = self.at(self.layout.bays[bay]), self.at(self.layout.deposits[deposit])
            for side in (-14, 14):
                yield svg.line(x, y + side, end, y + side, "s-rail", width=2)
            colour = self.colours[bay]
            yield _area(x, y, FOOTPRINT[1] * SCALE + 14, FOOTPRINT[0] * SCALE + 14, colour)
            yield svg.text(x, y + 45, bay, colour=colour)
            shelf = self.at(self.layout.stored(deposit, SHELF - 1))[0]
            first, last = end - FOOTPRINT[1] / 2 * SCALE - 10, shelf + BOX / 2 + 12
            yield _area((first + last) / 2, y, last - first, FOOTPRINT[0] * SCALE + 34, colour)
            yield svg.text((first + last) / 2, y + 53, deposit, colour=colour)
        for base in self.scenario.bases:
            x, y = self.at(self.layout.places[base])
            yield svg.rectangle(x - 25, y - 25, 50, 50, "f-plate", rx=6)
            yield svg.text(x, y + 41, base)
        x, y = self.at(self.layout.places[START])
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="15" fill="none" class="s-soft" stroke-dasharray="4 4"/>'
        yield svg.text(x, y + 32, START)

    def _carrier(self, name: str, at: Point) -> str:
        wide, high, colour = FOOTPRINT[1] * SCALE, FOOTPRINT[0] * SCALE, self.colours[name]
        wheels = "".join(
            svg.rectangle(wheel - 9, -high / 2 - 4, 18, high + 8, "f-ink", rx=3)
            for wheel in (-wide / 2 + 20, wide / 2 - 20)
        )
        deck = svg.rectangle(-wide / 2, -high / 2, wide, high, "f-paper", rx=7, stroke=colour, width=3)
        letter = svg.text(wide / 2 - 11, 6, name.removeprefix("carrier_"), size=16, colour=colour, weight=700)
        return svg.group(f"<title>{name}</title>{wheels}{deck}{letter}", self.at(at), name=name)

    def _box(self, box: BoxPosition) -> str:
        square = (
            f'<rect x="{-BOX / 2:.1f}" y="{-BOX / 2:.1f}" width="{BOX:.1f}" height="{BOX:.1f}" rx="4" '
            f'fill="{self.colours[box.name]}" class="s-paper" stroke-width="1.5"/>'
        )
        name = svg.text(0, BOX / 2 - 4, box.name.removeprefix("box_"), size=12, colour="#ffffff", weight=600)
        return svg.group(square + name, self.box_at(box), name=box.name)

    def _crane(self, at: Point, holding: bool) -> Iterator[str]:
        x, y = self.at(at)
        right = (BASE_Y + FOOTPRINT[1] / 2 + 0.2 - self.left) * SCALE
        for rail in (RAIL, right):
            yield svg.line(rail, self.head + 4, rail, self.height - 20, "s-soft", width=4)
        beams = "".join(svg.line(RAIL, side, right, side, "s-ink", width=5, opacity=0.55) for side in (-24, 24))
        ends = "".join(svg.rectangle(rail - 7, -32, 14, 64, "f-ink", rx=4) for rail in (RAIL, right))
        yield svg.group(beams + ends, (0.0, y), name=BRIDGE)
        frame = '<rect x="-24" y="-28" width="48" height="56" rx="6" fill="none" class="s-ink" stroke-width="4"/>'
        jaws = "".join(
            f'<g class="{kind}">'
            + "".join(svg.line(side * 24, 0, side * reach, 0, "s-ink", width=6) for side in (-1, 1))
            + "</g>"
            for kind, reach in (("open", 12), ("closed", 18))
        )
        name = svg.text(0, -34, GRIPPER, size=11, weight=600)
        yield svg.group(frame + jaws + name, (x, y), name=GRIPPER, kind=HOLDING if holding else "")


def _area(x: float, y: float, wide: float, high: float, colour: str) -> str:
    """A marked area of the floor around a point."""
    return (
        f'<rect x="{x - wide / 2:.1f}" y="{y - high / 2:.1f}" width="{wide:.1f}" height="{high:.1f}" rx="9" '
        f'fill="{colour}" fill-opacity="0.1" stroke="{colour}" stroke-width="1.5" stroke-dasharray="6 5"/>'
    )


class FloorView:
    """World view of a warehouse run, from the messages of its sensors."""

    file = "floor.svg"
    kinds = (MoveStatus, BoxPositions)

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._drawing = FloorDrawing(scenario, head=0.0)
        self._robots: dict[str, list[tuple[int, Point]]] = {}
        self._boxes: list[tuple[int, tuple[BoxPosition, ...]]] = []

    def take(self, message: Message) -> None:
        """Update the view from a message; ignore messages of other types and messages from the past."""
        if isinstance(message, MoveStatus):
            add(self._robots.setdefault(message.robot, []), message.stamp, message.current_pos)
        elif isinstance(message, BoxPositions):
            add(self._boxes, message.stamp, message.boxes)

    def forget(self, stamp: int) -> None:
        """Drop the changes before ``stamp`` (ns) and keep the state at that time."""
        for track in self._robots.values():
            forget(track, stamp)
        forget(self._boxes, stamp)

    def __bool__(self) -> bool:
        return bool(self._boxes and self._robots)

    def boxes(self, stamp: int) -> tuple[BoxPosition, ...]:
        """Positions of the boxes at ``stamp`` (ns)."""
        return latest(self._boxes, stamp)

    def picture(self, stamp: int, title: str = "") -> str:
        """The floor at ``stamp`` (ns) as SVG. Without a title it has the coordinates of `film`."""
        robots = {name: latest(track, stamp) for name, track in self._robots.items()}
        drawing = FloorDrawing(self.scenario) if title else self._drawing
        return drawing.draw(robots, self.boxes(stamp), title)

    def film(self, start: int) -> Film:
        """The animation from ``start`` (ns). The bridge follows the gripper, which has the class "holding"."""
        robots = {
            name: thinned([((stamp - start) / SECOND, *self._drawing.at(point)) for stamp, point in track])
            for name, track in self._robots.items()
        }
        holding: list[Moment] = []
        boxes: dict[str, list[Moment]] = {}
        for stamp, found in self._boxes:
            second = (stamp - start) / SECOND
            for box in found:
                boxes.setdefault(box.name, []).append((second, *self._drawing.box_at(box), box.position.z))
            held = float(any(box.holder == GRIPPER for box in found))
            if not holding or holding[-1][1] != held:
                holding.append((round(second, 2), held))
        bridge = {BRIDGE: [(second, 0.0, y) for second, _, y in robots[GRIPPER]]} if GRIPPER in robots else {}
        moves = {**robots, **bridge, **{name: thinned(track) for name, track in boxes.items()}}
        return Film(self.picture(start), moves, classes={GRIPPER: {HOLDING: holding}})

    def figures(self, start: int, end: int) -> list[tuple[str, str]]:
        """Number of boxes in their deposits."""
        stored = [box.holder.startswith("deposit") for box in self.boxes(end)]
        return [(f"{sum(stored)} of {len(stored)}", "boxes in their deposits")]

    def results(self, start: int, end: int) -> dict[str, Any]:
        """``boxes``: the holder of each box at the end. ``unfinished``: the boxes that are not in their deposits."""
        boxes = {box.name: box.holder for box in self.boxes(end)}
        targets = zip(self.scenario.deposits, self.scenario.loads, strict=True)
        deposit_of = {box: deposit for deposit, load in targets for box in load}
        lost = [
            f"{box} is not in {deposit} but {boxes.get(box, 'nowhere')}"
            for box, deposit in deposit_of.items()
            if boxes.get(box) != deposit
        ]
        return {"boxes": boxes, "unfinished": lost}

    def summary(self, start: int, end: int) -> list[str]:
        """The boxes of each holder at the end."""
        holders: dict[str, list[str]] = {}
        for box in self.boxes(end):
            holders.setdefault(box.holder, []).append(box.name)
        return [f"{holder}: {', '.join(sorted(boxes))}" for holder, boxes in sorted(holders.items())]


def world_view(graph: Graph) -> FloorView | None:
    """The view of the warehouse that ``graph`` runs; None for a graph without a gripper, or with several."""
    for node in graph.nodes:
        if issubclass(node.type, LayoutGripper):
            aisles = load_layout(str(node.parameters.get("layout", "")), where=f"{node.name}.layout")
            return FloorView(aisles[0]) if len(aisles) == 1 else None
        if issubclass(node.type, GripperAgent):
            return FloorView(node.type.scenario)
    return None
