from __future__ import annotations

import pytest

from socialbot.runs.difference import difference
from socialbot.runs.folder import RecordedRun, open_run
from tests.runs.runs import greeting


@pytest.fixture(scope="module")
def early(tmp_path_factory) -> RecordedRun:
    return open_run(greeting(tmp_path_factory.mktemp("run") / "early"))


@pytest.fixture(scope="module")
def late(tmp_path_factory) -> RecordedRun:
    return open_run(greeting(tmp_path_factory.mktemp("run") / "late", comes=8))


def test_a_run_is_the_same_as_itself(early):
    found = difference(early, early)
    assert (found.same, found.decisions, found.settings) == (True, (1, 1), ())
    assert list(found.text()) == ["Both runs decide the same, at the same times: 1 decisions."]


def test_the_first_decision_that_differs_is_told_with_where_the_runs_part(early, late):
    found = difference(early, late)
    assert (found.same, found.number, found.agent, found.only_time) == (False, 1, "Waldo", True)
    text = "\n".join(found.text())
    assert "Decision 1 of Waldo comes out the same, but at another time." in text
    assert "\nWaldo: early:\nAt 0." in text
    detections, beliefs = found.causes
    assert (detections.what, detections.first_s, detections.second_s) == ("detections", 0.5, 0.5)
    assert "Waldo: early: at 0.50 s the frame at 0.50 s showed person t1 4.0 m away" in text
    assert "Waldo: late: at 0.50 s the frame at 0.50 s showed nobody" in text
    assert beliefs.what == "beliefs of Waldo"


def test_a_run_that_decides_less(early, tmp_path):
    nobody = open_run(greeting(tmp_path / "empty", comes=100))
    found = difference(early, nobody)
    assert found.sides is not None
    assert [side.why is None for side in found.sides] == [False, True]
    assert "  nothing more is decided." in list(found.text())


def test_what_was_set_differently_is_named(early, tmp_path):
    changed = open_run(greeting(tmp_path / "early"))
    changed.results = {**changed.results, "parameters": {"bdi_engine": {"range_m": 5.0}}}
    found = difference(early, changed)
    assert [(each.name, each.first, each.second) for each in found.settings] == [("bdi_engine.range_m", 6.0, 5.0)]
    assert "  bdi_engine.range_m: 6.0 | 5.0" in list(found.text())
