"""Structured messages as ROS types of their own."""

from __future__ import annotations

import importlib.util
import math
import sys
import threading
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.bags import codec
from socialbot.bags.types import PACKAGE, RosbagsTypes, definitions, fields_of, type_name, typed_messages, types_with
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.transport import RclpyTypes, message_class, open_transport
from socialbot.core.errors import GraphError, InstallationError, MessageError, ParameterError
from socialbot.core.installation import interfaces_command
from socialbot.core.messages import (
    ActionRequest,
    HeadCommand,
    Message,
    PersonDetection,
    PersonDetections,
    Structured,
    TraceRecord,
    Utterance,
)
from socialbot.core.registry import message_types
from socialbot.deliberation.messages import AgentRequest, PlanExecutionInfo
from socialbot.graph.files import dump_graph, parse_graph, with_changes
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input, Output
from tests.bags.test_codec import messages
from tools.interfaces import PACKAGE as FOLDER
from tools.interfaces import definition_files

TYPES = RosbagsTypes()
built = pytest.mark.skipif(importlib.util.find_spec(PACKAGE) is None, reason="socialbot_msgs is not installed")
structured = st.sampled_from([kind for kind in message_types() if kind in messages]).flatmap(messages.__getitem__)


def test_package_holds_the_definitions_of_the_code() -> None:
    written = {file.name: file.read_text() for file in (FOLDER / "msg").iterdir()}
    assert written == definition_files(), "run python -m tools.interfaces"


def test_every_structured_message_has_a_type_that_bags_know() -> None:
    assert set(typed_messages().values()) == set(message_types())
    for name in definitions():
        assert name in types_with(name).fielddefs


def test_definition_documents_the_struct() -> None:
    text = definitions()["socialbot_msgs/msg/SpeechStatus"].splitlines()
    assert text[0] == "# Progress or result of an utterance."
    assert 'string STATE_EXPIRED="expired"' in text
    assert text[-5:] == [
        "std_msgs/Header header",
        "string utterance_id",
        "string state",
        "string text",
        "string detail",
    ]


def test_definitions_of_fields() -> None:
    def line(struct: type, name: str) -> str:
        return next(field.definition for field in fields_of(struct) if field.name == name)

    assert line(PersonDetections, "persons") == "PersonDetection[] persons"
    assert line(PersonDetection, "distance_m") == "float64 distance_m  # NaN: none"
    assert line(AgentRequest, "desire") == "Desire[<=1] desire"
    assert line(ActionRequest, "arguments") == "string[] arguments  # JSON"
    assert line(TraceRecord, "detail") == "string detail  # JSON"
    assert "frame_id" not in [field.name for field in fields_of(PersonDetections)]


@given(structured)
def test_round_trip_through_the_bytes_of_a_bag(message: Structured) -> None:
    ros = codec.encode(message, TYPES, "typed")
    name = codec.ros_type(type(message), "typed")
    assert ros.__msgtype__ == name == type_name(type(message))
    back = TYPES.deserialize(TYPES.serialize(ros), name)
    assert codec.decode(type(message), back, stamp=7) == message
    assert codec.decode(codec.decodable_types()[name], back) == message


@built
@pytest.mark.ros
@given(structured)
def test_round_trip_through_rclpy(message: Structured) -> None:
    serialization = pytest.importorskip("rclpy.serialization")
    data = serialization.serialize_message(codec.encode(message, RclpyTypes(), "typed"))
    name = type_name(type(message))
    assert codec.decode(type(message), serialization.deserialize_message(data, message_class(name))) == message
    assert codec.decode(type(message), TYPES.deserialize(data, name)) == message


@built
@pytest.mark.ros
def test_types_of_bags_are_those_of_ros() -> None:
    for name in definitions():
        types = types_with(name)
        assert message_class(name).get_fields_and_field_types().keys() == {
            field for field, _ in types.fielddefs[name][1]
        }


class Mouth(Node):
    """Republish each message."""

    heard = Input(Utterance, "/speech/heard")
    say = Output(Utterance, "/speech/say")

    @heard
    def on_heard(self, message: Utterance) -> None:
        self.say.publish(message)


@built
@pytest.mark.ros
def test_nodes_of_a_typed_graph_use_ros_types() -> None:
    pytest.importorskip("rclpy")
    from rclpy.executors import SingleThreadedExecutor

    from socialbot.bridge._host import NodeHost
    from socialbot.bridge.environment import ros_context
    from socialbot.bridge.graph_observer import observe_graph
    from socialbot.bridge.topics import list_topics, observer_node, publish_once

    graph = Graph("g", (NodeConfig("mouth", Mouth),), frozenset({"/speech/heard"}), wire="typed")
    said: list[Message] = []
    came = threading.Event()

    def observe(_: str, message: Message) -> None:
        said.append(message)
        came.set()

    with (
        observe_graph({"/speech/say": Utterance}, observe, lambda *_: None, "typed") as watch,
        ros_context() as context,
    ):
        host = NodeHost(graph, graph.nodes[0], ros_context=context, sim_time=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(host.ros_node)
        host.start()
        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        try:
            word = Utterance(stamp=7, id="u1", text="Good morning")
            with observer_node() as ros:
                while watch.subscriptions["/speech/say"].endpoint.get_publisher_count() < 1:
                    came.wait(0.02)
                publish_once(ros, "/speech/heard", word, timeout_s=10.0)
                types = {topic.name: topic.types for topic in list_topics(ros)}
            assert came.wait(10.0)
            assert said == [word]
            assert types["/speech/say"] == types["/speech/heard"] == ("socialbot_msgs/msg/Utterance",)
        finally:
            executor.shutdown()
            thread.join(2.0)
            host.stop()


def test_sealed_messages_are_text() -> None:
    with pytest.raises(ParameterError, match="sealed messages travel as text"):
        open_transport({KEYS_VARIABLE: "keys"}, form="typed")


def test_missing_types_are_an_error_with_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    message_class.cache_clear()
    monkeypatch.setitem(sys.modules, f"{PACKAGE}.msg", None)
    with pytest.raises(InstallationError) as caught:
        open_transport({}, form="typed")
    assert caught.value.remedy == f"{interfaces_command(PACKAGE)}, or write messages: json in the graph"
    message_class.cache_clear()


@pytest.mark.parametrize(
    ("line", "wire", "standard"),
    [
        ("messages: json", "json", False),
        ("messages: socialbot", "typed", False),
        ("messages: standard", "json", True),
        ("wire: typed", "typed", False),
    ],
)
def test_graph_file_has_one_form_of_messages(line: str, wire: str, standard: bool) -> None:
    graph = parse_graph(f"name: g\n{line}\nnodes: {{}}\n", where="g.yaml")
    assert (graph.wire, graph.standard) == (wire, standard)
    assert parse_graph(dump_graph(graph), where="again") == graph
    assert with_changes(graph, ["messages=json"]) == replace(graph, wire="json", standard=False)
    with pytest.raises(GraphError, match="--set messages: no form of messages: 'typd'"):
        with_changes(graph, ["messages=typd"])


def test_unknown_and_contradictory_forms_are_refused() -> None:
    with pytest.raises(GraphError, match=r"g\.yaml:2: no form of messages: 'typd'"):
        parse_graph("name: g\nmessages: typd\nnodes: {}\n", where="g.yaml")
    with pytest.raises(GraphError, match=r"g\.yaml:3: 'wire' is the old name of 'messages'"):
        parse_graph("name: g\nmessages: standard\nwire: json\nnodes: {}\n", where="g.yaml")


def test_nonstandard_values_are_json_in_both_forms() -> None:
    class Carried(Structured, frozen=True, kw_only=True):
        load: str

    assert codec.ros_type(Carried, "typed") == codec.STRING
    message = Carried(stamp=1, load="crate")
    assert codec.decode(Carried, codec.encode(message, TYPES, "typed")) == message


def test_plain_text_is_an_utterance() -> None:
    said = codec.encode(Utterance(stamp=0, id="", text="Good morning"), TYPES, "typed")
    assert codec.decode(Utterance, said, stamp=5) == Utterance(stamp=5, id="text-5", text="Good morning")


def detections(**fields: Any) -> PersonDetections:
    person = PersonDetection(**{"x": 1.0, "y": 2.0, "w": 3.0, "h": 4.0, "score": 1.0, **fields})
    return PersonDetections(stamp=1, frame_id="", width=9, height=9, persons=(person,))


@pytest.mark.parametrize(
    ("message", "what"),
    [
        (HeadCommand(stamp=1, mode="look", pan_rad=math.inf), "pan_rad is inf"),
        (detections(x=math.nan), "x is nan"),
        (detections(face=(1.0, 2.0, -math.inf, 4.0)), "face is -inf"),
    ],
)
def test_a_typed_message_with_a_number_that_is_not_finite_is_refused(message: Structured, what: str) -> None:
    with pytest.raises(MessageError, match=f"not a valid .*: {what}"):
        codec.decode(type(message), codec.encode(message, TYPES, "typed"))


@pytest.mark.parametrize("distance_m", [math.nan, math.inf, -math.inf])
def test_an_optional_number_that_is_not_finite_is_missing(distance_m: float) -> None:
    """A sensor that measures nothing sends NaN or infinity (REP 117)."""
    sent = codec.encode(detections(distance_m=distance_m), TYPES, "typed")
    assert codec.decode(PersonDetections, sent) == detections()


def test_header_holds_stamp_and_frame() -> None:
    found = PersonDetections(stamp=3 * 10**9 + 7, frame_id="camera", width=640, height=480, persons=())
    ros = codec.encode(found, TYPES, "typed")
    assert (ros.header.stamp.sec, ros.header.stamp.nanosec, ros.header.frame_id) == (3, 7, "camera")
    assert codec.header_stamp(ros) == found.stamp == codec.raw_stamp(TYPES.serialize(ros))


@pytest.mark.parametrize(
    ("message", "what"),
    [
        (Utterance(stamp=1, id="a\0b", text=""), "has a zero byte"),
        (Utterance(stamp=1, id="\ud800", text=""), "UTF-8"),
        (Utterance(stamp=2**31 * 10**9, id="", text=""), "out of range"),
        (PersonDetections(stamp=1, frame_id="", width=2**63, height=1, persons=()), "64 bits"),
        (TraceRecord(stamp=1, id="", source="", kind="", what="", detail={"a": object()}), "as JSON"),
    ],
)
def test_refuses_values_that_a_type_cannot_express(message: Structured, what: str) -> None:
    with pytest.raises(MessageError, match=what):
        codec.encode(message, TYPES, "typed")


def test_refuses_json_of_another_schema() -> None:
    ros = codec.encode(PlanExecutionInfo(stamp=1, agent_id="a"), TYPES, "typed")
    ros.status = "NEVER"
    with pytest.raises(MessageError, match=r"not a valid socialbot_msgs/msg/PlanExecutionInfo: .*NEVER"):
        codec.decode(PlanExecutionInfo, ros)


def test_message_of_another_type_is_refused() -> None:
    with pytest.raises(MessageError, match="not a valid socialbot_msgs/msg/PlanExecutionInfo"):
        codec.decode(PlanExecutionInfo, codec.encode(Utterance(stamp=1, id="u", text=""), TYPES, "typed"))


def test_damaged_json_field_is_refused() -> None:
    ros = codec.encode(TraceRecord(stamp=1, id="", source="", kind="", what=""), TYPES, "typed")
    ros.detail = "{"
    with pytest.raises(MessageError, match="TraceRecord"):
        codec.decode(TraceRecord, ros)
