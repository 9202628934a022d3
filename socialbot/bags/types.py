"""ROS message types by name: fields, definitions and CDR encoding, without ROS."""

from __future__ import annotations

import functools
import importlib
import inspect
import logging
import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from msgspec import inspect as structs
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag1,
    MessageDefinition,
    MessageDefinitionFormat,
    Nodetype,
)
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore, idl
from rosbags.typesys.store import Typestore

from socialbot.core.errors import MessageError
from socialbot.core.messages import Structured
from socialbot.core.references import installed_places
from socialbot.core.registry import message_types

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Fielddefs, FieldDesc, Typesdict

PACKAGE = "socialbot_msgs"
HEADER = ("stamp", "frame_id")
JSON = "json"
"""Kind of a field with JSON in a string."""
BYTE = "uint8"
"""Kind of the items of a field of bytes."""

_SCALARS: Mapping[type[structs.Type], str] = {
    structs.StrType: "string",
    structs.BoolType: "bool",
    structs.IntType: "int64",
    structs.FloatType: "float64",
}
_GENERATED = {JSON: "string", "bool": "boolean", "float64": "double"}
_LINE = 100

MAX_DEFINITION = 1 << 19
"""Most characters of a definition in a bag: those of large types have 100,000, with all their parts and comments."""
MAX_PARTS, MAX_DEPTH = 100_000, 100
"""Most parts of a type, beside those of sequences, and most types in each other: rosbags writes Python for each."""

log = logging.getLogger("socialbot.bags")


@dataclass(frozen=True)
class Field:
    """Field of a ROS type; ``kind`` is a scalar type of ROS, `JSON`, or a struct.

    ``count`` is the suffix of the type: empty, ``[]`` for an array, ``[N]`` for a fixed one, ``[<=1]`` if optional.
    ``attribute`` is the name of the field in Python, ``name`` that in messages.
    """

    name: str
    kind: str | type
    count: str = ""
    choices: tuple[str, ...] = ()
    missing_is_nan: bool = False
    attribute: str = ""

    @property
    def definition(self) -> str:
        """Line of the field in a definition."""
        kind = "string" if self.kind == JSON else self.kind if isinstance(self.kind, str) else ros_name(self.kind)
        note = "  # JSON" if self.kind == JSON else "  # NaN: none" if self.missing_is_nan else ""
        return f"{kind}{self.count} {self.name}{note}"

    @property
    def generated(self) -> str:
        """Type of the field as the generated Python classes describe it."""
        if isinstance(self.kind, str):
            kind = _GENERATED.get(self.kind, self.kind)
        else:
            kind = f"{PACKAGE}/{ros_name(self.kind)}"
        if self.count.startswith("[<="):
            return f"sequence<{kind}, {self.count[3:-1]}>"
        return f"sequence<{kind}>" if self.count == "[]" else f"{kind}{self.count}"


def ros_name(struct: type) -> str:
    """Name of a struct as a ROS type: its attribute ``ros_name`` if it has one, else its class name."""
    return getattr(struct, "ros_name", struct.__name__)


def type_name(struct: type) -> str:
    """ROS type of a message or of a part, such as ``socialbot_msgs/msg/Utterance``."""
    return f"{PACKAGE}/msg/{ros_name(struct)}"


@functools.cache
def typed_messages() -> Mapping[str, type[Structured]]:
    """Messages with a ROS type in socialbot_msgs, by type name."""
    return MappingProxyType({type_name(kind): kind for kind in message_types(built_in=True)})


@functools.cache
def fields_of(struct: type) -> tuple[Field, ...]:
    """Fields of the ROS type of ``struct``, without the header."""
    info = structs.type_info(struct)
    assert isinstance(info, structs.StructType)
    hidden = HEADER if issubclass(struct, Structured) else ()
    return tuple(
        replace(_field(field.encode_name, field.type), attribute=field.name)
        for field in info.fields
        if field.name not in hidden
    )


def _with_parts(struct: type) -> Iterator[type]:
    """A struct and the structs in its fields, recursively."""
    yield struct
    for field in fields_of(struct):
        if isinstance(field.kind, type):
            yield from _with_parts(field.kind)


@functools.cache
def own_types() -> Mapping[str, type]:
    """Structs of all types in socialbot_msgs, by type name: messages and their parts."""
    every = {part: None for kind in message_types(built_in=True) for part in _with_parts(kind)}
    structs_by_name = {type_name(struct): struct for struct in every}
    assert len(structs_by_name) == len(every), "two structs of one name"
    return MappingProxyType(dict(sorted(structs_by_name.items())))


@functools.cache
def definitions() -> Mapping[str, str]:
    """Definitions (texts of .msg files) by ROS type."""
    return MappingProxyType({name: _definition(struct) for name, struct in own_types().items()})


def field_types(struct: type) -> dict[str, str]:
    """Fields of the ROS type of ``struct`` as the generated Python classes describe them."""
    header = {"header": "std_msgs/Header"} if issubclass(struct, Structured) else {}
    return header | {field.name: field.generated for field in fields_of(struct)}


def _definition(struct: type) -> str:
    fields = fields_of(struct)
    paragraphs = (inspect.getdoc(struct) or "").replace("``", "").replace("`", "").split("\n\n")
    lines = [f"# {line}".rstrip() for paragraph in paragraphs for line in textwrap.wrap(paragraph, _LINE)]
    lines += [
        f'string {field.name.upper()}_{choice.upper().replace(" ", "_")}="{choice}"'
        for field in fields
        for choice in field.choices
    ]
    if issubclass(struct, Structured):
        lines.append("std_msgs/Header header")
    return "\n".join([*lines, *(field.definition for field in fields)]) + "\n"


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
        case structs.BytesType():
            return Field(name, BYTE, "[]")
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


PACKAGES = ("foxglove_msgs", "hri_msgs", "tf2_msgs", "vision_msgs")

_BLOCKS = Path(__file__).with_name("ros_types.txt").read_text("utf-8").split("MSG: ")[1:]
DEFINITIONS: Mapping[str, str] = MappingProxyType(
    {name: fields.strip() + "\n" for name, _, fields in (block.partition("\n") for block in _BLOCKS)}
)
"""Definitions (texts of .msg files) of other packages by type name."""


_HEADER = "std_msgs/msg/Header"
_WIDE = frozenset({"wchar", "wstring"})


@functools.cache
def known_types(release: Stores = Stores.ROS2_JAZZY) -> Typestore:
    """Types of a ROS release. The result is shared: do not register types in it."""
    return get_typestore(release)


@functools.cache
def _with_own_types() -> Typestore:
    """Types of ROS 2 Jazzy, `interfaces` and `standard_types`."""
    types = get_typestore(Stores.ROS2_JAZZY)
    for name, text in {**DEFINITIONS, **definitions()}.items():
        # Comments make the parser 50 times slower.
        types.register(get_types_from_msg("\n".join(line.partition("#")[0] for line in text.splitlines()), name))
    return types


def types_with(type_name: str) -> Typestore:
    """The types of ROS 2 Jazzy, with those of the package of ``type_name``. The result is shared."""
    package = type_name.partition("/")[0]
    return _with_own_types() if package in (PACKAGE, *PACKAGES) else known_types()


class RosbagsTypes:
    """`codec.TypeFactory` for rosbags messages, with the types of ROS 2 Jazzy and socialbot."""

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """Make a message of ``type_name``. Raises MessageError for an unknown type."""
        types = types_with(type_name).types
        if type_name not in types:
            raise MessageError(f"ROS 2 Jazzy has no type {type_name}")
        return types[type_name](**fields)

    def owns(self, ros_message: Any) -> bool:
        return hasattr(type(ros_message), "__msgtype__")

    def serialize(self, ros_message: Any) -> bytes:
        """Serialize ``ros_message`` to CDR. Raises MessageError when a field does not fit its type."""
        name = ros_message.__msgtype__
        try:
            return bytes(types_with(name).serialize_cdr(ros_message, name))
        except Exception as error:
            raise MessageError(f"cannot be written as {name}: {error}") from error

    def deserialize(self, data: bytes, type_name: str) -> Any:
        """Deserialize a CDR message of ``type_name``. Raises MessageError for damaged bytes."""
        try:
            return _read_cdr(types_with(type_name), data, type_name)
        except Exception as error:
            raise MessageError(f"{len(data)} bytes are no {type_name}: {error}") from error


def deserialize(connection: Connection, data: bytes) -> Any:
    """Decode ``data`` of ``connection``. Damaged bytes raise any exception."""
    types = _types(connection.msgtype, connection.msgdef, is_ros1(connection))
    read = _read_ros1 if is_ros1(connection) else _read_cdr
    return read(types, data, connection.msgtype)


@dataclass(frozen=True)
class TypeProblem:
    """Reason why messages of a type cannot be read, as a predicate of the type, and the remedy."""

    what: str
    remedy: str


def type_problem(connection: Connection) -> TypeProblem | None:
    """Return why messages of ``connection`` cannot be read; None if the bag or ROS defines its type and all parts."""
    return _type_problem(connection.msgtype, connection.msgdef, is_ros1(connection))


@functools.lru_cache(maxsize=512)
def _type_problem(name: str, definition: MessageDefinition, ros1: bool) -> TypeProblem | None:
    missing = _undefined(name, _types(name, definition, ros1).fielddefs)
    if missing is None:
        return None
    if (wide := missing.rpartition("/")[2]) in _WIDE:
        return TypeProblem(f"has a {wide}, which socialbot does not read", "leave out the topic, or use a string")
    what = "is unknown" if missing == name else f"needs {missing}, which is unknown"
    return TypeProblem(what, "record the bag with the definitions of its types (mcap does), or install them")


def _undefined(name: str, types: Typesdict) -> str | None:
    """Return the first type without fields among ``name`` and its parts, recursively."""
    seen, pending = {name}, [name]
    while pending:
        each = pending.pop(0)
        if each not in types:
            return each
        new = dict.fromkeys(part for part in _parts(types[each][1]) if part not in seen)
        seen.update(new)
        pending += new
    return None


def _check_size(name: str, types: Typesdict) -> None:
    """Raise TypesysError if a type has too many parts beside its sequences, whose parts take bytes of a message."""
    counts: dict[str, int] = {}

    def count(each: str, depth: int = 0) -> int:
        if depth > MAX_DEPTH:
            raise TypesysError(f"{name} has itself as a part, or more than {MAX_DEPTH} types in each other")
        if each not in counts:
            counts[each] = sum(of_field(field, depth) for _, field in types[each][1]) if each in types else 1
            if counts[each] > MAX_PARTS:
                raise TypesysError(f"{each} has more than {MAX_PARTS} parts")
        return counts[each]

    def of_field(field: FieldDesc, depth: int) -> int:
        if field[0] is Nodetype.NAME:
            return count(field[1], depth + 1)
        if field[0] is Nodetype.BASE:
            return 1
        item, length = field[1]
        if field[0] is Nodetype.ARRAY and length < 1:
            raise TypesysError(f"{name} has an array of {length} items")
        is_number = item[0] is Nodetype.BASE and item[1][0] != "string"
        return (length if field[0] is Nodetype.ARRAY and not is_number else 1) * of_field(item, depth)

    count(name)


def _parts(fields: Fielddefs) -> Iterator[str]:
    """Types of fields that need a definition: messages, and basic types that rosbags cannot decode."""
    for _, field in fields:
        item = field[1][0] if field[0] == Nodetype.ARRAY or field[0] == Nodetype.SEQUENCE else field
        if item[0] is Nodetype.NAME:
            yield item[1]
        elif item[1][0] in _WIDE:
            yield item[1][0]


def is_ros1(connection: Connection) -> bool:
    """Whether the messages of ``connection`` have the encoding of ROS 1, in a .bag or an .mcap file."""
    return isinstance(connection.ext, ConnectionExtRosbag1) or connection.ext.serialization_format == "ros1"


def to_cdr(connection: Connection, data: bytes) -> bytes:
    """Convert ``data`` of ``connection`` to CDR bytes.

    Raises as `deserialize` does, and ValueError for a ROS 1 type that ROS 2 has changed.
    """
    if is_ros1(connection):
        types = _ros2_types(connection.msgtype, connection.msgdef)
        used, _ = types.get_msgdef(connection.msgtype).getsize_ros1_to_cdr(data, 0, None, 0, types)
        return bytes(types.ros1_to_cdr(data[:used], connection.msgtype))
    _check_cdr(data)
    return bytes(data)


def _read_ros1(types: Typestore, data: bytes, name: str) -> Any:
    # Like ROS, but unlike Typestore.deserialize_ros1, this accepts trailing bytes: the recorder of librealsense adds
    # the units of depth behind an image.
    definition = types.get_msgdef(name)
    return definition.deserialize_ros1(memoryview(data), 0, definition.cls, types)[0]


def _read_cdr(types: Typestore, data: bytes, name: str) -> Any:
    # Like ROS, but unlike Typestore.deserialize_cdr, this accepts trailing bytes: rmw_serialize adds some after empty
    # sequences.
    _check_cdr(data)
    definition = types.get_msgdef(name)
    read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
    return read(memoryview(data)[4:], 0, definition.cls, types)[0]


def _check_cdr(data: bytes) -> None:
    if len(data) < 5 or data[0] or data[1] > 1:
        raise ValueError(f"{len(data)} bytes are no CDR message")


_NO_IDL = re.compile(r"\AIDL: .*\n|^[ \t]*#.*$", re.MULTILINE)
"""The headline of a part, and lines of the preprocessor, which rosbags does not read: parts are included anyway."""


@functools.lru_cache(maxsize=512)
def _types(name: str, definition: MessageDefinition, ros1: bool) -> Typestore:
    # Use the definition of each connection: types differ between releases of ROS.
    known = known_types(Stores.ROS1_NOETIC) if ros1 else types_with(name)
    if definition.format is MessageDefinitionFormat.NONE or not definition.data:
        return known if name in known.fielddefs or ros1 else _installed_types(name)
    types = get_typestore(Stores.EMPTY)
    try:
        if len(definition.data) > MAX_DEFINITION:
            raise TypesysError(f"the definition has more than {MAX_DEFINITION} characters")
        if definition.format is MessageDefinitionFormat.MSG:
            types.register(_parsed(_of_event(definition.data, name), name))
        else:
            for part in filter(None, definition.data.split("=" * 80 + "\n")):
                types.register(get_types_from_idl(_NO_IDL.sub("", part)))
        _check_size(name, {**known.fielddefs, **types.fielddefs})
    except Exception as error:  # noqa: BLE001 - rosbags makes Python of a definition, which may fail in any way
        found = known if name in known.fielddefs or ros1 else _installed_types(name)
        if name not in found.fielddefs:
            why = " ".join(str(error).split())
            log.warning("the definition of %s cannot be used: %s: %.200s", name, type(error).__name__, why)
        return found
    # Some writers leave out the definitions of types that ROS has.
    while (missing := _undefined(name, types.fielddefs)) in known.fielddefs and missing != name:
        types.register({missing: known.fielddefs[missing]})
    return types if name in types.fielddefs or ros1 else _installed_types(name)


_evaluated = idl.eval_expression


_CONSTANT_BITS = 64  # of the largest type of a constant


def _evaluated_small(expression: Any, *rest: Any) -> Any:
    """Evaluate a constant of an IDL file as rosbags does. Raises TypesysError before a number takes all memory."""
    if isinstance(expression, idl.BinaryExpression) and expression.op == "<<":
        bits = getattr(expression.right, "value", None)  # evaluated here, nested shifts would be so twice each
        if not isinstance(bits, int) or bits > _CONSTANT_BITS:
            raise TypesysError(f"a constant is shifted by more than {_CONSTANT_BITS} bits, or by a calculated number")
    found = _evaluated(expression, *rest)
    if isinstance(found.value, int) and found.value.bit_length() > _CONSTANT_BITS:
        raise TypesysError(f"a constant has more than {_CONSTANT_BITS} bits")
    return found


idl.eval_expression = _evaluated_small


_SERVICE = re.compile(
    r"\A(?:=+\nSRV: [^\n]*\n)?(?P<request>.*?)^---[ \t]*\n(?P<response>.*?)(?P<parts>^=+\n.*)?\Z", re.M | re.S
)


def _of_event(text: str, name: str) -> str:
    """Definition of the type ``name``: for the event of a service, rosbag2 stores that of the service instead."""
    found = _SERVICE.match(text) if name.endswith("_Event") else None
    if found is None:
        return text
    package, service = name.split("/")[0], name.rpartition("/")[2].removesuffix("_Event")
    parts, texts = {"Request": found["request"], "Response": found["response"]}, ["service_msgs/ServiceEventInfo info"]
    texts += [f"{package}/{service}_{part}[<=1] {part.lower()}" for part in parts]
    for part, fields in parts.items():
        has_fields = re.search(r"^\s*[^#\s]", fields, re.MULTILINE)
        texts += ["=" * 80, f"MSG: {package}/{service}_{part}", fields if has_fields else _NO_FIELDS]
    return "\n".join([*texts, found["parts"] or ""])


def _parsed(text: str, name: str) -> Typesdict:
    package, _, rest = name.partition("/")
    folder, _, short = rest.partition("/")
    types = get_types_from_msg(text, name)
    # The parser puts the parts of services into a folder of their own.
    return {name if each == f"{package}/{folder}/msg/{short}" else each: fields for each, fields in types.items()}


@functools.cache
def _installed_types(name: str) -> Typestore:
    types = get_typestore(Stores.EMPTY)
    if text := installed_definition(name):
        types.register(_parsed(text, name))
    return types


_TYPE_NAME = re.compile(r"[A-Za-z]\w*/(msg|srv|action)/[A-Za-z]\w*", re.ASCII)
_NO_FIELDS = "uint8 structure_needs_at_least_one_member"
_ROS_NAMES = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}


@functools.cache
def installed_definition(type_name: str) -> str:
    """Definition of a message, and of its parts, from the Python package of its type; empty if it is not installed.

    Unlike .msg files, this includes the parts of services and actions, such as ``std_srvs/srv/SetBool_Event``.
    """
    if not _TYPE_NAME.fullmatch(type_name):
        return ""
    package, folder, name = type_name.split("/")
    pending = [(f"{package}/{name}", _installed_class(package, name, folder))]
    texts: dict[str, str] = {}
    while pending:
        short, found = pending.pop(0)
        if found is None:
            return ""
        lines = []
        for field, kind in found.get_fields_and_field_types().items():
            match = re.fullmatch(r"(?:sequence<)?([\w/]+(?:<\d+>)?)(?:, (\d+))?>?(\[\d+\])?", kind)
            assert match is not None, kind
            item, bound, length = match[1].replace("<", "<="), match[2], match[3] or ""
            item = item.replace(">", "") if "<=" in item else item
            suffix = length if not kind.startswith("sequence<") else f"[<={bound}]" if bound else "[]"
            lines.append(f"{_ROS_NAMES.get(item, item)}{suffix} {field}")
            if "/" in item and item not in texts and item not in [known for known, _ in pending]:
                pending.append((item, _installed_class(*item.split("/"))))
        texts[short] = "\n".join(lines or [_NO_FIELDS])
    first, *others = texts.items()
    return "\n".join([first[1], *(f"{'=' * 80}\nMSG: {short}\n{text}" for short, text in others)]) + "\n"


def _installed_class(package: str, name: str, *folders: str) -> Any:
    """Python class of a message, or of a part of a service or action; None if it is not installed."""
    for folder in folders or ("msg", "srv", "action"):
        module = _message_module(package, folder)
        if module is None:
            continue
        base, _, part = name.partition("_")
        owner = getattr(module, base, None)
        found = getattr(module, name, None) or getattr(owner, part, None) if part else owner
        found = found or getattr(getattr(owner, "Impl", None), part or "-", None)
        if hasattr(found, "get_fields_and_field_types"):
            return found
    return None


def _message_module(package: str, folder: str) -> Any:
    """Python module of the messages of a ROS package; None if it is not installed.

    A bag may name any package: only an installed one that has such a folder is imported.
    """
    try:
        if any((place / folder / "__init__.py").is_file() for place in installed_places(package)):
            return importlib.import_module(f"{package}.{folder}")
    except (ImportError, ValueError):
        pass
    return None


@functools.lru_cache(maxsize=512)
def _ros2_types(name: str, definition: MessageDefinition) -> Typestore:
    """ROS 2 types of a ROS 1 connection: headers have no sequence number."""
    ros1, ros2 = _types(name, definition, ros1=True).fielddefs, known_types().fielddefs
    for each in ros1.keys() & ros2.keys() - {_HEADER}:
        one, other = ([(name.lower(), kind) for name, kind in types[each][1]] for types in (ros1, ros2))
        if one != other:
            raise ValueError(f"{each} of ROS 1 has other fields than that of ROS 2")
    types = get_typestore(Stores.EMPTY)
    types.register({**ros1, _HEADER: ros2[_HEADER]})
    return types
