"""Which lost publishers are a reason for a new DDS participant."""

from __future__ import annotations

import pytest

from socialbot.bridge.diagnostics import DIAGNOSTICS_TOPIC
from socialbot.core.messages import Utterance
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input, Output
from socialbot.runtime._lost_publishers import FRESH_S, STEADY_S, RunningNodes


class Talker(Node):
    """Publishes sentences."""

    say = Output(Utterance, "/say")


class Hearer(Node):
    """Receives sentences."""

    said = Input(Utterance, "/say")

    @said
    def on_said(self, utterance: Utterance) -> None: ...


GRAPH = Graph("two", (NodeConfig("one", Talker), NodeConfig("two", Talker), NodeConfig("hearer", Hearer)))


class Nodes:
    """Running nodes, and their time (s)."""

    now = 100.0

    def __init__(self) -> None:
        self.running = RunningNodes(GRAPH, lambda: self.now)

    def run(self, seconds: float, *names: str) -> None:
        for _ in range(round(seconds)):
            for name in names:
                self.running.note(name, "active")
            self.now += 1.0


@pytest.fixture
def nodes() -> Nodes:
    return Nodes()


def test_running_publishers_that_are_lost_are_a_reason(nodes: Nodes) -> None:
    nodes.run(STEADY_S + 1, "one", "two", "hearer")
    assert nodes.running.lost({}) == ""
    assert nodes.running.lost({"/say": 1}) == "/say"
    assert nodes.running.lost({"/other": 0, "/say": 2}) == "/say"


def test_publishers_that_do_not_run_are_missed_for_a_better_reason(nodes: Nodes) -> None:
    nodes.run(STEADY_S + 1, "one")
    assert nodes.running.lost({"/say": 1}) == ""
    assert nodes.running.lost({"/say": 2}) == "/say"
    nodes.running.note("one", "waiting")
    assert nodes.running.lost({"/say": 2}) == ""


def test_publishers_need_time_to_be_heard(nodes: Nodes) -> None:
    nodes.run(STEADY_S, "one", "two")
    assert nodes.running.lost({"/say": 2}) == ""
    nodes.run(1, "one", "two")
    assert nodes.running.lost({"/say": 2}) == "/say"


def test_publishers_on_a_machine_out_of_reach_do_not_count(nodes: Nodes) -> None:
    nodes.run(STEADY_S + 1, "one", "two")
    nodes.now += FRESH_S
    assert nodes.running.lost({"/say": 2}) == ""
    nodes.run(STEADY_S, "one", "two")
    assert nodes.running.lost({"/say": 2}) == ""


@pytest.mark.parametrize("topic", [HEALTH_TOPIC, DIAGNOSTICS_TOPIC])
def test_all_nodes_publish_their_health_and_diagnostics(nodes: Nodes, topic: str) -> None:
    nodes.run(STEADY_S + 1, "hearer")
    assert nodes.running.lost({topic: 2}) == ""
    assert nodes.running.lost({topic: 3}) == topic
