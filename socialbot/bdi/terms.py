"""Terms: values of beliefs, goals and actions, and the variables and expressions of plans.

Values are numbers, strings, atoms, tuples (AgentSpeak lists), literals without variables, and other hashable objects.
Plans may use variables and expressions instead of values.

>>> X, Y = variables("X Y")
>>> str(X + 1 > Y)
'X + 1 > Y'
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from socialbot.core.errors import RuleError


@functools.total_ordering
class Atom:
    """Symbol, such as ``yes`` in AgentSpeak; it differs from the equally named string."""

    __slots__ = ("name",)
    name: str
    _known: ClassVar[dict[str, Atom]] = {}

    def __new__(cls, name: str) -> Atom:
        atom = cls._known.get(name)
        if atom is None:
            atom = object.__new__(cls)
            object.__setattr__(atom, "name", name)
            atom = cls._known.setdefault(name, atom)
        return atom

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError("an atom never changes")

    def __reduce__(self) -> tuple[type[Atom], tuple[str]]:
        return Atom, (self.name,)

    def __lt__(self, other: object) -> bool:
        return self is not other and order(self) < order(other)

    def __str__(self) -> str:
        return self.name

    def __repr__(self) -> str:
        return f"Atom({self.name!r})"


class Pattern:
    """Base class of expressions with variables."""

    def __repr__(self) -> str:
        return str(self)

    def names(self) -> set[str]:
        return names_in(tuple(vars(self).values()))


def _arithmetic(symbol: str) -> tuple[Callable[[Term, object], Expression], Callable[[Term, object], Expression]]:
    """Operator methods of a term, as left and as right operand."""
    return (lambda term, other: Expression(symbol, term, other)), (lambda term, other: Expression(symbol, other, term))


def _comparison(symbol: str) -> Callable[[Term, object], Comparison]:
    return lambda term, other: Comparison(symbol, term, other)


class Term(Pattern):
    """Expression for a value that is unknown until a plan runs."""

    __add__, __radd__ = _arithmetic("+")
    __sub__, __rsub__ = _arithmetic("-")
    __mul__, __rmul__ = _arithmetic("*")
    __truediv__, __rtruediv__ = _arithmetic("/")
    __floordiv__, __rfloordiv__ = _arithmetic("//")
    __mod__, __rmod__ = _arithmetic("%")
    __pow__, __rpow__ = _arithmetic("**")
    __gt__, __ge__ = _comparison(">"), _comparison(">=")
    __lt__, __le__ = _comparison("<"), _comparison("<=")
    __eq__, __ne__ = _comparison("=="), _comparison("!=")  # type: ignore[assignment]

    def __neg__(self) -> Expression:
        return Expression("-", 0, self)

    __hash__ = object.__hash__


class Variable(Term):
    """Logical variable; ``Variable("_")`` matches anything and binds nothing."""

    def __init__(self, name: str) -> None:
        if not name.isidentifier():
            raise RuleError(f"{name!r} is not a variable name", remedy="use letters, digits and _")
        self.name = name

    def names(self) -> set[str]:
        return {self.name}

    def __str__(self) -> str:
        return self.name


@dataclass(eq=False, repr=False)
class Expression(Term):
    """Arithmetic expression of two terms; ``symbol`` is ``+ - * / // % **``, ``div`` or ``mod``.

    ``//`` and ``%`` round down, as in Python; ``div`` and ``mod`` round towards zero, as in AgentSpeak.
    """

    symbol: str
    left: object
    right: object

    def __str__(self) -> str:
        return f"{_part(self.left)} {self.symbol} {_part(self.right)}"


class Call(Term):
    """AgentSpeak function in arithmetic, such as ``math.max(X, 3)`` or ``.length(L)``."""

    def __init__(self, function: str, *args: object) -> None:
        self.function = function
        self.args = args

    def __str__(self) -> str:
        return f"{self.function}({', '.join(map(show, self.args))})"


@dataclass(eq=False, repr=False)
class Cons(Term):
    """List pattern of the first ``items`` and the ``tail``: ``[H1, H2 | T]``."""

    items: tuple[object, ...]
    tail: object

    def __str__(self) -> str:
        return f"[{', '.join(map(show, self.items))} | {show(self.tail)}]"


class Condition(Pattern):
    """Base class of conditions; a belief as a condition holds if a matching belief is held."""

    def __and__(self, other: object) -> Conjunction:
        return conjunction(self, other)

    def __rand__(self, other: object) -> Conjunction:
        return conjunction(other, self)

    def __or__(self, other: object) -> Disjunction:
        return Disjunction((conjunction(self), conjunction(other)))

    def __ror__(self, other: object) -> Disjunction:
        return Disjunction((conjunction(other), conjunction(self)))

    def __invert__(self) -> Negation:
        return Negation(self)

    def __rshift__(self, body: object) -> Any:
        raise RuleError(
            f"{self} alone is not an event",
            remedy=f"write +{self} or -{self}; put conditions in parentheses: event / (a & b) >> [...]",
        )


@dataclass(eq=False, repr=False)
class Comparison(Condition):
    """Comparison of two terms; ``symbol`` is ``> >= < <= == !=``, ``=`` (unifies) or ``=..`` (decomposes a literal)."""

    symbol: str
    left: object
    right: object

    def __rshift__(self, body: object) -> None:
        raise RuleError(f"{self} alone is not a plan", remedy="put conditions in parentheses: event / (a & b) >> [...]")

    def __bool__(self) -> bool:
        raise RuleError(
            f"{self} has no truth value outside a rule", remedy="join conditions with & and put each in parentheses"
        )

    def __str__(self) -> str:
        return f"{show(self.left)} {self.symbol} {show(self.right)}"


def variables(names: str) -> tuple[Variable, ...]:
    """Create variables from their names, separated by blanks."""
    return tuple(Variable(name) for name in names.split())


def names_in(term: object) -> set[str]:
    """Names of the variables in a term or in a tuple of terms."""
    if isinstance(term, tuple):
        found: set[str] = set()
        for item in term:
            found |= names_in(item)
        return found
    return term.names() if isinstance(term, Pattern) else set()


def order(term: object) -> tuple[object, ...]:
    """Sort key of any term: numbers, strings, lists, atoms and literals (by arity), then other objects."""
    if isinstance(term, (int, float)):
        return (0, term)
    if isinstance(term, str):
        return (1, term)
    if isinstance(term, tuple):
        return (2, *map(order, term))
    if isinstance(term, Atom):
        return (3, 0, term.name)
    args = getattr(term, "args", None)
    if isinstance(args, tuple):
        return (3, len(args), str(getattr(term, "functor", "")), *map(order, args))
    return (4, str(term))


def show(term: object) -> str:
    """Text of a term in AgentSpeak notation: strings in double quotes, lists in brackets."""
    if isinstance(term, str):
        return '"' + term.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
    if isinstance(term, tuple):
        return f"[{', '.join(map(show, term))}]"
    return str(term)


def _part(term: object) -> str:
    return f"({term})" if isinstance(term, Expression) else show(term)


@dataclass(eq=False, repr=False)
class Negation(Condition):
    """Negation as failure: it holds if the inner condition has no solution."""

    condition: Condition

    def __str__(self) -> str:
        joined = isinstance(self.condition, (Conjunction, Disjunction))
        return f"~({self.condition})" if joined else f"~{self.condition}"


class FunctionCondition(Condition):
    """Python function as a condition; its parameters are named like the variables it takes."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.parameters = tuple(inspect.signature(function).parameters)

    def names(self) -> set[str]:
        return set(self.parameters)

    def __str__(self) -> str:
        name = getattr(self.function, "__name__", type(self.function).__name__)
        return f"{name}({', '.join(self.parameters)})"


@dataclass(eq=False, repr=False)
class Truth(Condition):
    """Constant condition ``true`` or ``false``."""

    value: bool

    def __str__(self) -> str:
        return "true" if self.value else "false"


@dataclass(eq=False, repr=False)
class Conjunction(Condition):
    """Conditions that must all hold, tried from left to right."""

    terms: tuple[Condition, ...]

    def __str__(self) -> str:
        return " & ".join(
            f"({term})" if isinstance(term, (Comparison, Disjunction)) else str(term) for term in self.terms
        )


@dataclass(eq=False, repr=False)
class Disjunction(Condition):
    """Conditions of which one must hold, tried from left to right."""

    terms: tuple[Condition, ...]

    def __or__(self, other: object) -> Disjunction:
        return Disjunction((*self.terms, conjunction(other)))

    def __str__(self) -> str:
        return " | ".join(f"({term})" if isinstance(term, Conjunction) and len(term.terms) > 1 else str(term)
                          for term in self.terms)  # fmt: skip


NOTHING = Conjunction(())
"""Empty condition, which always holds."""


def conjunction(*parts: object) -> Conjunction:
    """Join conditions. Raises RuleError for other objects."""
    terms: list[Condition] = []
    for part in parts:
        if isinstance(part, Conjunction):
            terms.extend(part.terms)
        elif isinstance(part, Disjunction) and len(part.terms) == 1:
            terms.append(part.terms[0])
        elif isinstance(part, Condition):
            terms.append(part)
        elif callable(part) and not isinstance(part, type):
            terms.append(FunctionCondition(part))
        else:
            raise RuleError(
                f"{part!r} cannot be a condition",
                remedy="use beliefs, ~beliefs, comparisons of variables or functions, joined with &",
            )
    return Conjunction(tuple(terms))
