"""Causal order of a plan: the events that each start and end of a step has to wait for, independent of the clock.

An event waits for an earlier one if one reads what the other writes, or if both write in ways that do not commute. So
a plan remains valid if its steps start later, or take longer or shorter. For a predicate that must be true (or false),
only the first event that makes it so counts; repetitions delay nothing.

Detours are steps that only lead to another one of the same action, so that one step can stand for both. Searches for a
first plan let a robot drive from A to B and from B to C where it could drive from A to C.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.domain import SEPARATION_S, PddlDomain, PddlPlan, PddlProblem, PlanStep
from socialbot.planning.pddl.formulas import Add, Delete, Key, Predicate, conjuncts
from socialbot.planning.pddl.semantics import GroundAction, changes, evaluate, ground
from socialbot.planning.pddl.state import PddlState
from socialbot.planning.pddl.validation import (
    EPSILON_S,
    PlanEvent,
    ReadWriteAnalysis,
    ReadWriteSets,
    TimePoint,
    time_points,
    validate_plan,
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
    history.order_writes()
    for sets, reader in history.readings():
        for predicate, wanted in sets.literals.items():
            if predicate in history.writes:
                history.order_literal(predicate, state.holds(predicate), wanted, reader)
        for keys in sets.groups:
            history.order_group(keys, reader)
    return _reduced(history, len(plan.steps))


def contributing(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan) -> PddlPlan:
    """Return a valid plan without the steps that contribute nothing to its goal, not even through other steps.

    A search for a short makespan adds such steps wherever they cost no time. The result may be invalid if a step
    contributed in a way that its read and write sets do not show; validate it.
    """
    state = PddlState.of(problem, domain)
    history = _recorded(domain, state, plan, ())
    goals = () if problem.goal is None else (problem.goal,)
    needs = [ReadWriteAnalysis(domain).reading(goals, state)]  # _recorded has brought the state to the end of the plan
    reads: dict[int, list[ReadWriteSets]] = defaultdict(list)
    for event, sets in zip(history.order, history.sets, strict=True):
        reads[event.step].append(sets)
    for sets, reader in history.spans:
        reads[history.order[reader.last].step].append(sets)
    kept: set[int] = set()
    while needs:
        literals = {literal for sets in needs for literal in sets.literals.items()}
        keys = frozenset().union(*(group for sets in needs for group in sets.groups))
        serving = {
            event.step
            for event, sets in zip(history.order, history.sets, strict=True)
            if any((one, True) in literals for one in sets.added)
            or any((one, False) in literals for one in sets.deleted)
            or not keys.isdisjoint(sets.writes)
        }
        needs = [sets for step in serving - kept for sets in reads[step]]
        kept |= serving
    return PddlPlan(tuple(step for number, step in enumerate(plan.steps) if number in kept))


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
    """Events of a plan with their read and write sets; a position is an index in ``order``.

    Attributes:
        writes: Positions at which each key is written, with labels: adjacent writes with equal labels commute.
        waits: Earlier positions that each position has to wait for.
    """

    order: list[PlanEvent] = field(default_factory=list)
    sets: list[ReadWriteSets] = field(default_factory=list)
    starts: dict[int, int] = field(default_factory=dict)
    spans: list[tuple[ReadWriteSets, _Reader]] = field(default_factory=list)
    writes: dict[Key, list[tuple[int, object]]] = field(default_factory=lambda: defaultdict(list))
    waits: list[set[int]] = field(default_factory=list)

    def add(self, event: PlanEvent, sets: ReadWriteSets, invariants: ReadWriteSets) -> None:
        """Append an event; ``invariants`` are the read set over all of its step."""
        position = len(self.order)
        self.order.append(event)
        self.sets.append(sets)
        self.waits.append(set())
        if event.edge == "start":
            self.starts[event.step] = position
        else:
            start = self.starts.get(event.step, -1)
            self.spans.append((invariants, _Reader(start, position, start, position)))
        labels: tuple[tuple[Iterable[Key], object], ...] = (
            (sets.added, True), (sets.deleted - sets.added, False), (sets.moved, None), (sets.assigned, position),
        )  # fmt: skip
        for keys, label in labels:
            for key in keys:
                self.writes[key].append((position, label))

    def readings(self) -> Iterator[tuple[ReadWriteSets, _Reader]]:
        for position, sets in enumerate(self.sets):
            yield sets, _Reader(position, position, position - 1, position)
        yield from self.spans

    def wait(self, later: int, earlier: int) -> None:
        """Let ``later`` wait for ``earlier``, if both are positions and differ."""
        if 0 <= earlier < later:
            self.waits[later].add(earlier)

    def order_writes(self) -> None:
        """Keep the order of writes that do not commute."""
        for writes in self.writes.values():
            blocks = ([position for position, _ in block] for _, block in itertools.groupby(writes, lambda one: one[1]))
            for former, block in itertools.pairwise(blocks):
                for later, earlier in itertools.product(block, former):
                    self.wait(later, earlier)

    def order_literal(self, predicate: Predicate, initially: bool, wanted: bool, reader: _Reader) -> None:
        """Let a reader wait for the write that makes a predicate as wanted, and the reverting write for the reader."""
        truth: object = initially
        origin = -1
        for position, made in self.writes[predicate]:
            if position <= reader.upto and made != truth:
                truth, origin = made, position
        self.wait(reader.first, origin)
        reverted = False
        for position, made in self.writes[predicate]:
            if position < reader.since:
                continue
            if made != wanted:
                reverted = True
                self.wait(position, reader.last)
            elif reverted:
                break

    def order_group(self, keys: Iterable[Key], reader: _Reader) -> None:
        """Keep all writers of other keys before or after their reader, as in the plan."""
        last_inside = -1
        for position in sorted({position for key in keys for position, _ in self.writes.get(key, ())}):
            if position <= reader.upto:
                self.wait(reader.first, position)
            elif position >= reader.since:
                self.wait(position, reader.last)
            else:
                # The condition held after each write inside the span, in this order.
                self.wait(position, last_inside)
                last_inside = position


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
            history.add(event, sets[event], invariants[event.step])
            effects = actions[event.step].effects_at(event.edge)
            state.apply(changes(effects, state, duration=plan.steps[event.step].duration_s))
    return history


def _sequence(
    point: TimePoint, sets: dict[PlanEvent, ReadWriteSets], invariants: Sequence[ReadWriteSets]
) -> list[PlanEvent]:
    """Order simultaneous events: invariants of a step become true before its start, and false after its end."""
    waiting = list(point.events)
    if len(waiting) == 1:
        return waiting
    written = {one: one_set.writes for one, one_set in sets.items()}

    def comes_first(one: PlanEvent, other: PlanEvent) -> bool:
        needs_it = other.edge == "start" and not written[one].isdisjoint(invariants[other.step].reads)
        needed_it = one.edge == "end" and not written[other].isdisjoint(invariants[one.step].reads)
        return one.edge == "start" if one.step == other.step else needs_it or needed_it

    found: list[PlanEvent] = []
    while waiting:
        free = (one for one in waiting if not any(comes_first(other, one) for other in waiting))
        # Steps that require each other to start simultaneously have no order.
        found.append(next(free, waiting[0]))
        waiting.remove(found[-1])
    return found


def _reduced(history: _History, steps: int) -> CausalOrder:
    """Remove transitive waits, except through ends that may come early."""
    starts: list[frozenset[PlanEvent]] = [frozenset()] * steps
    ends: list[frozenset[PlanEvent]] = [frozenset()] * steps
    implied: list[frozenset[int]] = []
    for position, event in enumerate(history.order):
        is_start = event.edge == "start"
        own_start = -1 if is_start else history.starts.get(event.step, -1)
        before_own = implied[own_start] if own_start >= 0 else frozenset()
        covered, needed = set(before_own), []
        for earlier in sorted(history.waits[position], reverse=True):
            if earlier not in covered:
                needed.append(history.order[earlier])
                covered |= implied[earlier]
        (starts if is_start else ends)[event.step] = frozenset(needed)
        implied.append(frozenset((*(covered if is_start else before_own), position)))
    return CausalOrder(tuple(starts), tuple(ends))


_ROUNDS = 8
"""Largest number of times that the detours of a plan are removed: a detour of n steps needs n - 1 times."""


def without_detours(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan) -> PddlPlan:
    """Return a valid plan that is as long as a valid plan or shorter, and has no more steps."""
    for _ in range(_ROUNDS):
        detours = list(_detours(domain, PddlState.of(problem, domain), plan))
        shorter = _removed(domain, problem, plan, detours) if detours else None
        if shorter is None:
            break
        plan = shorter
    return plan


def successors(first: Sequence[str], last: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Yield objects for a step that may stand for two of its action, except those of the first."""
    choices = (dict.fromkeys(pair) for pair in zip(first, last, strict=True))
    yield from (args for args in itertools.product(*choices) if args != tuple(first))


def compacted(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan) -> PddlPlan | None:
    """Return a plan with each step as early as the causal order allows; None if it is not valid."""
    try:
        order = causal_order(domain, problem, plan)
    except PlanningError:
        return None
    times: dict[tuple[int, str], float] = {}
    steps = list(plan.steps)
    for number in sorted(range(len(steps)), key=lambda number: steps[number].start_s):
        step = steps[number]
        if any(event not in times for event in order.before_start[number]):
            return None
        starts = [times[event] + SEPARATION_S for event in order.before_start[number]]
        ends = [times[event] + SEPARATION_S - step.duration_s for event in order.before_end[number] if event in times]
        steps[number] = step = replace(step, start_s=max((0.0, *starts, *ends)))
        times[number, "start"], times[number, "end"] = step.start_s, step.end_s
    early = PddlPlan(tuple(sorted(steps, key=lambda step: step.start_s)))
    return None if validate_plan(domain, problem, early) else early


@dataclass(frozen=True)
class _Detour:
    """Two steps, and the one that can stand for them."""

    first: PlanStep
    last: PlanStep
    direct: PlanStep


@dataclass(frozen=True)
class _Sets:
    """Predicates that an action needs, adds and deletes."""

    needs: frozenset[Predicate]
    added: frozenset[Predicate]
    deleted: frozenset[Predicate]

    @classmethod
    def of(cls, action: GroundAction) -> _Sets:
        parts = (part for one in action.conditions for part in conjuncts(one.formula))
        effects = [one.effect for one in action.effects]
        return cls(
            frozenset(part for part in parts if isinstance(part, Predicate)),
            frozenset(effect.predicate for effect in effects if isinstance(effect, Add)),
            frozenset(effect.predicate for effect in effects if isinstance(effect, Delete)),
        )


def _detours(domain: PddlDomain, state: PddlState, plan: PddlPlan) -> Iterator[_Detour]:
    """Yield detours that share no steps. What a first step adds, its last step alone needs, and deletes."""
    steps = sorted(plan.steps, key=lambda step: step.start_s)
    sets = [_Sets.of(ground(domain.actions[step.action], step.args)) for step in steps]
    users: defaultdict[Predicate, list[int]] = defaultdict(list)
    for number, one in enumerate(sets):
        for predicate in one.needs:
            users[predicate].append(number)
    used: set[int] = set()
    for number, step in enumerate(steps):
        later = [
            next((user for user in users[predicate] if steps[user].start_s >= step.end_s - EPSILON_S), None)
            for predicate in sets[number].added
        ]
        last = min((user for user in later if user is not None), default=number)
        if last == number or steps[last].action != step.action or used & {number, last}:
            continue
        if not sets[number].added & sets[last].needs <= sets[last].deleted:
            continue
        for args in successors(step.args, steps[last].args):
            direct = _Sets.of(ground(domain.actions[step.action], args))
            new = direct.needs - sets[number].needs
            if (
                direct.deleted == sets[number].deleted
                and direct.added == sets[last].added
                and all(map(state.holds, new))
                and (one := _step(domain, state, step, args)) is not None
            ):
                used |= {number, last}
                yield _Detour(step, steps[last], one)
                break


def _step(domain: PddlDomain, state: PddlState, step: PlanStep, args: tuple[str, ...]) -> PlanStep | None:
    duration = ground(domain.actions[step.action], args).duration
    if duration is None:
        return replace(step, args=args)
    least_s = None if duration.least is None else evaluate(duration.least, state)
    return None if least_s is None else replace(step, args=args, duration_s=least_s)


def _removed(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan, detours: Sequence[_Detour]) -> PddlPlan | None:
    """Return the plan without some of the detours, all of them if possible; None if it is not shorter."""
    gone = {step for detour in detours for step in (detour.first, detour.last)}
    steps = [*(step for step in plan.steps if step not in gone), *(detour.direct for detour in detours)]
    fewer = PddlPlan(tuple(sorted(steps, key=lambda step: step.start_s)))
    shorter = compacted(domain, problem, fewer)
    if shorter is not None and shorter.makespan_s <= plan.makespan_s + EPSILON_S:
        return shorter
    if len(detours) == 1:
        return None
    half = len(detours) // 2
    return _removed(domain, problem, plan, detours[:half]) or _removed(domain, problem, plan, detours[half:])
