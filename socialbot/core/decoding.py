"""Decoding of JSON, MessagePack and plain values to types, safe in threads.

msgspec describes a struct or dataclass when something is decoded to it for the first time. The class holds this
description before it is complete. A thread that decodes to the same class meanwhile reads a null pointer, and the
process ends by SIGSEGV (msgspec 0.22). So here each type is described under a lock before its first use.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec

T = TypeVar("T")
JsonDecoder = msgspec.json.Decoder

_LOCK = threading.RLock()


def json_decoder(kind: type[T] | Any) -> JsonDecoder[T]:
    """Return the decoder of JSON to ``kind``."""
    return _json_decoder(kind)


@functools.cache
def _json_decoder(kind: Any) -> JsonDecoder[Any]:
    with _LOCK:
        return JsonDecoder(kind)


def msgpack_decoder(
    kind: type[T] | Any, dec_hook: Callable[[type, Any], Any] | None = None
) -> msgspec.msgpack.Decoder[T]:
    """Return the decoder of MessagePack to ``kind``; ``dec_hook`` decodes types that msgspec does not know."""
    return _msgpack_decoder(kind, dec_hook)


@functools.cache
def _msgpack_decoder(kind: Any, dec_hook: Callable[[type, Any], Any] | None) -> msgspec.msgpack.Decoder[Any]:
    with _LOCK:
        return msgspec.msgpack.Decoder(kind, dec_hook=dec_hook)


def from_json(data: bytes | bytearray | str, kind: type[T] | Any) -> T:
    """Decode JSON to ``kind``.

    Raises:
        msgspec.DecodeError: It is no JSON, or has another type.
        UnicodeError: It is no UTF-8.
    """
    return json_decoder(kind).decode(data)


def from_builtins(value: Any, kind: type[T] | Any, *, strict: bool = True) -> T:
    """Convert dictionaries, lists and plain values to ``kind``; without ``strict``, also texts to numbers.

    Raises:
        msgspec.ValidationError: ``value`` has another type.
    """
    json_decoder(kind)
    return msgspec.convert(value, kind, strict=strict)
