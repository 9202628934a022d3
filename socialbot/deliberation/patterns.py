"""Names that stand for several: with ``*`` for any letters, ``?`` for one, or ``{x}`` for the value of a variable."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping

_VARIABLE = re.compile(r"\{(\w+)\}")


def has_wildcards(name: str) -> bool:
    """Whether it has ``*`` or ``?`` in it."""
    return "*" in name or "?" in name


@functools.lru_cache(4096)
def like(pattern: str) -> Callable[[str], object]:
    """What tells whether a name is like one with wildcards."""
    parts = (".*" if letter == "*" else "." if letter == "?" else re.escape(letter) for letter in pattern)
    return re.compile("".join(parts)).fullmatch


def variable_of(name: str) -> str | None:
    """The variable that it is as a whole."""
    found = _VARIABLE.fullmatch(name)
    return found[1] if found else None


def variables_in(text: str) -> list[str]:
    """The variables that are written somewhere in a text."""
    return _VARIABLE.findall(text)


def filled(text: str, binding: Mapping[str, str]) -> str:
    """A text with the values of the variables in their places."""
    return _VARIABLE.sub(lambda found: binding[found[1]], text)
