"""What the plan_executor tells of the plans that it carries out."""

from __future__ import annotations

from typing import Any

import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import PlanningError
from socialbot.deliberation.options import DeliberationOptions
from tests.deliberation.stage import BOTH, FETCH, Behaviour, Stage


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
    stage = Stage()
    stage.execute("0: (move r1 home shop) [5]", wanted="at r1 shop")
    stage.until(4.9)
    times = [info.stamp / SECOND for info in stage.infos]
    assert times == [pytest.approx(0.2 * number) for number in range(25)]
    stage.until(5)
    told = len(stage.infos)
    stage.until(100)
    assert len(stage.infos) == told
    assert stage.engine.next_wakeup() is None


def test_a_step_reports_its_predecessors():
    stage = Stage()
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.forget("in b3 shop")
    stage.until(6)
    assert stage.plan_executor.info.actions_exec_info[1].message == "waits for (in b3 shop)"


def test_callbacks_that_raise_stop_nothing():
    stage = Stage()

    def fail(*_):
        raise ValueError("nobody listens")

    stage.plan_executor._ended = stage.plan_executor._changed = fail
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(20)
    assert stage.holds("holding r1 b3")
    assert "nobody listens" in [record.detail.get("message") for record in stage.trace.find("failure")]


def test_every_decision_can_be_followed_back_to_the_desire():
    stage = Stage()
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(20)
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
