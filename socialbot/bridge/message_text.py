"""ROS messages as text: YAML for the eye, with long arrays cut."""

from __future__ import annotations

import array
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

LONGEST = 64
"""Arrays and lists with more items than this are cut."""

_PLAIN = re.compile(r"[A-Za-z_/][\w/.+-]*(?: [\w/.+-]+)*", re.ASCII)
_WORDS_OF_YAML = frozenset({"true", "false", "null", "yes", "no", "on", "off"})


def message_text(message: Any, *, raw: bool = False) -> str:
    """``message``, an rclpy message, as YAML: field by field, indented.

    JSON in a String is shown as what it says, and of long arrays only the size is told, unless ``raw``.
    """
    return "\n".join(_lines(_plain(message, raw=raw)))


class _Cut(str):
    """A word about something too long to show."""

    __slots__ = ()


def _plain(value: Any, *, raw: bool) -> Any:
    """``value`` as mappings, lists and scalars."""
    if hasattr(value, "get_fields_and_field_types"):
        decoded = None if raw else _decoded(value)
        if decoded is not None:
            return {"data": decoded}
        return {name: _plain(getattr(value, name), raw=raw) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes) and len(value) == 1:
        return value[0]
    if isinstance(value, str) or (not isinstance(value, Sequence) and not hasattr(value, "dtype")):
        return value
    if len(value) > LONGEST and not raw:
        return _Cut(f"<{len(value)} {_kind(value)}>")
    items: Iterable[Any] = value.tolist() if isinstance(value, np.ndarray) else value
    return [_plain(item, raw=raw) for item in items]


def _decoded(message: Any) -> Any:
    """The content of a String that holds a JSON object, or None."""
    text = getattr(message, "data", None)
    if not isinstance(text, str) or not text.startswith("{"):
        return None
    try:
        return msgspec.json.decode(text)
    except (msgspec.MsgspecError, UnicodeError, RecursionError):
        return None


def _kind(values: Any) -> str:
    if isinstance(values, (bytes, bytearray)) or (isinstance(values, array.array) and values.itemsize == 1):
        return "bytes"
    if isinstance(values, (array.array, np.ndarray)):
        return "numbers"
    return "items"


def _lines(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping) and value:
        for name, item in value.items():
            yield from _entry(f"{_scalar(name)}:", item)
    elif isinstance(value, list) and not _short(value):
        for item in value:
            first, *rest = _lines(item)
            yield f"- {first}"
            yield from (f"  {line}" for line in rest)
    else:
        yield _inline(value)


def _entry(name: str, value: Any) -> Iterator[str]:
    if (isinstance(value, Mapping) and value) or (isinstance(value, list) and not _short(value)):
        yield name
        yield from (f"  {line}" for line in _lines(value))
    else:
        yield f"{name} {_inline(value)}"


def _short(values: list[Any]) -> bool:
    """Whether ``values`` fit in one line: numbers do, and so do a few words."""
    if any(isinstance(value, (list, Mapping)) for value in values):
        return False
    return (
        all(not isinstance(value, str) for value in values) or sum(len(_scalar(value)) for value in values) <= LONGEST
    )


def _inline(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_scalar, value))}]"
    return "{}" if isinstance(value, Mapping) else _scalar(value)


def _scalar(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else f"{'-' if value < 0 else ''}.inf"
    if isinstance(value, _Cut) or not isinstance(value, str):
        return str(value)
    if _PLAIN.fullmatch(value) and value.lower() not in _WORDS_OF_YAML:
        return value
    if value.isprintable() and '"' in value:
        return "'" + value.replace("'", "''") + "'"
    # What is not printable could do anything to a terminal.
    return json.dumps(value, ensure_ascii=not value.isprintable())
