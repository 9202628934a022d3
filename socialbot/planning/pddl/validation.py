"""Validation of plans by simulation, with their timeline and the read and write sets of their events."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.domain import (
    TOTAL_TIME,
    PddlDomain,
    PddlPlan,
    PddlProblem,
    PlanStep,
    TimedEffect,
    TimedInitialEffect,
)
from socialbot.planning.pddl.formulas import (
    Add,
    And,
    ConditionalEffect,
    Delete,
    Effect,
    Fluent,
    Formula,
    Key,
    Not,
    NumericComparison,
    NumericEffect,
    Or,
    Predicate,
    Quantified,
    UniversalEffect,
    simple_effects,
)
from socialbot.planning.pddl.semantics import (
    TOLERANCE,
    Binding,
    GroundAction,
    bindings,
    changes,
    evaluate,
    fluents,
    ground,
    substitute,
    triggered,
    truth,
    unmet,
)
from socialbot.planning.pddl.state import PddlState

EPSILON_S = 0.00005
"""Events nearer than this (s) are simultaneous."""

Edge = Literal["start", "end"]


class PlanEvent(NamedTuple):
    """Start or end of a step, given by its index; an instantaneous step only has a start."""

    step: int
    edge: Edge


@dataclass(frozen=True, slots=True)
class TimePoint:
    """Simultaneous events in the order of the steps: ends, then starts, then ends of steps that last 0 s."""

    time_s: float
    events: tuple[PlanEvent, ...]

    @property
    def phases(self) -> tuple[tuple[PlanEvent, ...], ...]:
        """The events in groups that happen one after the other: a step of 0 s ends after all starts."""
        late = tuple(one for one in self.events if one.edge == "end" and PlanEvent(one.step, "start") in self.events)
        return (tuple(one for one in self.events if one not in late), late) if late else (self.events,)


def time_points(plan: PddlPlan, actions: Sequence[GroundAction], running: Collection[int] = ()) -> list[TimePoint]:
    """Return the timeline of a plan.

    Args:
        running: Indexes of steps that have started before. They end first, one by one, in the order of their ends.
    """
    ends = sorted(running, key=lambda index: (plan.steps[index].end_s, index))
    found = [TimePoint(0.0, (PlanEvent(index, "end"),)) for index in ends]
    times: list[tuple[float, PlanEvent]] = []
    for index, (step, action) in enumerate(zip(plan.steps, actions, strict=True)):
        if index in running:
            continue
        times.append((step.start_s, PlanEvent(index, "start")))
        if action.duration is not None:
            times.append((step.end_s, PlanEvent(index, "end")))
    times.sort(key=lambda timed: timed[0])
    together: list[PlanEvent] = []
    begin = 0.0
    for time_s, happening in times:
        if together and time_s - begin >= EPSILON_S:
            found.append(TimePoint(begin, _in_order(together)))
            together = []
        if not together:
            begin = time_s
        together.append(happening)
    return [*found, TimePoint(begin, _in_order(together))] if together else found


def _in_order(together: list[PlanEvent]) -> tuple[PlanEvent, ...]:
    starts = {one.step for one in together if one.edge == "start"}
    return tuple(sorted(together, key=lambda one: (one.edge == "start" or 2 * (one.step in starts), one.step)))


@dataclass
class ReadWriteSets:
    """Read and write sets of an event. Derived predicates are replaced by those that they depend on.

    Attributes:
        literals: Predicates that must be true or false.
        groups: Other keys that a condition, an amount or a duration reads.
        added, deleted: Predicates that are made true or false; additions override deletions.
        moved, assigned: Functions that are only increased or decreased, and other changed functions.
    """

    literals: dict[Predicate, bool] = field(default_factory=dict)
    groups: list[frozenset[Key]] = field(default_factory=list)
    added: set[Predicate] = field(default_factory=set)
    deleted: set[Predicate] = field(default_factory=set)
    moved: set[Fluent] = field(default_factory=set)
    assigned: set[Fluent] = field(default_factory=set)

    @property
    def reads(self) -> frozenset[Key]:
        return frozenset(self.literals).union(*self.groups)

    @property
    def writes(self) -> frozenset[Key]:
        return frozenset((*self.added, *self.deleted, *self.moved, *self.assigned))

    def clash(self, other: ReadWriteSets) -> str | None:
        """Return a key for which two simultaneous events interfere; None if there is none."""
        found = (
            (self.reads & other.writes)
            | (other.reads & self.writes)
            | (self.added & other.deleted)
            | (self.deleted & other.added)
            | (self.assigned & (other.assigned | other.moved))
            | (self.moved & other.assigned)
        )
        return min(map(str, found), default=None)


class ReadWriteAnalysis:
    """Computes the read and write sets of the actions of a domain.

    Args:
        timed: Timed initial effects, which change the world as actions do.
        skip_settled: Leave out parts of conditions that no change can decide, such as those for which the rest of an
            ``or`` is constant. Interference of simultaneous events counts all atoms of their conditions (PDDL 2.1).
    """

    def __init__(
        self, domain: PddlDomain, timed: Iterable[TimedInitialEffect] = (), *, skip_settled: bool = True
    ) -> None:
        self._domain = domain
        self._skip_settled = skip_settled
        effects = [one.effect for action in domain.actions.values() for one in action.effects]
        changing = simple_effects((*effects, *(one.effect for one in timed)))
        changed = {one.predicate.name for one in changing if not isinstance(one, NumericEffect)}
        self._changing = frozenset((*changed, *domain.derived))

    def of(self, action: GroundAction, edge: Edge, state: PddlState) -> ReadWriteSets:
        """Return the read and write sets of the start or end of an action."""
        sets = self.reading(action.conditions_at(edge), state)
        effects = action.effects_at(edge)
        self._read_by_effects(effects, state, {}, sets)
        if edge == "start" and action.duration is not None:
            bounds = (action.duration.least, action.duration.most)
            _add_group(sets, (fluent for one in bounds if one is not None for fluent in fluents(one)))
        for effect in triggered(effects, state):
            match effect:
                case Add(predicate):
                    sets.added.add(predicate)
                case Delete(predicate):
                    sets.deleted.add(predicate)
                case NumericEffect(operator, fluent, _):
                    (sets.moved if operator in ("increase", "decrease") else sets.assigned).add(fluent)
        sets.moved -= sets.assigned
        return sets

    def reading(self, formulas: Iterable[Formula], state: PddlState) -> ReadWriteSets:
        """Return the read set of formulas."""
        sets = ReadWriteSets()
        for formula in formulas:
            self._read(formula, True, state, {}, sets)
        return sets

    def _read(self, formula: Formula, wanted: bool, state: PddlState, binding: Binding, into: ReadWriteSets) -> None:
        match formula:
            case Predicate(name):
                if name in self._domain.derived:
                    into.groups.append(state.derivation.bases(substitute(formula, binding), state))
                else:
                    into.literals[substitute(formula, binding)] = wanted
            case Not(part):
                self._read(part, not wanted, state, binding, into)
            case NumericComparison(_, left, right):
                into.groups.append(frozenset((*fluents(left, binding), *fluents(right, binding))))
            case And(parts) | Or(parts):
                listed = [(part, binding) for part in parts]
                self._read_parts(listed, wanted, isinstance(formula, Or) == wanted, state, into)
            case Quantified(quantifier, variables, part):
                instances = [(part, inner) for inner in bindings(variables, state, binding)]
                self._read_parts(instances, wanted, (quantifier == "exists") == wanted, state, into)

    def _read_parts(
        self,
        parts: list[tuple[Formula, Binding]],
        wanted: bool,
        any_decides: bool,
        state: PddlState,
        into: ReadWriteSets,
    ) -> None:
        """Read parts of a formula that are needed all, or of which any decides it; static parts may decide it then."""
        inside = into
        if any_decides:
            settled = [self._static_truth(part, state, inner) for part, inner in parts]
            if wanted in settled:
                return
            parts = [part for part, known in zip(parts, settled, strict=True) if known is None]
            inside = into if len(parts) == 1 else ReadWriteSets()
        for part, inner in parts:
            self._read(part, wanted, state, inner, inside)
        if inside is not into:
            _add_group(into, inside.reads)

    def _static_truth(self, formula: Formula, state: PddlState, binding: Binding) -> bool | None:
        """Return the truth of a static formula; None if actions can change it, or if nothing is to be skipped."""
        if not self._skip_settled:
            return None
        return truth(formula, _StaticWorld(state, self._changing), binding)  # type: ignore[arg-type]

    def _read_by_effects(
        self, effects: Iterable[Effect], state: PddlState, binding: Binding, into: ReadWriteSets
    ) -> None:
        """Read the amounts and conditions of effects; the truth of a condition matters either way."""
        for effect in effects:
            match effect:
                case UniversalEffect(variables, inside):
                    for inner in bindings(variables, state, binding):
                        self._read_by_effects(inside, state, inner, into)
                case ConditionalEffect(condition, inside):
                    if self._static_truth(condition, state, binding) is None:
                        into.groups.append(self.reading((substitute(condition, binding),), state).reads)
                    self._read_by_effects(inside, state, binding, into)
                case NumericEffect(_, _, amount):
                    _add_group(into, fluents(amount, binding))


def _add_group(sets: ReadWriteSets, keys: Iterable[Key]) -> None:
    group = frozenset(keys)
    if group:
        sets.groups.append(group)


@dataclass(frozen=True, slots=True)
class _StaticWorld:
    """View of a state in which everything that actions can change is undefined."""

    state: PddlState
    changing: frozenset[str]

    def holds(self, predicate: Predicate) -> bool | None:
        return None if predicate.name in self.changing else self.state.holds(predicate)

    def value(self, fluent: Fluent) -> None:
        return None

    def objects(self, types: tuple[str, ...]) -> Iterable[str]:
        return self.state.objects(types)


DURATION_S = 0.001
"""Tolerance of durations (s): plans are printed with three decimals."""


@dataclass(frozen=True, slots=True)
class PlanFault:
    """Error of a plan, with the index of the step and the violated condition if any.

    Attributes:
        interference: Two simultaneous events interfere, the later of them that of ``step``.
    """

    message: str
    time_s: float = 0.0
    step: int | None = None
    condition: Formula | None = None
    interference: bool = False

    def __str__(self) -> str:
        return f"{self.time_s:.3f} s: {self.message}"


def validate_plan(
    domain: PddlDomain, problem: PddlProblem, plan: PddlPlan, running: Collection[int] = ()
) -> tuple[PlanFault, ...]:
    """Simulate a plan by the rules of PDDL 2.1; return its errors in the order of time.

    Args:
        problem: Initial state and goal; without a goal any final state is valid.
        running: Indexes of steps that started before, and end before all others start.
    """
    state = PddlState.of(problem, domain)
    wrong = [
        PlanFault(message, step.start_s, index)
        for index, step in enumerate(plan.steps)
        if (message := _static_error(domain, state, step, index in running)) is not None
    ]
    if wrong:
        return tuple(wrong)
    return tuple(_Simulation(domain, state, plan, problem.timed, running).run(problem.goal))


def metric_value(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan) -> float | None:
    """Return the value of the metric of a problem after a valid plan; None if it has none or is undefined."""
    if problem.metric is None:
        return None
    state = PddlState.of(problem, domain)
    for _ in _Simulation(domain, state, plan, problem.timed, ()).run(None):
        pass
    if TOTAL_TIME not in domain.functions:
        state.values[Fluent(TOTAL_TIME)] = plan.makespan_s
    return evaluate(problem.metric.expression, state)


def state_after(state: PddlState, plan: PddlPlan) -> PddlState:
    """Apply all effects of a plan to a state, whether its conditions hold or not; return the state.

    Raises PlanningError for an effect on a function without a value.
    """
    actions = [ground(state.domain.actions[step.action], step.args) for step in plan.steps]
    for point in time_points(plan, actions):
        for index, edge in itertools.chain.from_iterable(point.phases):
            effects = actions[index].effects_at(edge)
            state.apply(changes(effects, state, duration=plan.steps[index].duration_s))
    return state


def _static_error(domain: PddlDomain, state: PddlState, step: PlanStep, running: bool = False) -> str | None:
    """Return an error that does not depend on the state: unknown name, wrong type or time; else None."""
    action = domain.actions.get(step.action)
    if action is None:
        return f"{step.call}: the domain has no action {step.action}"
    if len(step.args) != len(action.parameters):
        return f"{step.call}: {step.action} takes {len(action.parameters)} objects, not {len(step.args)}"
    for name, parameter in zip(step.args, action.parameters, strict=True):
        types = state.types.get(name)
        if types is None:
            return f"{step.call}: there is no object {name}"
        if not domain.belongs(types, parameter.types):
            return f"{step.call}: {name} is a {' and '.join(types)}, no {' or '.join(parameter.types)}"
    if not (math.isfinite(step.start_s) and math.isfinite(step.duration_s)):
        return f"{step.call}: its time is not finite"
    if running:
        return None if action.duration is not None else f"{step.call}: it is instantaneous and cannot be running"
    if step.start_s < -EPSILON_S:
        return f"{step.call} starts before the plan does"
    if action.duration is None and step.duration_s > DURATION_S:
        return f"{step.call} is instantaneous and cannot last {step.duration_s:g} s"
    if step.duration_s < 0:
        return f"{step.call} cannot last {step.duration_s:g} s"
    return None


class _Simulation:
    """Simulation of a plan. Timed initial effects are instantaneous steps after those of the plan."""

    def __init__(
        self,
        domain: PddlDomain,
        state: PddlState,
        plan: PddlPlan,
        timed: Sequence[TimedInitialEffect],
        running: Collection[int],
    ) -> None:
        self._state = state
        self._planned = len(plan.steps)
        self._steps = (*plan.steps, *(PlanStep(one.time_s, str(one)[1:-1]) for one in timed))
        self._actions = [ground(domain.actions[step.action], step.args) for step in plan.steps]
        self._actions += [GroundAction("at", (), None, (), (TimedEffect("start", one.effect),)) for one in timed]
        self._running = running
        self._sets = ReadWriteAnalysis(domain, timed)
        self._all_atoms = ReadWriteAnalysis(domain, timed, skip_settled=False)
        self._timeline = time_points(PddlPlan(self._steps), self._actions, running)
        self._invariants: dict[int, frozenset[Key]] = {}
        """Read sets of the invariants of running steps."""

    def run(self, goal: Formula | None) -> Iterator[PlanFault]:
        time_s = 0.0
        yield from self._check_invariants(self._running, time_s)
        for point in self._timeline:
            time_s = point.time_s
            yield from self._interference(point)
            for events in point.phases:
                yield from self._happen(events, time_s)
        for formula in unmet(() if goal is None else (goal,), self._state):
            yield PlanFault(f"the goal is not reached: {formula} does not hold", time_s, None, formula)

    def _happen(self, events: Sequence[PlanEvent], time_s: float) -> Iterator[PlanFault]:
        for event in events:
            yield from self._condition_errors(event, time_s)
        for event in events:
            if event.edge == "end":
                self._invariants.pop(event.step, None)
        changed: set[Key] = set()
        for event in events:
            yield from self._apply(event, time_s, changed)
        for index in [index for index, read in self._invariants.items() if not read.isdisjoint(changed)]:
            yield from self._invariant_errors(index, time_s)
        starts = (one.step for one in events if one.edge == "start")
        yield from self._check_invariants(
            (index for index in starts if self._actions[index].duration is not None), time_s
        )

    def _check_invariants(self, indexes: Iterable[int], time_s: float) -> Iterator[PlanFault]:
        for index in indexes:
            formulas = self._actions[index].conditions_at("over all")
            if formulas:
                self._invariants[index] = self._sets.reading(formulas, self._state).reads
                yield from self._invariant_errors(index, time_s)

    def _invariant_errors(self, index: int, time_s: float) -> Iterator[PlanFault]:
        call = self._steps[index].call
        for formula in unmet(self._actions[index].conditions_at("over all"), self._state):
            yield PlanFault(f"{call} cannot go on: {formula} does not hold", time_s, index, formula)

    def _condition_errors(self, event: PlanEvent, time_s: float) -> Iterator[PlanFault]:
        index, edge = event
        step = self._steps[index]
        for formula in unmet(self._actions[index].conditions_at(edge), self._state):
            yield PlanFault(f"{step.call} cannot {edge}: {formula} does not hold", time_s, index, formula)
        bounds = self._actions[index].duration
        if edge == "end" or bounds is None:
            return
        least = -math.inf if bounds.least is None else evaluate(bounds.least, self._state)
        most = math.inf if bounds.most is None else evaluate(bounds.most, self._state)
        if least is None or most is None:
            yield PlanFault(f"{step.call}: its duration has no value", time_s, index)
        elif step.duration_s < least - DURATION_S - TOLERANCE:
            yield PlanFault(f"{step.call} lasts {step.duration_s:g} s, less than {least:g} s", time_s, index)
        elif step.duration_s > most + DURATION_S + TOLERANCE:
            yield PlanFault(f"{step.call} lasts {step.duration_s:g} s, more than {most:g} s", time_s, index)

    def _apply(self, event: PlanEvent, time_s: float, changed: set[Key]) -> Iterator[PlanFault]:
        step = self._steps[event.step]
        effects = self._actions[event.step].effects_at(event.edge)
        try:
            made = changes(effects, self._state, duration=step.duration_s)
        except PlanningError as error:
            yield PlanFault(f"{step.call}: {error.what}", time_s, event.step)
            return
        self._state.apply(made)
        changed.update(made)

    def _interference(self, point: TimePoint) -> Iterator[PlanFault]:
        if len(point.events) < 2:
            return
        sets = [(one, self._all_atoms.of(self._actions[one.step], one.edge, self._state)) for one in point.events]
        for (one, mine), (other, theirs) in itertools.combinations(sets, 2):
            what = mine.clash(theirs) if one.step != other.step else None
            if what is not None:
                first, second = self._steps[one.step].call, self._steps[other.step].call
                yield PlanFault(
                    f"{first} cannot {one.edge} at the moment that {second} {other.edge}s: both need {what}",
                    point.time_s,
                    next((event.step for event in (other, one) if event.step < self._planned), None),
                    interference=True,
                )
