"""``socialbot doctor --robot``: one line for each thing that a robot has to answer, and a remedy."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from socialbot.bags.codec import encode
from socialbot.bags.types import RosbagsTypes
from socialbot.core.installation import interfaces_command
from socialbot.core.messages import Image, Transform, Transforms
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input
from socialbot.graph.services import Client
from socialbot.robots.profile import load_profile, parse_profile
from socialbot.robots.requirements import Requirement, graph_requirements, requirements
from socialbot.vision.camera import CameraPose
from socialbot.vision.images import encode_jpeg
from tests.robots.daemon_server import DaemonServer, running_daemon
from tests.system.running import socialbot_here


@pytest.fixture
def daemon() -> Iterator[DaemonServer]:
    with running_daemon() as server:
        yield server


def examined(folder: Path, url: str) -> tuple[int, dict[str, dict[str, Any]]]:
    """Exit code and findings by name, for a Reachy Mini at ``url``."""
    profile = folder / "mini.yaml"
    profile.write_text(f"like: reachy_mini\nurl: {url}\n")
    done = socialbot_here("doctor", "--robot", profile, "--json")
    return done.returncode, {each["name"]: each for each in json.loads(done.stdout)["findings"]}


def test_a_robot_that_answers_is_well(daemon, tmp_path):
    code, found = examined(tmp_path, daemon.url)
    assert code == 0
    assert (found["profile"]["state"], found["profile"]["text"]) == (
        "warning",
        "Reachy Mini; tested in simulation only",
    )
    assert found["daemon"]["text"] == f"{daemon.url}: version 1.13.0, a robot"
    assert found["head"]["text"] == "motors enabled; yaw 0.00, pitch 0.00 rad"
    assert found["speech"]["text"] == "on this computer, while its camera is open here"
    assert (found["camera"]["state"], "--camera FILE" in found["camera"]["remedy"]) == ("warning", True)
    assert not [request for request in daemon.requests if request.startswith("POST")]  # it looks, and changes nothing


@pytest.mark.parametrize(
    ("change", "name", "text", "remedy"),
    [
        ({"state": "stopped"}, "daemon", "it is stopped", "wake up the robot"),
        ({"mode": "disabled"}, "head", "motors disabled", "its motors are off"),
    ],
)
def test_a_robot_that_sleeps_is_an_error(daemon, tmp_path, change, name, text, remedy):
    vars(daemon).update(change)
    code, found = examined(tmp_path, daemon.url)
    assert code == 5
    assert found[name]["state"] == "error"
    assert text in found[name]["text"]
    assert remedy in found[name]["remedy"]


def test_a_daemon_that_is_away_is_an_error_with_the_command_that_starts_it(tmp_path):
    code, found = examined(tmp_path, "http://127.0.0.1:9")
    assert code == 5
    assert "does not answer" in found["daemon"]["text"]
    assert found["daemon"]["remedy"].startswith("start it: reachy-mini-daemon;")
    assert "head" not in found


def test_an_unknown_robot_is_refused():
    done = socialbot_here("doctor", "--robot", "reachy")
    assert done.returncode == 4
    assert "no robot 'reachy'" in done.stderr
    assert "did you mean 'reachy_mini'?" in done.stderr


OWN_HEAD = """
from socialbot import Output, Structured
from socialbot.robots import RobotHead


class Neck(Structured, frozen=True, kw_only=True):
    positions: tuple[float, ...]


class OwnHead(RobotHead):
    neck = Output(Neck, "/own/neck")

    def send(self, positions, duration_s):
        self.neck.publish(Neck(stamp=self.clock.now(), positions=tuple(positions.values())))


class NoHead:
    pass
"""


def own_head(folder: Path, kind: str) -> Path:
    profile = folder / "own.yaml"
    joint = "lower_rad: -1, upper_rad: 1, speed_rad_s: 1"
    profile.write_text(
        "name: own\n"
        "camera: {image: /image, info: /info}\n"
        f"head: {{type: '{kind}', remap: {{neck: /neck}}, pan: {{joint: a, {joint}}}, tilt: {{joint: b, {joint}}}}}\n",
        "utf-8",
    )
    (folder / "own_head.py").write_text(OWN_HEAD, "utf-8")
    return profile


def test_a_profile_with_a_node_of_ones_own_needs_its_topics(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    profile = load_profile(str(own_head(tmp_path, "own_head:OwnHead")))
    assert [each for each in requirements(profile) if each.part == "head"] == [
        Requirement("head", "subscriber", "/neck", "std_msgs/msg/String", needed=False)
    ]


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("own_head:OwnHeads", "own_head has no 'OwnHeads'"),
        ("own_heads:OwnHead", "there is no module 'own_heads'"),
        ("own_head:NoHead", "is no node"),
        ("camera", "does not fit this part of a robot"),
    ],
)
def test_a_node_of_ones_own_that_cannot_be_loaded_is_an_error(tmp_path, monkeypatch, kind, text):
    monkeypatch.syspath_prepend(tmp_path)
    done = socialbot_here("doctor", "--robot", own_head(tmp_path, kind), "--json")
    assert done.returncode == 5
    *_, found = json.loads(done.stdout)["findings"]
    assert (found["name"], found["state"]) == ("profile", "error")
    assert text in found["text"]
    assert found["remedy"]


def test_a_profile_needs_its_topics_and_actions():
    needed = {(each.part, each.kind, each.name) for each in requirements(load_profile("tiago"))}
    assert needed == {
        ("camera", "publisher", "/head_front_camera/rgb/image_raw"),
        ("camera", "publisher", "/head_front_camera/rgb/camera_info"),
        ("camera", "publisher", "/tf_static"),
        ("head", "subscriber", "/head_controller/joint_trajectory"),
        ("head", "publisher", "/joint_states"),
        ("speech", "action", "/tts_engine/tts"),
        ("base", "action", "/navigate_to_pose"),
        ("base", "publisher", "/tf"),
    }
    seer = parse_profile("name: seer\npeople: {type: ros4hri}\n", "seer.yaml")
    assert {each.name for each in requirements(seer)} == {"/humans/bodies/tracked", "/tf"}


class Porter(Node):
    battery = Input("sensor_msgs/msg/BatteryState", "/battery")
    lamp = Client("std_srvs/srv/SetBool", "/lamp")
    door = Client("std_srvs/srv/SetBool", "/door")

    @battery
    def on_battery(self, message): ...


def test_a_graph_without_other_nodes_is_well():
    done = socialbot_here("doctor", "cleaner")
    assert done.returncode == 0, done.stderr
    assert "needs nothing of other nodes" in done.stdout
    assert socialbot_here("doctor", "cleaner", "--robot", "tiago").returncode == 4


class TestOverDds:
    """Topics of standard types, which the wheels have."""

    def findings(self, *needed: Requirement, timeout_s: float = 1.0) -> list[tuple[str, str, str]]:
        from socialbot.bridge.robot_checks import check_topics

        found = check_topics(needed, "ros2 launch robby", timeout_s)
        return [(each.state, each.text, each.remedy) for each in found]

    def test_missing_ones_have_the_command_that_starts_the_drivers(self):
        image = Requirement("camera", "publisher", "/cam/image_raw", "sensor_msgs/msg/Image")
        neck = Requirement("head", "subscriber", "/neck", "trajectory_msgs/msg/JointTrajectory")
        first, second = self.findings(image, neck, timeout_s=0.2)
        assert first[:2] == ("error", "nobody publishes /cam/image_raw")
        assert "ros2 launch robby" in first[2]
        assert second[:2] == ("error", "nobody subscribes to /neck")
        assert second[2] == "as above; or correct the name in the profile"

    def test_what_a_graph_needs_of_other_nodes_is_looked_for(self):
        from std_msgs.msg import Float32
        from std_srvs.srv import SetBool

        from socialbot.bridge.environment import spinning_node
        from socialbot.bridge.robot_checks import check_topics

        topics, services = frozenset({"/battery"}), frozenset({"/lamp", "/door"})
        graph = Graph("house", (NodeConfig("porter", Porter),), inputs=topics, services=services)
        battery, lamp, door = graph_requirements(graph)
        assert (battery.kind, battery.type, battery.needed) == ("publisher", "sensor_msgs/msg/BatteryState", False)
        assert (lamp.kind, lamp.type, lamp.needed) == ("service", "std_srvs/srv/SetBool", True)
        with spinning_node("house") as ros:
            ros.create_service(SetBool, "/lamp", lambda _, response: response)
            ros.create_publisher(Float32, "/battery", 1)
            found = check_topics((battery, lamp, door), "", 2.0, source="graph file")
            told = [(each.name, each.state, each.text) for each in found]
        assert told == [
            ("porter", "error", "/battery is std_msgs/msg/Float32, not sensor_msgs/msg/BatteryState"),
            ("porter", "ok", "/lamp, by /house"),
            ("porter", "error", "nobody offers /door"),
        ]

    def test_what_is_there_under_other_names_is_told(self):
        from sensor_msgs.msg import CompressedImage, Image
        from std_srvs.srv import SetBool
        from trajectory_msgs.msg import JointTrajectory

        from socialbot.bridge.environment import spinning_node

        with spinning_node("driver") as ros:
            ros.create_publisher(Image, "/robot1/camera/color/image_raw", 5)
            ros.create_publisher(Image, "/robot1/camera/depth/image_raw", 5)
            ros.create_publisher(CompressedImage, "/robot1/camera/color/image_raw/compressed", 5)
            ros.create_subscription(JointTrajectory, "/robot1/neck", lambda _: None, 5)
            ros.create_service(SetBool, "/robot1/lamp", lambda _, response: response)
            color, packed = "/camera/color/image_raw", "/robot1/camera/color/image_raw/compressed"
            found = self.findings(
                Requirement("camera", "publisher", color, "sensor_msgs/msg/Image"),
                Requirement("camera", "publisher", packed, "sensor_msgs/msg/Image"),
                Requirement("head", "subscriber", "/neck", "trajectory_msgs/msg/JointTrajectory"),
                Requirement("lamp", "service", "/lamp", "std_srvs/srv/SetBool"),
                Requirement("cloud", "publisher", "/points", "sensor_msgs/msg/PointCloud2"),
            )
        there = "; of this type there is"
        image = f"{there} /robot1/camera/color/image_raw, /robot1/camera/depth/image_raw"
        ends = [remedy.partition("profile")[2] for *_, remedy in found]
        assert ends == [image, image, f"{there} /robot1/neck", f"{there} /robot1/lamp", ""]

    def test_a_type_that_is_not_installed_is_named(self):
        (found,) = self.findings(Requirement("x", "action", "/x", "absent_msgs/action/X"), timeout_s=0.1)
        assert found == (
            "error",
            "/x: the package absent_msgs is not installed",
            f"{interfaces_command('robot_interfaces')}, or source a ROS installation that has absent_msgs",
        )

    def test_messages_are_awaited_and_looked_at(self):
        from sensor_msgs.msg import Image, JointState

        from socialbot.bridge.environment import spinning_node

        with spinning_node("driver") as ros:
            images, joints = (
                ros.create_publisher(Image, "/cam", 5),
                ros.create_publisher(JointState, "/joint_states", 5),
            )
            picture = Image(width=640, height=480, encoding="rgb8")
            ros.create_timer(0.02, lambda: images.publish(picture))
            ros.create_timer(0.02, lambda: joints.publish(JointState(name=["wheel"], position=[0.0])))
            ros.create_publisher(Image, "/asleep", 5)
            ros.create_subscription(Image, "/neck", lambda _: None, 5)
            image = "sensor_msgs/msg/Image"
            found = self.findings(
                Requirement("camera", "publisher", "/cam", image),
                Requirement("head", "publisher", "/joint_states", "sensor_msgs/msg/JointState", False, ("pan",)),
                Requirement("camera", "publisher", "/asleep", image),
                Requirement("head", "subscriber", "/neck", "trajectory_msgs/msg/JointTrajectory"),
                Requirement("camera", "subscriber", "/neck", image),
                timeout_s=3.0,
            )
        assert [(state, text) for state, text, _ in found] == [
            ("ok", "/cam, by /driver: 640x480 rgb8"),
            ("warning", "/joint_states has no joint pan"),
            ("error", "/asleep: /driver publishes nothing"),
            ("error", "/neck is sensor_msgs/msg/Image, not trajectory_msgs/msg/JointTrajectory"),
            ("ok", "/neck, by /driver"),
        ]
        assert "there are wheel" in found[1][2]

    def test_messages_that_a_graph_cannot_use_are_told(self):
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image, JointState

        from socialbot.bridge.environment import spinning_node
        from socialbot.core import messages

        nan, k = float("nan"), [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]
        sent = {
            "/empty": (Image(encoding="rgb8"), messages.Image),
            "/odd": (Image(width=1, height=1, step=1, encoding="p010", data=b"0"), messages.Image),
            "/text": (CompressedImage(format="jpeg", data=b"no picture"), messages.CompressedImage),
            "/zero": (CameraInfo(width=640, height=480), messages.CameraInfo),
            "/nan": (CameraInfo(width=640, height=480, k=[*k[:2], nan, *k[3:]]), messages.CameraInfo),
            "/size": (CameraInfo(k=k), messages.CameraInfo),
            "/lens": (
                CameraInfo(width=640, height=480, k=k, distortion_model="plumb_bob", d=[0.1, nan, 0.0, 0.0]),
                messages.CameraInfo,
            ),
            "/joints": (JointState(name=["pan", "tilt"], position=[nan]), None),
        }  # fmt: skip
        needed = [
            Requirement("camera", "publisher", name, f"sensor_msgs/msg/{type(message).__name__}", message=kind,
                        joints=() if kind else ("pan", "tilt"))
            for name, (message, kind) in sent.items()
        ]  # fmt: skip
        with spinning_node("driver") as ros:
            made = [(ros.create_publisher(type(message), name, 5), message) for name, (message, _) in sent.items()]
            ros.create_timer(0.02, lambda: [publisher.publish(message) for publisher, message in made])
            found = self.findings(*needed, timeout_s=5.0)
        assert [state for state, *_ in found] == ["error"] * len(sent)
        assert [text for _, text, _ in found] == [
            "/empty cannot be used: no pixels",
            "/odd cannot be used: unknown encoding 'p010'",
            "/text cannot be used: cannot be decoded",
            "/zero is not calibrated: k is 0",
            "/nan cannot be used: focal lengths 500, 500 and middle nan, 240 for 640x480 pixels",
            "/size cannot be used: focal lengths 500, 500 and middle 320, 240 for 0x0 pixels",
            "/lens cannot be used: d = [0.1, nan, 0.0, 0.0] is no distortion of the model plumb_bob",
            "/joints has no position of pan, tilt",
        ]
        assert all(remedy for *_, remedy in found)

    def test_images_without_a_stream_are_told(self):
        from builtin_interfaces.msg import Time
        from sensor_msgs.msg import CompressedImage
        from std_msgs.msg import Header

        from socialbot.bridge.environment import spinning_node
        from socialbot.core import messages

        jpeg, ticks, shown = encode_jpeg(np.zeros((8, 8, 3), np.uint8), 90), itertools.count(1), []

        def picture(stamp: Time) -> CompressedImage:
            return CompressedImage(header=Header(stamp=stamp), format="jpeg", data=jpeg)

        with spinning_node("driver") as ros:
            names = ("/still", "/unset", "/stuck", "/well", "/past")
            still, unset, stuck, well, past = (ros.create_publisher(CompressedImage, name, 5) for name in names)

            def show_once() -> None:
                if still.get_subscription_count():
                    shown.append(len(shown))
                if len(shown) == 25:  # the subscriber may know its publisher later than the publisher knows it
                    still.publish(picture(Time(sec=7)))

            ros.create_timer(0.02, show_once)
            ros.create_timer(0.02, lambda: unset.publish(picture(Time())))
            ros.create_timer(0.02, lambda: stuck.publish(picture(Time(sec=7, nanosec=5))))
            ros.create_timer(0.02, lambda: well.publish(picture(ros.get_clock().now().to_msg())))
            ros.create_timer(0.02, lambda: past.publish(picture(Time(sec=next(ticks)))))
            kind = "sensor_msgs/msg/CompressedImage"
            needed = [
                Requirement("camera", "publisher", name, kind, message=messages.CompressedImage) for name in names
            ]
            found = self.findings(*needed, timeout_s=3.0)
        *found, (past_state, past_text, past_remedy) = found
        assert past_state == "warning"
        assert re.fullmatch(r"/past: its stamps are \d+\.\d s behind the clock of this computer", past_text)
        assert "NTP" in past_remedy
        assert [(state, text) for state, text, _ in found] == [
            ("error", "/still comes once only"),
            ("error", "/unset has no time: header.stamp is 0"),
            ("error", "/stuck has the same time twice: header.stamp is 7.000000005"),
            ("ok", "/well, by /driver"),
        ]


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        ("eye_optical", "1.20 m high, 0.000 rad down (from transforms)"),
        ("ghost", "does not place the camera 'ghost' above the floor"),
        ("", "places no camera: /cam has no frame_id"),
        (None, "places no camera: nothing is published on /cam"),
    ],
)
def test_a_camera_is_placed_by_transforms(frame, said):
    from socialbot.bridge.robot_checks import camera_placement

    def transform(parent: str, child: str, height: float, turn: tuple[float, float, float, float]) -> Transform:
        return Transform(stamp=9, parent=parent, child=child, translation=(0.0, 0.0, height), rotation=turn)

    fixed = transform("base_footprint", "neck", 1.0, (0.0, 0.0, 0.0, 1.0))
    moving = transform("neck", "eye_optical", 0.2, (-0.5, 0.5, -0.5, 0.5))
    types = RosbagsTypes()
    transforms = [encode(Transforms(stamp=0, transforms=(each,)), types) for each in (fixed, moving)]
    pixels = np.zeros((1, 1, 3), np.uint8)
    images = [] if frame is None else [encode(Image.from_bgr(pixels, stamp=1, frame_id=frame), types)]
    placed = camera_placement("/cam", images, transforms)
    assert (str(placed) if isinstance(placed, CameraPose) else placed[0]) == said


@pytest.mark.parametrize(
    ("turn", "height", "said"),
    [
        ((0.0, 0.70710678, 0.0, 0.70710678), 1.2, "1.20 m above base_link, pitch 0°, roll 90°"),
        ((0.5, 0.5, 0.5, 0.5), 1.2, "1.20 m above base_link, pitch 0°, roll -?180°"),
        ((-0.5, 0.5, -0.5, 0.5), -0.4, "-0.40 m above base_link, pitch 0°, roll 0°"),
    ],
)
def test_a_camera_that_is_not_upright_above_the_floor_is_told(turn, height, said):
    from socialbot.bridge.robot_checks import camera_placement

    types = RosbagsTypes()
    eye = Transform(stamp=1, parent="base_link", child="eye_optical", translation=(0.0, 0.0, height), rotation=turn)
    pixels = np.zeros((1, 1, 3), np.uint8)
    image = encode(Image.from_bgr(pixels, stamp=1, frame_id="eye_optical"), types)
    placed = camera_placement("/cam", [image], [encode(Transforms(stamp=0, transforms=(eye,)), types)])
    assert isinstance(placed, tuple)
    assert re.search(said, placed[0])
    assert "upright" in placed[1]
