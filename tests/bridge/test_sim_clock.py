"""Simulated time that waits for slow, busy, late and missing nodes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from socialbot.bridge import player as timeclock
from socialbot.bridge.player import SimClock
from socialbot.core.clock import SECOND
from socialbot.core.errors import NodeError
from socialbot.core.messages import Utterance
from socialbot.graph.node import Graph, Input, Node, NodeConfig, Output
from tests.bridge.hosting import node_hosts

pytestmark = pytest.mark.ros

SLOW_S = 0.3
"""Real time that a node needs."""


class Beat(Node):
    """Publishes every second."""

    said = Output(Utterance, "/said")

    def start(self) -> None:
        self.beats: list[int] = []
        self.call_after(1.0, self.beat)

    def beat(self) -> None:
        self.beats.append(self.clock.now())
        self.said.publish(Utterance(stamp=self.clock.now(), id=str(len(self.beats)), text="beat"))
        self.call_after(1.0, self.beat)


class Planner(Node):
    """Works in the background on each message, and notes the times of the message and of the result."""

    said = Input(Utterance, "/said")

    def start(self) -> None:
        self.known: list[tuple[int, int]] = []

    @said
    def on_said(self, message: Utterance) -> None:
        self.context.run_in_background(
            lambda: time.sleep(SLOW_S), lambda _: self.known.append((message.stamp, self.clock.now()))
        )


class Sleeper(Beat):
    """Takes real time for each beat."""

    def beat(self) -> None:
        time.sleep(SLOW_S)
        super().beat()


@contextmanager
def hosted(**nodes: type[Node]) -> Iterator[tuple[Any, dict[str, Any]]]:
    """An rclpy node for a clock, and nodes in simulated time by name."""
    from socialbot.bridge.environment import spinning_node

    graph = Graph("pacing", tuple(NodeConfig(name, kind) for name, kind in nodes.items()), frozenset({"/said"}))
    with spinning_node("clock") as ros, node_hosts(graph, sim_time=True) as host:
        yield ros, {name: host(name).node for name in nodes}


def test_timers_of_slow_nodes_fire_at_their_times() -> None:
    with hosted(quick=Beat, slow=Sleeper) as (ros, nodes):
        clock = SimClock(ros, nodes, step_s=0.25)
        clock.advance(3.1)
        first = clock.now - round(3.1 * SECOND)
        for node in nodes.values():
            assert len(node.beats) == 3
            assert [(beat - first) / SECOND for beat in node.beats] == pytest.approx([1.0, 2.0, 3.0], abs=0.26)


def test_idle_time_passes_faster_than_real_time() -> None:
    with hosted(quick=Beat) as (ros, nodes):
        clock = SimClock(ros, nodes, step_s=0.5)
        clock.advance(0.5)
        begun = time.monotonic()
        clock.advance(60.0)
        assert time.monotonic() - begun < 60.0
        assert len(nodes["quick"].beats) == 60


def test_background_work_takes_no_simulated_time() -> None:
    with hosted(quick=Beat, planner=Planner) as (ros, nodes):
        clock = SimClock(ros, nodes, step_s=0.1)
        clock.advance(0.1)
        assert clock.until(lambda: len(nodes["planner"].known) == 2, limit_s=5.0)
        for said, known in nodes["planner"].known:
            # It may be on its way while time goes on by a step or two, but not while it is worked on.
            assert (known - said) / SECOND <= 0.35


def test_until_returns_false_at_the_limit() -> None:
    with hosted(quick=Beat) as (ros, nodes):
        clock = SimClock(ros, nodes, step_s=0.25, start=100 * SECOND)
        assert not clock.until(lambda: False, limit_s=1.0)
        assert clock.now / SECOND == pytest.approx(101.0, abs=0.01)


def test_the_error_names_late_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timeclock, "STEP_TIMEOUT_S", 0.6)
    with hosted(quick=Beat) as (ros, nodes):
        clock = SimClock(ros, [*nodes, "nobody"])
        with pytest.raises(NodeError, match="is not done after") as caught:
            clock.advance(1.0)
        assert "quick" not in str(caught.value)
        clock.awaited.remove("nobody")
        clock.advance(1.0)
