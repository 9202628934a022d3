"""Internal actions on strings. Other terms stand for what they are printed as."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from socialbot.bdi.failures import Failed
from socialbot.bdi.internal.arguments import each, gives, opened, wrong
from socialbot.bdi.internal.printing import said, spelled
from socialbot.bdi.internals import internal
from socialbot.bdi.unification import Trail, Var, resolve

Args = tuple[Any, ...]


@internal(".substring", 2, 4, many=True, binds=True)
def substring(engine: Any, args: Args, trail: Trail) -> Iterator[None]:
    """``.substring(Part, Whole, Begin, End)``: Part is in Whole from Begin to before End; all places are tried."""
    part, whole = _text(".substring", args[0]), _text(".substring", args[1])
    places = (at for at in range(len(whole) - len(part) + 1) if whole.startswith(part, at))
    if len(args) == 2:
        yield from each(0, [0] if part in whole else [], trail)
    elif len(args) == 3:
        yield from each(args[2], places, trail)
    else:
        yield from each((args[2], args[3]), ((at, at + len(part)) for at in places), trail)


@internal(".lower_case", 2, binds=True)
def lower_case(engine: Any, args: Args, trail: Trail) -> bool:
    """``.lower_case(S, R)``: R is S in small letters."""
    return gives(args[1], _text(".lower_case", args[0]).lower(), trail)


@internal(".upper_case", 2, binds=True)
def upper_case(engine: Any, args: Args, trail: Trail) -> bool:
    """``.upper_case(S, R)``: R is S in capital letters."""
    return gives(args[1], _text(".upper_case", args[0]).upper(), trail)


@internal(".term2string", 2)
def term2string(engine: Any, args: Args, trail: Trail) -> bool:
    """``.term2string(T, S)``: S is what the term T is written as; gives a value to T or to S."""
    term, text = resolve(args[0]), resolve(args[1])
    if term.__class__ is not Var:
        return gives(text, spelled(term), trail)
    if not isinstance(text, str):
        raise wrong(".term2string", text, "a term or a string")
    from socialbot.bdi.agentspeak import AgentSpeakError, parse_term

    try:
        return gives(term, opened(parse_term(text, "<.term2string>")), trail)
    except AgentSpeakError as problem:
        raise Failed("wrong_arguments", f'.term2string: "{text}" is no term') from problem


def _text(name: str, term: Any) -> str:
    term = resolve(term)
    if term.__class__ is Var:
        raise wrong(name, term, "a value")
    return said(term)
