"""What the ward tells of itself, and what robots and nurses ask it to do."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal

import msgspec

from socialbot.core.messages import Structured

COMMANDS = "/hospital/commands"
CANCELS = "/hospital/cancels"
RESULTS = "/hospital/results"
STATE = "/hospital/state"
"""Topics of the ward."""

CORRIDOR = "corridor"
AWAY = "away"
"""Places that are no rooms: on the way, and out of the ward."""

DIRTY_ROOM = "dirty room"
CLOSED_DOOR = "closed door"
LOW_BATTERY = "low battery"
PERSON_IN_ROOM = "person in the room"
NURSE_ABSENT = "nurse absent"
PROBLEMS = (DIRTY_ROOM, CLOSED_DOOR, LOW_BATTERY, PERSON_IN_ROOM, NURSE_ABSENT)
"""Why actions fail because the ward is not as it should be."""

PARTNER_ABSENT = "partner absent"
CANCELLED = "cancelled"
"""Why else they fail; commands that make no sense fail with a sentence that says why."""

LOW_AT = 0.2
"""A battery with less than this (1 is full) is low."""

Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Seconds = Annotated[float, msgspec.Meta(ge=0.0)]


class ActionCommand(Structured, frozen=True, kw_only=True):
    """Tells a robot or a nurse what to do; ``args`` are all arguments of the action, the robot among them.

    Each partner of a joint action is commanded; it begins when both are.
    """

    id: str
    robot: str
    action: str
    args: tuple[str, ...] = ()


class ActionCancel(Structured, frozen=True, kw_only=True):
    """Takes back the command with this ``id``; nothing happens if it is done already."""

    id: str


class ActionResult(Structured, frozen=True, kw_only=True):
    """What became of a command, ``duration_s`` after it was given; every command has one result."""

    id: str
    robot: str
    action: str
    args: tuple[str, ...] = ()
    outcome: Literal["success", "failure"]
    reason: str = ""
    duration_s: Seconds = 0.0


class RoomState(msgspec.Struct, frozen=True, kw_only=True):
    """A room; ``cleaned`` is tidy, whoever is in it. ``people`` are those who do not belong there, sorted."""

    name: str
    door_open: bool
    cleaned: bool
    disinfected: bool
    people: tuple[str, ...] = ()

    @property
    def infected(self) -> bool:
        """Whether it waits to be disinfected."""
        return not self.disinfected

    @property
    def ready(self) -> bool:
        """Whether it is fit to be disinfected: tidy and empty."""
        return self.cleaned and not self.people


class AgentState(msgspec.Struct, frozen=True, kw_only=True):
    """A robot or a nurse.

    ``place`` is a room, `CORRIDOR` or `AWAY`; one that is not ``inside`` its place stands before the door. ``x`` and
    ``y`` in m, ``battery`` from 0 to 1. ``busy`` is what it does, as ``a_patrol_room(spotrobot1, room1)``, or empty.
    """

    name: str
    kind: str
    home: str
    place: str
    inside: bool
    x: float
    y: float
    battery: Share = 1.0
    busy: str = ""

    @property
    def low_battery(self) -> bool:
        """Whether it has to charge before it goes on."""
        return self.battery < LOW_AT


class WardState(Structured, frozen=True, kw_only=True, dict=True):
    """The ward as its sensors see it; a room or agent whose sensor is silent is left out."""

    rooms: tuple[RoomState, ...]
    agents: tuple[AgentState, ...]

    def room(self, name: str) -> RoomState | None:
        """The room called ``name``, if it is told of."""
        return self._room_by_name.get(name)

    def agent(self, name: str) -> AgentState | None:
        """The robot or nurse called ``name``, if it is told of."""
        return self._agent_by_name.get(name)

    @cached_property
    def _room_by_name(self) -> dict[str, RoomState]:
        return {room.name: room for room in self.rooms}

    @cached_property
    def _agent_by_name(self) -> dict[str, AgentState]:
        return {agent.name: agent for agent in self.agents}


WARD_MESSAGES: tuple[type[Structured], ...] = (ActionCommand, ActionCancel, ActionResult, WardState)
