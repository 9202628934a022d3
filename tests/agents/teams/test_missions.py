"""Teams with overlapping roles, and plans without actions."""

from __future__ import annotations

from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any, ClassVar

import pytest

from socialbot.agents.teams import CoordinatorOptions, HtnMissionPlanner, MemberState, Mission, Role, TeamDomain
from socialbot.agents.teams._mission_manager import MissionManager
from socialbot.agents.teams.missions import AgentPool, CapableAgents, CoordinatorMemory, RegisteredAgent
from socialbot.planning.htn.domain import Item, TaskDomain, TaskState

NETWORK = TaskDomain("carry")


@NETWORK.action
def a_carry(state: TaskState, first: str, second: str) -> TaskState:
    return state


@NETWORK.method("m_carry")
def carry(state: TaskState, first: str, second: str) -> list[Item]:
    return [("a_carry", first, second)] if state.heavy else []


class Carrying(TeamDomain[Any]):
    """Two carry a thing; one of them must also steer."""

    roles = (Role("Helper", frozenset({"a_carry"})), Role("Leader", frozenset({"a_carry", "a_steer"})))
    kinds: ClassVar = {"carry": 0}
    planner = HtnMissionPlanner(NETWORK)

    def targets(self, world: Any) -> Iterable[str]:
        return world.things

    def is_done(self, world: Any, target: str) -> bool | None:
        return target not in world.things

    def member(self, world: Any, name: str) -> MemberState | None:
        return MemberState()

    def state(self, world: Any, mission: Mission, *, sees: bool) -> TaskState:
        return TaskState(heavy=world.heavy)

    def tasks(self, mission: Mission) -> list[Item]:
        return [("m_carry", *mission.team.values())]


def members(**able: str) -> dict[str, RegisteredAgent]:
    return {name: RegisteredAgent(name, "robot", frozenset(actions.split())) for name, actions in able.items()}


@pytest.mark.parametrize(
    ("able", "team"),
    [
        ({"ann": "a_carry a_steer", "bob": "a_carry"}, ["bob", "ann"]),
        ({"ann": "a_carry", "bob": "a_carry a_steer"}, ["ann", "bob"]),
        ({"ann": "a_carry a_steer"}, None),
        ({"ann": "a_carry", "bob": "a_carry"}, None),
    ],
)
def test_one_agent_can_play_one_role_and_others_make_room(able: dict[str, str], team: list[str] | None):
    pool = AgentPool(Carrying(), members(**able), SimpleNamespace())
    found = pool.team(Mission(1, "carry", "piano"))
    assert (list(found.values()) if found else None) == team


def test_an_agent_that_registers_without_an_action_loses_its_role():
    before = members(ann="a_carry", bob="a_carry")
    capable = CapableAgents(Carrying.roles, before.values())
    capable.note(RegisteredAgent("ann", "robot", frozenset()))
    assert {name for agents in capable.by_role.values() for name in agents} == {"bob"}


def test_empty_plan_makes_the_mission_wait():
    memory = CoordinatorMemory(members(ann="a_carry", bob="a_carry a_steer"))
    manager = MissionManager(Carrying(), lambda *_: None, CoordinatorOptions(), memory)
    manager.world = SimpleNamespace(stamp=1, things=["piano"], heavy=False)
    mission = manager.begin("carry", "piano")
    manager.form_teams()
    assert mission.status == "waiting"
    assert mission.problem == "the plan is empty, but the world does not show that the mission is done"
