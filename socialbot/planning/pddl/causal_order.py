"""The causal order of a plan: which starts and ends have to wait for which others, whatever the clock says.

A happening waits for an earlier one if one of them reads what the other one writes, or if both write it in ways that
do not commute. Whoever keeps to that finds at each start and end what was read there as it was planned; so a plan
stays valid when its steps begin later, and last longer or shorter. For a predicate that has to be true (or false),
only the first of those that make it so counts; to make it so again holds nothing up.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem
from socialbot.planning.pddl.formulas import Fluent, Predicate
from socialbot.planning.pddl.read_write_sets import (
    Key,
    PlanEvent,
    Reading,
    ReadWriteAnalysis,
    ReadWriteSets,
    TimePoint,
    time_points,
)
from socialbot.planning.pddl.semantics import changes, ground
from socialbot.planning.pddl.state import PddlState


@dataclass(frozen=True, slots=True)
class CausalOrder:
    """For each step, by its index, what has to happen before it may start, and before it may end.

    What follows from the rest is left out; so is, before an end, the start of the same step. An end that comes too
    early does not let others start too early: they wait themselves for what should have come before it.
    """

    before_start: tuple[frozenset[PlanEvent], ...]
    before_end: tuple[frozenset[PlanEvent], ...]


def causal_order(
    domain: PddlDomain, now: PddlProblem | PddlState, plan: PddlPlan, running: Collection[int] = ()
) -> CausalOrder:
    """The order within ``plan``, which has to be valid from ``now`` on.

    The steps whose indexes are ``running`` have started: what they change at the start is part of ``now``, and the
    rest of the plan was made for what is the case once they all have ended; their times only tell which one ends
    first. Raises PlanningError for a step that is no action of the domain, or whose effects have no value.
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
    """Something read at a position, or from one to another; -1 for what began before the plan.

    What is written up to ``upto`` was written before, and what is written from ``since`` on is written after.
    """

    first: int
    last: int
    upto: int
    since: int


@dataclass
class _History:
    """What a plan does; a position is the place of a happening in ``order``."""

    order: list[PlanEvent] = field(default_factory=list)
    footprints: list[ReadWriteSets] = field(default_factory=list)
    starts: dict[int, int] = field(default_factory=dict)
    """The position at which each step starts."""
    spans: list[tuple[Reading, _Reader]] = field(default_factory=list)
    writes: dict[Predicate, list[tuple[int, bool]]] = field(default_factory=lambda: defaultdict(list))
    """Where each predicate is made true or false."""
    positions: dict[Key, int] = field(default_factory=lambda: defaultdict(int))
    """Where each key is written, as bits."""

    def add(self, happening: PlanEvent, footprint: ReadWriteSets, lasting: Reading | None) -> None:
        """Notes what happens next; ``lasting`` is what the step has read all the time, when it ends."""
        position = len(self.order)
        self.order.append(happening)
        self.footprints.append(footprint)
        if happening.edge == "start":
            self.starts[happening.step] = position
        elif lasting is not None:
            start = self.starts.get(happening.step, -1)
            self.spans.append((lasting, _Reader(start, position, start, position)))
        for key in footprint.writing.keys:
            self.positions[key] |= 1 << position
        for predicates, made in (
            (footprint.writing.added, True),
            (footprint.writing.deleted - footprint.writing.added, False),
        ):
            for predicate in predicates:
                self.writes[predicate].append((position, made))

    def readings(self) -> Iterator[tuple[Reading, _Reader]]:
        for position, footprint in enumerate(self.footprints):
            yield footprint.reading, _Reader(position, position, position - 1, position)
        yield from self.spans

    def literals(self) -> Iterator[tuple[Predicate, bool, _Reader]]:
        """The predicates that have to be true or false, and where."""
        for reading, reader in self.readings():
            for predicate, wanted in reading.literals.items():
                if predicate in self.writes:
                    yield predicate, wanted, reader

    def groups(self) -> Iterator[tuple[frozenset[Key], _Reader]]:
        """All else that is read, and where."""
        for reading, reader in self.readings():
            for keys in reading.groups:
                yield keys, reader

    def writers(self, keys: Iterable[Key]) -> int:
        """Where any of ``keys`` is written, as bits."""
        found = 0
        for key in keys:
            found |= self.positions.get(key, 0)
        return found


def _recorded(domain: PddlDomain, state: PddlState, plan: PddlPlan, running: Collection[int]) -> _History:
    """Carries out ``plan`` in ``state`` and notes what it reads and writes."""
    for step in plan.steps:
        if step.action not in domain.actions:
            raise PlanningError(f"{step.call}: the domain has no action {step.action}")
    actions = [ground(domain.actions[step.action], step.args) for step in plan.steps]
    footprints = ReadWriteAnalysis(domain)
    lasting = [footprints.reading(action.conditions_at("over all"), state) for action in actions]
    history = _History()
    for moment in time_points(plan, actions, running):
        prints = {one: footprints.of(actions[one.step], one.edge, state) for one in moment.happenings}
        for happening in _sequence(moment, prints, lasting):
            history.add(happening, prints[happening], lasting[happening.step] if happening.edge == "end" else None)
            effects = actions[happening.step].effects_at(happening.edge)
            state.apply(changes(effects, state, duration=plan.steps[happening.step].duration_s))
    return history


def _sequence(moment: TimePoint, prints: dict[PlanEvent, ReadWriteSets], lasting: Sequence[Reading]) -> list[PlanEvent]:
    """What happens at once, one after the other: what a step needs while it lasts comes first, and goes last."""
    waiting = list(moment.happenings)
    if len(waiting) == 1:
        return waiting
    written = {one: print.writing.keys for one, print in prints.items()}

    def comes_first(one: PlanEvent, other: PlanEvent) -> bool:
        needs_it = other.edge == "start" and not written[one].isdisjoint(lasting[other.step].keys)
        needed_it = one.edge == "end" and not written[other].isdisjoint(lasting[one.step].keys)
        return one.step != other.step and (needs_it or needed_it)

    found: list[PlanEvent] = []
    while waiting:
        free = (one for one in waiting if not any(comes_first(other, one) for other in waiting))
        # Steps that need each other to start at the same moment have no order.
        found.append(next(free, waiting[0]))
        waiting.remove(found[-1])
    return found


class _Waits:
    """For each position, the earlier ones that it has to wait for, as bits."""

    def __init__(self, positions: int) -> None:
        self.before = [0] * positions

    def add(self, later: int, earlier: int) -> None:
        """``later`` waits for ``earlier``, unless they are the same or one of them is no position."""
        if 0 <= earlier < later:
            self.before[later] |= 1 << earlier


def _order_writes(history: _History, waits: _Waits) -> None:
    """What makes something true and what makes it false keep to the order of the plan; so do changes of a value."""
    for writes in history.writes.values():
        for former, block in _neighbours(writes):
            for later in block:
                for earlier in former:
                    waits.add(later, earlier)
    values: dict[Fluent, list[tuple[int, int | None]]] = defaultdict(list)
    for position, footprint in enumerate(history.footprints):
        for fluent in footprint.writing.moved:
            values[fluent].append((position, None))
        for fluent in footprint.writing.assigned:
            values[fluent].append((position, position))
    for writes in values.values():
        for former, block in _neighbours(writes):
            for later in block:
                for earlier in former:
                    waits.add(later, earlier)


def _neighbours(writes: Sequence[tuple[int, object]]) -> Iterator[tuple[list[int], list[int]]]:
    """Blocks of equal writes, which commute, each with the one before it."""
    blocks = [[position for position, _ in block] for _, block in itertools.groupby(writes, key=lambda one: one[1])]
    return itertools.pairwise(blocks)


def _order_literal(
    writes: Sequence[tuple[int, bool]], initially: bool, wanted: bool, reader: _Reader, waits: _Waits
) -> None:
    """A predicate that has to be as ``wanted``: its reader waits for what made it so, and what unmakes it for that."""
    truth = initially
    maker = -1
    for position, made in writes:
        if position > reader.upto:
            break
        if made != truth:
            truth, maker = made, position
    if reader.first >= 0:
        waits.add(reader.first, maker)
    spoilt = False
    for position, made in writes:
        if position < reader.since:
            continue
        if made != wanted:
            spoilt = True
            waits.add(position, reader.last)
        elif spoilt:
            break


def _order_group(writers: int, reader: _Reader, waits: _Waits) -> None:
    """What is read otherwise has to be just as planned: all who write it come before or after, as in the plan."""
    last_inside = -1
    for position in _bits(writers):
        if position <= reader.upto:
            waits.add(reader.first, position)
        elif position >= reader.since:
            waits.add(position, reader.last)
        else:
            # It held after each of these, in their order, whenever they happen.
            waits.add(position, last_inside)
            last_inside = position


def _bits(mask: int) -> Iterator[int]:
    while mask:
        lowest = mask & -mask
        yield lowest.bit_length() - 1
        mask ^= lowest


def _reduced(history: _History, waits: _Waits, steps: int) -> CausalOrder:
    """The order without what follows from the rest, where ends may come too early."""
    starts: list[frozenset[PlanEvent]] = [frozenset()] * steps
    ends: list[frozenset[PlanEvent]] = [frozenset()] * steps
    implied: list[int] = []
    for position, happening in enumerate(history.order):
        own_start = history.starts.get(happening.step, -1) if happening.edge == "end" else -1
        covered = implied[own_start] if own_start >= 0 else 0
        all_before = covered
        needed: list[PlanEvent] = []
        for earlier in reversed(list(_bits(waits.before[position]))):
            if not covered >> earlier & 1:
                needed.append(history.order[earlier])
                covered |= implied[earlier]
        if happening.edge == "start":
            starts[happening.step] = frozenset(needed)
            all_before = covered
        else:
            ends[happening.step] = frozenset(needed)
        implied.append(all_before | 1 << position)
    return CausalOrder(tuple(starts), tuple(ends))
