"""Writes ONNX files with the standard library and numpy: the few protobuf messages that a small network needs.

Nothing here depends on the versions of other packages, so that the same network gives the same bytes anywhere.
Field numbers are those of onnx.proto.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

__all__ = ["Node", "Port", "model"]

Value: TypeAlias = "int | float | str | Sequence[int]"
"""An attribute: whole numbers are ints, names are text."""

_TYPES: Mapping[str, int] = {"float32": 1, "uint8": 2, "int32": 6, "int64": 7, "float16": 10}
_FLOAT, _INT, _STRING, _INTS = 1, 2, 3, 7
"""What onnx.proto calls the types of attributes."""
_IR_VERSION = 8


@dataclass(frozen=True)
class Node:
    """One operation: ``op`` of ``inputs`` gives ``outputs``."""

    op: str
    inputs: Sequence[str]
    outputs: Sequence[str]
    attributes: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Port:
    """An input or output of the network: its type as numpy names it, its shape with names for what may vary."""

    name: str
    shape: Sequence[int | str]
    dtype: str = "float32"


def model(
    nodes: Sequence[Node],
    inputs: Sequence[Port],
    outputs: Sequence[Port],
    constants: Mapping[str, np.ndarray],
    *,
    name: str,
    opset: int = 13,
    text: str = "",
) -> bytes:
    """The ONNX file of a network; ``nodes`` in an order in which they can run, ``constants`` by name."""
    graph = b"".join(_part(1, _node(node, f"{node.op}_{index}")) for index, node in enumerate(nodes))
    graph += _text(2, name)
    graph += b"".join(_part(5, _tensor(key, value)) for key, value in constants.items())
    graph += b"".join(_part(11, _port(port)) for port in inputs)
    graph += b"".join(_part(12, _port(port)) for port in outputs)
    file = _number(1, _IR_VERSION) + _text(2, "socialbot")
    file += _text(6, text) if text else b""
    return file + _part(7, graph) + _part(8, _text(1, "") + _number(2, opset))


def _node(node: Node, name: str) -> bytes:
    data = b"".join(_text(1, item) for item in node.inputs) + b"".join(_text(2, item) for item in node.outputs)
    data += _text(3, name) + _text(4, node.op)
    return data + b"".join(_part(5, _attribute(key, value)) for key, value in node.attributes.items())


def _attribute(name: str, value: Value) -> bytes:
    data = _text(1, name)
    if isinstance(value, float):
        return data + _tag(2, 5) + struct.pack("<f", value) + _number(20, _FLOAT)
    if isinstance(value, int):
        return data + _number(3, value) + _number(20, _INT)
    if isinstance(value, str):
        return data + _text(4, value) + _number(20, _STRING)
    return data + b"".join(_number(8, item) for item in value) + _number(20, _INTS)


def _tensor(name: str, value: np.ndarray) -> bytes:
    data = b"".join(_number(1, size) for size in value.shape) + _number(2, _TYPES[value.dtype.name])
    little = value.astype(value.dtype.newbyteorder("<"), copy=False)
    return data + _text(8, name) + _part(9, np.ascontiguousarray(little).tobytes())


def _port(port: Port) -> bytes:
    sizes = (_number(1, size) if isinstance(size, int) else _text(2, size) for size in port.shape)
    shape = b"".join(_part(1, size) for size in sizes)
    return _text(1, port.name) + _part(2, _part(1, _number(1, _TYPES[port.dtype]) + _part(2, shape)))


def _varint(number: int) -> bytes:
    number &= 0xFFFF_FFFF_FFFF_FFFF  # Negative numbers are written as 64 bits in two's complement.
    data = bytearray()
    while number > 0x7F:
        data.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*data, number])


def _tag(number: int, wire: int) -> bytes:
    return _varint(number << 3 | wire)


def _number(number: int, value: int) -> bytes:
    return _tag(number, 0) + _varint(value)


def _part(number: int, value: bytes) -> bytes:
    return _tag(number, 2) + _varint(len(value)) + value


def _text(number: int, value: str) -> bytes:
    return _part(number, value.encode())
