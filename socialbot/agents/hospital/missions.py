"""Missions of the hospital: who disinfects a room, when, and what is known of it."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain
from typing import ClassVar

from socialbot.agents.hospital.plans import DISINFECT as NETWORK
from socialbot.agents.hospital.plans import mission as disinfection
from socialbot.agents.hospital.ward.messages import (
    AWAY,
    CLOSED_DOOR,
    CORRIDOR,
    DIRTY_ROOM,
    LOW_BATTERY,
    MESSAGES,
    MISSIONS,
    NURSE_ABSENT,
    PERSON_IN_ROOM,
    STATE,
    WardState,
)
from socialbot.agents.hospital.ward.ward import DURATIONS, JOINT_ACTIONS
from socialbot.agents.teams.coordinator import TeamCoordinator
from socialbot.agents.teams.domain import MemberState, Role, TeamDomain
from socialbot.agents.teams.messages import AclMessage, Missions, Problem
from socialbot.agents.teams.missions import Mission
from socialbot.agents.teams.planning import HtnMissionPlanner
from socialbot.graph.ports import Delivery, Input, Output, Parameter
from socialbot.planning.htn.domain import Item, TaskState

DISINFECT = "disinfect"
NURSE, ROOM, SPOT, UVD = "NurseDisinfect", "NurseDisinfectRoom", "SpotRobot", "UvdRobot"
"""Variables of a disinfection, in the order of ``start(...)``."""

UNFIT, DOOR_CLOSED, BATTERY_LOW, AUTHENTICATED = "unfit", "door closed", "battery low: ", "authenticated"
"""Findings of agents: room not fit, door closed, battery low (followed by the name of the robot), nurse known."""

SETTLES = {"a_adapt_room": UNFIT, "a_open_door": DOOR_CLOSED, "a_authorize_patrol": AUTHENTICATED}
"""Finding that ends with an action."""
FINDS = {DIRTY_ROOM: UNFIT, PERSON_IN_ROOM: UNFIT, CLOSED_DOOR: DOOR_CLOSED}
"""Finding that begins with a problem."""

LONGEST_WAY_M = 60.0


class Disinfection(TeamDomain[WardState]):
    """Missions that disinfect the rooms of a ward. ``pace`` names the durations of actions in the ward.

    An ``urgent`` disinfection, as in intensive care, goes before others. Only the nurse of the room can play the nurse.
    """

    roles = (
        Role(NURSE, frozenset({"a_authenticate_nurse", "a_authorize_patrol", "a_adapt_room"}), is_local=True),
        Role(SPOT, frozenset({"a_navigate_to", "a_open_door", "a_patrol_room"})),
        Role(UVD, frozenset({"a_navigate_to", "a_disinfect_room"})),
    )
    kinds: ClassVar = {DISINFECT: 0, "urgent": 2}
    planner = HtnMissionPlanner(NETWORK)
    joint_actions = JOINT_ACTIONS
    repairable = frozenset({DIRTY_ROOM, PERSON_IN_ROOM, LOW_BATTERY, NURSE_ABSENT})
    blameless = frozenset({CLOSED_DOOR})
    undone = "the room is not disinfected"

    def __init__(self, pace: str = "clinic") -> None:
        self._durations = DURATIONS[pace]

    def targets(self, world: WardState) -> Iterable[str]:
        return (room.name for room in world.rooms if not room.disinfected)

    def changed(self, before: WardState, world: WardState) -> set[str] | None:
        if (len(before.rooms), len(before.agents)) != (len(world.rooms), len(world.agents)):
            return None  # sensors became silent, or work again
        pairs = chain(zip(before.rooms, world.rooms, strict=True), zip(before.agents, world.agents, strict=True))
        return {one.name for old, new in pairs if old is not new and old != new for one in (old, new)}

    def is_done(self, world: WardState, target: str) -> bool | None:
        room = world.room(target)
        return None if room is None else room.disinfected

    def member(self, world: WardState, name: str) -> MemberState | None:
        state = world.agent(name)
        if state is None:
            return None
        # A free agent that is busy charges its battery.
        rank, progress = (state.low_battery, bool(state.busy)), (state.x, state.y, state.battery)
        return MemberState(state.busy, state.home, state.place != AWAY, rank, progress)

    def state(self, world: WardState, mission: Mission, *, sees: bool) -> TaskState:
        """State for the task planner: the ward as observed, and the findings of the agents of a mission.

        Without ``sees``, rooms count as tidy and batteries as full unless an agent found otherwise. With it, findings
        from before the observation do not count. All places outside the room count as the corridor.
        """
        target = mission.target
        found = [what for what, since in mission.found.items() if not sees or since >= world.stamp]
        nurse, spot = mission.team[NURSE], mission.team[SPOT]
        agents = {name: world.agent(name) for name in mission.team.values()}
        room = world.room(target)
        low = {name: sees and agent is not None and agent.low_battery for name, agent in agents.items()}
        return TaskState(
            "ward",
            loc={name: target if agent and agent.place == target else CORRIDOR for name, agent in agents.items()}
            | {nurse: target},
            doors={target: room is not None and room.door_open and DOOR_CLOSED not in found},
            cleaned={target: (room is None or room.ready or not sees) and UNFIT not in found},
            disinfected={target: False},
            low_battery={name: is_low or BATTERY_LOW + name in found for name, is_low in low.items()},
            authenticated={spot: nurse} if AUTHENTICATED in mission.found else {},
        )

    def tasks(self, mission: Mission) -> list[Item]:
        return [disinfection(mission.team[SPOT], mission.team[UVD], mission.team[NURSE])]

    def variables(self, mission: Mission) -> dict[str, str]:
        team = mission.team
        return {NURSE: team[NURSE], ROOM: mission.target, SPOT: team[SPOT], UVD: team[UVD]}

    def on_done(self, mission: Mission, item: Item, now: int) -> None:
        action, *args = item
        if action == "a_authenticate_nurse":
            mission.found[AUTHENTICATED] = now
        elif action == "a_charge":
            mission.found.pop(BATTERY_LOW + args[0], None)
        else:
            mission.found.pop(SETTLES.get(action, ""), None)

    def on_problem(self, mission: Mission, problem: Problem, agent: str, now: int) -> None:
        if problem.kind == LOW_BATTERY:
            mission.found[BATTERY_LOW + agent] = now
        elif problem.kind in FINDS:
            mission.found[FINDS[problem.kind]] = now

    def longest_s(self, action: str) -> float:
        return self._durations.seconds.get(action, 0.0) + LONGEST_WAY_M / self._durations.speed


class HospitalCoordinator(TeamCoordinator):
    """Directs the robots and nurses of a hospital. With a ``memory_file`` it continues after a restart."""

    heard = Input(AclMessage, MESSAGES)
    state = Input(WardState, STATE, Delivery.LATCHED)
    said = Output(AclMessage, MESSAGES)
    missions = Output(Missions, MISSIONS, Delivery.LATCHED)

    pace = Parameter("clinic", "durations of actions in the ward; a longer action is stuck", choices=tuple(DURATIONS))

    def team_domain(self) -> Disinfection:
        return Disinfection(self.pace)

    @state
    def on_state(self, message: WardState) -> None:
        self.observe(message)
