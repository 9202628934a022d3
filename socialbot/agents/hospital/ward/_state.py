"""State of rooms, robots and nurses in a simulated ward, their movements and activities."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field

from socialbot.agents.hospital.ward.messages import AgentState, RoomState
from socialbot.agents.hospital.ward.ward import JOINT, Position, WardMember, length


@dataclass
class Journey:
    """Movement along ``points`` from ``begin`` to ``end`` (ns)."""

    points: tuple[Position, ...]
    begin: int
    end: int

    def position(self, time: int) -> Position:
        if time >= self.end:
            return self.points[-1]
        return self.left(time)[0]

    def made(self, time: int) -> float:
        """Distance covered at ``time``, m."""
        if time >= self.end:
            return length(self.points)
        return length(self.points) * max(time - self.begin, 0) / (self.end - self.begin)

    def left(self, time: int) -> tuple[Position, ...]:
        """The rest of the path at ``time``."""
        made = self.made(time)
        for number, (here, there) in enumerate(itertools.pairwise(self.points), start=1):
            whole = math.dist(here, there)
            if made < whole:
                share = made / whole
                turned = Position(here.x + (there.x - here.x) * share, here.y + (there.y - here.y) * share)
                return (turned, *self.points[number:])
            made -= whole
        return self.points[-1:]


@dataclass
class Activity:
    """An action in progress, or one that waits for a partner.

    ``ids`` are the id and time (ns) of the command, by agent.
    """

    action: str
    args: tuple[str, ...]
    ids: dict[str, tuple[str, int]]
    due: int = -1
    then: Callable[[], None] = lambda: None
    over: bool = False

    @property
    def waits(self) -> bool:
        return self.action in JOINT and len(self.ids) < len(self.args)

    def __str__(self) -> str:
        return f"{self.action}({', '.join(self.args)})"


@dataclass
class WardAgent:
    """State of a robot or a nurse."""

    member: WardMember
    place: str
    position: Position
    chance: random.Random
    inside: bool = True
    battery: float = 1.0
    activity: Activity | None = None
    journey: Journey | None = None
    _shown: tuple[tuple[object, ...], AgentState] | None = None
    """Last value of its sensor, with its inputs."""

    def at(self, time: int) -> Position:
        return self.journey.position(time) if self.journey else self.position

    def state(self, time: int) -> AgentState:
        """Value of its sensor: the same object as long as nothing changes."""
        position = self.at(time)
        because = (self.place, self.inside, position, self.battery, self.activity)
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
                busy=str(self.activity or ""),
            )
            self._shown = because, state
        return self._shown[1]


@dataclass
class RoomModel:
    """State of a room."""

    door_open: bool = True
    cleaned: bool = True
    disinfected: bool = True
    people: list[str] = field(default_factory=list)
    _shown: tuple[tuple[object, ...], RoomState] | None = None
    """Last value of its sensor, with its inputs."""

    def state(self, name: str) -> RoomState:
        """Value of the sensor of this room: the same object as long as nothing changes."""
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
