"""Nodes hosted on ROS: when they start."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from socialbot.graph import Graph, Input, Node, Output, Placement
from socialbot.messages import Health, Utterance
from tests.system.running import eventually

pytestmark = pytest.mark.ros


class Greeter(Node):
    """Says something as soon as it starts."""

    said = Output(Utterance, "/said")

    def start(self) -> None:
        self.said.publish(Utterance(stamp=self.clock.now(), id="first", text="hello"))


class Listener(Node):
    """Notes what it hears."""

    said = Input(Utterance, "/said")
    heard: str = ""

    @said
    def on_said(self, message: Utterance) -> None:
        self.heard += message.text


GRAPH = Graph("greeting", (Placement("greeter", Greeter), Placement("listener", Listener)))


@contextmanager
def hosting() -> Iterator[Any]:
    """Hosts nodes of `GRAPH` by their names, in this process."""
    from rclpy.executors import SingleThreadedExecutor

    from socialbot.bridge.host import NodeHost
    from socialbot.bridge.session import ros_context

    hosts: list[NodeHost] = []
    with ros_context() as context:
        executor = SingleThreadedExecutor(context=context)

        def host(name: str) -> Any:
            hosts.append(NodeHost(GRAPH, GRAPH.placement(name), ros_context=context, sim_time=False))
            executor.add_node(hosts[-1].ros_node)
            hosts[-1].start()
            return hosts[-1].node

        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        try:
            yield host
        finally:
            executor.shutdown()
            thread.join(2.0)
            for each in hosts:
                each.stop()


def test_a_node_starts_when_those_are_there_who_listen_to_it() -> None:
    with hosting() as host:
        host("greeter")
        listener = host("listener")
        assert eventually(lambda: listener.heard == "hello")


def test_a_node_starts_without_those_who_do_not_come(monkeypatch: pytest.MonkeyPatch) -> None:
    started = threading.Event()
    monkeypatch.setattr("socialbot.bridge.life.CONNECTED_S", 0.1)
    monkeypatch.setattr(Greeter, "start", lambda self: started.set())
    with hosting() as host:
        host("greeter")
        assert started.wait(20.0)


def test_a_node_that_waits_for_others_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socialbot.bridge.life.WAITS_QUIETLY_S", 0.1)
    said: list[Health] = []
    monkeypatch.setattr("socialbot.bridge.host.NodeHost._say_health", lambda self, health: said.append(health))
    with hosting() as host:
        host("greeter")
        assert eventually(lambda: len(said) > 2)
        waiting = said[:2]
        host("listener")
        assert eventually(lambda: said[-1].state == "ok")
    assert {(one.node, one.state, one.reason) for one in waiting} == {
        ("greeter", "waiting", "nobody at the other end of /said yet")
    }
