"""Internal actions on strings and on the text of terms."""

from __future__ import annotations

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


def pattern_of(name: str, text: str) -> re.Pattern[str]:
    """Compile a regular expression. Raises Failed for a wrong one."""
    try:
        return re.compile(text)
    except re.error as problem:
        raise Failed("wrong_arguments", f"{name}: {text!r} is not a regular expression: {problem}") from problem


@internal(".replace", 4, binds=True)
def replace(engine: Any, args: Args, trail: Trail) -> bool:
    """``.replace(S, Pattern, By, R)``: R is S with each match of a regular expression replaced; ``$1`` is a group."""
    text, what, by = text_of(".replace", args[0]), resolve(args[1]), resolve(args[2])
    if not isinstance(what, str) or not isinstance(by, str):
        raise wrong(".replace", by if isinstance(what, str) else what, "a string")
    template = re.sub(r"\\(.)|\$(\d)|[\\$]", _group, by, flags=re.DOTALL)
    try:
        return gives(args[3], pattern_of(".replace", what).sub(template, text), trail)
    except (re.error, IndexError) as problem:
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
