"""Topics of a hospital, and the state of its ward."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, TypeVar

import msgspec

from socialbot.core.messages import Structured

MESSAGES = "/hospital/messages"
MISSIONS = "/hospital/missions"
COMMANDS = "/hospital/commands"
CANCELS = "/hospital/cancels"
RESULTS = "/hospital/results"
STATE = "/hospital/state"

CORRIDOR = "corridor"
AWAY = "away"
"""Places outside rooms: in the ward, and outside the ward."""

DIRTY_ROOM = "dirty room"
CLOSED_DOOR = "closed door"
LOW_BATTERY = "low battery"
PERSON_IN_ROOM = "person in the room"
NURSE_ABSENT = "nurse absent"
"""Reasons of failures that are due to the state of the ward. For an invalid command the reason is a sentence."""

LOW_AT = 0.2
"""Charge below which a battery is low; 1 is full."""

Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class RoomState(msgspec.Struct, frozen=True, kw_only=True):
    """State of a room. ``cleaned`` is tidy, with or without people. ``people`` are sorted names of visitors."""

    name: str
    door_open: bool
    cleaned: bool
    disinfected: bool
    people: tuple[str, ...] = ()

    @property
    def infected(self) -> bool:
        return not self.disinfected

    @property
    def ready(self) -> bool:
        """Whether it is fit for disinfection: tidy and empty."""
        return self.cleaned and not self.people


class AgentState(msgspec.Struct, frozen=True, kw_only=True):
    """State of a robot or nurse.

    ``place`` is a room, `CORRIDOR` or `AWAY`. An agent that is not ``inside`` stands before the door. ``x`` and ``y``
    are in m, ``battery`` is 0 to 1. ``busy`` is its action, as ``a_patrol_room(spotrobot1, room1)``, or empty.
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
        return self.battery < LOW_AT


class WardState(Structured, frozen=True, kw_only=True, dict=True):
    """State of the ward by its sensors, without the rooms and agents of silent sensors."""

    rooms: tuple[RoomState, ...]
    agents: tuple[AgentState, ...]

    def room(self, name: str) -> RoomState | None:
        return _found(self.rooms, name) or self._room_by_name.get(name)

    def agent(self, name: str) -> AgentState | None:
        return _found(self.agents, name) or self._agent_by_name.get(name)

    @cached_property
    def _room_by_name(self) -> dict[str, RoomState]:
        return _by_name(self.rooms)

    @cached_property
    def _agent_by_name(self) -> dict[str, AgentState]:
        return _by_name(self.agents)


_PLACES: dict[str, int] = {}
"""Places of rooms and agents by name in earlier states, where a state is looked at first."""

Named = TypeVar("Named", RoomState, AgentState)


def _found(values: tuple[Named, ...], name: str) -> Named | None:
    place = _PLACES.get(name, len(values))
    return values[place] if place < len(values) and values[place].name == name else None


def _by_name(values: tuple[Named, ...]) -> dict[str, Named]:
    _PLACES.update((value.name, place) for place, value in enumerate(values))
    return {value.name: value for value in values}


WARD_MESSAGES: tuple[type[Structured], ...] = (WardState,)
