"""Desires that prepare others, for unmet preconditions and contexts."""

from __future__ import annotations

from socialbot.planning.planners.planner import PlannerAnswer, PlannerVerdict
from tests.deliberation.domains import dnf, i, n, p
from tests.deliberation.office import Office, job, office_for

READY_OR_QUIET = dnf([("T", p("ready"))], [("T", p("quiet")), ("T", p("lit"))])


def refuse(*names: str):
    def script(problem):
        if any(f"({name})" in str(problem.goal) for name in names):
            return PlannerAnswer(PlannerVerdict.IMPOSSIBLE)
        return None

    return script


def test_without_autosub_no_desire_is_added():
    office = office_for(job("a", precondition=READY_OR_QUIET))
    assert office.wants == ["a"]


def test_preparations_have_a_slightly_higher_priority():
    office = office_for(job("a", 0.5, 33.0, precondition=READY_OR_QUIET), autosub_prec=True, slow=True)
    first, second, parent = (state.desire for state in office.deliberator.desires)
    assert (first.name, second.name) == ("a_fulfill_precondition0", "a_fulfill_precondition1")
    assert (first.parent, first.priority, first.deadline) == ("a", 0.5 + 0.01, 33.0)
    assert [str(check.condition_to_check) for check in second.wanted] == ["(quiet)", "(lit)"]
    assert office.found("desire", first.name)[0].cause == office.found("desire", parent.name)[0].id


def test_an_unachievable_preparation_is_recorded_once():
    office = office_for(job("a", precondition=dnf([("F", p("done", "*"))])), job("b", 0.1), autosub_prec=True)
    office.believe("done c")
    office.forget("done c")
    assert office.found("desire_refused") == [], "it holds"
    office = Office(autosub_prec=True, beliefs="instance c job; done c")
    office.want(job("a", precondition=dnf([("F", p("done", "*"))])))
    office.believe("done d", "ready", "done b")
    (refused,) = office.found("desire_refused")
    assert refused.what == "a_fulfill_precondition"
    assert "no plan can bring it about" in refused.detail["reason"]
    assert refused.cause == office.found("desire", "a")[0].id


def test_when_one_is_fulfilled_the_others_go_and_the_desire_has_its_turn():
    office = office_for(job("a", precondition=READY_OR_QUIET), autosub_prec=True)
    assert office.pursued == "a_fulfill_precondition0"
    office.until(20)
    ended = [(record.what, record.kind, record.detail["reason"]) for record in office.trace if "desire_" in record.kind]
    assert ended == [
        ("a_fulfill_precondition0", "desire_fulfilled", ""),
        ("a_fulfill_precondition1", "desire_dropped", "a_fulfill_precondition0 is fulfilled"),
        ("a", "desire_fulfilled", ""),
    ]
    assert office.begun() == [(0.0, "(prepare)"), (2.0, "(do a)")]


def test_the_others_go_without_their_desire_though_its_context_does_not_hold_yet():
    office = Office(autosub_prec=True)
    office.want(job("a", precondition=READY_OR_QUIET, context=dnf([("T", p("told"))])))
    office.until(10)
    assert office.wants == ["a"]
    office.believe("told")
    assert office.until(20) == [("a", "fulfilled", "")]


def test_when_one_cannot_be_the_other_is_tried():
    office = Office(autosub_prec=True, comp_plan_tries=2)
    office.clerk.script = refuse("ready")
    office.want(job("a", precondition=READY_OR_QUIET))
    assert office.until(30) == [("a", "fulfilled", "")]
    assert [call for _, call in office.begun()] == ["(hush)", "(light)", "(do a)"]


def test_when_all_are_dropped_so_is_their_desire():
    office = Office(autosub_prec=True, comp_plan_tries=2)
    office.clerk.script = refuse("ready", "quiet")
    office.want(job("a", precondition=READY_OR_QUIET), job("b", 0.1))
    office.until(30)
    (dropped,) = [end for end in office.ends if end[0] == "a"]
    assert dropped == ("a", "dropped", "cannot be prepared: no plan after 2 tries: impossible")
    assert ("b", "fulfilled", "") in office.ends
    assert office.wants == []


def test_when_the_desire_ends_so_do_those_that_prepare_it_and_their_own():
    office = Office(autosub_prec=True)
    office.want(job("a", precondition=READY_OR_QUIET), job("deep", parent="a_fulfill_precondition1"))
    office.until(1)
    office.run(lambda: office.deliberator.drop("a"))
    assert office.wants == []
    reasons = {record.what: record.detail["reason"] for record in office.found("desire_dropped")}
    assert reasons["a_fulfill_precondition0"] == "a has ended"
    assert reasons["deep"] == "a_fulfill_precondition1 has ended"
    assert office.plans() == [("a_fulfill_precondition0", "aborted")]


def test_desires_that_are_their_own_parents_end_like_others():
    office = office_for(job("a", parent="b", precondition=dnf([("T", p("ready"))])))
    office.want(job("b", parent="a", precondition=dnf([("T", p("ready"))])), job("c", parent="c"))
    office.run(lambda: office.deliberator.drop("a"))
    office.run(lambda: office.deliberator.drop("c"))
    assert office.wants == []


def test_a_context_is_prepared_unless_unachievable():
    office = Office(autosub_context=True)
    context = dnf([("T", p("lit"))], [("EX", i("z", "job"))], [("F", p("done", "*"))], [("T", p("begun", "{x}"))])
    office.believe("done d")
    office.want(job("a", context=context))
    assert office.wants == ["a_fulfill_context0", "a"]
    office.until(20)
    assert office.begun() == [(0.0, "(light)"), (1.0, "(do a)")]


def test_a_context_that_ends_is_restored_and_the_desire_taken_up_again():
    office = Office(autosub_context=True)
    office.believe("quiet")
    office.want(job("a", context=dnf([("T", p("quiet"))])))
    office.until(2)
    office.forget("quiet")
    office.until(20)
    assert office.begun() == [(0.0, "(do a)"), (2.0, "(hush)"), (3.0, "(do a)")]
    assert office.ends == [("a", "fulfilled", "")]


def test_preparations_with_numbers_are_desired_as_they_are():
    office = Office(autosub_prec=True, slow=True)
    office.want(job("a", precondition=dnf([("GR", n("level", "a", value=2.0)), ("F", p("lit"))])))
    assert office.clerk.asked == []
    office.answer()
    assert office.clerk.asked == ["(and (> (level a) 2) (not (lit)))"]


def test_a_precondition_that_is_lost_again_is_prepared_again():
    office = office_for(job("b", 0.9), job("a", precondition=dnf([("T", p("ready"))])), autosub_prec=True)
    office.believe("ready")
    assert office.wants == ["b", "a"]
    office.forget("ready")
    assert "a_fulfill_precondition0" in office.wants
    assert office.until(30) == [("b", "fulfilled", ""), ("a", "fulfilled", "")]
