"""Missions of the hospital: their kinds, teams, plans, progress, and what other nodes see of them."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from operator import itemgetter
from typing import Literal

import msgspec

from socialbot.agents.hospital.messages import ActionStatus, MissionStatus, MissionView, PlannedAction, Problem
from socialbot.agents.hospital.plans import PlanStage, stages
from socialbot.agents.hospital.plans import mission as disinfection
from socialbot.agents.hospital.ward.messages import (
    AWAY,
    CLOSED_DOOR,
    CORRIDOR,
    DIRTY_ROOM,
    LOW_BATTERY,
    PERSON_IN_ROOM,
    WardState,
)
from socialbot.planning.htn.domain import Item, TaskState
from socialbot.planning.htn.planner import progressed
from socialbot.planning.htn.tree import TaskNode, TaskTree

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


class RegisteredAgent(msgspec.Struct):
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
class CoordinatorOptions:
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


class CoordinatorMemory(msgspec.Struct):
    """What a coordinator has to remember to go on where it was."""

    members: dict[str, RegisteredAgent] = {}
    missions: dict[int, Mission] = {}
    last: int = 0


def state_of(ward: WardState, mission: Mission, *, sees_rooms: bool) -> TaskState:
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
    return TaskState(
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


class AgentPool:
    """Those of the members who are there, as the ward shows them at one moment."""

    def __init__(self, members: Mapping[str, RegisteredAgent], ward: WardState) -> None:
        self._members = members
        self._ward = ward
        self._able: dict[str, dict[str, list[RegisteredAgent]]] = {}
        """Who can play the role of a variable, by the room where they have to be at home, if that matters."""

    def able(self, role: Role, room: str) -> list[RegisteredAgent]:
        """Who can play a role, free or not, by number; last come those with low batteries, before them who charges."""
        if role.variable not in self._able:
            self._able[role.variable] = self._by_home(role)
        return self._able[role.variable].get(room if role.at_home else "", [])

    def _by_home(self, role: Role) -> dict[str, list[RegisteredAgent]]:
        found: dict[str, list[tuple[tuple[bool, bool, tuple[str, int]], RegisteredAgent]]] = {}
        for member in self._members.values():
            state = self._ward.agent(member.name) if role.needs <= member.capabilities else None
            if state is not None and state.place != AWAY:
                place = found.setdefault(state.home if role.at_home else "", [])
                # Who is free and yet does something charges.
                place.append(((state.low_battery, bool(state.busy), by_number(member.name)), member))
        return {home: [member for _, member in sorted(able, key=itemgetter(0))] for home, able in found.items()}

    def team(self, mission: Mission) -> dict[str, str] | None:
        """Who is free to play each role of a mission, by the variables of the roles; None if somebody is missing."""
        team: dict[str, str] = {}
        for role in KINDS[mission.kind].roles:
            able = self.able(role, mission.room)
            found = next((each for each in able if not each.mission and each.name not in team.values()), None)
            if found is None:
                return None
            team[role.variable] = found.name
        return team

    def is_short(self, kind: str) -> bool:
        """Whether there is a role in all missions of a kind for which nobody is free."""
        roles = (role for role in KINDS[kind].roles if not role.at_home)
        return any(all(each.mission for each in self.able(role, "")) for role in roles)

    def yielding(self, mission: Mission, missions: Mapping[int, Mission]) -> list[Mission]:
        """The less urgent missions that have whom this one lacks, the latest of equal ones; none if that is no help."""
        chosen: dict[int, Mission] = {}
        taken: set[str] = set()
        for role in KINDS[mission.kind].roles:
            able = [each for each in self.able(role, mission.room) if each.name not in taken]
            free = next((each for each in able if not each.mission or each.mission in chosen), None)
            if free is None:
                lower = [each for each in able if missions[each.mission].priority < mission.priority]
                if not lower:
                    return []
                free = min(lower, key=lambda each: (missions[each.mission].priority, -each.mission))
                chosen[free.mission] = missions[free.mission]
            taken.add(free.name)
        return list(chosen.values())


@dataclass
class PlanProgress:
    """The tree that a plan comes from, its actions, and how many of them are done."""

    tree: TaskTree
    agenda: tuple[TaskNode, ...]
    stages: tuple[PlanStage, ...]
    position: int = 0
    reached: dict[str, int] = field(default_factory=dict)
    """How many of the actions each agent has behind it."""
    foreseen: tuple[int, TaskState] | None = None
    """The position and the state for which it was last looked over."""
    doubted: int | None = None
    """Since when (ns) it does not seem to be right."""

    @staticmethod
    def of(tree: TaskTree, team: Iterable[str]) -> PlanProgress:
        """The plan of ``tree`` for a ``team``, at its beginning."""
        plan = tree.plan
        return PlanProgress(tree, plan, stages([node.item for node in plan], tuple(team), JOINT_ACTIONS))

    @property
    def next(self) -> TaskNode | None:
        """The action that is being done, or comes next."""
        return self.agenda[self.position] if self.position < len(self.agenda) else None

    @property
    def left(self) -> list[Item]:
        """What is not known to be done."""
        return [node.item for node in self.agenda[self.position :]]

    @property
    def joint_share(self) -> float:
        """How many of the actions are joint, 0 to 1."""
        return sum(len(stage.agents) > 1 for stage in self.stages) / max(len(self.stages), 1)

    def find(self, agent: str, item: Item) -> int | None:
        """Where ``item`` stands among what ``agent`` is not known to have done."""
        ahead = range(self.reached.get(agent, 0), len(self.agenda))
        return next((index for index in ahead if self.agenda[index].item == item), None)

    def advance(self, agent: str, item: Item) -> bool:
        """Notes that ``agent`` has done ``item``; whether the plan has come further by that.

        Of a joint action all partners tell, and the same one may come again later on.
        """
        index = self.find(agent, item)
        if index is None:
            return False
        self.reached[agent] = index + 1
        if index < self.position:
            return False
        self.position = index + 1
        return True

    def fail(self, agent: str, item: Item) -> TaskNode | None:
        """The action that ``agent`` could not do, which now is the next one; if it is none of the plan, the next."""
        index = self.find(agent, item)
        if index is not None:
            self.position = index
        return self.next

    def drawing(self) -> str:
        """The tasks, with what is done of them."""
        comes, status = (self.next, "planned") if self.next else (self.agenda[-1], "done")
        return str(progressed(self.tree, comes, status))

    def actions(self, *, failed: bool = False) -> list[PlannedAction]:
        """The actions, with what became of them; with ``failed`` the one at hand has failed."""
        at_hand: ActionStatus = "failed" if failed else "planned"
        return [
            PlannedAction(
                action=stage.action,
                args=stage.args,
                agents=stage.agents,
                status="done" if index < self.position else at_hand if index == self.position else "planned",
            )
            for index, stage in enumerate(self.stages)
        ]


def view(mission: Mission, progress: PlanProgress | None) -> MissionView:
    """The mission for others to see."""
    return MissionView(
        id=mission.id,
        kind=mission.kind,
        room=mission.room,
        priority=mission.priority,
        status=mission.status,
        team=tuple(mission.team.values()),
        label=mission.label,
        actions=(*mission.past, *(progress.actions() if progress else ())),
        tree=progress.drawing() if progress else "",
        recoveries=mission.recoveries,
        revisions=mission.revisions,
        problem=mission.problem,
    )


SHOWN = 20
"""So many missions that are over are still shown."""


class MissionViewCache:
    """Shows missions; only those are drawn anew of which it was told that they have changed."""

    def __init__(self) -> None:
        self.changed = True
        """Whether there may be something new since this was last set to False."""
        self._over: deque[MissionView] = deque(maxlen=SHOWN)
        self._drawn: dict[int, MissionView] = {}

    def redraw(self, mission: Mission) -> None:
        """Notes that a mission has changed."""
        self._drawn.pop(mission.id, None)
        self.changed = True

    def close(self, mission: Mission, progress: PlanProgress | None) -> None:
        """Shows how a mission has ended."""
        self.redraw(mission)
        self._over.append(view(mission, progress))

    def views(self, missions: Iterable[Mission], progress_of: Mapping[int, PlanProgress]) -> Iterator[MissionView]:
        """The latest missions that are over, in the order of their end, then ``missions``."""
        yield from self._over
        for mission in missions:
            drawn = self._drawn.get(mission.id)
            if drawn is None:
                drawn = self._drawn[mission.id] = view(mission, progress_of.get(mission.id))
            yield drawn
