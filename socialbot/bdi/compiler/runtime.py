"""What generated code calls."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from socialbot.bdi.events import Event
from socialbot.bdi.failures import Failed
from socialbot.bdi.literals import SELF, Literal, literal
from socialbot.bdi.terms import Atom, Cons, order
from socialbot.bdi.unification import Trail, Var, annotations_match, closed, cons, resolve, undo, unify

FILENAME = "<plan>"
"""What the names of generated files begin with; a traceback shows no lines of a file that ends with ``>``."""

SUBGOAL, TAIL, EVENT, OPEN = 0, 1, 2, 4
"""What a body asks for: a goal; a goal as its last step; plans for an event it made; and (added) with variables."""

DONE = object()
"""Told by a plan that is done already."""

END = object()
"""Told by a body that has ended."""


def known(term: Any) -> Any:
    """The value of a term. Raises Failed when it has none."""
    value = resolve(term)
    if not closed(value):
        raise Failed("no_value", f"{value} has no value")
    return value


def renew(cell: Any) -> Any:
    """A variable without a value made anew; anything else as it is."""
    cell = resolve(cell)
    return Var(cell.name) if cell.__class__ is Var else cell


def holds(solutions: Iterator[Any], trail: Trail) -> bool:
    """Whether there is a solution; binds nothing."""
    mark = len(trail)
    found = next(solutions, None) is not None
    undo(trail, mark)
    return found


def div(left: Any, right: Any) -> int:
    """Integer division towards zero."""
    quotient = abs(math.trunc(left)) // abs(math.trunc(right))
    return quotient if (left >= 0) == (right >= 0) else -quotient


def mod(left: Any, right: Any) -> Any:
    """The remainder, with the sign of the dividend."""
    rest = math.fmod(left, right)
    return int(rest) if rest.is_integer() else rest


def univ(term: Any, parts: Any, trail: Trail) -> bool:
    """``term =.. [name, [args], [annotations]]``."""
    term = resolve(term)
    if term.__class__ is Atom:
        term = literal(term.name)
    if isinstance(term, Literal):
        name = Atom(f"{'~' if term.negated else ''}{term.functor}")
        return unify(parts, (name, term.args, term.annotations), trail)
    parts = resolve(parts)
    if parts.__class__ is not tuple or len(parts) != 3 or parts[0].__class__ is not Atom:
        raise Failed("no_value", f"{term} =.. {parts} leaves both sides open")
    name = parts[0].name
    made = literal(name.removeprefix("~"), parts[1], parts[2], negated=name.startswith("~"))
    return unify(term, made if made.args or made.annotations or made.negated else Atom(name), trail)


NAMES: dict[str, Any] = {
    "Cons": Cons, "DONE": DONE, "Event": Event, "Failed": Failed, "Literal": Literal, "ONCE": (None,), "SELF": SELF,
    "Var": Var, "annotations_match": annotations_match, "closed": closed, "cons": cons, "div": div, "holds": holds,
    "known": known, "literal": literal, "mod": mod, "order": order, "renew": renew, "resolve": resolve, "undo": undo,
    "unify": unify, "univ": univ,
}  # fmt: skip
"""By these names."""
