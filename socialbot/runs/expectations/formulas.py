"""Formulas of metric temporal logic (MTL) over a finite trace.

A trace has the moments 0 to ``end`` (ns). A formula holds at some of them; docs/expectations.md defines which. What
comes after the end is unknown, so each formula has two sets of moments: those where it holds whatever comes (``must``),
and those where it may hold (``may``). Sets reach beyond the end, to a moment from which on they do not change any more.
Windows without a limit end with a complete trace; other windows do not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, Protocol

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import RuleError
from socialbot.runs.expectations import _time_sets
from socialbot.runs.expectations._time_sets import EMPTY, TimeSet

if TYPE_CHECKING:
    from socialbot.core.messages import TraceRecord

Binding = Mapping[str, str]
"""Values of variables, such as the track id of a person."""


class Occurrence(NamedTuple):
    """Event, or a state from its first to its last moment (ns from the start), with the record that shows it."""

    begin: int
    end: int
    record: TraceRecord | None = None


class ObservedTrace(Protocol):
    """Observed atoms of a run, from 0 to ``end`` (ns); formulas are evaluated up to ``last``."""

    @property
    def end(self) -> int: ...

    @property
    def last(self) -> int: ...

    @property
    def complete(self) -> bool: ...

    def occurrences(self, atom: AtomicFormula, binding: Binding) -> Sequence[Occurrence]:
        """Return when an atom holds for these values of its variables, in order."""
        ...


class TruthSets(NamedTuple):
    """Moments at which a formula holds for certain, and those at which it may hold."""

    must: TimeSet
    may: TimeSet


@dataclass(frozen=True)
class Window:
    """Distance in time, from ``least`` to ``most`` (ns, None: without limit), both included."""

    least: int = 0
    most: int | None = None

    def __str__(self) -> str:
        if self == ALWAYS:
            return ""
        return f"[{self.least / SECOND:g}, {'∞' if self.most is None else f'{self.most / SECOND:g}'}]"

    def ahead(self, holds: TimeSet, trace: ObservedTrace) -> TimeSet:
        """Return the moments whose window ahead has a moment of ``holds``."""
        holds = self.in_run(holds, trace)
        return holds.earlier(self.least, self.most, trace.last) | self.beyond(holds, trace)

    def in_run(self, holds: TimeSet, trace: ObservedTrace) -> TimeSet:
        """Return ``holds``, without the moments after the end if this window ends with the trace."""
        return holds.clipped(0, trace.end) if self.most is None and trace.complete else holds

    def beyond(self, holds: TimeSet, trace: ObservedTrace) -> TimeSet:
        """Return the moments whose window reaches beyond all that is known, if ``holds`` stays true there."""
        last = trace.last
        if last not in holds:
            return EMPTY
        return TimeSet.of([(0 if self.most is None else max(0, last - self.most + 1), last)])

    def back(self, holds: TimeSet, trace: ObservedTrace) -> TimeSet:
        """Return the moments whose window before has a moment of ``holds``."""
        return holds.later(self.least, self.most, trace.last)

    @property
    def longest(self) -> int:
        return self.least if self.most is None else self.most


ALWAYS = Window()


def is_number(value: object) -> bool:
    """Return whether a value is a number, and no truth value."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def window(seconds: float | tuple[float, float] | None) -> Window:
    """Return the window of a duration: 0 to ``seconds``, or from the first to the second of two. Raises RuleError."""
    limits = seconds if isinstance(seconds, tuple) else (0.0, seconds)
    least, most = limits if len(limits) == 2 else (-1.0, None)
    if not (is_number(least) and (most is None or is_number(most))) or least < 0 or (most is not None and most < least):
        raise RuleError(f"within={seconds!r} is no time window", remedy="give seconds: 2, or (1, 2)")
    return Window(nanoseconds(least), None if most is None else nanoseconds(most))


class TemporalFormula:
    """Formula of MTL. ``&``, ``|``, ``~`` and ``implies`` combine formulas."""

    def truth(self, trace: ObservedTrace, binding: Binding) -> TruthSets:
        """Return when this formula holds."""
        truths = [part.truth(trace, binding) for part in self.parts]
        return TruthSets(*(self._holds(trace, *sets) for sets in zip(*truths, strict=True)))

    def _holds(self, trace: ObservedTrace, *parts: TimeSet) -> TimeSet:
        """Return when this formula holds if its parts hold at these moments; not for one that holds if they do not."""
        raise NotImplementedError

    @property
    def parts(self) -> tuple[TemporalFormula, ...]:
        return ()

    def atoms(self) -> Iterator[AtomicFormula]:
        for part in self.parts:
            yield from part.atoms()

    def onsets(self, trace: ObservedTrace, binding: Binding) -> list[int]:
        """Return the moments at which this formula begins to hold for certain."""
        return Rise(self).truth(trace, binding).must.starts()

    @property
    def memory(self) -> int:
        """Time (ns) after the end of a trace from which on the truth of this formula does not change."""
        return max((part.memory for part in self.parts), default=1) + self._reach

    @property
    def _reach(self) -> int:
        """Time (ns) before a moment on which the truth at that moment depends, beside the truth of the parts."""
        return 0

    def __and__(self, other: TemporalFormula) -> TemporalFormula:
        return Conjunction(self, as_formula(other))

    def __or__(self, other: TemporalFormula) -> TemporalFormula:
        return Disjunction(self, as_formula(other))

    def __invert__(self) -> TemporalFormula:
        return Negation(self)

    def implies(self, other: TemporalFormula) -> TemporalFormula:
        """Return the formula that holds where ``other`` holds, or this one does not."""
        return Disjunction(Negation(self), as_formula(other))

    def until(self, other: TemporalFormula, within: float | tuple[float, float] | None = None) -> TemporalFormula:
        """Return: ``other`` holds in the window ``within`` (s), and this formula at all moments before."""
        return Until(self, as_formula(other), window(within))

    def since(self, other: TemporalFormula, within: float | tuple[float, float] | None = None) -> TemporalFormula:
        """Return: ``other`` held in the window ``within`` (s) before, and this formula at all moments since."""
        return Since(self, as_formula(other), window(within))

    def held_for(self, seconds: float) -> TemporalFormula:
        """Return: this formula has held for ``seconds`` without a break."""
        since = Once(Rise(self), Window(nanoseconds(seconds)))
        return Conjunction(Historically(self, window(seconds)), since, f"{self} held for {seconds:g} s")

    def __bool__(self) -> NoReturn:
        raise RuleError("a formula is neither true nor false", where=str(self), remedy="combine with &, | and ~")


def as_formula(found: object) -> TemporalFormula:
    """Return a formula unchanged. Raises RuleError for anything else."""
    if isinstance(found, TemporalFormula):
        return found
    remedy = "give an atom such as said('greeting') or believed('busy()'), or a formula of them"
    raise RuleError(f"{found!r} is no formula", remedy=remedy)


class AtomicFormula(TemporalFormula):
    """Formula without parts: an event or a state of the run. Its ``text`` is its name in reports."""

    text: str = ""
    is_event = True
    variables: frozenset[str] = frozenset()
    binds: frozenset[str] = frozenset()
    """Those of ``variables`` for which this atom gives values."""

    def observer(self) -> Any:
        """Return a new observer of this atom for `Observation`."""
        raise NotImplementedError

    def atoms(self) -> Iterator[AtomicFormula]:
        yield self

    def truth(self, trace: ObservedTrace, binding: Binding) -> TruthSets:
        found = TimeSet.of((each.begin, each.end) for each in trace.occurrences(self, binding))
        return TruthSets(found, found | TimeSet.of([(trace.end + 1, trace.last)]))

    def onsets(self, trace: ObservedTrace, binding: Binding) -> list[int]:
        if self.is_event:  # events next to each other stay apart
            return [each.begin for each in trace.occurrences(self, binding)]
        return super().onsets(trace, binding)

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, eq=False)
class Constant(TemporalFormula):
    """Formula that always or never holds."""

    value: bool

    def truth(self, trace: ObservedTrace, binding: Binding) -> TruthSets:
        found = EMPTY.complement(trace.last) if self.value else EMPTY
        return TruthSets(found, found)

    def __str__(self) -> str:
        return "true" if self.value else "false"


@dataclass(frozen=True, eq=False)
class _OfPart(TemporalFormula):
    part: TemporalFormula

    @property
    def parts(self) -> tuple[TemporalFormula, ...]:
        return (self.part,)


class Negation(_OfPart):
    """Negation."""

    def truth(self, trace: ObservedTrace, binding: Binding) -> TruthSets:
        must, may = self.part.truth(trace, binding)
        return TruthSets(may.complement(trace.last), must.complement(trace.last))

    def __str__(self) -> str:
        return f"not {self.part}"


@dataclass(frozen=True, eq=False)
class _Pair(TemporalFormula):
    left: TemporalFormula
    right: TemporalFormula

    @property
    def parts(self) -> tuple[TemporalFormula, ...]:
        return self.left, self.right


@dataclass(frozen=True, eq=False)
class Conjunction(_Pair):
    """Conjunction. ``text`` is a shorter name for it in reports."""

    text: str = ""

    def _holds(self, trace: ObservedTrace, *parts: TimeSet) -> TimeSet:
        left, right = parts
        return left & right

    def __str__(self) -> str:
        return self.text or f"({self.left} and {self.right})"


class Disjunction(_Pair):
    """Disjunction."""

    def _holds(self, trace: ObservedTrace, *parts: TimeSet) -> TimeSet:
        left, right = parts
        return left | right

    def __str__(self) -> str:
        if isinstance(self.left, Negation):
            return f"({self.left.part} → {self.right})"
        return f"({self.left} or {self.right})"


class _LooksBack:
    window: Window

    @property
    def _reach(self) -> int:
        return self.window.longest


@dataclass(frozen=True, eq=False)
class _Timed(_OfPart):
    window: Window = ALWAYS

    symbol = ""

    def __str__(self) -> str:
        return f"{self.symbol}{self.window} {self.part}"


class Eventually(_Timed):
    """The part holds at a moment of the window ahead."""

    symbol = "F"

    def _holds(self, trace: ObservedTrace, *parts: TimeSet) -> TimeSet:
        return self.window.ahead(parts[0], trace)


class Always(_Timed):
    """The part holds at all moments of the window ahead."""

    symbol = "G"

    def truth(self, trace: ObservedTrace, binding: Binding) -> TruthSets:
        return Negation(Eventually(Negation(self.part), self.window)).truth(trace, binding)


class Once(_LooksBack, _Timed):
    """The part held at a moment of the window before; nothing held before the trace."""

    symbol = "O"

    def _holds(self, trace: ObservedTrace, *parts: TimeSet) -> TimeSet:
        return self.window.back(parts[0], trace)


class Historically(_LooksBack, _Timed):
    """The part held at all moments of the window before, as far as the trace has them."""

    symbol = "H"

    def truth(self, trace: ObservedTrace, binding: Binding) -> TruthSets:
        return Negation(Once(Negation(self.part), self.window)).truth(trace, binding)


@dataclass(frozen=True, eq=False)
class _TimedPair(_Pair):
    window: Window = ALWAYS

    symbol = ""

    def __str__(self) -> str:
        return f"({self.left} {self.symbol}{self.window} {self.right})"


class Until(_TimedPair):
    """The right part holds at a moment of the window ahead, the left one at all moments before that one."""

    symbol = "U"

    def _holds(self, trace: ObservedTrace, *parts: TimeSet) -> TimeSet:
        left, right = parts[0], self.window.in_run(parts[1], trace)
        found = _time_sets.until(left, right, self.window.least, self.window.most, trace.last)
        to_the_end = TimeSet(left.intervals[-1:]) if trace.last in left else EMPTY
        return found | (to_the_end & self.window.beyond(right, trace))


class Since(_LooksBack, _TimedPair):
    """The right part held at a moment of the window before, the left one at all moments after that one."""

    symbol = "S"

    def _holds(self, trace: ObservedTrace, *parts: TimeSet) -> TimeSet:
        return _time_sets.since(parts[0], parts[1], self.window.least, self.window.most, trace.last)


class Rise(_OfPart):
    """The part begins to hold: it holds, and did not at the moment before."""

    def truth(self, trace: ObservedTrace, binding: Binding) -> TruthSets:
        last = trace.last
        must, may = self.part.truth(trace, binding)
        if isinstance(self.part, AtomicFormula) and self.part.is_event:
            return TruthSets(must, may)
        return TruthSets(must.without(may.later(1, 1, last), last), may.without(must.later(1, 1, last), last))

    @property
    def _reach(self) -> int:
        return 1

    def __str__(self) -> str:
        return f"begin({self.part})"


@dataclass(frozen=True, eq=False)
class Counted(_OfPart):
    """``low`` to ``high`` onsets of the part (None: any number) are in the window ahead."""

    low: int = 0
    high: int | None = None
    window: Window = ALWAYS

    def truth(self, trace: ObservedTrace, binding: Binding) -> TruthSets:
        onsets, last = self.part.onsets(trace, binding), trace.last
        least, most = self.window.least, self.window.most
        now = _time_sets.counted(onsets, least, most, self.low, self.high, last)
        fewer = _time_sets.counted(onsets, least, most, 0, self.high, last)
        rises = Rise(self.part).truth(trace, binding)
        more = self.window.ahead(rises.may.without(rises.must, last), trace)
        return TruthSets(now if self.high is None else now.without(more, last), now | (fewer & more))

    @property
    def _reach(self) -> int:
        return 1

    def __str__(self) -> str:
        if self.high is None:
            return f"#{self.window} {self.part} ≥ {self.low}"
        return (
            f"#{self.window} {self.part} {f'= {self.low}' if self.low == self.high else f'in {self.low}..{self.high}'}"
        )
