"""Causal order of a plan: the events that each start and end of a step has to wait for, independent of the clock.

An event waits for an earlier one if one reads what the other writes, or if both write in ways that do not commute. So
a plan remains valid if its steps start later, or take longer or shorter. For a predicate that must be true (or false),
only the first event that makes it so counts; repetitions delay nothing.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem
from socialbot.planning.pddl.formulas import Fluent, Predicate
from socialbot.planning.pddl.semantics import changes, ground
from socialbot.planning.pddl.state import PddlState
from socialbot.planning.pddl.validation import (
    Key,
    PlanEvent,
    Reading,
    ReadWriteAnalysis,
    ReadWriteSets,
    TimePoint,
    time_points,
)


@dataclass(frozen=True, slots=True)
class CausalOrder:
    """Events that must happen before the start and before the end of each step, by its index.

    Events that follow from others are omitted, and so is the start of a step before its own end. Steps also wait for
    the predecessors of an end, so that an early end cannot start them too early.
    """

    before_start: tuple[frozenset[PlanEvent], ...]
    before_end: tuple[frozenset[PlanEvent], ...]


def causal_order(
    domain: PddlDomain, now: PddlProblem | PddlState, plan: PddlPlan, running: Collection[int] = ()
) -> CausalOrder:
    """Return the causal order of a valid plan.

    Args:
        now: Initial state, which includes the start effects of running steps.
        running: Indexes of steps that have started. The other steps were planned for the state after their ends.

    Raises:
        PlanningError: A step is no action of the domain, or has undefined effects.
    """
    state = PddlState.of(now, domain) if isinstance(now, PddlProblem) else now.copy()
    history = _recorded(domain, state.copy(), plan, running)
    waits = _Waits(len(history.order))
    _order_writes(history, waits)
    for predicate, wanted, reader in history.literals():
        _order_literal(history.writes[predicate], state.holds(predicate), wanted, reader, waits)
    for keys, reader in history.groups():
        _order_group(history.writers(keys), reader, waits)
    return _reduced(history, waits, len(plan.steps))


@dataclass(frozen=True, slots=True)
class _Reader:
    """Span of positions at which something is read; -1 for a start before the plan.

    Writes up to ``upto`` come before it, and writes from ``since`` come after it.
    """

    first: int
    last: int
    upto: int
    since: int


@dataclass
class _History:
    """Events of a plan with their read and write sets; a position is an index in ``order``."""

    order: list[PlanEvent] = field(default_factory=list)
    sets: list[ReadWriteSets] = field(default_factory=list)
    starts: dict[int, int] = field(default_factory=dict)
    spans: list[tuple[Reading, _Reader]] = field(default_factory=list)
    writes: dict[Predicate, list[tuple[int, bool]]] = field(default_factory=lambda: defaultdict(list))
    """Positions at which each predicate is made true or false."""
    positions: dict[Key, int] = field(default_factory=lambda: defaultdict(int))
    """Positions at which each key is written, as a bit set."""

    def add(self, event: PlanEvent, sets_of_event: ReadWriteSets, invariants: Reading | None) -> None:
        """Append an event; ``invariants`` are the read set over all of a step, at its end."""
        position = len(self.order)
        self.order.append(event)
        self.sets.append(sets_of_event)
        if event.edge == "start":
            self.starts[event.step] = position
        elif invariants is not None:
            start = self.starts.get(event.step, -1)
            self.spans.append((invariants, _Reader(start, position, start, position)))
        for key in sets_of_event.writing.keys:
            self.positions[key] |= 1 << position
        for predicates, made in (
            (sets_of_event.writing.added, True),
            (sets_of_event.writing.deleted - sets_of_event.writing.added, False),
        ):
            for predicate in predicates:
                self.writes[predicate].append((position, made))

    def readings(self) -> Iterator[tuple[Reading, _Reader]]:
        for position, sets_of_event in enumerate(self.sets):
            yield sets_of_event.reading, _Reader(position, position, position - 1, position)
        yield from self.spans

    def literals(self) -> Iterator[tuple[Predicate, bool, _Reader]]:
        """Yield the predicates that must be true or false, and their readers."""
        for reading, reader in self.readings():
            for predicate, wanted in reading.literals.items():
                if predicate in self.writes:
                    yield predicate, wanted, reader

    def groups(self) -> Iterator[tuple[frozenset[Key], _Reader]]:
        """Yield the other keys that are read, and their readers."""
        for reading, reader in self.readings():
            for keys in reading.groups:
                yield keys, reader

    def writers(self, keys: Iterable[Key]) -> int:
        """Return the positions at which any of the keys is written, as a bit set."""
        found = 0
        for key in keys:
            found |= self.positions.get(key, 0)
        return found


def _recorded(domain: PddlDomain, state: PddlState, plan: PddlPlan, running: Collection[int]) -> _History:
    """Simulate a plan and record its read and write sets."""
    for step in plan.steps:
        if step.action not in domain.actions:
            raise PlanningError(f"{step.call}: the domain has no action {step.action}")
    actions = [ground(domain.actions[step.action], step.args) for step in plan.steps]
    analysis = ReadWriteAnalysis(domain)
    invariants = [analysis.reading(action.conditions_at("over all"), state) for action in actions]
    history = _History()
    for point in time_points(plan, actions, running):
        sets = {one: analysis.of(actions[one.step], one.edge, state) for one in point.events}
        for event in _sequence(point, sets, invariants):
            history.add(event, sets[event], invariants[event.step] if event.edge == "end" else None)
            effects = actions[event.step].effects_at(event.edge)
            state.apply(changes(effects, state, duration=plan.steps[event.step].duration_s))
    return history


def _sequence(point: TimePoint, sets: dict[PlanEvent, ReadWriteSets], invariants: Sequence[Reading]) -> list[PlanEvent]:
    """Order simultaneous events: invariants of a step become true before its start, and false after its end."""
    waiting = list(point.events)
    if len(waiting) == 1:
        return waiting
    written = {one: one_set.writing.keys for one, one_set in sets.items()}

    def comes_first(one: PlanEvent, other: PlanEvent) -> bool:
        needs_it = other.edge == "start" and not written[one].isdisjoint(invariants[other.step].keys)
        needed_it = one.edge == "end" and not written[other].isdisjoint(invariants[one.step].keys)
        return one.step != other.step and (needs_it or needed_it)

    found: list[PlanEvent] = []
    while waiting:
        free = (one for one in waiting if not any(comes_first(other, one) for other in waiting))
        # Steps that require each other to start simultaneously have no order.
        found.append(next(free, waiting[0]))
        waiting.remove(found[-1])
    return found


class _Waits:
    """Earlier positions that each position has to wait for, as bit sets."""

    def __init__(self, positions: int) -> None:
        self.before = [0] * positions

    def add(self, later: int, earlier: int) -> None:
        """Let ``later`` wait for ``earlier``, if both are positions and differ."""
        if 0 <= earlier < later:
            self.before[later] |= 1 << earlier


def _order_writes(history: _History, waits: _Waits) -> None:
    """Keep the order of writes that do not commute."""
    for writes in history.writes.values():
        for former, block in _neighbours(writes):
            for later in block:
                for earlier in former:
                    waits.add(later, earlier)
    values: dict[Fluent, list[tuple[int, int | None]]] = defaultdict(list)
    for position, sets_of_event in enumerate(history.sets):
        for fluent in sets_of_event.writing.moved:
            values[fluent].append((position, None))
        for fluent in sets_of_event.writing.assigned:
            values[fluent].append((position, position))
    for writes in values.values():
        for former, block in _neighbours(writes):
            for later in block:
                for earlier in former:
                    waits.add(later, earlier)


def _neighbours(writes: Sequence[tuple[int, object]]) -> Iterator[tuple[list[int], list[int]]]:
    """Yield pairs of successive blocks of commuting writes."""
    blocks = [[position for position, _ in block] for _, block in itertools.groupby(writes, key=lambda one: one[1])]
    return itertools.pairwise(blocks)


def _order_literal(
    writes: Sequence[tuple[int, bool]], initially: bool, wanted: bool, reader: _Reader, waits: _Waits
) -> None:
    """Let a reader wait for the write that makes a predicate as wanted, and the reverting write for the reader."""
    truth = initially
    origin = -1
    for position, made in writes:
        if position > reader.upto:
            break
        if made != truth:
            truth, origin = made, position
    if reader.first >= 0:
        waits.add(reader.first, origin)
    reverted = False
    for position, made in writes:
        if position < reader.since:
            continue
        if made != wanted:
            reverted = True
            waits.add(position, reader.last)
        elif reverted:
            break


def _order_group(writers: int, reader: _Reader, waits: _Waits) -> None:
    """Keep all writers of other keys before or after their reader, as in the plan."""
    last_inside = -1
    for position in _bits(writers):
        if position <= reader.upto:
            waits.add(reader.first, position)
        elif position >= reader.since:
            waits.add(position, reader.last)
        else:
            # The condition held after each write inside the span, in this order.
            waits.add(position, last_inside)
            last_inside = position


def _bits(mask: int) -> Iterator[int]:
    while mask:
        lowest = mask & -mask
        yield lowest.bit_length() - 1
        mask ^= lowest


def _reduced(history: _History, waits: _Waits, steps: int) -> CausalOrder:
    """Remove transitive waits, except through ends that may come early."""
    starts: list[frozenset[PlanEvent]] = [frozenset()] * steps
    ends: list[frozenset[PlanEvent]] = [frozenset()] * steps
    implied: list[int] = []
    for position, event in enumerate(history.order):
        own_start = history.starts.get(event.step, -1) if event.edge == "end" else -1
        covered = implied[own_start] if own_start >= 0 else 0
        all_before = covered
        needed: list[PlanEvent] = []
        for earlier in reversed(list(_bits(waits.before[position]))):
            if not covered >> earlier & 1:
                needed.append(history.order[earlier])
                covered |= implied[earlier]
        if event.edge == "start":
            starts[event.step] = frozenset(needed)
            all_before = covered
        else:
            ends[event.step] = frozenset(needed)
        implied.append(all_before | 1 << position)
    return CausalOrder(tuple(starts), tuple(ends))
