"""Expectations on small traces: each kind passes, fails at the right moment, and stays open at the end of a run."""

from __future__ import annotations

import random
import re

import pytest

from socialbot.bdi import Belief, variables
from socialbot.core.errors import RuleError
from socialbot.runs.expectations import _time_sets, evaluate, load_behaviours
from socialbot.runs.expectations.reporting import Checked, notes
from socialbot.runs.folder import open_run
from socialbot.testing import (
    always,
    anyone,
    at_all_times,
    believed,
    count,
    did,
    doing,
    ended,
    expect,
    finished,
    in_order,
    never,
    once_per,
    person,
    said,
    told,
    wanting,
)
from tests.runs.asking.written_runs import write_run
from tests.runs.expectations.traces import check, frame, record, says


class greeted(Belief):  # noqa: N801 - read as in rules
    """This person has been greeted."""


def results(verdict):
    return [(each.outcome, each.text, each.at_s) for each in verdict.instances]


VISIT = [frame(1.0, t1=8.0), frame(2.0, t1=5.9), frame(2.4, t1=5.0)]


def test_a_response_in_time_passes_and_a_late_one_fails_at_its_trigger():
    greets = expect(said("hello")).within(2).after(person(nearer_than=6))
    assert results(check(greets, VISIT, says(4.0, "hello"))) == [("passed", "person t1", 2.0)]
    late = check(greets, VISIT, says(4.1, "hello"))
    assert (late.passed, late.instance, late.time) == (False, "person t1", 2.0)
    assert late.failures[0].came == 4_100_000_000
    assert late.failures[0].record is not None
    assert late.failures[0].record.kind == "detection"


def test_a_response_that_is_still_due_at_the_end_is_open():
    greets = expect(said("hello")).within(2).after(person(nearer_than=6))
    assert check(greets, VISIT, end_s=3.9).outcome == "open"
    assert check(greets, VISIT, end_s=3.9).passed
    assert check(greets, VISIT, end_s=4.0).outcome == "failed"


def test_without_any_trigger_nothing_is_tested():
    assert check(expect(said("hello")).within(2).after(person(nearer_than=6)), frame(1.0, t1=8.0)).outcome == "untested"


def test_a_window_may_have_a_least_time():
    offers = expect(said("offer")).within((2, 4)).after(said("hello"))
    assert check(offers, says(1.0, "hello"), says(3.0, "offer")).passed
    assert not check(offers, says(1.0, "hello"), says(2.9, "offer")).passed


def test_persons_who_flicker_are_one_state_and_each_person_is_an_instance():
    greets = expect(said("hello")).within(2).after(person(nearer_than=6, gap_s=0.5))
    flicker = [frame(2.9), frame(3.1, t1=5.0), frame(7.0, t1=4.0), frame(7.1, t2=3.0)]
    assert results(check(greets, VISIT, *flicker, says(3.0, "hello"))) == [
        ("passed", "person t1", 2.0),
        ("failed", "person t1", 3.1),
        ("failed", "person t1", 7.0),
        ("failed", "person t2", 7.1),
    ]


def test_what_is_said_to_a_person_is_found_by_its_reasons():
    to_each = expect(said("hello", to=person)).within(2).after(person(nearer_than=6))
    both = [frame(2.0, t1=5.0, t2=5.0)]
    assert results(check(to_each, both, says(3.0, "hello", "t2"))) == [
        ("failed", "person t1", 2.0),
        ("passed", "person t2", 2.0),
    ]
    assert check(expect(said("hello", to="t2")).in_total(), says(3.0, "hello", "t2")).passed
    assert not check(expect(said("hello", to="t1")).in_total(), says(3.0, "hello", "t2")).passed


def test_once_per_person_fails_at_the_second_time():
    once = once_per(person, said("hello", to=person))
    seen = frame(0.0, t1=3.0, t2=3.0)
    assert check(once, seen, says(1.0, "hello", "t1"), says(2.0, "hello", "t2")).passed
    twice = check(once, seen, says(1.0, "hello", "t1"), says(2.0, "hello", "t2"), says(3.0, "hello", "t2"))
    assert (twice.instance, twice.time) == ("person t2", 3.0)
    same_moment = check(once, seen, says(1.0, "hello", "t1"), says(1.0, "hello", "t1"))
    assert not same_moment.passed


def test_never_while_a_belief_is_held():
    quiet = never(said("*")).while_(believed('personDetected("No")'))
    alone = [record(1.0, "belief", 'personDetected("No")'), record(5.0, "unbelief", 'personDetected("No")')]
    assert check(quiet, alone, says(0.5, "hello"), says(5.0, "hello")).passed
    assert results(check(quiet, alone, says(4.9, "hello")))[0] == ("failed", "", 4.9)
    assert check(quiet, says(4.9, "hello")).outcome == "untested"


def test_a_belief_that_another_source_holds_goes_on():
    state = never(said("*")).while_(believed("busy()"))
    records = [record(1.0, "belief", "busy()"), record(2.0, "unbelief", "busy()", left="self")]
    assert not check(state, records, says(3.0, "hello")).passed
    assert check(state, [*records, record(2.5, "unbelief", "busy()")], says(3.0, "hello")).passed


def test_never_after_does_not_count_the_event_itself():
    rare = never(said("hello")).within(5).after(said("hello"))
    assert check(rare, says(1.0, "hello"), says(6.1, "hello")).passed
    again = check(rare, says(1.0, "hello"), says(5.9, "hello"))
    assert (again.passed, again.time) == (False, 5.9)


def test_before_needs_the_event_earlier():
    rule = expect(said("hello")).within(3).before(said("offer"))
    assert check(rule, says(1.0, "hello"), says(4.0, "offer")).passed
    assert check(rule, says(1.0, "hello"), says(4.1, "offer")).time == 4.1
    assert check(never(said("offer")).before(said("hello")), says(1.0, "offer"), says(2.0, "hello")).time == 2.0


def test_variables_of_beliefs_are_bound():
    (Who,) = variables("Who")  # noqa: N806
    rule = expect(said("hello", to=Who)).within(1).after(believed(greeted(Who)))
    found = check(
        rule, record(1.0, "belief", 'greeted("a")'), record(2.0, "belief", 'greeted("b")'), says(1.5, "hello", "a")
    )
    assert results(found) == [("passed", "Who a", 1.0), ("failed", "Who b", 2.0)]
    assert found.name == str(rule)


def test_until_and_always():
    waiting = expect(believed("idle()")).until(said("hello"))
    idle = record(0.0, "belief", "idle()")
    assert check(waiting, idle, says(3.0, "hello")).passed
    broken = check(waiting, idle, record(2.0, "unbelief", "idle()"), says(3.0, "hello"))
    assert (broken.passed, broken.time) == (False, 2.0)
    assert not check(waiting, idle).passed
    steady = at_all_times(believed("idle()")).within(2).after(said("hello"))
    assert check(steady, idle, record(5.0, "unbelief", "idle()"), says(2.9, "hello")).passed
    assert not check(steady, idle, record(5.0, "unbelief", "idle()"), says(3.1, "hello")).passed


def test_counts():
    three = [says(1.0, "beep"), says(2.0, "beep"), says(9.0, "beep")]
    assert check(expect(said("beep")).exactly(3).in_total(), *three).passed
    assert check(expect(said("beep")).at_most(2).in_total(), *three).time == 9.0
    assert check(expect(said("beep")).at_least(2).within(1).after(said("beep")), *three).time == 2.0
    assert check(expect(said("beep")).at_most(2).within(8).after(said("beep")), *three).time == 1.0
    twice = expect(said("beep")).at_least(2).within(5).after(said("beep"))
    assert [check(twice, says(1.0, "beep"), end_s=end_s).outcome for end_s in (5.9, 6.0)] == ["open", "failed"]
    busy = [record(0.5, "belief", "busy()"), record(3.0, "unbelief", "busy()")]
    assert check(expect(said("beep")).exactly(2).while_(believed("busy()")), *three, busy).passed
    assert not check(expect(said("beep")).at_most(1).while_(believed("busy()")), *three, busy).passed
    assert not check(expect(said("beep")).at_least(3).while_(believed("busy()")), *three, busy).passed


def test_durations():
    busy = [record(1.0, "belief", "busy()"), record(3.0, "unbelief", "busy()")]
    state = believed("busy()")
    assert check(expect(state).lasting(at_least=2, at_most=2), busy).passed
    assert not check(expect(state).lasting(at_least=2.1), busy).passed
    assert not check(expect(state).lasting(at_most=1.9), busy).passed
    assert check(expect(state).lasting(at_most=5), busy[:1], end_s=3.0).outcome == "open"


def test_order_across_agents():
    order = in_order(did("lift(_)", by="gripper_a"), did("move(_, base)", by="carrier_a"))
    lift, move = record(1.0, "action", "lift(box)", "gripper_a"), record(2.0, "step", "(move c base)", "carrier_a")
    assert check(order, lift, move).passed
    assert not check(order, move, record(3.0, "action", "lift(box)", "gripper_a")).passed
    assert not check(order, record(1.0, "action", "lift(box)", "gripper_b"), move).passed


def test_actions_and_goals_are_states_until_they_end():
    begin = record(1.0, "step", "(move c base)", "carrier_a", id="s1")
    end = record(3.0, "step_end", "(move c base)", "carrier_a", cause="s1", outcome="failed")
    moving = never(said("*")).while_(doing("move(_, base)"))
    assert not check(moving, begin, end, says(2.9, "hello")).passed
    assert check(moving, begin, end, says(3.0, "hello")).passed
    assert check(expect(finished("move(_, _)", "failed")).in_total(), begin, end).passed
    goal, done = record(1.0, "goal", "greet()", id="g1"), record(2.0, "achieved", "greet()", cause="g1")
    pursued = never(said("*")).while_(wanting("greet()"))
    assert check(pursued, goal, done, says(2.0, "hello")).passed
    assert not check(pursued, goal, says(2.0, "hello")).passed


def test_messages_between_agents():
    sent = record(1.0, "said", "registers", "nurse", receiver="coordinator")
    assert check(expect(told("registers", to="coordinator", by="nurse")).in_total(), sent).passed
    assert not check(expect(told("registers", to="robot")).in_total(), sent).passed


def test_formulas_combine_and_are_expectations_themselves():
    quiet = always(~(said("*") & anyone(nearer_than=1)))
    from socialbot.runs.expectations.expectations import as_expectation

    expectation = as_expectation(quiet, "quiet")
    assert expectation is not None
    assert check(expectation, frame(1.0, t1=0.5), says(1.0, "hello")).time == 1.0
    leaves = expect(said("bye")).within(1).after(ended(anyone()))
    assert check(leaves, frame(1.0, t1=3.0), says(1.5, "bye")).passed
    assert str(count(said("a")) <= 1) == "# said('a') in 0..1"


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: expect("hello"), "is no formula"),  # type: ignore[arg-type]
        (lambda: expect(count(said("a"))), "compare the count"),  # type: ignore[arg-type]
        (lambda: said("a") and said("b"), "combine with &"),
        (lambda: expect(said("a")).within(-1), "no time window"),
        (lambda: expect(said("a")).within(2).while_(anyone()), "within() has no meaning"),
        (lambda: expect(said("a")).once_per(person), "does not depend on person"),
        (lambda: believed(3), "no belief, goal or action"),
        (lambda: believed("open(a"), "lacks a closing bracket"),
        (lambda: in_order(said("a")), "two events"),
        (lambda: never(said("a")).in_total(), "in_total() has no meaning after never()"),
        (lambda: never(said("a")).at_least(2), "at_least() has no meaning after never()"),
        (lambda: at_all_times(said("a")).at_most(2), "at_most() has no meaning after at_all_times()"),
        (lambda: never(said("a")).exactly(2), "exactly() has no meaning after never()"),
        (lambda: never(said("a", to=person)).once_per(person), "once_per() has no meaning after never()"),
        (lambda: never(anyone()).lasting(at_least=1), "lasting() has no meaning after never()"),
        (lambda: expect(anyone()).at_least(2).lasting(at_least=1), "counts have no meaning with lasting()"),
        (lambda: expect(said("a", to=person)).at_least(2).once_per(person), "counts have no meaning with once_per()"),
        (lambda: never(said("a")).within(5).throughout(), "within() has no meaning with throughout()"),
        (lambda: expect(anyone()).at_least(2).throughout(), "counts have no meaning with throughout()"),
    ],
)
def test_mistakes_are_refused_with_a_remedy(make, text):
    with pytest.raises(RuleError) as error:
        make()
    assert text in str(error.value)
    assert error.value.remedy


def test_counted_moments_agree_with_counting():
    for number in range(300):
        rng = random.Random(f"count {number}")
        last = rng.randrange(1, 30)
        moments = sorted(rng.randrange(last + 1) for _ in range(rng.randrange(8)))
        least, low = rng.randrange(4), rng.randrange(4)
        most = None if rng.random() < 0.3 else least + rng.randrange(10)
        high = None if rng.random() < 0.4 else low + rng.randrange(3)
        found = _time_sets.counted(moments, least, most, low, high, last)
        for at in range(last + 1):
            there = sum(at + least <= each and (most is None or each <= at + most) for each in moments)
            assert (at in found) == (there >= low and (high is None or there <= high)), (number, at)


@pytest.mark.parametrize(
    ("code", "what", "remedy"),
    [
        ("expect(said('x'), 3)", r"wrong\.py: cannot be run: TypeError: .* \(wrong\.py:3\)", "correct the Python code"),
        ("expect(said('x')).within('1')", r"wrong\.py:3: within='1' is no time window", "give seconds"),
        ("expect(said('x')).within(5, 2)", r"wrong\.py: .*takes 2 positional arguments", "correct the Python code"),
        ("expect(said('x')).within((1, 2, 3))", r"wrong\.py:3: within=\(1, 2, 3\) is no time window", "give seconds"),
        ("expect(said('x') and said('y'))", r"wrong\.py:3: said\('x'\): a formula is neither", "combine with &"),
        ("expect(said(5)).in_total()", r"wrong\.py:3: said\(\): what=5 is no text", "quotation marks"),
        ("expect(said('x', by=5)).in_total()", r"wrong\.py:3: said\(\): by=5 is no text", "quotation marks"),
        ("expect(said('x')).at_least('two').in_total()", r"at_least\(\): 'two' is no number", r"at_least\(2\)"),
        ("expect(said('x')).exactly(-1).in_total()", r"exactly\(\): -1 is no number", r"exactly\(2\)"),
        ("expect(person(nearer_than='5'))", r"wrong\.py:3: person\(\): nearer_than='5' is no number", "give metres"),
        ("expect(person(posture='sitting'))", r"wrong\.py:3: person\(\): posture='sitting'", "known: seated, standing"),
        ("expect(person(closer_than=5))", "unexpected keyword argument 'closer_than'", "did you mean 'nearer_than'"),
        ("expect(said('x', too=person))", "unexpected keyword argument 'too'", "did you mean 'to'"),
        ("expect(sayed('x'))", "name 'sayed' is not defined", "did you mean 'said'"),
        ("expect(believed('x'))", "name 'believed' is not defined", "from socialbot.testing import believed"),
        ("expect(said('x')).afer(person())", "no attribute 'afer'", "did you mean 'after'"),
        ("None; from socialbot.testing import nevr", "cannot import name 'nevr'", "did you mean 'never'"),
        ("None; from socialbot.agents.waldo import greeted", "cannot import name 'greeted'", r"can also be a text"),
        ("(1", "SyntaxError", "correct the Python code"),
    ],
)
def test_a_mistake_in_a_file_of_expectations_names_its_line_and_a_remedy(tmp_path, code, what, remedy):
    path = tmp_path / "wrong.py"
    path.write_text(f"from socialbot.testing import expect, person, said\n\nsoon = {code}\n")
    with pytest.raises(RuleError, match=what) as error:
        load_behaviours(path)
    assert re.search(remedy, error.value.remedy or ""), error.value.remedy


def test_misspelled_names_are_noted_whatever_the_verdict(tmp_path):
    trace = [record(2.0, "belief", 'greeted("t1")'), record(2.0, "action", "stayIdle()"), *says(3.0, "hello")]
    folder = write_run(tmp_path / "run", trace)
    misspelled = {
        "never": (never(did("stayidle")), "passed", "stayIdle"),
        "after": (expect(said("*")).within(2).after(believed("greated(Who)")), "untested", "greeted"),
        "said": (expect(said("Hallo*")).in_total(), "failed", "Hello!"),
    }
    right = [never(did("fly")), expect(said("Hel*")).in_total(), never(said("Bye")), never(did("stay*"))]
    expectations = [*(one for one, _, _ in misspelled.values()), *right]
    run = open_run(folder)
    verdicts = evaluate(expectations, run)
    checked = Checked("run", run, None, verdicts)
    found = [(each.outcome, list(notes(checked, each))) for each in verdicts]
    for (outcome, noted), (_, wanted, meant) in zip(found, misspelled.values(), strict=False):
        assert outcome == wanted
        assert [f"did you mean {meant!r}?" in each for each in noted] == [True]
    assert [noted for _, noted in found[len(misspelled) :]] == [[]] * len(right)


def test_clauses_in_python_are_completed_as_in_a_file(tmp_path):
    folder = write_run(tmp_path / "run", says(3.0, "hello"))
    verdicts = evaluate([never(said("bye")), expect(said("hello"))], folder)
    assert [each.outcome for each in verdicts] == ["passed", "passed"]
    with pytest.raises(RuleError, match="expectation 1: 5 is no expectation"):
        evaluate([5], folder)  # type: ignore[list-item]
