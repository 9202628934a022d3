"""Internal actions on strings and on the text of terms."""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Iterator
from typing import Any

from socialbot.bdi.agentspeak._spelling import plain, said, spelled
from socialbot.bdi.agentspeak.lexer import AgentSpeakError
from socialbot.bdi.agentspeak.parser import parse_condition, parse_term
from socialbot.bdi.intentions import Failed
from socialbot.bdi.stdlib.registry import Args, each, gives, integer_of, internal, is_number, items_of, opened, wrong
from socialbot.bdi.terms import Atom
from socialbot.bdi.unification import Trail, Var, resolve


def text_of(name: str, term: Any) -> str:
    """Format a value as `.print` does. Raises Failed for an unbound variable."""
    term = resolve(term)
    if term.__class__ is Var:
        raise wrong(name, term, "a value")
    return said(term)


@internal(".concat", 2, 100)
def concat(engine: Any, args: Args, trail: Trail) -> bool:
    """``.concat(a1, ..., an, R)``: R is the concatenation of all lists, or one string of all arguments."""
    parts = [resolve(arg) for arg in args[:-1]]
    for part in parts:
        if part.__class__ is Var:
            raise wrong(".concat", part, "values")
    if parts[0].__class__ is tuple:
        return gives(args[-1], tuple(item for part in parts for item in items_of(".concat", part)), trail)
    return gives(args[-1], "".join(map(plain, parts)), trail)


@internal(".lower_case", 2, binds=True)
def lower_case(engine: Any, args: Args, trail: Trail) -> bool:
    """``.lower_case(S, R)``: R is the string S in small letters."""
    return gives(args[1], text_of(".lower_case", args[0]).lower(), trail)


@internal(".upper_case", 2, binds=True)
def upper_case(engine: Any, args: Args, trail: Trail) -> bool:
    """``.upper_case(S, R)``: R is the string S in capital letters."""
    return gives(args[1], text_of(".upper_case", args[0]).upper(), trail)


@internal(".substring", 2, 4, many=True)
def substring(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.substring(Part, Whole, Begin, End)``: Part is in Whole from Begin to End, the last position included.

    A number as Begin cuts: ``.substring(S, "abcdef", 1, 3)`` and ``.substring("abcdef", S, 1, 3)`` give ``"bc"``.
    """
    first, second, *span = map(resolve, args)
    if span and is_number(span[0]) and Var in (first.__class__, second.__class__):
        whole, result = (second, first) if first.__class__ is Var else (first, second)
        text = text_of(".substring", whole)
        begin = integer_of(".substring", span[0])
        end = integer_of(".substring", span[1]) if span[1:] and is_number(span[1]) else len(text)
        if not 0 <= begin <= end <= len(text):
            raise Failed(
                "wrong_arguments", f".substring: there is no part from {begin} to {end} of {len(text)} letters"
            )
        return each(result, [text[begin:end]], trail)
    part, whole = text_of(".substring", first), text_of(".substring", second)
    if not span:
        return each((), [()] if part in whole else [], trail)
    places = (at for at in range(len(whole)) if whole.startswith(part, at))
    return each(args[2:], ((at, at + len(part) - 1)[: len(span)] for at in places), trail)


MAX_SEARCHED = (10_000, 10_000, 2_000, 500)
"""Most characters of a text by the number of unlimited repeats in its regular expression, the last for more."""

MAX_REPEATS = 16
"""Most repeats of variable length in a regular expression; more repetitions than that count as unlimited."""


def replaced(name: str, pattern: str, template: str, text: str) -> str:
    """Replace each match of a regular expression, in a time that is bounded whatever the text.

    Raises Failed for a wrong expression, one with a variable repeat in an unlimited one, whose time can double with
    each character, more than `MAX_REPEATS`, and a text beyond `MAX_SEARCHED`.
    """
    try:
        compiled = re.compile(pattern)
        variable, unlimited = _repeats(_parser().parse(pattern), inside=False)
        if variable > MAX_REPEATS:
            raise Failed("wrong_arguments", f"{name}: {pattern!r} repeats repeats, which can take for ever")
        limit = MAX_SEARCHED[min(unlimited, len(MAX_SEARCHED) - 1)]
        if len(text) > limit:
            raise Failed("wrong_arguments", f"{name}: more than {limit} characters for the repeats of {pattern!r}")
        return compiled.sub(template, text)
    except (re.error, RecursionError, OverflowError, ValueError) as problem:  # ValueError: thousands of digits
        raise Failed("wrong_arguments", f"{name}: {pattern!r} is not a regular expression: {problem}") from problem


def _parser() -> Any:
    """The parser of `re`."""
    return vars(re).get("_parser") or importlib.import_module("sre_parse")  # before Python 3.11


def _repeats(parsed: Any, *, inside: bool) -> tuple[float, int]:
    """Count the repeats of variable and of unlimited length; infinite if one is ``inside`` of an unlimited one."""
    variable, unlimited = 0.0, 0
    for code, value in parsed:
        name, times = str(code), 1
        if name in ("MAX_REPEAT", "MIN_REPEAT"):
            least, most, body = value
            is_unlimited = most > max(MAX_REPEATS, least)
            variable += (math.inf if inside else 1) if most > least else 0
            unlimited += is_unlimited
            times = most if most <= MAX_REPEATS else max(least, 1)
            parts: Any = (body,)
            inner = inside or is_unlimited
        else:
            if name == "BRANCH":
                variable += math.inf if inside else 0
                value = value[1]
            parts = [
                part for part in (value if isinstance(value, (tuple, list)) else (value,)) if hasattr(part, "data")
            ]
            inner = inside
        for part in parts:
            more, endless = _repeats(part, inside=inner)
            variable += more * times
            unlimited += endless * times
    return variable, unlimited


@internal(".replace", 4, binds=True)
def replace(engine: Any, args: Args, trail: Trail) -> bool:
    """``.replace(S, Pattern, By, R)``: R is S with each match of a regular expression replaced; ``$1`` is a group."""
    text, what, by = text_of(".replace", args[0]), resolve(args[1]), resolve(args[2])
    if not isinstance(what, str) or not isinstance(by, str):
        raise wrong(".replace", by if isinstance(what, str) else what, "a string")
    template = re.sub(r"\\(.)|\$(\d)|[\\$]", _group, by, flags=re.DOTALL)
    try:
        return gives(args[3], replaced(".replace", what, template, text), trail)
    except IndexError as problem:
        raise Failed("wrong_arguments", f".replace: {by!r} cannot replace {what!r}: {problem}") from problem


def _group(match: re.Match[str]) -> str:
    """Translate an escape or a group of a replacement from Java's notation."""
    if match[1] is not None:
        return "\\\\" if match[1] == "\\" else match[1]
    if match[2] is not None:
        return f"\\g<{match[2]}>"
    raise Failed("wrong_arguments", f".replace: write \\\\{match[0]} for a plain {match[0]}")


@internal(".term2string", 2)
def term2string(engine: Any, args: Args, trail: Trail) -> bool:
    """``.term2string(T, S)``: S is the text of the term T; binds T or S. A text that is no term gives an atom."""
    term, text = resolve(args[0]), resolve(args[1])
    if term.__class__ is not Var:
        return gives(text, spelled(term), trail)
    if text.__class__ is Var:
        raise wrong(".term2string", text, "a term or a string")
    return gives(term, read_term(engine, said(text)), trail)


def read_term(engine: Any, text: str) -> Any:
    """Parse and compute a term or a condition; the atom of a text that is neither."""
    from socialbot.bdi.agentspeak.loading import _computed  # it imports this package

    try:
        return opened(parse_term(text, "<text>"), compute=lambda term: _computed(engine, term))
    except AgentSpeakError:
        pass
    try:
        condition = parse_condition(text, "<text>")
    except AgentSpeakError:
        return Atom(text)
    return condition.terms[0] if len(condition.terms) == 1 else condition
