"""How a plan that is carried out fares, and when it will be over."""

from __future__ import annotations

import pytest

from socialbot.core.clock import SECOND
from socialbot.deliberation._execution import PlanExecution, PlanTask
from socialbot.planning.pddl.domain import PlanStep
from socialbot.planning.pddl.semantics import ground
from tests.deliberation.stage import WORKSHOP, desire


def task(call: str, start_s: float, duration_s: float) -> PlanTask:
    name, *args = call.split()
    return PlanTask(PlanStep(start_s, name, tuple(args), duration_s), ground(WORKSHOP.actions[name], args))


def chain() -> tuple[PlanTask, PlanTask, PlanTask]:
    """A move, a pick after it, and a long move beside them."""
    move, pick, other = (
        task("move r1 home shop", 0, 5), task("pick r1 b3 shop", 5, 3), task("move r2 yard home", 0, 5)
    )  # fmt: skip
    pick.before_start = ((move, "end"),)
    return move, pick, other


def begin(task: PlanTask, second: float) -> None:
    task.status, task.started = "RUNNING", round(second * SECOND)
    task.enter("acting", task.started)


def end(task: PlanTask, second: float) -> None:
    task.status, task.ended = "SUCCESSFUL", round(second * SECOND)
    task.enter("over", task.ended)


def execution(*tasks: PlanTask, began: float = 0) -> PlanExecution:
    return PlanExecution(1, desire(), tasks, 8.0, round(began * SECOND), 0)


def estimate(plan: PlanExecution, second: float) -> float:
    return plan.estimated_end_s(round(second * SECOND))


def test_the_end_is_as_planned_until_something_is_late():
    move, pick, other = chain()
    plan = execution(move, pick, other)
    assert estimate(plan, 0) == 8
    begin(move, 0)
    assert estimate(plan, 4) == 9  # the other move has not begun
    begin(other, 4)
    assert estimate(plan, 4) == 9
    assert estimate(plan, 6.5) == 9.5
    end(move, 7)
    assert estimate(plan, 7) == 10
    begin(pick, 7)
    end(pick, 11)
    end(other, 9)
    assert estimate(plan, 20) == 11


def test_times_count_from_the_start_of_the_plan():
    move, pick, other = chain()
    begin(move, 8)
    info = execution(move, pick, other, began=10).info("r", 11 * SECOND)
    assert info.current_time == 1
    assert info.actions_exec_info[0].actual_start == -2
    assert info.actions_exec_info[0].exec_time == 3
    assert info.estimated_deadline == 6


def test_a_running_step_may_have_waited_for_removed_steps():
    move, pick, _ = chain()
    assert execution(pick).info("r", 0).actions_exec_info[0].wait_action_indexes == ()
    assert execution(move, pick).info("r", 0).actions_exec_info[1].wait_action_indexes == (0,)


def test_without_telling_an_action_is_as_far_as_its_time():
    move, *_ = chain()
    assert move.progress(0) == 0
    begin(move, 0)
    assert move.progress(2 * SECOND) == pytest.approx(0.4)
    assert move.progress(20 * SECOND) == 0.99
    move.enter("settling", 20 * SECOND)
    assert move.progress(20 * SECOND) == 1
    move.enter("over", 21 * SECOND)
    assert move.progress(22 * SECOND) == 1


def test_the_state_changes_with_the_status_of_a_step():
    move, pick, other = chain()
    plan = execution(move, pick, other)
    before = plan.state()
    assert plan.state() == before
    begin(move, 0)
    assert plan.state() != before
