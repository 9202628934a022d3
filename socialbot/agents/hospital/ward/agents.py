"""Who does what in the ward: robots and nurses as they are now, their ways, and the actions they know."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field

from socialbot.agents.hospital.ward.messages import AgentState, RoomState
from socialbot.agents.hospital.ward.ward import NURSE, SPOT, UVD, Member, Point, length

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
"""What the arguments of each action have to be: a kind of agent, any ``agent``, any ``robot``, a ``room``."""
JOINT = frozenset({"a_authenticate_nurse", "a_authorize_patrol", "a_authorize_disinfect"})
"""Actions of both their arguments; all others are those of the first."""
POWERED = frozenset({"a_navigate_to", "a_patrol_room", "a_disinfect_room"})
"""What a robot does not do with a low battery."""


@dataclass
class Journey:
    """A way along ``points`` from ``begin`` to ``end`` (ns)."""

    points: tuple[Point, ...]
    begin: int
    end: int

    def position(self, time: int) -> Point:
        """Where one is at ``time``."""
        if time >= self.end:
            return self.points[-1]
        return self.left(time)[0]

    def made(self, time: int) -> float:
        """How much of the way is made at ``time``, m."""
        if time >= self.end:
            return length(self.points)
        return length(self.points) * max(time - self.begin, 0) / (self.end - self.begin)

    def left(self, time: int) -> tuple[Point, ...]:
        """The rest of the way at ``time``."""
        made = self.made(time)
        for number, (here, there) in enumerate(itertools.pairwise(self.points), start=1):
            whole = math.dist(here, there)
            if made < whole:
                share = made / whole
                turned = Point(here.x + (there.x - here.x) * share, here.y + (there.y - here.y) * share)
                return (turned, *self.points[number:])
            made -= whole
        return self.points[-1:]


@dataclass
class Task:
    """An action under way, or one that waits for a partner. ``ids`` are command and time (ns) by who was told."""

    action: str
    args: tuple[str, ...]
    ids: dict[str, tuple[str, int]]
    due: int = -1
    then: Callable[[], None] = lambda: None
    over: bool = False

    @property
    def waits(self) -> bool:
        """Whether a partner is still missing."""
        return self.action in JOINT and len(self.ids) < len(self.args)

    def __str__(self) -> str:
        return f"{self.action}({', '.join(self.args)})"


@dataclass
class Agent:
    """A robot or a nurse as it is now."""

    member: Member
    place: str
    position: Point
    chance: random.Random
    inside: bool = True
    battery: float = 1.0
    task: Task | None = None
    journey: Journey | None = None
    _shown: tuple[tuple[object, ...], AgentState] | None = None
    """What its sensor said last, and because of what."""

    def at(self, time: int) -> Point:
        """Where it is."""
        return self.journey.position(time) if self.journey else self.position

    def state(self, time: int) -> AgentState:
        """What its sensor says; the very same as before if that has not changed, as it mostly has not."""
        position = self.at(time)
        because = (self.place, self.inside, position, self.battery, self.task)
        if self._shown is None or self._shown[0] != because:
            state = AgentState(
                name=self.member.name,
                kind=self.member.kind,
                home=self.member.home,
                place=self.place,
                inside=self.inside,
                x=round(position.x, 3),
                y=round(position.y, 3),
                battery=round(self.battery, 4),
                busy=str(self.task or ""),
            )
            self._shown = because, state
        return self._shown[1]


@dataclass
class RoomNow:
    """A room as it is now."""

    door_open: bool = True
    cleaned: bool = True
    disinfected: bool = True
    people: list[str] = field(default_factory=list)
    _shown: tuple[tuple[object, ...], RoomState] | None = None
    """What its sensor said last, and because of what."""

    def state(self, name: str) -> RoomState:
        """What the sensor of the room called ``name`` says; the very same as before if that has not changed."""
        because = (name, self.door_open, self.cleaned, self.disinfected, *self.people)
        if self._shown is None or self._shown[0] != because:
            state = RoomState(
                name=name,
                door_open=self.door_open,
                cleaned=self.cleaned,
                disinfected=self.disinfected,
                people=tuple(sorted(self.people)),
            )
            self._shown = because, state
        return self._shown[1]
