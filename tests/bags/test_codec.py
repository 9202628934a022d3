from __future__ import annotations

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import inspect as structs

from socialbot.bags import codec
from socialbot.bags.types import RosbagsTypes
from socialbot.bridge.transport import RclpyTypes, message_class
from socialbot.core import limits
from socialbot.core.errors import InstallationError, MessageError
from socialbot.core.messages import (
    BoxMarkers,
    CameraInfo,
    CompressedDepth,
    CompressedImage,
    DepthImage,
    DepthInfo,
    HeardSpeech,
    Image,
    JointTrajectory,
    Message,
    Mind,
    PersonDetection,
    PersonDetections,
    PointCloud,
    PointField,
    StopSpeech,
    Structured,
    Transform,
    Transforms,
    Utterance,
)
from socialbot.core.registry import message_types

TYPES = RosbagsTypes()

stamps = st.integers(1, 2**31 * 10**9 - 1)
texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12)
numbers = st.floats(allow_nan=False, allow_infinity=False)
sides = st.integers(0, 2**32 - 1)
quarters = st.integers(-(10**6), 10**6).map(lambda n: n / 4)
pixels = st.binary(max_size=64).map(lambda data: np.frombuffer(data, np.uint8))
scalars = st.one_of(texts, st.integers(-(2**63), 2**63 - 1), numbers, st.booleans())


def floats(size: int | None = None) -> st.SearchStrategy[tuple[float, ...]]:
    return st.lists(numbers, min_size=size or 0, max_size=size or 8).map(tuple)


def tuples(items: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.lists(items, max_size=4).map(tuple)


def values(kind: structs.Type) -> st.SearchStrategy[Any]:
    """Values of any type in a structured message."""
    match kind:
        case structs.Metadata(type=inner):
            return values(inner)
        case structs.StrType():
            return texts
        case structs.BytesType():
            return st.binary(max_size=64)
        case structs.BoolType():
            return st.booleans()
        case structs.IntType(ge=low, le=high):
            return st.integers(-(2**63) if low is None else low, 2**63 - 1 if high is None else high)
        case structs.FloatType(ge=low, le=high):
            return st.floats(low, high, allow_nan=False, allow_infinity=False)
        case structs.NoneType():
            return st.none()
        case structs.LiteralType(values=choices):
            return st.sampled_from(choices)
        case structs.UnionType(types=types):
            return st.one_of(*map(values, types))
        case structs.VarTupleType(item_type=item):
            return tuples(values(item))
        case structs.DictType(key_type=key, value_type=value):
            return st.dictionaries(values(key), values(value), max_size=3)
        case structs.StructType(cls=cls, fields=fields):
            return st.builds(
                cls, **{each.name: stamps if each.name == "stamp" else values(each.type) for each in fields}
            )
        case _:
            return scalars | st.lists(scalars, max_size=3)


frames = texts.map(lambda text: text.lstrip("/"))
messages: dict[type[Message], st.SearchStrategy[Any]] = {
    **{kind: st.builds(
        kind, stamp=stamps, frame_id=texts, height=sides, width=sides, encoding=texts, step=sides, data=pixels,
        is_bigendian=st.booleans(),
    ) for kind in (Image, DepthImage)},
    **{
        kind: st.builds(kind, stamp=stamps, frame_id=texts, format=texts, data=pixels)
        for kind in (CompressedImage, CompressedDepth)
    },
    **{kind: st.builds(
        kind, stamp=stamps, frame_id=texts, width=sides, height=sides, k=floats(9), d=floats(),
        distortion_model=texts,
    ) for kind in (CameraInfo, DepthInfo)},
    PointCloud: st.builds(
        PointCloud, stamp=stamps, frame_id=texts, height=sides, width=sides, is_bigendian=st.booleans(),
        point_step=sides, row_step=sides, data=pixels,
        fields=tuples(st.builds(PointField, texts, sides, st.integers(0, 255), sides)),
    ),
    Transforms: st.builds(
        Transforms, stamp=stamps,
        transforms=tuples(st.builds(
            Transform, stamp=stamps, parent=frames, child=frames, translation=floats(3), rotation=floats(4),
        )),
    ),
    JointTrajectory: st.lists(st.tuples(texts, numbers, numbers)).flatmap(
        lambda joints: st.builds(
            JointTrajectory, stamp=stamps, joint_names=st.just(tuple(name for name, _, _ in joints)),
            positions=st.just(tuple(at for _, at, _ in joints)),
            velocities=st.just(tuple(speed for _, _, speed in joints)),
            duration_s=st.integers(0, 10**15).map(lambda ns: ns / 10**9),
        )
    ),
    BoxMarkers: st.builds(
        BoxMarkers, stamp=stamps, frame_id=texts, boxes=tuples(st.tuples(quarters, quarters, quarters, quarters)),
    ),
    **{kind: values(structs.type_info(kind)) for kind in message_types(built_in=True)},
}  # fmt: skip
# Transforms have no header, and no wheel of their own for rclpy.
anything = st.sampled_from([kind for kind in messages if kind is not Transforms]).flatmap(messages.__getitem__)


def plain(message: Message) -> dict[str, Any]:
    """The message with arrays as lists, so that two can be compared with their types."""
    fields = {name: getattr(message, name) for name in message.__struct_fields__}
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in fields.items()} | {
        "type": type(message)
    }


def string(text: str) -> Any:
    return SimpleNamespace(data=text)


def test_every_message_has_a_strategy_and_a_ros_type() -> None:
    assert set(messages) | {Structured} == {*codec.ROS_TYPES, *message_types()}
    assert set(message_types()) <= set(messages)


def test_names_of_ros_types() -> None:
    assert codec.ROS_TYPES[Image] == "sensor_msgs/msg/Image"
    assert codec.ROS_TYPES[BoxMarkers] == "visualization_msgs/msg/ImageMarker"
    assert codec.ros_type(Utterance) == codec.STRING
    assert codec.decodable_types()["sensor_msgs/msg/CompressedImage"] is CompressedImage
    assert codec.decodable_types()["std_msgs/msg/String"] is Structured


def test_structured_messages_of_others_travel_as_json_too() -> None:
    class Carried(Structured, frozen=True, kw_only=True):
        load: str

    message = Carried(stamp=1, load="crate")
    ros = codec.encode(message, TYPES)
    assert json.loads(ros.data) == {"schema": "socialbot/Carried/1", "stamp": 1, "load": "crate"}
    assert codec.decode(Carried, ros) == message


def test_bare_message_has_no_ros_type() -> None:
    with pytest.raises(MessageError, match="no ROS type"):
        codec.encode(Message(stamp=1), TYPES)


@given(anything)
def test_round_trip_through_cdr(message: Message) -> None:
    ros = codec.encode(message, TYPES)
    name = codec.ros_type(type(message))
    assert ros.__msgtype__ == name
    back = codec.decode(type(message), TYPES.deserialize(TYPES.serialize(ros), name), stamp=7)
    assert plain(back) == plain(message)


@given(anything)
def test_structured_decodes_the_schema_in_the_json(message: Message) -> None:
    ros = codec.encode(message, TYPES)
    kind = codec.decodable_types()[ros.__msgtype__]
    assert issubclass(type(message), kind)
    assert plain(codec.decode(kind, ros)) == plain(message) | {
        "type": kind if kind is not Structured else type(message)
    }


@given(messages[Transforms])
def test_transforms_round_trip(message: Transforms) -> None:
    data = TYPES.serialize(codec.encode(message, TYPES))
    ros = TYPES.deserialize(data, codec.ros_type(Transforms))
    assert codec.decode(Transforms, ros, stamp=message.stamp) == message


@pytest.mark.ros
@given(anything)
def test_round_trip_through_rclpy(message: Message) -> None:
    serialization = pytest.importorskip("rclpy.serialization")
    ros = codec.encode(message, RclpyTypes())
    data = serialization.serialize_message(ros)
    name = codec.ros_type(type(message))
    back = serialization.deserialize_message(data, message_class(name))
    assert plain(codec.decode(type(message), back)) == plain(message)
    assert plain(codec.decode(type(message), TYPES.deserialize(data, name))) == plain(message)


@pytest.mark.ros
def test_pixels_reach_rclpy_as_an_array_of_bytes() -> None:
    pytest.importorskip("rclpy")
    image = Image.from_bgr(np.arange(24, dtype=np.uint8).reshape(2, 4, 3)[:, ::2], stamp=1, frame_id="c")
    ros = codec.encode(image, RclpyTypes())
    assert (type(ros.data).__name__, ros.data.typecode, ros.data.tolist()) == ("array", "B", image.data.tolist())


def test_pixels_are_not_copied() -> None:
    data = bytearray(12)
    ros = codec.encode(Image.from_bgr(np.zeros((2, 2, 3), np.uint8), stamp=1, frame_id="c"), TYPES)
    ros.data = data
    image = codec.decode(Image, ros)
    data[3] = 9
    assert image.data[3] == 9


def test_zero_header_stamp_becomes_the_time_of_reception() -> None:
    ros = codec.encode(CompressedImage(stamp=0, frame_id="c", format="jpeg", data=np.zeros(2, np.uint8)), TYPES)
    assert codec.decode(CompressedImage, ros, stamp=123).stamp == 123
    assert codec.header_stamp(ros) == 0
    assert codec.header_stamp(string("x")) is None


@pytest.mark.parametrize("text", ["hello", "", "  good morning", "[1, 2]"])
def test_plain_text_is_an_utterance(text: str) -> None:
    assert codec.decode(Utterance, string(text), stamp=5) == Utterance(stamp=5, id="text-5", text=text)
    assert codec.decode(Structured, string(text), stamp=5) == Utterance(stamp=5, id="text-5", text=text)


@pytest.mark.parametrize("text", ["hello", "  good morning\n"])
def test_plain_text_where_speech_is_expected_was_heard(text: str) -> None:
    heard = HeardSpeech(stamp=5, start=5, text=text.strip())
    assert codec.decode(HeardSpeech, string(text), stamp=5) == heard


UTTERANCE = {"schema": "socialbot/Utterance/1", "stamp": 1, "id": "u", "text": "hello"}


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"schema": "socialbot/Utterance/2"}, r"socialbot/Utterance/1: Invalid value 'socialbot/Utterance/2'"),
        ({"schema": "socialbot/Mind/1"}, r"socialbot/Utterance/1: Invalid value 'socialbot/Mind/1'"),
        ({"schema": "socialbot/Structured/1"}, r"socialbot/Utterance/1: it is socialbot/Structured/1"),
        ({"schema": None}, r"socialbot/Utterance/1"),
        ({"text": 3}, r"socialbot/Utterance/1: Expected `str`, got `int` - at `\$.text`"),
        ({"stamp": 1.5}, r"\$.stamp"),
        ({"id": msgspec.UNSET}, r"missing required field `id`"),
        ({"schema": msgspec.UNSET}, r"missing required field `schema`"),
    ],
)
def test_json_that_does_not_fit_is_refused(change: dict[str, Any], complaint: str) -> None:
    content = {name: value for name, value in (UTTERANCE | change).items() if value is not msgspec.UNSET}
    with pytest.raises(MessageError, match=complaint):
        codec.decode(Utterance, string(json.dumps(content)))


@pytest.mark.parametrize("text", ["{", '{"schema":', "{" + '"a":' + "[" * 100_000, '{"schema": "\udc80"}'])
@pytest.mark.parametrize("message_type", [Utterance, Structured])
def test_broken_json_is_refused(text: str, message_type: type[Structured]) -> None:
    with pytest.raises(MessageError, match="JSON does not fit"):
        codec.decode(message_type, string(text))


def test_unknown_schema_is_named() -> None:
    with pytest.raises(MessageError, match="somebody/Else/3") as caught:
        codec.decode(Structured, string('{"schema": "somebody/Else/3"}'))
    assert caught.value.remedy is not None


@pytest.mark.parametrize("text", ["hello", "{}"])
def test_plain_text_is_nothing_but_an_utterance(text: str) -> None:
    with pytest.raises(MessageError, match="socialbot/Mind/1"):
        codec.decode(Mind, string(text))


@pytest.mark.parametrize("message_type", list(messages))
@pytest.mark.parametrize("content", [SimpleNamespace(), SimpleNamespace(data=3), SimpleNamespace(header=None)])
def test_other_messages_are_refused(message_type: type[Message], content: Any) -> None:
    with pytest.raises(MessageError, match="not a valid"):
        codec.decode(message_type, content)


@pytest.mark.parametrize(
    ("positions", "velocities"), [((0.5,), ()), ((0.5, 0.1, 0.2), ()), ((0.5, 0.1), (0.1,)), ((), (0.1, 0.1))]
)
def test_trajectory_has_a_position_for_each_joint(positions: tuple[float, ...], velocities: tuple[float, ...]) -> None:
    trajectory = JointTrajectory(
        stamp=1, joint_names=("pan", "tilt"), positions=positions, velocities=velocities, duration_s=1.5
    )
    with pytest.raises(MessageError, match="a trajectory of 2 joints has"):
        codec.decode(JointTrajectory, codec.encode(trajectory, TYPES))


PERSON = PersonDetection(x=0, y=0, w=1, h=2, score=1)
STILL = Transform(stamp=1, parent="a", child="b", translation=(0, 0, 0), rotation=(0, 0, 0, 1))


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        ("PERSONS", lambda n: PersonDetections(stamp=1, frame_id="", width=1, height=1, persons=(PERSON,) * n)),
        ("SENTENCE_CHARACTERS", lambda n: Utterance(stamp=1, id="a", text="x" * n)),
        ("SENTENCE_CHARACTERS", lambda n: HeardSpeech(stamp=1, start=0, text="x" * n)),
        ("ALTERNATIVES", lambda n: HeardSpeech(stamp=1, start=0, text="x", alternatives=("y",) * n)),
        ("TRANSFORMS", lambda n: Transforms(stamp=1, transforms=(STILL,) * n)),
        (
            "JOINTS",
            lambda n: JointTrajectory(
                stamp=1, joint_names=("a",) * n, positions=(0.0,) * n, velocities=(), duration_s=1
            ),
        ),
        ("JOINTS", lambda n: CameraInfo(stamp=1, frame_id="", width=1, height=1, k=(1.0,) * 9, d=(0.0,) * n)),
    ],
)
def test_longer_messages_are_refused(limit: str, message: Callable[[int], Message]) -> None:
    most = getattr(limits, limit)
    for count in (most, most + 1):
        sent = message(count)
        ros = codec.encode(sent, TYPES)
        if count == most:
            assert codec.decode(type(sent), ros, stamp=1) == sent
        else:
            with pytest.raises(MessageError):
                codec.decode(type(sent), ros)


def test_sentences_and_texts_in_other_forms_are_refused_as_well() -> None:
    with pytest.raises(MessageError, match="characters of a sentence"):
        codec.decode(Utterance, SimpleNamespace(data="x" * (limits.SENTENCE_CHARACTERS + 1)))
    with pytest.raises(MessageError, match="16777216 characters"):
        codec.decode(Structured, SimpleNamespace(data="{" + " " * limits.TEXT_BYTES))


@pytest.mark.parametrize("number", [-1, 2**63, 10**30])
def test_times_that_ros_cannot_hold_are_refused(number: int) -> None:
    text = json.dumps({"schema": "socialbot/StopSpeech/1", "stamp": number})
    with pytest.raises(MessageError, match=r"\$.stamp"):
        codec.decode(StopSpeech, SimpleNamespace(data=text))


def test_trajectory_has_one_point() -> None:
    trajectory = JointTrajectory(stamp=1, joint_names=("pan",), positions=(0.5,), velocities=(), duration_s=1.5)
    ros = codec.encode(trajectory, TYPES)
    assert (ros.points[0].time_from_start.sec, ros.points[0].time_from_start.nanosec) == (1, 500_000_000)
    ros.points = []
    with pytest.raises(MessageError, match="got 0"):
        codec.decode(JointTrajectory, ros)


def test_boxes_are_drawn_as_closed_lines() -> None:
    ros = codec.encode(BoxMarkers(stamp=1, frame_id="c", boxes=((10.0, 20.0, 3.0, 4.0),)), TYPES)
    corners = [(point.x, point.y) for point in ros.points]
    assert ros.type == 2
    assert corners == [(10, 20), (13, 20), (13, 20), (13, 24), (13, 24), (10, 24), (10, 24), (10, 20)]
    ros.points = ros.points[:-1]
    with pytest.raises(MessageError, match="no list of boxes"):
        codec.decode(BoxMarkers, ros)


def test_camera_info_has_the_projection_of_a_single_camera() -> None:
    info = CameraInfo(
        stamp=1, frame_id="c", width=640, height=480, k=(500.0, 0, 320, 0, 510, 240, 0, 0, 1), roi=(8, 6, 320, 200)
    )
    ros = codec.encode(info, TYPES)
    assert ros.p.tolist() == [500, 0, 320, 0, 0, 510, 240, 0, 0, 0, 1, 0]
    assert ros.r.tolist() == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    with pytest.raises(MessageError, match="9 numbers"):
        codec.encode(CameraInfo(stamp=1, frame_id="c", width=1, height=1, k=(1.0,)), TYPES)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("nobody_msgs/msg/Nothing", "source the ROS workspace that has the package nobody_msgs"),
        ("sensor_msgs/msg/Nothing", "install ros-jazzy-rclpy"),
        ("nonsense", "source the ROS workspace"),
        ("", "source the ROS workspace"),
    ],
)
def test_types_that_are_not_installed(name: str, remedy: str) -> None:
    with pytest.raises(InstallationError, match="not installed") as caught:
        RclpyTypes().make(name)
    assert remedy in str(caught.value.remedy)


def test_types_that_rosbags_does_not_know() -> None:
    with pytest.raises(MessageError, match="nobody_msgs"):
        TYPES.make("nobody_msgs/msg/Nothing")
    with pytest.raises(MessageError, match="0 bytes"):
        TYPES.deserialize(b"", "std_msgs/msg/String")
    with pytest.raises(MessageError, match="cannot be written"):
        TYPES.serialize(TYPES.make("std_msgs/msg/String", data=3))


@pytest.mark.parametrize("text", ["\ud800", "a\udcff"])
def test_text_that_has_no_bytes_cannot_be_sent(text: str) -> None:
    with pytest.raises(MessageError, match="Utterance cannot be written as JSON"):
        codec.encode(Utterance(stamp=1, id="u", text=text), TYPES)
