"""ROS messages as rosbags knows them: made by the name of their type, written as CDR bytes and read back."""

from __future__ import annotations

import functools
import re
from typing import Any

from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from socialbot.bridge import interfaces, standard_types
from socialbot.errors import MessageError

_HEADER = "std_msgs/msg/Header"


@functools.cache
def known_types(release: Stores = Stores.ROS2_JAZZY) -> Typestore:
    """The types of a ROS release. It is shared, so nothing may be registered in it."""
    return get_typestore(release)


@functools.cache
def _with_own_types() -> Typestore:
    """The types of ROS 2 Jazzy, and those of `interfaces` and `standard_types`."""
    types = get_typestore(Stores.ROS2_JAZZY)
    for name, text in {**standard_types.DEFINITIONS, **interfaces.definitions()}.items():
        # Comments make the parser fifty times slower.
        types.register(get_types_from_msg("\n".join(line.partition("#")[0] for line in text.splitlines()), name))
    return types


def types_with(type_name: str) -> Typestore:
    """The types of ROS 2 Jazzy, with more where ``type_name`` is none of these packages. They are shared."""
    package = type_name.partition("/")[0]
    return _with_own_types() if package in (interfaces.PACKAGE, *standard_types.PACKAGES) else known_types()


class RosbagsTypes:
    """A `codec.TypeFactory` that makes messages for rosbags, with the types of ROS 2 Jazzy and socialbot's own."""

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """A message of ``type_name``. Raises MessageError when there is no such type."""
        types = types_with(type_name).types
        if type_name not in types:
            raise MessageError(f"ROS 2 Jazzy has no type {type_name}")
        return types[type_name](**fields)

    def serialize(self, ros_message: Any) -> bytes:
        """``ros_message`` as CDR bytes. Raises MessageError when a field does not fit its type."""
        name = ros_message.__msgtype__
        try:
            return bytes(types_with(name).serialize_cdr(ros_message, name))
        except Exception as error:
            raise MessageError(f"cannot be written as {name}: {error}") from error

    def deserialize(self, data: bytes, type_name: str) -> Any:
        """The message of ``type_name`` in CDR bytes. Raises MessageError when there is none in them."""
        try:
            return _read_cdr(types_with(type_name), data, type_name)
        except Exception as error:
            raise MessageError(f"{len(data)} bytes are no {type_name}: {error}") from error


def deserialize(connection: Connection, data: bytes) -> Any:
    """The message in ``data`` as read from ``connection`` of a bag. Damaged bytes raise whatever rosbags does."""
    ros1 = isinstance(connection.owner, Ros1Reader)
    types = _types(connection.msgtype, connection.msgdef, ros1)
    return types.deserialize_ros1(data, connection.msgtype) if ros1 else _read_cdr(types, data, connection.msgtype)


def is_known(connection: Connection) -> bool:
    """Whether the fields of the messages of ``connection`` are known, from the bag or as a type of ROS."""
    ros1 = isinstance(connection.owner, Ros1Reader)
    return connection.msgtype in _types(connection.msgtype, connection.msgdef, ros1).fielddefs


def to_cdr(connection: Connection, data: bytes) -> bytes:
    """``data`` as read from ``connection`` of a bag, as CDR bytes.

    Raises as `deserialize` does, and ValueError for a ROS 1 type that ROS 2 has changed.
    """
    if isinstance(connection.owner, Ros1Reader):
        return bytes(_ros2_types(connection.msgtype, connection.msgdef).ros1_to_cdr(data, connection.msgtype))
    _check_cdr(data)
    return bytes(data)


def _read_cdr(types: Typestore, data: bytes, name: str) -> Any:
    # As ROS does, but unlike Typestore.deserialize_cdr, this takes bytes behind the message:
    # rmw_serialize leaves some where a message ends in empty sequences.
    _check_cdr(data)
    definition = types.get_msgdef(name)
    read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
    return read(data[4:], 0, definition.cls, types)[0]


def _check_cdr(data: bytes) -> None:
    if len(data) < 5 or data[0] or data[1] > 1:
        raise ValueError(f"{len(data)} bytes are no CDR message")


@functools.lru_cache(maxsize=512)
def _types(name: str, definition: MessageDefinition, ros1: bool) -> Typestore:
    # Each connection is read with its own definition: types have changed between releases of ROS.
    known = known_types(Stores.ROS1_NOETIC) if ros1 else types_with(name)
    if definition.format is MessageDefinitionFormat.NONE or not definition.data:
        return known
    types = get_typestore(Stores.EMPTY)
    try:
        if definition.format is MessageDefinitionFormat.MSG:
            types.register(get_types_from_msg(definition.data, name))
        else:
            for part in filter(None, definition.data.split("=" * 80 + "\n")):
                types.register(get_types_from_idl(re.sub(r"\AIDL: .*\n", "", part)))
    except TypesysError:
        return known
    return types


@functools.lru_cache(maxsize=512)
def _ros2_types(name: str, definition: MessageDefinition) -> Typestore:
    """The types of a ROS 1 connection as ROS 2 has them: the same, but for the sequence number in the header."""
    ros1, ros2 = _types(name, definition, ros1=True).fielddefs, known_types().fielddefs
    for each in ros1.keys() & ros2.keys() - {_HEADER}:
        if _layout(ros1[each]) != _layout(ros2[each]):
            raise ValueError(f"{each} of ROS 1 has other fields than that of ROS 2")
    types = get_typestore(Stores.EMPTY)
    types.register({**ros1, _HEADER: ros2[_HEADER]})
    return types


def _layout(fields: tuple[Any, Any]) -> list[tuple[str, Any]]:
    return [(name.lower(), kind) for name, kind in fields[1]]
