"""Nodes hosted on ROS: when they start."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from socialbot.bridge.security import Freshness, Stream, new_key
from socialbot.core.clock import SECOND
from socialbot.core.messages import Health, Utterance
from socialbot.graph.node import Delivery, Graph, Input, Node, NodeConfig, Output
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


GRAPH = Graph("greeting", (NodeConfig("greeter", Greeter), NodeConfig("listener", Listener)))


@contextmanager
def hosting() -> Iterator[Any]:
    """Hosts nodes of `GRAPH` by their names, in this process."""
    from rclpy.executors import SingleThreadedExecutor

    from socialbot.bridge._host import NodeHost
    from socialbot.bridge.environment import ros_context

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
    monkeypatch.setattr("socialbot.bridge._node_thread.CONNECT_TIMEOUT_S", 0.1)
    monkeypatch.setattr(Greeter, "start", lambda self: started.set())
    with hosting() as host:
        host("greeter")
        assert started.wait(20.0)


def test_a_node_that_waits_for_others_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socialbot.bridge._node_thread.QUIET_WAIT_S", 0.1)
    said: list[Health] = []
    monkeypatch.setattr("socialbot.bridge._host.NodeHost._publish_health", lambda self, health: said.append(health))
    with hosting() as host:
        host("greeter")
        assert eventually(lambda: len(said) > 2)
        waiting = said[:2]
        host("listener")
        assert eventually(lambda: said[-1].state == "ok")
    assert {(one.node, one.state, one.reason) for one in waiting} == {
        ("greeter", "waiting", "nobody at the other end of /said yet")
    }


class Patient(Node):
    """Listens for something with a deadline, and rings ten times a second."""

    said = Input(Utterance, "/said", deadline_s=0.5)

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.rung: list[float] = []
        self.silences = 0

    def start(self) -> None:
        self.ring()

    def ring(self) -> None:
        self.rung.append(time.monotonic())
        self.call_after(0.1, self.ring)

    def on_silence(self, port: Input[Any], since: int | None) -> None:
        self.silences += 1


class Talker(Node):
    """Says something ten times a second."""

    said = Output(Utterance, "/said")

    def start(self) -> None:
        self.said.publish(Utterance(stamp=self.clock.now(), id="again", text="hello"))
        self.call_after(0.1, self.start)


@pytest.mark.parametrize("seconds", [-3600, -2, 3600])
def test_nodes_do_not_notice_that_the_clock_is_set(
    seconds: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody is taken to be silent, no timer is late or rings in a flood, and with keys nothing more is refused."""
    real, ahead = time.time_ns, [0]
    monkeypatch.setattr(time, "time_ns", lambda: real() + ahead[0])
    for kind in (Freshness, Stream):
        defaults = kind.__init__.__kwdefaults__
        assert defaults is not None
        monkeypatch.setitem(defaults, "wall", lambda: time.time_ns())
    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
    graph = Graph("patience", (NodeConfig("talker", Talker), NodeConfig("patient", Patient)))
    monkeypatch.setitem(globals(), "GRAPH", graph)
    with hosting() as host:
        host("talker")
        patient = host("patient")
        assert eventually(lambda: len(patient.rung) > 20)
        assert patient.silences == 0
        ahead[0] = seconds * SECOND
        before = len(patient.rung)
        assert eventually(lambda: len(patient.rung) > before + 30)
        assert patient.silences == 0
        apart = [later - sooner for sooner, later in itertools.pairwise(patient.rung)]
        assert min(apart) > 0.05
        assert max(apart) < 2.0


class Source(Node):
    """Publishes numbered utterances on request."""

    said = Output(Utterance, "/said")


@contextmanager
def composed() -> Iterator[tuple[Any, Any, Any]]:
    """A source and a listener in one process, and the list of messages that were published over DDS."""
    from rclpy.executors import SingleThreadedExecutor

    from socialbot.bridge._host import IntraProcess, NodeHost
    from socialbot.bridge.environment import ros_context

    graph = Graph("composed", (NodeConfig("source", Source), NodeConfig("listener", Listener)))
    with ros_context() as context:
        executor, intra_process = SingleThreadedExecutor(context=context), IntraProcess()
        hosts = [
            NodeHost(graph, one, ros_context=context, sim_time=False, intra_process=intra_process)
            for one in graph.placements
        ]
        for host in hosts:
            executor.add_node(host.ros_node)
            host.start()
        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        try:
            yield hosts[0], hosts[1], context
        finally:
            executor.shutdown()
            thread.join(2.0)
            for host in hosts:
                host.stop()


def test_composed_nodes_pass_messages_without_dds_until_another_process_subscribes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from socialbot.bridge import _host as host_module
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.transport import Sender, message_class, publisher_qos

    monkeypatch.setattr(host_module, "DDS_HOLD_S", 0.0)
    over_dds: list[str] = []
    publish = Sender.publish

    def spy(self: Sender, message: Any) -> None:
        if isinstance(message, Utterance):
            over_dds.append(message.text)
        publish(self, message)

    monkeypatch.setattr(Sender, "publish", spy)
    with composed() as (source, listener, _):
        ((publisher, _),) = source._publications.values()
        assert eventually(lambda: publisher.get_subscription_count() == 1 and listener.active_thread is not None)

        def say(text: str) -> None:
            source.node.said.publish(Utterance(stamp=source.node.clock.now(), id=text, text=text))

        for text in "abc":
            say(text)
        assert eventually(lambda: listener.node.heard == "abc")
        assert over_dds == []
        outside: list[Any] = []
        with spinning_node("outside") as ros:
            ros.create_subscription(
                message_class("std_msgs/msg/String"),
                "/said",
                lambda message: outside.append(message),
                publisher_qos(Delivery.EVERY),
            )
            assert eventually(lambda: publisher.get_subscription_count() == 2)
            for text in "def":
                say(text)
            assert eventually(lambda: listener.node.heard == "abcdef" and len(outside) == 3)
        assert over_dds == ["d", "e", "f"]
        assert eventually(lambda: publisher.get_subscription_count() == 1)
        say("g")
        assert eventually(lambda: listener.node.heard == "abcdefg")
        assert over_dds == ["d", "e", "f"]
