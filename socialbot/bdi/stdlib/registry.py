"""The registry of internal actions such as ``.print``, and access to their arguments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from socialbot.bdi.intentions import Failed
from socialbot.bdi.literals import Event, Literal, literal
from socialbot.bdi.terms import Atom, Call, Cons, Expression, Variable, show
from socialbot.bdi.unification import Trail, Var, closed, cons, resolve, undo, unify


@dataclass(frozen=True)
class Internal:
    """An internal action: ``function(engine, args, trail)``.

    It returns whether it succeeded (None counts as yes), or, with ``many``, iterates over its solutions; with
    ``pauses`` it may return a `Pause`. Variables in ``args`` are `Var`; ``binds`` promises that all have values then.
    With ``aware`` it looks at intentions: the plan that it is a step of has to be on one.
    """

    function: Callable[..., Any]
    arity: tuple[int, int]
    many: bool = False
    pauses: bool = False
    binds: bool = False
    aware: bool = False


INTERNALS: dict[str, Internal] = {}
"""By name, with the dot."""


def internal(
    name: str,
    least: int,
    most: int | None = None,
    *,
    many: bool = False,
    pauses: bool = False,
    binds: bool = False,
    aware: bool = False,
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Registers a function as an internal action with ``least`` to ``most`` arguments."""

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        INTERNALS[name] = Internal(function, (least, least if most is None else most), many, pauses, binds, aware)
        return function

    return register


Args = tuple[Any, ...]


def wrong(name: str, term: object, expected: str) -> Failed:
    """The failure that an argument is not what was expected."""
    if term.__class__ is Var:
        return Failed("wrong_arguments", f"{name} expects {expected}, but {term} has no value")
    return Failed("wrong_arguments", f"{name} expects {expected}, not {show(term)}")


def number_of(name: str, term: Any) -> float:
    """The value of a number. Raises Failed for anything else."""
    term = resolve(term)
    if not is_number(term):
        raise wrong(name, term, "a number")
    return term


def integer_of(name: str, term: Any) -> int:
    """The value of a whole number, which may be written as 2.0. Raises Failed for anything else."""
    term = resolve(term)
    if not is_number(term) or term != term // 1:
        raise wrong(name, term, "a whole number")
    return int(term)


def items_of(name: str, term: Any) -> Args:
    """The items of a list. Raises Failed for anything else."""
    term = resolve(term)
    if term.__class__ is not tuple:
        raise wrong(name, term, "a list")
    return term


def name_of(name: str, term: Any) -> str:
    """What an atom or a string says. Raises Failed for anything else."""
    term = resolve(term)
    if isinstance(term, Atom):
        return term.name
    if not isinstance(term, str):
        raise wrong(name, term, "a name")
    return term


def literal_of(name: str, term: Any) -> Literal:
    """A literal; a name alone is one without arguments. Raises Failed for anything else."""
    term = resolve(term)
    if isinstance(term, Atom):
        return literal(term.name)
    if not isinstance(term, Literal):
        raise wrong(name, term, "a literal")
    return term


def each_of(term: Any) -> Args:
    """The items of a list, or the one thing that is no list."""
    term = resolve(term)
    return term if term.__class__ is tuple else (term,)


def is_number(term: object) -> bool:
    """Whether a term is a number; True and False are none."""
    return isinstance(term, (int, float)) and not isinstance(term, bool)


def gives(term: Any, value: Any, trail: Trail) -> bool:
    """Makes a term equal to a value, or binds nothing."""
    mark = len(trail)
    if unify(term, value, trail):
        return True
    undo(trail, mark)
    return False


def each(term: Any, values: Iterable[Any], trail: Trail) -> Iterator[None]:
    """The ways to make a term equal to one of several values."""
    mark = len(trail)
    for value in values:
        if unify(term, value, trail):
            yield
        undo(trail, mark)


def opened(term: Any, variables: dict[str, Var] | None = None) -> Any:
    """A term of a text or plan for use at run time: with a fresh `Var` for each variable."""
    variables = {} if variables is None else variables
    if isinstance(term, Variable):
        return Var() if term.name == "_" else variables.setdefault(term.name, Var(term.name))
    if isinstance(term, tuple):
        return tuple(opened(item, variables) for item in term)
    if isinstance(term, Cons):
        return cons(opened(term.items, variables), opened(term.tail, variables))
    if isinstance(term, (Expression, Call)):
        raise Failed("wrong_arguments", f"{term} stands where nothing is computed")
    if isinstance(term, Literal):
        return term.with_(args=opened(term.args, variables), annotations=opened(term.annotations, variables))
    if isinstance(term, Event):
        return Event(term.change, opened(term.literal, variables), term.seconds)
    return term


def detached(term: Any) -> Any:
    """A copy of a term whose variables have no value and are nobody else's."""
    term = resolve(term)
    return term if closed(term) and not isinstance(term, Event) else _detached(term, {})


def _detached(term: Any, variables: dict[Var, Var]) -> Any:
    if term.__class__ is Var:
        return variables.setdefault(term, Var(term.name))
    if term.__class__ is tuple:
        return tuple(_detached(item, variables) for item in term)
    if term.__class__ is Cons:
        return cons(_detached(term.items, variables), _detached(term.tail, variables))
    if isinstance(term, Event):
        return Event(term.change, _detached(resolve(term.literal), variables), term.seconds)
    if isinstance(term, Literal):
        return term.with_(args=_detached(term.args, variables), annotations=_detached(term.annotations, variables))
    return term
