"""Read YAML within limits, with line numbers for error messages."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, ScalarNode
from ruamel.yaml.scanner import RoundTripScanner, Scanner, ScannerError

from socialbot.core.errors import GraphError, suggestion
from socialbot.core.foreign_files import ForeignFile, foreign_page, foreign_text
from socialbot.core.limits import YAML_DEPTH, YAML_GROWTH

_BRACKET = re.compile(r"[][{}]")


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


def line_of(page: CommentedMap | CommentedSeq, part: Any, default: int, *, value: bool = False) -> int:
    """Return the 1-based line of a key or list item, or of the ``value`` of a key.

    Merged and recursive parts have no known line and give the ``default``.
    """
    places = page.lc.data or {}
    return places[part][2 if value else 0] + 1 if part in places else default


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
    """Limit for aliases, before values are made of them."""

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


def read_page(text: str, *, where: str) -> YamlSection:
    """Parse ``text`` as a mapping; errors name ``where``. Raises GraphError for any other content."""
    expect_own(foreign_text(text), where)
    try:
        page = load_yaml(YAML(typ="rt"), text)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise GraphError(f"no valid YAML: {error.problem}", where=f"{where}:{line}") from error
    except YAMLError as error:
        raise GraphError(f"no valid YAML: {error}", where=where) from error
    expect_own(foreign_page(page), where)
    return YamlSection(page, where, file=where)


def expect_own(foreign: ForeignFile | None, where: str) -> None:
    """Raise GraphError if the file ``where`` is that of another program."""
    if foreign is not None:
        raise GraphError(f"this is {foreign.what}, not a file of socialbot", where=where, remedy=foreign.remedy)


def plain(value: object) -> object:
    """Convert numbers and strings of the YAML loader, which keep their notation, to plain Python types."""
    for kind in (bool, int, float, str):
        if isinstance(value, kind):
            return kind(value)
    return value


class YamlSection:
    """Mapping of ``file`` with its line numbers. Invalid values raise GraphError."""

    def __init__(self, page: Any, where: str, *, file: str) -> None:
        if not isinstance(page, Mapping):
            raise GraphError(f"expected names with values, got {page!r}", where=where)
        self._file = file
        self.page: Mapping[Any, Any] = page
        self.where = f"{file}:{page.lc.line + 1}" if isinstance(page, CommentedMap) else where

    def only(self, *known: str) -> None:
        """Reject keys that are not ``known``."""
        for key in self.page:
            if key not in known:
                raise GraphError(f"unknown key {key!r}", where=self.line(key), remedy=suggestion(str(key), known))

    def text(self, key: Any, default: str | None = None) -> str:
        value = self.page.get(key, default)
        if not isinstance(value, str):
            raise GraphError(f"{key!r} must be a text, got {value!r}", where=self.line(key))
        return value

    def texts(self, key: str) -> list[str]:
        value = self.page.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise GraphError(f"{key!r} must be a list of texts, got {value!r}", where=self.line(key))
        return value

    def flag(self, key: str, default: bool) -> bool:
        value = self.page.get(key, default)
        if not isinstance(value, bool):
            raise GraphError(f"{key!r} must be true or false, got {value!r}", where=self.line(key))
        return value

    def whole(self, key: str, default: int, *, minimum: int, maximum: int) -> int:
        value = plain(self.page.get(key, default))
        if type(value) is not int or not minimum <= value <= maximum:
            raise GraphError(
                f"{key!r} must be a whole number from {minimum} to {maximum}, got {value!r}", where=self.line(key)
            )
        return value

    def number(self, key: str, default: float, *, minimum: float, maximum: float) -> float:
        value = plain(self.page.get(key, default))
        if type(value) not in (int, float) or not minimum <= float(value) <= maximum:  # type: ignore[arg-type]
            raise GraphError(
                f"{key!r} must be a number from {minimum:g} to {maximum:g}, got {value!r}", where=self.line(key)
            )
        return float(value)  # type: ignore[arg-type]

    def section(self, key: Any, default: Mapping[str, object] | None = None) -> YamlSection:
        if key not in self.page and default is None:
            raise GraphError(f"{key!r} is missing", where=self.where)
        return YamlSection(self.page.get(key, default), self.line(key), file=self._file)

    def line(self, *path: Any) -> str:
        """Return file and line of the key at ``path``, or of its closest known parent."""
        section: Any = self.page
        where = self.where
        for key in path:
            if not isinstance(section, CommentedMap) or key not in section:
                break
            where = f"{self._file}:{line_of(section, key, section.lc.line + 1)}"
            section = section[key]
        return where
