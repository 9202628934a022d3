"""Beliefs, goals and the events about them, with the operators that rules are written in.

Subclass `Belief`, `SingletonBelief`, `Reactor` or `Goal` to make a name of your own::

    class personDetected(SingletonBelief): ...
    class GreetPeople(Goal): ...

``+b`` and ``-b`` are events (or, in a body, changes), ``~b`` is negation, ``b & c`` a conjunction,
``b.held_for(5)`` the event that ``b`` has been held for five seconds.
"""

from __future__ import annotations

import enum
import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from socialbot.bdi.terms import Bindings, Comparison, Variable, evaluate, names_in, show
from socialbot.errors import RuleError

if TYPE_CHECKING:
    from socialbot.bdi.rules import Head, Rule

ANYTHING = Variable("_")

Seconds = float | Callable[[], float]
"""A duration, or a function that tells it when the waiting begins."""


class Literal:
    """A name with arguments; the base of beliefs and goals."""

    def __init__(self, *args: object) -> None:
        self.args = args

    @property
    def functor(self) -> str:
        """The name: that of the class."""
        return type(self).__name__

    @property
    def key(self) -> tuple[str, int]:
        """Name and number of arguments; literals with the same key can match."""
        return self.functor, len(self.args)

    def names(self) -> set[str]:
        """The variables among the arguments."""
        return names_in(self.args)

    def ground(self, bindings: Bindings) -> Any:
        """The same literal with the values of its arguments. Raises RuleError for an unbound variable."""
        unbound = self.names() - bindings.keys()
        if unbound:
            raise RuleError(f"{', '.join(sorted(unbound))} has no value in {self}")
        return type(self)(*(evaluate(arg, bindings) for arg in self.args))

    def bind(self, bindings: Bindings) -> Any:
        """The same with ``_`` left as it is, for a pattern of what to forget."""
        return self.ground({**bindings, "_": ANYTHING})

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.args == other.args  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash((type(self), self.args))

    def __str__(self) -> str:
        return f"{self.functor}({', '.join(map(show, self.args))})"

    __repr__ = __str__


class Belief(Literal):
    """Something the agent holds true. Any number of beliefs of one name can be held."""

    singleton = False

    def held_for(self, seconds: Seconds) -> Held:
        """The event that this has been believed, without a break, for ``seconds``."""
        return Held(self, seconds)

    def __pos__(self) -> Event:
        return Event(Change.ADDED, self)

    def __neg__(self) -> Event:
        return Event(Change.REMOVED, self)

    def __invert__(self) -> Negation:
        return Negation(self)

    def __rshift__(self, body: object) -> None:
        no_rule(self)

    def __and__(self, other: object) -> Conjunction:
        return conjunction(self, other)

    def __rand__(self, other: object) -> Conjunction:
        return conjunction(other, self)


def no_rule(condition: object) -> None:
    """Raises RuleError for a condition that stands where an event belongs."""
    raise RuleError(
        f"{condition} alone is no event",
        remedy=f"an event is written +{condition} or -{condition}; several conditions go in parentheses: "
        "event / (a & b) >> [...]",
    )


class SingletonBelief(Belief):
    """A belief of which one at most is held: a new one takes the place of the old."""

    singleton = True


class Reactor(Belief):
    """An event only: plans react to ``+r``, but it is never held."""


class Goal(Literal):
    """Something the agent wants to achieve. As the head of a rule: how; in a body: do it now."""

    def __neg__(self) -> Event:
        return Event(Change.FAILED, self)

    def __truediv__(self, condition: object) -> Head:
        return Event(Change.WANTED, self) / condition

    def __rshift__(self, body: Iterable[object]) -> Rule:
        return Event(Change.WANTED, self) >> body


class Change(enum.Enum):
    """What can happen to a belief or goal."""

    ADDED = "+"
    REMOVED = "-"
    HELD = "held "
    WANTED = ""
    FAILED = "failed "


@dataclass(frozen=True)
class Event:
    """A change of a belief or goal: the head of a rule, or a step of its body."""

    change: Change
    literal: Literal
    seconds: Seconds = 0.0

    @property
    def key(self) -> tuple[Change, str, int]:
        """By this the engine finds the rules that may react."""
        return (self.change, *self.literal.key)

    def __truediv__(self, condition: object) -> Head:
        from socialbot.bdi.rules import Head

        return Head(self, conjunction(condition))

    def __rshift__(self, body: Iterable[object]) -> Rule:
        return self / Conjunction(()) >> body

    def __str__(self) -> str:
        if self.change is Change.HELD:
            seconds = self.seconds if isinstance(self.seconds, (int, float)) else "..."
            return f"+{self.literal}.held_for({seconds})"
        return f"{'-' if self.change is Change.FAILED else self.change.value}{self.literal}"


@dataclass(frozen=True)
class Held:
    """A belief and how long it has to be held; ``+`` makes the event of it."""

    belief: Belief
    seconds: Seconds

    def __pos__(self) -> Event:
        return Event(Change.HELD, self.belief, self.seconds)


@dataclass(frozen=True)
class Negation:
    """The condition that nothing matching is believed."""

    belief: Belief

    def __and__(self, other: object) -> Conjunction:
        return conjunction(self, other)

    def __rand__(self, other: object) -> Conjunction:
        return conjunction(other, self)

    def __rshift__(self, body: object) -> None:
        no_rule(self)

    def __str__(self) -> str:
        return f"~{self.belief}"


class Guard:
    """A Python function as a condition; its parameters are named like the variables it looks at."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.parameters = tuple(inspect.signature(function).parameters)

    def names(self) -> set[str]:
        return set(self.parameters)

    def holds(self, bindings: Bindings) -> bool:
        """Whether the function says so."""
        return bool(self.function(*(bindings[name] for name in self.parameters)))

    def __str__(self) -> str:
        name = getattr(self.function, "__name__", type(self.function).__name__)
        return f"{name}({', '.join(self.parameters)})"


@dataclass(frozen=True)
class Conjunction:
    """Conditions that must hold together, tried from left to right."""

    terms: tuple[Belief | Negation | Comparison | Guard, ...]

    def __and__(self, other: object) -> Conjunction:
        return conjunction(self, other)

    def __rand__(self, other: object) -> Conjunction:
        return conjunction(other, self)

    def __str__(self) -> str:
        return " & ".join(f"({term})" if isinstance(term, Comparison) else str(term) for term in self.terms)


def conjunction(*parts: object) -> Conjunction:
    """Joins conditions. Raises RuleError for something that cannot be one."""
    terms: list[Belief | Negation | Comparison | Guard] = []
    for part in parts:
        if isinstance(part, Conjunction):
            terms.extend(part.terms)
        elif isinstance(part, (Belief, Negation, Comparison, Guard)):
            terms.append(part)
        elif callable(part) and not isinstance(part, type):
            terms.append(Guard(part))
        else:
            raise RuleError(
                f"{part!r} cannot be a condition",
                remedy="use beliefs, ~beliefs, comparisons of variables or functions, joined with &",
            )
    return Conjunction(tuple(terms))
