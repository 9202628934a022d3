"""What compiled plans call: unification, failures and arithmetic functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from socialbot.bdi.intentions import Failed
from socialbot.bdi.literals import SELF, Event, Literal, literal
from socialbot.bdi.terms import Atom, Cons, order
from socialbot.bdi.unification import Trail, Var, annotations_match, closed, cons, resolve, undo, unify


def _length(engine: Any, items: Any) -> int:
    if not isinstance(items, (tuple, str)):
        raise Failed("wrong_arguments", f".length of {items}, which is no list and no string")
    return len(items)


def _random(engine: Any, most: float = 1) -> float:
    return engine.random.random() * most


def _time(engine: Any) -> int:
    """The time (ms) of the agent's clock."""
    return engine.clock.now() // 1_000_000


def _plain(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of numbers. What it cannot compute is a failure."""

    def compute(engine: Any, *args: Any) -> Any:
        try:
            return function(*args)
        except (TypeError, ValueError, ArithmeticError) as problem:
            shown = ", ".join(map(str, args))
            raise Failed("wrong_arguments", f"{name}({shown}): {problem}") from problem

    return compute


def _of_all(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of several numbers, which may also come in a list."""
    return _plain(name, lambda *args: function(args[0] if len(args) == 1 and isinstance(args[0], tuple) else args))


def _average(numbers: Any) -> float:
    return sum(numbers) / len(numbers)


def _deviation(numbers: Any) -> float:
    mean = _average(numbers)
    return math.sqrt(sum((number - mean) ** 2 for number in numbers) / (len(numbers) - 1))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    ".length": _length,
    "math.random": _random,
    "system.time": _time,
    **{
        name: _of_all(name, function)
        for name, function in {
            "math.max": max,
            "math.min": min,
            "math.sum": sum,
            "math.average": _average,
            "math.std_dev": _deviation,
        }.items()
    },
    **{
        name: _plain(name, function)
        for name, function in {
            "math.abs": abs,
            "math.round": lambda x: math.floor(x + 0.5),
            "math.floor": math.floor,
            "math.ceil": math.ceil,
            "math.sqrt": math.sqrt,
            "math.sin": math.sin,
            "math.cos": math.cos,
            "math.tan": math.tan,
            "math.asin": math.asin,
            "math.acos": math.acos,
            "math.atan": math.atan,
            "math.log": math.log,
            "math.exp": math.exp,
            "math.pi": lambda: math.pi,
            "math.e": lambda: math.e,
        }.items()
    },
}
"""By name."""


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
