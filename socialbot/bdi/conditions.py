"""Conditions: what has to hold before a plan is chosen. They join with ``&`` and ``|``; ``~`` negates."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from socialbot.bdi.terms import Comparison, Condition, names_in
from socialbot.errors import RuleError


@dataclass(eq=False, repr=False)
class Negation(Condition):
    """The condition that another one has no solution."""

    condition: Condition

    def names(self) -> set[str]:
        return self.condition.names()

    def __str__(self) -> str:
        joined = isinstance(self.condition, (Conjunction, Disjunction))
        return f"~({self.condition})" if joined else f"~{self.condition}"


class Guard(Condition):
    """A Python function as a condition; its parameters are named like the variables it looks at."""

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
    """``true`` and ``false``."""

    value: bool

    def names(self) -> set[str]:
        return set()

    def __str__(self) -> str:
        return "true" if self.value else "false"


@dataclass(eq=False, repr=False)
class Conjunction(Condition):
    """Conditions that must hold together, tried from left to right."""

    terms: tuple[Condition, ...]

    def names(self) -> set[str]:
        return set().union(*(term.names() for term in self.terms))

    def __str__(self) -> str:
        return " & ".join(
            f"({term})" if isinstance(term, (Comparison, Disjunction)) else str(term) for term in self.terms
        )


@dataclass(eq=False, repr=False)
class Disjunction(Condition):
    """Conditions of which one must hold, tried from left to right."""

    terms: tuple[Condition, ...]

    def names(self) -> set[str]:
        return set().union(*(names_in(term) for term in self.terms))

    def __or__(self, other: object) -> Disjunction:
        return Disjunction((*self.terms, conjunction(other)))

    def __str__(self) -> str:
        return " | ".join(f"({term})" if isinstance(term, Conjunction) and len(term.terms) > 1 else str(term)
                          for term in self.terms)  # fmt: skip


NOTHING = Conjunction(())
"""The condition that always holds."""


def conjunction(*parts: object) -> Conjunction:
    """Joins conditions. Raises RuleError for something that cannot be one."""
    terms: list[Condition] = []
    for part in parts:
        if isinstance(part, Conjunction):
            terms.extend(part.terms)
        elif isinstance(part, Disjunction) and len(part.terms) == 1:
            terms.append(part.terms[0])
        elif isinstance(part, Condition):
            terms.append(part)
        elif callable(part) and not isinstance(part, type):
            terms.append(Guard(part))
        else:
            raise RuleError(
                f"{part!r} cannot be a condition",
                remedy="use beliefs, ~beliefs, comparisons of variables or functions, joined with &",
            )
    return Conjunction(tuple(terms))
