"""Drawing of a ward (SVG), and animation of its states over a run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape

from socialbot.agents.base import svg
from socialbot.agents.hospital.ward.messages import AWAY, CORRIDOR, AgentState, RoomState, WardState
from socialbot.agents.hospital.ward.ward import CORRIDOR_M, NURSE, ROOM_M, SPOT, UVD, Position, Room, Ward
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message
from socialbot.core.registry import Film
from socialbot.runs.tracks import Moment, add, forget, latest, thinned

WIDE = 1180.0
"""Width of the drawing of a large ward, pixels."""
LARGEST = 62.0
"""Largest scale, pixels a metre."""
HEAD = 52.0
FOOT = 62.0
EDGE = 18.0
"""Space for the title, for the legend, and around the ward, pixels."""
DOOR_M = 1.1

TONES = {
    "ink": ("#26323a", "#e3e9ec"),
    "soft": ("#71808a", "#8e9ba4"),
    "paper": ("#ffffff", "#12181c"),
    "corridor": ("#eef2f4", "#1c242a"),
    "fresh": ("#e0f2e6", "#173326"),
    "infected": ("#fbe3dd", "#43241f"),
    "unknown": ("#e3e7ea", "#262e34"),
    "green": ("#23804a", "#5cc489"),
    "red": ("#c0402b", "#f0836e"),
    "amber": ("#a8700a", "#e9b44c"),
    "violet": ("#7b3fc4", "#b48cf0"),
    "teal": ("#0f7c86", "#4fc3cd"),
    "yellow": ("#f3c322", "#e0b321"),
    "dark": ("#26323a", "#12181c"),
}

TALLY = "tally"
"""Name of the group with the number of infected rooms."""

COAT = {SPOT: "yellow", UVD: "violet", NURSE: "teal"}
WORD = {SPOT: "spot", UVD: "uvd", NURSE: "nurse"}

SIGNS = {
    "disinfected": ("green", '<path d="M-4 .5 -1.2 3.4 4.2-3" class="l-paper"/>'),
    "to be disinfected": (
        "red",
        '<circle r="2.6" class="f-paper"/><path d="M0-5.4V5.4M-4.7-2.7 4.7 2.7M-4.7 2.7 4.7-2.7" class="l-paper t"/>',
    ),
    "dirty": (
        "amber",
        '<circle cx="-2.4" cy="-1.6" r="2" class="f-paper"/><circle cx="2.6" cy="-2.2" r="1.3" class="f-paper"/>'
        '<circle cx="1.2" cy="2.6" r="2.2" class="f-paper"/>',
    ),
    "person inside": (
        "ink",
        '<circle cy="-2.4" r="2.2" class="f-paper"/><path d="M-4 5a4 4.4 0 0 1 8 0z" class="f-paper"/>',
    ),
    "nurse absent": ("soft", '<path d="M0-4V4M-4 0H4" class="l-paper"/><path d="M-5.6 5.6 5.6-5.6" class="l-ink"/>'),
}
"""Signs by meaning: tone of the disc, and markup on it."""


_STYLE = svg.style("ward", TONES, ".ward .t{stroke-width:1.3}")


@dataclass(frozen=True)
class DrawingGroup:
    """A named part of the drawing; one that moves has a place (pixels)."""

    name: str
    drawing: str
    place: tuple[float, float] | None = None

    def svg(self) -> str:
        return svg.group(self.drawing, self.place, name=self.name)


class WardDrawing:
    """Drawing of one ward."""

    def __init__(self, ward: Ward) -> None:
        self.ward = ward
        self.left = min(room.corner.x for room in ward.rooms)
        if len(ward.corridor_ys) > 1:
            self.left = min(self.left, ward.spine_x - CORRIDOR_M / 2)
        self.top = min(room.corner.y for room in ward.rooms)
        right = max(room.corner.x for room in ward.rooms) + ROOM_M[0]
        bottom = max(max(room.corner.y + ROOM_M[1], room.corridor_y + CORRIDOR_M / 2) for room in ward.rooms)
        self.scale = min((WIDE - 2 * EDGE) / (right - self.left), LARGEST)
        self.is_roomy = self.scale > 40.0
        self.icon = 17.0 if self.is_roomy else 9.5
        """Half of the size of a robot, pixels."""
        self.wide = max((right - self.left) * self.scale + 2 * EDGE, 720.0)
        self.high = (bottom - self.top) * self.scale + HEAD + FOOT
        self.offset = (self.wide - (right - self.left) * self.scale) / 2

    def draw(self, state: WardState, title: str = "") -> str:
        """The complete drawing."""
        return self.framed(title, [group.svg() for group in self.groups(state)])

    def groups(self, state: WardState) -> Iterator[DrawingGroup]:
        """The parts that change: number of infected rooms, each room, and each robot or nurse in the ward."""
        tally = svg.text(self.wide - EDGE - 4, 33, _tally(state), size=13, anchor="end", tone="f-soft")
        yield DrawingGroup(TALLY, tally)
        lit = {_room_lit(agent) for agent in state.agents}
        away = {agent.home for agent in state.agents if agent.kind == NURSE and agent.place == AWAY}
        for room in self.ward.rooms:
            yield DrawingGroup(room.name, self._room(room, state.room(room.name), room.name in lit, room.name in away))
        for agent, place in self._whereabouts(state.agents):
            yield DrawingGroup(agent.name, self._agent(agent), place)

    def framed(self, title: str, groups: Iterable[str]) -> str:
        """A drawing of groups with title, corridors and legend."""
        title = title or "The ward"
        parts = [
            _STYLE,
            svg.rectangle(0, 0, self.wide, self.high, "f-paper"),
            svg.text(EDGE + 4, 33, title, size=19, anchor="start", weight=600),
            *self._corridors(),
            *groups,
            *self._legend(),
        ]
        return svg.document("ward", (self.wide, self.high), title, parts)

    def at(self, point: Position) -> tuple[float, float]:
        """Position of a point of the ward in the drawing, pixels."""
        return (point.x - self.left) * self.scale + self.offset, (point.y - self.top) * self.scale + HEAD

    def _corridors(self) -> Iterator[str]:
        ys = self.ward.corridor_ys
        half = CORRIDOR_M / 2
        for y in ys:
            rooms = [room for room in self.ward.rooms if room.corridor_y == y]
            start = max(self.left, min(min(room.corner.x for room in rooms), self.ward.spine_x + half))
            end = max(room.corner.x for room in rooms) + ROOM_M[0]
            yield self._area(Position(start, y - half), end - start, CORRIDOR_M, "f-corridor")
        if len(ys) > 1:
            spine = Position(self.ward.spine_x - half, ys[0] - half)
            yield self._area(spine, CORRIDOR_M, ys[-1] - ys[0] + CORRIDOR_M, "f-corridor")

    def _area(self, corner: Position, wide: float, high: float, tone: str) -> str:
        x, y = self.at(corner)
        return svg.rectangle(x, y, wide * self.scale + 0.5, high * self.scale + 0.5, tone)

    def _room(self, room: Room, state: RoomState | None, lit: bool, away: bool) -> str:
        x, y = self.at(room.corner)
        wide, high = ROOM_M[0] * self.scale, ROOM_M[1] * self.scale
        tone = "unknown" if state is None else "fresh" if state.disinfected else "infected"
        parts = [f"<title>{escape(_words_of(room.name, state))}</title>"]
        parts.append(svg.rectangle(x, y, wide, high, f"f-{tone} s-ink", width=2.5 if self.is_roomy else 1.6))
        if lit:
            inner = svg.rectangle(x + 3, y + 3, wide - 6, high - 6, "f-violet s-violet", width=3, rx=3)
            parts.append(f'<g fill-opacity=".22" stroke-opacity=".8">{inner}</g>')
        parts.append(self._door(room, state))
        label = y + (20 if self.is_roomy else 13) if room.is_above else y + high - (10 if self.is_roomy else 6)
        size = 14 if self.is_roomy else 10.5
        parts.append(
            svg.text(x + (12 if self.is_roomy else 6), label, room.name, size=size, anchor="start", weight=600)
        )
        signs = _signs_of(state, away)
        size = 1.15 if self.is_roomy else 0.72
        step = 19.0 * size
        for number, sign in enumerate(signs):
            place = x + wide - (len(signs) - number - 0.5) * step - (6 if self.is_roomy else 3)
            parts.append(_sign(sign, place, label - 4.5 * size, size))
        return "".join(parts)

    def _door(self, room: Room, state: RoomState | None) -> str:
        """The gap in the wall, and the leaf: closed, or open into the room."""
        x, y = self.at(room.door)
        half = DOOR_M / 2 * self.scale
        wall = 2.5 if self.is_roomy else 1.6
        gap = svg.line(x - half, y, x + half, y, "s-corridor", wall + 2.5)
        if state is None or (state.door_open and room.name in self.ward.docks):
            return gap
        if not state.door_open:
            return gap + svg.line(x - half, y, x + half, y, "s-red", wall + 2)
        inward = -1 if room.is_above else 1
        end = y + inward * half * 2
        arc = (
            f'<path d="M{x + half:.1f} {y:.1f}A{2 * half:.1f} {2 * half:.1f} 0 0 {0 if room.is_above else 1} '
            f'{x - half:.1f} {end:.1f}" class="l-soft t" stroke-dasharray="2 3" opacity=".7"/>'
        )
        return gap + arc + svg.line(x - half, y, x - half, end, "s-ink", wall + 0.5)

    # Robots and nurses

    def _whereabouts(self, agents: Sequence[AgentState]) -> Iterator[tuple[AgentState, tuple[float, float]]]:
        """Places of the agents in the ward, pixels."""
        inside: dict[str, list[AgentState]] = {}
        outside: dict[str, list[AgentState]] = {}
        for agent in agents:
            if agent.place in self.ward.room_by_name:
                (inside if agent.inside else outside).setdefault(agent.place, []).append(agent)
            elif agent.place != AWAY:
                yield agent, self.at(Position(agent.x, agent.y))
        for name, those in inside.items():
            yield from zip(those, self._places(self.ward.room_by_name[name], len(those)), strict=True)
        for name, those in outside.items():
            x, y = self.at(self.ward.room_by_name[name].entrance)
            for number, agent in enumerate(those):
                yield agent, (x + (number - (len(those) - 1) / 2) * 2.6 * self.icon, y)

    def _places(self, room: Room, count: int) -> list[tuple[float, float]]:
        """Places for ``count`` agents in a room: in rows."""
        columns = 3 if count in (3, 5, 6) else min(count, 4)
        rows = -(-count // columns)
        x, y = self.at(room.centre)
        across = min(ROOM_M[0] * self.scale / columns, 4.6 * self.icon)
        down = min(ROOM_M[1] * self.scale * 0.7 / rows, 4.0 * self.icon)
        y += (3 if room.is_above else -6) * self.icon / 9.5
        return [
            (x + (n % columns - (columns - 1) / 2) * across, y + (n // columns - (rows - 1) / 2) * down)
            for n in range(count)
        ]

    def _agent(self, agent: AgentState) -> str:
        size = self.icon
        coat = COAT.get(agent.kind, "soft")
        number = agent.name.removeprefix(agent.kind)
        parts = [f"<title>{escape(_words_of_agent(agent))}</title>"]
        if agent.busy:
            parts.append(f'<circle r="{size * 1.32:.1f}" class="l-{coat}" stroke-dasharray="3 2.4"/>')
        parts += self._figure(agent.kind, coat)
        ink = "f-dark" if agent.kind == SPOT else "f-paper"
        letters = size * (1.05 if len(number) < 2 else 0.9)
        parts.append(svg.text(0, size * 0.37, number[:3], size=letters, weight=700, tone=ink))
        below = size * 1.5
        if agent.kind != NURSE:
            parts.append(_battery(agent, size, below))
            below += 5
        if self.is_roomy:
            parts.append(svg.text(0, below + 11, WORD.get(agent.kind, agent.kind), size=11.5, weight=600))
            parts.append(svg.text(0, below + 24, _action_words(agent.busy), size=11, tone="f-soft"))
        return "".join(parts)

    def _figure(self, kind: str, coat: str) -> Iterator[str]:
        """A four-legged robot, a lamp on a round base, or a person."""
        size = self.icon
        if kind == SPOT:
            for x, y in ((-0.72, -0.7), (-0.72, 0.7), (0.72, -0.7), (0.72, 0.7)):
                yield f'<circle cx="{x * size:.1f}" cy="{y * size:.1f}" r="{size * 0.26:.1f}" class="f-ink"/>'
            yield svg.rectangle(
                -size, -size * 0.62, 2 * size, size * 1.24, f"f-{coat} s-dark", width=1.2, rx=size * 0.4
            )
        elif kind == UVD:
            yield f'<circle r="{size:.1f}" class="f-{coat} s-ink" stroke-width="1.2"/>'
            yield f'<circle r="{size * 0.74:.1f}" fill="none" class="s-paper" stroke-width="1" opacity=".7"/>'
        else:
            yield f'<path d="M{-size} {size * 0.9:.1f}a{size} {size * 1.15:.1f} 0 0 1 {2 * size} 0z" class="f-{coat}"/>'
            yield f'<circle cy="{-size * 0.1:.1f}" r="{size * 0.78:.1f}" class="f-{coat} s-paper" stroke-width="1.4"/>'

    def _legend(self) -> Iterator[str]:
        """The meanings of signs and figures, in a row."""
        entries = [(word, _sign(word, 0, 0, 1.0)) for word in SIGNS]
        entries.append(("closed door", svg.line(-8, 0, 8, 0, "s-red", 4.5)))
        if not self.is_roomy:
            entries += [(WORD[kind], "".join(self._figure(kind, COAT[kind]))) for kind in COAT]
        widths = [34.0 + 7.0 * len(word) for word, _ in entries]
        x, y = (self.wide - sum(widths)) / 2, self.high - FOOT / 2 + 6
        for (word, drawing), width in zip(entries, widths, strict=True):
            entry = drawing + svg.text(14, 4.5, word, size=12.5, anchor="start")
            yield svg.group(entry, (x + 10, y))
            x += width


def _room_lit(agent: AgentState) -> str:
    """The room where a robot uses its light, or an empty string."""
    return agent.place if agent.busy.startswith("a_disinfect_room(") else ""


def _signs_of(state: RoomState | None, nurse_away: bool) -> list[str]:
    if state is None:
        return []
    found = ["person inside"] if state.people else []
    found += ["nurse absent"] if nurse_away else []
    found += [] if state.cleaned else ["dirty"]
    return [*found, "disinfected" if state.disinfected else "to be disinfected"]


def _tally(state: WardState) -> str:
    left = sum(room.infected for room in state.rooms)
    return f"{left} room{'s' if left > 1 else ''} to be disinfected" if left else "all rooms disinfected"


def _words_of(name: str, state: RoomState | None) -> str:
    if state is None:
        return f"{name}: unknown"
    door = "open" if state.door_open else "closed"
    tidy = "tidy" if state.cleaned else "dirty"
    lit = "disinfected" if state.disinfected else "to be disinfected"
    return f"{name}: {', '.join((f'door {door}', tidy, lit, *state.people))}"


def _words_of_agent(agent: AgentState) -> str:
    before = not agent.inside and agent.place not in (AWAY, CORRIDOR)
    place = f"before {agent.place}" if before else agent.place
    battery = "" if agent.kind == NURSE else f", battery {agent.battery:.0%}"
    return f"{agent.name}: {place}{battery}{', ' if agent.busy else ''}{agent.busy}"


def _action_words(busy: str) -> str:
    return busy.partition("(")[0].removeprefix("a_").replace("_", " ")


def _battery(agent: AgentState, size: float, y: float) -> str:
    tone = "red" if agent.low_battery else "amber" if agent.battery < 0.5 else "green"
    high = size * 0.36
    case = svg.rectangle(-size, y - high / 2, 2 * size, high, "f-paper s-ink", width=0.9, rx=1.2)
    return case + svg.rectangle(-size + 1, y - high / 2 + 1, (2 * size - 2) * agent.battery, high - 2, f"f-{tone}")


def _sign(word: str, x: float, y: float, size: float) -> str:
    tone, drawing = SIGNS[word]
    return (
        f'<g transform="translate({x:.1f} {y:.1f}) scale({size})"><title>{word}</title>'
        f'<circle r="8.5" class="f-{tone}"/>{drawing}</g>'
    )


class WardAnimation:
    """States of a ward over a run, as drawings and as an animation."""

    def __init__(self, ward: Ward) -> None:
        self._drawing = WardDrawing(ward)
        self._states: list[tuple[int, WardState]] = []

    def take(self, message: Message) -> None:
        """Take a state of the ward; ignore messages of other types. The last state of a stamp counts."""
        if isinstance(message, WardState):
            if self._states and message.stamp == self._states[-1][0]:
                self._states.pop()
            add(self._states, message.stamp, message)

    def forget(self, stamp: int) -> None:
        """Drop the changes before ``stamp`` (ns) and keep the state at that time."""
        forget(self._states, stamp)

    def __bool__(self) -> bool:
        return bool(self._states)

    def state(self, stamp: int) -> WardState:
        """The ward at ``stamp`` (ns)."""
        return latest(self._states, stamp)

    def picture(self, stamp: int, title: str = "") -> str:
        """The ward at ``stamp`` (ns) as SVG."""
        return self._drawing.draw(self.state(stamp), title)

    def film(self, start: int) -> Film:
        """The animation from ``start`` (ns): a group for each room, robot and nurse."""
        seen = list(self._drawing.groups(self.state(start)))
        missing = set(self._drawing.ward.member_by_name) - {group.name for group in seen}
        groups = [*seen, *(DrawingGroup(name, "") for name in sorted(missing))]
        picture = self._drawing.framed("The ward", [group.svg() for group in groups])
        moves: dict[str, list[Moment]] = {}
        contents: dict[str, list[Moment]] = {}
        drawings: dict[str, int] = {"": 0}
        for stamp, state in self._states:
            second = round((stamp - start) / SECOND, 3)
            groups = {group.name: group for group in self._drawing.groups(state)}
            for name, group in groups.items():
                if group.place is not None:
                    moves.setdefault(name, []).append((second, *group.place))
                index = drawings.setdefault(group.drawing, len(drawings))
                _add_content(contents.setdefault(name, []), second, index)
            for name in contents.keys() - groups.keys():
                _add_content(contents[name], second, 0)
        return Film(picture, {name: thinned(track) for name, track in moves.items()}, contents, tuple(drawings))


def _add_content(track: list[Moment], second: float, index: int) -> None:
    if not track or track[-1][1] != index:
        track.append((second, index))
