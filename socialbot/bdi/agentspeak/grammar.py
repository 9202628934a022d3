"""The tables of the grammar: operators, key words, and what of Jason's language is not supported."""

from __future__ import annotations

from socialbot.bdi.events import Change

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
