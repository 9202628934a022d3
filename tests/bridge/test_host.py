"""Nodes hosted on ROS: when they start."""

from __future__ import annotations

import itertools
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.bridge import _callback_queue
from socialbot.bridge.diagnostics import DiagnosticsSubscriber
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.graph_observer import observe_graph
from socialbot.bridge.keys import new_key
from socialbot.bridge.security import Freshness, Stream
from socialbot.core.clock import SECOND
from socialbot.core.messages import Health, JointTrajectory, RosMessage, Structured, Utterance
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Delivery, Input, Output
from tests.bridge.hosting import has_receivers, node_hosts
from tests.system.running import eventually

pytestmark = pytest.mark.ros


class Greeter(Node):
    """Publish a message at start."""

    said = Output(Utterance, "/said")

    def start(self) -> None:
        self.said.publish(Utterance(stamp=self.clock.now(), id="first", text="hello"))


class Listener(Node):
    """Record the received messages."""

    said = Input(Utterance, "/said")
    heard: str = ""

    @said
    def on_said(self, message: Utterance) -> None:
        self.heard += message.text


class Letter(Structured, frozen=True, kw_only=True):
    """A message with a receiver."""

    receiver: str


class Postman(Node):
    """Publish each letter on the topic of its receiver."""

    sent = Input(Letter, "/sent", optional=True)
    letters = Output(Letter, "/{receiver}/letters")

    @sent
    def on_sent(self, message: Letter) -> None:
        self.letters.publish(message)


class Home(Node):
    """Record the received letters."""

    letters = Input(Letter, "~/letters", optional=True)

    def start(self) -> None:
        self.got: list[str] = []

    @letters
    def on_letter(self, message: Letter) -> None:
        self.got.append(message.receiver)


GRAPH = Graph("greeting", (NodeConfig("greeter", Greeter), NodeConfig("listener", Listener)))


def test_a_node_starts_when_its_subscribers_are_connected() -> None:
    with node_hosts(GRAPH) as host:
        host("greeter")
        listener = host("listener").node
        assert eventually(lambda: listener.heard == "hello")


def test_an_optional_input_may_have_a_type_that_is_not_installed() -> None:
    class Feeler(Listener):
        """Also feels, if the message package of the sensor is installed."""

        touch = Input("absent_msgs/msg/Touch", "/touch", optional=True)

        @touch
        def on_touch(self, message: RosMessage) -> None:
            raise AssertionError

    nodes = (NodeConfig("greeter", Greeter), NodeConfig("listener", Feeler))
    with node_hosts(Graph("feeling", nodes, inputs=frozenset({"/touch"}))) as host:
        host("greeter")
        listener = host("listener").node
        assert eventually(lambda: listener.heard == "hello")


def test_message_on_the_topic_of_its_receiver_is_sent_to_nobody_else() -> None:
    nodes = (NodeConfig("postman", Postman), NodeConfig("ann", Home), NodeConfig("bob", Home))
    outside = Graph("elsewhere", (NodeConfig("cat", Home),))
    with node_hosts(Graph("post", nodes)) as host, node_hosts(outside) as host_outside:
        postman, homes = host("postman"), {name: host(name).node for name in ("ann", "bob")}
        homes["cat"] = host_outside("cat").node
        assert eventually(lambda: postman.active_thread is not None)
        for name in ("ann", "bob"):
            postman.node.on_sent(Letter(stamp=1, receiver=name))
        assert eventually(lambda: homes["ann"].got and homes["bob"].got)

        def send_to_cat() -> bool:
            # The topic of a receiver outside the graph is made with the first message, which it may miss.
            postman.node.on_sent(Letter(stamp=1, receiver="cat"))
            return bool(homes["cat"].got)

        assert eventually(send_to_cat)
        for name, home in homes.items():
            assert set(home.got) == {name}
            readers = postman.ros_node.get_subscriptions_info_by_topic(f"/{name}/letters")
            assert [each.node_name for each in readers] == [name]


class Nodder(Node):
    """Publish a motion."""

    motion = Output(JointTrajectory, "/neck/joint_trajectory")

    def nod(self) -> None:
        still = {"joint_names": ("tilt",), "positions": (0.1,), "velocities": (0.0,), "duration_s": 0.2}
        self.motion.publish(JointTrajectory(stamp=self.clock.now(), **still))


def test_a_controller_begins_a_motion_when_it_arrives_whatever_its_clock_says() -> None:
    from trajectory_msgs.msg import JointTrajectory as RosTrajectory

    got: list[Any] = []
    seen: list[Any] = []
    topics = {"/neck/joint_trajectory": JointTrajectory}
    begun = time.time_ns()
    with spinning_node("controller") as ros, observe_graph(topics, lambda _, each: seen.append(each), print):
        ros.create_subscription(RosTrajectory, "/neck/joint_trajectory", got.append, 10)
        with node_hosts(Graph("neck", (NodeConfig("nodder", Nodder),))) as host:
            nodder = host("nodder")
            assert eventually(lambda: nodder.active_thread is not None)
            assert eventually(lambda: has_receivers(nodder, "motion", 2))
            nodder.active_thread.queue.call_soon(nodder.node.nod)
            assert eventually(lambda: bool(got and seen))
    assert (got[-1].header.stamp.sec, got[-1].header.stamp.nanosec) == (0, 0)
    assert seen[-1].stamp >= begun  # the record of the run has the time of arrival


def test_a_node_starts_without_missing_subscribers_after_a_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    started = threading.Event()
    monkeypatch.setattr("socialbot.bridge._node_thread.CONNECT_TIMEOUT_S", 0.1)
    monkeypatch.setattr(Greeter, "start", lambda self: started.set())
    with node_hosts(GRAPH) as host:
        host("greeter")
        assert started.wait(60.0)


def test_a_waiting_node_reports_missing_connections(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socialbot.bridge._node_thread.QUIET_WAIT_S", 0.1)
    said: list[Health] = []
    monkeypatch.setattr(
        "socialbot.bridge._host.NodeHost._publish_health", lambda self, health, to_all: said.append(health)
    )
    with node_hosts(GRAPH) as host:
        host("greeter")
        assert eventually(lambda: len(said) > 2)
        waiting = said[:2]
        host("listener")
        assert eventually(lambda: said[-1].state == "ok")
    assert {(one.node, one.state, one.reason) for one in waiting} == {("greeter", "waiting", "unconnected: /said")}


class Patient(Node):
    """Has an input with a deadline and a timer of 10 Hz."""

    said = Input(Utterance, "/said", deadline_s=1.0)

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.rung: list[float] = []
        self.silences = 0

    @said
    def on_said(self, message: Utterance) -> None: ...

    def start(self) -> None:
        self.ring()

    def ring(self) -> None:
        self.rung.append(time.monotonic())
        self.call_after(0.1, self.ring)

    def on_silence(self, port: Input[Any], since: int | None) -> None:
        self.silences += 1


class Talker(Node):
    """Publishes at 10 Hz."""

    said = Output(Utterance, "/said")

    def start(self) -> None:
        self.said.publish(Utterance(stamp=self.clock.now(), id="again", text="hello"))
        self.call_after(0.1, self.start)


class Source(Node):
    """Publishes numbered utterances on request."""

    said = Output(Utterance, "/said")


class Busy(Listener):
    """Handle the first message until it may go on."""

    free = threading.Event()

    @Listener.said
    def on_said(self, message: Utterance) -> None:
        self.free.wait(60.0)
        self.heard += message.text


def test_a_slow_node_delays_no_other_and_bounds_its_queue(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its own oldest messages are lost, and its diagnostics say so."""
    monkeypatch.setattr(_callback_queue, "MAX_COMMANDS", 20)
    monkeypatch.setattr(Busy, "free", threading.Event())
    graph = Graph("slow", (NodeConfig("source", Source), NodeConfig("busy", Busy), NodeConfig("quick", Listener)))
    reports: list[dict[str, str]] = []
    texts = [f"{number}," for number in range(100)]
    with spinning_node("observer") as ros, node_hosts(graph) as host:
        DiagnosticsSubscriber(ros, lambda name, values: reports.append(values) if name == "busy" else None)
        source, busy, quick = host("source"), host("busy"), host("quick")
        assert eventually(lambda: has_receivers(source, "said", 2) and source.active_thread is not None)
        for text in texts:
            source.node.said.publish(Utterance(stamp=source.node.clock.now(), id=text, text=text))
            assert eventually(lambda text=text: quick.node.heard.endswith(text))
        assert quick.node.heard == "".join(texts)
        assert busy.node.heard == ""
        assert eventually(lambda: reports and reports[-1]["dropped"] == "79 said")
        Busy.free.set()
        assert eventually(lambda: busy.node.heard == "".join(texts[:1] + texts[80:]))


def test_nodes_are_unaffected_by_changes_of_the_system_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Inputs do not time out, timers fire once and in time, and messages are accepted."""
    real, ahead = time.time_ns, [0]
    monkeypatch.setattr(time, "time_ns", lambda: real() + ahead[0])
    for kind in (Freshness, Stream):
        defaults = kind.__init__.__defaults__ or ()
        changed = tuple(time.time_ns if default is real else default for default in defaults)
        monkeypatch.setattr(kind.__init__, "__defaults__", changed)
    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv("SOCIALBOT_KEYS", str(tmp_path / "keys"))
    graph = Graph("patience", (NodeConfig("talker", Talker), NodeConfig("patient", Patient)))
    with node_hosts(graph) as host:
        host("talker")
        patient = host("patient").node
        for seconds in (0, 3600, 3598, 0):
            ahead[0] = seconds * SECOND
            before = len(patient.rung)
            assert eventually(lambda before=before: len(patient.rung) > before + 12)
            assert patient.silences == 0
        apart = [later - sooner for sooner, later in itertools.pairwise(patient.rung)]
        assert min(apart) > 0.05
        assert max(apart) < 2.0


def test_composed_nodes_use_dds_only_for_subscribers_outside(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from socialbot.bridge import _host as host_module
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.qos import publisher_qos
    from socialbot.bridge.transport import Sender, message_class

    monkeypatch.setattr(host_module, "DDS_HOLD_S", 0.0)
    over_dds: list[str] = []
    publish = Sender.publish

    def spy(self: Sender, message: Any) -> None:
        if isinstance(message, Utterance):
            over_dds.append(message.text)
        publish(self, message)

    monkeypatch.setattr(Sender, "publish", spy)
    graph = Graph("composed", (NodeConfig("source", Source), NodeConfig("listener", Listener)))
    with node_hosts(graph, intra_process=host_module.IntraProcess()) as host:
        source, listener = host("source"), host("listener")
        (publisher,) = (sender.publisher for sender in source._senders.values())
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


def test_publishers_outside_without_end_do_not_keep_a_node_busy(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stranger can announce any number, of which rclpy makes objects at each look. Here one takes a minute."""
    spent_s: list[float] = []

    def look(*_: object) -> list[object]:
        spent_s.append(60.0)
        return []

    monkeypatch.setattr("socialbot.bridge.discovery.publishers", look)
    clocks = SimpleNamespace(monotonic=time.monotonic, thread_time=lambda: sum(spent_s))
    monkeypatch.setattr("socialbot.bridge.discovery.time", clocks, raising=False)
    graph = Graph("outside", (NodeConfig("listener", Listener),), inputs=frozenset({"/said"}))
    with node_hosts(graph) as host:
        listener = host("listener")
        for _ in range(3):
            listener._check_outside()
        assert len(spent_s) == 1


@pytest.mark.parametrize(
    ("kind", "reliable", "words"),
    [
        ("std_msgs/msg/String", False, "the publisher of /said is best effort: nothing arrives; give the input said"),
        ("std_msgs/msg/Bool", True, "/said is std_msgs/msg/Bool, not std_msgs/msg/String"),
    ],
)
def test_a_node_tells_why_no_publisher_outside_matches(
    kind: str, reliable: bool, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from socialbot.bridge.qos import profile
    from socialbot.bridge.transport import message_class, open_transport

    monkeypatch.setattr("socialbot.bridge._host.OUTSIDE_S", 0.1)
    graph = Graph("outside", (NodeConfig("listener", Listener),), inputs=frozenset({"/said"}))
    with node_hosts(graph) as host, spinning_node("driver") as driver, spinning_node("other") as other:
        listener = host("listener")

        def reason() -> str:
            thread = listener.active_thread
            return "" if thread is None or thread.health is None else thread.health.reason

        driver.create_publisher(message_class(kind), "/said", profile(10, reliable=reliable))
        assert eventually(lambda: words in reason())
        sender = open_transport().advertise(other, "/said", Utterance)
        assert eventually(lambda: sender.publisher.get_subscription_count() == 1 and not reason())
        sender.publish(Utterance(stamp=1, id="a", text="a"))
        assert eventually(lambda: listener.node.heard == "a")
