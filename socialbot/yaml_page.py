"""Pages of YAML whose parts know the line they stand in, so that every mistake can be shown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from socialbot.errors import GraphError
from socialbot.graph import suggestion
from socialbot.yaml_text import line_of, load_yaml


def read_page(text: str, *, where: str) -> Section:
    """The page that ``text`` is; ``where`` is named in errors. Raises GraphError for what is no mapping in YAML."""
    try:
        page = load_yaml(YAML(typ="rt"), text)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise GraphError(f"no valid YAML: {error.problem}", where=f"{where}:{line}") from error
    except YAMLError as error:
        raise GraphError(f"no valid YAML: {error}", where=where) from error
    return Section(page, where, file=where)


def plain(value: object) -> object:
    """Without the notation (1e3, 0x10, ...) that the YAML loader remembers in subclasses of numbers."""
    for kind in (bool, int, float, str):
        if isinstance(value, kind):
            return kind(value)
    return value


class Section:
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

    def section(self, key: Any, default: Mapping[str, object] | None = None) -> Section:
        """The mapping ``key``."""
        if key not in self.page and default is None:
            raise GraphError(f"{key!r} is missing", where=self.where)
        return Section(self.page.get(key, default), self.line(key), file=self._file)

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
