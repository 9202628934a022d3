"""Registry of internal actions such as ``.print``, and access to their arguments."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

from socialbot.bdi.intentions import Failed
from socialbot.bdi.literals import Event, Literal, literal
from socialbot.bdi.terms import Atom, Call, Cons, Expression, LiteralVariable, Rest, Variable, show
from socialbot.bdi.unification import Trail, Var, closed, cons, resolve, undo, unify


@dataclass(frozen=True)
class Internal:
    """Internal action: ``function(engine, args, trail)``.

    The function returns its success (None counts as true), or an iterator over solutions with ``many``, or perhaps a
    `Pause` with ``pauses``. Unbound variables in ``args`` are `Var`; ``binds`` promises to bind them all. An ``aware``
    action inspects intentions, so its plan must run on one.
    """

    function: Callable[..., Any]
    arity: tuple[int, int]
    many: bool = False
    pauses: bool = False
    binds: bool = False
    aware: bool = False


T = TypeVar("T", bound=Callable[..., Any])

INTERNALS: dict[str, Internal] = {}
"""Internal actions by dotted name."""


def internal(name: str, least: int, most: int | None = None, **options: bool) -> Callable[[T], T]:
    """Register a function as an internal action with ``least`` to ``most`` arguments and options of `Internal`."""

    def register(function: T) -> T:
        INTERNALS[name] = Internal(function, (least, least if most is None else most), **options)
        return function

    return register


Args = tuple[Any, ...]


def wrong(name: str, term: object, expected: str) -> Failed:
    """Return the failure for an argument of the wrong type."""
    shown = f"but {term} has no value" if term.__class__ is Var else f"not {show(term)}"
    return Failed("wrong_arguments", f"{name} expects {expected}, {shown}")


def number_of(name: str, term: Any) -> float:
    """Evaluate a number. Raises Failed for any other term."""
    term = resolve(term)
    if not is_number(term):
        raise wrong(name, term, "a number")
    return term


def integer_of(name: str, term: Any) -> int:
    """Evaluate a number, without its fraction. Raises Failed for any other term."""
    term = resolve(term)
    if not is_number(term) or not math.isfinite(term):
        raise wrong(name, term, "a number")
    return int(term)


class Collection(ABC):
    """Mutable value of AgentSpeak: a set, a map or a queue. Equal ones have the same kind and items."""

    kind = ""
    used: ClassVar[bool] = False
    """Whether a collection was ever made; messages need no search for them before."""

    def __new__(cls, *args: Any, **named: Any) -> Any:
        Collection.used = True
        return super().__new__(cls)

    @abstractmethod
    def items(self) -> Args:
        """Items in order."""

    def copy(self) -> Collection:
        return type(self)(self.items())  # type: ignore[call-arg]

    def __len__(self) -> int:
        return len(self.items())

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.items() == other.items()  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash(type(self))  # items may change


def items_of(name: str, term: Any) -> Args:
    """Return the items of a list, set or queue. Raises Failed for any other term."""
    term = resolve(term)
    if isinstance(term, Collection) and term.kind != "map":
        return term.items()
    if not isinstance(term, tuple):
        raise wrong(name, term, "a list")
    return term


def name_of(name: str, term: Any) -> str:
    """Return the text of an atom or a string. Raises Failed for any other term."""
    term = resolve(term)
    if isinstance(term, Atom):
        return term.name
    if not isinstance(term, str):
        raise wrong(name, term, "a name")
    return term


def literal_of(name: str, term: Any) -> Literal:
    """Convert a term to a literal; atoms have no arguments. Raises Failed for any other term."""
    term = resolve(term)
    if isinstance(term, Atom):
        return literal(term.name)
    if not isinstance(term, Literal):
        raise wrong(name, term, "a literal")
    return term


def each_of(term: Any) -> Args:
    """Return the items of a list, or a tuple of any other term."""
    term = resolve(term)
    return term if term.__class__ is tuple else (term,)


def is_number(term: object) -> bool:
    """Check whether a term is a number; booleans are not."""
    return isinstance(term, (int, float)) and not isinstance(term, bool)


def gives(term: Any, value: Any, trail: Trail) -> bool:
    """Unify a term with a value; a failure binds nothing."""
    mark = len(trail)
    if unify(term, value, trail):
        return True
    undo(trail, mark)
    return False


def each(term: Any, values: Iterable[Any], trail: Trail) -> Iterator[None]:
    """Unify a term with each of several values in turn."""
    mark = len(trail)
    for value in values:
        if unify(term, value, trail):
            yield
        undo(trail, mark)


def opened(term: Any, variables: dict[Any, Var] | None = None, compute: Callable[[Any], Any] | None = None) -> Any:
    """Copy a term with a fresh `Var` for each variable.

    Args:
        term: Term of a plan, or value that may have unbound variables.
        variables: Fresh variables by name (of a plan) or by the variable they replace.
        compute: Evaluates expressions and function calls; without it they raise Failed.
    """
    variables = {} if variables is None else variables
    if isinstance(term, Variable):
        return Var() if term.name == "_" else variables.setdefault(term.name, Var(term.name))
    if term.__class__ is Var:
        return variables.setdefault(term, Var(term.name))
    if isinstance(term, tuple):
        return tuple(opened(item, variables, compute) for item in term)
    if isinstance(term, Cons):
        return cons(opened(term.items, variables, compute), opened(term.tail, variables, compute))
    if isinstance(term, (Expression, Call)):
        if compute is None:
            raise Failed("wrong_arguments", f"{term!s} is an expression, where a value is required")
        return compute(term)
    if isinstance(term, Literal):
        args, notes = opened(term.args, variables, compute), opened(term.annotations, variables, compute)
        return term.with_(args=args, annotations=notes)
    if isinstance(term, Event):
        return Event(term.change, opened(resolve(term.literal), variables, compute), term.seconds)
    if isinstance(term, LiteralVariable):
        variable = opened(resolve(term.variable), variables, compute)
        namespace = opened(resolve(term.namespace), variables, compute)
        return LiteralVariable(variable, opened(term.annotations, variables, compute), term.negated, namespace)
    if isinstance(term, Rest):
        return Rest(opened(resolve(term.tail), variables, compute))
    return term.copy() if isinstance(term, Collection) else term


def detached(term: Any) -> Any:
    """Copy a value with fresh unbound variables; a set, map or queue is copied, too."""
    term = resolve(term)
    shared = closed(term) and not isinstance(term, Event) and not (Collection.used and _has_collection(term))
    return term if shared else opened(term)


def _has_collection(term: Any) -> bool:
    if isinstance(term, tuple):
        return any(map(_has_collection, term))
    return isinstance(term, Collection) or (isinstance(term, Literal) and _has_collection(term.args))
