"""Which lost publishers are a reason for a new DDS participant."""

from __future__ import annotations

import pytest

from socialbot.bridge.diagnostics import DIAGNOSTICS_TOPIC
from socialbot.core.messages import Utterance
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input, Output
from socialbot.runtime._lost_publishers import (
    FRESH_S,
    LONGEST_PAUSE_S,
    RENEWAL_PAUSE_S,
    STEADY_S,
    RenewalBackoff,
    RunningNodes,
)


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


class Process:
    """A process whose participant is replaced when that is due, and the time (s)."""

    now = 100.0

    def __init__(self) -> None:
        self.backoff = RenewalBackoff(lambda: self.now)
        self.backoff.started()

    def lives(self, seconds: float, *, is_lost: bool) -> list[float]:
        """Ages (s) of its participants when they are replaced."""
        begun, ages = self.now, []
        for _ in range(round(seconds)):
            self.now += 1.0
            if self.backoff.is_due(is_lost=is_lost):
                ages.append(self.now - begun)
                self.backoff.started()
                begun = self.now
        return ages


def test_replacements_that_do_not_help_are_ever_more_seldom() -> None:
    pauses = [RENEWAL_PAUSE_S, 60.0, 120.0, 240.0, LONGEST_PAUSE_S, LONGEST_PAUSE_S]
    assert Process().lives(sum(pauses), is_lost=True) == pauses


def test_a_loss_after_a_good_time_is_mended_at_once() -> None:
    process = Process()
    for _ in range(5):
        assert process.lives(RENEWAL_PAUSE_S, is_lost=False) == []
        assert process.lives(1, is_lost=True) == [1.0]
    assert process.lives(RENEWAL_PAUSE_S - 1, is_lost=False) == []
    assert process.lives(100, is_lost=True) == [2 * RENEWAL_PAUSE_S - (RENEWAL_PAUSE_S - 1)]
