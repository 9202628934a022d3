"""Attacks of an intruder on topics of standard ROS types, whose messages have detached seals."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from socialbot.bags.codec import STRING, encode
from socialbot.bags.reader import open_bag
from socialbot.bridge.detached_seals import seal_topic
from socialbot.bridge.environment import KEYS_VARIABLE, OPEN_TOPICS_VARIABLE, spinning_node
from socialbot.bridge.inspection import LiveImages
from socialbot.bridge.keys import new_key
from socialbot.bridge.qos import profile, publisher_qos
from socialbot.bridge.recorder import Recording, record
from socialbot.bridge.sim_clock import CLOCK_TOPIC, KEPT_TOPIC, ROUND_TOPIC, Round, SimClock, StepReport
from socialbot.bridge.transport import WINDOW_VARIABLE, RclpyTypes, message_class, open_transport
from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError
from socialbot.core.messages import CameraInfo, CompressedImage, Image, JointTrajectory, Message, Utterance, ros_message
from socialbot.graph.node import Context, Graph, Node, NodeConfig
from socialbot.graph.ports import Delivery, Input, Output
from socialbot.vision.images import as_jpeg
from tests.bridge.hosting import has_receivers, node_hosts
from tests.system.running import eventually

pytestmark = pytest.mark.ros

Battery = ros_message("sensor_msgs/msg/BatteryState")


def image(level: int) -> Image:
    return Image.from_bgr(np.full((8, 8, 3), level, np.uint8), stamp=level + 1, frame_id="camera")


def large_image(level: int) -> Image:
    """An image that is sealed by tags."""
    return Image.from_bgr(np.full((480, 640, 3), level, np.uint8), stamp=level + 1, frame_id="camera")


def battery(level: int) -> Message:
    made = message_class("sensor_msgs/msg/BatteryState")(percentage=level / 100)
    return Battery(stamp=0, ros=made)


@dataclass(frozen=True)
class Case:
    """A standard type with its delivery, and messages by level: genuine is 1, forged is 2."""

    kind: type[Message]
    make: Callable[[int], Message]
    level: Callable[[Any], int]
    delivery: Delivery = Delivery.EVERY


CASES = {
    "picture": Case(Image, image, lambda one: int(one.data[0]), Delivery.NEWEST),
    "large picture": Case(Image, large_image, lambda one: int(one.data[0]), Delivery.NEWEST),
    "compressed": Case(
        CompressedImage,
        lambda level: CompressedImage(stamp=1, frame_id="", format="jpeg", data=np.full(5000, level, np.uint8)),
        lambda one: int(one.data[0]),
        Delivery.NEWEST,
    ),
    "camera_info": Case(
        CameraInfo,
        lambda level: CameraInfo(stamp=1, frame_id="camera", width=level, height=1, k=(1.0,) * 9),
        lambda one: one.width,
        Delivery.LATCHED,
    ),
    "trajectory": Case(
        JointTrajectory,
        lambda level: JointTrajectory(
            stamp=1, joint_names=("pan",), positions=(float(level),), velocities=(), duration_s=1.0
        ),
        lambda one: round(one.positions[0]),
    ),
    "battery": Case(Battery, battery, lambda one: round(100 * one.percentage)),
}


def nodes_of(case: Case) -> Graph:
    """A graph of a sender and a receiver of the type of ``case``."""

    class Source(Node):
        out = Output(case.kind, "/standard", case.delivery)

    class Sink(Node):
        seen = Input(case.kind, "/standard", case.delivery)

        def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
            super().__init__(name, context, parameters)
            self.got: list[int] = []

        @seen
        def on_seen(self, message: Any) -> None:
            self.got.append(case.level(message))

    return Graph("standard", (NodeConfig("source", Source), NodeConfig("sink", Sink)))


@pytest.fixture
def keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    new_key("robot", tmp_path / "keys")
    monkeypatch.setenv(KEYS_VARIABLE, str(tmp_path / "keys"))
    monkeypatch.setenv(WINDOW_VARIABLE, "1.0")


@dataclass
class Intruder:
    """Records a topic and its seals as serialised bytes, and publishes on both."""

    ros: Any
    topic: str
    ros_class: Any
    delivery: Delivery = Delivery.EVERY
    heard: list[bytes] = field(default_factory=list)
    seals: list[bytes] = field(default_factory=list)

    def __post_init__(self) -> None:
        qos, text = publisher_qos(self.delivery), message_class(STRING)
        self.ros.create_subscription(self.ros_class, self.topic, lambda one: self.heard.append(one), qos, raw=True)
        self.ros.create_subscription(text, seal_topic(self.topic), lambda one: self.seals.append(one), qos, raw=True)
        self.messages = self.ros.create_publisher(self.ros_class, self.topic, qos)
        self.sealed = self.ros.create_publisher(text, seal_topic(self.topic), qos)

    def is_connected(self) -> bool:
        """Whether another process than this one receives both topics."""
        return self.messages.get_subscription_count() > 1 and self.sealed.get_subscription_count() > 1


@pytest.mark.parametrize("name", CASES)
def test_a_node_takes_only_sealed_messages_once(name: str, keys: None) -> None:
    case = CASES[name]
    graph = nodes_of(case)
    with node_hosts(graph) as host, spinning_node("intruder") as ros:
        sink, source = host("sink"), host("source")
        intruder = Intruder(ros, "/standard", open_transport().message_class(case.kind), case.delivery)
        assert eventually(intruder.is_connected)
        assert eventually(lambda: has_receivers(source, "out", 2))
        source.node.context.call_soon(lambda: source.node.out.publish(case.make(1)))
        assert eventually(lambda: sink.node.got == [1] and intruder.heard and intruder.seals)
        intruder.messages.publish(encode(case.make(2), RclpyTypes()))
        intruder.sealed.publish(intruder.seals[0])
        intruder.messages.publish(intruder.heard[0])
        assert eventually(lambda: sink.statistics.refusals["unsealed"] == 2)
        assert eventually(lambda: sink.statistics.refusals.total() >= 3)
        assert set(sink.statistics.refusals) <= {"unsealed", "replayed", "late"}
        source.node.context.call_soon(lambda: source.node.out.publish(case.make(3)))
        assert eventually(lambda: sink.node.got == [1, 3])


def test_a_late_node_gets_the_latched_message_of_long_ago(keys: None) -> None:
    case = CASES["camera_info"]
    with node_hosts(nodes_of(case)) as host, spinning_node("watch") as ros:
        source = host("source")
        watch = Intruder(ros, "/standard", open_transport().message_class(case.kind), case.delivery)
        source.node.context.call_soon(lambda: source.node.out.publish(case.make(1)))
        assert eventually(lambda: len(watch.seals) >= 4)  # longer than the window
        sink = host("sink")
        assert eventually(lambda: sink.node.got == [1])


def test_an_open_topic_needs_no_seal(keys: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(OPEN_TOPICS_VARIABLE, "/other:/standard")
    case = CASES["picture"]
    with node_hosts(nodes_of(case)) as host, spinning_node("driver") as ros:
        sink = host("sink")
        driver = Intruder(ros, "/standard", open_transport().message_class(case.kind), case.delivery)
        assert eventually(lambda: driver.messages.get_subscription_count() > 1)
        driver.messages.publish(encode(case.make(4), RclpyTypes()))
        assert eventually(lambda: sink.node.got == [4])


@pytest.mark.parametrize("text", ["camera", "/camera image", "/camera/", "/a:b"])
def test_open_topics_have_full_names(text: str) -> None:
    with pytest.raises(ParameterError, match="full topic name"):
        open_transport({OPEN_TOPICS_VARIABLE: text})


def test_the_time_of_a_simulation_cannot_be_forged(keys: None) -> None:
    class Idle(Node):
        """Has a clock."""

    graph = Graph("idle", (NodeConfig("idle", Idle),))
    clock_class = message_class("rosgraph_msgs/msg/Clock")
    text = message_class(STRING)
    with spinning_node("clock") as ros, node_hosts(graph, sim_time=True) as host, spinning_node("intruder") as stranger:
        idle = host("idle")
        intruder = Intruder(stranger, CLOCK_TOPIC, clock_class)
        rounds = stranger.create_publisher(text, ROUND_TOPIC, publisher_qos(Delivery.LATCHED))
        reports = stranger.create_publisher(text, KEPT_TOPIC, publisher_qos(Delivery.LATCHED))
        clock = SimClock(ros, ["idle"])
        assert eventually(intruder.is_connected)
        assert eventually(lambda: rounds.get_subscription_count() and reports.get_subscription_count())
        clock.advance(1.0)
        assert eventually(lambda: idle.node.clock.now() == clock.now)
        far = clock_class()
        far.clock.sec = 10**6
        for _ in range(3):
            intruder.messages.publish(far)
        rounds.publish(text(data=Round(10**9, 10**9, {}).encode()))
        lie = StepReport("idle", "forged", 10**18, {}, {}, 0, 10**9, 10**9, 0)
        reports.publish(text(data=lie.encode()))
        assert eventually(lambda: idle.statistics.refusals["unsealed"] >= 4)
        clock.advance(1.0)
        assert eventually(lambda: idle.node.clock.now() == clock.now)
        assert clock.now == 3 * SECOND


def test_a_stranger_does_not_hold_the_messages_of_a_node_in_simulated_time(keys: None) -> None:
    """A publisher on the topic of rounds is no simulation clock as long as it sends no valid round."""
    case, clock_class = CASES["trajectory"], message_class("rosgraph_msgs/msg/Clock")
    with spinning_node("player") as ros, spinning_node("intruder") as stranger:
        clock = open_transport().advertise_class(ros, CLOCK_TOPIC, clock_class, standard=True)
        rounds = stranger.create_publisher(message_class(STRING), ROUND_TOPIC, publisher_qos(Delivery.LATCHED))
        with node_hosts(nodes_of(case), sim_time=True) as host:
            sink, source = host("sink"), host("source")
            assert eventually(lambda: rounds.get_subscription_count() == 2)
            assert eventually(lambda: clock.publisher.get_subscription_count() == 2)
            assert eventually(lambda: has_receivers(source, "out", 1))
            now = clock_class()
            now.clock.sec = 1
            clock.publish_encoded(now)
            source.node.context.call_soon(lambda: source.node.out.publish(case.make(1)))
            assert eventually(lambda: sink.node.got == [1], timeout_s=20.0)


@contextmanager
def publishing(topic: str, kind: type[Message]) -> Iterator[tuple[Any, Intruder]]:
    """A sender with keys and an intruder on ``topic``."""
    with spinning_node("friend") as friend, spinning_node("intruder") as ros:
        transport = open_transport()
        sender = transport.advertise(friend, topic, kind, Delivery.NEWEST)
        yield sender, Intruder(ros, topic, transport.message_class(kind), Delivery.NEWEST)


def test_the_page_shows_only_sealed_images(keys: None) -> None:
    with publishing("/camera", Image) as (sender, intruder), spinning_node("page") as ros:
        live = LiveImages(ros, "/camera", Image)
        live.at(0)
        assert eventually(lambda: sender.publisher.get_subscription_count() == 2)
        assert eventually(lambda: sender.seals.get_subscription_count() == 2)
        intruder.messages.publish(encode(image(2), RclpyTypes()))

        def shown() -> bytes:
            sender.publish(image(1))
            found = live.at(10 * SECOND)
            return b"" if found is None else found.jpeg

        assert eventually(shown)
        assert shown() == as_jpeg(image(1))


def test_a_recording_holds_only_sealed_images(keys: None, tmp_path: Path) -> None:
    done, made = threading.Event(), list[Recording]()
    thread = threading.Thread(
        target=lambda: made.append(record(tmp_path / "bag", topics=["/camera"], stopped=done.is_set))
    )
    with publishing("/camera", Image) as (sender, intruder):
        thread.start()
        try:
            assert eventually(lambda: sender.publisher.get_subscription_count() == 2)
            assert eventually(lambda: sender.seals.get_subscription_count() == 2)
            assert eventually(intruder.is_connected)
            intruder.messages.publish(encode(image(2), RclpyTypes()))
            assert eventually(lambda: len(intruder.heard) == 1)
            intruder.messages.wait_for_all_acked()
            sender.publish(image(1))
            sender.publisher.wait_for_all_acked()
            sender.seals.wait_for_all_acked()
            assert eventually(lambda: len(intruder.heard) == 2)
        finally:
            done.set()
            thread.join()
    assert made[0].refused == {"/camera": "1 unsealed"}
    with open_bag(tmp_path / "bag") as bag:
        found = [one for _, one in bag.messages({"/camera": "/camera"}, {"/camera": Image}) if isinstance(one, Image)]
    assert [int(one.data[0]) for one in found] == [1]


def test_a_recording_loses_nothing_when_a_publisher_of_another_reliability_joins(keys: None, tmp_path: Path) -> None:
    """The recorder subscribes again then, with a quality of service for both."""
    done, made = threading.Event(), list[Recording]()
    thread = threading.Thread(
        target=lambda: made.append(record(tmp_path / "bag", topics=["/standard"], stopped=done.is_set))
    )
    transport = open_transport()
    with spinning_node("source") as ros, spinning_node("other") as other:
        sender = transport.advertise(ros, "/standard", CameraInfo)
        thread.start()
        try:
            assert eventually(lambda: sender.publisher.get_subscription_count() == 1)
            assert eventually(lambda: sender.seals.get_subscription_count() == 1)
            sent, make = 0, CASES["camera_info"].make

            def send_until(reached: Callable[[], bool]) -> None:
                nonlocal sent
                while not reached():
                    sent += 1
                    sender.publish(make(sent))
                    done.wait(0.02)

            send_until(lambda: sent == 50)
            joined = other.create_publisher(
                message_class("sensor_msgs/msg/CameraInfo"), "/standard", profile(10, reliable=False)
            )
            send_until(lambda: joined.get_subscription_count() == 1)
            last = sent + 50
            send_until(lambda: sent == last)
            sender.publisher.wait_for_all_acked()
            sender.seals.wait_for_all_acked()
        finally:
            done.set()
            thread.join()
    assert made[0].refused == {}
    with open_bag(tmp_path / "bag") as bag:
        messages = bag.messages({"/standard": "/standard"}, {"/standard": CameraInfo})
        found = [one.width for _, one in messages if isinstance(one, CameraInfo)]
    assert found == list(range(1, sent + 1))


def test_text_of_others_is_a_standard_type(keys: None, tmp_path: Path) -> None:
    """A std_msgs/String of another program has a detached seal, too, while a structured message has its own."""
    kind = ros_message("std_msgs/msg/String")
    case = Case(
        kind, lambda level: kind(stamp=0, ros=message_class(STRING)(data=str(level))), lambda one: int(one.ros.data)
    )
    with node_hosts(nodes_of(case)) as host, spinning_node("intruder") as ros:
        sink, source = host("sink"), host("source")
        intruder = Intruder(ros, "/standard", message_class(STRING))
        structured = open_transport().advertise(ros, "/standard", Utterance)
        assert eventually(intruder.is_connected)
        assert eventually(lambda: structured.publisher.get_subscription_count() > 1)
        assert eventually(lambda: has_receivers(source, "out", 2))
        structured.publish(Utterance(stamp=1, id="u", text="5"))
        source.node.context.call_soon(lambda: source.node.out.publish(case.make(1)))
        assert eventually(lambda: sink.node.got == [1])
        assert eventually(lambda: sink.statistics.refusals["unsealed"] == 1)
