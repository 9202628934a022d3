"""Structured messages as ROS messages of their own types, and back; the types are those of `interfaces`."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec
import numpy as np

from socialbot.bridge.interfaces import JSON, Field, fields_of, type_name
from socialbot.clock import SECOND
from socialbot.errors import MessageError
from socialbot.messages import Structured

if TYPE_CHECKING:
    from socialbot.bridge.codec import TypeFactory

S = TypeVar("S", bound=Structured)

MISSING = msgspec.NODEFAULT
INTEGERS = range(-(2**63), 2**63)
_NUMBERS = {"bool": np.bool_, "int64": np.int64, "float64": np.float64}


def to_typed(message: Structured, types: TypeFactory) -> Any:
    """``message`` as a ROS message of its own type. Raises MessageError when that cannot express it."""
    try:
        seconds, rest = divmod(message.stamp, SECOND)
        if abs(seconds) >= 2**31:
            raise MessageError(f"the stamp {message.stamp} is out of range")
        stamp = types.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)
        frame_id = _text(getattr(message, "frame_id", ""))
        header = types.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)
        return types.make(type_name(type(message)), header=header, **_values(message, types))
    except MessageError as error:
        raise MessageError(error.what, where=type(message).__name__) from error


def from_typed(message_type: type[S], ros_message: Any) -> S:
    """``ros_message`` as ``message_type``. Raises MessageError when it is of another type, or does not fit."""
    try:
        header = ros_message.header
        given = {
            "schema": message_type.__struct_config__.tag,
            "stamp": header.stamp.sec * SECOND + header.stamp.nanosec,
            "frame_id": header.frame_id,
            **_given(message_type, ros_message),
        }
        return msgspec.convert(given, message_type)
    except (AttributeError, TypeError, ValueError, msgspec.MsgspecError, RecursionError) as error:
        raise MessageError(f"not a valid {type_name(message_type)}: {error}") from error


def _values(struct: Any, types: TypeFactory) -> dict[str, Any]:
    return {field.name: _value(field, getattr(struct, field.name), types) for field in fields_of(type(struct))}


def _value(field: Field, value: Any, types: TypeFactory) -> Any:
    if field.missing_is_nan:
        return math.nan if value is None else float(value)
    if not field.count:
        return _one(field, value, types)
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
            return _text(value)
        case "json":
            return _text(_json(value))
        case "float64":
            return float(value)
        case "int64" if value not in INTEGERS:
            raise MessageError(f"{field.name} is {value}, which 64 bits cannot hold")
        case _:
            return value


def _text(text: str) -> str:
    try:
        text.encode()
    except UnicodeError as error:
        raise MessageError(f"{text!r} cannot be written as UTF-8: {error}") from error
    if "\0" in text:
        raise MessageError(
            f"{text!r} holds a zero, where a text of ROS ends", remedy="leave it out, or write wire: json"
        )
    return text


def _json(value: Any) -> str:
    try:
        return msgspec.json.encode(value).decode()
    except (UnicodeError, TypeError, OverflowError, RecursionError) as error:
        raise MessageError(f"cannot be written as JSON: {error}") from error


def _given(struct: type, ros_message: Any) -> dict[str, Any]:
    """The fields of ``struct`` that differ from their defaults: the others are the defaults themselves again."""
    fields = ((field, _read(field, getattr(ros_message, field.name))) for field in fields_of(struct))
    defaults = _defaults(struct)
    return {field.name: value for field, value in fields if defaults.get(field.name, MISSING) != value}


@functools.cache
def _defaults(struct: type) -> dict[str, Any]:
    return {field.name: field.default for field in msgspec.structs.fields(struct) if field.default is not MISSING}


def _read(field: Field, value: Any) -> Any:
    if field.missing_is_nan:
        return None if math.isnan(value) else float(value)
    if not field.count:
        return _read_one(field, value)
    # Arrays of numbers come as array.array from rclpy, and of numpy from rosbags.
    items = tuple(_read_one(field, item) for item in (value if isinstance(value, list) else value.tolist()))
    if field.count == "[<=1]":
        return items[0] if items else None
    return items


def _read_one(field: Field, value: Any) -> Any:
    if isinstance(field.kind, type):
        return msgspec.convert(_given(field.kind, value), field.kind)
    return msgspec.json.decode(value) if field.kind == JSON else value
