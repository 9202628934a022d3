from __future__ import annotations

import time

import pytest
from msgspec.structs import replace

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.runs.history import History
from socialbot.runs.narration import Narrator, Wording
from tests.runs.deliberating_runs import DETOUR, PHRASES, desire, plan, plan_end, record, request, step, step_end


def story(*records: TraceRecord) -> list[str]:
    """The sentences of the story of ``records``, each with its agent."""
    narrator = Narrator(Wording(phrases=PHRASES))
    sentences = [(each.source, narrator.story(each)) for each in records]
    return [f"{agent} {sentence[1]}" for agent, sentence in sentences if sentence is not None]


def test_story_of_a_run():
    assert story(*DETOUR) == [
        "ann wants be_home within 20 s (desires.yaml)",
        "ann plans be_home: 2 steps, 5.0 s",
        "ann goes from hall to yard",
        "ann goes from yard to hall: failed: the door is locked",
        "ann gives up plan 1 for be_home",
        "ann makes a new plan for be_home: 1 step, 4.0 s",
        "ann asks bob to help",
        "ann asks bob for open_door",
        "bob wants open_door within 6 s (ann asks for it)",
        "bob plans open_door: 1 step, 4.0 s",
        "bob unlock bob door",
        "bob has reached open_door after 3.5 s",
        "ann has reached be_home after 7.0 s",
    ]


@pytest.mark.parametrize(
    ("each", "sentence"),
    [
        (record(0, "a", "desire_dropped", "x", reason="deleted"), "a drops x: deleted"),
        (record(0, "a", "desire_refused", "x", reason="no box"), "a does not take up x: no box"),
        (record(0, "a", "planning", "x", verdict="gave up", message="gave up"), "a finds no plan for x: gave up"),
        (plan_end(0, "a", "x", 3, "aborted", "too late"), "a aborts plan 3 for x: too late"),
        (step_end(0, "a", "(go a b c)", "cancelled", message="too late"), "a goes from b to c: cancelled: too late"),
        (request(0, "a", "a asks b to add belief (p c)", "1"), "a tells b to believe (p c)"),
        (request(0, "a", "a asks b to del belief (p c)", "1"), "a tells b to forget (p c)"),
        (request(0, "a", "a asks b to check desire x", "1"), "a asks b whether it wants x"),
        (record(0, "a", "reply", "b: refused", "1", reason="no rights"), "a is refused by b: no rights"),
        (record(0, "a", "reply", "b: timeout", "1", reason="-"), "a gets no answer from b"),
        (record(0, "b", "refused", "a asks b", "1", reason="no rights"), "b refuses: a asks b (no rights)"),
        (record(0, "a", "silent", "Boxes"), "a receives no more data from: Boxes"),
        (record(0, "a", "heard", "Boxes"), "a receives data again from: Boxes"),
        (record(0, "a", "failure", "rule", message="it broke"), "a fails at rule: it broke"),
        (record(0, "a", "failure", "go(b)", message="E: no", where="a.py:3"), "a fails at go(b): E: no (a.py:3)"),
    ],
)
def test_story_has_problems(each, sentence):
    assert story(each) == [sentence]


def test_story_omits_repetitions():
    quiet = [
        record(0, "a", "belief", "p(c)"),
        record(0, "a", "planning", "x", verdict="solved", message=""),
        plan_end(0, "a", "x", 1, "succeeded"),
        step_end(0, "a", "(go a b c)"),
        record(0, "a", "reply", "b: done", "1", reason=""),
    ]
    assert story(*quiet) == []


def test_desire_has_its_reason():
    rule = record(0, "a", "rule", "tired", id="a-7", effect="ADD desire rest")
    whole = desire(0, "a", "sort", "a-7")
    part = desire(0, "a", "sort_first", whole.id)
    assert story(rule, whole, part) == [
        "a wants sort within 20 s (its rule tired)",
        "a wants sort_first within 20 s (to prepare sort)",
    ]


def test_plan_after_a_successful_plan_is_not_new():
    again = (plan(0, "a", "x", 1), plan_end(1, "a", "x", 1, "succeeded"), plan(2, "a", "x", 2))
    assert story(*again)[-1] == "a plans x: 0 steps, 5.0 s"


def test_action_without_phrase_is_shown_as_in_the_plan():
    assert story(step(0, "a", "(fly a moon)")) == ["a fly a moon"]


def part(seconds: float, name: str, whole: TraceRecord) -> TraceRecord:
    return desire(seconds, "a", name, whole.id)


def test_dropping_a_needless_desire_is_no_failure():
    whole = desire(0, "a", "clean")
    one, other = part(0, "go_one", whole), part(0, "go_other", whole)
    below = part(0, "charge", other)
    reached = record(1, "a", "desire_fulfilled", "go_one", one.id, reason="")
    needless = record(1, "a", "desire_dropped", "go_other", reached.id, reason="go_one is fulfilled")
    deeper = record(1, "a", "desire_dropped", "charge", reached.id, reason="go_other has ended")
    narrator = Narrator(Wording())
    assert [narrator.story(each) for each in (whole, one, other, below, reached, needless, deeper)][-2:] == [
        ("rests", "no longer needs go_other: go_one is fulfilled"),
        ("rests", "no longer needs charge: go_other has ended"),
    ]


def test_dropping_a_desire_that_cannot_be_prepared_is_a_failure():
    whole = desire(0, "a", "clean")
    first = part(0, "go_one", whole)
    second = part(0, "charge", first)
    tried = record(1, "a", "desire_dropped", "charge", second.id, reason="no plan")
    parent = record(1, "a", "desire_dropped", "go_one", tried.id, reason="cannot be prepared: no plan")
    assert story(whole, first, second, tried, parent)[-2:] == [
        "a drops charge: no plan",
        "a drops go_one: cannot be prepared: no plan",
    ]
    deleted = record(1, "a", "desire_dropped", "clean", whole.id, reason="deleted")
    child = record(1, "a", "desire_dropped", "go_one", deleted.id, reason="clean has ended")
    grandchild = record(1, "a", "desire_dropped", "charge", deleted.id, reason="go_one has ended")
    assert story(whole, first, second, deleted, child, grandchild)[-3:] == [
        "a drops clean: deleted",
        "a no longer needs go_one: clean has ended",
        "a no longer needs charge: go_one has ended",
    ]


def no_plan(seconds: float, name: str, message: str) -> TraceRecord:
    return record(seconds, "a", "planning", name, verdict="gave up", message=message)


def test_missing_plan_is_reported_once_per_reason():
    tries = [no_plan(second, "x", "too hard") for second in range(4)]
    assert story(*tries, no_plan(5, "y", "too hard"), no_plan(6, "x", "no time"), no_plan(7, "x", "no time")) == [
        "a finds no plan for x: too hard",
        "a finds no plan for y: too hard",
        "a finds no plan for x: no time",
    ]
    assert len(story(tries[0], plan(1, "a", "x", 1), tries[2])) == 3


def test_proofs_of_a_planner_are_replaced():
    proof = "kairos: note: no plan: not even without durations: 48 states of that relaxation searched"
    dropped = record(0, "a", "desire_dropped", "x", reason=f"no plan after 8 tries: {proof}")
    assert story(no_plan(0, "x", proof), dropped) == [
        "a finds no plan for x: no sequence of actions leads there",
        "a drops x: no plan after 8 tries: no sequence of actions leads there",
    ]


def test_plan_that_is_too_long_is_reported():
    late = record(0, "a", "planning", "x", verdict="solved", message="the plan lasts 9 s", steps=3)
    assert story(late) == ["a finds no plan for x: the plan lasts 9 s"]


def test_published_desire_has_its_topic():
    assert story(desire(0, "a", "x", "add_desire")) == ["a wants x within 20 s (published on add_desire)"]


@pytest.mark.parametrize(
    ("weight", "sentences"),
    [("problem", ["a reports smoke"]), ("word", ["a reports smoke"]), ("plan", []), ("", [])],
)
def test_story_has_messages_that_no_other_record_repeats(weight, sentences):
    assert story(record(0, "a", "said", "reports smoke", weight=weight)) == sentences


def test_plan_without_times_and_desire_without_deadline():
    wanted = record(0, "a", "desire", "x", "somebody", priority=1)
    made = record(0, "a", "plan_start", "x", plan=1, steps=["0: (go)"], makespan_s=None)
    assert story(wanted, made) == ["a wants x (somebody)", "a plans x: 1 step"]


def test_failed_action_is_reported_once():
    end = step_end(0, "a", "(go a b c)", "failed", message="no way")
    assert story(end, record(0, "a", "failure", "go(a, b, c)", reason="action_failed", message="no way")) == [
        "a goes from b to c: failed: no way"
    ]


def test_action_without_enough_objects_keeps_its_call():
    assert Wording(phrases=PHRASES).call("go", ["a"]) == "go a"


def _time_to_tell(count: int, *, is_recorded: bool) -> float:
    """Least processor time (s) for the sentences of ``count`` steps of one plan, whose start may not be recorded."""
    begin = TraceRecord(stamp=0, id="plan", source="planner", kind="plan_start", what="d", detail={"plan": 1})
    detail = {"directed_by": "planner", "plan": 1}
    one = TraceRecord(stamp=0, id="", source="robot", kind="step", what="(wait robot)", detail=detail)
    steps = [replace(one, stamp=number * SECOND, id=f"step-{number}") for number in range(1, count + 1)]
    history = History([begin, *steps] if is_recorded else steps, start=0)
    narrator, times = Narrator(Wording(), history), []
    for _ in range(3):
        before = time.process_time()
        for each in steps:
            narrator.clause(each)
        times.append(time.process_time() - before)
    return min(times)


@pytest.mark.parametrize("is_recorded", [True, False])
def test_the_time_for_the_sentence_of_a_step_does_not_grow_with_the_run(is_recorded):
    short, long = (_time_to_tell(count, is_recorded=is_recorded) for count in (250, 2000))
    assert long < 8 * 3 * short, "eight times as many steps"
