"""Structured messages as ROS types of their own: which fields the type of each has, and its definition.

Everything follows from the struct by rule, so that there is nothing to keep twice:

- ``stamp``, and ``frame_id`` where there is one, are the header;
- texts, truth values, whole numbers and numbers are string, bool, int64 and float64; structs are types of their own;
- a tuple of these is an array;
- a number that may be missing is NaN then; anything else that may be is an array of at most one;
- what has no one type (dictionaries, unions) is a string that holds JSON.
"""

from __future__ import annotations

import functools
import inspect
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from msgspec import inspect as structs

from socialbot.messages import Structured
from socialbot.schemas import STRUCTURED

PACKAGE = "socialbot_msgs"
HEADER = ("stamp", "frame_id")
JSON = "json"
"""The kind of a field that holds JSON in a string."""

_SCALARS: Mapping[type[structs.Type], str] = {
    structs.StrType: "string",
    structs.BoolType: "bool",
    structs.IntType: "int64",
    structs.FloatType: "float64",
}
_LINE = 100


@dataclass(frozen=True)
class Field:
    """A field of a ROS type: the ``kind`` of its value or values (a scalar of ROS, `JSON` or a struct), and how many.

    ``count`` is the suffix of the type in a definition: nothing for one, ``[]`` for many, ``[N]`` for just so many,
    ``[<=1]`` for one that may be missing. ``choices`` are the only values that there are, if these are few.
    """

    name: str
    kind: str | type
    count: str = ""
    choices: tuple[str, ...] = ()
    missing_is_nan: bool = False

    @property
    def definition(self) -> str:
        """Its line in a definition."""
        kind = "string" if self.kind == JSON else self.kind if isinstance(self.kind, str) else self.kind.__name__
        return f"{kind}{self.count} {self.name}{self._note}"

    @property
    def constants(self) -> tuple[str, ...]:
        """The lines for its choices."""
        return tuple(
            f'string {self.name.upper()}_{choice.upper().replace(" ", "_")}="{choice}"' for choice in self.choices
        )

    @property
    def _note(self) -> str:
        if self.kind == JSON:
            return "  # JSON"
        return "  # NaN: none" if self.missing_is_nan else ""


def type_name(struct: type) -> str:
    """The ROS type of a message or a part of one, such as ``socialbot_msgs/msg/Utterance``."""
    return f"{PACKAGE}/msg/{struct.__name__}"


TYPED: Mapping[str, type[Structured]] = MappingProxyType({type_name(kind): kind for kind in STRUCTURED})
"""The messages that have a ROS type of their own, by its name."""


@functools.cache
def fields_of(struct: type) -> tuple[Field, ...]:
    """The fields of the ROS type of ``struct``, without the header that a message has besides."""
    info = structs.type_info(struct)
    assert isinstance(info, structs.StructType)
    hidden = HEADER if issubclass(struct, Structured) else ()
    return tuple(_field(field.name, field.type) for field in info.fields if field.name not in hidden)


def parts_of(struct: type) -> Iterator[type]:
    """The structs that the fields of ``struct`` hold, and those that theirs hold."""
    for field in fields_of(struct):
        if isinstance(field.kind, type):
            yield field.kind
            yield from parts_of(field.kind)


@functools.cache
def definitions() -> Mapping[str, str]:
    """The definition (the text of its .msg file) of each ROS type, by its name."""
    every = {part: None for kind in STRUCTURED for part in (kind, *parts_of(kind))}
    texts = {type_name(struct): _definition(struct) for struct in every}
    assert len(texts) == len(every), "two structs of one name"
    return MappingProxyType(dict(sorted(texts.items())))


def _definition(struct: type) -> str:
    fields = fields_of(struct)
    lines = [f"# {line}".rstrip() for line in _doc(struct)]
    lines += [constant for field in fields for constant in field.constants]
    if issubclass(struct, Structured):
        lines.append("std_msgs/Header header")
    return "\n".join([*lines, *(field.definition for field in fields)]) + "\n"


def _doc(struct: type) -> list[str]:
    paragraphs = (inspect.getdoc(struct) or "").replace("``", "").replace("`", "").split("\n\n")
    return [line for paragraph in paragraphs for line in textwrap.wrap(paragraph, _LINE)]


def _field(name: str, kind: structs.Type) -> Field:
    kind = _plain(kind)
    match kind:
        case structs.UnionType(types=types) if kind.includes_none and len(types) == 2:
            one = _one(next(each for each in types if not isinstance(each, structs.NoneType)))
            return Field(name, one, missing_is_nan=True) if one == "float64" else Field(name, one, "[<=1]")
        case structs.VarTupleType(item_type=item):
            return Field(name, _one(item), "[]")
        case structs.TupleType(item_types=items) if len({_one(item) for item in items}) == 1:
            return Field(name, _one(items[0]), f"[{len(items)}]")
        case structs.LiteralType(values=values) if all(isinstance(value, str) for value in values):
            return Field(name, "string", choices=tuple(str(value) for value in values))
        case _:
            return Field(name, _one(kind))


def _one(kind: structs.Type) -> str | type:
    kind = _plain(kind)
    if isinstance(kind, structs.StructType):
        return kind.cls
    if isinstance(kind, structs.LiteralType):
        return "string" if isinstance(kind.values[0], str) else "int64"
    return _SCALARS.get(type(kind), JSON)


def _plain(kind: structs.Type) -> structs.Type:
    while isinstance(kind, structs.Metadata):
        kind = kind.type
    return kind
