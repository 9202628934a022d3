"""Report of a run: the frozen page and its tables."""

from __future__ import annotations

import os
import re
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.errors import RunError
from socialbot.core.messages import TraceRecord
from socialbot.runs._frames import MAX_WORST, WORST_APART_S, Perception
from socialbot.runs._report_tables import node_charts, story_sections
from socialbot.runs.difference import difference
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.pages import Page
from socialbot.runs.record import SCORED, STOPPED, NodeReport
from socialbot.runs.report import MAX_PICTURES, difference_page, report_html, write_report
from socialbot.runs.run import Picture
from socialbot.runs.story import Story, story_of
from socialbot.vision.metrics.scores import ScoredFrame
from socialbot.vision.metrics.truth import TruthPerson
from tests.runs.deliberating_runs import DETOUR, PHRASES, desire, record
from tests.runs.pages import charts, headings, read, series, unfrozen
from tests.runs.runs import START, frame, greeting

TENTHS = 60
BLIND = range(20, 25)
"""Tenths of a second in which a present person is missed."""


class Grey:
    """Camera with grey pictures."""

    def at(self, stamp: int) -> Picture | None:
        _, data = cv2.imencode(".jpg", np.full((480, 640, 3), 120, np.uint8))
        return Picture(stamp, data.tobytes())


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return greeting(tmp_path_factory.mktemp("run") / "waldo")


def changed(folder: Path, copy: Path, **changes: object) -> Path:
    """A copy of a run with other results."""
    copy.mkdir()
    for name in ("trace.jsonl", "seen.jsonl", "graph.yaml"):
        (copy / name).symlink_to(folder / name)
    found = msgspec.json.decode((folder / "results.json").read_bytes())
    (copy / "results.json").write_bytes(msgspec.json.encode({**found, **changes}))
    return copy


def test_report_holds_what_the_page_shows_at_any_time(folder):
    html = report_html(open_run(folder, Grey()), "Waldo")
    words = read(html)
    assert "1 person came into view. Waldo said “Hello! Nice to see you.”." in words
    assert "Turning points" in headings(html)
    assert "leads to “Hello! Nice to see you.”" in words
    data = unfrozen(html)
    lines = [line["text"] for line in data["log"]]
    assert 'Waldo said "Hello! Nice to see you."' in lines
    assert {lane["name"] for lane in data["timeline"]["lanes"]} >= {"people", "speech", "goals"}
    beliefs = [[belief["text"] for belief in held] for _, held in data["tracks"]["agents"]["bdi_engine"]["beliefs"]]
    assert any('personDetected("Yes")' in texts for texts in beliefs)
    has = data["run"]["has"]
    assert (has["pictures"], has["world"], has["commands"]) == (True, False, False)
    assert has["why_not"] == "this page is the record of a run"
    assert 1 <= len(data["pictures"]) <= 2 * MAX_PICTURES
    assert len(html) < 1_500_000


def test_report_explains_actions_down_to_the_frame(folder):
    data = unfrozen(report_html(open_run(folder), "Waldo"))
    said = next(line for line in data["log"] if line["text"].startswith("Waldo said"))
    chain = [reason["sentence"] for reason in data["why"][said["id"]]["chain"]]
    assert chain[0].endswith('said "Hello! Nice to see you."')
    assert chain[-1].startswith("the frame at 0.70 s showed person t1 4.0 m away")
    assert any(each["plan"].startswith("GreetPeople()") for each in data["plans"])
    assert "Turning points" not in headings(report_html(open_run(folder), "Waldo"))


@pytest.mark.parametrize(
    ("ended", "verdict", "warning"),
    [
        ("well", "ended well", ""),
        (STOPPED, "stopped", "This run was stopped after 1.9 s, before its end."),
        ("detector: no model", "failed", "This run failed after 1.9 s: detector: no model"),
    ],
)
def test_report_begins_with_how_the_run_ended(folder, tmp_path, ended, verdict, warning):
    html = report_html(open_run(changed(folder, tmp_path / "run", ended=ended)))
    assert f'class="mark {"live" if ended == "well" else "bad"}">{verdict}</span>' in html
    assert re.findall(r'<p class="warning">(.*?)</p>', html) == ([warning] if warning else [])


def test_report_is_not_written_to_a_pipe(tmp_path):
    """Nobody reads from it, so writing would not end."""
    run = greeting(tmp_path / "run")
    os.mkfifo(run / "report.html")
    with pytest.raises(RunError, match="is a device or a pipe"):
        write_report(run)


def test_report_is_not_written_through_a_link_out_of_the_folder(tmp_path):
    run, outside = greeting(tmp_path / "run"), tmp_path / "outside.txt"
    outside.write_text("mine")
    (run / "report.html").symlink_to(outside)
    with pytest.raises(RunError, match="link"):
        write_report(run)
    assert outside.read_text() == "mine"


def test_report_of_a_broken_off_run_says_so(folder, tmp_path):
    copy = changed(folder, tmp_path / "run")
    (copy / "results.json").unlink()
    path = write_report(copy)
    html = path.read_text("utf-8")
    assert path == copy / "report.html"
    assert "broken off</span>" in html
    assert "results.json is missing" in html


def test_report_shows_scores_and_resources(folder, tmp_path):
    band = {"tp": 9, "fp": 1, "fn": 0, "precision": 0.9, "recall": 1.0, "f1": 0.947}
    results = {
        "scores": {"frames": 20, "missing_frames": 0, "bands": {"0-2 m": band, "2-10 m": band, "10-20 m": band}},
        "nodes": {"head": {"calls": 7, "failures": 0, "skipped": 3, "cpu_s": 1.25, "peak_rss_mb": 80.0}},
        "parameters": {"bdi_engine": {"range_m": 4.5}},
        "versions": {"python": "3.11"},
    }
    html = report_html(open_run(changed(folder, tmp_path / "run", **results)))
    words = read(html)
    assert series(html, "Precision, recall and F1 by distance")["F1"] == [[0, 0.947], [1, 0.947], [2, 0.947]]
    assert re.search(r"head\s+7\s+3\s+1\.2 s\s+80 MB", words)
    assert "bdi_engine.range_m" in words
    assert "3.11" in words


def test_report_needs_a_run(tmp_path):
    with pytest.raises(RunError):
        write_report(tmp_path)


def test_report_of_an_empty_run_says_so(tmp_path):
    (tmp_path / "trace.jsonl").write_text("")
    assert "Nothing happened." in read(write_report(tmp_path).read_text("utf-8"))


# Ground truth


def person(name: str) -> TruthPerson:
    return TruthPerson(id=name, x=100, y=50, w=80, h=200, distance_m=4.0, visible=1.0)


def scored(tenth: int) -> ScoredFrame:
    """Ann is always present, Bob from 4 s on; at 5 s there is also a false detection."""
    present = (person("ann"), person("bob")) if tenth >= 40 else (person("ann"),)
    stamp = START + tenth * SECOND // 10
    if tenth in BLIND:
        return ScoredFrame(stamp, missed=present)
    return ScoredFrame(stamp, found=present, false=frame(tenth, 3.0).persons if tenth == 50 else ())


@pytest.fixture(scope="module")
def judged(tmp_path_factory) -> RecordedRun:
    folder = greeting(tmp_path_factory.mktemp("run") / "waldo", comes=0, tenths=TENTHS)
    (folder / SCORED).write_bytes(msgspec.json.Encoder().encode_lines(map(scored, range(TENTHS))))
    return open_run(folder, Grey())


def test_perception_charts_show_the_ground_truth(judged):
    people, rates = Perception(judged).charts()
    present, found, false = ([value for _, value in each.points] for each in people.series)
    assert present == [1] * 40 + [2] * 20
    assert [tenth for tenth, pair in enumerate(zip(present, found, strict=True)) if pair[0] != pair[1]] == [*BLIND]
    assert [tenth for tenth, count in enumerate(false) if count] == [50]
    recall = dict(rates.series[1].points)
    assert recall[2.2] == pytest.approx(26 / 31)  # from 0.7 to 3.7 s, half a second of which is blind
    assert recall[5.9] == 1.0


def test_rates_need_persons(tmp_path, judged):
    (tmp_path / "trace.jsonl").write_bytes((judged.folder / "trace.jsonl").read_bytes())
    (tmp_path / SCORED).write_bytes(msgspec.json.Encoder().encode_lines([ScoredFrame(START), ScoredFrame(START + 1)]))
    empty = Perception(open_run(tmp_path))
    assert {value for each in empty.charts()[1].series for _, value in each.points} == {None}
    assert empty.worst == []


def test_worst_frames_are_apart(judged):
    times = [judged.history.seconds(each.stamp) for each in Perception(judged).worst]
    assert times == [2.0, 5.0]
    assert len(times) <= MAX_WORST
    assert times[1] - times[0] >= WORST_APART_S


def test_report_shows_the_worst_frames(judged):
    html = report_html(judged)
    words = read(html)
    assert headings(html)[:3] == ["Visits", "Detection over time", "Worst frames"]
    assert "2.00 s: 1 missed (4.0 m)" in words
    assert "5.00 s: 2 found, 1 false" in words
    assert [mark[0] for mark in charts(html)["Persons present and found"]["marks"]] == [2.0, 5.0]


def test_report_leaves_a_damaged_line_out(tmp_path, judged):
    (tmp_path / "trace.jsonl").write_bytes((judged.folder / "trace.jsonl").read_bytes())
    (tmp_path / SCORED).write_bytes(b'{"stamp":1}\nrubbish\n{"stamp":2}\n')
    damaged = open_run(tmp_path)
    assert [each.stamp for each in damaged.scored] == [1, 2]
    assert any(text.startswith("scored.jsonl:2") for text in damaged.damage)


# Deliberation


def story_page(story: Story) -> str:
    return Page("A run", sections=story_sections(story)).html()


def test_story_becomes_tables():
    html = story_page(story_of(DETOUR, PHRASES))
    words = read(html)
    assert headings(html) == ["Desires", "Plans", "Requests between agents"]
    for text in ("be_home", "7.00 s", "asks bob for open_door", "↻ 2", "fulfilled", "failed: (go ann yard hall)"):
        assert text in words


def test_lead_sums_up_the_story():
    assert story_of(DETOUR, PHRASES).lead() == (
        "ann wanted be_home and reached it after 7.0 s; its first plan said 5.0 s. "
        "One plan was given up, at 3.0 s: ann goes from yard to hall, the door is locked."
    )
    assert story_of(DETOUR[:3]).lead().startswith("ann wanted be_home and still pursued it")
    dropped = story_of((desire(0, "a", "x"), record(1, "a", "desire_dropped", "x", reason="deleted")))
    assert dropped.lead() == "a wanted x, which was dropped: deleted. No plan was given up."
    assert story_of([]).lead() == "Nobody wanted anything."


def test_messages_between_agents_take_the_place_of_requests():
    def said(text: str, weight: str) -> TraceRecord:
        more = {"receiver": "bob", "performative": "inform", "content": "Problem", "mission": "m_1", "weight": weight}
        return record(1, "ann", "said", text, **more)

    html = story_page(story_of((desire(0, "ann", "x"), said("reports <smoke>", "problem"), said("hums", ""))))
    read(html)
    assert html.count('<td class="bad">reports &lt;smoke&gt;</td>') == 2, "among the important ones, and among all"
    assert html.count("<td>hums</td>") == 1
    assert "Requests between agents" not in html


# Nodes


def reports(name: str, seconds: list[float], pid: str = "7", **values: float) -> list[tuple[float, NodeReport]]:
    told = {"machine": "robot", "state": "active", "pid": pid, **{key: str(value) for key, value in values.items()}}
    return [(at_s, NodeReport(0, name, told)) for at_s in seconds]


def test_each_measure_has_a_chart_with_each_node():
    found = node_charts(
        {
            "head": reports(
                "head", [0, 1, 2], "1", call_hz=10, publish_hz=5, age_p99_ms=1200, cpu_percent=3, rss_mb=80
            ),
            "camera": reports("camera", [0, 1, 2], "2", call_hz=0, publish_hz=30, cpu_percent=6, rss_mb=160),
        }
    )
    assert [(chart.title, [each.name for each in chart.series]) for chart in found] == [
        ("Messages per second", ["handled by head", "published by head", "published by camera"]),
        ("Latency, 99th percentile", ["message age at head"]),
        ("Processor, of one core", ["head", "camera"]),
        ("Memory", ["head", "camera"]),
    ]


def test_nodes_of_a_process_share_a_line():
    found = node_charts({name: reports(name, [0, 1, 2], cpu_percent=50) for name in ("head", "speech")})
    assert [[each.name for each in chart.series] for chart in found] == [["head, speech"]]


def test_restart_is_a_gap_and_a_mark():
    told = reports("head", [0, 1, 2], "1", rss_mb=80) + reports("head", [12, 13, 14], "2", rss_mb=80)
    (chart,) = node_charts({"head": told})
    assert [value for _, value in chart.series[0].points].count(None) == 1
    assert chart.marks == [(12, "head restarted")]


def test_long_charts_keep_peaks_and_gaps():
    hours = reports("head", [float(second) for second in (*range(20_000), *range(21_000, 40_000))], rss_mb=80)
    hours[20_500] = reports("head", [21_500.0], rss_mb=900)[0]
    (chart,) = node_charts({"head": hours})
    values = [value for _, value in chart.series[0].points]
    assert len(values) < 1000
    assert max(value or 0 for value in values) == 900
    assert None in values


@pytest.mark.parametrize("told", [{}, {"head": reports("head", [0, 1], call_hz=9)}])
def test_silent_nodes_have_no_chart(told):
    assert node_charts(told) == []
    assert node_charts({"head": reports("head", [0, 1, 2], call_hz=float("nan"))}) == []


# Two runs


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> tuple[RecordedRun, RecordedRun]:
    folder = tmp_path_factory.mktemp("runs")
    first, second = (open_run(greeting(folder / str(comes), comes=comes), Grey()) for comes in (5, 8))
    return first, second


def test_difference_page_marks_the_first_different_decision(pair):
    first, second = pair
    page = difference_page(first, second, difference(first, second))
    html = page.html()
    words = read(html)
    assert headings(html)[:3] == ["First different decision", "Timelines", "First differences"]
    assert not page.good
    assert "is the first that is the same, but at another time" in page.lead
    assert re.findall(r'"at":([\d.]+)}</script>', html) == ["0.7", "1.0"]
    assert words.count("the frame at the end of the chain") == 2


def test_difference_page_of_equal_runs_has_no_decision(pair):
    page = difference_page(pair[0], pair[0], difference(pair[0], pair[0]))
    html = page.html()
    read(html)
    assert page.good
    assert headings(html) == ["Timelines"]
