"""The plan executor runs plans against the current beliefs."""
# ruff: noqa: N801 - actions are written as plans write them

from __future__ import annotations

import pytest

from socialbot.core.clock import SECOND
from socialbot.deliberation.actions import PlanAction, register
from socialbot.deliberation.options import DeliberationOptions
from socialbot.planning.pddl.domain import parse_plan
from socialbot.planning.pddl.reader import read_domain
from tests.deliberation.stage import BOTH, FETCH, WORKSHOP, Behaviour, Stage, desire, stage_with

# Order and effects


def test_steps_run_in_parallel_and_start_after_their_predecessors():
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
    assert stage.plan_executor.idle
    assert stage.plan_executor.info.target is None


def test_effects_are_believed_at_the_start_and_the_end_of_a_step():
    stage = stage_with("0: (pick r1 b1 home) [3]", until=1)
    assert stage.holds("load r1 = 1")
    assert stage.holds("in b1 home")
    stage.until(3)
    assert stage.holds("load r1 = 1")
    assert stage.holds("holding r1 b1")
    assert not stage.holds("in b1 home")


def test_a_nested_step_runs_within_its_envelope():
    stage = Stage()
    stage.execute("0: (shine) [10]\n0.001: (spray b1) [4]\n4.002: (spray b2) [4]", wanted="painted b1; painted b2")
    assert stage.until(30) == [("succeeded", "")]
    assert stage.holds("paint = 1")
    assert not stage.holds("lit")


def test_an_early_end_waits_for_its_predecessors():
    stage = Stage(options=DeliberationOptions(tolerance_s=0))
    plan = "0: (shine) [10]\n0.001: (spray b1) [4]"
    stage.behaviour["(shine)"] = Behaviour(lasts_s=1)
    stage.execute(plan, wanted="painted b1")
    stage.until(3)
    assert stage.status()["(shine)"] == "RUNNING"
    assert stage.until(30) == [("succeeded", "")]


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
    stage = stage_with("", wanted="at r1 home")
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
def test_a_plan_that_does_not_fit_beliefs_fails_before_its_start(plan, reason):
    stage = stage_with(plan, until=10, wanted="at r1 yard")
    ((how, why),) = stage.ends
    assert how == "failed"
    assert reason in why
    assert stage.timeline == []
    assert stage.trace.find("plan_end")[0].detail["outcome"] == "failed"


def test_a_plan_for_another_domain_fails_before_anything_begins():
    stage = Stage()
    other = type(WORKSHOP)("workshop", actions=WORKSHOP.actions)
    stage.run(lambda: stage.plan_executor.execute(parse_plan(FETCH), desire(), "", domain=other))
    assert stage.ends == [("failed", "the domain has changed since the plan was made")]
    assert stage.timeline == []


# Conditions


def test_a_step_waits_for_its_conditions_and_fails_when_they_do_not_come():
    stage = stage_with(FETCH, until=4, wanted="holding r1 b3")
    stage.forget("in b3 shop")
    assert stage.until(6.9) == []
    assert stage.until(20) == [("failed", "(pick r1 b3 shop): condition does not hold: (in b3 shop)")]
    assert "(pick r1 b3 shop)" not in stage.begun()
    assert stage.trace.find("plan_end")[0].time == 7 * SECOND


def test_a_step_begins_as_soon_as_its_conditions_have_come():
    stage = stage_with(FETCH, until=4, wanted="holding r1 b3")
    stage.forget("in b3 shop")
    stage.until(6)
    stage.believe("in b3 shop")
    stage.until(20)
    assert stage.begun()["(pick r1 b3 shop)"] == 6
    assert stage.ends == [("succeeded", "")]


def test_a_condition_that_stops_holding_fails_the_step_and_its_action_is_cancelled():
    stage = stage_with("0: (pick r1 b1 home) [3]", until=1, wanted="holding r1 b1")
    stage.forget("at r1 home")
    assert stage.until(20) == [("failed", "(pick r1 b1 home): condition holds no longer: (at r1 home)")]
    assert stage.timeline[-1] == (1.5, "is asked to stop", "(pick r1 b1 home)")
    assert stage.holds("load r1 = 0")
    assert stage.status() == {"(pick r1 b1 home)": "FAILED"}


def test_a_condition_may_flicker():
    stage = stage_with("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    for begin in (1, 2):
        stage.until(begin)
        stage.forget("at r1 home")
        stage.until(begin + 0.4)
        stage.believe("at r1 home")
    assert stage.until(20) == [("succeeded", "")]


def test_without_tolerance_it_may_not():
    stage = Stage(options=DeliberationOptions(tolerance_s=0))
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(1)
    stage.forget("at r1 home")
    assert stage.ends == [("failed", "(pick r1 b1 home): condition holds no longer: (at r1 home)")]


def test_a_condition_at_the_end_that_does_not_hold_fails_the_step():
    stage = stage_with("0: (shine) [10]\n0.001: (spray b1) [4]", until=1, wanted="painted b1")
    stage.believe("paint = 0")
    assert stage.until(20) == [("failed", "(spray b1): condition does not hold at the end: (>= (paint) 1)")]
    assert not stage.holds("painted b1")
    assert stage.holds("paint = 0")


# What sensors see


def test_watched_effects_are_left_to_the_sensors():
    stage = stage_with(FETCH, Stage(watched={"at"}), until=1, wanted="holding r1 b3")
    assert stage.holds("at r1 home")
    stage.forget("at r1 home")
    stage.until(5.5)
    assert stage.status()["(move r1 home shop)"] == "RUNNING"
    stage.believe("at r1 shop")
    stage.until(20)
    assert stage.begun()["(pick r1 b3 shop)"] == 5.5
    assert stage.ends == [("succeeded", "")]


def test_an_effect_that_is_not_seen_fails_the_step():
    stage = stage_with(FETCH, Stage(watched={"at"}), wanted="holding r1 b3")
    stage.forget("at r1 home")
    assert stage.until(20) == [("failed", "(move r1 home shop): effect not seen: (at r1 shop)")]
    assert stage.trace.find("step_end")[0].time == 7 * SECOND
    assert not stage.holds("at r1 home")


def test_a_condition_that_only_sensors_can_make_true_is_given_time():
    stage = stage_with("0: (shine) [10]\n0.001: (ring)", Stage(watched={"lit"}), until=1, wanted="rung")
    assert "(ring)" not in stage.begun()
    stage.believe("lit")
    stage.until(2)
    assert stage.begun()["(ring)"] == 1


@pytest.mark.parametrize("seen_at", [2.5, 3.5])
def test_a_number_may_be_seen_before_or_after_the_action_ends(seen_at):
    stage = stage_with("0: (shine) [10]\n0.001: (spray b1) [4]", Stage(watched={"paint"}), wanted="painted b1")
    stage.until(seen_at)
    stage.believe("paint = 2")
    assert stage.until(20) == [("succeeded", "")]
    assert stage.holds("paint = 2")


@pytest.mark.parametrize(
    ("seen", "end"),
    [
        ("paint = 0", ("succeeded", "")),
        ("paint = -1", ("failed", "(spray b1): condition does not hold at the end: (>= (paint) 1)")),
    ],
)
def test_a_condition_at_the_end_counts_without_the_effects_that_sensors_saw_before(seen, end):
    stage = Stage(watched={"paint"})
    stage.believe("paint = 1")
    stage.execute("0: (shine) [10]\n0.001: (spray b1) [4]", wanted="painted b1")
    stage.until(2.5)
    stage.believe(seen)
    assert stage.until(20) == [end]


@pytest.mark.parametrize("is_replaced", [False, True])
@pytest.mark.parametrize("seen_at", [2.5, 3.5])
def test_a_fact_may_be_seen_to_end_before_or_after_the_action_that_needs_it_ends(seen_at, is_replaced):
    needs = "(at start (holding ?r ?b)) (over all (at ?r ?p))"
    domain = read_domain(WORKSHOP.text.replace(needs, f"{needs} (at end (holding ?r ?b))", 1))
    stage = Stage(domain=domain, watched={"holding"})
    stage.behaviour["(put r1 b1 home)"] = Behaviour(lasts_s=3)
    stage.believe("holding r1 b1")
    stage.execute("0: (put r1 b1 home) [3]", wanted="in b1 home")
    stage.until(seen_at)
    stage.forget("holding r1 b1")
    if is_replaced:  # by a plan during the same step
        stage.execute("1: (move r1 home shop) [5]", wanted="at r1 shop")
    assert stage.until(20)[-1] == ("succeeded", "")
    assert stage.holds("in b1 home")


@pytest.mark.parametrize(
    ("seen", "ends"),
    [
        ("load r1 = 1", ("succeeded", "")),
        ("load r1 = 0", ("failed", "(pick r1 b1 home): effect not seen: (load r1) = 1")),
    ],
)
def test_a_step_ends_after_its_effects_at_the_start_are_seen(seen, ends):
    stage = Stage(watched={"load"})
    stage.behaviour["(pick r1 b1 home)"] = Behaviour(lasts_s=0.5)
    stage.execute("0: (pick r1 b1 home) [3]\n3.01: (put r1 b1 home) [3]", wanted="in b1 home")
    stage.until(1)
    assert "(put r1 b1 home)" not in stage.begun()
    stage.believe(seen)
    stage.until(1.5)
    stage.believe("load r1 = 0")
    assert stage.until(20) == [ends]


def test_a_number_that_does_not_change_fails_the_step():
    stage = Stage(watched={"paint"})
    stage.execute("0: (shine) [10]\n0.001: (spray b1) [4]", wanted="painted b1")
    assert stage.until(20) == [("failed", "(spray b1): effect not seen: (paint) = 2")]


# Failures


@pytest.mark.parametrize("lasts_s", [0, 1])
def test_an_action_that_fails_leaves_things_as_they_were(lasts_s):
    stage = Stage()
    stage.behaviour["(pick r1 b1 home)"] = Behaviour(lasts_s=lasts_s, fails="it slipped")
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    assert stage.until(20) == [("failed", "(pick r1 b1 home): it slipped")]
    assert stage.holds("load r1 = 0")


def test_an_action_without_handler_fails():
    stage = Stage()
    without_plans(stage, "+!ring/0")
    stage.believe("lit")
    stage.execute("0: (ring)", wanted="rung")
    assert stage.ends[0][0] == "failed"
    assert "no plan" in stage.ends[0][1]


def test_external_changes_are_not_rolled_back():
    stage = Stage()
    stage.behaviour["(pick r1 b1 home)"] = Behaviour(fails="it slipped")
    stage.execute("0: (pick r1 b1 home) [3]", wanted="holding r1 b1")
    stage.until(1)
    stage.believe("load r1 = 4")
    stage.until(20)
    assert stage.holds("load r1 = 4")


def test_after_a_failure_no_step_starts_and_running_steps_continue():
    stage = Stage()
    stage.behaviour["(move r1 home shop)"] = Behaviour(lasts_s=1, fails="stuck")
    stage.execute(BOTH, wanted="holding r1 b3; holding r2 b1")
    stage.until(2)
    assert [task.step.call for task in stage.plan_executor.running] == ["(move r2 yard home)"]
    assert stage.plan_executor.info.status == "ABORT"
    stage.until(30)
    assert list(stage.begun()) == ["(move r1 home shop)", "(move r2 yard home)"]
    assert stage.holds("at r2 home")
    assert stage.holds("at r1 home")
    assert stage.ends == [("failed", "(move r1 home shop): stuck")]


def test_a_step_that_continues_after_a_failure_may_fail_too():
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
    assert stage.until(600) == [("failed", "(move r1 home shop): takes longer than 30 s; 5 s were planned")]
    assert stage.timeline[-1] == (30, "is asked to stop", "(move r1 home shop)")
    assert stage.holds("at r1 home")


def test_an_object_that_has_gone_fails_the_step_and_does_not_come_back():
    stage = stage_with("0: (pick r1 b1 home) [3]", until=1, wanted="holding r1 b1")
    stage.forget("instance r1 robot")
    stage.until(10)
    assert stage.ends[0][0] == "failed"
    assert "r1" not in stage.facts.objects()


def test_equal_steps_do_not_run_at_once():
    stage = Stage()
    stage.believe("lit")
    stage.execute("0: (spray b1) [4]\n4.1: (spray b1) [4]\n4.2: (spray b2) [4]", wanted="painted b1")
    stage.until(20)
    begins = [(time, call) for time, what, call in stage.timeline if what == "begins"]
    assert begins == [(0, "(spray b1)"), (0, "(spray b2)"), (4, "(spray b1)")]


# Who carries it out


def without_plans(stage: Stage, key: str) -> None:
    for ready in list(stage.engine.library.triggers[key].plans):
        stage.engine.remove_plan(ready.plan)


def test_a_plan_action_executes_a_step_and_reports_progress():
    class fill(PlanAction):
        rate_hz = 1.0

        def advance(self):
            return self.progress_made + 0.125

    stage = Stage()
    without_plans(stage, "+!move/3")
    register(stage.engine, fill, 3, "move")
    stage.execute(FETCH, wanted="holding r1 b3")
    stage.until(4)
    assert stage.plan_executor.info.actions_exec_info[0].progress == 0.5
    assert stage.plan_executor.info.estimated_deadline == 11
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


def test_a_dropped_intention_fails_the_step():
    stage = stage_with(FETCH, until=1, wanted="holding r1 b3")
    stage.run(lambda: stage.engine.intentions.drop(next(iter(stage.engine.intentions))))
    assert stage.ends == [("failed", "(move r1 home shop): the goal was dropped")]
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
    stage = stage_with("0: (shine) [10]\n0.001: (ring)", Stage(domain=domain), until=1, wanted="rung")
    assert stage.begun() == {"(shine)": 0, "(ring)": 0}
