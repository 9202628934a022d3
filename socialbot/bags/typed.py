"""Structured messages as ROS messages of their own types, field by field."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec
import numpy as np

from socialbot.bags.types import BYTE, JSON, Field, fields_of, type_name
from socialbot.core.clock import SECOND
from socialbot.core.decoding import from_builtins, from_json
from socialbot.core.errors import MessageError
from socialbot.core.messages import Structured

if TYPE_CHECKING:
    from socialbot.bags.codec import TypeFactory

S = TypeVar("S", bound=Structured)

MISSING = msgspec.NODEFAULT
_NUMBERS = {"bool": np.bool_, "int64": np.int64, "float64": np.float64}


def header_stamp(ros_message: Any) -> int | None:
    """Stamp (ns) in the header of ``ros_message``; None when its type has no header."""
    header = getattr(ros_message, "header", None)
    return None if header is None else header.stamp.sec * SECOND + header.stamp.nanosec


def make_header(types: TypeFactory, stamp: int, frame_id: str = "") -> Any:
    """Make a header with a stamp (ns)."""
    seconds, rest = divmod(stamp, SECOND)
    time = types.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)
    return types.make("std_msgs/msg/Header", stamp=time, frame_id=frame_id)


def json_text(value: Any, what: str = "") -> str:
    """Encode a value as JSON. Raises MessageError, which begins with ``what``, if JSON cannot express it."""
    try:
        return msgspec.json.encode(value).decode()
    except (UnicodeError, TypeError, OverflowError, RecursionError) as error:
        raise MessageError(f"{what}cannot be written as JSON: {error}") from error


def to_typed(message: Structured, types: TypeFactory) -> Any:
    """Encode ``message`` as its own ROS type. Raises MessageError when that cannot express it."""
    try:
        if abs(message.stamp // SECOND) >= 2**31:
            raise MessageError(f"the stamp {message.stamp} is out of range")
        header = make_header(types, message.stamp, _text_field(getattr(message, "frame_id", "")))
        return types.make(type_name(type(message)), header=header, **_values(message, types))
    except MessageError as error:
        raise MessageError(error.what, where=type(message).__name__) from error


def from_typed(message_type: type[S], ros_message: Any) -> S:
    """Decode a ROS message of an own type. Raises MessageError when it has another type, or does not fit."""
    try:
        header = ros_message.header
        given = {
            "schema": message_type.__struct_config__.tag,
            "stamp": header_stamp(ros_message),
            "frame_id": header.frame_id,
            **_given(message_type, ros_message),
        }
        return from_builtins(given, message_type)
    except (AttributeError, TypeError, ValueError, msgspec.MsgspecError, RecursionError) as error:
        raise MessageError(f"not a valid {type_name(message_type)}: {error}") from error


def _values(struct: Any, types: TypeFactory) -> dict[str, Any]:
    return {field.name: _value(field, getattr(struct, field.attribute), types) for field in fields_of(type(struct))}


def _value(field: Field, value: Any, types: TypeFactory) -> Any:
    if field.missing_is_nan:
        return math.nan if value is None else float(value)
    if not field.count:
        return _one(field, value, types)
    if field.kind == BYTE:
        return np.frombuffer(value, np.uint8)
    if field.count == "[<=1]":
        value = () if value is None else (value,)
    items = [_one(field, item, types) for item in value]
    number = _NUMBERS.get(field.kind) if isinstance(field.kind, str) else None
    return items if number is None else np.array(items, number)


def _one(field: Field, value: Any, types: TypeFactory) -> Any:
    match field.kind:
        case type():
            return types.make(type_name(field.kind), **_values(value, types))
        case "string":
            return _text_field(value)
        case "json":
            return _text_field(json_text(value))
        case "float64":
            return float(value)
        case "int64" if not -(2**63) <= value < 2**63:
            raise MessageError(f"{field.name} does not fit into 64 bits (got {value})")
        case _:
            return value


def _text_field(text: str) -> str:
    try:
        text.encode()
    except UnicodeError as error:
        raise MessageError(f"{text!r} cannot be written as UTF-8: {error}") from error
    if "\0" in text:
        raise MessageError(
            f"{text!r} has a zero byte, which ends a ROS string", remedy="remove it, or write messages: json"
        )
    return text


def _given(struct: type, ros_message: Any) -> dict[str, Any]:
    """Return the fields of ``struct`` that differ from their defaults, by their names in messages."""
    fields = ((field, _read(field, getattr(ros_message, field.name))) for field in fields_of(struct))
    defaults = _defaults(struct)
    return {field.name: value for field, value in fields if defaults.get(field.name, MISSING) != value}


@functools.cache
def _defaults(struct: type) -> dict[str, Any]:
    return {
        field.encode_name: field.default for field in msgspec.structs.fields(struct) if field.default is not MISSING
    }


def _read(field: Field, value: Any) -> Any:
    if field.missing_is_nan:
        return float(value) if math.isfinite(value) else None  # infinity is no measurement, either (REP 117)
    if not field.count:
        return _read_one(field, value)
    if field.kind == BYTE:
        return bytes(value)
    # Arrays of numbers come as array.array from rclpy, and of numpy from rosbags.
    items = tuple(_read_one(field, item) for item in (value if isinstance(value, list) else value.tolist()))
    if field.count == "[<=1]":
        return items[0] if items else None
    return items


def _read_one(field: Field, value: Any) -> Any:
    if isinstance(field.kind, type):
        return from_builtins(_given(field.kind, value), field.kind)
    if field.kind == JSON:
        return from_json(value, Any)
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{field.name} is {value}, and no finite number")
    return value
