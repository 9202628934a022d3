"""The check of explanations finds each kind of false statement."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from msgspec.structs import replace

from evaluation.explanations import Check, checked, played
from socialbot.core.messages import TraceRecord

SEED = 7


@pytest.fixture(scope="module")
def visit(tmp_path_factory):
    return played(SEED, tmp_path_factory.mktemp("run") / "visit")


def test_statements_of_a_run_are_true(visit):
    check = checked(*visit)
    assert check.false == []
    assert min(check.counts.values()) > 0
    assert check.counts.total() > 100


def changed(visit, kind: str, change: Callable[[TraceRecord], TraceRecord | None]) -> list[str]:
    """The false statements after one record of a kind is changed."""
    run, seen = visit
    check, left = Check(seen, 6.0), 1
    for record in run.history:
        if record.source != "bdi_engine":
            continue
        other = change(record) if left and record.kind == kind else None
        left -= other is not None
        check.take(other or record)
    assert left == 0
    return check.false


def counted(record: TraceRecord) -> TraceRecord | None:
    return replace(record, what=record.what.replace(" of ", "1 of ")) if "was within" in record.what else None


def other_walk(record: TraceRecord) -> TraceRecord | None:
    what = record.what.replace("faces the robot", "walks past the robot at 2.0 m")
    return replace(record, what=what) if what != record.what else None


def later_since(record: TraceRecord) -> TraceRecord | None:
    matched = [dict(each) for each in record.detail.get("matched", ())]
    if not any("since" in each for each in matched):
        return None
    return replace(record, detail={**record.detail, "matched": [{**each, "since": 1} for each in matched]})


def other_reason(record: TraceRecord) -> TraceRecord | None:
    held = [{**each, "because": 'personDetected("Yes") does not hold'} for each in record.detail.get("rejected", ())]
    is_there = record.what.startswith(("+stays", "+engages", "GreetPeople"))
    return replace(record, detail={**record.detail, "rejected": held}) if held and is_there else None


@pytest.mark.parametrize(
    ("kind", "change", "found"),
    [
        ("percept", counted, "reasons of sensors"),
        ("percept", other_walk, "reasons of sensors"),
        ("plan", later_since, "conditions that hold"),
        ("plan", other_reason, "conditions that do not hold"),
        ("belief", lambda record: replace(record, what="sunny()"), "beliefs that end"),
    ],
)
def test_false_statement_is_found(visit, kind, change, found):
    false = changed(visit, kind, change)
    assert any(each.startswith(found) for each in false), false


def test_changed_order_of_rules_is_found(visit):
    run, seen = visit
    check = Check(seen, 6.0)
    for record in run.history:
        if record.source == "bdi_engine":
            check.take(record)
    chosen = next(record for record in run.history if record.kind == "plan" and record.detail.get("later"))
    later = list(chosen.detail["later"])
    detail = {**chosen.detail, "rejected": [{"plan": one, "because": "it rains"} for one in later], "later": []}
    check.take(replace(chosen, detail=detail))
    assert any(each.startswith("order of rules") for each in check.false)
