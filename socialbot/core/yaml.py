"""Read YAML from any source within limits, and keep the line of every part for error messages."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.scanner import RoundTripScanner, Scanner, ScannerError

from socialbot.core.errors import GraphError, suggestion

DEPTH = 50
"""How deep lists and mappings may be nested."""

_BRACKET = re.compile(r"[][{}]")


def load_yaml(loader: YAML, text: str) -> Any:
    """What ``loader`` makes of ``text``. Raises YAMLError, and a MarkedYAMLError where the place is known."""
    loader.Scanner = _RoundTripScanner if loader.Scanner is RoundTripScanner else _Scanner
    try:
        return loader.load(text)
    except YAMLError:
        raise
    except Exception as error:
        # Numbers that are too long, dates that are none, lists as keys: ruamel.yaml fails in many ways.
        raise YAMLError(f"{type(error).__name__}: {error}") from error


def line_of(page: CommentedMap | CommentedSeq, part: Any, default: int, *, value: bool = False) -> int:
    """The line, from 1, of a key or a number in a list, or of the ``value`` of a key.

    It is the ``default`` where the line is not known: what is merged stands elsewhere, and so does what is in itself.
    """
    places = page.lc.data or {}
    return places[part][2 if value else 0] + 1 if part in places else default


def check_depth(text: str) -> None:
    """For what others parse: raises YAMLError where brackets are nested too deeply, those in quotes among them."""
    depth = 0
    for bracket in _BRACKET.findall(text):
        depth += 1 if bracket in "[{" else -1
        if depth > DEPTH:
            raise YAMLError(f"nested more than {DEPTH} deep")


class _Shallow:
    """Scanning takes time that grows with the square of the depth, and Python does not recurse any deeper than that."""

    def fetch_more_tokens(self: Any) -> Any:
        if len(self.flow_context) + len(self.indents) > DEPTH:
            raise ScannerError(problem=f"nested more than {DEPTH} deep", problem_mark=self.reader.get_mark())
        return super().fetch_more_tokens()  # type: ignore[misc]


class _Scanner(_Shallow, Scanner):
    pass


class _RoundTripScanner(_Shallow, RoundTripScanner):
    pass


def read_page(text: str, *, where: str) -> YamlSection:
    """The page that ``text`` is; ``where`` is named in errors. Raises GraphError for what is no mapping in YAML."""
    try:
        page = load_yaml(YAML(typ="rt"), text)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise GraphError(f"no valid YAML: {error.problem}", where=f"{where}:{line}") from error
    except YAMLError as error:
        raise GraphError(f"no valid YAML: {error}", where=where) from error
    return YamlSection(page, where, file=where)


def plain(value: object) -> object:
    """Without the notation (1e3, 0x10, ...) that the YAML loader remembers in subclasses of numbers."""
    for kind in (bool, int, float, str):
        if isinstance(value, kind):
            return kind(value)
    return value


class YamlSection:
    """A mapping of the ``file`` that knows where it stands. What is not as wanted raises GraphError."""

    def __init__(self, page: Any, where: str, *, file: str) -> None:
        if not isinstance(page, Mapping):
            raise GraphError(f"expected names with values, got {page!r}", where=where)
        self._file = file
        self.page: Mapping[Any, Any] = page
        self.where = f"{file}:{page.lc.line + 1}" if isinstance(page, CommentedMap) else where

    def only(self, *known: str) -> None:
        """Refuses keys that are not ``known``."""
        for key in self.page:
            if key not in known:
                raise GraphError(f"unknown key {key!r}", where=self.line(key), remedy=suggestion(str(key), known))

    def text(self, key: Any, default: str | None = None) -> str:
        """The text ``key``."""
        value = self.page.get(key, default)
        if not isinstance(value, str):
            raise GraphError(f"{key!r} must be a text, got {value!r}", where=self.line(key))
        return value

    def texts(self, key: str) -> list[str]:
        """The list of texts ``key``; empty where there is none."""
        value = self.page.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise GraphError(f"{key!r} must be a list of texts, got {value!r}", where=self.line(key))
        return value

    def whole(self, key: str, default: int, *, minimum: int, maximum: int) -> int:
        """The whole number ``key``."""
        value = plain(self.page.get(key, default))
        if type(value) is not int or not minimum <= value <= maximum:
            raise GraphError(
                f"{key!r} must be a whole number from {minimum} to {maximum}, got {value!r}", where=self.line(key)
            )
        return value

    def number(self, key: str, default: float, *, minimum: float, maximum: float) -> float:
        """The number ``key``."""
        value = plain(self.page.get(key, default))
        if type(value) not in (int, float) or not minimum <= float(value) <= maximum:  # type: ignore[arg-type]
            raise GraphError(
                f"{key!r} must be a number from {minimum:g} to {maximum:g}, got {value!r}", where=self.line(key)
            )
        return float(value)  # type: ignore[arg-type]

    def section(self, key: Any, default: Mapping[str, object] | None = None) -> YamlSection:
        """The mapping ``key``."""
        if key not in self.page and default is None:
            raise GraphError(f"{key!r} is missing", where=self.where)
        return YamlSection(self.page.get(key, default), self.line(key), file=self._file)

    def line(self, *path: Any) -> str:
        """File and line of the key that ``path`` leads to, or of as much of the way as there is."""
        section: Any = self.page
        where = self.where
        for key in path:
            if not isinstance(section, CommentedMap) or key not in section:
                break
            where = f"{self._file}:{line_of(section, key, section.lc.line + 1)}"
            section = section[key]
        return where
