"""Desires that interrupt each other, and those that do not."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.planning.pddl.formulas import Predicate
from socialbot.planning.planners.planner import PlannerAnswer, PlannerVerdict
from tests.deliberation.domains import dnf, p
from tests.deliberation.office import Office, job, office_for
from tests.deliberation.stage import Behaviour


def test_without_preemption_the_plan_is_carried_out_to_its_end():
    office = office_for(job("a", 0.1), until=1)
    office.want(job("b", 0.9))
    office.until(20)
    assert office.begun() == [(0.0, "(do a)"), (6.0, "(do b)")]
    assert office.plans() == [("a", "succeeded"), ("b", "succeeded")]


def test_a_higher_priority_interrupts_and_the_other_is_replanned_afterwards():
    office = office_for(job("a", 0.1), until=1, reschedule_policy="PREEMPT")
    office.want(job("b", 0.9))
    office.until(20)
    assert office.begun() == [(0.0, "(do a)"), (1.0, "(do b)"), (7.0, "(do a)")]
    assert office.plans() == [("a", "aborted"), ("b", "succeeded"), ("a", "succeeded")]
    assert office.found("plan_end", "a")[0].detail["reason"] == "b comes first"
    assert office.ends == [("b", "fulfilled", ""), ("a", "fulfilled", "")]


def test_to_be_interrupted_is_no_failure():
    office = office_for(job("a", 0.1), reschedule_policy="PREEMPT", exec_plan_tries=1)
    for second, name in enumerate("bcd"):
        office.until(second + 1)
        office.want(job(name, 0.5 + second / 10))
    office.until(40)
    assert sorted(office.ends) == [(name, "fulfilled", "") for name in "abcd"]


def test_equals_interrupt_only_with_a_strictly_shorter_deadline():
    office = office_for(job("a", deadline=50), until=1, reschedule_policy="PREEMPT")
    office.want(job("b", deadline=50), job("c", deadline=60))
    assert office.pursued == "a"
    office.want(job("d", deadline=49))
    assert office.pursued == "d"


def test_a_desire_without_a_plan_preempts_none():
    office = Office(reschedule_policy="PREEMPT", comp_plan_tries=3)
    office.clerk.script = lambda problem: (
        PlannerAnswer(PlannerVerdict.IMPOSSIBLE) if "(done b)" in str(problem.goal) else None
    )
    office.want(job("a", 0.1))
    office.want(job("b", 0.9))
    office.until(30)
    assert office.plans() == [("a", "succeeded")]
    assert [end[:2] for end in office.ends] == [("a", "fulfilled"), ("b", "dropped")]


def test_a_desire_preempts_once_its_precondition_holds():
    office = Office(reschedule_policy="PREEMPT")
    office.want(job("a", 0.1), job("b", 0.9, precondition=dnf([("T", p("ready"))])))
    office.until(2)
    office.believe("ready")
    assert office.pursued == "b"


def test_the_preempting_plan_starts_after_all_actions_have_stopped():
    office = Office(reschedule_policy="PREEMPT")
    office.behaviour["(do a)"] = Behaviour(stop_s=1.5)
    office.want(job("a", 0.1))
    office.until(1)
    office.want(job("b", 0.9))
    office.until(2)
    assert office.deliberator.plan_executor.aborting
    office.until(20)
    assert office.begun() == [(0.0, "(do a)"), (2.5, "(do b)"), (8.5, "(do a)")]


def test_it_is_planned_for_again_as_things_are_when_the_other_has_stopped():
    office = office_for(job("a", 0.1, rollback_belief_add=(p("ready"),)), until=1, reschedule_policy="PREEMPT")
    office.want(job("b", 0.9, value=(p("ready"), p("lit"))))
    office.until(1.5)
    assert office.begun()[-1] == (1.0, "(light)"), "to prepare is not needed any more"
    assert office.until(3) == [("b", "fulfilled", "")]


def only_after_the_other(problem):
    """A planner for whom ``b`` can be done only when ``a`` is, which is so only if that is not interrupted."""
    wants_b, done = "(done b)" in str(problem.goal), Predicate("done", ("a",)) in problem.facts
    return PlannerAnswer(PlannerVerdict.GAVE_UP, message="no") if wants_b and not done else None


def test_running_steps_end_when_only_then_there_is_a_plan():
    office = Office(reschedule_policy="PREEMPT", comp_plan_tries=100)
    office.clerk.script = only_after_the_other
    office.want(job("a", 0.1))
    office.until(1)
    office.want(job("b", 0.9))
    office.until(30)
    assert office.begun() == [(0.0, "(do a)"), (6.0, "(do b)")]
    assert [end[:2] for end in office.ends] == [("a", "fulfilled"), ("b", "fulfilled")]


def test_a_fruitless_preemption_is_not_repeated_until_the_other_desire_ends():
    office = Office(reschedule_policy="PREEMPT", comp_plan_tries=100)
    asked = iter([True, False])
    office.clerk.script = lambda problem: (
        PlannerAnswer(PlannerVerdict.GAVE_UP) if "(done b)" in str(problem.goal) and not next(asked, True) else None
    )
    office.want(job("a", 0.1))
    office.until(1)
    office.want(job("b", 0.9))
    office.until(30)
    assert office.begun() == [(0.0, "(do a)"), (1.0, "(do a)"), (7.0, "(do b)")]


def test_a_fruitless_preemption_may_be_repeated_after_a_change_of_its_facts():
    office = Office(reschedule_policy="PREEMPT", comp_plan_tries=100)
    asked = iter([True, False])
    office.clerk.script = lambda problem: (
        PlannerAnswer(PlannerVerdict.GAVE_UP) if "(done b)" in str(problem.goal) and not next(asked, True) else None
    )
    office.want(job("a", 0.1))
    office.until(1)
    office.want(job("b", 0.9, precondition=dnf([("F", p("ready"))])))
    office.until(3)
    office.believe("ready")
    office.forget("ready")
    office.until(4)
    assert office.begun() == [(0.0, "(do a)"), (1.0, "(do a)"), (3.0, "(do b)")]


def test_a_failed_plan_is_not_repaired_while_a_higher_rank_is_planned_for():
    office = Office(reschedule_policy="PREEMPT", slow=True)
    office.behaviour["(do a)"] = Behaviour(lasts_s=1.0, fails="slipped")
    office.want(job("a", 0.1))
    office.answer()
    office.want(job("b", 0.9))
    office.until(2)
    assert len(office.pending) == 1
    office.answer()
    office.answer()
    assert office.pursued == "b"


STEPS = st.lists(
    st.tuples(
        st.sampled_from("abcd"),
        st.sampled_from(["want", "drop", "ready", "unready"]),
        st.sampled_from([0.2, 0.5, 0.8]),
        st.sampled_from([20.0, 40.0]),
        st.booleans(),
        st.sampled_from([0.0, 0.7, 3.1, 7.0]),
    ),
    max_size=14,
)


@settings(max_examples=60, deadline=None)
@given(STEPS)
def test_the_best_desire_is_pursued_and_aborts_have_a_reason(steps):
    office = Office(reschedule_policy="PREEMPT")
    needs, changes, now = dnf([("T", p("ready"))]), 0, 0.0
    for name, what, priority, deadline, needy, pause in steps:
        changes += 1
        if what == "want":
            office.forget(f"done {name}")
            more = {"precondition": needs} if needy else {}
            office.want(job(name, priority, deadline, **more))
        elif what == "drop":
            office.run(lambda name=name: office.deliberator.drop(name))
        elif what == "ready":
            office.believe("ready")
        else:
            office.forget("ready")
        now += pause
        office.until(now)
        check_best(office)
    office.believe("ready")
    office.until(now + 60)
    assert office.wants == []
    assert all(how == "fulfilled" or reason == "deleted" for _, how, reason in office.ends)
    aborts = [how for _, how in office.plans() if how != "succeeded"]
    assert len(aborts) <= changes + 1, "at most one for each change from outside"


def check_best(office: Office) -> None:
    """Check that no desire that may be pursued outranks the pursued one."""
    ready = any(fact.name == "ready" for fact in office.facts.facts())
    able = [state for state in office.deliberator.desires if ready or not state.desire.precondition.clauses]
    pursued = office.deliberator.pursuit.current
    if pursued is None:
        assert able == []
    else:
        assert not any(state.outranks(pursued) for state in able)
