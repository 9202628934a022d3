"""Questions about plans: their steps, why there was a new one, and how they ended."""

from __future__ import annotations

import msgspec
import pytest

from socialbot.runs.asking import answer
from socialbot.runs.folder import RecordedRun, open_run
from tests.runs.asking.written_runs import faults, write_run
from tests.runs.deliberating_runs import plan, plan_end, record

STEPS = ("(go ann dock hall)", "(clean ann hall)", "(go ann hall attic)", "(clean ann attic)")
RECORDS = [
    record(0.0, "ann", "belief", "at(ann, dock)"),
    plan(1.0, "ann", "clean_rooms", 1, *STEPS),
    record(1.0, "ann", "action", "go(ann, dock, hall)", id="went"),
    plan_end(8.0, "ann", "clean_rooms", 1, "failed", "the door is locked"),
    plan(8.0, "ann", "clean_rooms", 2, "(clean ann hall)", "(go ann hall dock)"),
    record(8.0, "ann", "action", "clean(ann, hall)", id="cleaned"),
    plan(9.0, "bob", "water_plants", 1, "(pour bob)"),
    plan_end(10.0, "bob", "water_plants", 1, "succeeded"),
    plan_end(20.0, "ann", "clean_rooms", 2, "succeeded"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("run") / "ann", RECORDS)


@pytest.fixture(scope="module")
def run(folder) -> RecordedRun:
    return open_run(folder)


@pytest.mark.parametrize(
    ("question", "claims"),
    [
        ("What was the first step of the plan to clean the rooms?", [("step", "(clean ann hall)", 1)]),
        ("What was the last step of ann's plan?", [("step", "(go ann hall dock)", 2)]),
        ("At 5 s, what was step 3 of the plan for clean_rooms?", [("step", "(go ann hall attic)", 3)]),
        ("Wie lautet der zweite Schritt deines Plans für clean_rooms?", [("step", "(go ann hall dock)", 2)]),
        ("Quelle était la première étape de ton plan clean_rooms ?", [("step", "(clean ann hall)", 1)]),
        ("¿Cuál fue el último paso del plan clean_rooms?", [("step", "(go ann hall dock)", 2)]),
        (
            "How many steps did the plan for clean_rooms have?",
            [("step_count", "clean_rooms", 2), ("step", "(clean ann hall)", 1), ("step", "(go ann hall dock)", 2)],
        ),
        ("What was the first step of your plan?", [("step", "(clean ann hall)", 1), ("step", "(pour bob)", 1)]),
    ],
)
def test_steps_of_plans_are_told_by_number(run, folder, question, claims):
    found = answer(run, question)
    told = [(clause.claim.kind, clause.claim.what[0], clause.claim.value) for clause in found.clauses]
    assert told == claims, found.text
    assert not faults(folder, found)


@pytest.mark.parametrize(
    "question", ["What was step 9 of ann's plan?", "What is the first step of your plan to bake a cake?"]
)
def test_steps_and_plans_that_no_record_has_are_refused(run, question):
    assert not answer(run, question).known


@pytest.mark.parametrize(
    "question",
    [
        "Why did you replan?",
        "Why did ann need a new plan?",
        "When did you make another plan?",
        "What made you change your plan?",
        "Warum hast du einen neuen Plan gemacht?",
        "Pourquoi as-tu changé de plan ?",
        "¿Por qué cambiaste de plan?",
    ],
)
def test_a_new_plan_is_explained_by_the_end_of_the_last_one(run, folder, question):
    found = answer(run, question)
    [clause] = found.clauses
    assert clause.claim.what == ("clean_rooms", "failed", "the door is locked")
    assert not faults(folder, found)


def test_who_had_no_new_plan_had_no_reason_for_one(run):
    assert not answer(run, "Why did bob need a new plan?").known


@pytest.mark.parametrize("change", [{"value": 2.0}, {"what": ("(go ann dock hall)", "clean_rooms")}])
def test_a_false_step_is_found_by_the_verifier(run, folder, change):
    found = answer(run, "What was the first step of the plan for clean_rooms?")
    [clause] = found.clauses
    claim = msgspec.structs.replace(clause.claim, **change)
    assert faults(folder, msgspec.structs.replace(found, clauses=(msgspec.structs.replace(clause, claim=claim),)))


@pytest.mark.parametrize(
    ("question", "text"),
    [
        ("How did the plan end?", "At 20 s the plan for clean_rooms succeeded."),
        ("Did the mission succeed?", "At 20 s the plan for clean_rooms succeeded."),
        ("What was the outcome of the first plan?", "At 8 s the plan for clean_rooms failed: the door is locked."),
        ("What went wrong?", "At 8 s the plan for clean_rooms failed: the door is locked."),
    ],
)
def test_ends_of_plans_are_told_with_their_reason(run, folder, question, text):
    found = answer(run, question)
    assert found.text == text
    [clause] = found.clauses
    assert clause.claim.kind == "plan_ended"
    assert run.history.find(clause.records[0]).kind == "plan_end"
    assert not faults(folder, found)


def test_a_false_end_is_found_by_the_verifier(run, folder):
    found = answer(run, "How did the plan end?")
    [clause] = found.clauses
    claim = msgspec.structs.replace(clause.claim, what=("clean_rooms", "failed", ""))
    false = msgspec.structs.replace(found, clauses=(msgspec.structs.replace(clause, claim=claim),))
    assert faults(folder, false)


@pytest.mark.parametrize(
    ("question", "text"),
    [
        ("How did the plan sort_boxes end?", "At 10 s the plan for sort_boxes succeeded."),
        ("When did the plan for sort_boxes end?", "At 10 s the plan for sort_boxes succeeded."),
        ("Wann war der Plan sort_boxes zu Ende?", "Bei 10 s: der Plan für sort_boxes endete: succeeded."),
        ("When was sort_boxes_again finished?", "At 15 s the plan for sort_boxes_again succeeded."),
        ("When did the plan end?", "At 20 s the plan for go_home succeeded."),
    ],
)
def test_a_plan_that_is_named_is_no_other_one(tmp_path, question, text):
    goals = {"sort_boxes": 10.0, "sort_boxes_again": 15.0, "go_home": 20.0}
    records = [record(0.0, "ann", "action", "pickup(ann, box_a1)", id="picked")]
    for number, (goal, end) in enumerate(goals.items(), 1):
        records += [
            plan(end - 5.0, "ann", goal, number, "(go ann hall)"),
            plan_end(end, "ann", goal, number, "succeeded"),
        ]
    assert answer(open_run(write_run(tmp_path / "run", records)), question).text == text
