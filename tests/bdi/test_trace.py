from __future__ import annotations

from hypothesis import given, settings

from socialbot.bdi import Engine, fail
from socialbot.bdi.literals import Literal
from socialbot.bdi.trace import KINDS
from socialbot.core.clock import SECOND, ManualClock
from tests.bdi.lab import Lab, X, Y, do, go, mood, p, ping, q, sub
from tests.bdi.programs import PROGRAMS, STIMULI


def traced(program, stimuli) -> Lab:
    """A lab after a random program with random stimuli, each of which has an id."""
    lab = Lab(*program)
    for number, (what, value) in enumerate(stimuli):
        if isinstance(value, Literal):
            getattr(lab.engine, what)(value, cause=f"given-{number}")
        else:
            lab.clock.advance(value)
            lab.engine.run_until_idle(budget=20)
    lab.engine.run_until_idle(budget=40)
    return lab


@settings(deadline=None, max_examples=100)
@given(PROGRAMS, STIMULI)
def test_everything_on_the_trace_has_its_cause_before_it(program, stimuli):
    lab = traced(program, stimuli)
    known: set[str] = set()
    before = 0
    for record in lab.trace:
        assert record.cause in known or record.cause.startswith("given-")
        assert record.id not in known
        assert record.kind in KINDS
        assert record.time >= before
        known.add(record.id)
        before = record.time


@settings(deadline=None, max_examples=30)
@given(PROGRAMS, STIMULI)
def test_two_runs_leave_the_same_trace(program, stimuli):
    assert repr(traced(program, stimuli).trace) == repr(traced(program, stimuli).trace)


def chain(lab: Lab, kind: str) -> list[str]:
    """The kinds and contents from the first record of ``kind`` back to what was given."""
    by_id = {record.id: record for record in lab.trace}
    record = next(record for record in lab.trace if record.kind == kind)
    steps = [f"{record.kind} {record.what}"]
    while record.cause in by_id:
        record = by_id[record.cause]
        steps.append(f"{record.kind} {record.what}")
    return [*steps, record.cause]


def test_cause_of_an_action_is_the_percept():
    lab = Lab(+p(X) / (X > 0) >> [go(X)], go(X) >> [sub()], sub() >> [do("x")])
    lab.engine.believe(p(1), cause="frame-9")
    lab.engine.run_until_idle()
    assert chain(lab, "action") == [
        'action do("x")', "plan sub()", "goal sub()", "plan go(X)", "goal go(1)",
        "plan +p(X)", "belief p(1)", "frame-9",
    ]  # fmt: skip


def test_a_plan_names_its_rule_and_those_that_did_not_apply():
    lab = Lab(+p(1) >> [], +p(X) / q(X) >> [], +p(X) >> [do(X)])
    lab.tell(+p(2))
    (plan,) = [record for record in lab.trace if record.kind == "plan"]
    where = str(plan.detail.pop("where"))
    assert where.startswith("tests/bdi/test_trace.py:")
    assert plan.detail == {
        "rule": "+p(X) >> [do(X)]",
        "rejected": [{"plan": "+p(X) / (q(X)) >> []", "because": "q(2) does not hold"}],
    }


def test_a_failure_plan_is_led_back_to_the_failure_and_the_goal():
    lab = Lab(go() >> [fail("why")], -go() >> [do("x")])
    lab.engine.achieve(go(), cause="caller")
    lab.engine.run_until_idle()
    assert [step.split()[0] for step in chain(lab, "failure")] in (
        ["failure", "plan", "goal", "caller"],
        ["failure", "action", "plan", "goal", "caller"],
    )
    by_id = {record.id: record for record in lab.trace}
    plan = [record for record in lab.trace if record.kind == "plan"][-1]
    assert plan.what == "-go()"
    assert by_id[plan.cause].kind == "failure"


def test_cause_of_a_held_for_event_is_the_belief():
    lab = Lab(+mood(X).held_for(2) >> [do(X)])
    lab.engine.believe(mood("glad"), cause="frame-1")
    lab.engine.run_until_idle()
    lab.until(3)
    assert chain(lab, "action")[-3:] == ['held mood("glad")', 'belief mood("glad")', "frame-1"]
    (held,) = [record for record in lab.trace if record.kind == "held"]
    assert held.time == 2 * SECOND
    assert held.detail == {"seconds": 2}


def test_each_change_of_mind_is_on_the_trace():
    lab = Lab(+p(X) >> [+q(X), -p(X), +ping(X)], go() >> [], start=5)
    lab.tell(+p(1), go())
    assert [f"{record.kind} {record.what}" for record in lab.trace] == [
        "belief p(1)", "plan +p(X)", "belief q(1)", "goal go()", "plan go()", "achieved go()",
        "unbelief p(1)", "event ping(1)",
    ]  # fmt: skip
    assert {record.time for record in lab.trace} == {5 * SECOND}
    sources = [record.detail.get("source") for record in lab.trace if record.kind == "belief"]
    assert sources == ["self", "self"]


def test_the_end_of_a_belief_has_the_cause_of_its_end():
    lab = Lab()
    lab.engine.believe(mood("sad"), cause="frame-1")
    lab.engine.believe(mood("glad"), cause="frame-2")
    lab.engine.forget(mood("glad"), cause="frame-3")
    lab.engine.run_until_idle()
    assert [(record.what, record.cause) for record in lab.trace if record.kind == "unbelief"] == [
        ('mood("sad")', "frame-2"), ('mood("glad")', "frame-3"),
    ]  # fmt: skip


def test_the_ids_carry_the_name_of_the_agent():
    lab = Lab(name="waldo")
    lab.tell(+p(1), +p(2))
    assert [record.id for record in lab.trace] == ["waldo-1", "waldo-2"]


def test_an_engine_without_a_sink_works_as_well():
    lab = Lab()
    engine = Engine("quiet", ManualClock(), robot=lab)
    engine.add_rules(+p(X) / q(Y) >> [do(X, Y)])
    for belief in (q(2), p(1)):
        engine.believe(belief)
    engine.run_until_idle()
    assert lab.done == [(1, 2)]
