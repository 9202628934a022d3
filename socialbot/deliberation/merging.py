"""Merging: a new plan and the steps that still run become tasks, each with what it has to wait for."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace

from socialbot.clock import SECOND
from socialbot.deliberation.execution import Happening, Task
from socialbot.deliberation.facts import FactBase
from socialbot.errors import PlanningError
from socialbot.planning.causal import causal_order
from socialbot.planning.domain import Domain, Problem
from socialbot.planning.formulas import Formula
from socialbot.planning.plan import Plan
from socialbot.planning.semantics import SetValue, ground
from socialbot.planning.state import State
from socialbot.planning.timeline import Happening as Numbered
from socialbot.planning.validation import faults


def projected(facts: FactBase, domain: Domain, running: Iterable[Task], goal: Formula | None) -> Problem:
    """What will be believed when the running tasks have ended as planned."""
    state = State.of(facts.problem(goal), domain)
    for task in sorted(running, key=_end):
        _see(state, task)
        _end_in(state, task)
    return state.problem(goal)


def merged(
    domain: Domain, facts: FactBase, plan: Plan, goal: Formula, running: tuple[Task, ...], now: int
) -> tuple[Task, ...]:
    """The tasks for a plan that starts from what is `projected`, after those that are running.

    Raises PlanningError when the plan does not do what it shall, as things are believed now.
    """
    ending = tuple(task for task in running if task.phase == "settling" or task.action.duration is None)
    going_on = tuple(task for task in running if task not in ending)
    state = State.of(facts.problem(goal), domain)
    for task in sorted(ending, key=_end):
        _see(state, task)
        _end_in(state, task)
    for task in sorted(going_on, key=_end):
        _see(state, task)
        state.apply(SetValue(fluent, value) for fluent, value in task.starting_values.items() if value is not None)
    problem = state.problem(goal)
    steps = [replace(task.step, start_s=((task.started or 0) - now) / SECOND) for task in going_on]
    whole = Plan((*steps, *plan.steps))
    before = range(len(going_on))
    wrong = faults(domain, problem, whole, before)
    if wrong:
        raise PlanningError(f"the plan does not fit what is believed now: {wrong[0]}")
    order = causal_order(domain, problem, whole, before)
    for task, step in zip(going_on, steps, strict=True):
        task.step = step
    new = tuple(Task(step, ground(domain.actions[step.action], step.args)) for step in plan.steps)
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


def _same_before(number: int, tasks: tuple[Task, ...], running: int) -> tuple[Task, ...]:
    """Earlier tasks that do the very same: nobody does that twice at once, though PDDL has nothing against it."""
    task = tasks[number]
    return tuple(
        other
        for index, other in enumerate(tasks[:number])
        if other.step.call == task.step.call and (index < running or other.step.end_s <= task.step.start_s)
    )


def _happenings(numbered: Collection[Numbered], tasks: tuple[Task, ...]) -> tuple[Happening, ...]:
    return tuple((tasks[number], edge) for number, edge in sorted(numbered))


def _end(task: Task) -> float:
    return (task.started or 0) / SECOND + task.step.duration_s


def _see(state: State, task: Task) -> None:
    """Has happen what sensors will see of a task, and have not yet seen."""
    state.apply([change for change in task.expected if not task.is_seen(change, state)])


def _end_in(state: State, task: Task) -> None:
    """Has a task end. Numbers that sensors tell may have changed already by as much as they shall."""
    state.apply(
        [
            change
            for change in task.changes("end", task.as_when_begun(state, state.domain))
            if not (isinstance(change, SetValue) and change.fluent in task.starting_values)
            or not task.is_seen(change, state)
        ]
    )
