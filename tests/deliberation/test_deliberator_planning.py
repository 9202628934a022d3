"""Planners that are late, wrong, dead or silent, and deadlines that cannot be met."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import pytest

from socialbot.planning.pddl.domain import parse_plan
from socialbot.planning.pddl.formulas import And
from socialbot.planning.pddl.reader import read_domain
from socialbot.planning.planners.engines import Kairos
from socialbot.planning.planners.planner import PlannerAnswer, PlannerVerdict
from tests.deliberation.domains import dnf, n, p
from tests.deliberation.office import JOBS, Clerk, Office, job, office_for
from tests.deliberation.stage import Behaviour


def last_reason(office: Office) -> str:
    return office.ends[-1][2]


@pytest.mark.parametrize(
    ("reply", "stated"),
    [
        (PlannerAnswer(PlannerVerdict.INVALID), "invalid"),
        (PlannerAnswer(PlannerVerdict.GAVE_UP, message="found no plan in 5 s"), "found no plan in 5 s"),
        (PlannerAnswer(PlannerVerdict.FAILED, message="killed by signal 11"), "killed by signal 11"),
        (PlannerAnswer(PlannerVerdict.SOLVED), "the planner returned no plan"),
        ("a plan", "str: a plan"),
        (RuntimeError("no such planner"), "RuntimeError: no such planner"),
    ],
)
def test_a_planner_without_a_plan_costs_one_desire_and_the_others_go_on(reply, stated):
    office = Office(comp_plan_tries=3)
    office.clerk.script = lambda problem: reply if "(done a)" in str(problem.goal) else None
    office.want(job("a", 0.9), job("b"))
    assert office.until(30) == [("b", "fulfilled", ""), ("a", "dropped", f"no plan after 3 tries: {stated}")]
    assert [record.time / 1e9 for record in office.found("planning", "a")] == [0.0, 6.0, 7.0], "b was not interrupted"


class Mute:
    name = "mute"

    def solve(self, *question: Any) -> Any:
        """Returns nothing at all."""


def test_a_planner_without_an_answer_is_reported():
    mute: Any = Mute()
    office = office_for(job("a"), comp_plan_tries=1, planner=mute)
    assert last_reason(office) == "no plan after 1 try: the planner returned no answer"
    assert office.found("planning")[0].detail["verdict"] == "failed"


def test_an_impossible_problem_is_planned_again_after_a_change_or_much_later():
    office = Office(comp_plan_tries=3)
    office.clerk.script = lambda problem: PlannerAnswer(PlannerVerdict.IMPOSSIBLE)
    office.want(job("a"))
    office.until(2.5)
    office.believe("lit")
    office.until(30)
    assert [record.time / 1e9 for record in office.found("planning", "a")] == [0.0, 2.5, 10.5]
    assert last_reason(office) == "no plan after 3 tries: impossible"


def test_not_even_new_beliefs_have_it_asked_again_before_the_pause_is_over():
    office = Office()
    office.clerk.script = lambda problem: PlannerAnswer(PlannerVerdict.IMPOSSIBLE)
    office.want(job("a"))
    office.believe("lit")
    office.until(2)
    assert [record.time / 1e9 for record in office.found("planning", "a")] == [0.0, 1.0]


def test_executions_that_fail_at_once_are_tried_again_after_a_pause():
    office = Office(exec_plan_tries=8)
    office.behaviour["(do a)"] = Behaviour(lasts_s=0.0, fails="the arm is booting")
    office.want(job("a"))
    office.until(2.5)
    office.behaviour.clear()
    office.until(20)
    assert office.begun() == [(float(second), "(do a)") for second in range(4)]
    assert office.ends == [("a", "fulfilled", "")]


def test_attempts_that_keep_failing_become_rarer():
    office = Office(exec_plan_tries=8)
    office.behaviour["(do a)"] = Behaviour(lasts_s=0.0, fails="the arm is broken")
    office.want(job("a"))
    office.until(60)
    assert [time for time, _ in office.begun()] == [0.0, 1.0, 2.0, 3.0, 5.0, 9.0, 17.0, 25.0]
    assert office.ends == [("a", "dropped", "aborted 8 times: (do a): the arm is broken")]


def test_a_plan_with_an_unhandled_action_drops_its_desire():
    office = Office()
    office.run(lambda: office.engine.remove_plan(next(iter(office.engine.library.triggers["+!prepare/0"].plans)).plan))
    office.want(job("x", value=(p("ready"), p("lit"))), job("b"))
    assert office.until(10) == [("x", "dropped", "no plan or action performs prepare"), ("b", "fulfilled", "")]
    assert office.begun() == [(0.0, "(do b)")]


def test_between_two_tries_some_time_passes():
    office = Office(comp_plan_tries=3, retry_s=2.0)
    office.clerk.script = lambda problem: PlannerAnswer(PlannerVerdict.GAVE_UP)
    office.want(job("a"))
    office.until(10)
    assert [record.time / 1e9 for record in office.found("planning", "a")] == [0.0, 2.0, 4.0]


def test_the_count_of_tries_restarts_after_an_executed_plan():
    office = Office(comp_plan_tries=3)
    office.behaviour["(do a)"] = Behaviour(lasts_s=1.0, fails="slipped")
    impossible = iter([True, True, False, True, True, False])
    office.clerk.script = lambda problem: PlannerAnswer(PlannerVerdict.GAVE_UP) if next(impossible, False) else None
    office.want(job("a"))
    office.until(2.5)
    assert office.pursued == "a"
    office.until(3.5)
    office.behaviour.clear()
    office.until(20)
    assert len(office.clerk.asked) == 6
    assert office.ends == [("a", "fulfilled", "")]


def test_a_planner_that_never_answers_is_given_up_and_asked_again():
    office = office_for(job("a"), slow=True, planning_timeout_s=2.0)
    assert len(office.pending) == 1
    office.until(6.9)
    assert not office.clerk.cancelled
    office.until(8.1)
    (record,) = office.found("planning", "a")
    assert (record.detail["verdict"], record.detail["message"]) == ("failed", "the planner does not answer")
    assert len(office.pending) == 2
    office.answer()
    assert office.pursued is None, "the first answer comes too late"
    assert office.clerk.cancelled[0].is_set()
    office.answer()
    assert office.pursued == "a"


def test_a_plan_longer_than_the_deadline_is_never_accepted():
    office = Office(comp_plan_tries=2)
    office.clerk.script = lambda problem: PlannerAnswer(PlannerVerdict.SOLVED, parse_plan("1.0: (do a) [6]"))
    office.want(job("a", deadline=6.5))
    office.until(10)
    assert office.begun() == []
    assert last_reason(office) == "no plan after 2 tries: the plan lasts 7 s, longer than the 6.5 s there are"
    assert office.clerk.limits[0].makespan_s == 6.5


def test_an_impossible_deadline_is_stated_by_the_real_planner_too():
    office = Office(planner=Kairos(), comp_plan_tries=1, planning_timeout_s=0.5)
    office.want(job("a", deadline=5.9), job("b", deadline=0.0, priority=0.1))
    office.until(10)
    assert [name for name, how, _ in office.ends if how == "dropped"] == ["a", "b"]
    assert "the plan found first lasts 6 s, longer than the 5.9 s there are" in office.ends[0][2]


def test_a_new_plan_may_not_last_longer_than_the_time_until_it_would_be_aborted():
    office = Office(rtc_deadline=1.5)
    office.behaviour["(do a)"] = Behaviour(lasts_s=6.0, fails="slipped")
    office.want(job("a", deadline=8.0))
    office.until(6)
    assert [limits.makespan_s for limits in office.clerk.limits] == [8.0, 6.0]


def test_a_plan_that_takes_far_longer_than_its_deadline_is_aborted():
    office = Office(exec_plan_tries=1)
    office.behaviour["(do a)"] = Behaviour(lasts_s=15.0)
    office.want(job("a", deadline=7.0))
    assert office.until(40) == [("a", "dropped", "aborted 1 time: not achieved in 14 s, 2 times the deadline")]
    assert office.plans() == [("a", "aborted")]


def test_a_plan_that_does_not_fit_the_domain_any_more_fails_before_anything_begins():
    office = office_for(job("a"), exec_plan_tries=1, slow=True)
    office.run(lambda: setattr(office.facts, "domain", replace(JOBS, name="other")))
    office.answer()
    assert office.begun() == []
    assert last_reason(office) == "aborted 1 time: the domain has changed since the plan was made"


def test_a_plan_with_an_unknown_action_fails_before_anything_begins():
    office = Office(exec_plan_tries=1)
    office.clerk.script = lambda problem: PlannerAnswer(PlannerVerdict.SOLVED, parse_plan("0.0: (fly a) [1]"))
    office.want(job("a"))
    assert office.begun() == []
    assert last_reason(office).startswith("aborted 1 time: ")
    assert "no action fly" in last_reason(office)


# While a plan is being made


def test_a_desire_that_ends_meanwhile_cancels_the_planner():
    office = office_for(job("a"), slow=True)
    (answer,) = office.pending
    office.believe("done a")
    assert office.ends == [("a", "fulfilled", "")]
    office.run(answer)
    assert office.begun() == []
    assert office.clerk.cancelled[0].is_set()


def test_a_plan_whose_precondition_ends_during_planning_is_not_counted():
    office = Office(slow=True)
    office.believe("ready")
    office.want(job("a", precondition=dnf([("T", p("ready"))])))
    office.forget("ready")
    office.answer()
    assert office.pursued is None
    assert next(iter(office.deliberator.desires)).failed_planning == 0
    office.believe("ready")
    office.answer()
    assert office.pursued == "a"


def test_a_more_urgent_desire_replaces_the_plan_request():
    office = office_for(job("a"), slow=True)
    office.want(job("b", 0.9), job("c", 0.1))
    assert len(office.pending) == 2
    office.answer()
    assert office.clerk.cancelled[0].is_set()
    assert office.pursued is None
    office.answer()
    assert office.pursued == "b"


def test_beliefs_that_change_meanwhile_are_seen_when_the_plan_begins():
    office = office_for(job("x", value=(p("done", "a"), p("ready"))), slow=True, exec_plan_tries=2)
    office.believe("ready")
    office.answer()
    assert office.plans() == [("x", "failed")]
    office.until(1)
    office.answer()
    assert office.until(10) == [("x", "fulfilled", "")]


def test_the_context_that_ends_while_a_new_plan_is_made_ends_the_pursuit():
    office = Office(slow=True)
    office.believe("quiet")
    office.behaviour["(do a)"] = Behaviour(lasts_s=1.0, fails="slipped")
    office.want(job("a", context=dnf([("T", p("quiet"))])))
    office.answer()
    office.until(2)
    office.forget("quiet")
    office.answer()
    office.until(3)
    assert office.pursued is None or office.plans()[-1][1] != "succeeded"
    assert office.wants == ["a"]
    assert office.begun() == [(0.0, "(do a)")]


def test_after_stop_no_answer_is_wanted():
    office = office_for(job("a"), slow=True)
    office.run(office.deliberator.stop)
    (answer,) = office.pending
    office.run(answer)
    assert office.begun() == []
    assert office.clerk.cancelled[0].is_set()


def test_a_planner_that_hangs_in_its_thread_does_not_hold_up_the_agent():
    entered, leave = threading.Event(), threading.Event()

    class Stuck(Clerk):
        def solve(self, domain, problem, limits, cancelled=None):
            assert isinstance(problem.goal, And)
            entered.set()
            leave.wait(30)
            return super().solve(domain, problem, limits, cancelled)

    office = Office(planner=Stuck())
    threads = []

    def aside(work, then):
        threads.append(threading.Thread(target=lambda: then(work())))
        threads[-1].start()

    office.deliberator.pursuit.run_in_background = aside
    office.want(job("a"))
    assert entered.wait(60)
    office.believe("lit")
    assert office.facts.check(dnf([("T", p("lit"))]).clauses[0].literals[0])
    leave.set()
    threads[0].join(60)
    assert office.until(7) == [("a", "fulfilled", "")]


def both(**options) -> Office:
    """An office that wants a job done, and a level that nothing brings about."""
    office = Office(planner=Kairos(), comp_plan_tries=3, **options)
    office.want(job("both", value=(p("done", "a"), n("level", "b", value=7))))
    return office


def test_an_impossible_desire_names_the_unreachable_condition():
    office = both()
    office.until(60)
    assert office.begun() == []
    assert office.ends == [("both", "dropped", "no plan after 3 tries: nothing can make (= (level b) 7) true")]


def test_partial_desires_achieve_what_is_possible():
    office = both(partial_desires=True)
    office.until(60)
    assert office.begun() == [(0.0, "(do a)")]
    assert office.plans() == [("both", "succeeded")]
    assert office.ends == [("both", "dropped", "no plan after 3 tries: nothing can make (= (level b) 7) true")]


def test_an_impossible_condition_that_becomes_possible_is_achieved_after_all():
    office = both(partial_desires=True)
    office.until(8)
    office.believe("level b = 7")
    assert office.until(60) == [("both", "fulfilled", "")]


def test_the_repair_of_a_partial_plan_leaves_out_the_same_conditions():
    office = Office(planner=Kairos(), partial_desires=True, comp_plan_tries=3)
    office.behaviour["(do a)"] = Behaviour(lasts_s=1.0, fails="slipped")
    office.want(job("both", value=(p("done", "a"), n("level", "b", value=7))))
    office.until(0.5)
    office.behaviour.clear()
    office.until(60)
    assert office.plans() == [("both", "failed"), ("both", "succeeded")]


ONE_HAND = read_domain(
    """
    (define (domain hand)
      (:requirements :typing :durative-actions :negative-preconditions)
      (:types job - object)
      (:predicates (done ?j - job) (hand))
      (:durative-action do :parameters (?j - job) :duration (= ?duration 6)
        :condition (and (at start (hand)) (at start (not (done ?j))))
        :effect (and (at start (not (hand))) (at end (hand)) (at end (done ?j)))))
    """,
    where="hand",
)


def one_by_one(broken: str, **options) -> Office:
    """An office that wants three jobs, one after the other, of which one always fails."""
    beliefs = "instance a job; instance b job; instance c job; hand"
    office = Office(planner=Kairos(), domain=ONE_HAND, beliefs=beliefs, partial_desires=True, **options)
    office.behaviour[f"(do {broken})"] = Behaviour(lasts_s=0.5, fails="it is broken")
    office.want(job("all", value=tuple(p("done", name) for name in "abc"), deadline=100.0))
    return office


@pytest.mark.parametrize("broken", ["a", "b", "c"])
def test_a_step_that_keeps_failing_costs_only_its_own_condition(broken: str):
    office = one_by_one(broken, exec_plan_tries=3)
    ((_, how, reason),) = office.until(300)
    assert {fact.params for fact in office.facts.facts() if fact.name == "done"} == {(n,) for n in "abc" if n != broken}
    assert how == "dropped"
    assert reason.endswith(f"times: (do {broken}): it is broken; missing: (done {broken})")


def test_a_step_that_has_failed_is_tried_again_when_the_rest_is_achieved():
    office = one_by_one("a", exec_plan_tries=3)
    office.until(10)
    office.behaviour.clear()
    assert office.until(300) == [("all", "fulfilled", "")]


CHAIN = read_domain(
    """
    (define (domain chain)
      (:requirements :typing :durative-actions)
      (:types job - object)
      (:predicates (done ?j - job) (next ?j ?k - job))
      (:durative-action do :parameters (?j ?k - job) :duration (= ?duration 6)
        :condition (and (at start (done ?j)) (at start (next ?j ?k)))
        :effect (at end (done ?k))))
    """,
    where="chain",
)


@pytest.mark.parametrize(("tries", "end"), [(3, "fulfilled"), (2, "dropped")])
def test_failures_before_the_last_progress_do_not_count(tries: int, end: str):
    beliefs = "instance z job; instance a job; instance b job; done z; next z a; next a b"
    office = Office(planner=Kairos(), domain=CHAIN, beliefs=beliefs, exec_plan_tries=tries)
    broken = Behaviour(lasts_s=0.5, fails="it is broken")
    office.behaviour.update({"(do z a)": broken, "(do a b)": broken})
    office.want(job("all", value=(p("done", "a"), p("done", "b")), deadline=100.0))
    for call in ("(do z a)", "(do a b)"):  # each fails twice
        while [begun for _, begun in office.begun()].count(call) < 2 and not office.ends:
            office.until(office.now + 0.1)
        del office.behaviour[call]
    office.until(60)
    assert office.ends[0][:2] == ("all", end)
