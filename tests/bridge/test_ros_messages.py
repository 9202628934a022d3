"""Nodes whose inputs and outputs are ROS messages of any type: inline, from a bag, and over DDS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped, Twist
from sensor_msgs.msg import BatteryState, LaserScan
from std_msgs.msg import Float32

from socialbot.bags.codec import decode, encode
from socialbot.bags.reader import open_bag
from socialbot.bags.types import RosbagsTypes
from socialbot.bags.writer import BagWriter
from socialbot.bridge.transport import RclpyTypes
from socialbot.core.clock import SECOND
from socialbot.core.errors import GraphError, MessageError
from socialbot.core.messages import Image, RosMessage, Utterance, ros_message
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input, Output
from socialbot.runs.record import RunRecord
from socialbot.runtime.bag_source import BagSource
from socialbot.runtime.run import run
from tests.bridge.hosting import node_hosts, spinning_nodes
from tests.system.running import eventually, socialbot_here


class Guard(Node):
    """Stops the robot when its battery is low, and says how far the next wall is."""

    battery = Input(BatteryState, "/battery")
    level = Input("std_msgs/Float32", "/level")
    scan = Input("sensor_msgs/msg/LaserScan", "/scan", optional=True)
    wheels = Output(Twist, "/cmd_vel")
    said = Output(Utterance, "/said")
    seen: tuple[Any, ...] = ()

    @battery
    def on_battery(self, message: RosMessage) -> None:
        self.seen += (("battery", message.stamp, round(message.percentage, 3), message.header.frame_id),)
        if message.percentage < 0.2:
            self.wheels.publish(Twist())

    @level
    def on_level(self, message: RosMessage) -> None:
        self.seen += (("level", round(message.data, 3)),)

    @scan
    def on_scan(self, message: RosMessage) -> None:
        self.seen += (("scan", round(float(min(message.ranges)), 3)),)


GRAPH = Graph("guard", (NodeConfig("guard", Guard),), inputs=frozenset({"/battery", "/level"}))
TWIST, BATTERY = ros_message("geometry_msgs/msg/Twist"), ros_message(BatteryState)


def battery(percentage: float, stamp: int = 5 * SECOND) -> BatteryState:
    message = BatteryState(percentage=percentage)
    message.header.frame_id = "base"
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
    return message


def recorded(path: Path) -> Path:
    """A bag as a robot records it."""
    with BagWriter(path) as writer:
        for second, share in enumerate((0.5, 0.25, 0.1), start=1):
            writer.write("/battery", BATTERY.of(battery(share, second * SECOND), 0), second * SECOND)
            level = ros_message(Float32).of(Float32(data=share), second * SECOND)
            writer.write("/level", level, second * SECOND + SECOND // 2)
    return path


def test_type_is_named_by_its_class_or_its_text():
    assert ros_message("std_msgs/Float32") is ros_message("std_msgs/msg/Float32") is ros_message(Float32)
    assert Guard.level.message_type.__name__ == "Float32"
    with pytest.raises(GraphError, match="'battery' is no ROS type"):
        Input("battery", "/battery")
    with pytest.raises(GraphError, match="int is no message"):
        Output(int, "/battery")


def test_stamp_is_that_of_the_header_or_the_time_of_receipt():
    assert BATTERY.of(battery(0.5), 9).stamp == 5 * SECOND
    assert BATTERY.of(BatteryState(), 9).stamp == 9
    assert ros_message(Float32).of(Float32(), 9).stamp == 9
    with pytest.raises(AttributeError, match="voltages"):
        BATTERY.of(battery(0.5), 9).voltages  # noqa: B018


def test_inline_run_passes_ros_messages():
    runner = InlineRunner(GRAPH)
    sent: list[Any] = []
    runner.tap("/cmd_vel", lambda _, message: sent.append(message))
    runner.start()
    runner.feed("/battery", BATTERY.of(battery(0.1), 0))
    runner.close()
    guard = runner.nodes["guard"]
    assert isinstance(guard, Guard)
    assert guard.seen == (("battery", 5 * SECOND, 0.1, "base"),)
    assert [(type(each), each.linear.x) for each in sent] == [(TWIST, 0.0)]


def test_message_of_another_type_is_refused():
    runner = InlineRunner(GRAPH)
    runner.start()
    guard = runner.nodes["guard"]
    assert isinstance(guard, Guard)
    for wrong in (Float32(), Utterance(stamp=0, id="a", text="no"), 3):
        with pytest.raises(MessageError, match="/cmd_vel: not a geometry_msgs/msg/Twist"):
            guard.wheels.publish(wrong)


@pytest.mark.parametrize("made", [BatteryState, LaserScan, PoseStamped])
def test_message_survives_a_bag_and_back(made):
    message = made()
    message.header.frame_id = "map"
    if made is LaserScan:
        message.ranges = [1.0, 2.5]
    kind = ros_message(made)
    in_bag = encode(kind.of(message, 7), RosbagsTypes())
    types = RosbagsTypes()
    read = decode(kind, types.deserialize(types.serialize(in_bag), kind.ros_type), stamp=7)
    assert encode(read, RclpyTypes()) == message


def test_bag_feeds_inputs_of_ros_types(tmp_path):
    guards: list[Guard] = []

    class Watched(Guard):
        def start(self) -> None:
            guards.append(self)

    graph = Graph("guard", (NodeConfig("guard", Watched),), inputs=GRAPH.inputs)
    sent: list[Any] = []
    with open_bag(recorded(tmp_path / "bag")) as bag, RunRecord(tmp_path / "run") as record:
        run(graph, BagSource(bag), record, lambda topic, message: sent.append(topic))
    assert [each[0] for each in guards[0].seen] == ["battery", "level"] * 3
    assert [each[1:3] for each in guards[0].seen if each[0] == "battery"] == [
        (second * SECOND, share) for second, share in ((1, 0.5), (2, 0.25), (3, 0.1))
    ]


def test_unknown_type_in_a_bag_is_named(tmp_path):
    with open_bag(recorded(tmp_path / "bag")) as bag:
        assert [type(message) for _, message in bag.messages({"/battery": "/battery"})] == [BATTERY] * 3


def test_topic_has_one_type():
    class Camera(Node):
        image = Output(Image, "/image")

    class Viewer(Node):
        image = Input("sensor_msgs/msg/Image", "/image")

        @image
        def on_image(self, message: RosMessage) -> None: ...

    with pytest.raises(GraphError, match="/image is Image for camera but sensor_msgs/msg/Image for viewer"):
        Graph("mixed", (NodeConfig("camera", Camera), NodeConfig("viewer", Viewer)))


@pytest.mark.ros
def test_nodes_exchange_ros_messages_with_other_ros_nodes():
    got: list[Twist] = []
    with spinning_nodes("robot") as (robot,), node_hosts(GRAPH) as host:
        robot.create_subscription(Twist, "/cmd_vel", got.append, 10)
        batteries = robot.create_publisher(BatteryState, "/battery", 10)
        levels = robot.create_publisher(Float32, "/level", 10)
        guard = host("guard").node
        assert eventually(lambda: batteries.get_subscription_count() and levels.get_subscription_count())
        batteries.publish(battery(0.1))
        levels.publish(Float32(data=0.5))
        assert eventually(lambda: len(got) == 1 and len(guard.seen) == 2)
    assert sorted(guard.seen) == [("battery", 5 * SECOND, 0.1, "base"), ("level", 0.5)]
    assert got == [Twist()]


def test_types_that_are_not_installed_are_named_before_anything_starts(tmp_path, monkeypatch):
    (tmp_path / "strange.py").write_text(
        "from socialbot import Input, Node\n\n\nclass Strange(Node):\n"
        '    thing = Input("nobody_msgs/msg/Thing", "/thing")\n\n'
        "    @thing\n    def on_thing(self, message): ...\n",
        "utf-8",
    )
    file = tmp_path / "graph.yaml"
    file.write_text("name: strange\ninputs: [/thing]\nnodes:\n  strange: {type: 'strange:Strange'}\n", "utf-8")

    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    done = socialbot_here("graph", file)
    assert done.returncode == 0, done.stderr
    assert "/thing: the ROS type nobody_msgs/msg/Thing is not installed" in done.stdout
    assert "source the ROS workspace that has the package nobody_msgs" in done.stdout

    assert socialbot_here("graph", file, "--runner", "inline").returncode == 0

    for command in (("up", file, "--out", "live"), ("graph", file, "--runner", "ros")):
        done = socialbot_here(*command)
        assert done.returncode == 5
        assert "error: /thing: the ROS type nobody_msgs/msg/Thing is not installed" in done.stderr
        assert "source the ROS workspace that has the package nobody_msgs" in done.stderr
    assert not (tmp_path / "live").exists()
