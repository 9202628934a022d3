"""Names in questions: of people, misheard ones, and ones without their letter."""

from __future__ import annotations

from functools import partial

import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.runs.asking import answer, answer_heard, words_of_names
from socialbot.runs.history import History
from socialbot.runs.run import RunView
from tests.runs.asking.waldo_run import two_visitors
from tests.runs.asking.written_runs import run_of_deeds

DEEDS = (
    ("crane_a", "lift(crane_a, crate_b1, pier_1)"),
    ("crane_a", "lower(crane_a, crate_b1, truck_a)"),
    ("truck_a", "drive(truck_a, pier_1, depot_a)"),
    ("scout_a", "go(scout_a, pier_2)"),
    ("guard_a", 'check("Ann")'),
    ("crane_a", "turn(crane_a, pier_1)"),
)


@pytest.fixture(scope="module")
def harbour() -> RunView:
    """Return a run of four agents without a camera, a deed each second."""
    return run_of_deeds(DEEDS)


@pytest.mark.parametrize(
    "question",
    [
        "Was Ann here?",
        "Was a person called Ann here?",
        "Did somebody named Ann come?",
        "War jemand namens Ann hier?",
        "Une personne nommée Ann est-elle venue ?",
        "¿Vino una persona llamada Ann?",
    ],
)
def test_a_person_whom_no_camera_saw_was_here_as_the_deeds_tell(harbour, question):
    found = answer(harbour, question)
    assert [clause.records for clause in found.clauses] == [("guard_a-4",)], found.text


@pytest.mark.parametrize("question", ["Was Eve here?", "Was a person called Eve here?", "Who tickled Ann?"])
def test_a_person_whom_no_record_names_was_not_here(harbour, question):
    assert not answer(harbour, question).known


def test_a_name_without_its_letter_is_the_thing_that_the_deed_has():
    """Another deed has a base without a letter."""
    calls = (
        ("gripper_a", "push(gripper_a, carrier_b, base_b)"),
        ("carrier_b", "move(carrier_b, deposit, base)"),
    )
    run = run_of_deeds(calls)
    assert answer(run, "Who pushed carrier b to the base?").clauses[0].records == ("gripper_a-0",)
    assert answer(run, "Who moved to the base?").clauses[0].records == ("carrier_b-1",)


def test_an_agent_may_be_the_thing_of_an_event(harbour):
    found = answer(harbour, "What happened right after crate B1 was loaded on the truck?")
    assert found.clauses[0].records == ("truck_a-2",), found.text


@pytest.mark.parametrize(
    ("heard", "taken"),
    [
        ("Where did Scott go?", "Where did scout go?"),
        ("Where did Simon go?", "Where did Simon go?"),
        ("Where did the crane turn?", "Where did the crane turn?"),
    ],
)
def test_an_unknown_word_is_taken_for_the_name_of_the_same_sound(harbour, heard, taken):
    text, found = answer_heard([heard], partial(answer, harbour), words_of_names(harbour))
    assert text == taken
    assert found == answer(harbour, taken)


def test_what_was_written_is_not_taken_for_a_name_of_the_same_sound(harbour):
    assert not answer(harbour, "Where did Scott go?").known


def test_a_number_of_seconds_may_be_recognised_in_two_parts():
    history = History(
        TraceRecord(stamp=n * SECOND, id=f"robot-{n}", source="robot", kind="action", what=f"step{n}()")
        for n in (0, 90, 101, 110)
    )
    found = answer(RunView(None, history, None), "What did you do at 100 1 seconds?")
    assert [clause.records for clause in found.clauses] == [("robot-101",)]


@pytest.fixture(scope="module")
def visits() -> RunView:
    return two_visitors()


@pytest.mark.parametrize(
    "question",
    [
        "Did you greet t9?", "Why did you greet t9?", "was t9 here", "When did T9 leave?", "how long did t9 stay",
        "Hast du t9 begrüßt?", "War t9 hier?", "As-tu salué t9 ?", "¿Saludaste a t9?", "Did you greet p1?",
    ],
)  # fmt: skip
def test_ids_that_the_run_does_not_have_are_nobody_else(visits, question):
    found = answer(visits, question)
    assert not found.known
    assert not found.options
    assert [clause.claim.what[0] for clause in found.clauses] == ["p1" if "p1" in question else "t9"]
