"""The validation of plans: each is carried out on paper, by the rules of PDDL 2.1."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from socialbot.core.errors import PlanningError
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem, PlanStep
from socialbot.planning.pddl.formulas import Formula
from socialbot.planning.pddl.read_write_sets import EPSILON_S, Key, PlanEvent, ReadWriteAnalysis, TimePoint, time_points
from socialbot.planning.pddl.semantics import TOLERANCE, GroundAction, SetValue, changes, evaluate, ground, unmet
from socialbot.planning.pddl.state import PddlState

DURATION_S = 0.001
"""Tolerance of durations (s): plans are printed with three decimals."""


@dataclass(frozen=True, slots=True)
class PlanFault:
    """Error of a plan, with the index of the step and the violated condition if any."""

    message: str
    time_s: float = 0.0
    step: int | None = None
    condition: Formula | None = None

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
    actions = [ground(domain.actions[step.action], step.args) for step in plan.steps]
    return tuple(_Simulation(domain, state, plan, actions, running).run(problem.goal))


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
        if not domain.fits(types, parameter.types):
            return f"{step.call}: {name} is a {' or '.join(types)}, no {' or '.join(parameter.types)}"
    if not (math.isfinite(step.start_s) and math.isfinite(step.duration_s)):
        return f"{step.call}: it has no proper time"
    if running:
        return None if action.duration is not None else f"{step.call}: it is instantaneous and cannot be running"
    if step.start_s < -EPSILON_S:
        return f"{step.call} starts before the plan does"
    if action.duration is None and step.duration_s > DURATION_S:
        return f"{step.call} is instantaneous and cannot last {step.duration_s:g} s"
    if action.duration is not None and step.duration_s < EPSILON_S:
        return f"{step.call} lasts no time at all"
    return None


class _Simulation:
    def __init__(
        self,
        domain: PddlDomain,
        state: PddlState,
        plan: PddlPlan,
        actions: Sequence[GroundAction],
        running: Collection[int],
    ) -> None:
        self._state = state
        self._steps = plan.steps
        self._actions = actions
        self._running = running
        self._sets = ReadWriteAnalysis(domain)
        self._timeline = time_points(plan, actions, running)
        self._invariants: dict[int, frozenset[Key]] = {}
        """Read sets of the invariants of running steps."""

    def run(self, goal: Formula | None) -> Iterator[PlanFault]:
        time_s = 0.0
        yield from self._check_invariants(self._running, time_s)
        for point in self._timeline:
            time_s = point.time_s
            yield from self._interference(point)
            for event in point.events:
                yield from self._condition_errors(event, time_s)
            for event in point.events:
                if event.edge == "end":
                    self._invariants.pop(event.step, None)
            changed: set[Key] = set()
            for event in point.events:
                yield from self._apply(event, time_s, changed)
            for index in [index for index, read in self._invariants.items() if not read.isdisjoint(changed)]:
                yield from self._invariant_errors(index, time_s)
            starts = (one.step for one in point.events if one.edge == "start")
            yield from self._check_invariants(
                (index for index in starts if self._actions[index].duration is not None), time_s
            )
        for formula in unmet(() if goal is None else (goal,), self._state):
            yield PlanFault(f"the goal is not reached: {formula} does not hold", time_s, None, formula)

    def _check_invariants(self, indexes: Iterable[int], time_s: float) -> Iterator[PlanFault]:
        for index in indexes:
            formulas = self._actions[index].conditions_at("over all")
            if formulas:
                self._invariants[index] = self._sets.reading(formulas, self._state).keys
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
        least = None if bounds.least is None else evaluate(bounds.least, self._state)
        most = None if bounds.most is None else evaluate(bounds.most, self._state)
        if (bounds.least is not None and least is None) or (bounds.most is not None and most is None):
            yield PlanFault(f"{step.call}: its duration has no value", time_s, index)
        elif least is not None and step.duration_s < least - DURATION_S - TOLERANCE:
            yield PlanFault(f"{step.call} lasts {step.duration_s:g} s, less than {least:g} s", time_s, index)
        elif most is not None and step.duration_s > most + DURATION_S + TOLERANCE:
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
        changed.update(one.fluent if isinstance(one, SetValue) else one.predicate for one in made)

    def _interference(self, point: TimePoint) -> Iterator[PlanFault]:
        if len(point.events) < 2:
            return
        prints = [(one, self._sets.of(self._actions[one.step], one.edge, self._state)) for one in point.events]
        for (one, mine), (other, theirs) in itertools.combinations(prints, 2):
            what = mine.clash(theirs)
            if what is not None:
                first, second = self._steps[one.step].call, self._steps[other.step].call
                yield PlanFault(
                    f"{first} cannot {one.edge} at the moment that {second} {other.edge}s: both need {what}",
                    point.time_s,
                    other.step,
                )
