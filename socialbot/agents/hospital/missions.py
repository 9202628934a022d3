"""Missions of the hospital: their priorities, teams and progress."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import lru_cache
from operator import itemgetter
from typing import Literal

import msgspec

from socialbot.agents.hospital.messages import MissionStatus, MissionView, PlannedAction, Problem
from socialbot.agents.hospital.plans import mission as disinfection
from socialbot.agents.hospital.plans import stages
from socialbot.agents.hospital.ward.messages import (
    AWAY,
    CLOSED_DOOR,
    CORRIDOR,
    DIRTY_ROOM,
    LOW_BATTERY,
    PERSON_IN_ROOM,
    WardState,
)
from socialbot.agents.hospital.ward.ward import DURATIONS, JOINT_ACTIONS
from socialbot.core.clock import nanoseconds
from socialbot.planning.htn.domain import Item, TaskState
from socialbot.planning.htn.planner import progressed
from socialbot.planning.htn.tree import TaskNode, TaskTree

DISINFECT = "disinfect"
PRIORITIES = {DISINFECT: 0, "urgent": 2}
"""Priorities of the kinds of missions. An ``urgent`` disinfection, as in intensive care, goes before others."""

NURSE, ROOM, SPOT, UVD = "NurseDisinfect", "NurseDisinfectRoom", "SpotRobot", "UvdRobot"
"""Variables of a disinfection, in the order of ``start(...)``."""

ROLES = {
    NURSE: frozenset({"a_authenticate_nurse", "a_authorize_patrol", "a_adapt_room"}),
    SPOT: frozenset({"a_navigate_to", "a_open_door", "a_patrol_room"}),
    UVD: frozenset({"a_navigate_to", "a_disinfect_room"}),
}
"""Necessary actions of each role of a mission. Only the nurse of the room can play the nurse."""

_NUMBERED = re.compile(r"(.*?)(\d*)")


@lru_cache(maxsize=10_000)
def by_number(name: str) -> tuple[str, int]:
    """Sort key of a name: its kind, then its number."""
    found = _NUMBERED.fullmatch(name)
    return (found[1], int(found[2] or 0)) if found else (name, 0)


FOREVER = 2**62


class RegisteredAgent(msgspec.Struct):
    """A registered agent with the number of its mission (0: none).

    It gets no mission until ``aside_until`` (ns). That is `FOREVER` for an agent that does not answer; any message ends
    it. ``strikes`` counts how often it was set aside since it finished a mission.
    """

    name: str
    kind: str
    capabilities: frozenset[str]
    mission: int = 0
    aside_until: int = 0
    strikes: int = 0


UNFIT, DOOR_CLOSED, BATTERY_LOW = "unfit", "door closed", "battery low: "
"""Findings of agents: room not fit, door closed, battery low (followed by the name of the robot)."""


class Mission(msgspec.Struct):
    """State of a mission.

    ``team`` maps roles to agents, ``active`` are the agents that have not finished. ``past`` are actions of abandoned
    plans. Times in ns: ``touched`` of the latest news, ``ended`` of the last agent, ``rests_until`` of the next try.
    ``found`` are findings of agents with their times. ``failures`` counts the failures of this team. ``lacks`` says
    which roles nobody can play now. ``asked_at`` is when its silent team was asked to answer (0: not asked).
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
    lacks: str = ""
    asked_at: int = 0

    @property
    def priority(self) -> int:
        return PRIORITIES[self.kind]

    @property
    def label(self) -> str:
        """Label of its present plans."""
        return f"mission_{self.id}_{self.revision}"

    def context(self) -> dict[str, str]:
        """Variables of its plans with their values."""
        return {NURSE: self.team[NURSE], ROOM: self.room, SPOT: self.team[SPOT], UVD: self.team[UVD]}

    def tasks(self) -> list[Item]:
        return [disinfection(self.team[SPOT], self.team[UVD], self.team[NURSE])]

    def apply_effects(self, item: Item) -> None:
        """Apply the effects of a finished action to the findings."""
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

    def add_finding(self, problem: Problem, agent: str, now: int) -> None:
        """Add the finding of an agent."""
        if problem.kind in (DIRTY_ROOM, PERSON_IN_ROOM):
            self.found[UNFIT] = now
        elif problem.kind == CLOSED_DOOR:
            self.found[DOOR_CLOSED] = now
        elif problem.kind == LOW_BATTERY:
            self.found[BATTERY_LOW + agent] = now


Policy = Literal["auto", "replan", "repair", "none"]


class CoordinatorOptions(msgspec.Struct):
    """Options of the coordinator; see the parameters of `HospitalCoordinator`.

    ``policy`` is the reaction to a problem: a new plan for the whole mission (``replan``), a repaired tree
    (``repair``), ``replan`` if more than half of the actions are joint, else ``repair`` (``auto``), or the end of the
    mission (``none``). A ``proactive`` coordinator uses the rooms and batteries of the ward and acts before a problem.
    Others use only reports of agents. ``pace`` names the durations of actions in the ward: an agent that is busy with
    one for much longer is stuck.
    """

    policy: Policy = "auto"
    proactive: bool = True
    triggers: bool = True
    patience_s: float = 120.0
    rest_s: float = 5.0
    pace: str = "clinic"


LIMIT_FACTOR, LIMIT_EXTRA_S, LONGEST_WAY_M = 3.0, 10.0, 60.0


def action_limit(action: str, pace: str) -> int:
    """Time (ns) after which an agent that is busy with an action is stuck in it."""
    durations = DURATIONS[pace]
    way_s = LONGEST_WAY_M / durations.speed
    return nanoseconds(LIMIT_FACTOR * (durations.seconds.get(action, 0.0) + way_s) + LIMIT_EXTRA_S)


class CoordinatorMemory(msgspec.Struct):
    """Persistent state of a coordinator."""

    members: dict[str, RegisteredAgent] = {}
    missions: dict[int, Mission] = {}
    last: int = 0


def state_of(ward: WardState, mission: Mission, *, sees_rooms: bool) -> TaskState:
    """State for the task planner: the ward as observed, and the findings of the agents of a mission.

    Without ``sees_rooms``, rooms count as tidy and batteries as full unless an agent found otherwise. With it, findings
    from before the observation do not count. All places outside the room count as the corridor.
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
    """Registered agents that are present in a state of the ward, and not set aside at a time (ns)."""

    def __init__(self, members: Mapping[str, RegisteredAgent], ward: WardState, now: int = 0) -> None:
        self._members = members
        self._ward = ward
        self._now = now
        self._able: dict[str, dict[str, list[RegisteredAgent]]] = {}

    def able(self, role: str, room: str) -> list[RegisteredAgent]:
        """Agents for a role of a mission in ``room``, free or not.

        First idle ones, then charging ones, then low batteries; by number.
        """
        if role not in self._able:
            self._able[role] = self._by_home(role)
        return self._able[role].get(room if role == NURSE else "", [])

    def _by_home(self, role: str) -> dict[str, list[RegisteredAgent]]:
        able = [
            # A free agent that is busy charges its battery.
            ((state.low_battery, bool(state.busy), by_number(member.name)), state.home, member)
            for member in self._members.values()
            if ROLES[role] <= member.capabilities
            and member.aside_until <= self._now
            and (state := self._ward.agent(member.name)) is not None
            and state.place != AWAY
        ]
        found: defaultdict[str, list[RegisteredAgent]] = defaultdict(list)
        for _, home, member in sorted(able, key=itemgetter(0)):
            found[home if role == NURSE else ""].append(member)
        return found

    def team(self, mission: Mission) -> dict[str, str] | None:
        """A free agent for each role, by variable; None if one is missing."""
        team: dict[str, str] = {}
        for role in ROLES:
            able = self.able(role, mission.room)
            found = next((each for each in able if not each.mission and each.name not in team.values()), None)
            if found is None:
                return None
            team[role] = found.name
        return team

    def is_short(self) -> bool:
        """Whether a role other than the nurse has no free agent."""
        return any(all(each.mission for each in self.able(role, "")) for role in (SPOT, UVD))

    def lacking(self, mission: Mission) -> str:
        """Roles of a mission that nobody can play, free or not, with the reason; an empty string if there are none."""
        found = []
        for role in ROLES:
            if self.able(role, mission.room):
                continue
            capable = [each for each in self._members.values() if ROLES[role] <= each.capabilities]
            if role == NURSE:
                capable = [each for each in capable if self._home(each.name) in (mission.room, None)]
            reasons = [self._absence(each) for each in sorted(capable, key=lambda each: by_number(each.name))]
            found.append(f"nobody for {role} ({'; '.join(reasons) or 'no such agent is registered'})")
        return ", ".join(found)

    def _home(self, name: str) -> str | None:
        state = self._ward.agent(name)
        return None if state is None else state.home

    def _absence(self, member: RegisteredAgent) -> str:
        state = self._ward.agent(member.name)
        if member.aside_until == FOREVER:
            return f"{member.name} does not answer"
        if member.aside_until > self._now:
            return f"{member.name} is set aside after a failure"
        return f"{member.name} is away" if state is not None else f"the ward does not show {member.name}"

    def yielding(self, mission: Mission, missions: Mapping[int, Mission]) -> list[Mission]:
        """Missions of lower priority that must yield to give this one a team, latest first; empty if impossible."""
        chosen: dict[int, Mission] = {}
        taken: set[str] = set()
        for role in ROLES:
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


class PlanProgress:
    """Progress of the plan of a task tree for a team.

    Attributes:
        agenda: Actions as nodes of the tree.
        stages: The same actions with their agents.
        position: Number of finished actions.
        revised_for: Position and state of the latest revision.
        doubted_since: Time (ns) of the first doubt about the plan.
    """

    def __init__(self, tree: TaskTree, team: Iterable[str]) -> None:
        self.tree = tree
        self.agenda = tree.plan
        self.stages = stages([node.item for node in self.agenda], tuple(team), JOINT_ACTIONS)
        self.position = 0
        self.revised_for: tuple[int, TaskState] | None = None
        self.doubted_since: int | None = None
        self.busy_since: dict[str, tuple[str, int]] = {}
        """Action that each agent is busy with, as the ward shows it, and since when (ns)."""
        self._reached: dict[str, int] = {}
        """Number of finished actions, by agent."""

    @property
    def next(self) -> TaskNode | None:
        """The action in progress, or the next one."""
        return self.agenda[self.position] if self.position < len(self.agenda) else None

    @property
    def acting(self) -> tuple[str, ...]:
        """Agents of the action in progress, or of the next one."""
        return self.stages[self.position].agents if self.position < len(self.stages) else ()

    @property
    def left(self) -> list[Item]:
        """The actions that are not known to be done."""
        return [node.item for node in self.agenda[self.position :]]

    @property
    def joint_share(self) -> float:
        """Share of joint actions, 0 to 1."""
        return sum(len(stage.agents) > 1 for stage in self.stages) / max(len(self.stages), 1)

    def find(self, agent: str, item: Item) -> int | None:
        """Index of an action among those that the agent is not known to have done."""
        ahead = range(self._reached.get(agent, 0), len(self.agenda))
        return next((index for index in ahead if self.agenda[index].item == item), None)

    def advance(self, agent: str, item: Item) -> bool:
        """Record that an agent has done an action; returns whether the plan advances.

        All partners report a joint action, and the same action may occur twice.
        """
        index = self.find(agent, item)
        if index is None:
            return False
        self._reached[agent] = index + 1
        if index < self.position:
            return False
        self.position = index + 1
        return True

    def fail(self, agent: str, item: Item) -> TaskNode | None:
        """Set the position to the failed action of an agent, if the plan has it; returns the next action."""
        index = self.find(agent, item)
        if index is not None:
            self.position = index
        return self.next

    def drawing(self) -> str:
        """The task tree with its progress."""
        upcoming, status = (self.next, "planned") if self.next else (self.agenda[-1], "done")
        return str(progressed(self.tree, upcoming, status))

    def executed(self, *, failed: bool = False) -> list[PlannedAction]:
        """The finished actions, and with ``failed`` the present one, which has failed."""
        done = [msgspec.structs.replace(stage, status="done") for stage in self.stages[: self.position]]
        present = self.stages[self.position : self.position + 1] if failed else ()
        return done + [msgspec.structs.replace(stage, status="failed") for stage in present]

    def actions(self) -> list[PlannedAction]:
        """The actions with their status."""
        return [*self.executed(), *self.stages[self.position :]]


def view(mission: Mission, progress: PlanProgress | None) -> MissionView:
    """The published state of a mission."""
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
        problem=mission.lacks or mission.problem,
    )
