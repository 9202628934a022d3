from __future__ import annotations

import logging

import pytest

from socialbot.agents.hospital.demo import hospital, large_hospital
from socialbot.agents.hospital.missions import Disinfection
from socialbot.agents.hospital.scripted import SCRIPTED, ScriptedAgent, actions_of, scripted
from socialbot.agents.hospital.ward.messages import MESSAGES
from socialbot.agents.hospital.ward.ward import NURSE, SPOT, UVD
from socialbot.agents.teams.messages import AclMessage, Plan, Problem, Refusal, Register, Report, Stop
from socialbot.graph.node import Graph
from tests.agents.hospital.listings import LISTING_3
from tests.agents.hospital.watched import Watched

logging.getLogger("socialbot.coordinator").setLevel(logging.ERROR)


class Run(Watched):
    """A run of a scripted hospital, in which the test may say something, too."""

    def __init__(self, graph: Graph) -> None:
        super().__init__(scripted(graph))

    def receive(self, **changes) -> None:
        message = AclMessage(
            **{
                "stamp": self.runner.clock.now(), "id": "x", "sender": "coordinator", "receiver": "spotrobot1",
                "performative": "request", "content": Plan("mission_9_1", ()), "mission": "mission_9_1", **changes,
            }
        )  # fmt: skip
        self.runner.feed(MESSAGES, message)


def test_scripted_hospital_has_no_bdi_nodes():
    graph = scripted(hospital(rate=25.0, seed=3))
    assert {config.type for config in graph.nodes} & set(SCRIPTED) == set()
    assert [config.name for config in graph.nodes] == [each.name for each in hospital().nodes]
    assert graph.node("world").parameters == {"rate": 25.0, "seed": 3}


def test_scripted_mission_executes_listing_3_in_order():
    run = Run(hospital()).until(6.0)
    view = run.views[1]
    assert [(each.action, *each.args) for each in view.actions] == LISTING_3
    assert {each.status for each in view.actions} == {"done"}
    assert (view.status, run.infected()) == ("finished", [])
    assert run.ended[1] == pytest.approx(4.2, abs=0.1)
    assert len(run.contents(Plan)) == len(LISTING_3) + 3  # three of them are for two
    begun = {(command.action, *command.args): command.stamp for command in run.commands}
    assert sorted(begun.values()) == list(begun.values())
    assert list(begun) == LISTING_3


def test_first_problem_ends_scripted_mission():
    run = Run(hospital(rate=100.0)).until(20.0)
    view = run.views[1]
    assert run.contents(Problem) == [Problem("dirty room", ("spotrobot1", "room1"), "a_patrol_room")]
    assert (view.status, view.problem) == ("failed", "dirty room")
    assert [each.status for each in view.actions] == ["done"] * 5 + ["failed"]
    assert run.infected() == ["room1"]
    assert list(run.views) == [1]
    assert run.ended[1] < 2.6


def test_absent_nurse_ends_joint_action_for_both_partners():
    graph = hospital(world={"faults": "1.9 leaves nurse_disinfected1 30"})
    run = Run(graph).until(20.0)
    assert run.views[1].status == "failed"
    assert run.views[1].problem == "nurse absent"
    reports = [report for report in run.contents(Report) if report.action == "a_authenticate_nurse"]
    assert {report.outcome for report in reports} <= {"failure"}


def test_rooms_are_disinfected_one_by_one_and_failed_rooms_are_skipped():
    run = Run(large_hospital(4, 1, 1, seed=3, rate=50.0)).until(90.0)
    failed = {view.target for view in run.views.values() if view.status == "failed"}
    finished = {view.target for view in run.views.values() if view.status == "finished"}
    assert failed
    assert finished
    assert failed | finished == {"room1", "room2", "room3", "room4"}
    assert set(run.infected()) == failed


def test_invalid_action_is_refused_and_ends_the_mission():
    run = Run(hospital()).until(0.5)
    run.receive(content=Plan("mission_9_1", ("no action(",)))
    (refusal,) = run.contents(Refusal)
    assert "no action(" in refusal.reason
    assert run.commands == []


def test_action_is_cancelled_when_its_mission_is_aborted():
    run = Run(hospital()).until(0.5)
    run.receive(content=Plan("mission_9_1", ("a_navigate_to(spotrobot1, room2)",)))
    run.receive(content=Stop("enough"), mission="mission_8_1")
    assert run.cancels == []
    run.receive(content=Stop("enough"))
    assert len(run.cancels) == 1
    run.until(3.0)
    assert [report.action for report in run.contents(Report) if report.args == ("spotrobot1", "room2")] == []


def test_robot_ignores_messages_for_others():
    run = Run(hospital()).until(0.5)
    run.receive(receiver="uvdrobot1", content=Plan("mission_9_1", ("a_navigate_to(spotrobot1, room2)",)))
    assert [command.robot for command in run.commands] == ["uvdrobot1"]


def test_agents_register_again_on_request_of_the_coordinator():
    run = Run(hospital()).until(0.5)
    before = len(run.contents(Register))
    run.receive(receiver="all", performative="query", content=Register(), mission="")
    assert len(run.contents(Register)) == before + 1 + 3 + 3


@pytest.mark.parametrize("kind", [SPOT, UVD, NURSE])
def test_robots_and_nurses_register_their_actions(kind: str):
    able = set(actions_of(kind))
    assert sum(role.needs <= able for role in Disinfection.roles) == 1
    assert ("a_charge" in able) is (kind != NURSE)


def test_every_scripted_agent_has_a_kind():
    agents = [node for node in SCRIPTED.values() if issubclass(node, ScriptedAgent)]
    assert sorted(agent.kind for agent in agents) == sorted((SPOT, UVD, NURSE))
