"""Questions about beliefs."""

from __future__ import annotations

import pytest

from socialbot.core.messages import TraceRecord
from socialbot.runs.asking import answer
from socialbot.runs.folder import RecordedRun, open_run
from tests.runs.asking.written_runs import faults, write_run
from tests.runs.deliberating_runs import plan, plan_end, record


def _believe(at: float, what: str, id: str) -> TraceRecord:
    return record(at, "ann", "belief", what, id=id)


def _forget(at: float, what: str) -> TraceRecord:
    return record(at, "ann", "unbelief", what)


RECORDS = [
    _believe(0.0, "battery_charge(ann, 90)", "full"),
    _believe(0.0, "at(ann, dock)", "docked"),
    plan(1.0, "ann", "clean_rooms", 1, "(go ann dock hall)"),
    record(1.0, "ann", "action", "go(ann, dock, hall)", id="went"),
    _forget(2.0, "at(ann, dock)"),
    _believe(6.0, "at(ann, hall)", "arrived"),
    _forget(6.0, "battery_charge(ann, 90)"),
    _believe(6.0, "battery_charge(ann, 40)", "low"),
    plan_end(8.0, "ann", "clean_rooms", 1, "failed", "the door is locked"),
    plan(9.0, "ann", "clean_rooms", 2, "(go ann hall dock)"),
    plan_end(20.0, "ann", "clean_rooms", 2, "succeeded"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("run") / "ann", RECORDS)


@pytest.fixture(scope="module")
def run(folder) -> RecordedRun:
    return open_run(folder)


@pytest.mark.parametrize(
    ("question", "text", "records"),
    [
        ("How full was the battery at 3 s?", "At 3 s I believed battery_charge(ann, 90).", ["full"]),
        ("How full was the battery at 7 s?", "At 7 s I believed battery_charge(ann, 40).", ["low"]),
        ("What was the battery level?", "At 20 s I believed battery_charge(ann, 40).", ["low"]),
        ("Wie voll war der Akku bei 3 s?", "Bei 3 s: ich glaubte battery_charge(ann, 90).", ["full"]),
        ("¿Cómo de llena estaba la batería a los 7 s?", "A los 7 s yo creía battery_charge(ann, 40).", ["low"]),
        ("Where were you at 1 s?", "At 1 s I believed at(ann, dock).", ["docked"]),
        ("Where did you believe you were at 10 s?", "At 10 s I believed at(ann, hall).", ["arrived"]),
    ],
)
def test_beliefs_are_told_with_their_record(run, folder, question, text, records):
    found = answer(run, question)
    assert (found.intent, found.text) == ("believed", text)
    assert [each for clause in found.clauses for each in clause.records] == records
    assert not faults(folder, found)


def test_nothing_is_told_of_a_time_without_the_belief(run):
    found = answer(run, "Where did you believe you were at 4 s?")
    assert not any(clause.claim.kind == "believed" for clause in found.clauses)
