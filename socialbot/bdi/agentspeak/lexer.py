"""Tokens and operator tables of the AgentSpeak grammar, and syntax errors with positions."""

from __future__ import annotations

import re
from bisect import bisect_left
from enum import IntEnum
from itertools import accumulate

from socialbot.bdi.literals import Change
from socialbot.core.errors import SocialbotError


class Level(IntEnum):
    """Precedence of the operators, from the weakest."""

    OR, AND, NOT, COMPARE, SUM, PRODUCT, POWER = range(1, 8)


BINARY: dict[str, tuple[int, str]] = {
    "|": (Level.OR, "|"),
    "&": (Level.AND, "&"),
    **{sign: (Level.COMPARE, sign) for sign in (">", ">=", "<", "<=", "==", "=", "=..")},
    "\\==": (Level.COMPARE, "!="),
    "+": (Level.SUM, "+"),
    "-": (Level.SUM, "-"),
    "*": (Level.PRODUCT, "*"),
    "/": (Level.PRODUCT, "/"),
    "div": (Level.PRODUCT, "div"),
    "mod": (Level.PRODUCT, "mod"),
    "**": (Level.POWER, "**"),
}
"""Precedence and internal symbol of the binary operators."""

WRITTEN = {symbol: word for word, (_, symbol) in BINARY.items()} | {"//": "div", "%": "mod"}
"""AgentSpeak spelling of the internal symbols. Division rounds down in Python and towards zero in AgentSpeak."""

KEYWORDS = frozenset({"not", "div", "mod", "if", "elif", "else", "while", "for"})
"""Reserved names, which literals can use in quotes only. ``true`` and ``false`` may be atoms."""

TRIGGERS = {
    ("+", ""): Change.ADDED,
    ("-", ""): Change.REMOVED,
    ("+", "!"): Change.WANTED,
    ("-", "!"): Change.FAILED,
    ("+", "?"): Change.ASKED,
    ("-", "?"): Change.UNANSWERED,
    ("^", "!"): Change.GOAL_STATE,
    ("^", "?"): Change.QUESTION_STATE,
}

UNSUPPORTED = {
    "-<": ("'-<'", "write - alone"),
    "`": ("a backquote", None),
}
"""Unsupported keywords of Jason, with alternatives."""

REMEDIES = {
    "&&": "write '&'",
    "||": "write '|' between conditions and '|||' between steps",
    "!=": "write '\\=='",
    "++": "between terms, leave a blank between the signs",
    "--": "between terms, leave a blank between the signs",
    "is": "write '='",
    "and": "write '&'",
    "or": "write '|'",
    '"': "end the string with '\"' in the same line; a line end in it is written \\n",
    "'": 'end the quoted name with "\'" in the same line',
    "/*": "end the comment with '*/'",
}
"""Remedies for common mistakes."""

REFUSED = {
    ".python": ("a Python function in a condition has no counterpart in AgentSpeak",
                "write the rule in Python, or let a rule in AgentSpeak say the same"),
}  # fmt: skip
"""Internal actions that the parser rejects."""

FUNCTIONS = frozenset({".length", ".count"})
LIBRARIES = ("math.", "system.")
"""Beginnings of the names of built-in functions."""


def is_function(name: str, arity: int) -> bool:
    """Check whether a name in a term is a function call."""
    return name.startswith(LIBRARIES) or (arity == 1 and name in FUNCTIONS)


_PLAIN = re.compile(r"(?:[^\W\dA-Z_]\w*::)?[^\W\dA-Z_.]\w*|\.?[^\W\dA-Z_]\w*(?:\.[^\W\d]\w*)*")


def is_plain(name: str) -> bool:
    """Check whether a name needs no quotes."""
    known = _PLAIN.fullmatch(name) is not None and name not in KEYWORDS
    return known and (name[0] == "." or (name[0].isalpha() and not name[0].isupper()))


def keeps_quotes(name: str) -> bool:
    """Check whether quotes around a name are a part of it: they are where it needs none, as in Jason."""
    return is_plain(name) and name[0] != "." and not is_function(name, 1)


def is_quoted(name: str) -> bool:
    """Check whether quotes are a part of a name, such as ``'abc'``, which is not ``abc``."""
    return name[:1] == name[-1:] == "'" and keeps_quotes(name[1:-1])


UNQUALIFIED = frozenset({
    "atomic/0", "breakpoint/0", "all_unifs/0", "default/0", "this_ns/0", "source/1", "self/0", "percept/0", "tell/0",
    "untell/0", "achieve/0", "unachieve/0", "askOne/0", "askAll/0", "askHow/0", "tellHow/0", "untellHow/0",
})  # fmt: skip
"""Names with a number of arguments that belong to no namespace."""


def qualified(namespace: str, name: str, arity: int) -> str:
    """Return the name of a literal in a namespace; '' is the default one."""
    if not namespace or "." in name or "::" in name or f"{name}/{arity}" in UNQUALIFIED:
        return name
    return f"{namespace}::{name}"


END = "\n"
"""End-of-text token; no other token is blank."""

_STRING = r'"(?:[^"\\\n\r]|\\[^\n\r])*"'
_QUOTED = r"'(?:[^'\\\n\r]|\\[^\n\r])*'"
_WORD = re.compile(
    r"\s*(?:"
    r"[A-Z_]\w*"  # a variable
    r"|\.?[^\W\d]\w*(?:\.[^\W\d]\w*)*"  # a name, with a dot only before a letter
    r"|[(),;]"
    r"|[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?|\.[0-9]+(?:[eE][+-]?[0-9]+)?"
    rf"|{_STRING}|{_QUOTED}"
    r"|<-|<=|<:|>=|:-|::|=\.\.|==|\\==|\*\*|-\+|\+\+|--|\+<|\+>|-<|!!|!=|\|&\||\|\|\||\|\||&&|/\*"
    r"|\S)"
)
_COMMENT = re.compile(rf"({_STRING}|{_QUOTED})|//[^\n]*|#[^\n]*|/\*.*?(?:\*/|(\Z))", re.DOTALL)
_NOT_LINE_END = re.compile(r"[^\n]")
_ESCAPE = re.compile(r"\\([0-3][0-7]{2}|[0-7]{1,2}|.)", re.DOTALL)
ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "b": "\b", "f": "\f", "\\": "\\", '"': '"', "'": "'"}


class AgentSpeakError(SocialbotError):
    """AgentSpeak text with a syntax error or an unsupported feature."""

    exit_code = 4
    line: int = 0
    column: int = 0


class Source:
    """Tokenized text. The comments ``//``, ``/* */`` and ``#`` count as whitespace."""

    def __init__(self, text: str, file: str) -> None:
        self.text = text
        self.file = file
        bare = _COMMENT.sub(_blank, text) if "#" in text or "/" in text else text
        # Trailing whitespace would be scanned again from each of its characters.
        self._pieces: list[str] = _WORD.findall(bare.rstrip())
        self.words = [piece.strip() for piece in self._pieces]
        self.words += (END, END)
        self._ends: list[int] | None = None
        self._line_ends: list[int] | None = None

    def start(self, index: int) -> int:
        if self._ends is None:
            self._ends = list(accumulate(map(len, self._pieces)))
        if index < len(self._ends):
            return self._ends[index] - len(self.words[index])
        return self._ends[-1] if self._ends else 0

    def line(self, offset: int) -> int:
        """Return the 1-based line of an offset."""
        if self._line_ends is None:
            self._line_ends = [found.start() for found in re.finditer("\n", self.text)]
        return bisect_left(self._line_ends, offset) + 1

    def error(self, index: int, what: str, remedy: str | None = None) -> AgentSpeakError:
        """Return the error for a token."""
        return self.error_at(self.start(index), what, remedy)

    def error_at(self, offset: int, what: str, remedy: str | None) -> AgentSpeakError:
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
        """Return the content of a quoted token with escapes resolved."""
        inside = self.words[index][1:-1]
        if "\\" not in inside:
            return inside
        for escape in _ESCAPE.findall(inside):
            if escape not in ESCAPES and not escape.isdecimal():
                raise self.error(index, f"unknown escape '\\{escape}'", "write \\\\ for a backslash itself")
        return _ESCAPE.sub(lambda match: ESCAPES.get(match[1]) or chr(int(match[1], 8)), inside)

    def name(self, index: int) -> str:
        """Return the name that a token in single quotes stands for."""
        name = self.unquoted(index)
        return f"'{name}'" if keeps_quotes(name) else name


def bare(text: str) -> str:
    """Return a text of the same length with blanks in place of comments and strings."""
    return _COMMENT.sub(lambda found: found[0] if found[0][0] == "'" else _NOT_LINE_END.sub(" ", found[0]), text)


def _blank(match: re.Match[str]) -> str:
    if match[1]:
        return match[1]
    # The start of an unclosed comment stays, so that the parser reports it.
    begin = "/*" if match[2] is not None else ""
    return begin + _NOT_LINE_END.sub(" ", match[0][len(begin) :])
