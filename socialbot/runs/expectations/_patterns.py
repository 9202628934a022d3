"""Patterns for the texts of trace records: ``greeted("t1")``, ``(carrier_move carrier_a base deposit)``."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache

from socialbot.core.errors import RuleError

_VARIABLE = re.compile(r"[A-Z]\w*")
_PLAIN = re.compile(r"[\w.-]+")


@lru_cache(maxsize=65536)
def call_of(text: str) -> tuple[str, tuple[str, ...]]:
    """Return the name and the arguments of a literal, or of an action in PDDL notation; strings lose their quotes."""
    text = text.strip()
    if text.startswith("("):
        name, *args = text.strip("()").split() or [""]
        return name, tuple(args)
    name, bracket, rest = text.partition("(")
    if not bracket or not rest.endswith(")"):
        return text, ()
    return name.strip(), tuple(_without_quotes(each) for each in _separated(rest[:-1]))


def _separated(text: str) -> Iterator[str]:
    """Yield the parts between the commas outside of brackets and strings."""
    depth, quote, part, escaped = 0, False, "", False
    for character in text:
        if character == "," and not depth and not quote:
            yield part.strip()
            part = ""
            continue
        if character == '"' and not escaped:
            quote = not quote
        elif not quote:
            depth += (character in "([{") - (character in ")]}")
        escaped = character == "\\" and not escaped
        part += character
    if part.strip():
        yield part.strip()


def _without_quotes(text: str) -> str:
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'" else text


@dataclass(frozen=True)
class TextPattern:
    """Pattern of a name, and of arguments unless it is None.

    Each argument is a variable, ``_`` for any value, or a text in which ``*`` and ``?`` stand for others.
    """

    name: str
    args: tuple[str, ...] | None
    variables: frozenset[str]
    text: str

    def match(self, text: str) -> Mapping[str, str] | None:
        """Return the values of the variables if ``text`` matches; None if it does not."""
        name, args = call_of(text)
        if not fnmatchcase(name, self.name):
            return None
        if self.args is None:
            return {}
        if len(args) != len(self.args):
            return None
        values: dict[str, str] = {}
        for wanted, given in zip(self.args, args, strict=True):
            if wanted in self.variables:
                if values.setdefault(wanted, given) != given:
                    return None
            elif wanted != "_" and not fnmatchcase(given, wanted):
                return None
        return values


def pattern_of(what: object, where: str) -> TextPattern:
    """Return the pattern for a literal of the engine, a class of literals, or a text.

    In a text, names that begin with a capital are variables, as in AgentSpeak. Raises RuleError.
    """
    if isinstance(what, type):
        return TextPattern(str(getattr(what, "functor", what.__name__)), None, frozenset(), what.__name__)
    names: Callable[[], set[str]] | None = getattr(what, "names", None)
    text = str(what).strip()
    if not text or not (isinstance(what, str) or hasattr(what, "functor")):
        remedy = "give a literal such as greeted(Who), its class, or a text such as 'greeted(_)'"
        raise RuleError(f"{what!r} is no belief, goal or action", where=where, remedy=remedy)
    name, bracket, rest = text.partition("(")
    if not bracket and not text.startswith("("):
        return TextPattern(text, None, frozenset(), text)
    if not text.startswith("(") and not rest.endswith(")"):
        raise RuleError(f"{text!r} lacks a closing bracket", where=where, remedy="write name(argument, argument)")
    raw = text.strip("()").split()[1:] if text.startswith("(") else list(_separated(rest[:-1]))
    found = names() if names is not None else {each for each in raw if _VARIABLE.fullmatch(each)}
    name, args = call_of(text)
    return TextPattern(name, args, frozenset(found) - {"_"}, text)


def names_in(text: str) -> set[str]:
    """Return the arguments of a literal that are single names or strings, at any depth."""
    return {_without_quotes(each) for each in re.findall(r'"[^"]*"|[\w.-]+', text.partition("(")[2])}
