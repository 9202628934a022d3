"""Words for formulas of metric temporal logic."""

from __future__ import annotations

import operator
from collections.abc import Callable

from socialbot.core.errors import RuleError
from socialbot.runs.expectations.formulas import (
    Always,
    Conjunction,
    Counted,
    Eventually,
    Historically,
    Negation,
    Once,
    Rise,
    TemporalFormula,
    Window,
    as_formula,
    window,
)


class OnsetCount:
    """Number of times that a formula begins in a window ahead; compare it with a number."""

    def __init__(self, part: TemporalFormula, window: Window) -> None:
        self._part, self._window = part, window

    def _compared(self, compare: Callable[[int, int], bool], number: int) -> TemporalFormula:
        low, high = {
            operator.le: (0, number),
            operator.lt: (0, number - 1),
            operator.ge: (number, None),
            operator.gt: (number + 1, None),
            operator.eq: (number, number),
        }[compare]
        return Counted(self._part, max(low, 0), high, self._window)

    def __le__(self, number: int) -> TemporalFormula:
        return self._compared(operator.le, number)

    def __lt__(self, number: int) -> TemporalFormula:
        return self._compared(operator.lt, number)

    def __ge__(self, number: int) -> TemporalFormula:
        return self._compared(operator.ge, number)

    def __gt__(self, number: int) -> TemporalFormula:
        return self._compared(operator.gt, number)

    def __eq__(self, number: object) -> TemporalFormula:  # type: ignore[override]
        if not isinstance(number, int):
            raise RuleError(f"a count cannot be compared with {number!r}", remedy="give a whole number")
        return self._compared(operator.eq, number)

    __hash__ = None  # type: ignore[assignment]


def always(part: TemporalFormula, within: float | tuple[float, float] | None = None) -> TemporalFormula:
    """Return: ``part`` holds at all moments of the window ``within`` (s) ahead; without it, from then on."""
    return Always(as_formula(part), window(within))


def eventually(part: TemporalFormula, within: float | tuple[float, float] | None = None) -> TemporalFormula:
    """Return: ``part`` holds at a moment of the window ``within`` (s) ahead; without it, at some time."""
    return Eventually(as_formula(part), window(within))


def once(part: TemporalFormula, within: float | tuple[float, float] | None = None) -> TemporalFormula:
    """Return: ``part`` held at a moment of the window ``within`` (s) before."""
    return Once(as_formula(part), window(within))


def historically(part: TemporalFormula, within: float | tuple[float, float] | None = None) -> TemporalFormula:
    """Return: ``part`` held at all moments of the window ``within`` (s) before."""
    return Historically(as_formula(part), window(within))


def began(part: TemporalFormula) -> TemporalFormula:
    """Return: ``part`` begins to hold at this moment."""
    return Rise(as_formula(part))


def ended(part: TemporalFormula) -> TemporalFormula:
    """Return: ``part`` held until the moment before and does not any more."""
    return Conjunction(Rise(Negation(as_formula(part))), Once(part, Window(1, 1)), f"the end of {part}")


def count(part: TemporalFormula, within: float | tuple[float, float] | None = None) -> OnsetCount:
    """Return how often ``part`` begins in the window ``within`` (s) ahead: ``count(said("offer")) <= 1``."""
    return OnsetCount(as_formula(part), window(within))
