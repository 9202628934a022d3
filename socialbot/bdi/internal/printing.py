"""``.print``, and how AgentSpeak spells terms."""

from __future__ import annotations

from typing import Any

from socialbot.bdi.events import Event
from socialbot.bdi.internals import internal
from socialbot.bdi.literals import Literal
from socialbot.bdi.plans import Plan
from socialbot.bdi.terms import Atom, Cons
from socialbot.bdi.unification import Trail, Var, resolve


@internal(".print", 0, 100)
def print_(engine: Any, args: tuple[Any, ...], trail: Trail) -> None:
    """``.print(a1, ..., an)``: prints its arguments, without anything between them."""
    engine.say("".join(map(said, args)))


internal(".println", 0, 100)(print_)


def said(term: Any) -> str:
    """A term as it is printed: strings and names without quotes, unless they are part of something."""
    term = resolve(term)
    if isinstance(term, str):
        return term
    if term.__class__ is Atom:
        return term.name
    if term.__class__ is Var:
        return f"{term}<no-value>"
    return spelled(term)


def spelled(term: Any) -> str:
    """A term in AgentSpeak, spelled as Jason does: without blanks, whole numbers without a fraction."""
    if term.__class__ is Atom:
        return _name(term.name)
    if isinstance(term, str):
        return f'"{term}"'
    if isinstance(term, bool) or term is None:
        return str(term).lower()
    if isinstance(term, float):
        return str(int(term)) if term.is_integer() and abs(term) < 1e16 else repr(term)
    if term.__class__ is tuple:
        return f"[{','.join(map(spelled, term))}]"
    if term.__class__ is Cons:
        return f"[{','.join(map(spelled, term.items))}|{spelled(term.tail)}]"
    if isinstance(term, Literal):
        return _literal(term)
    if isinstance(term, (Plan, Event)):
        from socialbot.bdi.agentspeak.printer import agentspeak

        return (
            agentspeak(term) if isinstance(term, Plan) else f"{{{term.change.value}{spelled(resolve(term.literal))}}}"
        )
    return str(term)


def _literal(term: Literal) -> str:
    args = f"({','.join(map(spelled, term.args))})" if term.args else ""
    notes = f"[{','.join(sorted(map(spelled, term.annotations)))}]" if term.annotations else ""
    return f"{'~' if term.negated else ''}{_name(term.functor)}{args}{notes}"


def _name(name: str) -> str:
    if name.isidentifier() and name[0].islower():
        return name
    from socialbot.bdi.agentspeak.printer import agentspeak

    return agentspeak(Atom(name))
