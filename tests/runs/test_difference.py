"""Comparison of two runs."""

from __future__ import annotations

import msgspec
import pytest

from socialbot.runs.difference import compare, difference
from socialbot.runs.folder import RecordedRun, open_run
from tests.runs.deliberating_runs import DETOUR, HALL, record
from tests.runs.runs import greeting


@pytest.fixture(scope="module")
def early(tmp_path_factory) -> RecordedRun:
    return open_run(greeting(tmp_path_factory.mktemp("run") / "early"))


@pytest.fixture(scope="module")
def late(tmp_path_factory) -> RecordedRun:
    return open_run(greeting(tmp_path_factory.mktemp("run") / "late", comes=8))


def test_equal_runs_have_no_difference(early):
    found = difference(early, early)
    assert (found.same, found.decisions, found.settings) == (True, (1, 1), ())
    assert list(found.text()) == ["Both runs decide the same, at the same times: 1 decisions."]


def test_first_different_decision(early, late):
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


def test_missing_decision_of_a_run(early, tmp_path):
    nobody = open_run(greeting(tmp_path / "empty", comes=100))
    found = difference(early, nobody)
    assert found.sides is not None
    assert [side.why is None for side in found.sides] == [False, True]
    assert "  nothing more is decided." in list(found.text())


def test_different_settings_are_listed(early, tmp_path):
    changed = open_run(greeting(tmp_path / "early"))
    changed.results = {**changed.results, "parameters": {"bdi_engine": {"range_m": 5.0}}}
    found = difference(early, changed)
    assert [(each.name, each.first, each.second) for each in found.settings] == [("bdi_engine.range_m", 6.0, 5.0)]
    assert "  bdi_engine.range_m: 6.0 | 5.0" in list(found.text())


def test_settings_of_a_run_that_goes_on_are_not_known(early, tmp_path):
    unfinished = greeting(tmp_path / "run")
    (unfinished / "results.json").unlink()
    assert difference(early, open_run(unfinished)).settings == ()


# Decisions


def test_comparison_of_equal_decisions():
    found = compare(DETOUR, DETOUR)
    assert found.exact
    assert found.same
    assert "21 decisions" in found.text


def test_comparison_ignores_other_records():
    assert compare(DETOUR, (*DETOUR, record(9, "ann", "belief", "p"))).exact


def test_comparison_with_other_times():
    late = [msgspec.structs.replace(each, stamp=each.stamp + 1, id="other") for each in DETOUR]
    found = compare(DETOUR, late)
    assert found.same
    assert not found.exact
    assert "in the same order" in found.text


def test_comparison_ignores_the_order_of_agents():
    others = sorted(DETOUR, key=lambda each: each.source)
    assert compare(DETOUR, others).same


@pytest.mark.parametrize(
    ("kind", "told"),
    [("step", HALL), ("plan_start", "be_home"), ("plan_end", "be_home"), ("desire_fulfilled", "be_home")],
)
def test_comparison_names_a_missing_decision(kind, told):
    missing = next(each for each in DETOUR if (each.kind, each.source, each.what) == (kind, "ann", told))
    found = compare(DETOUR, [each for each in DETOUR if each is not missing])
    assert not found.same
    assert found.difference.startswith("ann")
    assert found.text.startswith("Decisions differ")


def test_comparison_names_another_plan():
    changed = [
        msgspec.structs.replace(each, detail={**each.detail, "steps": ["0.000: (fly ann) [1.000]"]})
        if each.kind == "plan_start"
        else each
        for each in DETOUR
    ]
    assert "fly" in compare(DETOUR, changed).difference


def test_comparison_names_a_new_decision():
    found = compare(DETOUR[:-1], DETOUR)
    assert "only there now" in found.difference
