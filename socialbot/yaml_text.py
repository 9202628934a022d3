"""YAML from anywhere: whatever is wrong with a text, it is a YAMLError, and soon."""

from __future__ import annotations

import re
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError
from ruamel.yaml.scanner import RoundTripScanner, Scanner, ScannerError

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
