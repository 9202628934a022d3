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
from collections.abc import Callable, Collection, Iterator
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


class Name(str):
    """Name of an agent, a performative or a reason in a rule: a string that also equals the atom of this name."""

    __slots__ = ()
    __hash__ = str.__hash__

    def __eq__(self, other: object) -> bool:
        return str.__eq__(self, other.name if other.__class__ is Atom else other)  # type: ignore[attr-defined]

    def __ne__(self, other: object) -> bool:
        return not self == other


class Pattern:
    """Base class of expressions with variables."""

    def __repr__(self) -> str:
        return str(self)

    def __bool__(self) -> bool:
        raise RuleError(
            f"{self!s} has no truth value outside a rule",
            remedy="join conditions with & (and), | (or) and ~ (not), each in parentheses; "
            "choose steps with when(condition, [...], [...]); compare objects with `is None`",
        )

    def names(self) -> set[str]:
        return names_in(tuple(vars(self).values()))

    def same_text(self, other: Pattern) -> bool:
        """Whether another expression is written alike; two conditions or bodies as terms are equal then."""
        return str(self) == str(other)


class Quoted(Pattern):
    """Condition or steps, which are equal, also as parts of other terms, if they are written alike."""

    def __eq__(self, other: object) -> bool:
        return self is other or (self.__class__ is other.__class__ and self.same_text(other))  # type: ignore[arg-type]

    def __hash__(self) -> int:
        return hash(str(self))


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

    def _unjoined(self, *_: object) -> Any:
        raise RuleError(
            f"{self!s} is a value, not a condition", remedy="put each comparison in parentheses: b(X) & (X > 3)"
        )

    __and__ = __rand__ = __or__ = __ror__ = __invert__ = _unjoined

    def __format__(self, spec: str) -> str:
        raise RuleError(
            f"{self!s} has no value when the text is formatted",
            remedy="pass it as an argument of its own, or compute the text in the plan: "
            'compute(lambda X: f"... {X} ...")',
        )

    def _unknown(self, *_: object) -> Any:
        raise RuleError(
            f"{self!s} has no value when the rule is made",
            remedy="compute with it in the plan: compute(lambda X: abs(X)), or a function as a condition",
        )

    __int__ = __float__ = __index__ = __abs__ = __round__ = __getitem__ = _unknown

    def __contains__(self, item: object) -> bool:
        raise RuleError(f"{self!s} is no collection when the rule is made", remedy="use a function as a condition")


class Variable(Term):
    """Logical variable; ``Variable("_")`` matches anything and binds nothing.

    ``alone`` marks the result of `variables` for a single name, which can be unpacked.
    """

    alone = False

    def __init__(self, name: str) -> None:
        if not name.isidentifier():
            raise RuleError(f"{name!r} is not a variable name", remedy="use letters, digits and _, separated by blanks")
        self.name = name

    def __iter__(self) -> Iterator[Variable]:
        """Iterate over this variable alone, so that ``(K,) = variables("K")`` is ``K = variables("K")``."""
        if not self.alone:
            raise RuleError(f"{self!s} is a variable, not a list", remedy="use for_each(condition, [...]) in the plan")
        return iter((self,))

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

    predicate = ""
    """Rule that computes the function, without its last argument, which is the value; '' for a function in Python."""

    def __init__(self, function: str, *args: object) -> None:
        self.function = function
        self.args = args

    def __str__(self) -> str:
        return f"{self.function}({', '.join(map(show, self.args))})"


class Computation(Term):
    """Value that a Python function computes from the variables that its parameters name."""

    def __init__(self, function: Callable[..., Any]) -> None:
        if not callable(function) or isinstance(function, type):
            raise RuleError(f"{function!r} is not a function", remedy='write compute(lambda X: f"... {X} ...")')
        self.function = function
        self.parameters = _without_default(function)

    def names(self) -> set[str]:
        return set(self.parameters)

    def __str__(self) -> str:
        return f"compute({_call_of(self.function, self.parameters)})"


class OwnName(Term):
    """Name of the agent that executes the plan, a string."""

    def __str__(self) -> str:
        return "my_name()"


class Aggregate(Term):
    """Value of all solutions of a condition: ``count``, ``findall``, ``min_of``, ``max_of`` or ``sum_of``.

    Variables without a value before it are its own.
    """

    def __init__(self, kind: str, template: object, condition: Condition) -> None:
        self.kind = kind
        self.template = template
        self.condition = condition

    def names(self) -> set[str]:
        return (names_in(self.template) | self.condition.names()) - {"_"}

    def __str__(self) -> str:
        return f"{self.kind}({self.arguments()})"

    def arguments(self) -> str:
        """Text of the arguments."""
        condition = written_condition(self.condition)
        return condition if self.kind == "count" else f"{show(self.template)}, {condition}"


@dataclass(eq=False, repr=False)
class Cons(Term):
    """List pattern of the first ``items`` and the ``tail``: ``[H1, H2 | T]``."""

    items: tuple[object, ...]
    tail: object

    def __str__(self) -> str:
        return f"[{', '.join(map(show, self.items))} | {show(self.tail)}]"


@dataclass(eq=False, repr=False)
class LiteralVariable(Term):
    """Variable for a literal with annotations, ``X[source(S)]``, for a negated one, ``~X``, or ``Namespace::X``.

    The namespace is an atom or a variable. With a variable, ``variable`` may be a literal: ``Namespace::at(X)``.
    """

    variable: object
    annotations: tuple[object, ...] = ()
    negated: bool = False
    namespace: object = None

    def __str__(self) -> str:
        notes = f"[{', '.join(map(show, self.annotations))}]" if self.annotations else ""
        namespace = "" if self.namespace is None else f"{show(self.namespace)}::"
        return f"{namespace}{'~' if self.negated else ''}{show(self.variable)}{notes}"


@dataclass(eq=False, repr=False)
class Rest(Term):
    """Remaining annotations, such as ``T`` in ``p(X)[a|T]``; always the last one of the annotations."""

    tail: object

    def __str__(self) -> str:
        return f"|{show(self.tail)}"


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
class Comparison(Quoted, Condition):
    """Comparison of two terms; ``symbol`` is ``> >= < <= == !=``, ``=`` (unifies) or ``=..`` (decomposes a literal)."""

    symbol: str
    left: object
    right: object

    def __rshift__(self, body: object) -> None:
        raise RuleError(f"{self} alone is not a plan", remedy="put conditions in parentheses: event / (a & b) >> [...]")

    def binds(self) -> bool:
        """Whether it gives a variable the value of an aggregate, or the name of the agent."""
        return self.symbol == "=" and isinstance(self.right, (Aggregate, OwnName))

    def __str__(self) -> str:
        if self.binds():
            given = f"{self.right.arguments()}, " if isinstance(self.right, Aggregate) else ""
            name = self.right.kind if isinstance(self.right, Aggregate) else "my_name"
            return f"{name}({given}{show(self.left)})"
        return f"{show(self.left)} {self.symbol} {show(self.right)}"


def variables(*names: str) -> Any:
    """Create variables from names, which may also be separated by blanks.

    >>> K = variables("K")
    >>> X, Y = variables("X Y")

    Returns:
        The `Variable` of one name; otherwise a tuple of variables.

    Raises:
        RuleError: A name is not valid or given twice.
    """
    parts = " ".join(names).split()
    if len(set(parts)) < len(parts):
        raise RuleError(f"variables({' '.join(names)!r}) needs different names", remedy='write X, Y = variables("X Y")')
    made = tuple(map(Variable, parts))
    if len(made) != 1:
        return made
    made[0].alone = True
    return made[0]


def names_in(term: object) -> set[str]:
    """Names of the variables in a term or in a tuple of terms."""
    if isinstance(term, tuple):
        found: set[str] = set()
        for item in term:
            found |= names_in(item)
        return found
    return term.names() if isinstance(term, Pattern) else set()


def order(term: object) -> tuple[object, ...]:
    """Sort key of any term, as in Jason: numbers, strings, lists, atoms and literals, then other objects.

    Literals are ordered by name, strong negation, arguments and annotations.
    """
    if isinstance(term, (int, float)):
        return (0, term)
    if isinstance(term, str):
        return (1, term)
    if isinstance(term, tuple):
        return (2, tuple(map(order, term)))
    if isinstance(term, Atom):
        return (3, term.name, False, (), ())
    args = getattr(term, "args", None)
    if isinstance(args, tuple):
        notes = tuple(sorted(map(order, getattr(term, "annotations", ()))))
        return (3, str(getattr(term, "functor", "")), getattr(term, "negated", False), tuple(map(order, args)), notes)
    return (4, str(term))


def by_order(items: Collection[Any]) -> Collection[Any]:
    """Return annotations in the order of terms, in which Jason keeps them."""
    if len(items) < 2:
        return items
    in_order = getattr(items, "in_order", None)  # of many annotations of a belief
    return sorted(items, key=order) if in_order is None else in_order()


def show(term: object) -> str:
    """Text of a term in AgentSpeak notation: strings in double quotes, lists in brackets."""
    if isinstance(term, str):
        return '"' + term.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
    if isinstance(term, tuple):
        return f"[{', '.join(map(show, term))}]"
    return str(term)


def _part(term: object) -> str:
    return f"({term!s})" if isinstance(term, Expression) else show(term)


@dataclass(eq=False, repr=False)
class Negation(Quoted, Condition):
    """Negation as failure: it holds if the inner condition has no solution."""

    condition: Condition

    def __str__(self) -> str:
        joined = isinstance(self.condition, (Conjunction, Disjunction))
        return f"~({self.condition})" if joined else f"~{self.condition}"


class FunctionCondition(Condition):
    """Python function as a condition; its parameters are named like the variables it takes."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.parameters = _without_default(function)

    def names(self) -> set[str]:
        return set(self.parameters)

    def __str__(self) -> str:
        return _call_of(self.function, self.parameters)


def _without_default(function: Callable[..., Any]) -> tuple[str, ...]:
    """Names of the parameters of a function that have no default."""
    parameters = inspect.signature(function).parameters.values()
    return tuple(parameter.name for parameter in parameters if parameter.default is parameter.empty)


def _call_of(function: Callable[..., Any], parameters: tuple[str, ...]) -> str:
    return f"{getattr(function, '__name__', type(function).__name__)}({', '.join(parameters)})"


@dataclass(eq=False, repr=False)
class Holds(Condition):
    """Condition that is the value of a variable."""

    what: object

    def __str__(self) -> str:
        return show(self.what)


@dataclass(eq=False, repr=False)
class Truth(Condition):
    """Constant condition ``true`` or ``false``."""

    value: bool

    def __str__(self) -> str:
        return "true" if self.value else "false"


@dataclass(eq=False, repr=False)
class Conjunction(Quoted, Condition):
    """Conditions that must all hold, tried from left to right."""

    terms: tuple[Condition, ...]

    def __str__(self) -> str:
        return " & ".join(f"({term})" if _joins(term) else str(term) for term in self.terms)


def _joins(condition: Condition) -> bool:
    """Whether the text of a condition has an operator that binds less tightly than ``&``."""
    return isinstance(condition, Disjunction) or (isinstance(condition, Comparison) and not condition.binds())


def written_condition(condition: object) -> str:
    """Text of a condition as an argument, where a single one needs no parentheses."""
    alone = isinstance(condition, Conjunction) and len(condition.terms) == 1
    return str(condition.terms[0] if alone else condition)  # type: ignore[attr-defined]


@dataclass(eq=False, repr=False)
class Disjunction(Quoted, Condition):
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
        elif isinstance(part, Term):
            part._unjoined()
        elif callable(part) and not isinstance(part, type):
            terms.append(FunctionCondition(part))
        else:
            use = "use beliefs, ~beliefs, comparisons of variables or functions, joined with &"
            remedy = f"write {part.__name__}(), with its arguments" if isinstance(part, type) else use
            raise RuleError(f"{part!r} cannot be a condition", remedy=remedy)
    return Conjunction(tuple(terms))
