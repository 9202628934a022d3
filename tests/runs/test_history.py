from __future__ import annotations

import string

from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.runs.history import History
from tests.runs.deliberating_runs import record, request

IDS = st.sampled_from(string.ascii_lowercase[:6])
KINDS = st.sampled_from(("belief", "goal", "plan", "action", "step", "said", "plan_start", "plan_end", "detection"))
DETAILS = st.fixed_dictionaries(
    {}, optional={"mission": IDS, "label": IDS, "receiver": st.just("ann"), "plan": st.just(1)}
)
RECORDS = st.lists(
    st.builds(
        TraceRecord,
        stamp=st.integers(0, 5).map(lambda tenth: tenth * SECOND // 10),
        id=IDS,
        source=st.sampled_from(("ann", "bob")),
        kind=KINDS,
        what=st.sampled_from(("go(a)", "(go a)", "home")),
        cause=st.one_of(st.just(""), IDS),
        detail=DETAILS,
    ),
    max_size=12,
)


def test_late_records_are_sorted_by_time():
    one, two, three = (record(second, "ann", "belief", f"b{second}") for second in (1.0, 2.0, 3.0))
    history = History([one, three, two])
    assert list(history) == [one, two, three]
    assert history.between(two.stamp, three.stamp) == [two, three]
    assert list(history.back(one.stamp, two.stamp)) == [two, one]
    assert (history.until(two.stamp), history.until(two.stamp - 1), len(history)) == (2, 1, 3)
    assert (history.duration_s, history.stamp(1.0), history.seconds(two.stamp)) == (2.0, two.stamp, 1.0)


def test_causes_precede_effects_that_arrived_before_them():
    goal = record(1.0, "ann", "goal", "greet()", id="g")
    action = record(1.0, "ann", "action", "speak()", cause="g", id="a")
    other = record(1.0, "ann", "belief", "b", id="b")
    said = record(1.0, "/speech/say", "utterance", "Hello", cause="a", id="say-a")
    begun = record(1.0, "/speech/status", "speech", "started", cause="say-a", id="started")
    later = record(2.0, "/speech/status", "speech", "finished", cause="say-a", id="finished")
    history = History([said, begun, later, goal, action, other])
    assert list(history) == [goal, action, said, begun, other, later]
    assert min(history.late(0)) == 0


def test_a_sentence_without_a_cause_has_the_action_that_quotes_it():
    other = record(1.0, "ann", "action", 'speak("Hello")', id="a1")
    action = record(1.2, "ann", "action", 'speak("Bye")', id="a2")
    said = record(1.2, "/speech/say", "utterance", "Bye", id="u1")
    late = record(3.0, "/speech/say", "utterance", "Bye", id="u2")
    unknown = record(1.2, "/speech/say", "utterance", "Good morning", id="u3")
    history = History([other, action, said, unknown, late])
    assert [history.cause(each) for each in (said, unknown, late)] == [action, None, None]


def test_start_before_the_first_record():
    history = History([record(1.0, "ann", "belief", "b")], start=100 * SECOND)
    assert history.seconds(history.end) == 1.0
    assert History().duration_s == 0.0


def test_end_in_seconds_is_the_last_stamp():
    records = [
        TraceRecord(stamp=stamp, id=str(stamp), source="a", kind="event", what="e") for stamp in (0, 1_333_333_313)
    ]
    history = History(records)
    assert history.stamp(history.duration_s) == history.end


def test_causes_and_effects():
    belief = record(1.0, "ann", "belief", "here", cause="frame-7", id="b")
    goal = record(1.0, "ann", "goal", "greet()", cause="b", id="g")
    done = record(2.0, "ann", "achieved", "greet()", cause="g", id="a")
    history = History([belief, goal, done])
    assert history.chain(done) == [done, goal, belief]
    assert (history.cause(belief), history.effects(belief), history.effects(goal)) == (None, [goal], [done])


def test_cause_is_the_last_earlier_record_with_the_id():
    first = record(1.0, "ann", "belief", "first", id="ann-1")
    effect = record(2.0, "ann", "goal", "go()", cause="ann-1", id="ann-2")
    again = record(3.0, "ann", "belief", "after a restart", id="ann-1")
    assert History([first, effect, again]).cause(effect) is first


def test_request_has_two_ids():
    asked = request(1.0, "bob", "bob asks ann to add desire be_home", "bob-77")
    wanted = record(1.1, "ann", "desire", "be_home", cause="bob-77")
    assert History([asked, wanted]).chain(wanted) == [wanted, asked]


def test_step_without_cause_follows_its_action():
    action = record(1.0, "robot", "action", "go(robot, room1)", id="r-1")
    other = record(1.0, "robot", "action", "go(robot, room2)", id="r-2")
    step = record(1.0, "robot", "step", "(go robot room1)")
    assert History([action, other, step]).cause(step) is action


def test_message_of_a_mission_follows_its_plan_and_problem():
    def said(seconds: float, who: str, to: str, weight: str) -> TraceRecord:
        return record(seconds, who, "said", "a word", mission="m1", receiver=to, weight=weight)

    problem = said(2.0, "robot", "boss", "problem")
    end = record(2.0, "boss", "plan_end", "clean", cause="d", label="m1", outcome="failed")
    plan = record(2.0, "boss", "plan_start", "clean", cause="d", label="m2", plan=2, steps=[])
    word = record(2.0, "boss", "said", "a plan", mission="m2", receiver="robot", weight="plan")
    assert History([problem, end, plan, word]).chain(word) == [word, plan, end, problem]


@settings(max_examples=40)
@given(RECORDS)
def test_causes_never_loop(records):
    history = History(records)
    for each in history:
        chain = history.chain(each)
        assert chain[0] is each
        assert len({id(link) for link in chain}) == len(chain)


@settings(max_examples=40)
@given(RECORDS)
def test_effects_have_the_record_as_cause(records):
    history = History(records)
    for each in history:
        assert all(history.cause(effect) is each for effect in history.effects(each))
