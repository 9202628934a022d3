"""Execution state of a plan: its steps as tasks, predicted facts, and merging of a repaired plan."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from socialbot.core.clock import SECOND
from socialbot.core.errors import PlanningError
from socialbot.deliberation.actions import progress_of
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.messages import ActionExecutionInfo, ActionStatus, Desire, PlanExecutionInfo, PlanStatus
from socialbot.planning.pddl.causal_order import causal_order
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem, PlanStep
from socialbot.planning.pddl.formulas import Effect, Fluent, Formula, Key, PddlWorld, Predicate
from socialbot.planning.pddl.semantics import TOLERANCE, Changes, GroundAction, change_text, changes, ground
from socialbot.planning.pddl.state import PddlState, Projection
from socialbot.planning.pddl.validation import PlanEvent, validate_plan

if TYPE_CHECKING:
    from socialbot.bdi.intentions import Failure, Intention


Phase = Literal["waiting", "acting", "ending", "settling", "over"]
"""Phases of a task: before its start; action runs; end conditions do not hold yet; sensed effects missing; ended."""

NEARLY = 0.99
"""Progress of an action that reports none and takes longer than planned."""


@dataclass(eq=False)
class PlanTask:
    """A step of a plan during its execution. An instantaneous action has all its effects at its end.

    Attributes:
        before_start, before_end: Events that must happen before the task may start or end.
        since, unmet_since: Times (ns) at which the phase began and a condition stopped holding.
        expected: Effects that sensors have still to report.
        starting_values: What the end effects change and sensors report, with its values after the start.
        started_changes: Effects of its start.
        presumed: Facts that count at its start although sensors do not show them: it goes on from a stopped step.
    """

    step: PlanStep
    action: GroundAction
    before_start: tuple[TaskEvent, ...] = ()
    before_end: tuple[TaskEvent, ...] = ()
    phase: Phase = "waiting"
    status: ActionStatus = "WAITING"
    record: str = ""
    message: str = ""
    since: int = 0
    started: int | None = None
    ended: int | None = None
    unmet_since: int | None = None
    intention: Intention | None = None
    outcome: tuple[Failure | None] | None = None
    expected: Changes = field(default_factory=dict)
    starting_values: dict[Key, bool | float | None] = field(default_factory=dict)
    started_changes: Changes = field(default_factory=dict)
    presumed: Changes = field(default_factory=dict)
    _progress: float = 0.0

    @property
    def active(self) -> bool:
        return self.phase in ("acting", "ending", "settling")

    def effects(self, when: Literal["start", "end"]) -> tuple[Effect, ...]:
        if self.action.duration is None:
            return () if when == "start" else self.action.effects_at("start")
        return self.action.effects_at(when)

    def changes(self, when: Literal["start", "end"], world: PddlWorld) -> Changes:
        """Return its effects in a world. Raises PlanningError for fluents without a value."""
        return changes(self.effects(when), world, duration=self.step.duration_s)

    def end_changes(self, world: PddlWorld, domain: PddlDomain) -> Changes:
        """Return its end effects from `starting_values`, as sensors may have reported some of them already."""
        return self.changes("end", Projection(world, domain, self.known_starting_values))

    @property
    def known_starting_values(self) -> Changes:
        return {key: value for key, value in self.starting_values.items() if value is not None}

    def without_end_effects(self, world: PddlWorld, domain: PddlDomain) -> Changes:
        """Return what its end effects have changed in a world already, as it would be without them."""
        found: Changes = {}
        for key, new in self.end_changes(world, domain).items():
            before, now = self.starting_values.get(key), world.value(key) if isinstance(key, Fluent) else None
            if before is not None and self.is_seen(key, new, world):
                found[key] = before if now is None else now - new + before
        return found

    def first_unseen(self, world: PddlWorld) -> str | None:
        """Return the first expected effect that sensors have not reported; None if there is none."""
        unseen = (change_text(key, new) for key, new in self.expected.items() if not self.is_seen(key, new, world))
        return next(unseen, None)

    def note_seen(self, world: PddlWorld) -> None:
        """Expect no longer what a world shows. Another task or person may change it again before this task ends."""
        self.expected = {key: new for key, new in self.expected.items() if not self.is_seen(key, new, world)}

    def is_seen(self, key: Key, new: bool | float, world: PddlWorld) -> bool:
        """Return whether a world shows an effect; numbers may be beyond it, as other tasks change them too."""
        if isinstance(key, Fluent):
            return _is_reached(self.starting_values.get(key), world.value(key), new)
        return world.holds(key) == new

    def has_happened(self, what: Literal["start", "end"]) -> bool:
        if what == "start" and self.action.duration is not None:
            return self.started is not None
        return self.status == "SUCCESSFUL"

    def enter(self, phase: Phase, now: int) -> None:
        self.phase, self.since, self.unmet_since = phase, now, None

    def lasted_s(self, now: int) -> float:
        """Return the time (s) since its start."""
        if self.started is None:
            return 0.0
        return ((now if self.ended is None else self.ended) - self.started) / SECOND

    def progress(self, now: int) -> float:
        """Return its progress, 0 to 1: that of the action, or estimated from the time."""
        if self.phase == "acting":
            reported = self._reported_progress()
            spent = self.lasted_s(now) / self.step.duration_s if self.step.duration_s > 0 else NEARLY
            self._progress = min(spent, NEARLY) if reported is None else reported
        elif self.active or self.status == "SUCCESSFUL":
            self._progress = 1.0
        return self._progress

    def length_s(self, now: int) -> float:
        """Return its total duration (s): actual, extrapolated or planned."""
        if self.started is None:
            return self.step.duration_s
        lasted = self.lasted_s(now)
        if self.phase != "acting":
            return lasted
        reported = self._reported_progress()
        return lasted / reported if reported else max(lasted, self.step.duration_s)

    def _reported_progress(self) -> float | None:
        return None if self.intention is None else progress_of(self.intention)


TaskEvent = tuple[PlanTask, Literal["start", "end"]]
"""Start or end of a task."""


@dataclass(eq=False)
class PlanExecution:
    """Execution of a plan for a desire; ``number`` counts the plans of the agent. Times are in ns."""

    number: int
    desire: Desire
    tasks: tuple[PlanTask, ...]
    makespan_s: float
    began: int
    pursued_since: int
    record: str = ""
    end_record: str = ""
    status: PlanStatus = "RUNNING"
    reason: str = ""

    def active(self) -> Iterator[PlanTask]:
        return (task for task in self.tasks if task.active)

    def released(self) -> Iterator[PlanTask]:
        """Return the tasks that wait only for their conditions, in the order of the plan."""
        return (task for task in self.tasks if task.phase == "waiting" and have_happened(task.before_start))

    def state(self) -> str:
        """Return a text that differs if the status of the plan or of a step does."""
        return " ".join((str(self.number), self.status, *(f"{task.status} {task.message}" for task in self.tasks)))

    def info(self, agent_id: str, now: int) -> PlanExecutionInfo:
        numbers = {task: number for number, task in enumerate(self.tasks)}
        return PlanExecutionInfo(
            stamp=now,
            agent_id=agent_id,
            plan=self.number,
            target=self.desire,
            actions_exec_info=tuple(self._info(task, numbers, now) for task in self.tasks),
            current_time=self.seconds(now),
            planned_deadline=self.makespan_s,
            estimated_deadline=self.estimated_end_s(now),
            status=self.status,
            reason=self.reason,
        )

    def seconds(self, time: int) -> float:
        return (time - self.began) / SECOND

    def estimated_end_s(self, now: int) -> float:
        earliest = self.seconds(now)
        starts: dict[PlanTask, float] = {}
        ends: dict[PlanTask, float] = {}
        for task in self.tasks:
            if task.started is not None:
                starts[task] = self.seconds(task.started)
            else:
                waits = (starts.get(other, 0.0) if what == "start" else ends.get(other, 0.0)
                         for other, what in task.before_start)  # fmt: skip
                starts[task] = max((earliest, *waits))
            ends[task] = starts[task] + task.length_s(now)
        return max(ends.values(), default=0.0)

    def _info(self, task: PlanTask, numbers: dict[PlanTask, int], now: int) -> ActionExecutionInfo:
        return ActionExecutionInfo(
            index=numbers[task],
            name=task.step.action,
            args=task.step.args,
            # A running task may have waited for steps of an earlier plan.
            wait_action_indexes=tuple(sorted({numbers[other] for other, _ in task.before_start if other in numbers})),
            planned_start=task.step.start_s,
            actual_start=None if task.started is None else self.seconds(task.started),
            duration=task.step.duration_s,
            exec_time=task.lasted_s(now),
            progress=task.progress(now),
            status=task.status,
            message=task.message,
        )


def have_happened(events: Iterable[TaskEvent]) -> bool:
    return all(task.has_happened(what) for task, what in events)


def _is_reached(start: float | None, now: float | None, end: float) -> bool:
    if now is None:
        return False
    close = abs(now - end) <= TOLERANCE * max(1.0, abs(end))
    if start is None or start == end:
        return close
    return close or (now > end) == (end > start)


def projected(facts: FactBase, domain: PddlDomain, running: Iterable[PlanTask], goal: Formula | None) -> PddlProblem:
    """Return the predicted facts after the end of the running tasks."""
    state = PddlState.of(facts.problem(goal), domain)
    for task in sorted(running, key=_end):
        _apply_unseen(state, task)
        _apply_end(state, task)
    return state.problem(goal)


def with_expected(problem: PddlProblem, facts: FactBase, running: Iterable[PlanTask]) -> PddlProblem:
    """Return a problem with the expected effects of running tasks that sensors have not reported."""
    state, seen = PddlState.of(problem, facts.domain), PddlState.of(facts.problem(), facts.domain)
    for task in running:
        state.apply({key: new for key, new in task.expected.items() if not task.is_seen(key, new, seen)})
    return state.problem(problem.goal)


def merged(
    domain: PddlDomain,
    facts: FactBase,
    plan: PddlPlan,
    goal: Formula,
    running: tuple[PlanTask, ...],
    now: int,
    assumed: Mapping[Key, bool | float | None] | None = None,
) -> tuple[PlanTask, ...]:
    """Return the running tasks followed by those of a plan that starts from the `projected` facts.

    Values that are ``assumed`` replace those of the facts. Raises PlanningError if the plan is not valid for them.
    """
    ending = tuple(task for task in running if task.phase == "settling" or task.action.duration is None)
    continuing = tuple(task for task in running if task not in ending)
    state = PddlState.of(facts.problem(goal), domain)
    _assume(state, assumed or {})
    for task in sorted(ending, key=_end):
        _apply_unseen(state, task)
        _apply_end(state, task)
    for task in sorted(continuing, key=_end):
        _apply_unseen(state, task)
        state.apply(task.known_starting_values)
    problem = state.problem(goal)
    steps = [replace(task.step, start_s=((task.started or 0) - now) / SECOND) for task in continuing]
    whole = PddlPlan((*steps, *plan.steps))
    before = range(len(continuing))
    wrong = validate_plan(domain, problem, whole, before)
    if wrong:
        raise PlanningError(f"the plan does not fit what is believed now: {wrong[0]}")
    order = causal_order(domain, problem, whole, before)
    for task, step in zip(continuing, steps, strict=True):
        task.step = step
    new = tuple(PlanTask(step, ground(domain.actions[step.action], step.args)) for step in plan.steps)
    tasks = (*continuing, *new)
    for number, task in enumerate(tasks):
        task.before_end = _task_events(order.before_end[number], tasks)
        if number not in before:
            task.before_start = (
                *((other, "end") for other in ending),
                *((other, "end") for other in _same_before(number, tasks, len(continuing))),
                *_task_events(order.before_start[number], tasks),
            )
    return (*ending, *tasks)


def _same_before(number: int, tasks: tuple[PlanTask, ...], running: int) -> tuple[PlanTask, ...]:
    """Return earlier tasks with the same call: PDDL allows them at once, but actions do not."""
    task = tasks[number]
    return tuple(
        other
        for index, other in enumerate(tasks[:number])
        if other.step.call == task.step.call and (index < running or other.step.end_s <= task.step.start_s)
    )


def _task_events(numbered: Collection[PlanEvent], tasks: tuple[PlanTask, ...]) -> tuple[TaskEvent, ...]:
    return tuple((tasks[number], edge) for number, edge in sorted(numbered))


def _assume(state: PddlState, values: Mapping[Key, bool | float | None]) -> None:
    state.apply({key: value or False for key, value in values.items() if isinstance(key, Predicate)})
    for key, value in values.items():
        if isinstance(key, Fluent) and value is None:
            state.values.pop(key, None)
        elif isinstance(key, Fluent) and value is not None:
            state.apply({key: value})


def _end(task: PlanTask) -> float:
    return (task.started or 0) / SECOND + task.step.duration_s


def _apply_unseen(state: PddlState, task: PlanTask) -> None:
    """Apply the expected effects of a task that sensors have not reported."""
    state.apply({key: new for key, new in task.expected.items() if not task.is_seen(key, new, state)})


def _apply_end(state: PddlState, task: PlanTask) -> None:
    changed = task.end_changes(state, state.domain)
    seen = {key for key, new in changed.items() if key in task.starting_values and task.is_seen(key, new, state)}
    state.apply({key: new for key, new in changed.items() if key not in seen})
