"""A mission over DDS, in real time: the world, the coordinator and each agent in a process of its own."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from socialbot.agents.hospital.demo import hospital
from socialbot.agents.hospital.ward.messages import MESSAGES, MISSIONS, STATE, WardState
from socialbot.agents.teams.messages import COORDINATOR, EVERYBODY, AclMessage, Missions, Problem
from socialbot.bridge.diagnostics import unconnected
from socialbot.bridge.graph_observer import LatestStatistics, expect_free_names, observe_graph
from socialbot.graph.node import Graph
from socialbot.runtime.launch import Launch
from tests.agents.hospital.listings import LISTING_3, LISTING_4
from tests.agents.hospital.watched import Observer
from tests.system.running import eventually

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("hospital over DDS")]

HOSPITAL = hospital(coordinator={"proactive": False, "policy": "repair"})


class Heard(Observer):
    """Messages that were received so far."""

    def done(self) -> bool:
        return any(view.status == "finished" for view in self.views.values())

    def has_begun(self, action: str) -> bool:
        """Whether an agent executes ``action``."""
        return self.ward is not None and any(agent.busy.startswith(action) for agent in self.ward.agents)


@contextmanager
def over_dds(graph: Graph, folder: Path) -> Iterator[tuple[Heard, Launch]]:
    with observed(graph, folder) as (heard, launch, _):
        yield heard, launch


@contextmanager
def observed(graph: Graph, folder: Path) -> Iterator[tuple[Heard, Launch, Any]]:
    heard, fates = Heard(), LatestStatistics(graph)
    topics = {MESSAGES: AclMessage, MISSIONS: Missions, STATE: WardState}
    with observe_graph(topics, heard.observe, fates.note) as onlooker:
        expect_free_names(onlooker.ros, graph)
        with Launch(graph, folder) as launch:
            # The mission begins with the first message of the world, so the world waits until all others are heard.
            os.kill(launch.pids["world"], signal.SIGSTOP)
            others = onlooker.connections(graph, {config.name for config in graph.nodes} - {"world"})
            assert eventually(lambda: not unconnected(others), timeout_s=60.0), unconnected(others)
            os.kill(launch.pids["world"], signal.SIGCONT)
            yield heard, launch, onlooker.ros


@pytest.mark.parametrize(
    ("rate", "listing"), [pytest.param(0.0, LISTING_3, marks=pytest.mark.slow), (100.0, LISTING_4)]
)
def test_mission_completes_over_dds(rate: float, listing: list, tmp_path: Path):
    with observed(HOSPITAL.with_parameters({"world": {"rate": rate}}), tmp_path) as (heard, launch, ros):
        assert eventually(heard.done, timeout_s=60.0), heard.views
        launch.check()
        for name in heard.views[1].team:
            private = ros.get_subscriptions_info_by_topic(f"/{name}/team_messages")
            assert [each.node_name for each in private] == [name]
    # The shared topic carries nothing for one member.
    assert {message.receiver for message in heard.said if message.sender == COORDINATOR} == {EVERYBODY}
    assert heard.history() == listing
    assert len(heard.contents(Problem)) == heard.views[1].recoveries == (rate == 100.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["coordinator", "spotrobot1"])
def test_restarted_process_resumes_its_part(name: str, tmp_path: Path):
    graph = HOSPITAL.with_parameters({"coordinator": {"memory_file": str(tmp_path / "memory.json")}})
    with over_dds(graph, tmp_path) as (heard, launch):
        assert eventually(lambda: heard.has_begun("a_approach_nurse"), timeout_s=60.0)
        os.kill(launch.pids[name], signal.SIGKILL)
        launch.start(name, ["node", "--graph", str(tmp_path / "graph.yaml"), name])
        assert eventually(lambda: heard.done() and not heard.infected(), timeout_s=60.0), heard.views
        launch.check()
    assert list(heard.views) == [1]
