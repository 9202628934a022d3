"""Hospital wards: rooms, staff, durations of actions, and faults."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Literal, NamedTuple

from socialbot.agents.hospital.ward.messages import (
    CLOSED_DOOR,
    DIRTY_ROOM,
    LOW_BATTERY,
    NURSE_ABSENT,
    PERSON_IN_ROOM,
    PROBLEMS,
)
from socialbot.core.errors import ParameterError

SPOT = "spotrobot"
UVD = "uvdrobot"
NURSE = "nurse_disinfected"
ROBOTS = (SPOT, UVD)
"""Kinds of agents; they are called by their kind and a number."""

ROOM_M = (4.6, 4.0)
"""Width of a room along the corridor, and its depth."""
CORRIDOR_M = 2.4
"""Width of a corridor."""
ROOMS_A_SIDE = 9
"""Rooms on either side of one corridor of a large ward."""


class Position(NamedTuple):
    """A position: x along the corridors, y across them."""

    x: float
    y: float


@dataclass(frozen=True)
class Room:
    """A room with its corner of smallest x and y; its door leads to the corridor whose middle is at ``corridor_y``."""

    name: str
    corner: Position
    corridor_y: float

    @property
    def centre(self) -> Position:
        """Its middle."""
        return Position(self.corner.x + ROOM_M[0] / 2, self.corner.y + ROOM_M[1] / 2)

    @property
    def is_above(self) -> bool:
        """Whether it lies on that side of its corridor where y is smaller."""
        return self.corner.y < self.corridor_y

    @property
    def door(self) -> Position:
        """The middle of its door."""
        return Position(self.centre.x, self.corner.y + (ROOM_M[1] if self.is_above else 0.0))

    @property
    def entrance(self) -> Position:
        """Where one stands before its door."""
        return Position(self.centre.x, self.corridor_y)

    def contains(self, point: Position) -> bool:
        """Whether ``point`` is in the room or on its edge."""
        within = 0.0 <= point.x - self.corner.x <= ROOM_M[0]
        return within and 0.0 <= point.y - self.corner.y <= ROOM_M[1]


@dataclass(frozen=True)
class WardMember:
    """A robot or nurse, and the room it belongs to, where it begins."""

    name: str
    kind: str
    home: str


@dataclass(frozen=True)
class Ward:
    """All that does not change.

    ``closed`` doors are those at the start. ``infections`` are rooms that come to need disinfection, and when (s).
    When an infection meets a problem, that is of one of the ``problems`` and appears ``window_s`` (first, last) after
    the infection, but not before the start.
    """

    name: str
    rooms: tuple[Room, ...]
    members: tuple[WardMember, ...]
    dock: str
    closed: frozenset[str]
    infections: tuple[tuple[float, str], ...]
    problems: tuple[str, ...] = PROBLEMS
    window_s: tuple[float, float] = (0.0, 0.0)
    spine_x: float = field(default=0.0)
    """Where the corridor runs that joins the others."""

    @cached_property
    def room_by_name(self) -> dict[str, Room]:
        """The rooms by name."""
        return {room.name: room for room in self.rooms}

    @cached_property
    def member_by_name(self) -> dict[str, WardMember]:
        """The robots and nurses by name."""
        return {member.name: member for member in self.members}

    def of_kind(self, kind: str) -> tuple[str, ...]:
        """The names of all of one kind."""
        return tuple(member.name for member in self.members if member.kind == kind)

    @property
    def robots(self) -> tuple[str, ...]:
        """The names of all robots."""
        return tuple(member.name for member in self.members if member.kind in ROBOTS)

    def room_at(self, point: Position) -> str:
        """The room that ``point`` lies in, or an empty string."""
        return next((room.name for room in self.rooms if room.contains(point)), "")

    def way(self, start: Position, room: str, target: str) -> tuple[Position, ...]:
        """The way from ``start``, in ``room`` or (empty) a corridor, to the place before the door of ``target``."""
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

    @cached_property
    def corridor_ys(self) -> tuple[float, ...]:
        """The middle of each corridor, from the smallest."""
        return tuple(sorted({room.corridor_y for room in self.rooms}))

    def distance(self, start: str, target: str) -> float:
        """How far it is from the middle of one room to the middle of another, m."""
        if start == target:
            return 0.0
        end = self.room_by_name[target]
        points = self.way(self.room_by_name[start].centre, start, target)
        return length((*points, end.door, end.centre))


def length(points: tuple[Position, ...]) -> float:
    """The length of a way, m."""
    return sum(math.dist(here, there) for here, there in pairwise(points))


def paper_ward() -> Ward:
    """The ward of the paper: a nurse in the first of four rooms, whose door is closed; both robots wait in the last.

    The first room comes to need disinfection after 1 s; whether it is dirty is drawn at the start.
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
        dock="room4",
        closed=frozenset({"room1"}),
        infections=((1.0, "room1"),),
        problems=(DIRTY_ROOM,),
        window_s=(-1.0, -1.0),
        spine_x=0.0,
    )


def large_ward(rooms: int = 50, spots: int = 4, uvds: int = 4, nurses: int = 0, *, every_s: float = 3.0) -> Ward:
    """A ward of many rooms and a dock, with a nurse in each of the first rooms (0: in each).

    Each room with a nurse comes to need disinfection, one each ``every_s`` from 1 s on, in an order that is always the
    same; a third of the doors is closed. Raises ValueError where there is no room or a negative number.
    """
    nurses = nurses or rooms
    if not (1 <= nurses <= rooms and spots >= 0 and uvds >= 0 and every_s >= 0.0):
        raise ValueError(f"no ward of {rooms} rooms, {spots} spots, {uvds} uvds and {nurses} nurses")
    *plain, last = _rooms(rooms + 1, ROOMS_A_SIDE)
    order = [room.name for room in plain[:nurses]]
    members = [WardMember(f"{NURSE}{number}", NURSE, room) for number, room in enumerate(order, start=1)]
    for kind, count in ((SPOT, spots), (UVD, uvds)):
        members += [WardMember(f"{kind}{number}", kind, "dock") for number in range(1, count + 1)]
    random.Random("the order of infections").shuffle(order)
    return Ward(
        name="large",
        rooms=(*plain, Room("dock", last.corner, last.corridor_y)),
        members=tuple(members),
        dock="dock",
        closed=frozenset(room.name for room in plain[::3]),
        infections=tuple((1.0 + number * every_s, room) for number, room in enumerate(order)),
        window_s=(0.0, 10.0),
        spine_x=-CORRIDOR_M / 2,
    )


def _rooms(count: int, a_side: int) -> Iterator[Room]:
    """Rooms on both sides of as many corridors as it takes."""
    width, depth = ROOM_M
    for number in range(count):
        corridor, place = divmod(number, 2 * a_side)
        side, column = divmod(place, a_side)
        top = corridor * (2 * depth + CORRIDOR_M + 0.4)
        y = top + (side and depth + CORRIDOR_M)
        yield Room(f"room{number + 1}", Position(column * width, y), top + depth + CORRIDOR_M / 2)


AT_ONCE = 0.0


@dataclass(frozen=True)
class ActionDurations:
    """``speed`` in m/s, ``seconds`` of each action without the way to it, ``a_charge`` from empty to full.

    Batteries hold 1; they lose ``battery_per_m`` of the way and ``battery_of`` each action done.
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
"""As in the paper's simulation: its mission takes 4.2 s, of which the nurse takes the first, and 0.3 s more when the
room is dirty."""

INSTANT = ActionDurations(speed=math.inf, seconds={"a_infected_room": 1.0})
"""As in the simulation of the paper's predecessor: only the nurse takes time."""

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
"""As robots that stroll and light that takes minutes would do it."""

DURATIONS: Mapping[str, ActionDurations] = {"paper": PAPER, "instant": INSTANT, "clinic": CLINIC}
"""The paces by name."""


FaultKind = Literal["dirty", "closes", "drains", "enters", "leaves", "silent", "slow", "stalls"]

STATE_SENSOR = "state"
"""All sensors of the ward at once."""
SLOW_S = 2.0
"""A slow sensor looks this seldom."""

PROBLEM_OF: dict[FaultKind, str] = {
    "dirty": DIRTY_ROOM,
    "closes": CLOSED_DOOR,
    "drains": LOW_BATTERY,
    "enters": PERSON_IN_ROOM,
    "leaves": NURSE_ABSENT,
}
"""The problem that actions meet after a fault of that kind."""

STAY_S = (5.0, 15.0)
"""How long a person who walks in stays, and a nurse who is called away, at least and at most."""

_REMEDY = (
    "write faults as: 2 dirty room1; 3 closes room2; 4 drains spotrobot1; 5 enters room1 10; "
    "6 leaves nurse_disinfected1 10; 7 silent uvdrobot1 5; 8 slow state 5; 9 stalls uvdrobot1 3"
)


@dataclass(frozen=True, slots=True)
class WardFault:
    """Something that goes wrong at ``time_s`` (s from the start of the world).

    A room gets ``dirty``, its door ``closes``; the battery of a robot ``drains``. For ``duration_s`` a person
    ``enters`` a room, a nurse ``leaves`` the ward, a robot or nurse ``stalls``. The sensor of a room, robot or nurse,
    or `STATE_SENSOR`, is ``silent`` for so long, or ``slow``: it tells of what was up to `SLOW_S` ago.
    """

    time_s: float
    kind: FaultKind
    who: str
    duration_s: float = 0.0

    def __str__(self) -> str:
        lasting = [] if self.kind in ("dirty", "closes", "drains") else [_written(self.duration_s)]
        return " ".join([_written(self.time_s), self.kind, self.who, *lasting])


def parse_faults(text: str, ward: Ward) -> tuple[WardFault, ...]:
    """The faults that ``text`` lists, separated by semicolons. Raises ParameterError."""
    return tuple(_fault(part.split(), ward) for part in text.split(";") if part.strip())


def _fault(words: list[str], ward: Ward) -> WardFault:
    rooms, members = ward.room_by_name, ward.member_by_name
    try:
        match words:
            case time, ("dirty" | "closes") as kind, room if room in rooms:
                return WardFault(_seconds(time), kind, room)
            case time, "drains", robot if robot in ward.robots:
                return WardFault(_seconds(time), "drains", robot)
            case time, "enters", room, duration if room in rooms:
                return WardFault(_seconds(time), "enters", room, _seconds(duration))
            case time, "leaves", nurse, duration if nurse in ward.of_kind(NURSE):
                return WardFault(_seconds(time), "leaves", nurse, _seconds(duration))
            case time, "stalls", who, duration if who in members:
                return WardFault(_seconds(time), "stalls", who, _seconds(duration))
            case time, ("silent" | "slow") as kind, who, duration if who in {*rooms, *members, STATE_SENSOR}:
                return WardFault(_seconds(time), kind, who, _seconds(duration))
    except ValueError as error:
        raise ParameterError(f"no time in s: {error}", where=f"fault {' '.join(words)!r}", remedy=_REMEDY) from error
    raise ParameterError(f"no fault: {' '.join(words)!r}", where="faults", remedy=_REMEDY)


def _written(seconds: float) -> str:
    return str(seconds).removesuffix(".0")


def _seconds(word: str) -> float:
    seconds = float(word)
    if not 0.0 <= seconds <= 1e6:
        raise ValueError(f"{word} is not between 0 and 1000000")
    return seconds


def drawn_problems(ward: Ward, seed: int, rate: float) -> tuple[WardFault, ...]:
    """What the missions of one run meet: of ``rate`` per cent of the infections, each by itself, one problem.

    It is the same for the same seed, and no command changes it. Sorted by time.
    """
    chance = random.Random(f"problems {seed}")
    found = []
    for time_s, room in ward.infections:
        [meets] = chance.choices((False, True), weights=(100.0 - rate, rate))
        problem = _problem(ward, room, chance, time_s)
        if meets:
            found.append(problem)
    return tuple(sorted(found, key=lambda fault: (fault.time_s, fault.kind, fault.who)))


def _problem(ward: Ward, room: str, chance: random.Random, infected_s: float) -> WardFault:
    """A problem of the mission in ``room``; a low battery may be that of any robot."""
    time_s = max(round(infected_s + chance.uniform(*ward.window_s), 2), 0.0)
    stay_s = round(chance.uniform(*STAY_S), 1)
    robot = chance.choice(ward.robots or ("",))
    nurse = next((member.name for member in ward.members if (member.kind, member.home) == (NURSE, room)), "")
    could = {
        DIRTY_ROOM: WardFault(time_s, "dirty", room),
        CLOSED_DOOR: WardFault(time_s, "closes", room),
        PERSON_IN_ROOM: WardFault(time_s, "enters", room, stay_s),
        **({LOW_BATTERY: WardFault(time_s, "drains", robot)} if robot else {}),
        **({NURSE_ABSENT: WardFault(time_s, "leaves", nurse, stay_s)} if nurse else {}),
    }
    kinds = [kind for kind in ward.problems if kind in could]
    return could[chance.choice(kinds)] if kinds else could[DIRTY_ROOM]


def random_faults(ward: Ward, seed: int, *, until_s: float = 60.0) -> tuple[WardFault, ...]:
    """One to six faults of any kind before ``until_s``, in the order of their times; the same for the same seed."""
    chance = random.Random(f"faults {seed}")
    rooms, members = list(ward.room_by_name), list(ward.member_by_name)
    robots, nurses = ward.robots, ward.of_kind(NURSE)
    kinds: list[FaultKind] = ["dirty", "closes", "enters", "silent", "slow", "stalls"]
    if robots:
        kinds.append("drains")
    if nurses:
        kinds.append("leaves")
    found = []
    for _ in range(chance.randint(1, 6)):
        time_s, duration_s = round(chance.uniform(0.0, until_s), 1), round(chance.uniform(1.0, 15.0), 1)
        kind = chance.choice(kinds)
        match kind:
            case "dirty" | "closes":
                found.append(WardFault(time_s, kind, chance.choice(rooms)))
            case "drains":
                found.append(WardFault(time_s, kind, chance.choice(robots)))
            case "enters":
                found.append(WardFault(time_s, kind, chance.choice(rooms), duration_s))
            case "leaves":
                found.append(WardFault(time_s, kind, chance.choice(nurses), duration_s))
            case "stalls":
                found.append(WardFault(time_s, kind, chance.choice(members), duration_s))
            case _:
                found.append(WardFault(time_s, kind, chance.choice([*rooms, *members, STATE_SENSOR]), duration_s))
    return tuple(sorted(found, key=lambda fault: (fault.time_s, fault.kind, fault.who)))
