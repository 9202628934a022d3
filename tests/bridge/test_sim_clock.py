"""Simulated time that waits for the nodes: over DDS, with nodes that are slow, busy aside, late or dead."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from socialbot.bridge import sim_clock as timekeeper
from socialbot.bridge.sim_clock import SimClock
from socialbot.core.clock import SECOND
from socialbot.core.errors import NodeError
from socialbot.core.messages import Utterance
from socialbot.graph.node import Graph, Input, Node, NodeConfig, Output

pytestmark = pytest.mark.ros

SLOW_S = 0.3
"""Real time that a node here takes for something."""


class Beat(Node):
    """Says something every second, and takes its time over what it hears."""

    said = Output(Utterance, "/said")

    def start(self) -> None:
        self.beats: list[int] = []
        self.call_after(1.0, self.beat)

    def beat(self) -> None:
        self.beats.append(self.clock.now())
        self.said.publish(Utterance(stamp=self.clock.now(), id=str(len(self.beats)), text="beat"))
        self.call_after(1.0, self.beat)


class Planner(Node):
    """Has something worked out aside for each thing that it hears, and notes when it was heard and known."""

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
    """Nodes in simulated time, hosted in this process, and an rclpy node to move it."""
    from rclpy.executors import SingleThreadedExecutor

    from socialbot.bridge._host import NodeHost
    from socialbot.bridge.environment import ros_context, spinning_node

    graph = Graph("pacing", tuple(NodeConfig(name, kind) for name, kind in nodes.items()), frozenset({"/said"}))
    with spinning_node("mover") as ros, ros_context() as context:
        executor = SingleThreadedExecutor(context=context)
        hosts = [NodeHost(graph, one, ros_context=context, sim_time=True) for one in graph.placements]
        for host in hosts:
            executor.add_node(host.ros_node)
            host.start()
        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        try:
            yield ros, {host.name: host.node for host in hosts}
        finally:
            executor.shutdown()
            thread.join(2.0)
            for host in hosts:
                host.stop()


def test_timers_fire_at_their_times_however_slow_a_node_is() -> None:
    with hosted(quick=Beat, slow=Sleeper) as (ros, nodes):
        keeper = SimClock(ros, nodes, step_s=0.25)
        keeper.advance(3.1)
        first = keeper.now - round(3.1 * SECOND)
        for node in nodes.values():
            assert len(node.beats) == 3
            assert [(beat - first) / SECOND for beat in node.beats] == pytest.approx([1.0, 2.0, 3.0], abs=0.26)


def test_a_long_time_passes_fast_where_nothing_is_to_be_done() -> None:
    with hosted(quick=Beat) as (ros, nodes):
        keeper = SimClock(ros, nodes, step_s=0.5)
        keeper.advance(0.5)
        begun = time.monotonic()
        keeper.advance(60.0)
        assert time.monotonic() - begun < 20.0
        assert len(nodes["quick"].beats) == 60


def test_work_aside_takes_no_simulated_time() -> None:
    with hosted(quick=Beat, planner=Planner) as (ros, nodes):
        keeper = SimClock(ros, nodes, step_s=0.1)
        keeper.advance(0.1)
        assert keeper.until(lambda: len(nodes["planner"].known) == 2, limit_s=5.0)
        for said, known in nodes["planner"].known:
            # It may be on its way while time goes on by a step or two, but not while it is worked on.
            assert (known - said) / SECOND <= 0.35


def test_until_says_when_the_time_was_up() -> None:
    with hosted(quick=Beat) as (ros, nodes):
        keeper = SimClock(ros, nodes, step_s=0.25, start=100 * SECOND)
        assert not keeper.until(lambda: False, limit_s=1.0)
        assert keeper.now / SECOND == pytest.approx(101.0, abs=0.01)


def test_a_node_that_does_not_keep_up_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timekeeper, "STEP_TIMEOUT_S", 0.6)
    with hosted(quick=Beat) as (ros, nodes):
        keeper = SimClock(ros, [*nodes, "nobody"])
        with pytest.raises(NodeError, match="is not done after") as caught:
            keeper.advance(1.0)
        assert "quick" not in str(caught.value)
        keeper.awaited.remove("nobody")
        keeper.advance(1.0)
