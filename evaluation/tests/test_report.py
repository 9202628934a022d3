import json

import pytest
from rich.console import Console

from evaluation.report import Figure, Report, percentile
from socialbot.core.errors import SocialbotError
from tests.runs.pages import headings, read


@pytest.mark.parametrize(
    ("value", "required", "ok"),
    [
        (14.9, 15.0, True),
        (15.1, 15.0, False),
        (0, 0, True),
        (1, 0, False),
        (None, 15.0, False),
        (7.0, None, None),
        (True, True, True),
        (False, True, False),
        (None, True, False),
    ],
)
def test_a_figure_is_held_against_what_is_required(value, required, ok):
    assert Figure("key", "text", value, required).ok is ok


def test_a_percentile_is_a_value_that_occurred():
    values = [float(value) for value in range(100, 0, -1)]
    assert percentile(values, 0.5) == 51.0
    assert percentile(values, 0.99) == 100.0
    assert percentile([3.0], 1.0) == 3.0
    assert percentile([], 0.5) is None


@pytest.fixture
def report() -> Report:
    report = Report("sample", quick=True)
    report.add("latency_p99_ms", "latency", 20.5, 15.0)
    report.add("frames_lost", "lost", 0, 0)
    report.add("actions", "actions", None)
    report.tables["nodes"] = {"camera": {"peak_rss_mb": 80.0, "cpu_share": None}, "agent": {"peak_rss_mb": 60.0}}
    return report


def test_the_json_has_each_figure_under_its_key_and_names_what_is_unmet(report, tmp_path, capsys):
    report.finish(tmp_path / "figures.json")
    content = json.loads((tmp_path / "figures.json").read_text("utf-8"))
    assert (content["latency_p99_ms"], content["frames_lost"], content["actions"]) == (20.5, 0, None)
    assert content["required"] == {"latency_p99_ms": 15.0, "frames_lost": 0}
    assert content["unmet"] == ["latency_p99_ms"]
    assert content["nodes"]["camera"]["peak_rss_mb"] == 80.0
    assert content["quick"] is True
    assert content["machine"]["cores"] >= 1
    assert "python" in content["machine"]["versions"]
    assert "at most 15" in capsys.readouterr().out


def test_the_table_shows_value_requirement_and_verdict(report):
    console = Console(record=True, width=110)
    report.show(console)
    lines = console.export_text().splitlines()
    assert any(line.split() == ["latency", "20.5", "at", "most", "15", "no"] for line in lines)
    assert any(line.split() == ["lost", "0", "at", "most", "0", "ok"] for line in lines)
    assert any(line.split() == ["camera", "80", "-"] for line in lines)


def test_a_file_that_cannot_be_written_is_an_error_for_the_user(report, tmp_path):
    with pytest.raises(SocialbotError, match="cannot be written"):
        report.finish(tmp_path / "nowhere" / "figures.json")


def test_beside_the_json_there_is_a_page(report, tmp_path, capsys):
    report.tables["<b>by rate"] = {f"{rate} %": {"seconds": rate / 7, "how": "well"} for rate in (0, 10, 50)}
    report.finish(tmp_path / "figures.json")
    html = (tmp_path / "figures.html").read_text("utf-8")
    words = read(html)
    assert headings(html) == ["Figures", "nodes", "&lt;b&gt;by rate", "Measurement conditions"]
    assert "1 of 2 requirements are met; not met: latency_p99_ms." in words
    for told in ("latency", "20.5", "at most 15", "80", "python -m", "numpy"):
        assert told in words
    assert html.count('<figure class="plot">') == 1
