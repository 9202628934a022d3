from __future__ import annotations

import msgspec
import pytest

from socialbot.runs.decisions import compare
from tests.runs.deliberating_runs import DETOUR, HALL, record


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
