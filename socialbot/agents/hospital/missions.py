"""Missions of the hospital: which kinds there are, whom they need, how they are directed, how far one has come."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import msgspec

from socialbot.agents.hospital.disinfect import mission as disinfection
from socialbot.agents.hospital.messages import MissionStatus, PlannedAction, Problem
from socialbot.agents.hospital.ward.messages import (
    CLOSED_DOOR,
    CORRIDOR,
    DIRTY_ROOM,
    LOW_BATTERY,
    PERSON_IN_ROOM,
    WardState,
)
from socialbot.tasks.domain import Item
from socialbot.tasks.state import State

JOINT_ACTIONS = frozenset({"a_authenticate_nurse", "a_authorize_patrol", "a_authorize_disinfect"})
"""Actions that all agents do whom they name; any other one is done by the first that it names."""

_NUMBERED = re.compile(r"(.*?)(\d*)")


@lru_cache(maxsize=10_000)
def by_number(name: str) -> tuple[str, int]:
    """What names are sorted by: their kind, then their number, so that ``spotrobot10`` comes after ``spotrobot9``."""
    found = _NUMBERED.fullmatch(name)
    return (found[1], int(found[2] or 0)) if found else (name, 0)


@dataclass(frozen=True, slots=True)
class Role:
    """A part in a mission: the variable that stands for who has it, and the actions that it takes."""

    variable: str
    needs: frozenset[str]
    at_home: bool = False
    """Whether only the one will do to whom the room belongs."""


@dataclass(frozen=True, slots=True)
class MissionKind:
    """A kind of mission in a room: its priority, whom it needs, and its tasks for a team by variables."""

    name: str
    priority: int
    roles: tuple[Role, ...]
    tasks: Callable[[Mapping[str, str]], list[Item]]


NURSE, ROOM, SPOT, UVD = "NurseDisinfect", "NurseDisinfectRoom", "SpotRobot", "UvdRobot"
"""The variables of a disinfection, in the order of ``start(...)``."""

_ROLES = (
    Role(NURSE, frozenset({"a_authenticate_nurse", "a_authorize_patrol", "a_adapt_room"}), at_home=True),
    Role(SPOT, frozenset({"a_navigate_to", "a_open_door", "a_patrol_room"})),
    Role(UVD, frozenset({"a_navigate_to", "a_disinfect_room"})),
)


def _disinfect(team: Mapping[str, str]) -> list[Item]:
    return [disinfection(team[SPOT], team[UVD], team[NURSE])]


DISINFECT = MissionKind("disinfect", 0, _ROLES, _disinfect)
URGENT = MissionKind("urgent", 2, _ROLES, _disinfect)
"""A disinfection that others have to wait for, as in intensive care."""

KINDS = {kind.name: kind for kind in (DISINFECT, URGENT)}


class Member(msgspec.Struct):
    """An agent that has registered, and the mission it works for (0: none)."""

    name: str
    kind: str
    capabilities: frozenset[str]
    mission: int = 0


UNFIT, DOOR_CLOSED, BATTERY_LOW = "unfit", "door closed", "battery low: "
"""What agents find out: that the room is not fit, its door closed, the battery of one (its name follows) low."""


class Mission(msgspec.Struct):
    """A mission and how far it has come.

    ``team`` has who plays which role. ``active`` are those who have not finished. ``past`` are actions of plans that
    were given up. ``touched`` (ns) is when there last was news of it, ``ended`` when the last one had finished, and
    ``rests_until`` when it may be tried anew. ``found`` is what its agents found out: what is so, and since when (ns).
    ``failures`` counts what went wrong with this team.
    """

    id: int
    kind: str
    room: str
    status: MissionStatus = "waiting"
    team: dict[str, str] = {}
    active: list[str] = []
    revision: int = 0
    past: list[PlannedAction] = []
    recoveries: int = 0
    revisions: int = 0
    problem: str = ""
    touched: int = 0
    ended: int = 0
    rests_until: int = 0
    authenticated: bool = False
    found: dict[str, int] = {}
    failures: dict[str, int] = {}

    @property
    def priority(self) -> int:
        """That of its kind."""
        return KINDS[self.kind].priority

    @property
    def label(self) -> str:
        """The label of its plans as they are now."""
        return f"mission_{self.id}_{self.revision}"

    @property
    def is_over(self) -> bool:
        """Whether nothing more is done for it."""
        return self.status in ("finished", "failed")

    def context(self) -> dict[str, str]:
        """The variables of its plans and what they stand for."""
        return {NURSE: self.team[NURSE], ROOM: self.room, SPOT: self.team[SPOT], UVD: self.team[UVD]}

    def tasks(self) -> list[Item]:
        """What its team has to do."""
        return KINDS[self.kind].tasks(self.team)

    def is_done(self, item: Item) -> None:
        """Takes into account what an action has brought about."""
        match item:
            case ("a_adapt_room", *_):
                self.found.pop(UNFIT, None)
            case ("a_open_door", *_):
                self.found.pop(DOOR_CLOSED, None)
            case ("a_charge", robot):
                self.found.pop(BATTERY_LOW + robot, None)
            case ("a_authenticate_nurse", *_):
                self.authenticated = True
            case ("a_authorize_patrol", *_):
                self.authenticated = False
            case _:
                pass

    def has_met(self, problem: Problem, agent: str, now: int) -> None:
        """Takes into account what an ``agent`` has found out."""
        if problem.kind in (DIRTY_ROOM, PERSON_IN_ROOM):
            self.found[UNFIT] = now
        elif problem.kind == CLOSED_DOOR:
            self.found[DOOR_CLOSED] = now
        elif problem.kind == LOW_BATTERY:
            self.found[BATTERY_LOW + agent] = now


Policy = Literal["auto", "replan", "repair", "none"]


@dataclass
class Conduct:
    """How the coordinator goes about it.

    ``policy``: plan anew as a whole, mend the tree at the failed action, the former if more than half of the actions
    are joint (``auto``), or give the mission up (``none``). A ``proactive`` one sees the rooms and batteries of the
    ward and acts before a plan meets a problem; another one only knows what its agents tell. After ``patience_s``
    without news it plans anew; a mission that cannot go on now is tried again after ``rest_s``. Without ``triggers``
    it begins only missions that it is asked for.
    """

    policy: Policy = "auto"
    proactive: bool = True
    triggers: bool = True
    patience_s: float = 120.0
    rest_s: float = 5.0


class Memory(msgspec.Struct):
    """What a coordinator has to remember to go on where it was."""

    members: dict[str, Member] = {}
    missions: dict[int, Mission] = {}
    last: int = 0


def state_of(ward: WardState, mission: Mission, *, sees_rooms: bool) -> State:
    """What the planner of tasks is told: the ward as it was seen, and what the agents of the mission found out.

    Unless it ``sees_rooms``, rooms are taken to be tidy and batteries to be full as long as nobody says otherwise.
    What was found out before the ward was seen is of no account if it does. Where robots are on their way to the room
    makes no difference: all of that is the corridor.
    """
    found = [what for what, since in mission.found.items() if not sees_rooms or since >= ward.stamp]
    nurse, spot = mission.team[NURSE], mission.team[SPOT]
    agents = {name: ward.agent(name) for name in mission.team.values()}
    room = ward.room(mission.room)
    low = {name: sees_rooms and agent is not None and agent.low_battery for name, agent in agents.items()}
    return State(
        "ward",
        loc={
            name: mission.room if agent and agent.place == mission.room else CORRIDOR for name, agent in agents.items()
        }
        | {nurse: mission.room},
        doors={mission.room: room is not None and room.door_open and DOOR_CLOSED not in found},
        cleaned={mission.room: (room is None or room.ready or not sees_rooms) and UNFIT not in found},
        disinfected={mission.room: False},
        low_battery={name: is_low or BATTERY_LOW + name in found for name, is_low in low.items()},
        authenticated={spot: nurse} if mission.authenticated else {},
    )
