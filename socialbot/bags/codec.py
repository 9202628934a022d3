"""Convert messages of socialbot to ROS messages and back, by type name, without ROS packages."""

from __future__ import annotations

import array
import functools
import struct
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Protocol, TypeVar, Union, cast

import msgspec
import numpy as np

from socialbot.bags.sound import AUDIO_TYPES, is_sound, sound_of
from socialbot.bags.typed import from_typed, header_stamp, json_text, make_header, to_typed
from socialbot.bags.types import type_name, typed_messages
from socialbot.core import limits
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.decoding import JsonDecoder, json_decoder
from socialbot.core.errors import MessageError
from socialbot.core.messages import (
    NO_JSON,
    AudioData,
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
    PointCloud,
    PointField,
    RosMessage,
    Structured,
    Transform,
    Transforms,
    Utterance,
    is_ros_message,
    ros_message,
)
from socialbot.core.registry import message_types
from socialbot.graph.node import WireForm

M = TypeVar("M", bound=Message)

STRING = "std_msgs/msg/String"

ROS_TYPES: Mapping[type[Message], str] = MappingProxyType(
    {
        # The last class of a type is the one that `decodable_types` gives.
        DepthImage: "sensor_msgs/msg/Image",
        Image: "sensor_msgs/msg/Image",
        CompressedDepth: "sensor_msgs/msg/CompressedImage",
        CompressedImage: "sensor_msgs/msg/CompressedImage",
        DepthInfo: "sensor_msgs/msg/CameraInfo",
        CameraInfo: "sensor_msgs/msg/CameraInfo",
        PointCloud: "sensor_msgs/msg/PointCloud2",
        Transforms: "tf2_msgs/msg/TFMessage",
        JointTrajectory: "trajectory_msgs/msg/JointTrajectory",
        BoxMarkers: "visualization_msgs/msg/ImageMarker",
        Structured: STRING,
    }
)
"""ROS type of each message: unstructured ones, and structured ones in JSON form."""

BULK_TYPES = (Image, CompressedImage, PointCloud)
"""Messages whose field ``data`` may be large."""


@functools.cache
def decodable_types() -> Mapping[str, type[Message]]:
    """Message classes by ROS type for `decode`; `Structured` stands for the schema named in the JSON."""
    names = {name: kind for kind, name in ROS_TYPES.items()}
    # Old bags of ROS 1 have transforms in the package tf.
    sounds = dict.fromkeys(AUDIO_TYPES, AudioData)
    return MappingProxyType({**names, "tf/msg/tfMessage": Transforms, **sounds, **typed_messages()})


CDR_BEGIN = 4
"""Bytes before the first field of a serialised message."""

_LINE_LIST = 2
_LINE_WIDTH_PX = 2.0
_CORNERS = (0, 1, 1, 2, 2, 3, 3, 0)


class TypeFactory(Protocol):
    """Factory of ROS messages by type name."""

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """Make a message of ``type_name`` with all its ``fields``; sequences of numbers are numpy arrays."""
        ...

    def owns(self, ros_message: Any) -> bool:
        """Whether a message could have been made by this factory."""
        ...


def ros_type(message_type: type[Message], form: WireForm = "json") -> str:
    """ROS type for ``message_type``. Messages of other packages are JSON in both forms.

    Raises:
        MessageError: There is no such ROS type.
    """
    if issubclass(message_type, Structured):
        name = type_name(message_type)
        return name if form == "typed" and typed_messages().get(name) is message_type else STRING
    if issubclass(message_type, RosMessage):
        return message_type.ros_type
    if message_type not in ROS_TYPES:
        raise MessageError(f"{message_type.__name__} has no ROS type", remedy="derive it from Structured")
    return ROS_TYPES[message_type]


def message_type_of(ros_name: str) -> type[Message]:
    """Message class that `decode` makes of messages of a ROS type: one of socialbot, or else a `RosMessage`."""
    return decodable_types().get(ros_name) or ros_message(ros_name)


def carries(ros_name: str, message_type: type[Message]) -> bool:
    """Whether the ROS type ``ros_name`` carries ``message_type`` in one of the forms."""
    if message_type is AudioData and ros_name in AUDIO_TYPES:
        return True
    return ros_name in (ros_type(message_type), ros_type(message_type, "typed"))


def raw_stamp(cdr: bytes) -> int:
    """Stamp (ns) of a serialised message that begins with a header."""
    seconds, rest = struct.unpack_from("<iI" if cdr[1] & 1 else ">iI", cdr, CDR_BEGIN)
    return seconds * SECOND + rest


def with_stamp(cdr: bytes, stamp: int) -> bytes:
    """Replace the stamp (ns) of a serialised message that begins with a header."""
    packed = struct.pack("<iI" if cdr[1] & 1 else ">iI", *divmod(stamp, SECOND))
    return cdr[:CDR_BEGIN] + packed + cdr[CDR_BEGIN + len(packed) :]


def decode(message_type: type[M], ros_message: Any, *, stamp: int = 0) -> M:
    """Decode ``ros_message`` as ``message_type``; ``stamp`` (ns) is the default stamp.

    Pixels and compressed data are views of the ROS message. With `Structured`, the schema in the JSON selects the
    type. Raises MessageError when the content does not fit, or ``ros_message`` is of another type.
    """
    if message_type is AudioData and is_sound(ros_message):
        return cast(M, _decode_sound(ros_message, stamp))
    if issubclass(message_type, Structured):
        decode_form = _decode_typed if hasattr(ros_message, "header") else _decode_json
        return cast(M, decode_form(message_type, ros_message, stamp))
    if issubclass(message_type, RosMessage):
        return cast(M, message_type.of(ros_message, stamp))
    name = ros_type(message_type)
    try:
        return cast(M, _DECODERS[message_type](message_type, ros_message, header_stamp(ros_message) or stamp))
    except (AttributeError, TypeError, ValueError, IndexError) as error:
        raise MessageError(f"not a valid {name}: {error}") from error


def encode(message: Message, types: TypeFactory, form: WireForm = "json") -> Any:
    """Encode ``message`` with ``types``. Raises MessageError when its ROS type cannot express it."""
    if isinstance(message, Structured):
        if ros_type(type(message), form) == STRING:
            return types.make(STRING, data=json_text(message, f"{type(message).__name__} "))
        return to_typed(message, types)
    if isinstance(message, RosMessage):
        return _remade(message.ros, message.ros_type, types)
    name = ros_type(type(message))
    return _ENCODERS[type(message)](message, name, types)


def _remade(ros: Any, name: str, types: TypeFactory) -> Any:
    """Make a message of rclpy or rosbags with ``types``, field by field, unless it is one of them already."""
    if types.owns(ros):
        return ros

    def part(value: Any) -> Any:
        if isinstance(value, (list, tuple)):
            return [part(each) for each in value]
        if is_ros_message(value):
            return _remade(value, ros_message(type(value)).ros_type, types)
        return np.asarray(value) if isinstance(value, array.array) else value

    names = ros.get_fields_and_field_types() if hasattr(ros, "get_fields_and_field_types") else vars(ros)
    try:
        return types.make(name, **{field: part(getattr(ros, field)) for field in names})
    except (AttributeError, TypeError, ValueError, AssertionError) as error:
        raise MessageError(f"not a valid {name}: {error}") from error


def _decode_sound(ros_message: Any, stamp: int) -> AudioData:
    try:
        return sound_of(ros_message, stamp)
    except (AttributeError, TypeError, ValueError) as error:
        raise MessageError(f"not a valid message with sound: {error}") from error


def _decode_typed(message_type: type[Structured], ros_message: Any, stamp: int) -> Structured:
    message = from_typed(message_type, ros_message)
    if isinstance(message, Utterance) and not message.id and not message.stamp:
        # The sender gave only a text.
        return msgspec.structs.replace(message, stamp=stamp, id=f"text-{stamp}")
    return message


def _decode_json(message_type: type[Structured], ros_message: Any, stamp: int) -> Structured:
    text = getattr(ros_message, "data", None)
    if not isinstance(text, str):
        raise MessageError(f"not a valid {STRING}: {type(ros_message).__name__} holds no text")
    _expect_at_most(limits.TEXT_BYTES, len(text), "characters")
    if message_type in (Utterance, Structured) and not text.lstrip().startswith("{"):
        _expect_at_most(limits.SENTENCE_CHARACTERS, len(text), "characters of a sentence")
        return Utterance(stamp=stamp, id=f"text-{stamp}", text=text)
    if message_type is HeardSpeech and not text.lstrip().startswith("{"):  # of a recogniser that knows only the text
        _expect_at_most(limits.SENTENCE_CHARACTERS, len(text), "characters of a sentence")
        return HeardSpeech(stamp=stamp, start=stamp, text=text.strip())
    wanted = "a schema of socialbot" if message_type is Structured else str(message_type.__struct_config__.tag)
    try:
        message = _json_decoder(message_type).decode(text)
    except NO_JSON as error:
        raise MessageError(f"JSON does not fit {wanted}: {error}", remedy=_schema_remedy(str(error))) from error
    if not isinstance(message, message_type):
        raise MessageError(f"JSON does not fit {wanted}: it is {message.__struct_config__.tag}")
    return message


def _expect_at_most(most: int, count: int, what: str) -> None:
    if count > most:
        raise MessageError(f"a message has at most {most} {what} (got {count})")


@functools.cache
def _json_decoder(message_type: type[Structured]) -> JsonDecoder[Any]:
    # A union, because msgspec lets the schema name be missing where only one struct is possible.
    members = message_types() if message_type is Structured else (message_type, Structured)
    return json_decoder(Union[members])  # noqa: UP007 - the members are known at run time only


def _schema_remedy(error: str) -> str | None:
    if "$.schema" in error:
        return "connect the topic to a sender of that schema, and run the same version of socialbot on both sides"
    return 'name the schema in the JSON: {"schema": "socialbot/...", ...}' if "`schema`" in error else None


def _bytes(data: Any) -> np.ndarray:
    return np.frombuffer(data, np.uint8)


def _floats(numbers: Any) -> tuple[float, ...]:
    return tuple(map(float, numbers))


_FIELDS: dict[type[Message], Mapping[str, Callable[[Any], Any] | None]] = {
    Image: {"height": None, "width": None, "encoding": None, "is_bigendian": bool, "step": None, "data": _bytes},
    CompressedImage: {"format": None, "data": _bytes},
    CameraInfo: {
        "width": None,
        "height": None,
        "distortion_model": None,
        "k": _floats,
        "d": _floats,
        "roi": lambda part: (part.x_offset, part.y_offset, part.width, part.height),
    },
    PointCloud: {
        "height": None,
        "width": None,
        "fields": lambda fields: tuple(
            PointField(each.name, each.offset, each.datatype, each.count) for each in fields
        ),
        "is_bigendian": bool,
        "point_step": None,
        "row_step": None,
        "data": _bytes,
    },
}
_FIELDS |= {DepthImage: _FIELDS[Image], CompressedDepth: _FIELDS[CompressedImage], DepthInfo: _FIELDS[CameraInfo]}
"""Fields that have the same name in ROS, and how they are converted from ROS."""


def _decode_fields(message_type: Any, ros: Any, stamp: int) -> Message:
    if issubclass(message_type, CameraInfo):
        _expect_at_most(limits.JOINTS, len(ros.d if hasattr(ros, "d") else ros.D), "coefficients of a lens")
    else:
        _expect_at_most(limits.BULK_BYTES, len(ros.data), "bytes of an image or of points")
    fields = {}
    for name, convert in _FIELDS[message_type].items():
        value = getattr(ros, name) if hasattr(ros, name) else getattr(ros, name.upper())  # ROS 1 writes K and D
        fields[name] = convert(value) if convert else value
    return message_type(stamp=stamp, frame_id=ros.header.frame_id, **fields)


def _decode_trajectory(message_type: type[Message], ros: Any, stamp: int) -> JointTrajectory:
    if len(ros.points) != 1:
        raise MessageError(f"a trajectory must have 1 point (got {len(ros.points)})")
    point = ros.points[0]
    joints = len(ros.joint_names)
    _expect_at_most(limits.JOINTS, joints, "joints")
    if len(point.positions) != joints or len(point.velocities) not in (0, joints):
        counts = f"{len(point.positions)} positions and {len(point.velocities)} velocities"
        raise MessageError(f"a trajectory of {joints} joints has {counts}")
    return JointTrajectory(
        stamp=stamp,
        joint_names=tuple(ros.joint_names),
        positions=_floats(point.positions),
        velocities=_floats(point.velocities),
        duration_s=(point.time_from_start.sec * SECOND + point.time_from_start.nanosec) / SECOND,
    )


def _decode_boxes(message_type: type[Message], ros: Any, stamp: int) -> BoxMarkers:
    if ros.type != _LINE_LIST or len(ros.points) % len(_CORNERS):
        raise MessageError(f"an ImageMarker of type {ros.type} with {len(ros.points)} points is no list of boxes")
    boxes = []
    for first in range(0, len(ros.points), len(_CORNERS)):
        corner, opposite = ros.points[first], ros.points[first + 3]
        boxes.append((corner.x, corner.y, opposite.x - corner.x, opposite.y - corner.y))
    return BoxMarkers(stamp=stamp, frame_id=ros.header.frame_id, boxes=tuple(boxes))


def _decode_transforms(message_type: type[Message], ros: Any, stamp: int) -> Transforms:
    _expect_at_most(limits.TRANSFORMS, len(ros.transforms), "transforms")

    def one(each: Any) -> Transform:
        at, turn = each.transform.translation, each.transform.rotation
        return Transform(
            stamp=each.header.stamp.sec * SECOND + each.header.stamp.nanosec,
            parent=each.header.frame_id.lstrip("/"),
            child=each.child_frame_id.lstrip("/"),
            translation=(at.x, at.y, at.z),
            rotation=(turn.x, turn.y, turn.z, turn.w),
        )

    return Transforms(stamp=stamp, transforms=tuple(map(one, ros.transforms)))


def _encode_transforms(message: Transforms, name: str, types: TypeFactory) -> Any:
    def one(each: Transform) -> Any:
        translation = types.make("geometry_msgs/msg/Vector3", **dict(zip("xyz", each.translation, strict=True)))
        rotation = types.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", each.rotation, strict=True)))
        transform = types.make("geometry_msgs/msg/Transform", translation=translation, rotation=rotation)
        header = make_header(types, each.stamp, each.parent)
        return types.make(
            "geometry_msgs/msg/TransformStamped", header=header, child_frame_id=each.child, transform=transform
        )

    return types.make(name, transforms=[one(each) for each in message.transforms])


def _array(numbers: tuple[float, ...]) -> np.ndarray:
    return np.array(numbers, np.float64)


def _duration(types: TypeFactory, seconds: float) -> Any:
    whole, rest = divmod(nanoseconds(seconds), SECOND)
    return types.make("builtin_interfaces/msg/Duration", sec=whole, nanosec=rest)


def _encode_fields(message: Image | CompressedImage | CameraInfo | PointCloud, name: str, types: TypeFactory) -> Any:
    fields = {field: getattr(message, field) for field in _FIELDS[type(message)]}
    if isinstance(message, Image):
        fields["is_bigendian"] = int(message.is_bigendian)
    elif isinstance(message, PointCloud):
        parts = [msgspec.structs.asdict(field) for field in message.fields]
        fields |= {"fields": [types.make("sensor_msgs/msg/PointField", **part) for part in parts], "is_dense": False}
    elif isinstance(message, CameraInfo):
        fields |= _camera_fields(message, types)
    return types.make(name, header=make_header(types, message.stamp, message.frame_id), **fields)


def _camera_fields(info: CameraInfo, types: TypeFactory) -> dict[str, Any]:
    if len(info.k) != 9:
        raise MessageError(f"k of a CameraInfo must have 9 numbers (got {len(info.k)})")
    k = _array(info.k)
    p = np.hstack([k.reshape(3, 3), np.zeros((3, 1))]).reshape(-1)
    x, y, width, height = info.roi
    region = types.make(
        "sensor_msgs/msg/RegionOfInterest", x_offset=x, y_offset=y, height=height, width=width, do_rectify=False
    )
    return {
        "d": _array(info.d),
        "k": k,
        "r": np.eye(3).reshape(-1),
        "p": p,
        "binning_x": 0,
        "binning_y": 0,
        "roi": region,
    }


def _encode_trajectory(trajectory: JointTrajectory, name: str, types: TypeFactory) -> Any:
    point = types.make(
        "trajectory_msgs/msg/JointTrajectoryPoint",
        positions=_array(trajectory.positions),
        velocities=_array(trajectory.velocities),
        accelerations=_array(()),
        effort=_array(()),
        time_from_start=_duration(types, trajectory.duration_s),
    )
    header = make_header(types, trajectory.stamp)
    return types.make(name, header=header, joint_names=list(trajectory.joint_names), points=[point])


def _encode_boxes(markers: BoxMarkers, name: str, types: TypeFactory) -> Any:
    def point(x: float, y: float) -> Any:
        return types.make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0)

    def colour(red: float, green: float, blue: float) -> Any:
        return types.make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0)

    points = []
    for x, y, w, h in markers.boxes:
        corners = [point(x, y), point(x + w, y), point(x + w, y + h), point(x, y + h)]
        points += [corners[index] for index in _CORNERS]
    return types.make(
        name,
        header=make_header(types, markers.stamp, markers.frame_id),
        ns="socialbot",
        id=0,
        type=_LINE_LIST,
        action=0,
        position=point(0, 0),
        scale=_LINE_WIDTH_PX,
        outline_color=colour(0.0, 1.0, 0.0),
        filled=0,
        fill_color=colour(0.0, 0.0, 0.0),
        lifetime=_duration(types, 0),
        points=points,
        outline_colors=[],
    )


_DECODERS: Mapping[type[Message], Callable[[type[Message], Any, int], Message]] = {
    **dict.fromkeys(_FIELDS, _decode_fields),
    JointTrajectory: _decode_trajectory,
    Transforms: _decode_transforms,
    BoxMarkers: _decode_boxes,
}
_ENCODERS: Mapping[type[Message], Callable[[Any, str, TypeFactory], Any]] = {
    **dict.fromkeys(_FIELDS, _encode_fields),
    JointTrajectory: _encode_trajectory,
    Transforms: _encode_transforms,
    BoxMarkers: _encode_boxes,
}
