from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from socialbot.core.clock import SECOND
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.record import SCORED
from socialbot.runs.report import page_of
from socialbot.runs.report_sight import APART_S, WORST, Sight
from socialbot.vision.metrics.scores import ScoredFrame
from socialbot.vision.metrics.truth import TruthPerson
from tests.runs.pages import headings, read
from tests.runs.runs import START, frame, greeting
from tests.runs.test_run_page import Grey

TENTHS = 60
BLIND = range(20, 25)
"""Tenths of a second in which nobody is found who is there."""


def person(name: str) -> TruthPerson:
    return TruthPerson(id=name, x=100, y=50, w=80, h=200, distance_m=4.0, visible=1.0)


def scored(tenth: int) -> ScoredFrame:
    """Ann is always there, Bob from 4 s on; then there is also a false alarm."""
    there = (person("ann"), person("bob")) if tenth >= 40 else (person("ann"),)
    stamp = START + tenth * SECOND // 10
    if tenth in BLIND:
        return ScoredFrame(stamp, missed=there)
    return ScoredFrame(stamp, found=there, false=frame(tenth, 3.0).persons if tenth == 50 else ())


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> RecordedRun:
    folder: Path = greeting(tmp_path_factory.mktemp("run") / "waldo", comes=0, tenths=TENTHS)
    lines = msgspec.json.Encoder().encode_lines(map(scored, range(TENTHS)))
    (folder / SCORED).write_bytes(lines)
    return open_run(folder, Grey())


def test_the_curves_are_those_of_the_truth(run):
    people, rates = Sight(run).plots()
    there, found, false = ([value for _, value in curve.points] for curve in people.curves)
    assert there == [1] * 40 + [2] * 20
    assert [tenth for tenth, (all_, some) in enumerate(zip(there, found, strict=True)) if all_ != some] == [*BLIND]
    assert [tenth for tenth, count in enumerate(false) if count] == [50]
    assert people.most == 2
    recall = dict(rates.curves[1].points)
    assert recall[2.2] == pytest.approx(26 / 31)  # from 0.7 to 3.7 s, of which half a second is blind
    assert recall[5.9] == 1.0


def test_rates_are_nothing_where_there_is_nobody(tmp_path, run):
    (tmp_path / "trace.jsonl").write_bytes((run.folder / "trace.jsonl").read_bytes())
    (tmp_path / SCORED).write_bytes(msgspec.json.Encoder().encode_lines([ScoredFrame(START), ScoredFrame(START + 1)]))
    empty = open_run(tmp_path)
    _, rates = Sight(empty).plots()
    assert {value for curve in rates.curves for _, value in curve.points} == {None}
    assert Sight(empty).worst == []


def test_the_worst_frames_are_apart(run):
    times = [run.history.seconds(each.stamp) for each in Sight(run).worst]
    assert times == [2.0, 5.0]
    assert len(times) <= WORST
    assert times[1] - times[0] >= APART_S


def test_the_page_has_the_curves_and_the_worst_frames(run):
    html = page_of(run, "Waldo").html()
    words = read(html)
    assert headings(html)[:2] == ["What went on when", "Where seeing went wrong"]
    assert "2.00 s: 1 missed (4.0 m)" in words
    assert "5.00 s: 2 found, 1 false" in words
    chart = html.partition('class="lanes"')[2].partition("</svg>")[0]
    drawn = re.findall(r'<g class="curve c-(\w+)">', chart)
    assert drawn == ["there", "found", "false", "precision", "recall", "f1"]
    assert chart.count('class="marked"') == 2


def test_without_the_truth_there_is_nothing_of_it(tmp_path):
    html = page_of(open_run(greeting(tmp_path / "run"), Grey()), "Waldo").html()
    assert "Where seeing went wrong" not in headings(html)
    assert 'class="curve' not in html


def test_a_damaged_line_is_told_and_left_out(tmp_path, run):
    (tmp_path / "trace.jsonl").write_bytes((run.folder / "trace.jsonl").read_bytes())
    (tmp_path / SCORED).write_bytes(b'{"stamp":1}\nrubbish\n{"stamp":2}\n')
    damaged = open_run(tmp_path)
    assert [each.stamp for each in damaged.scored] == [1, 2]
    assert any(text.startswith("scored.jsonl:2") for text in damaged.damage)
