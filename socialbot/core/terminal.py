"""Text from files, people and the network, without the characters that control a terminal, or that XML cannot hold."""

from __future__ import annotations

import logging
import re

_CONTROL = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]"
)
"""Control characters except tab and line feed, bidirectional controls, line separators, surrogates, noncharacters."""


def without_controls(text: str) -> str:
    """Replace each character that could change a terminal, or the order of a line, by a question mark."""
    return _CONTROL.sub("?", text)


def escaped_json(text: str) -> str:
    """Escape these characters in JSON, which keeps its meaning."""
    return _CONTROL.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


class TerminalFormatter(logging.Formatter):
    """Formatter of log records without these characters."""

    def format(self, record: logging.LogRecord) -> str:
        return without_controls(super().format(record))
