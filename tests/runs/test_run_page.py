from __future__ import annotations

import re
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from socialbot.core.errors import RunError
from socialbot.runs.folder import open_run
from socialbot.runs.record import STOPPED
from socialbot.runs.report import page_of
from socialbot.runs.report_writer import write_report
from socialbot.runs.run import Picture
from tests.runs.pages import headings, read
from tests.runs.runs import greeting


class Grey:
    """A camera that sees grey; so much is enough for what lies over it."""

    def at(self, stamp: int) -> Picture | None:
        _, data = cv2.imencode(".jpg", np.full((480, 640, 3), 120, np.uint8))
        return Picture(stamp, data.tobytes())


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return greeting(tmp_path_factory.mktemp("run") / "waldo")


def results(folder: Path, copy: Path, **changes: object) -> Path:
    """A copy of a run with other results."""
    copy.mkdir()
    for name in ("trace.jsonl", "seen.jsonl", "graph.yaml"):
        (copy / name).symlink_to(folder / name)
    found = msgspec.json.decode((folder / "results.json").read_bytes())
    (copy / "results.json").write_bytes(msgspec.json.encode({**found, **changes}))
    return copy


def test_a_run_of_waldo_is_told_from_the_frame_to_the_word(folder):
    html = page_of(open_run(folder, Grey()), "Waldo").html()
    words = read(html)
    assert headings(html)[:3] == ["What went on when", "What was seen", "What was done, and why"]
    assert "1 person came into view. Waldo said “Hello! Nice to see you.”." in words
    assert 'personDetected("Yes")' in words
    assert "leads to “Hello! Nice to see you.”" in words
    assert words.count("the frame at 0.70 s showed person t1 4.0 m away") == 1
    assert "GreetPeople() / (greeted()) >> []" in words
    assert 1 <= html.count("data:image/jpeg;base64,") <= 8
    assert "t1 4.0 m" in words
    assert len(html) < 1_500_000


def test_without_pictures_it_is_told_all_the_same(folder):
    html = page_of(open_run(folder), "Waldo").html()
    read(html)
    assert "What was seen" not in headings(html)


@pytest.mark.parametrize(
    ("ended", "verdict", "said"),
    [
        ("well", "ended well", ""),
        (STOPPED, "stopped", "This run was stopped before its end."),
        ("detector: no model", "failed", "This run failed: detector: no model"),
    ],
)
def test_how_it_ended_stands_at_the_top(folder, tmp_path, ended, verdict, said):
    page = page_of(open_run(results(folder, tmp_path / "run", ended=ended)), "Waldo")
    assert (page.verdict, page.good) == (verdict, ended == "well")
    assert list(page.warnings) == ([said] if said else [])


def test_a_run_that_was_broken_off_says_so(folder, tmp_path):
    copy = results(folder, tmp_path / "run")
    (copy / "results.json").unlink()
    path = write_report(copy)
    html = path.read_text("utf-8")
    assert path == copy / "report.html"
    assert "broken off</span>" in html
    assert "results.json is missing" in read(html).split("What went on when")[0]


def test_scores_and_costs_are_told_where_they_are_known(folder, tmp_path):
    band = {"tp": 9, "fp": 1, "fn": 0, "precision": 0.9, "recall": 1.0, "f1": 0.947}
    told = {
        "scores": {"frames": 20, "missing_frames": 0, "bands": {"0-2 m": band, "2-10 m": band, "10-20 m": band}},
        "nodes": {"head": {"calls": 7, "failures": 0, "skipped": 3, "cpu_s": 1.25, "peak_rss_mb": 80.0}},
        "parameters": {"bdi_engine": {"range_m": 4.5}},
        "versions": {"python": "3.11"},
    }
    html = page_of(open_run(results(folder, tmp_path / "run", **told)), "Waldo").html()
    words = read(html)
    assert "0.947" in words
    assert 'class="rates"' in html
    assert re.search(r"head.* 7 .*3.*1\.2 s.*80 MB", words)
    assert "bdi_engine.range_m" in words
    assert "3.11" in words


def test_a_folder_without_a_run_is_an_error(tmp_path):
    with pytest.raises(RunError):
        write_report(tmp_path)


def test_a_run_in_which_nothing_happened_has_a_page(tmp_path):
    (tmp_path / "trace.jsonl").write_text("")
    assert "Nothing happened." in read(write_report(tmp_path).read_text("utf-8"))
