"""The verifier of answers finds each kind of unsupported clause; answers to the questions of two runs reach records."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from ruamel.yaml import YAML

from evaluation.questions import QUESTIONS, REACHED, SEALED, asked, reaches
from evaluation.questions_check import Verifier
from evaluation.questions_runs import RUNS
from socialbot.runs.asking import answer
from socialbot.runs.folder import RecordedRun, open_run

Recorded = tuple[RecordedRun, Verifier]


@pytest.fixture(scope="module")
def visits(tmp_path_factory) -> Recorded:
    return recorded("visits", tmp_path_factory.mktemp("questions"))


@pytest.fixture(scope="module")
def guard(tmp_path_factory) -> Recorded:
    return recorded("guard", tmp_path_factory.mktemp("questions"))


def recorded(name: str, folder: Path) -> Recorded:
    RUNS[name](folder / name)
    return open_run(folder / name), Verifier(folder / name)


def told(run: RecordedRun, question: str) -> dict[str, Any]:
    return json.loads(msgspec.json.encode(answer(run, question)))


def change_claim(name: str, value: object) -> Callable[[dict[str, Any]], None]:
    return lambda found: found["clauses"][0]["claim"].update({name: value})


def change_text(old: str, new: str) -> Callable[[dict[str, Any]], None]:
    def change(found: dict[str, Any]) -> None:
        for part in (found, *found["clauses"]):
            part["text"] = part["text"].replace(old, new)

    return change


@pytest.mark.parametrize(
    ("question", "change"),
    [
        ("When did you offer help?", change_claim("at_s", 12.5)),
        ("When did you offer help?", change_claim("what", ["Good bye!"])),
        ("When did you offer help?", change_text("11.2", "12.2")),
        ("Wann hast du Hilfe angeboten?", change_text("11,2", "12,2")),
        ("When did you offer help?", change_text("person t1", "person t2")),
        ("When did you offer help?", change_text("offered", "never offered")),
        ("Did you offer help to t2?", change_text("only been here", "been here")),
        ("Did you help t2?", change_claim("persons", ["t1"])),
        ("Did you say goodbye?", change_claim("what", ["hello"])),
        ("How many people were here before 30 s?", change_claim("until_s", 40.0)),
        ("Why didn't you greet t3 at 36 s?", change_text("36", "46")),
        ("What do you see at 12 s?", change_claim("value", 5.0)),
        ("What do you see at 12 s?", change_claim("persons", ["t2"])),
        ("Who was here?", change_claim("until_s", 60.0)),
        ("How many people were here?", change_claim("value", 6.0)),
        ("How often did you offer help?", change_claim("value", 3.0)),
        ("What will you do next at 12 s?", change_claim("kind", "wanted")),
        ("Why did you greet t1?", lambda found: found["clauses"][1]["claim"].update(what=['stays("t1")'])),
        ("Why did you greet t1?", lambda found: found["clauses"][0].update(records=["nothing-1"])),
        ("Why did you greet t1?", lambda found: found.update(text=f"{found['text']} I like people.")),
        ("Why did you greet t1?", lambda found: found.update(clauses=[])),
    ],
)
def test_unsupported_clauses_are_found(visits, question, change):
    run, verifier = visits
    found = told(run, question)
    assert verifier.faults(found) == []
    changed = copy.deepcopy(found)
    change(changed)
    assert changed != found
    assert verifier.faults(changed) != []


@pytest.mark.parametrize("question", ["Did you let Ann in?", "Did you admit Ann?", "Why did you not admit Bob?"])
def test_a_goal_without_names_is_not_denied_of_those_that_it_was_for(guard, question):
    found = told(guard[0], question)
    assert "did_not" not in [clause["claim"]["kind"] for clause in found["clauses"]]


@pytest.mark.parametrize(
    "change",
    [change_claim("until_s", 30.0), lambda found: found["clauses"][0]["claim"].update(what=["admit"], persons=["Ann"])],
)
def test_denials_of_goals_are_unsupported(guard, change):
    run, verifier = guard
    found = told(run, "Did you check Bob before 10 s?")
    assert verifier.faults(found) == []
    change(found)
    assert verifier.faults(found) != []


@pytest.mark.parametrize(
    ("question", "kind", "change"),
    [
        ("What went wrong?", "failed", change_claim("what", ['fail("the badge is unknown")', "check", "no badge"])),
        ("What went wrong?", "failed", change_text("unknown", "forged")),
        ("Did anything fail before 20 s?", "nothing_failed", change_claim("until_s", 30.0)),
    ],
)
def test_unsupported_failures_are_found(guard, question, kind, change):
    run, verifier = guard
    found = told(run, question)
    assert [clause["claim"]["kind"] for clause in found["clauses"]] == [kind]
    assert verifier.faults(found) == []
    change(found)
    assert verifier.faults(found) != []


@pytest.mark.parametrize(("target", "is_reached"), [("people 4", True), ("times 3", True), ("times 4", False)])
def test_a_number_of_people_rests_on_the_deeds_that_were_done_to_them(visits, target, is_reached):
    run, verifier = visits
    assert reaches(answer(run, "How many people did you greet?"), target, verifier) is is_reached


@pytest.mark.slow
def test_answers_reach_the_right_records(tmp_path):
    parts = YAML(typ="safe").load(QUESTIONS.read_text("utf-8"))
    number = reached = 0
    misses: list[str] = []
    for name in ("visits", "guard", "hospital", "warehouse", "cleaner", "reception"):
        questions = [line for part, by_run in parts.items() if part not in SEALED for line in by_run.get(name, [])]
        right, wrong, unsupported, _ = asked(*recorded(name, tmp_path / name), questions, None)
        assert unsupported == []
        number, reached, misses = number + len(questions), reached + right, misses + wrong
    assert reached >= REACHED * number, misses
