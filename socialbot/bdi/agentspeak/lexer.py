"""The tokens and tables of AgentSpeak's grammar, and syntax errors with their position."""

from __future__ import annotations

import re
from itertools import accumulate

from socialbot.bdi.literals import Change
from socialbot.core.errors import SocialbotError

OR, AND, NOT, COMPARE, SUM, PRODUCT, POWER = range(1, 8)
"""How tightly operators bind."""

BINARY: dict[str, tuple[int, str]] = {
    "|": (OR, "|"),
    "&": (AND, "&"),
    **{sign: (COMPARE, sign) for sign in (">", ">=", "<", "<=", "==", "=", "=..")},
    "\\==": (COMPARE, "!="),
    "+": (SUM, "+"),
    "-": (SUM, "-"),
    "*": (PRODUCT, "*"),
    "/": (PRODUCT, "/"),
    "div": (PRODUCT, "div"),
    "mod": (PRODUCT, "mod"),
    "**": (POWER, "**"),
}
"""Operators between two things: how tightly they bind, and their symbol in the representation."""

WRITTEN = {symbol: word for word, (_, symbol) in BINARY.items()} | {"//": "div", "%": "mod"}
"""How AgentSpeak writes the symbols of the representation; what rounds down in Python rounds towards zero there."""

KEYWORDS = frozenset({"not", "div", "mod", "if", "elif", "else", "while", "for"})
"""Names that cannot be names of literals, unless they are quoted. ``true`` and ``false`` can be atoms."""

TRIGGERS = {
    ("+", ""): Change.ADDED,
    ("-", ""): Change.REMOVED,
    ("+", "!"): Change.WANTED,
    ("-", "!"): Change.FAILED,
    ("+", "?"): Change.ASKED,
    ("-", "?"): Change.UNANSWERED,
}

UNSUPPORTED = {
    "::": ("a namespace ('::')", "leave the namespace out, or make it a part of the name"),
    "^": ("a meta-event ('^')", "let the plans of the goal change a belief, and react to that"),
    "<:": ("a goal condition ('<:')", "test the condition in a plan, with 'if' or 'while'"),
    "+<": ("'+<'", "write + or - alone"),
    "+>": ("'+>'", "write + or - alone"),
    "-<": ("'-<'", "write + or - alone"),
    "`": ("a backquote", None),
}
"""Words of Jason's that are not supported, and what to do instead."""

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
"""What to do about words that people write by mistake."""

REFUSED = {
    ".python": ("a Python function in a condition has no counterpart in AgentSpeak",
                "write the rule in Python, or let a rule in AgentSpeak say the same"),
    ".include": ("'.include' is not supported", "load both files"),
}  # fmt: skip
"""Internal actions that are refused where they are read, not when they would be done."""

FUNCTIONS = frozenset({".length", ".count"})
LIBRARIES = ("math.", "system.")


def is_function(name: str, arity: int) -> bool:
    """Whether a name stands for the value of a function wherever a term is expected."""
    return name.startswith(LIBRARIES) or (arity == 1 and name in FUNCTIONS)


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
