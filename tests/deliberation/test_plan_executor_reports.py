"""Reports of the plan executor."""

from __future__ import annotations

from typing import Any

import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import PlanningError
from socialbot.deliberation._execution import PlanExecution, PlanTask
from socialbot.deliberation.options import DeliberationOptions
from socialbot.planning.pddl.domain import PlanStep
from socialbot.planning.pddl.semantics import ground
from tests.deliberation.stage import BOTH, FETCH, WORKSHOP, Behaviour, Stage, desire, stage_with


def test_the_state_of_the_plan_is_reported():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=9)
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(6)
    info = stage.plan_executor.info
    assert (info.agent_id, info.plan, info.status, info.current_time) == ("stage", 1, "RUNNING", 6)
    assert info.planned_deadline == pytest.approx(8.001)
    assert info.estimated_deadline == 9
    move, pick = info.actions_exec_info
    assert (move.status, move.exec_time, move.actual_start, move.progress) == ("RUNNING", 6, 0, 0.99)
    assert (pick.status, pick.actual_start, pick.wait_action_indexes) == ("WAITING", None, (0,))
    stage.until(30)
    assert stage.infos[-2].estimated_deadline == 12


def test_reports_come_five_times_a_second_during_a_plan_only():
    stage = stage_with("0: (move r1 home shop) [5]", until=4.9, wanted="at r1 shop")
    times = [info.stamp / SECOND for info in stage.infos]
    assert times == [pytest.approx(0.2 * number) for number in range(25)]
    stage.until(5)
    told = len(stage.infos)
    stage.until(100)
    assert len(stage.infos) == told
    assert stage.engine.next_wakeup() is None


def test_a_step_reports_its_predecessors():
    stage = stage_with(FETCH, wanted="holding r1 b3")
    stage.forget("in b3 shop")
    stage.until(6)
    assert stage.plan_executor.info.actions_exec_info[1].message == "waits for (in b3 shop)"


def test_callbacks_that_raise_do_not_stop_the_plan():
    stage = Stage()

    def fail(*_):
        raise ValueError("nobody listens")

    stage.plan_executor._ended = stage.plan_executor._changed = fail
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(20)
    assert stage.holds("holding r1 b3")
    assert "nobody listens" in [record.detail.get("message") for record in stage.trace.find("failure")]


def test_every_decision_can_be_followed_back_to_the_desire():
    stage = stage_with(FETCH, until=20, wanted="holding r1 b3")
    action = stage.trace.find("action")[-1]
    assert [record.kind for record in stage.trace.explain(action.id)] == [
        "action",
        "plan",
        "goal",
        "step",
        "plan_start",
    ]
    assert stage.trace.explain(action.id)[-1].cause == "desire-1"
    step = stage.trace.find("step")[-1]
    assert step.what == "(pick r1 b3 shop)"
    assert step.detail == {
        "action": "pick",
        "args": ["r1", "b3", "shop"],
        "planned_start": 5.001,
        "conditions": ["(in b3 shop)", "(< (load r1) 1)", "(at r1 shop)"],
    }
    belief = stage.trace.find("belief", "holding(r1, b3)")[0]
    assert belief.cause == step.id


def test_a_failed_plan_can_be_followed_back_to_the_action():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=1, fails="stuck")
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(5)
    end = stage.trace.find("plan_end")[0]
    kinds = [record.kind for record in stage.trace.explain(end.id)]
    assert kinds[:3] == ["plan_end", "step_end", "failure"]
    assert kinds[-1] == "plan_start"
    assert "step" in kinds


def test_two_runs_are_the_same():
    def run():
        stage = Stage(watched={"at"})
        stage.behaviour["(move r2 yard home)"] = Behaviour(lasts_s=2, fails="lost")
        stage.execute(BOTH, wanted="holding r1 b3; holding r2 b1")
        stage.forget("at r1 home")
        stage.until(40)
        return [str(record) for record in stage.trace], [str(info) for info in stage.infos]

    assert run() == run()


def test_options_that_make_no_sense_are_refused():
    wrong: dict[str, Any]
    for wrong in ({"patience_s": -1}, {"rtc_deadline": 0.5}, {"report_s": 0}, {"tolerance_s": float("nan")}):
        with pytest.raises(PlanningError, match="must be >= "):
            DeliberationOptions(**wrong)


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
