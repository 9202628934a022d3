from __future__ import annotations

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.runs import state as courses
from socialbot.runs.folder import open_run
from socialbot.runs.history import History
from socialbot.runs.state import StateIndex
from tests.runs.deliberating_runs import desire, plan, plan_end, record, step, step_end
from tests.runs.runs import greeting


def moment(records, second: float):
    history = History(records, start=100 * SECOND)
    return StateIndex(history).at(history.stamp(second))


def agent(records, second: float):
    (found,) = moment(records, second).agents
    return found


def told_by(source: str, belief: TraceRecord) -> TraceRecord:
    return msgspec.structs.replace(belief, detail={"source": source})


def test_beliefs_have_sources_and_times():
    records = [
        told_by("percept", record(1.0, "ann", "belief", "here(bob)", id="b1")),
        told_by("carl", record(2.0, "ann", "belief", "here(bob)")),
        record(3.0, "ann", "unbelief", "here(bob)"),
    ]
    assert moment(records, 0.5).agents == ()
    assert [(b.id, b.text, b.source, b.since_s) for b in agent(records, 1.0).beliefs] == [
        ("b1", "here(bob)", "percept", 1.0)
    ]
    assert [b.source for b in agent(records, 2.5).beliefs] == ["percept, carl"]
    assert agent(records, 3.0).beliefs == ()


def test_belief_of_another_source_is_kept():
    records = [
        told_by("percept", record(1.0, "ann", "belief", "here(bob)")),
        told_by("carl", record(2.0, "ann", "belief", "here(bob)")),
        record(3.0, "ann", "unbelief", "here(bob)", left="carl"),
    ]
    assert [(b.text, b.source, b.since_s) for b in agent(records, 3.0).beliefs] == [("here(bob)", "carl", 1.0)]


def test_desire_with_its_plan_and_current_step():
    records = [
        desire(0.0, "ann", "be_home"),
        plan(1.0, "ann", "be_home", 1, "0.000: (go ann hall yard) [2.000]", "2.000: (go ann yard home) [2.000]"),
        msgspec.structs.replace(step(1.0, "ann", "(go ann hall yard)"), id="s1"),
        step_end(3.0, "ann", "(go ann hall yard)", cause="s1"),
        plan_end(5.0, "ann", "be_home", 1, "succeeded"),
        record(5.0, "ann", "desire_fulfilled", "be_home", reason=""),
    ]
    then = agent(records, 2.0)
    assert [(w.text, w.priority, w.due_s) for w in then.desires] == [("be_home", 0.5, 20.0)]
    assert [(p.number, p.done, p.steps) for p in then.plans] == [(1, 0, 2)]
    assert [(d.text, d.since_s) for d in then.actions] == [("go ann hall yard", 1.0)]
    assert [(p.done, agent(records, 4.0).actions) for p in agent(records, 4.0).plans] == [(1, ())]
    over = agent(records, 5.0)
    assert (over.desires, over.plans, over.actions) == ((), (), ())
    assert [(e.kind, e.outcome) for e in over.ended] == [
        ("desire", "fulfilled"),
        ("plan", "succeeded"),
        ("action", "successful"),
    ]


def test_goals_have_plan_and_step_until_achieved():
    records = [
        record(1.0, "ann", "goal", "serve()", id="g1"),
        record(1.0, "ann", "plan", "serve()", "g1", id="p1", label="politely"),
        record(1.0, "ann", "goal", "fetch()", "p1", id="g2"),
        record(1.0, "ann", "plan", "fetch()", "g2", id="p2", rule="fetch() >> [go()]"),
        record(1.0, "ann", "action", "go()", "p2", id="a1"),
        record(2.0, "ann", "progress", "go()", "a1", fraction=0.5, text=""),
        record(3.0, "ann", "action_end", "go()", "a1", outcome="finished"),
        record(3.0, "ann", "achieved", "fetch()", "g2"),
    ]
    assert [(g.text, g.depth, g.plan, g.step) for g in agent(records, 2.0).goals] == [
        ("serve()", 0, "politely", ""),
        ("fetch()", 1, "fetch() >> [go()]", "go()"),
    ]
    assert [(d.text, d.since_s, d.done) for d in agent(records, 2.0).actions] == [("go()", 1.0, 0.5)]
    assert [g.text for g in agent(records, 3.0).goals] == ["serve()"]


def test_goals_end_with_a_dropped_intention():
    records = [
        record(1.0, "ann", "goal", "serve()", id="g1"),
        record(1.0, "ann", "plan", "serve()", "g1", id="p1"),
        record(1.0, "ann", "goal", "fetch()", "p1", id="g2"),
        record(2.0, "ann", "failure", "fetch()", "g2", id="f1", message="no plan"),
        record(2.0, "ann", "dropped", "intention", "f1", message="no plan"),
    ]
    assert agent(records, 2.0).goals == ()
    assert [(e.text, e.outcome) for e in agent(records, 2.0).ended] == [("serve()", "no plan"), ("fetch()", "no plan")]


def test_persons_and_speech_of_a_run(tmp_path):
    run = open_run(greeting(tmp_path / "run"))
    nobody, greeted = (run.states.at(run.history.stamp(second)) for second in (0.4, 1.9))
    assert nobody.sight is not None
    assert (nobody.sight.persons, nobody.speech) == ((), ())
    assert greeted.sight is not None
    assert [(p.track_id, p.distance_m) for p in greeted.sight.persons] == [("t1", 4.0)]
    assert (greeted.sight.width, greeted.sight.height) == (640, 480)
    assert [(s.text, s.state) for s in greeted.speech] == [("Hello! Nice to see you.", "started")]
    assert greeted.head is not None
    assert greeted.head.mode == "track"
    (waldo,) = greeted.agents
    assert 'personDetected("Yes")' in [belief.text for belief in waldo.beliefs]


def test_speech_and_motion_have_their_agent_sound_and_end():
    records = [
        record(1.0, "ann", "action", "speak()", id="a1"),
        record(1.0, "/say", "utterance", "Hello", "a1", id="say-1"),
        record(1.1, "/status", "speech", "started", "say-1", detail="001-hello.wav"),
        record(1.2, "/head", "head", "track", "a1"),
        record(1.3, "/joints", "motion", "head_pan_joint 0.500 rad", duration_s=0.4),
    ]
    history = History(records, start=100 * SECOND)
    state = StateIndex(history).at(history.stamp(1.3))
    (said,) = state.speech
    assert (said.agent, said.state, said.sound) == ("ann", "started", "001-hello.wav")
    assert state.head is not None
    assert (state.head.agent, state.head.mode, state.head.moves_until_s) == ("ann", "track", 1.7)


def test_a_goal_without_any_action_says_so():
    records = [
        record(1.0, "ann", "goal", "greet()", id="g1"),
        record(1.0, "ann", "plan", "greet()", "g1", id="p1"),
        record(1.0, "ann", "achieved", "greet()", "g1"),
        record(2.0, "ann", "goal", "greet()", id="g2"),
        record(2.0, "ann", "plan", "greet()", "g2", id="p2"),
        record(2.0, "ann", "goal", "speak()", "p2", id="g3"),
        record(2.0, "ann", "plan", "speak()", "g3", id="p3"),
        record(2.0, "ann", "action", "say(hello)", "p3"),
        record(2.0, "ann", "achieved", "speak()", "g3"),
        record(2.0, "ann", "achieved", "greet()", "g2"),
    ]
    assert [end.outcome for end in agent(records, 2.0).ended] == [
        "achieved", "achieved", "achieved without any action",
    ]  # fmt: skip


TEXTS = st.sampled_from(("a", "b", "c"))
KINDS = (
    *("belief", "unbelief", "goal", "plan", "action", "achieved", "desire", "desire_dropped", "detection", "utterance"),
)
HAPPENINGS = st.tuples(
    st.sampled_from(("ann", "bob")),
    st.sampled_from(KINDS),
    TEXTS,
    st.integers(0, 40),
)


def happened(happenings) -> list[TraceRecord]:
    """Return records 0.1 s apart; utterances have no cause, as that is an action just before, never an old record."""
    return [
        record(
            number / 10, who, kind, what, f"r{cause}" if cause < number and kind != "utterance" else "", id=f"r{number}"
        )
        for number, (who, kind, what, cause) in enumerate(happenings)
    ]


@pytest.fixture
def near(monkeypatch):
    """Checkpoints after every few records."""
    monkeypatch.setattr(courses, "APART", 4)


@pytest.mark.usefixtures("near")
class TestCheckpoints:
    @settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(st.lists(HAPPENINGS, max_size=20), st.lists(st.integers(0, 45), max_size=8))
    def test_states_equal_those_built_from_the_start(self, happenings, tenths):
        history = History(happened(happenings), start=100 * SECOND)
        course = StateIndex(history)
        for tenth in tenths:
            stamp = history.stamp(tenth / 10)
            assert course.at(stamp) == StateIndex(history).at(stamp)

    @settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(st.lists(HAPPENINGS, max_size=20), st.randoms(use_true_random=False))
    def test_states_are_right_while_the_history_grows_in_any_order(self, happenings, random):
        records = happened(happenings)
        late = sorted(records, key=lambda each: each.stamp + random.randrange(SECOND))
        history = History(start=100 * SECOND)
        course = StateIndex(history)
        for each in late:
            history.append(each)
            stamp = history.stamp(random.randrange(45) / 10)
            assert course.at(stamp) == StateIndex(history).at(stamp)

    @settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(st.lists(HAPPENINGS, max_size=20), st.lists(HAPPENINGS, max_size=8), st.integers(0, 40), st.integers(0, 25))
    def test_states_are_right_after_trimming(self, before, after, count, seen):
        records = happened([*before, *after])
        whole, history = (History(records[: len(before)], start=100 * SECOND) for _ in range(2))
        course, told = StateIndex(history), StateIndex(whole)
        course.at(history.stamp(seen / 10))
        forgotten = course.forget(count)
        assert forgotten == history.forgotten <= min(count, len(whole))
        for each in records[len(before) :]:
            history.append(each)
            whole.append(each)
        for stamp in {each.stamp for each in history}:
            assert course.at(stamp) == told.at(stamp)

    def test_current_items_keep_causes_and_effects(self):
        early = [
            record(0.0, "ann", "belief", "hungry", id="b1"),
            record(0.1, "ann", "goal", "eat()", "b1", id="g1"),
            record(0.1, "ann", "plan", "eat()", "g1", id="p1"),
            record(0.2, "ann", "action", "cook()", "p1", id="a1"),
            *(record(0.3 + n / 10, "ann", "belief", f"tick({n})") for n in range(12)),
        ]
        history = History(early, start=100 * SECOND)
        course = StateIndex(history)
        assert course.forget(14) == 12
        cook = history.find("a1")
        assert cook is not None
        assert [each.id for each in history.chain(cook)] == ["a1", "p1", "g1", "b1"]
        history.append(record(9.0, "ann", "failure", "cook()", "a1", id="f1"))
        history.append(record(9.0, "ann", "dropped", "eat()", "f1", reason="burnt"))
        (ann,) = course.at(history.end).agents
        assert (ann.goals, [(ended.text, ended.outcome) for ended in ann.ended]) == ((), [("eat()", "burnt")])

    def test_ended_items_are_right_at_every_time(self):
        records = [
            record(0.0, "ann", "goal", "eat()", id="g1"),
            record(0.0, "ann", "plan", "eat()", "g1", id="p1"),
            record(0.0, "ann", "action", "cook()", "p1", id="a1"),
            record(0.1, "ann", "belief", "hungry"),
            record(0.2, "ann", "belief", "late"),
            record(0.3, "ann", "failure", "cook()", "a1", id="f1"),
            record(0.3, "ann", "dropped", "eat()", "f1", reason="burnt"),
            *(record(1.0 + n, "ann", "belief", f"tick({n})") for n in range(9)),
        ]
        whole, history = (History(records, start=100 * SECOND) for _ in range(2))
        course = StateIndex(history)
        assert course.forget(4) == 4
        for each in history:
            assert course.at(each.stamp) == StateIndex(whole).at(each.stamp)
        assert history.find("g1") is not None, "a page that shows it is asked why"

    def test_parallel_actions_end_their_goal_on_failure(self):
        records = [
            record(0.0, "ann", "goal", "eat()", id="g1"),
            record(0.0, "ann", "plan", "eat()", "g1", id="p1"),
            record(0.0, "ann", "action", "cook()", "p1", id="a1"),
            record(0.0, "ann", "action", "lay()", "p1", id="a2"),
            *(record(1.0 + n, "ann", "belief", f"tick({n})") for n in range(9)),
        ]
        history = History(records, start=100 * SECOND)
        course = StateIndex(history)
        assert course.forget(8) == 8
        history.append(record(20.0, "ann", "failure", "cook()", "a1", id="f1"))
        history.append(record(20.0, "ann", "dropped", "eat()", "f1", reason="burnt"))
        (ann,) = course.at(history.end).agents
        assert ann.goals == ()

    def test_ended_items_are_dropped(self):
        history = History(start=100 * SECOND)
        course = StateIndex(history)
        for n in range(0, 400, 4):
            for each in (
                record(n, "ann", "goal", "look()", f"g{n - 4}", id=f"g{n}"),
                record(n + 1, "ann", "plan", "look()", f"g{n}", id=f"p{n}"),
                record(n + 2, "ann", "achieved", "look()", f"g{n}"),
                record(n + 3, "ann", "belief", "looked", f"p{n}", id=f"b{n}"),
            ):
                history.append(each)
            course.forget(max(0, len(history) - 8))
            assert len(history) <= 12
        assert history.find("g200") is history.find("p200") is None
        assert history.find("b0") is not None, "it is still believed"
