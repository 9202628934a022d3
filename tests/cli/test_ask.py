from __future__ import annotations

import json

import pytest
import typer
from typer.testing import CliRunner

from socialbot.cli.ask import ask
from socialbot.core.errors import ParameterError, SocialbotError
from tests.runs.runs import greeting

app = typer.Typer()
app.command()(ask)


def told(*arguments: object) -> str:
    """Return the output. Exceptions of the command pass through."""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if isinstance(done.exception, SocialbotError):
        raise done.exception
    assert done.exit_code == 0
    return done.stdout


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return greeting(tmp_path_factory.mktemp("run") / "waldo")


def test_answers_a_question(run):
    assert told(run, "Why did you greet me?").startswith("At 0.7 s I greeted you because you paid attention to me")


def test_the_newest_run_is_the_default(run, monkeypatch, tmp_path):
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "one").symlink_to(run)
    monkeypatch.chdir(tmp_path)
    assert told("When did you greet somebody?") == "At 0.7 s I greeted person t1.\n"
    assert told("I was in the room. " * 20 + "When did you greet somebody?")  # no name of a file is that long


def test_prints_the_clauses_with_their_records(run):
    found = json.loads(told(run, "Did you greet t1?", "--json"))
    records = {json.loads(line)["id"] for line in (run / "trace.jsonl").read_text().splitlines()}
    assert (found["intent"], found["known"]) == ("did", True)
    assert {id for clause in found["clauses"] for id in clause["records"]} <= records


def test_a_rule_that_nothing_triggered_is_a_reason(tmp_path):
    deserted = greeting(tmp_path / "deserted", comes=99)
    assert told(deserted, "Why did you not greet anybody?").startswith("I did not greet anybody because")


def test_the_closest_readings_of_an_unclear_question_are_told(run):
    assert told(run, "What about the first visitor?").splitlines() == [
        "Do you ask what I did at 0.7 s, or what I said at 0.7 s?",
        "",
        "    what I did at 0.7 s: At 0.7 s I greeted person t1.",
        '    what I said at 0.7 s: At 0.7 s I said "Hello! Nice to see you.".',
    ]


def test_says_what_can_be_asked_instead(run):
    lines = told(run, "Where is the exit?").splitlines()
    assert lines[0].startswith('I don\'t know. The record does not mention "exit". I can tell why I')
    assert "    Why did you greet?" in lines


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--at", "99", "What do you see?"], "does not contain 99.00 s"),
        (["--agent", "r2d2", "What do you see?"], "no agent 'r2d2'"),
        ([" "], "no question"),
    ],
)
def test_bad_input(run, arguments, message):
    with pytest.raises(ParameterError, match=message):
        told(run, *arguments)
