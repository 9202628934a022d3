"""A mission over DDS, in real time: the world, the coordinator and each agent in a process of its own."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from socialbot.agents.hospital.coordinator import MISSIONS, HospitalCoordinator
from socialbot.agents.hospital.messages import TOPIC, AclMessage, Missions, MissionView, Problem
from socialbot.agents.hospital.robot_node import Nurse, Spot, Uvd
from socialbot.agents.hospital.ward.messages import STATE, WardState
from socialbot.agents.hospital.ward.world_node import HospitalWorld
from socialbot.bridge.graph_observer import LatestStatistics, expect_free_names, observe_graph
from socialbot.core.messages import Message
from socialbot.graph.node import Graph, NodeConfig
from socialbot.runtime.launch import Launch
from tests.agents.hospital.listings import LISTING_3, LISTING_4
from tests.system.running import eventually

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("hospital over DDS")]

HOSPITAL = Graph(
    "hospital",
    (
        NodeConfig("world", HospitalWorld),
        NodeConfig("coordinator", HospitalCoordinator, {"proactive": False, "policy": "repair"}),
        NodeConfig("spotrobot1", Spot),
        NodeConfig("uvdrobot1", Uvd),
        NodeConfig("nurse_disinfected1", Nurse),
    ),
)


class Heard:
    """What came on the topics so far."""

    def __init__(self) -> None:
        self.view: MissionView | None = None
        self.problems: list[Problem] = []
        self.ward: WardState | None = None

    def observe(self, topic: str, message: Message) -> None:
        if isinstance(message, Missions) and message.missions:
            self.view = message.missions[0]
        elif isinstance(message, AclMessage) and isinstance(message.content, Problem):
            self.problems.append(message.content)
        elif isinstance(message, WardState):
            self.ward = message

    def done(self) -> bool:
        return self.view is not None and self.view.status == "finished"

    def begun(self, action: str) -> bool:
        """Whether somebody in the ward is at ``action``."""
        return self.ward is not None and any(agent.busy.startswith(action) for agent in self.ward.agents)

    def disinfected(self) -> bool:
        return self.ward is not None and all(room.disinfected for room in self.ward.rooms)


@contextmanager
def over_dds(graph: Graph, folder: Path) -> Iterator[tuple[Heard, Launch]]:
    heard, fates = Heard(), LatestStatistics(graph)
    topics = {TOPIC: AclMessage, MISSIONS: Missions, STATE: WardState}
    with observe_graph(topics, heard.observe, fates.note) as onlooker:
        expect_free_names(onlooker.ros, graph)
        with Launch(graph, folder) as launch:
            yield heard, launch


@pytest.mark.parametrize(("rate", "listing"), [(0.0, LISTING_3), (100.0, LISTING_4)])
def test_mission_completes_over_dds(rate: float, listing: list, tmp_path: Path):
    with over_dds(HOSPITAL.with_parameters({"world": {"rate": rate}}), tmp_path) as (heard, launch):
        assert eventually(heard.done, timeout_s=60.0), heard.view
        launch.check()
    assert heard.view is not None
    done = [(each.action, *each.args) for each in heard.view.actions]
    assert done == listing
    assert len(heard.problems) == heard.view.recoveries == (rate == 100.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["coordinator", "spotrobot1"])
def test_restarted_process_resumes_its_part(name: str, tmp_path: Path):
    graph = HOSPITAL.with_parameters({"coordinator": {"memory_file": str(tmp_path / "memory.json")}})
    with over_dds(graph, tmp_path) as (heard, launch):
        assert eventually(lambda: heard.begun("a_approach_nurse"), timeout_s=60.0)
        os.kill(launch.pids[name], signal.SIGKILL)
        launch.start(name, ["node", "--graph", str(tmp_path / "graph.yaml"), name])
        assert eventually(lambda: heard.done() and heard.disinfected(), timeout_s=60.0), heard.view
        launch.check()
    assert heard.view is not None
    assert heard.view.id == 1
