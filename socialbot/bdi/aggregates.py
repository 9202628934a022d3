"""Aggregates over all solutions of a condition, and other values that a plan computes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from socialbot.bdi.terms import (
    Aggregate,
    Call,
    Comparison,
    Computation,
    Cons,
    Expression,
    OwnName,
    conjunction,
    names_in,
)


def count(condition: object, number: object = None) -> Any:
    """Number of the solutions of a condition: the condition that it is ``number`` or, without it, the value."""
    return _aggregate("count", None, condition, number)


def findall(term: object, condition: object, items: object = None) -> Any:
    """Tuple of ``term`` for each solution of a condition, as a condition on ``items`` or, without it, as a value."""
    return _aggregate("findall", term, condition, items)


def min_of(term: object, condition: object, least: object = None) -> Any:
    """Least ``term`` of all solutions, as a condition on ``least`` or as a value; it fails without a solution."""
    return _aggregate("min_of", term, condition, least)


def max_of(term: object, condition: object, greatest: object = None) -> Any:
    """Greatest ``term`` of all solutions, as a condition on ``greatest`` or as a value; it fails without a solution."""
    return _aggregate("max_of", term, condition, greatest)


def sum_of(term: object, condition: object, total: object = None) -> Any:
    """Sum of ``term`` over all solutions, as a condition on ``total`` or, without it, as a value."""
    return _aggregate("sum_of", term, condition, total)


def _aggregate(kind: str, template: object, condition: object, result: object) -> Aggregate | Comparison:
    found = Aggregate(kind, template, conjunction(condition))
    return found if result is None else Comparison("=", result, found)


def my_name(name: object = None) -> Any:
    """Name of the agent, a string: the condition that it is ``name`` or, without it, the value."""
    return OwnName() if name is None else Comparison("=", name, OwnName())


def compute(function: Callable[..., Any]) -> Any:
    """Value of a function of variables: ``say(compute(lambda X: f"Hello {X}"))``; its parameters name the variables."""
    return Computation(function)


def needed_names(term: object) -> set[str]:
    """Names of the variables that need a value to compute a term, without those of the conditions in it."""
    if isinstance(term, Aggregate) or (isinstance(term, Call) and term.function == ".count"):
        return set()
    if isinstance(term, (tuple, Expression, Cons)):
        parts = term if isinstance(term, tuple) else tuple(vars(term).values())
        return set[str]().union(*map(needed_names, parts))
    if isinstance(getattr(term, "args", None), tuple):
        return needed_names((*term.args, *getattr(term, "annotations", ())))  # type: ignore[attr-defined]
    return names_in(term)
