from __future__ import annotations

import array
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

from socialbot.bridge.topics import (
    TopicInfo,
    TopicRate,
    message_text,
    messages,
    observer_node,
    parse_message,
    publish_once,
    settled_topics,
    topic_rate,
)
from socialbot.cli.topic import rate_line, topic
from socialbot.core.clock import SECOND
from socialbot.core.errors import GraphError, InstallationError, MessageError
from socialbot.core.messages import RosMessage
from socialbot.deliberation.messages import Belief, Desire, DesireItem, Fact
from tests.system.running import eventually, next_line

SAID = {
    "schema": "socialbot/Utterance/1",
    "stamp": 7,
    "id": "u1",
    "text": "Good morning: can I help?",
    "key": "",
    "cause": "",
}
PICTURE_BYTES = 921600

TALKER = f"""
import array, json, time
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_msgs.msg import String
from socialbot.core.process import Ending
from socialbot.bridge.environment import spinning_node

latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
picture = Image(width=640, height=480, encoding="bgr8", data=array.array("B", bytes({PICTURE_BYTES})))
with Ending().on_signals() as ending, spinning_node("talker") as node:
    node.create_publisher(String, "/speech/say", latched).publish(String(data=json.dumps({SAID!r})))
    node.create_publisher(String, "/silent", 10)
    node.create_subscription(String, "/wanted", lambda message: None, 10)
    images = node.create_publisher(Image, "/camera/image_raw", qos_profile_sensor_data)
    while not ending.asked:
        images.publish(picture)
        time.sleep(0.05)
"""


class Fields:
    """A stand-in for an rclpy message."""

    def __init__(self, **fields: Any) -> None:
        vars(self).update(fields)

    def get_fields_and_field_types(self) -> dict[str, str]:
        return dict.fromkeys(vars(self), "")


def loaded(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


class TestMessageText:
    def test_is_yaml_with_the_fields_of_the_message(self):
        point = Fields(x=0.5, y=float("inf"), positions=array.array("d", [1.0, 2.0]))
        message = Fields(
            header=Fields(stamp=Fields(sec=3), frame_id=""),
            level=b"\x02",
            flag=True,
            words=["pan", "yes", "a: b", "two\nlines", "\x1b[31m", 'it\'s "so"'],
            matrix=np.eye(2).reshape(-1),
            none=[],
            points=[point, point],
        )
        as_yaml = {"x": 0.5, "y": float("inf"), "positions": [1.0, 2.0]}
        assert loaded(message_text(message)) == {
            "header": {"stamp": {"sec": 3}, "frame_id": ""},
            "level": 2,
            "flag": True,
            "words": ["pan", "yes", "a: b", "two\nlines", "\x1b[31m", 'it\'s "so"'],
            "matrix": [1.0, 0.0, 0.0, 1.0],
            "none": [],
            "points": [as_yaml, as_yaml],
        }

    def test_replaces_long_arrays_by_their_size(self):
        message = Fields(data=array.array("B", bytes(900)), ranges=array.array("f", [0.0] * 360), k=np.zeros(100))
        assert message_text(message) == "data: <900 bytes>\nranges: <360 numbers>\nk: <100 numbers>"
        assert len(loaded(message_text(message, raw=True))["data"]) == 900

    def test_decodes_json_in_a_string(self):
        message = Fields(data=json.dumps({**SAID, "persons": [{"x": 1.0, "track_id": ""}, {}]}))
        text = message_text(message)
        assert text.startswith("data:\n  schema: socialbot/Utterance/1\n  stamp: 7\n")
        assert loaded(text)["data"] == json.loads(message.data)  # type: ignore[attr-defined]
        assert loaded(message_text(message, raw=True))["data"] == message.data  # type: ignore[attr-defined]

    @pytest.mark.parametrize("text", ["{broken", "Hello", "", "[1, 2]", "{" * 5000])
    def test_keeps_other_text(self, text):
        assert loaded(message_text(Fields(data=text))) == {"data": text}

    def test_escapes_control_characters(self):
        assert message_text(Fields(data="\x1b]0;x\x07\x9b")).isprintable()


def test_parses_yaml_and_json_and_adds_the_stamp():
    held = Fact(name="holding", params=("gripper_a", "box_a1"))
    yaml = "{desire: {name: grab, priority: 0.9, value: [{name: holding, params: [gripper_a, box_a1]}]}}"
    assert parse_message("DesireItem", yaml, stamp=7) == DesireItem(
        stamp=7, desire=Desire(name="grab", priority=0.9, value=(held,))
    )
    json = '{"belief": {"name": "holding", "params": ["gripper_a", "box_a1"]}, "stamp": 3}'
    assert parse_message("Belief", json, stamp=7) == Belief(stamp=3, belief=held)


def test_parses_any_ros_type_and_adds_the_stamp_to_its_header():
    battery = parse_message("sensor_msgs/BatteryState", "{percentage: 1, header: {frame_id: pack}}", stamp=7 * SECOND)
    assert isinstance(battery, RosMessage)
    assert (battery.ros_type, battery.stamp, battery.percentage) == ("sensor_msgs/msg/BatteryState", 7 * SECOND, 1.0)
    assert (battery.header.frame_id, battery.header.stamp.sec) == ("pack", 7)
    level = parse_message("std_msgs/msg/Float32", "{data: 0.25}", stamp=7)
    assert isinstance(level, RosMessage)
    assert (level.stamp, level.data) == (7, 0.25)


def test_parses_a_message_of_a_module_in_the_working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = "from socialbot import Structured\n\n\nclass Lux(Structured, frozen=True, kw_only=True):\n    lux: float\n"
    (tmp_path / "own_light.py").write_text(code, "utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    message = parse_message("own_light:Lux", "{lux: 3}", stamp=7)
    assert (type(message).__name__, message.stamp, getattr(message, "lux", None)) == ("Lux", 7, 3.0)
    for schema, fields, complaint in (
        ("own_light:Luks", "{lux: 3}", "own_light has no 'Luks'.*known: Lux"),
        ("own_dark:Lux", "{lux: 3}", "cannot load message 'own_dark:Lux': there is no module 'own_dark'"),
        ("numpy:ndarray", "{lux: 3}", "'numpy:ndarray' is no message"),
        ("pathlib:Path", "{lux: 3}", "pathlib of Python's standard library has no 'Path'"),
        ("own_light:Lux", "{lux: bright}", "see the class Lux"),
        ("Lux", "{lux: 3}", "module:Class for a message of your own"),
    ):
        with pytest.raises(MessageError, match=f"(?s){complaint}"):
            parse_message(schema, fields, stamp=7)


@pytest.mark.parametrize(
    ("schema", "fields", "place"),
    [
        ("HeadCommand", "{mode: look, pan_rad: .nan}", "pan_rad is nan"),
        ("Belief", "{belief: {name: heat, params: [k1], value: .inf}}", "belief.value is inf"),
        (
            "PersonDetections",
            "{frame_id: c, width: 9, height: 9, persons: [{x: 1, y: 2, w: 3, h: 4, score: 1, distance_m: -.inf}]}",
            "persons[0].distance_m is -inf",
        ),
    ],
)
def test_a_number_that_json_cannot_hold_is_no_field_of_a_message(schema: str, fields: str, place: str) -> None:
    with pytest.raises(MessageError, match=re.escape(place)):
        parse_message(schema, fields, stamp=7)
    assert math.isinf(getattr(parse_message("std_msgs/msg/Float32", "{data: .inf}", stamp=7), "data", 0.0))


@pytest.mark.parametrize(
    ("schema", "fields", "complaint"),
    [
        ("std_msgs/msg/Float32", "{date: 1}", "did you mean 'data'?"),
        ("std_msgs/msg/Float32", "{data: much}", "does not fit"),
        ("std_msgs/msg/Int32", "{data: 0.5}", "does not fit"),
        ("std_msgs/msg/Float32", "{data: 0x" + "f" * 600 + "}", "not valid YAML: a number of more than 250 characters"),
        ("std_msgs/msg/Float32", "{1: 2}", "no field 1"),
        ("Float32", "{data: 1}", "or a ROS type, such as std_msgs/msg/Float32"),
        ("DesireItm", "{}", "did you mean 'DesireItem'?"),
        ("Belief", "{believe: {name: a}}", "did you mean 'belief'?"),
        ("Belief", "{}", "missing required field `belief`"),
        ("Belief", "{belief: {name: 3}}", r"Expected `str`, got `int` - at `\$.belief.name`"),
        ("DesireItem", "{desire: {name: a, priority: 1.5}}", r"\$.desire.priority"),
        ("Belief", "{belief: [", "not valid YAML"),
        ("Belief", "a", "expected names with values"),
        ("Belief", '{"belief": {"name": "\\ud800"}}', "surrogates"),
        ("Belief", "{[a]: b}", "no field"),
        ("Belief", "{{a: b}: c}", "not valid YAML"),
        ("Belief", "9" * 5000, "not valid YAML"),
        ("Belief", "{" * 5000, "nested more than"),
    ],
)
def test_refuses_fields_that_do_not_fit_the_schema(schema, fields, complaint):
    with pytest.raises(MessageError, match=complaint.replace("?", r"\?")):
        parse_message(schema, fields, stamp=0)


class TestTopicRate:
    def test_has_rate_periods_and_bandwidth(self):
        rate = topic_rate([(time_s, 1000) for time_s in (0.0, 0.1, 0.3, 0.4)])
        assert rate is not None
        assert (rate.hz, rate.min_s, rate.max_s) == pytest.approx((7.5, 0.1, 0.2))
        assert rate.deviation_s == pytest.approx(np.std([0.1, 0.2, 0.1]))
        assert (rate.bytes_per_s, rate.messages) == pytest.approx((7500, 4))

    @pytest.mark.parametrize("received", [[], [(1.0, 1)], [(1.0, 1), (1.0, 1)]])
    def test_needs_two_messages(self, received):
        assert topic_rate(received) is None

    @pytest.mark.parametrize("scale", [1e-6, 1.0, 9.9e5])
    def test_fits_in_one_line_of_80_columns(self, scale):
        rate = TopicRate(hz=1234.5, min_s=99.9, max_s=99.9, deviation_s=9.9, bytes_per_s=1e6 * scale, messages=1000)
        assert len(rate_line(rate)) <= 80


class Graph:
    """A stand-in for an rclpy node that discovers ``looks`` one after the other."""

    def __init__(self, *looks: tuple[str, ...]) -> None:
        self._looks = list(looks)
        self._now: tuple[str, ...] = ()

    def get_name(self) -> str:
        return "me"

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        self._now = self._looks.pop(0) if len(self._looks) > 1 else self._looks[0]
        return [(name, ["std_msgs/msg/String"]) for name in self._now]

    def get_publishers_info_by_topic(self, name: str) -> list[Any]:
        return [SimpleNamespace(node_name=node, topic_type="no_msgs/msg/No") for node in ("me", "other")]

    def get_subscriptions_info_by_topic(self, name: str) -> list[Any]:
        return []


class TestSettledTopics:
    def test_waits_until_the_topics_are_stable(self):
        topics = settled_topics(Graph((), ("/b",), ("/b", "/a")))
        assert topics == (
            TopicInfo("/a", ("std_msgs/msg/String",), 1, 0),
            TopicInfo("/b", ("std_msgs/msg/String",), 1, 0),
        )

    def test_ends_on_request(self):
        assert settled_topics(Graph(()), ended=lambda: True) == ()


@pytest.fixture(scope="module")
def domain(other_domain: int) -> str:
    return str(other_domain)


@pytest.fixture(autouse=True)
def apart(domain, monkeypatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


@pytest.fixture(scope="module")
def talker(domain) -> Iterator[None]:
    variables = {**os.environ, "ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    process = subprocess.Popen([sys.executable, "-c", TALKER], env=variables)
    yield
    # Killed, it would leave its shared memory behind.
    process.terminate()
    process.wait(180)


def run(*arguments: str) -> str:
    result = CliRunner().invoke(topic, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


@pytest.mark.ros
@pytest.mark.usefixtures("talker")
class TestCommands:
    def test_echo_prints_the_last_message_of_a_latched_topic(self):
        shown, end = run("echo", "speech/say", "--count", "1").split("---")
        assert loaded(shown) == {"data": SAID}
        assert not end.strip()

    def test_echo_shortens_images_of_best_effort_topics(self):
        text = run("echo", "/camera/image_raw", "--count", "2")
        assert text.count("data: <921600 bytes>\n---\n") == 2

    def test_list_prints_types_publishers_and_subscribers(self):
        rows = [line.split() for line in run("list").splitlines()]
        assert rows == [
            ["topic", "type", "pubs", "subs"],
            ["/camera/image_raw", "sensor_msgs/Image", "1", "0"],
            ["/silent", "std_msgs/String", "1", "0"],
            ["/speech/say", "std_msgs/String", "1", "0"],
            ["/wanted", "std_msgs/String", "0", "1"],
        ]
        assert "/rosout" in run("list", "--all")

    def test_hz_prints_the_rate_until_the_duration(self):
        *_, last = run("hz", "/camera/image_raw", "--duration", "1.5").splitlines()
        rate, unit, *_ = last.split()
        assert unit == "Hz"
        assert 2 < float(rate) < 25
        assert "MB/s" in last

    @pytest.mark.parametrize("name", ["a b", "", "/", "a//b", "~", "{x}", "1a", "a\n", "\u00e9", "a" * 228])
    @pytest.mark.parametrize("command", [["echo"], ["hz"], ["pub", "std_msgs/msg/String", "{data: a}"]])
    def test_refuses_names_that_no_topic_can_have(self, command, name):
        with pytest.raises(GraphError, match="TOPIC: no valid topic: "):
            run(command[0], name, *command[1:])

    def test_suggests_the_name_of_a_misspelt_topic(self):
        with pytest.raises(GraphError, match="no publisher of /speech/sy") as caught:
            run("echo", "/speech/sy", "--timeout", "1")
        assert "did you mean '/speech/say'?" in str(caught.value)

    def test_a_topic_without_a_publisher_is_an_error(self):
        with pytest.raises(GraphError, match="no publisher of /wanted"):
            run("hz", "/wanted", "--timeout", "0.5")

    def test_pub_sends_one_message(self):
        from std_msgs.msg import String

        from socialbot.bridge.environment import spinning_node

        received: list[Any] = []
        with spinning_node("listener") as ros:
            ros.create_subscription(String, "/speech/heard", lambda message: received.append(message), 10)
            assert run("pub", "/speech/heard", "Utterance", "{id: u1, text: 'Good morning', stamp: 7}") == ""
            assert eventually(lambda: bool(received))
        (message,) = received
        said = {"schema": "socialbot/Utterance/1", "stamp": 7, "id": "u1", "text": "Good morning"}
        assert json.loads(message.data).items() >= said.items()

    def test_pub_waits_for_late_subscribers(self, monkeypatch):
        from std_msgs.msg import String

        from socialbot.bridge.environment import spinning_node
        from socialbot.core.messages import Utterance

        heard: list[str] = []
        word = Utterance(stamp=7, id="u1", text="Good morning")
        with spinning_node("first") as first, observer_node() as sender:
            first.create_subscription(String, "/to_all", lambda _: heard.append("first"), 10)
            publisher_of = sender.create_publisher

            def with_a_late_one(*arguments: Any) -> Any:
                publisher = publisher_of(*arguments)
                assert eventually(lambda: publisher.get_subscription_count() == 1)
                late.create_subscription(String, "/to_all", lambda _: heard.append("late"), 10)
                return publisher

            with spinning_node("late") as late:
                monkeypatch.setattr(sender, "create_publisher", with_a_late_one)
                publish_once(sender, "/to_all", word, timeout_s=5.0)
                assert eventually(lambda: sorted(heard) == ["first", "late"])

    def test_pub_needs_a_subscriber(self):
        with pytest.raises(GraphError, match="no subscriber of /wantet") as caught:
            run("pub", "/wantet", "Utterance", "{id: u1, text: a}", "--timeout", "1")
        assert "did you mean '/wanted'?" in str(caught.value)

    @pytest.mark.parametrize(
        ("arguments", "number"),
        [(("echo", "/speech/say"), signal.SIGINT), (("hz", "/camera/image_raw"), signal.SIGTERM)],
    )
    def test_ends_with_code_0_on_signals(self, arguments, number):
        command = [sys.executable, "-c", "from socialbot.cli.topic import topic; topic()", *arguments]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            assert next_line(process)
            process.send_signal(number)
            _, complaint = process.communicate(timeout=180)
        finally:
            process.kill()
        assert (process.returncode, complaint) == (0, "")


@pytest.mark.ros
class TestMessages:
    def test_an_uninstalled_type_is_an_error(self):
        with pytest.raises(InstallationError, match="no_msgs/msg/No"):
            next(messages(Graph(("/a",)), "/a", timeout_s=1.0))

    def test_the_subscription_adapts_to_weaker_publishers(self):
        from rclpy.qos import qos_profile_sensor_data
        from std_msgs.msg import String

        from socialbot.bridge.environment import spinning_node

        deadline = time.monotonic() + 60
        with spinning_node("driver") as driver, observer_node() as ros:
            publisher, said = driver.create_publisher(String, "/mixed", 10), "reliable"
            with closing(messages(ros, "/mixed", timeout_s=5.0)) as heard:
                for message in heard:
                    assert time.monotonic() < deadline
                    publisher.publish(String(data=said))
                    if message is not None and message.data == "reliable":
                        publisher, said = driver.create_publisher(String, "/mixed", qos_profile_sensor_data), "best"
                    if message is not None and message.data == "best":
                        break
