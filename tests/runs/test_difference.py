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


# Decisions


def test_a_run_decides_as_itself():
    found = compare(DETOUR, DETOUR)
    assert found.exact
    assert found.same
    assert "21 decisions" in found.told


def test_records_that_are_no_decisions_do_not_count():
    assert compare(DETOUR, (*DETOUR, record(9, "ann", "belief", "p"))).exact


def test_other_times_are_the_same_in_order_only():
    late = [msgspec.structs.replace(each, stamp=each.stamp + 1, id="other") for each in DETOUR]
    found = compare(DETOUR, late)
    assert found.same
    assert not found.exact
    assert "in the same order" in found.told


def test_what_agents_do_side_by_side_may_come_in_another_order():
    others = sorted(DETOUR, key=lambda each: each.source)
    assert compare(DETOUR, others).same


@pytest.mark.parametrize(
    ("kind", "told"),
    [("step", HALL), ("plan_start", "be_home"), ("plan_end", "be_home"), ("desire_fulfilled", "be_home")],
)
def test_a_decision_that_is_missing_is_named(kind, told):
    missing = next(each for each in DETOUR if (each.kind, each.source, each.what) == (kind, "ann", told))
    found = compare(DETOUR, [each for each in DETOUR if each is not missing])
    assert not found.same
    assert found.difference.startswith("ann")
    assert found.told.startswith("Decisions differ")


def test_another_plan_is_a_difference():
    changed = [
        msgspec.structs.replace(each, detail={**each.detail, "steps": ["0.000: (fly ann) [1.000]"]})
        if each.kind == "plan_start"
        else each
        for each in DETOUR
    ]
    assert "fly" in compare(DETOUR, changed).difference


def test_decisions_that_are_new_are_named():
    found = compare(DETOUR[:-1], DETOUR)
    assert "only there now" in found.difference
