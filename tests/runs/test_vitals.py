from __future__ import annotations

import re

from socialbot.runs.record import NodeTold
from socialbot.runs.report_vitals import vitals_charts
from tests.runs.pages import read


def node(name: str, seconds: list[float], pid: str = "7", **values: float) -> list[tuple[float, NodeTold]]:
    told = {"machine": "robot", "state": "active", "pid": pid, **{key: str(value) for key, value in values.items()}}
    return [(at_s, NodeTold(0, name, told)) for at_s in seconds]


def captions(html: str) -> list[str]:
    return re.findall(r"<figcaption><b>(.*?)</b> (.*?)</figcaption>", html)


def test_every_measure_has_a_chart_of_every_node():
    told = {
        "head": node("head", [0, 1, 2, 3], "1", call_hz=10, publish_hz=5, age_p99_ms=1200, cpu_percent=3, rss_mb=80),
        "<camera>": node("<camera>", [0, 1, 2, 3], "2", call_hz=0, publish_hz=30, cpu_percent=6, rss_mb=160),
    }
    html = vitals_charts(told)
    read(html)
    assert re.findall("<h3>(.*?)</h3>", html) == ["Messages a second", "Latency", "Processor, of one core", "Memory"]
    assert captions(html)[:3] == [("head", "up to 10 Hz"), ("&lt;camera&gt;", "up to 30 Hz"), ("head", "up to 1200 ms")]
    # Memory has one scale: who has half of it is half as high.
    heights = [float(y) for y in re.findall(r'd="M0\.0 ([\d.]+)', html.rpartition("<h3>")[2])]
    assert heights == [23.5, 2.0]


def test_nodes_of_a_process_share_its_charts():
    told = {name: node(name, [0, 1, 2], call_hz=9, cpu_percent=50) for name in ("head", "speech")}
    assert captions(vitals_charts(told)) == [
        ("head", "up to 9 Hz"),
        ("speech", "up to 9 Hz"),
        ("head, speech", "up to 50 %"),
    ]


def test_a_node_that_died_has_a_gap_and_a_mark():
    told = {"head": node("head", [0, 1, 2], "1", rss_mb=80) + node("head", [12, 13, 14], "2", rss_mb=80)}
    html = vitals_charts(told)
    assert len(re.findall("M", re.findall(r'c-first"><path d="(.*?)"', html)[0])) == 2
    assert "started again at 12.0 s" in html


def test_peaks_of_long_runs_are_kept_in_little_room():
    hours = node("head", [float(second) for second in range(40_000)], rss_mb=80)
    hours[20_000] = node("head", [20_000.0], rss_mb=900)[0]
    html = vitals_charts({"head": hours})
    assert "up to 900 MB" in html
    assert len(html) < 10_000


def test_who_has_told_nothing_has_no_chart():
    assert vitals_charts({}) == ""
    assert vitals_charts({"head": node("head", [0, 1], call_hz=9)}) == ""
    assert vitals_charts({"head": node("head", [0, 1, 2], call_hz=float("nan"))}) == ""
