"""The director carries out plans against what is believed."""
# ruff: noqa: N801 - actions are written as plans write them

from __future__ import annotations

import pytest

from socialbot.agent_messages import Condition, Conjunction, Dnf
from socialbot.clock import SECOND
from socialbot.deliberation.actions import PlanAction, register
from socialbot.deliberation.director import DirectorOptions
from socialbot.errors import PlanningError
from socialbot.planning.plan import parse_plan
from socialbot.planning.reader import read_domain
from tests.deliberation.stage import WORKSHOP, Behaviour, Stage, desire, fact, facts

FETCH = """
0.000: (move r1 home shop) [5]
5.001: (pick r1 b3 shop) [3]
"""
BOTH = """
0.000: (move r1 home shop) [5]
0.000: (move r2 yard home) [5]
5.001: (pick r1 b3 shop) [3]
5.001: (pick r2 b1 home) [3]
"""


def when(text: str) -> Dnf:
    """The context that a fact holds."""
    return Dnf(clauses=(Conjunction(literals=(Condition(condition_to_check=fact(text)),)),))


def records(stage: Stage, kind: str):
    return stage.trace.find(kind)


# Order and effects


def test_steps_run_side_by_side_and_each_begins_when_what_it_waits_for_has_ended():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=7)
    stage.behaviour["(move r2 yard home)"] = Behaviour(lasts_s=2)
    stage.execute(BOTH, wanted="holding r1 b3; holding r2 b1")
    stage.until(60)
    assert stage.begun() == {
        "(move r1 home shop)": 0,
        "(move r2 yard home)": 0,
        "(pick r2 b1 home)": 2,
        "(pick r1 b3 shop)": 7,
    }
    assert stage.ends == [("succeeded", "")]
    assert stage.holds("holding r1 b3")
    assert not stage.holds("in b3 shop")
    assert stage.director.idle
    assert stage.director.info.target is None


def test_effects_are_believed_as_a_step_begins_and_as_it_ends():
    stage = Stage()
    stage.execute("0: (pick r1 b1 home) [3]")
    stage.until(1)
    assert stage.holds("load r1 = 1")
    assert stage.holds("in b1 home")
    stage.until(3)
    assert stage.holds("load r1 = 1")
    assert stage.holds("holding r1 b1")
    assert not stage.holds("in b1 home")


def test_what_has_to_be_inside_of_a_step_is():
    stage = Stage()
    stage.execute("0: (shine) [10]\n0.001: (spray b1) [4]\n4.002: (spray b2) [4]", wanted="painted b1; painted b2")
    stage.until(30)
    assert stage.ends == [("succeeded", "")]
    assert stage.holds("paint = 1")
    assert not stage.holds("lit")


def test_an_end_that_comes_too_early_waits_for_what_has_to_come_before_it():
    stage = Stage(options=DirectorOptions(tolerance_s=0))
    plan = "0: (shine) [10]\n0.001: (spray b1) [4]"
    stage.behaviour["(shine)"] = Behaviour(lasts_s=1)
    stage.execute(plan, wanted="painted b1")
    stage.until(3)
    assert stage.status()["(shine)"] == "RUNNING"
    stage.until(30)
    assert stage.ends == [("succeeded", "")]


def test_an_instantaneous_action_changes_things_when_it_has_been_carried_out():
    stage = Stage()
    stage.behaviour["(ring)"] = Behaviour(lasts_s=0.5)
    stage.execute("0: (shine) [10]\n0.001: (ring)", wanted="rung")
    stage.until(0.2)
    assert not stage.holds("rung")
    stage.until(20)
    assert stage.holds("rung")
    assert stage.ends == [("succeeded", "")]


def test_an_empty_plan_succeeds_at_once():
    stage = Stage()
    stage.execute("", wanted="at r1 home")
    assert stage.ends == [("succeeded", "")]


# Before it begins


@pytest.mark.parametrize(
    ("plan", "reason"),
    [
        ("0: (fly r1 home) [5]", "no action fly"),
        ("0: (move r1 home) [5]", "takes 3 objects, not 2"),
        ("0: (move r1 home mars) [5]", "there is no object mars"),
        ("0: (move r1 home b1) [5]", "b1 is a box"),
        ("0: (move r1 shop home) [5]", "(at r1 shop)"),
        ("0: (move r1 home shop) [50]", "50"),
        ("0: (move r1 home shop) [5]", "the goal is not reached"),
    ],
)
def test_a_plan_that_does_not_fit_what_is_believed_fails_before_anything_begins(plan, reason):
    stage = Stage()
    stage.execute(plan, wanted="at r1 yard")
    stage.until(10)
    ((how, why),) = stage.ends
    assert how == "failed"
    assert reason in why
    assert stage.timeline == []
    assert records(stage, "plan_end")[0].detail["outcome"] == "failed"


def test_a_plan_for_another_domain_fails_before_anything_begins():
    stage = Stage()
    other = type(WORKSHOP)("workshop", actions=WORKSHOP.actions)
    stage.run(lambda: stage.director.execute(parse_plan(FETCH), desire(), "", domain=other))
    assert stage.ends == [("failed", "the domain has changed since the plan was made")]
    assert stage.timeline == []


# Conditions


def test_a_step_waits_for_its_conditions_and_fails_when_they_do_not_come():
    stage = Stage()
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(4)
    stage.forget("in b3 shop")
    stage.until(6.9)
    assert stage.ends == []
    stage.until(20)
    assert stage.ends == [("failed", "(pick r1 b3 shop): condition does not hold: (in b3 shop)")]
    assert "(pick r1 b3 shop)" not in stage.begun()
    assert records(stage, "plan_end")[0].time == 7 * SECOND


def test_a_step_begins_as_soon_as_its_conditions_have_come():
    stage = Stage()
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(4)
    stage.forget("in b3 shop")
    stage.until(6)
    stage.believe("in b3 shop")
    stage.until(20)
    assert stage.begun()["(pick r1 b3 shop)"] == 6
    assert stage.ends == [("succeeded", "")]


def test_a_condition_that_stops_holding_fails_the_step_and_its_action_is_cancelled():
    stage = Stage()
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(1)
    stage.forget("at r1 home")
    stage.until(20)
    assert stage.ends == [("failed", "(pick r1 b1 home): condition holds no longer: (at r1 home)")]
    assert stage.timeline[-1] == (1.5, "is asked to stop", "(pick r1 b1 home)")
    assert stage.holds("load r1 = 0")
    assert stage.status() == {"(pick r1 b1 home)": "FAILED"}


def test_a_condition_may_flicker():
    stage = Stage()
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    for begin in (1, 2):
        stage.until(begin)
        stage.forget("at r1 home")
        stage.until(begin + 0.4)
        stage.believe("at r1 home")
    stage.until(20)
    assert stage.ends == [("succeeded", "")]


def test_without_tolerance_it_may_not():
    stage = Stage(options=DirectorOptions(tolerance_s=0))
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(1)
    stage.forget("at r1 home")
    assert stage.ends == [("failed", "(pick r1 b1 home): condition holds no longer: (at r1 home)")]


def test_a_condition_at_the_end_that_does_not_hold_fails_the_step():
    stage = Stage()
    stage.execute("0: (shine) [10]\n0.001: (spray b1) [4]", wanted="painted b1")
    stage.until(1)
    stage.believe("paint = 0")
    stage.until(20)
    assert stage.ends == [("failed", "(spray b1): condition does not hold at the end: (>= (paint) 1)")]
    assert not stage.holds("painted b1")
    assert stage.holds("paint = 0")


# What sensors see


def test_watched_effects_are_left_to_the_sensors():
    stage = Stage(watched={"at"})
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(1)
    assert stage.holds("at r1 home")
    stage.forget("at r1 home")
    stage.until(5.5)
    assert stage.status()["(move r1 home shop)"] == "RUNNING"
    stage.believe("at r1 shop")
    stage.until(20)
    assert stage.begun()["(pick r1 b3 shop)"] == 5.5
    assert stage.ends == [("succeeded", "")]


def test_an_effect_that_is_not_seen_fails_the_step():
    stage = Stage(watched={"at"})
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.forget("at r1 home")
    stage.until(20)
    assert stage.ends == [("failed", "(move r1 home shop): effect not seen: (at r1 shop)")]
    assert records(stage, "step_end")[0].time == 7 * SECOND
    assert not stage.holds("at r1 home")


def test_a_condition_that_only_sensors_can_make_true_is_given_time():
    stage = Stage(watched={"lit"})
    stage.execute("0: (shine) [10]\n0.001: (ring)", wanted="rung")
    stage.until(1)
    assert "(ring)" not in stage.begun()
    stage.believe("lit")
    stage.until(2)
    assert stage.begun()["(ring)"] == 1


@pytest.mark.parametrize("seen_at", [2.5, 3.5])
def test_a_number_may_be_seen_before_or_after_the_action_ends(seen_at):
    stage = Stage(watched={"paint"})
    stage.execute("0: (shine) [10]\n0.001: (spray b1) [4]", wanted="painted b1")
    stage.until(seen_at)
    stage.believe("paint = 2")
    stage.until(20)
    assert stage.ends == [("succeeded", "")]
    assert stage.holds("paint = 2")


def test_a_number_that_does_not_change_fails_the_step():
    stage = Stage(watched={"paint"})
    stage.execute("0: (shine) [10]\n0.001: (spray b1) [4]", wanted="painted b1")
    stage.until(20)
    assert stage.ends == [("failed", "(spray b1): effect not seen: (paint) = 2")]


# Failures


@pytest.mark.parametrize("lasts_s", [0, 1])
def test_an_action_that_fails_leaves_things_as_they_were(lasts_s):
    stage = Stage()
    stage.behaviour["(pick r1 b1 home)"] = Behaviour(lasts_s=lasts_s, fails="it slipped")
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(20)
    assert stage.ends == [("failed", "(pick r1 b1 home): it slipped")]
    assert stage.holds("load r1 = 0")
    assert stage.outcomes[0].step is not None
    assert stage.outcomes[0].step.action == "pick"


def test_an_action_that_nobody_can_carry_out_fails():
    stage = Stage()
    without_plans(stage, "+!ring/0")
    stage.believe("lit")
    stage.execute("0: (ring)", wanted="rung")
    assert stage.ends[0][0] == "failed"
    assert "no plan" in stage.ends[0][1]


def test_what_somebody_else_changed_meanwhile_is_not_taken_back():
    stage = Stage()
    stage.behaviour["(pick r1 b1 home)"] = Behaviour(fails="it slipped")
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(1)
    stage.believe("load r1 = 4")
    stage.until(20)
    assert stage.holds("load r1 = 4")


def test_after_a_failure_nothing_new_begins_and_the_rest_goes_on():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=1, fails="stuck")
    stage.execute(BOTH, wanted="holding r1 b3; holding r2 b1")
    stage.until(2)
    assert [task.step.call for task in stage.director.running] == ["(move r2 yard home)"]
    assert stage.director.info.status == "ABORT"
    stage.until(30)
    assert list(stage.begun()) == ["(move r1 home shop)", "(move r2 yard home)"]
    assert stage.holds("at r2 home")
    assert stage.holds("at r1 home")
    assert stage.ends == [("failed", "(move r1 home shop): stuck")]


def test_a_step_that_goes_on_after_a_failure_may_fail_too():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=1, fails="stuck")
    stage.behaviour["(move r2 yard home)"] = Behaviour(lasts_s=2, fails="lost")
    stage.execute(BOTH, wanted="holding r1 b3; holding r2 b1")
    stage.until(30)
    assert [reason for _, reason in stage.ends] == ["(move r1 home shop): stuck", "(move r2 yard home): lost"]


def test_a_step_that_takes_far_too_long_fails():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=500)
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(600)
    assert stage.ends == [("failed", "(move r1 home shop): takes longer than 30 s; 5 s were planned")]
    assert stage.timeline[-1] == (30, "is asked to stop", "(move r1 home shop)")
    assert stage.holds("at r1 home")


def test_an_object_that_has_gone_fails_the_step_and_does_not_come_back():
    stage = Stage()
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(1)
    stage.forget("instance r1 robot")
    stage.until(10)
    assert stage.ends[0][0] == "failed"
    assert "r1" not in stage.facts.objects()


def test_nobody_does_the_same_twice_at_once():
    stage = Stage()
    stage.believe("lit")
    stage.execute("0: (spray b1) [4]\n4.1: (spray b1) [4]\n4.2: (spray b2) [4]", wanted="painted b1")
    stage.until(20)
    begins = [(time, call) for time, what, call in stage.timeline if what == "begins"]
    assert begins == [(0, "(spray b1)"), (0, "(spray b2)"), (4, "(spray b1)")]


# A new plan while steps run


def test_projected_is_what_comes_of_the_steps_that_run():
    stage = Stage()
    stage.execute(BOTH, wanted="holding r1 b3; holding r2 b1")
    stage.until(1)
    before = stage.facts.problem()
    problem = stage.director.projected()
    added = {str(predicate) for predicate in problem.facts - before.facts}
    assert added == {"(at r1 shop)", "(at r2 home)"}
    assert problem.values == before.values


@pytest.mark.parametrize("seen", [False, True])
def test_projected_counts_what_sensors_will_see_once(seen):
    stage = Stage(watched={"lit", "paint"}, beliefs=f"{'instance b1 box'}; paint = 3")
    stage.execute("0: (shine) [10]\n0.001: (spray b1) [4]", wanted="painted b1")
    assert [str(predicate) for predicate in stage.director.projected().facts] == []
    stage.believe("lit")
    stage.until(2)
    if seen:
        stage.believe("paint = 2")
    problem = stage.director.projected()
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
    stage = Stage()
    stage.execute(BOTH, wanted="holding r2 b1")
    stage.until(2)
    stage.execute("0: (pick r2 b1 home) [3]", wanted="holding r2 b1")
    stage.until(30)
    statuses = [(info.plan, info.status) for info in stage.infos if info.target is not None]
    assert list(dict.fromkeys(statuses)) == [(1, "RUNNING"), (1, "ABORT"), (2, "RUNNING"), (2, "SUCCESSFUL")]
    assert [info.reason for info in stage.infos if info.status == "ABORT"] == ["plan 2 takes its place"]
    assert "(pick r1 b3 shop)" not in stage.begun()
    assert stage.ends == [("succeeded", "")]


def test_a_new_plan_begins_when_what_failed_has_stopped():
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
    stage = Stage(watched={"holding"})
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(3.5)
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


def test_whatever_goes_wrong_within_aborts_the_plan_with_the_reason():
    stage = Stage()

    def burst(task):
        raise OverflowError("what nobody thought of")

    stage.director._performer.look_at = burst  # type: ignore[method-assign] - a mistake of ours
    stage.execute("0: (move r1 home shop) [5]", wanted="at r1 shop", rollback_belief_add=tuple(facts("open home")))
    stage.until(1)
    assert stage.ends == [("aborted", "OverflowError: what nobody thought of")]
    assert stage.director.idle
    assert stage.status() == {"(move r1 home shop)": "CANCELLED"}
    assert stage.holds("open home")
    assert [record.detail["reason"] for record in records(stage, "failure")] == ["OverflowError"]


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
    stage.run(lambda: stage.director.abort("enough", lambda: stopped.append(stage.now)))
    stage.run(lambda: stage.director.abort("twice", lambda: stopped.append("too")))
    assert stage.director.aborting
    assert stopped == []
    assert not stage.holds("open home")
    assert stage.status() == {"(pick r1 b1 home)": "CANCELLED", "(move r2 yard home)": "CANCELLED"}
    stage.until(10)
    assert stopped == [3, "too"]
    assert stage.director.idle
    assert not stage.director.aborting
    assert stage.holds("open home")
    assert not stage.holds("in b1 home")
    assert stage.holds("load r1 = 0")
    assert stage.holds("at r2 yard")
    assert stage.ends == []
    end = records(stage, "plan_end")[0]
    assert end.detail == {"plan": 1, "outcome": "aborted", "reason": "enough"}
    assert [info.status for info in stage.infos if info.target][-1] == "ABORT"


def test_an_action_that_never_stops_holds_nobody_up_for_ever():
    stage = Stage()
    stage.behaviour["(pick r1 b1 home)"] = Behaviour(stop_s=None)
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(1)
    stopped = []
    stage.run(lambda: stage.director.abort("enough", lambda: stopped.append(stage.now)))
    stage.until(10)
    assert stopped == [6]
    assert "has not stopped in 5 s" in [record.detail.get("message") for record in records(stage, "failure")]


def test_an_abort_of_nothing_calls_back():
    stage = Stage()
    stopped = []
    stage.run(lambda: stage.director.abort("nothing", lambda: stopped.append(stage.now)))
    assert stopped == [0]
    assert stage.director.idle


def test_no_plan_is_executed_while_another_one_is_stopped():
    stage = Stage()
    stage.behaviour["(pick r1 b1 home)"] = Behaviour(stop_s=2)
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.run(lambda: stage.director.abort("enough"))
    with pytest.raises(PlanningError, match="still being stopped"):
        stage.director.execute(parse_plan(FETCH), desire(), "")


def test_whoever_waits_for_an_abort_may_execute_another_plan():
    stage = Stage()
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(1)
    go_on = desire("holding r1 b3")
    stage.run(
        lambda: stage.director.abort("first", lambda: stage.director.execute(parse_plan(FETCH), go_on, "desire-2"))
    )
    stage.until(20)
    assert stage.ends == [("succeeded", "")]
    assert stage.holds("holding r1 b3")


def test_a_failed_plan_may_be_aborted():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=1, fails="stuck")
    stage.execute(BOTH, wanted="holding r2 b1", rollback_belief_add=tuple(facts("open home")))
    stage.until(2)
    stopped = []
    stage.run(lambda: stage.director.abort("no other plan", lambda: stopped.append(stage.now)))
    stage.until(3)
    assert stopped == [2]
    assert stage.status() == {
        "(move r1 home shop)": "FAILED",
        "(move r2 yard home)": "CANCELLED",
        "(pick r1 b3 shop)": "WAITING",
        "(pick r2 b1 home)": "WAITING",
    }
    assert stage.holds("open home")
    assert len(records(stage, "plan_end")) == 1


def test_a_context_that_no_longer_holds_aborts_the_plan():
    stage = Stage()
    stage.believe("open home")
    stage.execute(FETCH, wanted="holding r1 b3", context=when("open home"))
    stage.until(2)
    stage.forget("open home")
    assert stage.ends == [("aborted", "the context of the desire no longer holds")]
    assert stage.holds("at r1 home")
    assert stage.director.idle


def test_a_plan_without_its_context_begins_nothing():
    stage = Stage()
    stage.execute(FETCH, wanted="holding r1 b3", context=when("open home"))
    assert stage.ends == [("aborted", "the context of the desire no longer holds")]
    assert stage.timeline == []


def test_a_plan_is_aborted_when_its_desire_was_pursued_for_too_long():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=25)
    stage.execute(FETCH, wanted="holding r1 b3", deadline=8.0)
    stage.until(40)
    assert stage.ends == [("aborted", "not achieved in 16 s, 2 times the deadline")]
    assert stage.timeline[-1] == (16, "is asked to stop", "(move r1 home shop)")


def test_a_new_plan_does_not_give_a_desire_more_time():
    stage = Stage()
    stage.until(10)
    stage.run(lambda: stage.director.execute(parse_plan(FETCH), desire("holding r1 b3", deadline=8.0), "", began=0))
    stage.until(40)
    assert stage.ends == [("aborted", "not achieved in 16 s, 2 times the deadline")]
    assert stage.timeline[-1][0] == 16


# Holding


def test_while_it_is_held_nothing_begins_and_what_runs_goes_on():
    stage = Stage()
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(2)
    stage.run(lambda: stage.director.hold("the camera is silent"))
    stage.until(20)
    assert stage.holds("at r1 shop")
    assert "(pick r1 b3 shop)" not in stage.begun()
    stage.run(stage.director.release)
    stage.until(40)
    assert stage.begun()["(pick r1 b3 shop)"] == 20
    assert stage.ends == [("succeeded", "")]


def test_the_patience_of_a_step_does_not_end_while_it_is_held():
    stage = Stage()
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.forget("in b3 shop")
    stage.until(6)
    stage.run(lambda: stage.director.hold("the camera is silent"))
    stage.until(20)
    stage.run(stage.director.release)
    stage.until(21)
    stage.believe("in b3 shop")
    stage.until(40)
    assert stage.ends == [("succeeded", "")]


def test_an_effect_that_nobody_can_see_is_waited_for_while_it_is_held():
    stage = Stage(watched={"at"})
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.forget("at r1 home")
    stage.until(4)
    stage.run(lambda: stage.director.hold("the camera is silent"))
    stage.until(15)
    stage.run(stage.director.release)
    stage.until(16)
    stage.believe("at r1 shop")
    stage.until(30)
    assert stage.ends == [("succeeded", "")]


def test_it_is_not_seen_for_ever():
    stage = Stage(watched={"at"})
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.forget("at r1 home")
    stage.run(lambda: stage.director.hold("the camera is silent"))
    stage.until(15)
    stage.run(stage.director.release)
    stage.until(30)
    assert stage.ends == [("failed", "(move r1 home shop): effect not seen: (at r1 shop)")]
    assert records(stage, "step_end")[0].time == 17 * SECOND


# What is told


def test_it_is_told_how_the_plan_fares():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=9)
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(6)
    info = stage.director.info
    assert (info.agent_id, info.plan, info.status, info.current_time) == ("stage", 1, "RUNNING", 6)
    assert info.planned_deadline == pytest.approx(8.001)
    assert info.estimated_deadline == 9
    move, pick = info.actions_exec_info
    assert (move.status, move.exec_time, move.actual_start, move.progress) == ("RUNNING", 6, 0, 0.99)
    assert (pick.status, pick.actual_start, pick.wait_action_indexes) == ("WAITING", None, (0,))
    stage.until(30)
    assert stage.infos[-2].estimated_deadline == 12


def test_it_is_told_five_times_a_second_while_a_plan_runs_and_never_else():
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


def test_a_step_says_what_it_waits_for():
    stage = Stage()
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.forget("in b3 shop")
    stage.until(6)
    assert stage.director.info.actions_exec_info[1].message == "waits for (in b3 shop)"


def test_callbacks_that_raise_stop_nothing():
    stage = Stage()

    def fail(*_):
        raise ValueError("nobody listens")

    stage.director._ended = stage.director._changed = fail
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(20)
    assert stage.holds("holding r1 b3")
    assert "nobody listens" in [record.detail.get("message") for record in records(stage, "failure")]


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
    step = records(stage, "step")[-1]
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
    end = records(stage, "plan_end")[0]
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
    for wrong in ({"patience_s": -1}, {"rtc_deadline": 0.5}, {"report_s": 0}, {"tolerance_s": float("nan")}):
        with pytest.raises(PlanningError, match="give at least"):
            DirectorOptions(**wrong)


# Who carries it out


def without_plans(stage: Stage, key: str) -> None:
    for ready in list(stage.engine.triggers[key].plans):
        stage.engine.remove_plan(ready.plan)


def test_a_plan_action_carries_it_out_and_tells_how_far_it_is():
    class fill(PlanAction):
        rate_hz = 1.0

        def advance(self):
            return self.progress_made + 0.125

    stage = Stage()
    without_plans(stage, "+!move/3")
    register(stage.engine, fill, 3, "move")
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(4)
    assert stage.director.info.actions_exec_info[0].progress == 0.5
    assert stage.director.info.estimated_deadline == 11
    stage.until(20)
    assert stage.begun() == {"(pick r1 b3 shop)": 8}
    assert stage.ends == [("succeeded", "")]


def test_a_plan_in_agentspeak_carries_it_out():
    stage = Stage()
    without_plans(stage, "+!move/3")
    stage.engine.add_text("+!move(R, A, B) <- .wait(2000); +moved(R, B).")
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(20)
    assert stage.begun() == {"(pick r1 b3 shop)": 2}
    assert "moved(r1, shop)" in {str(held.belief) for held in stage.engine.beliefs}


def test_somebody_who_drops_the_intention_fails_the_step():
    stage = Stage()
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(1)
    stage.run(lambda: stage.engine.drop(next(iter(stage.engine.intentions))))
    assert stage.ends == [("failed", "(move r1 home shop): it was given up from outside")]
    assert stage.holds("at r1 home")


def test_conditions_may_follow_from_others():
    text = WORKSHOP.text.replace("(rung))", "(rung) (bright))", 1).replace(
        "(:durative-action move", "(:derived (bright) (lit))\n(:durative-action move", 1
    )
    domain = read_domain(
        text.replace(":precondition (lit)", ":precondition (bright)").replace(
            ":negative-preconditions", ":negative-preconditions :derived-predicates"
        )
    )
    stage = Stage(domain=domain)
    stage.execute("0: (shine) [10]\n0.001: (ring)", wanted="rung")
    stage.until(1)
    assert stage.begun() == {"(shine)": 0, "(ring)": 0}
