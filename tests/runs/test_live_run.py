"""A run that goes on for so long that not all of it can be kept."""

from __future__ import annotations

from itertools import pairwise

import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.graph.files import load_graph
from socialbot.runs import run as live_run
from socialbot.runs.run import LiveRun
from socialbot.runs.why import explain
from tests.runs.runs import START, frame, waldo_heard_by

MINUTES = 10
WELL = {"machine": "desk", "state": "active"}


@pytest.fixture(scope="module")
def long() -> tuple[LiveRun, LiveRun]:
    """Waldo is visited for 20 s of each minute: a run that looks back five of them, and one without end."""
    short, whole = (LiveRun(load_graph("waldo").without_sources()) for _ in range(2))
    runner = waldo_heard_by(short, whole)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live_run, "LATER_S", 60.0)
        for tenth in range(600 * MINUTES):
            runner.feed("/humans/bodies/detections", frame(tenth, *([4.0] if tenth % 600 < 200 else [])))
            if tenth % 10 == 0:
                for live in (short, whole):
                    live.note_node(frame(tenth).stamp, "speech", {**WELL, "call_hz": str(tenth)})
            if tenth % 100 == 0:
                patch.setattr(live_run, "LOOKS_BACK_S", 300.0)
                assert short.end
        patch.setattr(live_run, "LOOKS_BACK_S", 1e9)
        assert whole.end
    return short, whole


def test_old_records_are_dropped(long):
    short, whole = long
    kept_s = (short.end - short.history.since) / SECOND
    assert 300.0 <= kept_s < 300.0 + 60.0 + 30.0 + 10.0
    assert short.history.forgotten + len(short.history) == len(whole.history)
    assert short.history.find(whole.history[10].id) is None


def test_remaining_states_are_right(long):
    short, whole = long
    for stamp in range(short.history.since, short.end, 7 * SECOND):
        assert short.states.at(stamp) == whole.states.at(stamp)
        assert short.nodes(stamp) == whole.nodes(stamp)
    since = short.history.seconds(short.end) - 300.0
    bars = {bar.id: bar for lane in short.timeline.lanes() for bar in lane.bars}
    assert bars
    for lane in whole.timeline.lanes():
        for bar in lane.bars:
            assert bars.get(bar.id) == bar or (bar.to_s is not None and bar.to_s < since)


def test_old_belief_is_still_explained(long):
    short, whole = long
    (waldo,) = short.states.at(short.end).agents
    oldest = min(waldo.beliefs, key=lambda held: held.since_s)
    assert short.history.stamp(oldest.since_s) < short.history.since
    record = short.history.find(oldest.id)
    assert record is not None
    assert explain(short.history, short.wording, record) == explain(whole.history, whole.wording, record)


def test_older_half_of_too_many_records_is_dropped(monkeypatch):
    monkeypatch.setattr(live_run, "MOST_RECORDS", 1000)
    live = LiveRun(load_graph("waldo").without_sources())
    runner = waldo_heard_by(live)
    counts = []
    for tenth in range(4000):
        runner.feed("/humans/bodies/detections", frame(tenth, 4.0))
        counts.append(len(live.history))
    drops = [(before, after) for before, after in pairwise(counts) if after < before]
    assert max(counts) <= 1000
    assert len(drops) > 4
    assert all(500 <= after < 500 + 256 + 10 for _, after in drops)


def note(live: LiveRun, number: int, text: str = "look()") -> None:
    record = TraceRecord(stamp=START + number, id=f"a{number}", source="bdi_engine", kind="note", what=text)
    live.observe("/bdi/trace", record)


def test_records_that_arrive_while_others_are_processed_wait(monkeypatch):
    """Else a flood is processed without end, and nothing is dropped meanwhile."""
    monkeypatch.setattr(live_run, "MOST_RECORDS", 1000)
    live, numbers, process = LiveRun(load_graph("waldo")), iter(range(1, 5000)), live_run.trace_record

    def flooded(topic, message):
        if number := next(numbers, 0):
            note(live, number)
        return process(topic, message)

    monkeypatch.setattr(live_run, "trace_record", flooded)
    note(live, 0)
    counts = [len(live.history) for _ in range(5001)]
    assert live.history.end == START + 4999
    assert max(counts) <= 1000


def test_older_half_of_too_long_records_is_dropped(monkeypatch):
    monkeypatch.setattr(live_run, "MOST_BYTES", 10_000_000)
    live = LiveRun(load_graph("waldo"))
    sizes = []
    for number in range(5000):
        note(live, number, "x" * 10_000)
        sizes.append(sum(len(record.what) for record in live.history))
    assert max(sizes) <= 10_000_000
    assert min(sizes[2000:]) >= 4_000_000


def test_a_huge_record_is_left_out_and_reported():
    live = LiveRun(load_graph("waldo"))
    note(live, 0)
    note(live, 1, "x" * live_run.LONGEST_RECORD)
    assert [record.id for record in live.history] == ["a0"]
    assert live.problems == ["records longer than 262144 bytes are on disk only: 1"]


def test_old_node_reports_are_dropped():
    graph = load_graph("waldo")
    live = LiveRun(graph)
    live.observe("/humans/bodies/detections", frame(0))
    for second in range(10_000):
        live.note_node(START + second * SECOND, "speech", {**WELL, "call_hz": str(second)})
        assert live.end
    (told,) = live.node_history.reports.values()
    assert 3600 <= len(told) <= 3600 + 300 + 2
    assert [node.name for node in live.nodes(live.end)] == [node.name for node in live.graph_view().nodes]


def at_work(live: LiveRun, seconds: range, each_s: int) -> None:
    """An agent has a goal every so often, and reaches it one second later; a node says each second how it is."""
    for second in seconds:
        stamp = START + second * SECOND
        goal, now = f"g{second - second % each_s}", second % each_s
        if now < 2:
            kind, id, cause = ("achieved", f"e{second}", goal) if now else ("goal", goal, "")
            told = TraceRecord(stamp=stamp, id=id, source="bdi_engine", kind=kind, what="look()", cause=cause)
            live.observe("/bdi/trace", told)
        live.note_node(stamp, "speech", {**WELL, "call_hz": str(second)})
        if second % 100 == 0:
            assert live.end


def test_trimmed_run_hides_incomplete_times():
    """Records are forgotten many at once, all else one by one."""
    short, whole = LiveRun(load_graph("waldo")), LiveRun(load_graph("waldo"))
    at_work(short, range(3 * 3600), 60)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live_run, "LOOKS_BACK_S", 1e9)
        at_work(whole, range(3 * 3600), 60)
        since = short.history.seconds(short.history.since)
        assert 3600.0 <= short.history.seconds(short.end) - since <= 3600.0 + 300.0 + 100.0
        for second in (since, since + 50.0, since + 1000.0):
            stamp = short.history.stamp(second)
            assert short.states.at(stamp) == whole.states.at(stamp)
            assert short.nodes(stamp) == whole.nodes(stamp)
        assert {bar for lane in short.timeline.lanes() for bar in lane.bars} == {
            bar for lane in whole.timeline.lanes() for bar in lane.bars if bar.to_s is None or bar.to_s >= since
        }


def test_end_advances_without_records():
    live = LiveRun(load_graph("waldo"))
    at_work(live, range(256), 2)  # as many records as are forgotten at once
    assert len(live.history) == 256
    for second in range(256, 10_000, 100):
        live.note_node(START + second * SECOND, "speech", WELL)
        assert live.end == START + second * SECOND
    assert live.states.at(live.end).agents


def test_late_record_does_not_change_the_complete_range():
    live = LiveRun(load_graph("waldo"))
    at_work(live, range(3 * 3600), 10)
    since = live.history.since
    old = TraceRecord(stamp=START - 9999 * SECOND, id="old", source="bdi_engine", kind="belief", what="old")
    live.observe("/bdi/trace", old)
    assert live.end
    assert live.history.since == since


def test_future_stamp_drops_nothing():
    graph = load_graph("waldo")
    live = LiveRun(graph)
    for second in range(500):
        live.observe("/humans/bodies/detections", frame(second * 10, 4.0))
        if second == 400:
            live.observe("/humans/bodies/detections", frame(10_000_000, 4.0))
        assert live.end
    assert live.history.forgotten == 0
    assert live.history.since == START
    assert len(live.history) == 501
