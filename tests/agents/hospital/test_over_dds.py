"""A mission over DDS, in real time: the world, the coordinator and each agent in a process of its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from socialbot.agents.hospital.coordinator_node import MISSIONS, HospitalCoordinator
from socialbot.agents.hospital.messages import TOPIC, AclMessage, Missions, MissionView, Problem
from socialbot.agents.hospital.robot_node import Nurse, Spot, Uvd
from socialbot.agents.hospital.ward_node import HospitalWorld
from socialbot.bridge.launch import Launch
from socialbot.bridge.observing import Fates, observing
from socialbot.bridge.readiness import expect_free_names
from socialbot.graph import Graph, Placement
from socialbot.messages import Message
from tests.agents.hospital.test_coordinator import LISTING_3, LISTING_4
from tests.system.running import eventually

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("hospital over DDS")]

HOSPITAL = Graph(
    "hospital",
    (
        Placement("world", HospitalWorld),
        Placement("coordinator", HospitalCoordinator, {"proactive": False, "policy": "repair"}),
        Placement("spotrobot1", Spot),
        Placement("uvdrobot1", Uvd),
        Placement("nurse_disinfected1", Nurse),
    ),
)


class Heard:
    """What came on the topics so far."""

    def __init__(self) -> None:
        self.view: MissionView | None = None
        self.problems: list[Problem] = []

    def observe(self, topic: str, message: Message) -> None:
        if isinstance(message, Missions) and message.missions:
            self.view = message.missions[0]
        elif isinstance(message, AclMessage) and isinstance(message.content, Problem):
            self.problems.append(message.content)

    def done(self) -> bool:
        return self.view is not None and self.view.status == "finished"


@contextmanager
def over_dds(graph: Graph, folder: Path) -> Iterator[tuple[Heard, Launch]]:
    heard, fates = Heard(), Fates(graph)
    with observing({TOPIC: AclMessage, MISSIONS: Missions}, heard.observe, fates.note) as onlooker:
        expect_free_names(onlooker.ros, graph)
        with Launch(graph, folder) as launch:
            yield heard, launch


@pytest.mark.parametrize(("rate", "listing"), [(0.0, LISTING_3), (100.0, LISTING_4)])
def test_a_mission_is_done_by_processes_that_only_talk(rate: float, listing: list, tmp_path: Path):
    with over_dds(HOSPITAL.with_parameters({"world": {"rate": rate}}), tmp_path) as (heard, launch):
        assert eventually(heard.done, timeout_s=60.0), heard.view
        launch.check()
    assert heard.view is not None
    done = [(each.action, *each.args) for each in heard.view.actions]
    assert done == listing or heard.view.recoveries > len(heard.problems), "an agent may have come late"
    assert done[-9 if rate == 0.0 else -3 :] == listing[-9 if rate == 0.0 else -3 :]
    assert len(heard.problems) == (rate == 100.0)
