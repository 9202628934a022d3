"""Desires, from their adoption to their end."""

from __future__ import annotations

import pytest

from socialbot.bdi.trace import Record, as_text, sentence
from socialbot.deliberation.messages import Fact, FactCondition
from socialbot.deliberation.rules import ReactiveRule, RuleEffect
from socialbot.planning.pddl.domain import parse_plan
from socialbot.planning.planners.engines import Kairos
from socialbot.planning.planners.planner import PlannerAnswer, PlannerVerdict
from tests.deliberation.domains import dnf, i, n, p
from tests.deliberation.office import Office, Watcher, job, office_for
from tests.deliberation.stage import Behaviour

KINDS = (
    "desire", "desire_refused", "desire_fulfilled", "desire_dropped", "planning", "plan_start", "plan_end", "step",
    "step_end", "hold", "release", "rule", "reply", "refused", "silent", "heard",
)  # fmt: skip


def test_a_desire_is_planned_executed_and_fulfilled():
    office = Office()
    assert office.want(job("a")) == [""]
    assert office.pursued == "a"
    office.until(6)
    assert office.begun() == [(0.0, "(do a)")]
    assert office.ends == [("a", "fulfilled", "")]
    assert office.wants == []
    assert office.pursued is None


def test_the_plan_of_one_action_that_takes_all_the_time_there_is_is_accepted():
    office = office_for(job("a", deadline=6.0), until=7, planner=Kairos())
    assert office.ends == [("a", "fulfilled", "")]


def test_desires_have_their_turns_by_priority_then_deadline_then_arrival():
    office = office_for(job("a", 0.2), job("b", 0.9), job("c", 0.5, 50.0), job("d", 0.5, 40.0), until=40)
    assert [call for _, call in office.begun()] == ["(do b)", "(do d)", "(do c)", "(do a)"]
    assert [how for _, how, _ in office.ends] == ["fulfilled"] * 4


def test_a_desire_that_holds_already_needs_no_plan():
    office = Office()
    office.believe("done a")
    office.want(job("a"))
    assert office.ends == [("a", "fulfilled", "")]
    assert office.clerk.asked == []


def test_a_desire_fulfilled_externally_stops_its_plan():
    office = office_for(job("a"), job("b"), until=2)
    office.believe("done b")
    assert office.ends == [("b", "fulfilled", "")], "though it had no turn yet"
    office.believe("done a")
    assert office.ends[1:] == [("a", "fulfilled", "")]
    assert (2.0, "is asked to stop", "(do a)") in office.timeline
    assert office.pursued is None


def test_a_plan_that_is_nearly_done_is_carried_out_to_its_end_though_its_desire_is_fulfilled():
    office = office_for(job("a"), until=5)
    office.believe("done a")
    assert office.wants == ["a"]
    assert office.until(6) == [("a", "fulfilled", "")]
    assert (6.0, "ends", "(do a)") in office.timeline


def test_a_desire_that_is_fulfilled_while_its_nearly_done_plan_fails_is_fulfilled():
    office = Office()
    office.behaviour["(do a)"] = Behaviour(lasts_s=5.5, fails="slipped")
    office.want(job("a"))
    office.until(5)
    office.believe("done a")
    assert office.until(6) == [("a", "fulfilled", "")]
    assert len(office.clerk.asked) == 1


def test_numbers_and_negations_can_be_desired():
    office = Office(beliefs="instance a job; level a = 3; lit")
    wanted = (
        FactCondition(condition_to_check=n("level", "a", value=5), check="GREQ"),
        FactCondition(condition_to_check=p("lit"), check="F"),
    )
    office.clerk.script = lambda problem: PlannerAnswer(PlannerVerdict.GAVE_UP, message="not today")
    office.want(job("x", value=(), conditions=wanted))
    assert office.clerk.asked == ["(and (>= (level a) 5) (not (lit)))"]
    office.believe("level a = 7")
    office.forget("lit")
    assert office.ends == [("x", "fulfilled", "")]


def test_dropping_a_desire_stops_its_plan_and_calls_listeners():
    office = office_for(job("a"), until=1)
    office.run(lambda: office.deliberator.drop("a", "no longer", cause="test"))
    assert office.ends == [("a", "dropped", "no longer")]
    assert office.pursued is None
    assert office.plans() == [("a", "aborted")]
    assert not office.facts.check(FactCondition(condition_to_check=p("begun", "a"))), "its start is taken back"
    assert not office.deliberator.drop("a")


def test_a_name_is_taken_once_and_the_same_again_has_one_more_listener():
    office = office_for(job("a"))
    assert office.want(job("a")) == [""]
    assert office.want(job("a", value=(p("lit"),))) == ["another desire has the name a"]
    assert office.until(7) == [("a", "fulfilled", "")] * 2


@pytest.mark.parametrize(
    ("desire", "reason"),
    [
        (job("x", value=()), "wants nothing"),
        (job("x", value=(p("cleaned", "a"),)), "there is no predicate 'cleaned'"),
        (job("x", value=(p("done"),)), "has 1 parameter"),
        (job("x", value=(p("done", "{y}"),)), "'{y}' is no name"),
        (job("x", value=(p("level", "a"),)), "is a function"),
        (
            job("x", value=(), conditions=(FactCondition(condition_to_check=p("lit"), check="GR"),)),
            "GR checks a function",
        ),
        (job("x", precondition=dnf([("T", p("raedy"))])), "there is no predicate 'raedy'"),
        (job("x", precondition=dnf([("EQ", p("ready"))])), "EQ checks a function"),
        (job("x", context=dnf([("T", p("done", "a", "b"))])), "has 1 parameter"),
        (job("x", rollback_belief_add=(p("nothing"),)), "there is no predicate 'nothing'"),
        (job("x", rollback_belief_add=(p("done", "*"),)), "'*' is no name"),
        (job("x", rollback_belief_del=(p("nothing", "*"),)), "there is no predicate 'nothing'"),
    ],
)
def test_a_desire_that_does_not_fit_the_domain_is_refused(desire, reason):
    office = Office()
    (refusal,) = office.want(desire, cause="somebody")
    assert reason in refusal
    (record,) = office.found("desire_refused", "x")
    assert (record.cause, record.detail["reason"]) == ("somebody", refusal)
    assert office.wants == []


def test_an_object_that_is_not_known_counts_as_a_failed_try_until_it_is():
    office = office_for(job("z"), until=2, comp_plan_tries=5)
    assert office.wants == ["z"]
    assert len(office.found("planning", "z")) == 3
    assert office.clerk.asked == []
    office.believe("instance z job")
    assert office.until(10) == [("z", "fulfilled", "")]


def test_a_desire_about_an_unknown_object_is_dropped_with_the_reason():
    office = office_for(job("z"), until=5, comp_plan_tries=3)
    ((name, how, reason),) = office.ends
    assert (name, how) == ("z", "dropped")
    assert reason.startswith("no plan after 3 tries: (done z): there is no object 'z'")


def test_a_precondition_is_waited_for():
    office = office_for(job("a", precondition=dnf([("T", p("ready")), ("F", p("lit"))], [("T", p("quiet"))])))
    assert office.clerk.asked == []
    office.believe("ready")
    assert office.pursued == "a"


@pytest.mark.parametrize(
    ("precondition", "change"),
    [
        (dnf([("T", p("be*", "a"))]), "begun a"),
        (dnf([("EX", i("{x}", "job")), ("T", p("begun", "{x}"))]), "begun z"),
        (dnf([("EX", i("z", "job"))]), "instance z job"),
        (dnf([("GR", n("level", "{x}", value=2)), ("F", p("done", "{x}"))]), "level b = 3"),
    ],
)
def test_preconditions_with_patterns_and_variables_are_seen_to_hold(precondition, change):
    office = office_for(job("a", precondition=precondition))
    assert office.pursued is None
    office.believe(change)
    assert office.pursued == "a"


def test_a_desire_is_not_taken_up_while_its_context_does_not_hold():
    office = office_for(job("a", context=dnf([("T", p("quiet"))])))
    assert office.pursued is None
    office.believe("quiet")
    assert office.pursued == "a"


def test_a_plan_is_aborted_and_rolled_back_when_the_context_ends():
    office = Office()
    office.believe("quiet", "told")
    office.want(
        job(
            "a",
            context=dnf([("T", p("quiet"))]),
            rollback_belief_add=(p("lit"),),
            rollback_belief_del=(p("told"), p("done", "*")),
        )
    )
    office.until(2)
    office.believe("done d")
    office.forget("quiet")
    assert office.plans() == [("a", "aborted")]
    held = office.facts.facts()
    assert p("lit") in held
    assert p("told") not in held
    assert p("done", "d") not in held
    assert office.wants == ["a"]
    office.until(5)
    assert office.pursued is None, "it waits for its context"
    office.believe("quiet")
    assert office.until(20) == [("a", "fulfilled", "")]


# What goes wrong


def test_a_step_that_fails_makes_for_a_new_plan_at_once():
    office = Office()
    office.behaviour["(do a)"] = Behaviour(lasts_s=1.0, fails="slipped")
    office.want(job("a"))
    office.until(0.5)
    office.behaviour.clear()
    office.until(10)
    assert office.begun() == [(0.0, "(do a)"), (1.0, "(do a)")]
    assert office.plans() == [("a", "failed"), ("a", "succeeded")]
    assert office.ends == [("a", "fulfilled", "")]


def test_a_desire_whose_plans_fail_too_often_is_dropped_with_the_reason():
    office = Office(exec_plan_tries=3)
    office.behaviour["(do a)"] = Behaviour(lasts_s=1.0, fails="slipped")
    office.want(job("a"), job("b"))
    office.until(20)
    assert office.ends[0] == ("a", "dropped", "aborted 3 times: (do a): slipped")
    assert len(office.begun()) == 4
    assert office.ends[1] == ("b", "fulfilled", "")


def test_several_steps_that_fail_at_once_are_one_failed_execution():
    office = Office(exec_plan_tries=2)
    for name in "ab":
        office.behaviour[f"(do {name})"] = Behaviour(lasts_s=1.0, fails="slipped")
    office.clerk.script = lambda problem: PlannerAnswer(
        PlannerVerdict.SOLVED, parse_plan("0.0: (do a) [6]\n0.0: (do b) [6]") if len(office.clerk.asked) == 1 else None
    )
    office.want(job("x", value=(p("done", "a"), p("done", "b"))))
    office.until(1.5)
    assert office.wants == ["x"]
    assert next(iter(office.deliberator.desires)).failed_execution == 1


def test_a_completed_plan_that_misses_the_goal_has_failed():
    office = office_for(job("a", context=dnf([("F", p("told"))])), until=5.9, exec_plan_tries=2)
    # Somebody undoes each result in the same moment.
    office.run(lambda: office.facts.watch(lambda it, held, cause: undo(office, it, held)))
    assert office.until(20) == [
        ("a", "dropped", "aborted 2 times: the plan has ended, but its goal does not hold"),
    ]


def undo(office: Office, it: Fact, held: bool) -> None:
    if held and it == p("done", "a"):
        office.facts.remove(it)


def test_rules_that_set_each_other_off_for_ever_are_stopped_and_stated():
    office = Office()
    flip = ReactiveRule("flip", dnf([("T", p("lit"))]), (effect("DEL", "lit"), effect("ADD", "quiet")))
    flop = ReactiveRule("flop", dnf([("T", p("quiet"))]), (effect("DEL", "quiet"), effect("ADD", "lit")))
    office.run(lambda: [office.deliberator.add_rule(rule) for rule in (flip, flop)])
    office.believe("lit")
    (record,) = office.found("failure", "rules")
    assert record.detail["reason"] == "circle"
    office.want(job("a"))
    assert office.until(10) == [("a", "fulfilled", "")]


def effect(operation, name: str) -> RuleEffect:
    return RuleEffect(operation=operation, fact=p(name))


def test_rules_may_come_and_go_and_bring_desires():
    office = Office()
    office.believe("level a = 3")
    state = job("do_{x}", value=(p("done", "{x}"),))
    rule = ReactiveRule("busy", dnf([("GR", n("level", "{x}", value=2))]), (RuleEffect(operation="ADD", desire=state),))
    office.run(lambda: office.deliberator.add_rule(rule))
    assert office.wants == ["do_a"], "it fires for what holds already"
    (record,) = office.found("desire", "do_a")
    assert record.cause == office.found("rule", "busy")[0].id
    office.run(lambda: office.deliberator.remove_rule("busy"))
    office.believe("level b = 3")
    assert office.wants == ["do_a"]


def test_a_rule_drops_a_desire():
    office = office_for(job("a"))
    rule = ReactiveRule("stop", dnf([("T", p("told"))]), (RuleEffect(operation="DEL", desire=job("a")),))
    office.run(lambda: office.deliberator.add_rule(rule))
    office.believe("told")
    assert office.ends == [("a", "dropped", "the rule stop")]


def test_a_rule_drops_all_desires_of_a_name_like_that():
    office = office_for(job("a"), job("b", 0.4), job("wait", value=(p("lit"),)))
    rule = ReactiveRule("stop", dnf([("T", p("told"))]), (RuleEffect(operation="DEL", desire=job("?")),))
    office.run(lambda: office.deliberator.add_rule(rule))
    office.believe("told")
    assert office.ends == [("a", "dropped", "the rule stop"), ("b", "dropped", "the rule stop")]
    assert office.wants == ["wait"]


# The same desire again


def test_a_desire_that_is_asked_for_again_has_the_new_priority_and_deadline():
    office = Office(slow=True)
    assert office.want(job("a", 0.2, 50), job("b", 0.5), job("a", 0.9, 20)) == ["", "", ""]
    assert office.wants == ["a", "b"]
    assert office.deliberator.pursuit.planning_for is office.deliberator.desires.get("a")
    assert [record.detail["priority"] for record in office.found("desire", "a")] == [0.2, 0.9]
    office.want(job("a", 0.9, 20))
    assert len(office.found("desire", "a")) == 2, "the same again is nothing new"


def test_a_pursued_desire_may_be_revised_with_its_preparations():
    office = Office()
    office.behaviour["(do a)"] = Behaviour(lasts_s=20.0)
    office.want(job("a", deadline=7.0))
    office.until(10)
    office.want(job("a", deadline=12.0))
    assert office.until(21) == [("a", "fulfilled", ""), ("a", "fulfilled", "")], "14 s would have been too much before"
    other = Office(autosub_prec=True, slow=True)
    other.want(job("b", 0.5, precondition=dnf([("T", p("ready"))])), job("b", 0.7, 30.0))
    (child,) = other.deliberator.desires.children("b")
    assert (child.desire.priority, child.desire.deadline) == (0.71, 30.0)


@pytest.mark.parametrize("deadline", [float("inf"), float("nan"), 1e300])
def test_an_invalid_deadline_is_refused_without_side_effects(deadline):
    office = Office()
    (reason,) = office.want(job("a", deadline=deadline))
    assert "is out of range" in reason
    office.want(job("b"))
    assert "is out of range" in office.want(job("b", deadline=deadline))[0]
    assert office.until(10) == [("b", "fulfilled", "")]


# What nobody knows


def test_a_negation_about_an_unknown_object_is_no_success():
    office = Office(comp_plan_tries=2)
    office.want(job("typo", value=(), conditions=(FactCondition(check="F", condition_to_check=p("done", "aa")),)))
    office.until(5)
    ((_, how, reason),) = office.ends
    assert how == "dropped"
    assert "there is no object 'aa'" in reason


def test_it_is_when_the_object_has_appeared():
    office = Office()
    office.want(job("later", value=(), conditions=(FactCondition(check="F", condition_to_check=p("done", "e")),)))
    assert office.ends == []
    office.believe("instance e job")
    assert office.ends == [("later", "fulfilled", "")]


def test_a_plan_whose_desire_comes_true_early_is_stopped_without_its_rollback():
    office = office_for(job("a", rollback_belief_add=(p("told"),), rollback_belief_del=(p("done", "*"),)), until=2)
    office.believe("done a")
    assert office.ends == [("a", "fulfilled", "")]
    assert office.plans() == [("a", "aborted")]
    assert p("told") not in office.facts.facts()
    assert p("done", "a") in office.facts.facts()
    assert p("begun", "a") not in office.facts.facts(), "what the step had changed is taken back"
    office.want(job("b", rollback_belief_add=(p("told"),)))
    office.until(3)
    office.run(lambda: office.deliberator.drop("b"))
    assert p("told") in office.facts.facts()


def test_the_chain_of_causes_is_described_in_sentences():
    office = Office()
    state = job("do_{x}", value=(p("done", "{x}"),))
    rule = ReactiveRule("busy", dnf([("GR", n("level", "{x}", value=2))]), (RuleEffect(operation="ADD", desire=state),))
    office.run(lambda: office.deliberator.add_rule(rule))
    office.behaviour["(do a)"] = Behaviour(lasts_s=2.0, fails="slipped")
    office.believe("level a = 3")
    office.until(2)
    (end,) = [record for record in office.found("plan_end") if record.detail["outcome"] == "failed"]
    lines = as_text(office.trace.explain(end.id)).splitlines()
    assert lines[:2] == [
        "Plan 1 for do_a was over, failed: (do a): slipped at +2.000 s,",
        "because the step (do a) was over, failed: slipped at +2.000 s,",
    ]
    assert lines[-6:] == [
        "because it began the step (do a) at +0.000 s,",
        "because it began plan 1 for do_a at +0.000 s,",
        "because it planned for do_a at +0.000 s,",
        "because it desired do_a at +0.000 s,",
        "because its rule busy fired: ADD desire do_a at +0.000 s,",
        "because it believed level(a, 3), source: percept at +0.000 s.",
    ]


def test_every_kind_of_record_has_its_sentence():
    for kind in KINDS:
        assert sentence(Record("x-1", 0, kind, "this", "", {})) != f"{kind} this", kind
    record = Record("x-2", 0, "desire_dropped", "tidy", "", {"reason": "aborted 8 times"})
    assert sentence(record) == "it dropped its desire tidy: aborted 8 times"


def test_exceptions_in_listeners_and_observers_do_not_stop_the_agent():
    class Broken(Watcher):
        def beliefs_changed(self):
            raise ValueError("no screen")

        desires_changed = beliefs_changed

        def status_changed(self, status, reason):
            raise ValueError("no screen")

    office = Office(observer=Broken())
    office.run(lambda: office.deliberator.desire(job("a"), listener=lambda how, reason: 1 / 0))
    office.want(job("b"))
    assert office.until(20) == [("b", "fulfilled", "")]
    assert {record.detail["reason"] for record in office.found("failure")} == {"ValueError", "ZeroDivisionError"}


def test_observers_are_called_for_changes_only():
    watcher = Watcher()
    office = Office(observer=watcher)
    beliefs, desires = watcher.beliefs, watcher.desires
    office.want(job("a"))
    assert (watcher.beliefs, watcher.desires) == (beliefs + 1, desires + 1), "the step has begun"
    office.until(5)
    assert (watcher.beliefs, watcher.desires) == (beliefs + 1, desires + 1)
    office.until(7)
    assert watcher.statuses == [("SCHEDULING", ""), ("PLANNING", "a"), ("EXECUTING", "a"), ("SCHEDULING", "")]
    assert watcher.infos[-1].target is None


def test_every_decision_has_a_chain_of_causes_to_its_origin():
    office = Office()
    office.behaviour["(do a)"] = Behaviour(lasts_s=1.0, fails="slipped")
    office.want(job("a"), cause="letter-7")
    office.until(0.5)
    office.behaviour.clear()
    office.until(10)
    first, again = office.found("action")
    kinds = [record.kind for record in office.trace.explain(first.id)]
    assert kinds == ["action", "plan", "goal", "step", "plan_start", "planning", "desire"]
    assert office.trace.explain(first.id)[-1].cause == "letter-7"
    kinds = [record.kind for record in office.trace.explain(again.id)]
    assert kinds[:8] == ["action", "plan", "goal", "step", "plan_start", "planning", "plan_end", "step_end"]
    assert kinds[-1] == "desire"


def test_decisions_do_not_depend_on_planning_time():
    traces = []
    for seconds in (0.1, 3.0):
        office = Office()
        office.clerk.script = lambda problem, office=office, seconds=seconds: PlannerAnswer(
            PlannerVerdict.SOLVED, office.clerk.plan(problem).plan, seconds=seconds
        )
        office.want(job("a"), job("b"))
        office.until(20)
        traces.append(list(office.trace))
    assert traces[0] == traces[1]
