from __future__ import annotations

import msgspec
import pytest

from socialbot.core.clock import SECOND
from socialbot.runs.folder import open_run
from socialbot.runs.history import History
from socialbot.runs.timeline import Timeline, timeline_of
from socialbot.runs.tracks import forget, latest
from tests.runs.deliberating_runs import desire, plan, plan_end, record, step, step_end
from tests.runs.runs import greeting

ERRAND = (
    desire(0.0, "ann", "be_home"),
    plan(1.0, "ann", "be_home", 1, "0.000: (go ann hall home) [2.000]"),
    msgspec.structs.replace(step(1.0, "ann", "(go ann hall home)"), id="s1"),
    record(1.0, "ann", "goal", "go(ann, hall, home)", "s1", id="g1"),
    record(1.0, "ann", "plan", "go(A, B, C)", "g1", id="p1"),
    record(1.0, "ann", "action", "go(ann, hall, home)", "p1", id="a1"),
    step_end(3.0, "ann", "(go ann hall home)", cause="s1"),
    plan_end(3.0, "ann", "be_home", 1, "succeeded"),
    record(3.0, "ann", "desire_fulfilled", "be_home", reason=""),
)


def bars(timeline: Timeline) -> dict[str, list[tuple[str, float, float | None, str]]]:
    return {
        f"{lane.agent}.{lane.name}": [(bar.text, bar.from_s, bar.to_s, bar.outcome) for bar in lane.bars]
        for lane in timeline.lanes()
    }


def test_desires_plans_and_steps_are_bars():
    assert bars(timeline_of(History(ERRAND, start=100 * SECOND))) == {
        "ann.desires": [("be_home", 0.0, 3.0, "fulfilled")],
        "ann.plans": [("plan 1 for be_home", 1.0, 3.0, "succeeded")],
        "ann.steps": [("go ann hall home", 1.0, 3.0, "successful")],
    }


def test_open_bars_and_changes():
    history = History(start=100 * SECOND)
    timeline = Timeline(history)
    for each in ERRAND[:3]:
        history.append(each)
        timeline.take(each)
    assert [(changed.lane, changed.bar.to_s) for changed in timeline.changed()] == [
        ("desires", None),
        ("plans", None),
        ("steps", None),
    ]
    assert timeline.changed() == ()
    history.append(ERRAND[6])
    timeline.take(ERRAND[6])
    assert [(changed.lane, changed.bar.to_s) for changed in timeline.changed()] == [("steps", 3.0)]


def test_bar_is_encoded_with_from_and_to():
    (lane, *_) = timeline_of(History(ERRAND, start=100 * SECOND)).lanes()
    bar = msgspec.json.decode(msgspec.json.encode(lane))["bars"][0]
    assert (bar["from"], bar["to"], bar["kind"]) == (0.0, 3.0, "desire")


def test_returning_person_has_a_new_bar():
    box = {"x": 0, "y": 0, "w": 1, "h": 2, "score": 1}

    def seen(second: float, *tracks: str):
        return record(second, "/d", "detection", "", persons=[{**box, "track_id": track} for track in tracks])

    history = History([seen(0.0, "t1"), seen(0.5), seen(0.9, "t1"), seen(3.0, "t1", "t2")], start=100 * SECOND)
    assert bars(timeline_of(history)) == {
        ".people": [("t1", 0.0, 0.9, ""), ("t1", 3.0, 3.0, ""), ("t2", 3.0, 3.0, "")],
    }


def test_lanes_of_a_run(tmp_path):
    run = open_run(greeting(tmp_path / "run"))
    lanes = bars(run.timeline)
    assert [text for text, *_ in lanes[".people"]] == ["t1"]
    assert lanes["bdi_engine.goals"][0][0] == "GreetPeople()"
    assert lanes["bdi_engine.actions"][0][0] == 'speak("greeting")'
    assert lanes[".speech"][0][0] == "Hello! Nice to see you."


def test_old_bars_are_dropped():
    lasts = (*ERRAND[:7], desire(0.0, "ann", "be_glad"))
    history = History(sorted(lasts, key=lambda each: each.stamp), start=100 * SECOND)
    timeline = timeline_of(history)
    timeline.forget(history.stamp(4.0))
    assert bars(timeline) == {
        "ann.desires": [("be_home", 0.0, None, ""), ("be_glad", 0.0, None, "")],
        "ann.plans": [("plan 1 for be_home", 1.0, None, "")],
    }
    timeline.take(plan_end(5.0, "ann", "be_home", 1, "succeeded"))
    assert bars(timeline)["ann.plans"] == [("plan 1 for be_home", 1.0, 5.0, "succeeded")]


def test_person_has_a_new_bar_after_trimming(tmp_path):
    history = open_run(greeting(tmp_path / "run")).history
    timeline = timeline_of(history)
    timeline.forget(history.end + SECOND)
    assert ".people" not in bars(timeline)
    last = next(each for each in reversed(list(history)) if each.kind == "detection")
    timeline.take(last)
    assert [text for text, *_ in bars(timeline)[".people"]] == ["t1"]


@pytest.mark.parametrize(("stamp", "kept"), [(5, "abc"), (10, "abc"), (19, "abc"), (20, "bc"), (25, "bc"), (99, "c")])
def test_forget_keeps_the_current_value(stamp, kept):
    track = [(10, "a"), (20, "b"), (30, "c")]
    before = latest(track, stamp)
    forget(track, stamp)
    assert "".join(what for _, what in track) == kept
    assert latest(track, stamp) == before
