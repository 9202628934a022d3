"""Read YAML within limits, and convert it to declared types; errors name the line.

The fields of a file are those of a msgspec struct or a dataclass, with types, defaults and ranges::

    class Motor(msgspec.Struct):
        joint: str
        speed: Annotated[float, msgspec.Meta(ge=0.1, le=3.0)] = 1.0

    motor = read_page(text, where="motor.yaml").read(Motor)

The ``description`` of a `msgspec.Meta` says in errors what a value must be; after ``;`` it may have a remedy. A
``pattern`` must match the whole text. A required text must not be empty. A key without a value is an error, unless it
stands for a list or section without required parts.
"""

from __future__ import annotations

import functools
import itertools
import re
import sys
from collections.abc import Mapping
from typing import Any, NoReturn, TypeVar

import msgspec
from msgspec import inspect
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, ScalarNode
from ruamel.yaml.scanner import RoundTripScanner, Scanner, ScannerError

from socialbot.core.errors import GraphError, SocialbotError, suggestion
from socialbot.core.foreign_files import ForeignFile, foreign_page, foreign_text
from socialbot.core.limits import YAML_DEPTH, YAML_GROWTH, YAML_NUMBER

_BRACKET = re.compile(r"[][{}]")
_T = TypeVar("_T")
_NUMBER_TAGS = {"tag:yaml.org,2002:int", "tag:yaml.org,2002:float"}
_STRUCTS = (inspect.StructType, inspect.DataclassType)
_LISTS = (inspect.ListType, inspect.VarTupleType, inspect.TupleType, inspect.FrozenSetType)
_WORDS: Mapping[type[inspect.Type], str] = {
    inspect.StrType: "text", inspect.IntType: "whole number", inspect.FloatType: "number", inspect.VarTupleType: "list",
}  # fmt: skip


def load_yaml(loader: YAML, text: str) -> Any:
    """Parse ``text`` with ``loader``. Raises YAMLError, or MarkedYAMLError with a position if it is known."""
    loader.Scanner = _RoundTripScanner if loader.Scanner is RoundTripScanner else _Scanner
    loader.Composer = _Composer
    try:
        return loader.load(text)
    except YAMLError:
        raise
    except Exception as error:
        # ruamel.yaml raises many types: for long numbers, invalid dates, lists as keys.
        raise YAMLError(f"{type(error).__name__}: {error}") from error


@functools.lru_cache(32)  # sweeps and trials make the same nodes again and again, and a team has the same rules
def _page(text: str) -> Any:
    return load_yaml(YAML(typ="rt"), text)


def check_depth(text: str) -> None:
    """Check YAML for other parsers. Raises YAMLError for deeply nested brackets, including brackets in quotes."""
    depth = 0
    for bracket in _BRACKET.findall(text):
        depth += 1 if bracket in "[{" else -1
        if depth > YAML_DEPTH:
            raise YAMLError(f"nested more than {YAML_DEPTH} deep")


class _Shallow:
    """Depth limit for scanners, since their time is quadratic in the depth and Python limits recursion."""

    def fetch_more_tokens(self: Any) -> Any:
        if len(self.flow_context) + len(self.indents) > YAML_DEPTH:
            raise ScannerError(problem=f"nested more than {YAML_DEPTH} deep", problem_mark=self.reader.get_mark())
        return super().fetch_more_tokens()  # type: ignore[misc]


class _Scanner(_Shallow, Scanner):
    pass


class _RoundTripScanner(_Shallow, RoundTripScanner):
    pass


class _Composer(Composer):
    """Limits for aliases and numbers, before values are made of them."""

    def compose_scalar_node(self, anchor: Any) -> Any:
        node = super().compose_scalar_node(anchor)
        if node.tag in _NUMBER_TAGS and len(node.value) > YAML_NUMBER:
            problem = f"a number of more than {YAML_NUMBER} characters"
            raise ComposerError(problem=problem, problem_mark=node.start_mark)
        return node

    def compose_document(self) -> Any:
        node = super().compose_document()
        mark = self.parser.scanner.reader.get_mark()
        _expanded(node, 0, mark.index + YAML_GROWTH, {})
        return node


def _expanded(node: Any, level: int, limit: int, known: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """Size and height of a node with all aliases in full. Raises ComposerError beyond the limits."""
    size, height = known.get(id(node), (0, 0))
    if level + height > YAML_DEPTH:
        raise ComposerError(problem=f"nested more than {YAML_DEPTH} deep", problem_mark=node.start_mark)
    if size:
        return size, height
    size = 1
    if isinstance(node, ScalarNode):
        size += len(node.value)
    else:
        parts = itertools.chain(*node.value) if isinstance(node, MappingNode) else node.value
        for part in parts:
            part_size, part_height = _expanded(part, level + 1, limit, known)
            size, height = size + part_size, max(height, 1 + part_height)
            if size > limit:
                raise ComposerError(problem="aliases make it too large", problem_mark=node.start_mark)
    known[id(node)] = size, height
    return size, height


def read_page(text: str, *, where: str, error: type[SocialbotError] = GraphError, foreign: bool = False) -> YamlSection:
    """Parse ``text`` as a mapping; errors name ``where``. Raises ``error`` for any other content.

    YAML of other programs is refused by its name, unless the reader wants such a file: ``foreign``.
    """
    file = YamlFile(where, error)
    return YamlSection(file.parse(text, foreign=foreign), 1, file)


def expect_own(foreign: ForeignFile | None, where: str, error: type[SocialbotError] = GraphError) -> None:
    """Raise ``error`` if the file ``where`` is that of another program."""
    if foreign is not None:
        raise error(f"this is {foreign.what}, not a file of socialbot", where=where, remedy=foreign.remedy)


def plain(value: Any) -> Any:
    """Convert numbers and strings of the YAML loader, which keep their notation, to plain Python types."""
    for kind in (bool, int, float, str):
        if isinstance(value, kind):
            return kind(value)
    return value


class YamlFile:
    """YAML file with its name ``where`` and the type of its errors, for users."""

    def __init__(self, where: str, error: type[SocialbotError] = GraphError) -> None:
        self.where = where
        self.error = error

    def parse(self, text: str, *, foreign: bool = False) -> Any:
        """Parse the content of the file, which may be ``foreign`` YAML. Raises the error of the file."""
        expect_own(foreign_text(text), self.where, self.error)
        try:
            page = _page(text)
        except MarkedYAMLError as error:
            place = f"{self.where}:{error.problem_mark.line + 1}" if error.problem_mark else self.where
            remedy = 'write texts such as "*" and "{x}: y" in quotes' if isinstance(error, ScannerError) else None
            raise self.error(f"no valid YAML: {error.problem}", where=place, remedy=remedy) from error
        except YAMLError as error:
            raise self.error(f"no valid YAML: {error}", where=self.where) from error
        if not foreign:
            expect_own(foreign_page(page), self.where, self.error)
        return page

    def fail(self, what: str, line: int, remedy: str | None = None) -> NoReturn:
        """Raise the error of the file."""
        raise self.error(what, where=f"{self.where}:{line}", remedy=remedy)

    def made(self, found: Any, section: YamlSection) -> Any:
        """Return the object to use for one that was read from a section."""
        return found

    def convert(self, kind: inspect.Type, value: Any, line: int, name: str = "") -> Any:
        """Convert a value of the file to a type; ``name`` stands for it in errors. Raises the error of the file."""
        whole = _bare(kind)
        for each in whole.types if isinstance(whole, inspect.UnionType) else (whole,):
            bare = _bare(each)
            if isinstance(bare, inspect.DictType) and isinstance(value, Mapping):
                return self._dict(bare, value, line)
            if isinstance(bare, _STRUCTS) and (isinstance(value, Mapping) or (value is None and _optional(bare))):
                return YamlSection(value or {}, line, self).read(bare.cls)
            if isinstance(bare, _LISTS) and (value is None or isinstance(value, list)) and _has_length(bare, value):
                return self._list(bare, value or [], line, name)
            if _fits(bare, given := plain(value)):
                return float(given) if isinstance(bare, inspect.FloatType) else given
        wanted, _, remedy = _wanted(kind).partition("; ")
        if isinstance(kind, inspect.StrType):
            remedy = 'write texts such as "12" and "{x}" in quotes'
        elif isinstance(kind, _STRUCTS):
            remedy = f"known: {', '.join(field.name for field in kind.fields)}"
        must = f"{name} must be" if name and not isinstance(kind, (*_STRUCTS, inspect.DictType)) else "expected"
        self.fail(f"{must} {wanted}, got {_shown(value)}", line, remedy or None)

    def _dict(self, kind: inspect.DictType, page: Mapping[Any, Any], line: int) -> dict[str, Any]:
        found = {}
        for key, value in page.items():
            place = line_of(page, key, line)
            name = self.convert(kind.key_type, str(key), place)
            if name in found:
                self.fail(f"two keys have the name {name!r}", place, "leave one out")
            found[name] = self.convert(kind.value_type, value, place, repr(name))
        return found

    def _list(self, kind: Any, values: list[Any], line: int, name: str) -> Any:
        kinds = kind.item_types if isinstance(kind, inspect.TupleType) else itertools.repeat(kind.item_type)
        if name and not name.startswith("each of"):
            name = f"each of {name}"
        places = (line_of(values, number, line) for number in range(len(values)))
        found = [self.convert(*each, name) for each in zip(kinds, values, places, strict=False)]
        return {inspect.ListType: list, inspect.FrozenSetType: frozenset}.get(type(kind), tuple)(found)


def line_of(page: Any, part: Any, default: int) -> int:
    """Return the 1-based line of a key or list item; merged and recursive parts have none and give the ``default``."""
    places = (page.lc.data or {}) if isinstance(page, (CommentedMap, CommentedSeq)) else {}
    return places[part][0] + 1 if part in places else default


@functools.cache
def _fields(kind: type) -> tuple[inspect.Field, ...]:
    found: Any = inspect.type_info(kind)
    return found.fields


def _bare(kind: inspect.Type) -> inspect.Type:
    """Return a type without its description."""
    return kind.type if isinstance(kind, inspect.Metadata) else kind


def _optional(kind: Any) -> bool:
    return not any(field.required for field in kind.fields)


def _has_length(kind: inspect.Type, value: list[Any] | None) -> bool:
    return not isinstance(kind, inspect.TupleType) or len(kind.item_types) == len(value or [])


def _fits(kind: inspect.Type, value: Any) -> bool:
    """Whether a type without parts has a value. Numbers are finite."""
    if isinstance(kind, inspect.LiteralType):
        return any(type(value) is type(each) and value == each for each in kind.values)
    if isinstance(kind, inspect.StrType):
        return isinstance(value, str) and (kind.pattern is None or re.fullmatch(kind.pattern, value) is not None)
    if isinstance(kind, (inspect.IntType, inspect.FloatType)):
        least = -sys.float_info.max if kind.ge is None else kind.ge
        most = sys.float_info.max if kind.le is None else kind.le
        kinds = (int,) if isinstance(kind, inspect.IntType) else (int, float)
        return type(value) in kinds and least <= value <= most
    return isinstance(kind, inspect.AnyType) or (isinstance(kind, inspect.BoolType) and isinstance(value, bool))


def _wanted(kind: inspect.Type) -> str:
    """What a value of a type must be, and a remedy after ``;``, if there is one."""
    if isinstance(kind, inspect.Metadata):
        return (kind.extra_json_schema or {})["description"]
    if isinstance(kind, inspect.UnionType):
        return " or ".join(_wanted(each) for each in kind.types if not isinstance(each, inspect.NoneType))
    if isinstance(kind, inspect.LiteralType):
        return f"one of {', '.join(map(str, kind.values))}"
    if isinstance(kind, _LISTS):
        items: Any = kind.item_types if isinstance(kind, inspect.TupleType) else (kind.item_type,)
        count = f"{len(items)} " if isinstance(kind, inspect.TupleType) else ""
        word = _WORDS.get(type(_bare(items[0])))
        return f"a list of {count}{word}s" if word else "a list"
    if isinstance(kind, (inspect.IntType, inspect.FloatType)):
        style = "" if isinstance(kind, inspect.IntType) else ".12g"
        bounds = {"from": kind.ge, "to": kind.le}
        return f"a {_WORDS[type(kind)]}" + "".join(
            f" {word} {x:{style}}" for word, x in bounds.items() if x is not None
        )
    return {inspect.StrType: "a text", inspect.BoolType: "true or false"}.get(type(kind), "names with values")


def _shown(value: object) -> str:
    if isinstance(value, Mapping):
        return "names with values"
    return "a list" if isinstance(value, list) else "nothing" if value is None else repr(plain(value))


class YamlSection:
    """Mapping of a file with its line numbers. Invalid values raise the error of the file."""

    def __init__(self, page: Any, line: int, file: YamlFile) -> None:
        if not isinstance(page, Mapping):
            file.fail(f"expected names with values, got {_shown(page)}", line)
        self.page: Mapping[Any, Any] = page
        self._file = file
        self.start = page.lc.line + 1 if isinstance(page, CommentedMap) else line
        self.where = f"{file.where}:{self.start}"

    def only(self, *known: str) -> None:
        """Reject keys that are not ``known``."""
        for key in self.page:
            if key not in known:
                remedy = suggestion(str(key), known)
                self._file.fail(f"unknown key {key!r}", line_of(self.page, key, self.start), remedy)

    def read(self, kind: type[_T], usual: Mapping[str, Any] = {}) -> _T:
        """Return the section as a struct or dataclass, with ``usual`` values and defaults for those that it lacks."""
        self.only(*(field.name for field in _fields(kind)))
        given = dict(usual)
        for field in _fields(kind):
            if field.required and self.page.get(field.name, usual.get(field.name, "")) == "":
                self._missing(field.name, field.type)
            if field.name in self.page:
                given[field.name] = self._value(field.name, field.type)
        return self._file.made(kind(**given), self)

    def value(self, key: Any, kind: Any, default: Any = msgspec.NODEFAULT) -> Any:
        """Return the value of a key as a type, or the ``default`` if there is no such key."""
        if key in self.page:
            return self._value(key, inspect.type_info(kind))
        return self._missing(key, inspect.type_info(kind)) if default is msgspec.NODEFAULT else default

    def _missing(self, key: str, kind: inspect.Type) -> NoReturn:
        self._file.fail(f"{key!r} is missing", self.start, f"give {_wanted(kind)}")

    def _value(self, key: Any, kind: inspect.Type) -> Any:
        return self._file.convert(kind, self.page[key], line_of(self.page, key, self.start), repr(key))

    def section(self, key: Any, default: Mapping[str, object] | None = None) -> YamlSection:
        if key not in self.page and default is None:
            self._file.fail(f"{key!r} is missing", self.start)
        return YamlSection(self.page.get(key, default), line_of(self.page, key, self.start), self._file)

    def line(self, *path: Any) -> str:
        """Return file and line of the key or list item at ``path``, or of its closest known parent."""
        part: Any = self.page
        line = self.start
        for key in path:
            try:
                line, part = line_of(part, key, part.lc.line + 1), part[key]
            except (AttributeError, LookupError, TypeError):  # no such part
                break
        return f"{self._file.where}:{line}"
