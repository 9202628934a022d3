"""The words of an AgentSpeak text, and errors that show where in the text they are.

Words are plain strings. Where one stands is worked out only when somebody asks, which makes the scanning
of a text that is right fast.
"""

from __future__ import annotations

import re
from itertools import accumulate

from socialbot.errors import SocialbotError

END = "\n"
"""Comes after the last word; no other word is blank."""

_STRING = r'"(?:[^"\\\n\r]|\\[^\n\r])*"'
_QUOTED = r"'(?:[^'\\\n\r]|\\[^\n\r])*'"
_WORD = re.compile(
    r"\s*(?:"
    r"[A-Z_]\w*"  # a variable
    r"|\.?[^\W\d]\w*(?:\.[^\W\d]\w*)*"  # a name; a dot that a letter follows belongs to it
    r"|[(),;]"
    r"|[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?|\.[0-9]+(?:[eE][+-]?[0-9]+)?"
    rf"|{_STRING}|{_QUOTED}"
    r"|<-|<=|<:|>=|:-|::|=\.\.|==|\\==|\*\*|-\+|\+\+|--|\+<|\+>|-<|!!|!=|\|&\||\|\|\||\|\||&&|/\*"
    r"|\S)"
)
_COMMENT = re.compile(rf"({_STRING}|{_QUOTED})|//[^\n]*|#[^\n]*|/\*.*?(?:\*/|(\Z))", re.DOTALL)
_NOT_LINE_END = re.compile(r"[^\n]")
_ESCAPE = re.compile(r"\\(.)", re.DOTALL)
ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "b": "\b", "f": "\f", "\\": "\\", '"': '"', "'": "'"}


class AgentSpeakError(SocialbotError):
    """AgentSpeak text that cannot be understood, or uses what is not supported."""

    exit_code = 4
    line: int = 0
    column: int = 0


class Source:
    """A text, cut into words. The comments in it, ``//``, ``/* */`` and ``#``, count as blanks."""

    def __init__(self, text: str, file: str) -> None:
        self.text = text
        self.file = file
        bare = _COMMENT.sub(_blank, text) if "#" in text or "/" in text else text
        # Blanks that no word follows would be looked through again from each of them.
        self._pieces: list[str] = _WORD.findall(bare.rstrip())
        self.words = [piece.strip() for piece in self._pieces]
        self.words += (END, END)
        self._ends: list[int] | None = None
        self._known = (0, 1)

    def start(self, index: int) -> int:
        """The offset in the text at which a word begins."""
        if self._ends is None:
            self._ends = list(accumulate(map(len, self._pieces)))
        if index < len(self._ends):
            return self._ends[index] - len(self.words[index])
        return self._ends[-1] if self._ends else 0

    def line(self, offset: int) -> int:
        """The line, from 1, of an offset; cheap when asked from front to back."""
        before, line = self._known if self._known[0] <= offset else (0, 1)
        line += self.text.count("\n", before, offset)
        self._known = offset, line
        return line

    def error(self, index: int, what: str, remedy: str | None = None) -> AgentSpeakError:
        """The error that something is wrong at a word."""
        offset = self.start(index)
        begin = self.text.rfind("\n", 0, offset) + 1
        shown = self.text[begin:].split("\n", 1)[0].rstrip()
        under = "".join("\t" if char == "\t" else " " for char in self.text[begin:offset])
        line, column = self.line(offset), offset - begin + 1
        error = AgentSpeakError(
            f"{what}\n    {shown}\n    {under}^", where=f"{self.file}:{line}:{column}", remedy=remedy
        )
        error.line, error.column = line, column
        return error

    def unquoted(self, index: int) -> str:
        """What is between the quotes of a word, with the escapes resolved."""
        inside = self.words[index][1:-1]
        if "\\" not in inside:
            return inside
        for escape in _ESCAPE.findall(inside):
            if escape not in ESCAPES:
                raise self.error(index, f"unknown escape '\\{escape}'", "write \\\\ for a backslash itself")
        return _ESCAPE.sub(lambda match: ESCAPES[match[1]], inside)


def _blank(match: re.Match[str]) -> str:
    if match[1]:
        return match[1]
    # Of a comment that is never closed, its beginning stays, for the parser to complain about.
    begin = "/*" if match[2] is not None else ""
    return begin + _NOT_LINE_END.sub(" ", match[0][len(begin) :])
