"""Terms: constants, variables, and what can be computed or compared with them.

>>> X, Y = variables("X Y")
>>> str(X + 1 > Y)
'X + 1 > Y'
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import Any

from socialbot.errors import RuleError

Bindings = Mapping[str, Any]
"""What the variables stand for, by name."""

SYMBOLS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    ">": operator.gt, ">=": operator.ge, "<": operator.lt, "<=": operator.le, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip


class Term:
    """What stands for a value that is known only when a rule runs."""

    def names(self) -> set[str]:
        """The variables it needs a value of; ``_`` never has one."""
        raise NotImplementedError

    def value(self, bindings: Bindings) -> Any:
        """Its value under ``bindings``, which hold all its variables."""
        raise NotImplementedError

    def __add__(self, other: object) -> Expression:
        return Expression("+", self, other)

    def __sub__(self, other: object) -> Expression:
        return Expression("-", self, other)

    def __mul__(self, other: object) -> Expression:
        return Expression("*", self, other)

    def __truediv__(self, other: object) -> Expression:
        return Expression("/", self, other)

    def __radd__(self, other: object) -> Expression:
        return Expression("+", other, self)

    def __rsub__(self, other: object) -> Expression:
        return Expression("-", other, self)

    def __rmul__(self, other: object) -> Expression:
        return Expression("*", other, self)

    def __rtruediv__(self, other: object) -> Expression:
        return Expression("/", other, self)

    def __gt__(self, other: object) -> Comparison:
        return Comparison(">", self, other)

    def __ge__(self, other: object) -> Comparison:
        return Comparison(">=", self, other)

    def __lt__(self, other: object) -> Comparison:
        return Comparison("<", self, other)

    def __le__(self, other: object) -> Comparison:
        return Comparison("<=", self, other)

    def __eq__(self, other: object) -> Comparison:  # type: ignore[override]
        return Comparison("==", self, other)

    def __ne__(self, other: object) -> Comparison:  # type: ignore[override]
        return Comparison("!=", self, other)

    __hash__ = object.__hash__


class Variable(Term):
    """A logical variable; ``Variable("_")`` matches anything and binds nothing."""

    def __init__(self, name: str) -> None:
        if not name.isidentifier():
            raise RuleError(f"{name!r} is no name for a variable", remedy="use letters, digits and _")
        self.name = name

    def names(self) -> set[str]:
        return {self.name}

    def value(self, bindings: Bindings) -> Any:
        return bindings[self.name]

    def __str__(self) -> str:
        return self.name

    __repr__ = __str__


class Expression(Term):
    """Arithmetic on two terms."""

    def __init__(self, symbol: str, left: object, right: object) -> None:
        self.symbol = symbol
        self.left = left
        self.right = right

    def names(self) -> set[str]:
        return names_in((self.left, self.right))

    def value(self, bindings: Bindings) -> Any:
        return SYMBOLS[self.symbol](evaluate(self.left, bindings), evaluate(self.right, bindings))

    def __str__(self) -> str:
        return f"{_part(self.left)} {self.symbol} {_part(self.right)}"

    __repr__ = __str__


class Comparison:
    """Two terms compared; it belongs in the condition of a rule."""

    def __init__(self, symbol: str, left: object, right: object) -> None:
        self.symbol = symbol
        self.left = left
        self.right = right

    def names(self) -> set[str]:
        return names_in((self.left, self.right))

    def holds(self, bindings: Bindings) -> bool:
        """Whether it is true under ``bindings``."""
        return bool(SYMBOLS[self.symbol](evaluate(self.left, bindings), evaluate(self.right, bindings)))

    def __rshift__(self, body: object) -> None:
        raise RuleError(f"{self} alone is no rule", remedy="put conditions in parentheses: event / (a & b) >> [...]")

    def __bool__(self) -> bool:
        raise RuleError(
            f"{self} has no truth value outside a rule", remedy="join conditions with & and put each in parentheses"
        )

    def __str__(self) -> str:
        return f"{show(self.left)} {self.symbol} {show(self.right)}"

    __repr__ = __str__


def variables(names: str) -> tuple[Variable, ...]:
    """Makes variables from their names, separated by blanks."""
    return tuple(Variable(name) for name in names.split())


def names_in(terms: tuple[object, ...]) -> set[str]:
    """The variables in some terms."""
    found: set[str] = set()
    for term in terms:
        if isinstance(term, Term):
            found |= term.names()
    return found


def evaluate(term: object, bindings: Bindings) -> Any:
    """The value of a term; a constant is its own value."""
    return term.value(bindings) if isinstance(term, Term) else term


def unify(patterns: tuple[object, ...], values: tuple[object, ...], bindings: Bindings) -> Bindings | None:
    """The bindings under which ``patterns`` equal ``values``, or None when there are none."""
    if len(patterns) != len(values):
        return None
    added: dict[str, Any] = {}
    for pattern, value in zip(patterns, values, strict=True):
        if not isinstance(pattern, Variable):
            if evaluate(pattern, {**bindings, **added}) != value:
                return None
        elif pattern.name != "_":
            known = added.get(pattern.name, bindings.get(pattern.name, value))
            if known is not value and known != value:
                return None
            added[pattern.name] = value
    return {**bindings, **added} if added else bindings


def _part(term: object) -> str:
    return f"({term})" if isinstance(term, Expression) else show(term)


def show(term: object) -> str:
    """A term as a person would write it: strings in double quotes."""
    if isinstance(term, str):
        return '"' + term.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return str(term)
