"""A plan that is carried out makes way for a new one, is aborted, or is held."""

from __future__ import annotations

import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import PlanningError
from socialbot.deliberation.messages import Dnf, FactCondition, FactConjunction
from socialbot.planning.pddl.domain import parse_plan
from tests.deliberation.stage import BOTH, FETCH, Behaviour, Stage, desire, fact, facts, stage_with


def when(text: str) -> Dnf:
    """The context that a fact holds."""
    return Dnf(clauses=(FactConjunction(literals=(FactCondition(condition_to_check=fact(text)),)),))


# A new plan while steps run


def test_the_projection_contains_the_effects_of_running_steps():
    stage = stage_with(BOTH, until=1, wanted="holding r1 b3; holding r2 b1")
    before = stage.facts.problem()
    problem = stage.plan_executor.projected()
    added = {str(predicate) for predicate in problem.facts - before.facts}
    assert added == {"(at r1 shop)", "(at r2 home)"}
    assert problem.values == before.values


@pytest.mark.parametrize("seen", [False, True])
def test_the_projection_counts_sensed_effects_once(seen):
    stage = Stage(watched={"lit", "paint"}, beliefs=f"{'instance b1 box'}; paint = 3")
    stage.execute("0: (shine) [10]\n0.001: (spray b1) [4]", wanted="painted b1")
    assert [str(predicate) for predicate in stage.plan_executor.projected().facts] == []
    stage.believe("lit")
    stage.until(2)
    if seen:
        stage.believe("paint = 2")
    problem = stage.plan_executor.projected()
    assert {str(fluent): value for fluent, value in problem.values.items()} == {"(paint)": 2}


def test_a_new_plan_takes_over_the_steps_that_run():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=1, fails="stuck")
    stage.execute(BOTH, wanted="holding r2 b1")
    stage.until(2)
    stage.execute("0: (pick r2 b1 home) [3]", wanted="holding r2 b1")
    (second,) = [info for info in stage.infos if info.plan == 2 and info.status == "RUNNING"][:1]
    assert [(step.name, step.planned_start, step.status) for step in second.actions_exec_info] == [
        ("move", -2.0, "RUNNING"),
        ("pick", 0.0, "WAITING"),
    ]
    assert second.actions_exec_info[1].wait_action_indexes == (0,)
    stage.until(30)
    assert stage.begun()["(pick r2 b1 home)"] == 5
    assert stage.ends[-1] == ("succeeded", "")
    assert [call for _, what, call in stage.timeline if what == "begins"].count("(move r2 yard home)") == 1


def test_a_better_plan_may_take_the_place_of_one_that_runs():
    stage = stage_with(BOTH, until=2, wanted="holding r2 b1")
    stage.execute("0: (pick r2 b1 home) [3]", wanted="holding r2 b1")
    stage.until(30)
    statuses = [(info.plan, info.status) for info in stage.infos if info.target is not None]
    assert list(dict.fromkeys(statuses)) == [(1, "RUNNING"), (1, "ABORT"), (2, "RUNNING"), (2, "SUCCESSFUL")]
    assert [info.reason for info in stage.infos if info.status == "ABORT"] == ["plan 2 takes its place"]
    assert "(pick r1 b3 shop)" not in stage.begun()
    assert stage.ends == [("succeeded", "")]


def test_a_new_plan_starts_after_failed_actions_have_stopped():
    stage = Stage()
    stage.behaviour["(pick r1 b1 home)"] = Behaviour(stop_s=2)
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(1)
    stage.forget("at r1 home")
    stage.until(2)
    stage.believe("at r1 home")
    stage.execute("0: (move r1 home shop) [5]", wanted="at r1 shop")
    stage.until(30)
    assert stage.begun()["(move r1 home shop)"] == 3.5


def test_a_step_that_settles_is_waited_for():
    stage = stage_with("0: (pick r1 b1 home) [3]", Stage(watched={"holding"}), until=3.5, wanted="holding r1 b1")
    stage.execute("0: (put r1 b1 home) [3]", wanted="in b1 home")
    stage.until(4.5)
    assert "(put r1 b1 home)" not in stage.begun()
    stage.believe("holding r1 b1")
    stage.until(7.6)
    stage.forget("holding r1 b1")
    stage.until(20)
    assert stage.begun()["(put r1 b1 home)"] == 4.5
    assert stage.ends == [("succeeded", "")]
    assert stage.holds("load r1 = 0")
    assert stage.holds("in b1 home")


# Abort


def test_internal_errors_abort_the_plan_with_the_reason():
    stage = Stage()

    def burst(task):
        raise OverflowError("what nobody thought of")

    stage.plan_executor._actions.check = burst  # type: ignore[method-assign] - a mistake of ours
    stage.execute("0: (move r1 home shop) [5]", wanted="at r1 shop", rollback_belief_add=tuple(facts("open home")))
    assert stage.until(1) == [("aborted", "OverflowError: what nobody thought of")]
    assert stage.plan_executor.idle
    assert stage.status() == {"(move r1 home shop)": "CANCELLED"}
    assert stage.holds("open home")
    assert [record.detail["reason"] for record in stage.trace.find("failure")] == ["OverflowError"]


def test_an_abort_stops_all_takes_back_and_rolls_back():
    stage = Stage()
    stage.behaviour["(pick r1 b1 home)"] = Behaviour(stop_s=2)
    stage.execute(
        "0: (pick r1 b1 home) [3]\n0: (move r2 yard home) [5]",
        wanted="holding r1 b1",
        rollback_belief_add=tuple(facts("open home")),
        rollback_belief_del=tuple(facts("in * home")),
    )
    stage.until(1)
    stopped = []
    stage.run(lambda: stage.plan_executor.abort("enough", lambda: stopped.append(stage.now)))
    stage.run(lambda: stage.plan_executor.abort("twice", lambda: stopped.append("too")))
    assert stage.plan_executor.aborting
    assert stopped == []
    assert not stage.holds("open home")
    assert stage.status() == {"(pick r1 b1 home)": "CANCELLED", "(move r2 yard home)": "CANCELLED"}
    stage.until(10)
    assert stopped == [3, "too"]
    assert stage.plan_executor.idle
    assert not stage.plan_executor.aborting
    assert stage.holds("open home")
    assert not stage.holds("in b1 home")
    assert stage.holds("load r1 = 0")
    assert stage.holds("at r2 yard")
    assert stage.ends == []
    end = stage.trace.find("plan_end")[0]
    assert end.detail == {"plan": 1, "outcome": "aborted", "reason": "enough"}
    assert [info.status for info in stage.infos if info.target][-1] == "ABORT"


def test_an_action_that_never_stops_does_not_block_the_plan():
    stage = Stage()
    stage.behaviour["(pick r1 b1 home)"] = Behaviour(stop_s=None)
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(1)
    stopped = []
    stage.run(lambda: stage.plan_executor.abort("enough", lambda: stopped.append(stage.now)))
    stage.until(10)
    assert stopped == [6]
    assert "has not stopped in 5 s" in [record.detail.get("message") for record in stage.trace.find("failure")]


def test_an_abort_without_a_plan_calls_back():
    stage = Stage()
    stopped = []
    stage.run(lambda: stage.plan_executor.abort("nothing", lambda: stopped.append(stage.now)))
    assert stopped == [0]
    assert stage.plan_executor.idle


def test_no_plan_is_executed_while_another_one_is_stopped():
    stage = Stage()
    stage.behaviour["(pick r1 b1 home)"] = Behaviour(stop_s=2)
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.run(lambda: stage.plan_executor.abort("enough"))
    with pytest.raises(PlanningError, match="still being stopped"):
        stage.plan_executor.execute(parse_plan(FETCH), desire(), "")


def test_an_abort_callback_may_execute_another_plan():
    stage = stage_with("0: (pick r1 b1 home) [3]", until=1, wanted="holding r1 b1")
    go_on = desire("holding r1 b3")
    stage.run(
        lambda: stage.plan_executor.abort(
            "first", lambda: stage.plan_executor.execute(parse_plan(FETCH), go_on, "desire-2")
        )
    )
    assert stage.until(20) == [("succeeded", "")]
    assert stage.holds("holding r1 b3")


def test_a_failed_plan_may_be_aborted():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=1, fails="stuck")
    stage.execute(BOTH, wanted="holding r2 b1", rollback_belief_add=tuple(facts("open home")))
    stage.until(2)
    stopped = []
    stage.run(lambda: stage.plan_executor.abort("no other plan", lambda: stopped.append(stage.now)))
    stage.until(3)
    assert stopped == [2]
    assert stage.status() == {
        "(move r1 home shop)": "FAILED",
        "(move r2 yard home)": "CANCELLED",
        "(pick r1 b3 shop)": "WAITING",
        "(pick r2 b1 home)": "WAITING",
    }
    assert stage.holds("open home")
    assert len(stage.trace.find("plan_end")) == 1


def test_a_context_that_no_longer_holds_aborts_the_plan():
    stage = Stage()
    stage.believe("open home")
    stage.execute(FETCH, wanted="holding r1 b3", context=when("open home"))
    stage.until(2)
    stage.forget("open home")
    assert stage.ends == [("aborted", "the context of the desire no longer holds")]
    assert stage.holds("at r1 home")
    assert stage.plan_executor.idle


def test_a_plan_without_its_context_starts_no_step():
    stage = stage_with(FETCH, wanted="holding r1 b3", context=when("open home"))
    assert stage.ends == [("aborted", "the context of the desire no longer holds")]
    assert stage.timeline == []


def test_a_plan_is_aborted_when_its_desire_was_pursued_for_too_long():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=25)
    stage.execute(FETCH, wanted="holding r1 b3", deadline=8.0)
    assert stage.until(40) == [("aborted", "not achieved in 16 s, 2 times the deadline")]
    assert stage.timeline[-1] == (16, "is asked to stop", "(move r1 home shop)")


def test_a_new_plan_does_not_give_a_desire_more_time():
    stage = Stage()
    stage.until(10)
    stage.run(
        lambda: stage.plan_executor.execute(parse_plan(FETCH), desire("holding r1 b3", deadline=8.0), "", began=0)
    )
    assert stage.until(40) == [("aborted", "not achieved in 16 s, 2 times the deadline")]
    assert stage.timeline[-1][0] == 16


# Holding


def test_during_a_hold_no_step_starts_and_running_ones_continue():
    stage = stage_with(FETCH, until=2, wanted="holding r1 b3")
    stage.run(lambda: stage.plan_executor.hold("the camera is silent"))
    stage.until(20)
    assert stage.holds("at r1 shop")
    assert "(pick r1 b3 shop)" not in stage.begun()
    stage.run(stage.plan_executor.release)
    stage.until(40)
    assert stage.begun()["(pick r1 b3 shop)"] == 20
    assert stage.ends == [("succeeded", "")]


def test_the_patience_of_a_step_does_not_end_while_it_is_held():
    stage = stage_with(FETCH, wanted="holding r1 b3")
    stage.forget("in b3 shop")
    stage.until(6)
    stage.run(lambda: stage.plan_executor.hold("the camera is silent"))
    stage.until(20)
    stage.run(stage.plan_executor.release)
    stage.until(21)
    stage.believe("in b3 shop")
    assert stage.until(40) == [("succeeded", "")]


def test_unsensed_effects_are_waited_for_during_a_hold():
    stage = stage_with(FETCH, Stage(watched={"at"}), wanted="holding r1 b3")
    stage.forget("at r1 home")
    stage.until(4)
    stage.run(lambda: stage.plan_executor.hold("the camera is silent"))
    stage.until(15)
    stage.run(stage.plan_executor.release)
    stage.until(16)
    stage.believe("at r1 shop")
    assert stage.until(30) == [("succeeded", "")]


def test_it_is_not_seen_for_ever():
    stage = stage_with(FETCH, Stage(watched={"at"}), wanted="holding r1 b3")
    stage.forget("at r1 home")
    stage.run(lambda: stage.plan_executor.hold("the camera is silent"))
    stage.until(15)
    stage.run(stage.plan_executor.release)
    assert stage.until(30) == [("failed", "(move r1 home shop): effect not seen: (at r1 shop)")]
    assert stage.trace.find("step_end")[0].time == 17 * SECOND
