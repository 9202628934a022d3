"""Hospital wards: rooms, staff, durations of actions, and faults."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

from socialbot.agents.base._simulation import WorldFault, parse_world_faults

SPOT = "spotrobot"
UVD = "uvdrobot"
NURSE = "nurse_disinfected"
ROBOTS = (SPOT, UVD)
"""Kinds of robots. An agent is named by its kind and a number."""

ROOM_M = (4.6, 4.0)
"""Width of a room along the corridor, and its depth."""
CORRIDOR_M = 2.4
"""Width of a corridor."""
ROOMS_A_SIDE = 9
"""Rooms on each side of a corridor of a large ward."""
ROOMS_A_DOCK = 1000
"""Largest number of rooms of a large ward for each dock. The farthest are 0.6 km from it."""

PROBLEMS = ("dirty", "closes", "drains", "enters", "leaves")
"""Kinds of faults that cause a problem in a mission."""


class Position(NamedTuple):
    """A position: x along the corridors, y across them."""

    x: float
    y: float


@dataclass(frozen=True)
class Room:
    """A room with its corner of smallest x and y. Its door leads to the corridor with its middle at ``corridor_y``."""

    name: str
    corner: Position
    corridor_y: float

    @property
    def centre(self) -> Position:
        return Position(self.corner.x + ROOM_M[0] / 2, self.corner.y + ROOM_M[1] / 2)

    @property
    def is_above(self) -> bool:
        """Whether it lies on the side of its corridor with smaller y."""
        return self.corner.y < self.corridor_y

    @property
    def door(self) -> Position:
        return Position(self.centre.x, self.corner.y + (ROOM_M[1] if self.is_above else 0.0))

    @property
    def entrance(self) -> Position:
        """Position before its door."""
        return Position(self.centre.x, self.corridor_y)

    def contains(self, point: Position) -> bool:
        """Whether a position is in the room or on its edge."""
        within = 0.0 <= point.x - self.corner.x <= ROOM_M[0]
        return within and 0.0 <= point.y - self.corner.y <= ROOM_M[1]


@dataclass(frozen=True)
class WardMember:
    """A robot or nurse, with the room where it starts."""

    name: str
    kind: str
    home: str


@dataclass(frozen=True)
class Ward:
    """The static description of a ward.

    ``closed`` are the doors that are closed at the start. ``infections`` are times (s) with rooms that need
    disinfection from then on. The problem of an infection is a fault of a kind in ``problems``. It appears
    ``window_s`` (first, last) after the infection, but not before the start. Robots charge in ``docks``, which are
    rooms whose doors are always open. ``spine_x`` is the corridor that joins the others.
    """

    name: str
    rooms: tuple[Room, ...]
    members: tuple[WardMember, ...]
    docks: tuple[str, ...]
    closed: frozenset[str]
    infections: tuple[tuple[float, str], ...]
    problems: tuple[str, ...] = PROBLEMS
    window_s: tuple[float, float] = (0.0, 0.0)
    spine_x: float = 0.0

    @cached_property
    def room_by_name(self) -> dict[str, Room]:
        return {room.name: room for room in self.rooms}

    @cached_property
    def member_by_name(self) -> dict[str, WardMember]:
        return {member.name: member for member in self.members}

    @cached_property
    def nurse_by_room(self) -> dict[str, str]:
        """The first nurse at home in each room."""
        return {member.home: member.name for member in reversed(self.members) if member.kind == NURSE}

    def of_kind(self, kind: str) -> tuple[str, ...]:
        """Names of the members of one kind."""
        return tuple(member.name for member in self.members if member.kind == kind)

    @cached_property
    def robots(self) -> tuple[str, ...]:
        """Names of all robots."""
        return tuple(member.name for member in self.members if member.kind in ROBOTS)

    def room_at(self, point: Position) -> str:
        """The room at a position; an empty string for a corridor."""
        near = self._rooms_by_row.get(math.floor(point.y / ROOM_M[1]), ())
        return next((room.name for room in near if room.contains(point)), "")

    @cached_property
    def _rooms_by_row(self) -> dict[int, list[Room]]:
        """Rooms that touch a strip along the corridors, as deep as a room, by its number."""
        found: dict[int, list[Room]] = {}
        for room in self.rooms:
            first, last = (math.floor(y / ROOM_M[1]) for y in (room.corner.y, room.corner.y + ROOM_M[1]))
            for row in range(first, last + 1):
                found.setdefault(row, []).append(room)
        return found

    def way(self, start: Position, room: str, target: str) -> tuple[Position, ...]:
        """The path from ``start`` (in ``room``, or in a corridor if that is empty) to the entrance of ``target``."""
        points = [start]
        if room:
            points += [self.room_by_name[room].door, self.room_by_name[room].entrance]
        elif start.x != self.spine_x:
            points.append(Position(start.x, min(self.corridor_ys, key=lambda y: abs(y - start.y))))
        end = self.room_by_name[target].entrance
        if points[-1].y != end.y:
            points += [Position(self.spine_x, points[-1].y), Position(self.spine_x, end.y)]
        points.append(end)
        return tuple(points[:1] + [there for here, there in pairwise(points) if here != there])

    def way_to_dock(self, start: Position, room: str) -> tuple[str, tuple[Position, ...]]:
        """The nearest dock, and the path to its entrance; see `way`."""
        ways = [(dock, self.way(start, room, dock)) for dock in self.docks]
        return min(ways, key=lambda way: length(way[1]))

    @cached_property
    def corridor_ys(self) -> tuple[float, ...]:
        """The y of the middle of each corridor, sorted."""
        return tuple(sorted({room.corridor_y for room in self.rooms}))


def length(points: tuple[Position, ...]) -> float:
    """Length of a path, m."""
    return sum(math.dist(here, there) for here, there in pairwise(points))


@dataclass
class Journey:
    """Movement along ``points`` from ``begin`` to ``end`` (ns)."""

    points: tuple[Position, ...]
    begin: int
    end: int

    def made(self, time: int) -> float:
        """Distance covered at ``time``, m."""
        if time >= self.end:
            return length(self.points)
        return length(self.points) * max(time - self.begin, 0) / (self.end - self.begin)

    def left(self, time: int) -> tuple[Position, ...]:
        """The rest of the path at ``time``."""
        if time >= self.end:
            return self.points[-1:]
        made = self.made(time)
        for number, (here, there) in enumerate(pairwise(self.points), start=1):
            whole = math.dist(here, there)
            if made < whole:
                share = made / whole
                turned = Position(here.x + (there.x - here.x) * share, here.y + (there.y - here.y) * share)
                return (turned, *self.points[number:])
            made -= whole
        return self.points[-1:]


def paper_ward() -> Ward:
    """The ward of the paper: a nurse in the first of four rooms, with a closed door, and both robots in the last.

    The first room needs disinfection after 1 s. Its problem, if any, is dirt from the start.
    """
    members = (
        WardMember(f"{NURSE}1", NURSE, "room1"),
        WardMember(f"{SPOT}1", SPOT, "room4"),
        WardMember(f"{UVD}1", UVD, "room4"),
    )
    return Ward(
        name="paper",
        rooms=tuple(_rooms(4, 2)),
        members=members,
        docks=("room4",),
        closed=frozenset({"room1"}),
        infections=((1.0, "room1"),),
        problems=("dirty",),
        window_s=(-1.0, -1.0),
        spine_x=0.0,
    )


def large_ward(rooms: int = 50, spots: int = 4, uvds: int = 4, nurses: int = 0, *, every_s: float = 3.0) -> Ward:
    """A ward of many rooms, with a nurse in each of the first ``nurses`` rooms (0: in each).

    There is a dock for each `ROOMS_A_DOCK` rooms or part of them; the robots of each kind start in all of them.
    Every ``every_s`` from 1 s on, another room with a nurse needs disinfection, always in the same order. A third of
    the doors is closed. Raises ValueError for a ward without rooms, or a negative number.
    """
    nurses = nurses or rooms
    if not (1 <= nurses <= rooms and spots >= 0 and uvds >= 0 and every_s >= 0.0):
        raise ValueError(f"cannot build a ward of {rooms} rooms, {spots} spots, {uvds} uvds and {nurses} nurses")
    count = math.ceil(rooms / ROOMS_A_DOCK)
    places = list(_rooms(rooms + count, ROOMS_A_SIDE))
    # From the last one, as each leaves the places before it where they are.
    ends = [places.pop((rooms + count) * number // count - 1) for number in range(count, 0, -1)]
    names = ["dock", *(f"dock{number}" for number in range(2, count + 1))]
    docks = [replace(place, name=name) for name, place in zip(names, reversed(ends), strict=True)]
    plain = [replace(place, name=f"room{number}") for number, place in enumerate(places, start=1)]
    order = [room.name for room in plain[:nurses]]
    members = [WardMember(f"{NURSE}{number}", NURSE, room) for number, room in enumerate(order, start=1)]
    for kind, robots in ((SPOT, spots), (UVD, uvds)):
        members += [
            WardMember(f"{kind}{number + 1}", kind, docks[number * count // robots].name) for number in range(robots)
        ]
    random.Random("the order of infections").shuffle(order)
    return Ward(
        name="large",
        rooms=(*plain, *docks),
        members=tuple(members),
        docks=tuple(dock.name for dock in docks),
        closed=frozenset(room.name for room in plain[::3]),
        infections=tuple((1.0 + number * every_s, room) for number, room in enumerate(order)),
        window_s=(0.0, 10.0),
        spine_x=-CORRIDOR_M / 2,
    )


def _rooms(count: int, a_side: int) -> Iterator[Room]:
    """Rooms on both sides of parallel corridors."""
    width, depth = ROOM_M
    for number in range(count):
        corridor, place = divmod(number, 2 * a_side)
        side, column = divmod(place, a_side)
        top = corridor * (2 * depth + CORRIDOR_M + 0.4)
        y = top + (side and depth + CORRIDOR_M)
        yield Room(f"room{number + 1}", Position(column * width, y), top + depth + CORRIDOR_M / 2)


ROLES: dict[str, tuple[str, ...]] = {
    "a_navigate_to": ("agent", "room"),
    "a_open_door": ("agent", "room"),
    "a_approach_nurse": (SPOT, NURSE),
    "a_authenticate_nurse": (SPOT, NURSE),
    "a_authorize_patrol": (SPOT, NURSE),
    "a_patrol_room": (SPOT, "room"),
    "a_adapt_room": (NURSE, "room"),
    "a_authorize_disinfect": (UVD, SPOT),
    "a_disinfect_room": (UVD, "room"),
    "a_charge": ("robot",),
    "a_infected_room": (NURSE, "room"),
}
"""Arguments of the actions: a kind of agent, any ``agent``, any ``robot``, or a ``room``."""
JOINT_ACTIONS = frozenset({"a_authenticate_nurse", "a_authorize_patrol", "a_authorize_disinfect"})
"""Actions of both agents in their arguments. The first argument executes any other action."""
POWERED = frozenset({"a_navigate_to", "a_patrol_room", "a_disinfect_room"})
"""Actions that a robot with a low battery cannot execute."""
ANYWHERE = frozenset({"a_navigate_to", "a_charge", "a_authorize_disinfect", "a_infected_room"})
"""Actions that do not take place in a room."""
EFFECTS: dict[str, dict[str, Any]] = {
    "a_open_door": {"door_open": True},
    "a_adapt_room": {"cleaned": True, "people": ()},
    "a_disinfect_room": {"disinfected": True},
    "a_infected_room": {"disinfected": False},
}
"""Changes of the room by a finished action."""


@dataclass(frozen=True)
class ActionDurations:
    """Durations and power use of actions.

    ``speed`` is in m/s. ``seconds`` are the durations of actions without the path to their room; ``a_charge`` is a
    charge from empty to full. A full battery holds 1. It loses ``battery_per_m`` of a path, and ``battery_of`` an
    action when that is done.
    """

    speed: float
    seconds: Mapping[str, float] = field(default_factory=dict)
    battery_per_m: float = 0.001
    battery_of: Mapping[str, float] = field(default_factory=lambda: {"a_patrol_room": 0.01, "a_disinfect_room": 0.04})


PAPER = ActionDurations(
    speed=10.0,
    seconds={
        "a_open_door": 0.2,
        "a_approach_nurse": 0.04,
        "a_authenticate_nurse": 0.04,
        "a_authorize_patrol": 0.04,
        "a_patrol_room": 0.06,
        "a_adapt_room": 0.1,
        "a_authorize_disinfect": 0.04,
        "a_disinfect_room": 0.6,
        "a_charge": 3.0,
        "a_infected_room": 1.0,
    },
)
"""Durations of the paper's simulation: a mission takes 4.2 s, 1 s of it the nurse's; dirt 0.3 s more."""

INSTANT = ActionDurations(speed=math.inf, seconds={"a_infected_room": 1.0})
"""Durations of the paper's predecessor: only the nurse takes time."""

CLINIC = ActionDurations(
    speed=1.0,
    seconds={
        "a_open_door": 5.0,
        "a_approach_nurse": 2.0,
        "a_authenticate_nurse": 4.0,
        "a_authorize_patrol": 3.0,
        "a_patrol_room": 20.0,
        "a_adapt_room": 60.0,
        "a_authorize_disinfect": 2.0,
        "a_disinfect_room": 300.0,
        "a_charge": 1800.0,
        "a_infected_room": 1.0,
    },
)
"""Realistic durations: slow robots, and minutes of light."""

DURATIONS: Mapping[str, ActionDurations] = {"paper": PAPER, "instant": INSTANT, "clinic": CLINIC}


STATE_SENSOR = "state"
"""Name that stands for all sensors of the ward."""
SLOW_S = 2.0
"""Period of a slow sensor."""

STAY_S = (5.0, 15.0)
"""Shortest and longest stay of a person in a room, and absence of a nurse."""


def parse_faults(text: str, ward: Ward) -> tuple[WorldFault, ...]:
    """Parse the faults of a ward. Raises ParameterError.

    Kinds: a room gets ``dirty``, its door ``closes``, the battery of a robot ``drains``. For a duration a person
    ``enters`` a room, a nurse ``leaves`` the ward, a robot or nurse ``stalls``. The sensor of a room, robot or nurse,
    or `STATE_SENSOR`, is ``silent`` for a duration, or ``slow``: it updates every `SLOW_S`.
    """
    rooms, members = ward.room_by_name, ward.member_by_name
    sensors = {*rooms, *members, STATE_SENSOR}
    targets = {
        **dict.fromkeys(("dirty", "closes", "enters"), rooms),
        **dict.fromkeys(("silent", "slow"), sensors),
        "drains": ward.robots,
        "leaves": ward.of_kind(NURSE),
        "stalls": members,
    }
    examples = (
        "2 dirty room1; 3 closes room2; 4 drains spotrobot1; 5 enters room1 10; "
        "6 leaves nurse_disinfected1 10; 7 silent uvdrobot1 5; 8 slow state 5; 9 stalls uvdrobot1 3"
    )
    return parse_world_faults(text, targets, ("enters", "leaves", "stalls", "silent", "slow"), examples)


def drawn_problems(ward: Ward, seed: int, rate: float) -> tuple[WorldFault, ...]:
    """Problems of the infections of one run, sorted by time: each infection has one with ``rate`` per cent.

    They depend on the seed only, not on commands.
    """
    chance = random.Random(f"problems {seed}")
    found = []
    for time_s, room in ward.infections:
        [meets] = chance.choices((False, True), weights=(100.0 - rate, rate))
        problem = _problem(ward, room, chance, time_s)
        if meets:
            found.append(problem)
    return tuple(sorted(found, key=lambda fault: (fault.time_s, fault.kind, fault.target)))


def _problem(ward: Ward, room: str, chance: random.Random, infected_s: float) -> WorldFault:
    """A problem of the mission in ``room``; a low battery may be that of any robot."""
    time_s = max(round(infected_s + chance.uniform(*ward.window_s), 2), 0.0)
    stay_s = round(chance.uniform(*STAY_S), 1)
    robot = chance.choice(ward.robots or ("",))
    nurse = ward.nurse_by_room.get(room, "")
    targets = {"dirty": room, "closes": room, "drains": robot, "enters": room, "leaves": nurse}
    kind = chance.choice([kind for kind in ward.problems if targets[kind]])
    return WorldFault(time_s, kind, targets[kind], stay_s if kind in ("enters", "leaves") else None)
