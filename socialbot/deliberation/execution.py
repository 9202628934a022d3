"""The execution state of a plan: its steps as tasks, predicted facts, and merging of a repaired plan."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from socialbot.core.clock import SECOND
from socialbot.core.errors import PlanningError
from socialbot.deliberation.actions import progress_of
from socialbot.deliberation.facts import FactBase
from socialbot.deliberation.messages import ActionExecutionInfo, ActionStatus, Desire, PlanExecutionInfo, PlanStatus
from socialbot.planning.pddl.causal_order import causal_order
from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem, PlanStep
from socialbot.planning.pddl.formulas import Add, Delete, Effect, Fluent, Formula, PddlWorld, Predicate
from socialbot.planning.pddl.read_write_sets import PlanEvent
from socialbot.planning.pddl.semantics import TOLERANCE, GroundAction, GroundChange, SetValue, changes, ground
from socialbot.planning.pddl.state import Derivation, PddlState
from socialbot.planning.pddl.validation import validate_plan

if TYPE_CHECKING:
    from socialbot.bdi.intentions import Failure, Intention


class Projection:
    """A world after some changes, with what is derived then; the world itself stays as it is."""

    def __init__(self, world: PddlWorld, domain: PddlDomain, changes: Iterable[GroundChange] = ()) -> None:
        self._world = world
        self._domain = domain
        self._derived: frozenset[Predicate] | None = None
        self._predicates: dict[Predicate, bool] = {}
        self._values: dict[Fluent, float] = {}
        for change in changes:
            match change:
                case Add(predicate):
                    self._predicates[predicate] = True
                case Delete(predicate):
                    self._predicates[predicate] = False
                case SetValue(fluent, value):
                    self._values[fluent] = value

    def after(self, changes: Iterable[GroundChange]) -> Projection:
        """This world after some more changes."""
        return Projection(self, self._domain, changes)

    def holds(self, predicate: Predicate) -> bool:
        if predicate.name in self._domain.derived:
            if self._derived is None:
                self._derived = Derivation(self._domain).derived(self)
            return predicate in self._derived
        known = self._predicates.get(predicate)
        return self._world.holds(predicate) if known is None else known

    def value(self, fluent: Fluent) -> float | None:
        known = self._values.get(fluent)
        return self._world.value(fluent) if known is None else known

    def objects(self, types: tuple[str, ...]) -> Iterable[str]:
        return self._world.objects(types)


Phase = Literal["waiting", "acting", "ending", "settling", "over"]
"""A task waits for its turn; its action goes on; that is done, but what has to hold at the end does not yet; the
sensors have not yet seen the effects; it is over."""

NEARLY = 0.99
"""The progress of an action that lasts longer than planned, and does not tell how far it is."""


@dataclass(eq=False)
class PlanTask:
    """A step that is carried out. ``before_start`` and ``before_end`` are the happenings that it has to wait for.

    All of an instantaneous action happens at its end, when it has been carried out. ``since`` (ns) is when the phase
    began, ``unmet_since`` when a condition stopped holding. ``expected`` are the effects that sensors have to see,
    and ``starting_values`` the numbers among them as they were when it had begun.
    """

    step: PlanStep
    action: GroundAction
    before_start: tuple[Happening, ...] = ()
    before_end: tuple[Happening, ...] = ()
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
    expected: tuple[GroundChange, ...] = ()
    starting_values: dict[Fluent, float | None] = field(default_factory=dict)
    _progress: float = 0.0

    @property
    def active(self) -> bool:
        """Whether it has begun and is not over."""
        return self.phase in ("acting", "ending", "settling")

    def effects(self, when: Literal["start", "end"]) -> tuple[Effect, ...]:
        """What it changes then."""
        if self.action.duration is None:
            return () if when == "start" else self.action.effects_at("start")
        return self.action.effects_at(when)

    def changes(self, when: Literal["start", "end"], world: PddlWorld) -> list[GroundChange]:
        """What that comes down to in a world. Raises PlanningError for numbers that have no value."""
        return changes(self.effects(when), world, duration=self.step.duration_s)

    def as_when_begun(self, world: PddlWorld, domain: PddlDomain) -> Projection:
        """A world with the numbers that sensors tell as they were when it had begun.

        A sensor may have seen already by how much the task has changed them.
        """
        values = self.starting_values.items()
        return Projection(world, domain, (SetValue(fluent, value) for fluent, value in values if value is not None))

    def first_unseen(self, world: PddlWorld) -> GroundChange | None:
        """The first of the effects that sensors have to see which they have not seen; None when there is none."""
        return next((change for change in self.expected if not self.is_seen(change, world)), None)

    def is_seen(self, change: GroundChange, world: PddlWorld) -> bool:
        """Whether an effect is what a world shows; numbers may have gone further, as others change them, too."""
        match change:
            case Add(predicate):
                return world.holds(predicate)
            case Delete(predicate):
                return not world.holds(predicate)
            case SetValue(fluent, value):
                return _has_come(self.starting_values.get(fluent), world.value(fluent), value)

    def has_happened(self, what: Literal["start", "end"]) -> bool:
        """Whether it has begun, or ended well."""
        if what == "start" and self.action.duration is not None:
            return self.started is not None
        return self.status == "SUCCESSFUL"

    def enter(self, phase: Phase, now: int) -> None:
        """Begins another phase."""
        self.phase, self.since, self.unmet_since = phase, now, None

    def lasted_s(self, now: int) -> float:
        """How long it has gone on, s."""
        if self.started is None:
            return 0.0
        return ((now if self.ended is None else self.ended) - self.started) / SECOND

    def progress(self, now: int) -> float:
        """How far it is, 0 to 1: as the action says, or else by the time that has passed."""
        if self.phase == "acting":
            told = self._told()
            spent = self.lasted_s(now) / self.step.duration_s if self.step.duration_s > 0 else NEARLY
            self._progress = min(spent, NEARLY) if told is None else told
        elif self.active or self.status == "SUCCESSFUL":
            self._progress = 1.0
        return self._progress

    def length_s(self, now: int) -> float:
        """How long it lasts in all, s: as it has, at its pace so far, or as planned."""
        if self.started is None:
            return self.step.duration_s
        lasted = self.lasted_s(now)
        if self.phase != "acting":
            return lasted
        told = self._told()
        return lasted / told if told else max(lasted, self.step.duration_s)

    def _told(self) -> float | None:
        return None if self.intention is None else progress_of(self.intention)


Happening = tuple[PlanTask, Literal["start", "end"]]
"""The start or the end of a task."""


@dataclass(eq=False)
class PlanExecution:
    """A plan that is carried out for a desire; ``number`` counts the plans of the agent. Times are ns."""

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
        """The tasks that have begun and are not over, in the order of the plan."""
        return (task for task in self.tasks if task.active)

    def released(self) -> Iterator[PlanTask]:
        """The tasks that wait only for their conditions, in the order of the plan."""
        return (task for task in self.tasks if task.phase == "waiting" and have_happened(task.before_start))

    def state(self) -> str:
        """A text that changes with the status of the plan or of a step."""
        return " ".join((str(self.number), self.status, *(f"{task.status} {task.message}" for task in self.tasks)))

    def info(self, agent_id: str, now: int) -> PlanExecutionInfo:
        """How it fares."""
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
        """A time as s from the start of the plan."""
        return (time - self.began) / SECOND

    def estimated_end_s(self, now: int) -> float:
        """When all will be over as it looks now, s from the start of the plan."""
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
            # One that has begun may have waited for steps of an earlier plan.
            wait_action_indexes=tuple(sorted({numbers[other] for other, _ in task.before_start if other in numbers})),
            planned_start=task.step.start_s,
            actual_start=None if task.started is None else self.seconds(task.started),
            duration=task.step.duration_s,
            exec_time=task.lasted_s(now),
            progress=task.progress(now),
            status=task.status,
            message=task.message,
        )


def have_happened(happenings: Iterable[Happening]) -> bool:
    """Whether all of some happenings have occurred."""
    return all(task.has_happened(what) for task, what in happenings)


def _has_come(start: float | None, now: float | None, end: float) -> bool:
    if now is None:
        return False
    close = abs(now - end) <= TOLERANCE * max(1.0, abs(end))
    if start is None or start == end:
        return close
    return close or (now > end) == (end > start)


def projected(facts: FactBase, domain: PddlDomain, running: Iterable[PlanTask], goal: Formula | None) -> PddlProblem:
    """What will be believed when the running tasks have ended as planned."""
    state = PddlState.of(facts.problem(goal), domain)
    for task in sorted(running, key=_end):
        _see(state, task)
        _end_in(state, task)
    return state.problem(goal)


def merged(
    domain: PddlDomain, facts: FactBase, plan: PddlPlan, goal: Formula, running: tuple[PlanTask, ...], now: int
) -> tuple[PlanTask, ...]:
    """The tasks for a plan that starts from what is `projected`, after those that are running.

    Raises PlanningError when the plan does not do what it shall, as things are believed now.
    """
    ending = tuple(task for task in running if task.phase == "settling" or task.action.duration is None)
    going_on = tuple(task for task in running if task not in ending)
    state = PddlState.of(facts.problem(goal), domain)
    for task in sorted(ending, key=_end):
        _see(state, task)
        _end_in(state, task)
    for task in sorted(going_on, key=_end):
        _see(state, task)
        state.apply(SetValue(fluent, value) for fluent, value in task.starting_values.items() if value is not None)
    problem = state.problem(goal)
    steps = [replace(task.step, start_s=((task.started or 0) - now) / SECOND) for task in going_on]
    whole = PddlPlan((*steps, *plan.steps))
    before = range(len(going_on))
    wrong = validate_plan(domain, problem, whole, before)
    if wrong:
        raise PlanningError(f"the plan does not fit what is believed now: {wrong[0]}")
    order = causal_order(domain, problem, whole, before)
    for task, step in zip(going_on, steps, strict=True):
        task.step = step
    new = tuple(PlanTask(step, ground(domain.actions[step.action], step.args)) for step in plan.steps)
    tasks = (*going_on, *new)
    for number, task in enumerate(tasks):
        task.before_end = _happenings(order.before_end[number], tasks)
        if number not in before:
            task.before_start = (
                *((other, "end") for other in ending),
                *((other, "end") for other in _same_before(number, tasks, len(going_on))),
                *_happenings(order.before_start[number], tasks),
            )
    return (*ending, *tasks)


def _same_before(number: int, tasks: tuple[PlanTask, ...], running: int) -> tuple[PlanTask, ...]:
    """Earlier tasks that do the very same: nobody does that twice at once, though PDDL has nothing against it."""
    task = tasks[number]
    return tuple(
        other
        for index, other in enumerate(tasks[:number])
        if other.step.call == task.step.call and (index < running or other.step.end_s <= task.step.start_s)
    )


def _happenings(numbered: Collection[PlanEvent], tasks: tuple[PlanTask, ...]) -> tuple[Happening, ...]:
    return tuple((tasks[number], edge) for number, edge in sorted(numbered))


def _end(task: PlanTask) -> float:
    return (task.started or 0) / SECOND + task.step.duration_s


def _see(state: PddlState, task: PlanTask) -> None:
    """Has happen what sensors will see of a task, and have not yet seen."""
    state.apply([change for change in task.expected if not task.is_seen(change, state)])


def _end_in(state: PddlState, task: PlanTask) -> None:
    """Has a task end. Numbers that sensors tell may have changed already by as much as they shall."""
    state.apply(
        [
            change
            for change in task.changes("end", task.as_when_begun(state, state.domain))
            if not (isinstance(change, SetValue) and change.fluent in task.starting_values)
            or not task.is_seen(change, state)
        ]
    )
