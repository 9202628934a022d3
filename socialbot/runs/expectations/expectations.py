"""Expectations: sentences about a run, as formulas of MTL with instances.

::

    expect(said("greeting")).within(2).after(person(nearer_than=6))
    never(said("greeting")).while_(believed(personDetected("No")))
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

from socialbot.bdi.terms import Variable
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import RuleError
from socialbot.runs.expectations.formulas import (
    ALWAYS,
    Always,
    Conjunction,
    Constant,
    Counted,
    Disjunction,
    Eventually,
    Historically,
    Negation,
    Once,
    Rise,
    TemporalFormula,
    Until,
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


When = Literal["each", "throughout", "begin"]
Mode = Literal["some", "never", "all"]


@dataclass(frozen=True, eq=False)
class Expectation:
    """Expectations on runs.

    Args:
        text: The expectation as a sentence.
        holds: The formula that must hold.
        when: At which moments: at each onset of ``trigger``, throughout the run, or at its beginning.
        trigger: Each of its onsets is an instance ("each"); the formula need only hold while it holds ("throughout").
        name: Name in reports; a behaviour file gives the name of the variable.
        subject: Formula that the expectation is about, for explanations.
        reason: Why it matters; see `because`.
    """

    text: str
    holds: TemporalFormula
    when: When
    trigger: TemporalFormula | None = None
    name: str = ""
    subject: TemporalFormula | None = None
    reason: str = ""

    @property
    def formula(self) -> TemporalFormula:
        """The whole expectation as one formula, which must hold at the beginning of the run."""
        if self.when == "begin":
            return self.holds
        if self.when == "each" and self.trigger is not None:
            return Always(Rise(self.trigger).implies(self.holds))
        return Always(self.holds if self.trigger is None else self.trigger.implies(self.holds))

    @property
    def variables(self) -> frozenset[str]:
        return frozenset(name for atom in self.formula.atoms() for name in atom.variables)

    def named(self, name: str) -> Expectation:
        """Return this expectation under another name."""
        return replace(self, name=name)

    def because(self, reason: str) -> Expectation:
        """Return this expectation with the reason why it matters, for reports."""
        return replace(self, reason=reason)

    def __str__(self) -> str:
        return self.name or self.text


def _seconds(found: Window | None) -> str:
    if found is None:
        return ""
    text = f"{(found.most or 0) / 1e9:g}"
    return f" within {f'{found.least / 1e9:g} to ' if found.least else ''}{text} s"


def _times(number: int) -> str:
    return "once" if number == 1 else f"{number} times"


@dataclass(frozen=True, eq=False)
class ExpectationClause:
    """Beginning of an expectation, from `expect`, `never` or `at_all_times`; the methods complete it."""

    what: TemporalFormula
    mode: Mode
    window: Window | None = None
    low: int | None = None
    high: int | None = None

    def within(self, seconds: float | tuple[float, float]) -> ExpectationClause:
        """Limit the time to or from the other event: at most ``seconds``, or between two numbers of seconds."""
        return replace(self, window=window(seconds))

    def at_least(self, number: int) -> ExpectationClause:
        """Expect this many or more."""
        return self._counting("at_least", number, number, self.high)

    def at_most(self, number: int) -> ExpectationClause:
        """Expect this many or fewer."""
        return self._counting("at_most", number, self.low or 0, number)

    def exactly(self, number: int) -> ExpectationClause:
        """Expect this many."""
        return self._counting("exactly", number, number, number)

    def _counting(self, word: str, number: int, low: int, high: int | None) -> ExpectationClause:
        self._refuse(word, "mode")
        if not isinstance(number, int) or isinstance(number, bool) or number < 0:
            raise RuleError(f"{number!r} is no number of times", where=f"{word}()", remedy=f"give one: {word}(2)")
        return replace(self, low=low, high=high)

    # Completed expectations

    def after(self, trigger: TemporalFormula) -> Expectation:
        """Expect it after each time that ``trigger`` happens or begins to hold."""
        reach = self.window or ALWAYS
        if self.low is not None:
            holds: TemporalFormula = Counted(self.what, self.low, self.high, reach)
        elif self.mode == "some":
            holds = Eventually(self.what, reach)
        elif self.mode == "all":
            holds = Always(self.what, reach)
        else:  # the moment of the trigger itself is left out: never(a).within(5).after(a)
            later = Window(max(reach.least, 1), reach.most)
            holds = Negation(Eventually(self.what, later))
        return self._made(f"{_seconds(self.window)} after {trigger}", holds, "each", trigger)

    def before(self, trigger: TemporalFormula) -> Expectation:
        """Expect it before each time that ``trigger`` happens or begins to hold."""
        self._refuse("before", "count")
        reach = self.window or ALWAYS
        if self.mode == "some":
            holds: TemporalFormula = Once(self.what, reach)
        elif self.mode == "all":
            holds = Historically(self.what, Window(max(reach.least, 1), reach.most))
        else:
            holds = Negation(Once(self.what, Window(max(reach.least, 1), reach.most)))
        rest = f"{_seconds(self.window)} before {trigger}" if reach.most != 0 else f" when {trigger} begins"
        return self._made(rest, holds, "each", trigger)

    def while_(self, state: TemporalFormula) -> Expectation:
        """Expect it at all times at which ``state`` holds; counts are for each time that ``state`` holds."""
        self._refuse("while_", "window")
        if self.low is not None:
            return self._made(f" while {state}", _counted_during(self.what, state, self.low, self.high), "each", state)
        holds = Negation(self.what) if self.mode == "never" else self.what
        return self._made(f" while {state}", holds, "throughout", state)

    def until(self, end: TemporalFormula) -> Expectation:
        """Expect it from the beginning of the run until ``end`` first happens, which it must."""
        self._refuse("until", "window", "count")
        left = Negation(self.what) if self.mode == "never" else self.what
        return self._made(f" until {end}", Until(left, end), "begin")

    def once_per(self, variable: Variable) -> Expectation:
        """Expect it at most once for each value of a variable, which it contains: ``said("greeting", to=person)``."""
        self._refuse("once_per", "mode", "window", "count")
        found = [atom for atom in self.what.atoms() if variable.name in atom.variables]
        if not found:
            remedy = f"use {variable.name} in it, for example said('greeting', to={variable.name})"
            raise RuleError(f"{self.what} does not depend on {variable.name}", where="once_per()", remedy=remedy)
        return self._made(f" at most once per {variable.name}", Counted(self.what, 0, 1), "begin")

    def in_total(self) -> Expectation:
        """Expect the number of times, or that it happens at all, in the whole run."""
        self._refuse("in_total", "mode", "window")
        if self.low is None:
            return self._made(" at some time", Eventually(self.what), "begin")
        return self._made(" in total", Counted(self.what, self.low, self.high), "begin")

    def lasting(self, at_least: float | None = None, at_most: float | None = None) -> Expectation:
        """Expect that each time, the state lasts at least and at most this long (s).

        A limit that is met to the nanosecond is kept.
        """
        self._refuse("lasting", "mode", "window", "count")
        parts: list[TemporalFormula] = []
        if at_least is not None:
            parts.append(Always(self.what, Window(0, max(nanoseconds(at_least) - 1, 0))))
        if at_most is not None:
            end = nanoseconds(at_most) + 1
            parts.append(Eventually(Negation(self.what), Window(0, end)))
        if not parts:
            raise RuleError("lasting() needs a limit", where="expectation", remedy="give at_least or at_most (s)")
        holds = parts[0] if len(parts) == 1 else Conjunction(parts[0], parts[1])
        limits = [f"at least {at_least:g} s" if at_least is not None else ""]
        limits += [f"at most {at_most:g} s" if at_most is not None else ""]
        return self._made(f" lasts {' and '.join(filter(None, limits))}", holds, "each", self.what)

    def throughout(self) -> Expectation:
        """Expect it at all times of the run."""
        self._refuse("throughout", "window", "count")
        holds = Negation(self.what) if self.mode == "never" else self.what
        return self._made("", holds, "throughout")

    def _refuse(self, word: str, *parts: Literal["mode", "window", "count"]) -> None:
        """Raise RuleError if this clause has a part that has no meaning with the method ``word``."""
        what = remedy = ""
        if "mode" in parts and self.mode != "some":
            what = f"{word}() has no meaning after {'never' if self.mode == 'never' else 'at_all_times'}()"
            remedy = f"begin with expect(...), or leave out {word}()"
        elif "window" in parts and self.window is not None:
            what = f"within() has no meaning with {word}()"
            remedy = "leave out within(), or complete it with after() or before()"
        elif "count" in parts and self.low is not None:
            what, remedy = f"counts have no meaning with {word}()", "count with after(), while_() or in_total()"
        if what:
            raise RuleError(what, where="expectation", remedy=remedy)

    def _made(
        self, rest: str, holds: TemporalFormula, when: When, trigger: TemporalFormula | None = None
    ) -> Expectation:
        how_many = ""
        if self.low is not None:
            how_many = f" at least {_times(self.low)}"
            if self.high is not None:
                how_many = f" {self.low} to {_times(self.high)}" if self.low else f" at most {_times(self.high)}"
            if self.low == self.high:
                how_many = f" {_times(self.low)}"
        word = {"some": "expect", "never": "never", "all": "always"}[self.mode]
        return Expectation(f"{word} {self.what}{how_many}{rest}", holds, when, trigger, subject=self.what)


def _counted_during(what: TemporalFormula, state: TemporalFormula, low: int, high: int | None) -> TemporalFormula:
    """Return: of the onsets of ``what`` until ``state`` ends, there are ``low`` to ``high``.

    n or more onsets are n nested untils, each of which begins after the one before.
    """

    def at_least(number: int) -> TemporalFormula:
        found: TemporalFormula = Constant(True)
        for left in range(number):
            first = left == number - 1
            found = Until(
                state, Conjunction(Conjunction(Rise(what), state), found), ALWAYS if first else Window(1, None)
            )
        return found

    lower = at_least(low)
    return lower if high is None else Conjunction(lower, Negation(at_least(high + 1)))


def expect(what: TemporalFormula) -> ExpectationClause:
    """Begin an expectation that something happens or holds: ``expect(a).within(2).after(b)``."""
    return ExpectationClause(_checked(what, "expect"), "some")


def never(what: TemporalFormula) -> ExpectationClause:
    """Begin an expectation that something never happens: ``never(a).while_(b)``; alone it means in the whole run."""
    return ExpectationClause(_checked(what, "never"), "never")


def at_all_times(what: TemporalFormula) -> ExpectationClause:
    """Begin an expectation that a state holds all the time: ``at_all_times(a).within(5).after(b)``."""
    return ExpectationClause(_checked(what, "at_all_times"), "all")


def once_per(variable: Variable, what: TemporalFormula) -> Expectation:
    """Return the expectation that something happens at most once for each value of ``variable``."""
    return expect(what).once_per(variable)


def in_order(*events: TemporalFormula) -> Expectation:
    """Return the expectation that no event happens before the one before it first did, of any agents.

    Events with the same time stamp are in order.
    """
    if len(events) < 2:
        raise RuleError("in_order() needs two events or more", where="in_order()", remedy="give them in their order")
    holds: TemporalFormula | None = None
    for earlier, later in pairwise(events):
        ordered = Disjunction(Until(Negation(later), earlier), Always(Negation(later)))
        holds = ordered if holds is None else Conjunction(holds, ordered)
    assert holds is not None
    return Expectation(f"in order: {', '.join(map(str, events))}", holds, "begin", subject=events[-1])


def _checked(what: object, where: str) -> TemporalFormula:
    if isinstance(what, OnsetCount):
        raise RuleError("compare the count with a number", where=f"{where}()", remedy="count(a) <= 1")
    if not isinstance(what, TemporalFormula):
        remedy = "give an atom such as said('greeting') or believed('busy()'), or a formula of them"
        raise RuleError(f"{what!r} is no formula", where=f"{where}()", remedy=remedy)
    return what


def as_expectation(found: object, name: str) -> Expectation | None:
    """Return a value of a behaviour file as an expectation with its name; None for other values.

    Formulas are parts of expectations, except for ``always(...)``.
    """
    if isinstance(found, ExpectationClause):
        if found.mode == "some":
            found = found.in_total()
        else:
            found = found.throughout()
    elif isinstance(found, Always) and found.window == ALWAYS:
        found = Expectation(f"always {found.part}", found.part, "throughout", subject=found.part)
    if not isinstance(found, Expectation):
        return None
    return found if found.name else found.named(name)
