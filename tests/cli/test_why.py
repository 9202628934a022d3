from __future__ import annotations

import itertools
import json
import re

import pytest
import typer
from typer.testing import CliRunner

from socialbot.cli.diff import diff
from socialbot.cli.report import report
from socialbot.cli.why import _absent, seconds_of, why
from socialbot.core.errors import ParameterError, RunError, SocialbotError
from tests.runs.runs import greeting, long_run

app = typer.Typer()
app.command()(why)
app.command()(diff)
app.command()(report)


def ask(*arguments: object) -> tuple[int, str]:
    """Return the exit code and the output. Exceptions of the command pass through."""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if isinstance(done.exception, SocialbotError):
        raise done.exception
    return done.exit_code, done.stdout


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return greeting(tmp_path_factory.mktemp("run") / "waldo")


@pytest.fixture(scope="module")
def later(tmp_path_factory):
    return greeting(tmp_path_factory.mktemp("run") / "later", comes=8)


def test_explains_the_last_action(run):
    code, told = ask("why", run)
    assert code == 0
    assert 'Waldo said "Hello! Nice to see you.",\n  because it did speak("greeting"),' in told
    assert "    not by GreetPeople() / (several()) >> [" in told
    assert ask("why", run, "--action", 1) == ask("why", run, "--at", "1.2") == (0, told)


def test_newest_run_is_the_default(run, monkeypatch, tmp_path):
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "one").symlink_to(run)
    monkeypatch.chdir(tmp_path)
    assert ask("why") == ask("why", run)


def test_lists_actions_by_number(run):
    code, told = ask("why", run, "--list")
    (line,) = told.splitlines()
    assert (code, line.split()[0], line.endswith('Waldo said "Hello! Nice to see you."')) == (0, "1", True)


def test_explains_a_rejected_plan(run):
    code, told = ask("why", run, "--not", "several")
    assert code == 0
    assert told.splitlines()[1].endswith("for GreetPeople(): several() does not hold")
    assert "  chosen each time" in ask("why", run, "--not", '[speak("greeting"), for_each(')[1]


@pytest.fixture(scope="module")
def deserted(tmp_path_factory):
    return greeting(tmp_path_factory.mktemp("run") / "deserted", comes=99)


def test_explains_a_rule_that_nothing_triggered(deserted):
    code, told = ask("why", deserted, "--not", 'speak("offer")')
    lines = re.sub(r"waldo\.py:\d+", "waldo.py:LINE", told).splitlines()
    assert code == 0
    assert lines[0] == "This run considered no such rule. The agents have these, as they are now:"
    assert lines[1].startswith("OfferHelp() >> [")
    assert lines[2] == "  not triggered: the goal OfferHelp() was not adopted in this run"
    triggers = {line.partition(" / ")[0]: then for line, then in itertools.pairwise(lines[3:]) if line[0] == "+"}
    assert triggers["+engages(Who)"] == "  not triggered: +engages(Who) did not occur in this run"
    assert all("waldo.py:LINE), which leads to OfferHelp()" in line for line in lines[3::2])
    assert json.loads(ask("why", deserted, "--not", 'speak("offer")', "--json")[1])[0]["occurred_s"] == []


def test_unknown_plan_names_the_rules_of_the_agents(deserted):
    with pytest.raises(RunError, match=r"no plan 'dance' was ever considered(.|\n)*OfferHelp\(\) >> \["):
        ask("why", deserted, "--not", "dance")


def test_time_without_decision_is_said(run):
    code, told = ask("why", run, "--at", "0.05")
    assert (code, told.startswith("Nothing was decided at 0.05 s; the next decision was at 0.")) == (0, True)
    assert json.loads(ask("why", run, "--at", "0.05", "--json")[1]) == []


def test_explains_a_rejected_plan_at_a_time(run):
    code, told = ask("why", run, "--not", "several", "--at", "1.0")
    assert (code, "several() does not hold" in told) == (0, True)
    code, told = ask("why", run, "--not", "several", "--at", "0.05")
    assert code == 0
    assert "0.05 s: the goal GreetPeople() was not adopted then; next at 0." in told
    assert "0.05 s: +engages(Who) did not occur then; next at 0." in told
    assert told.splitlines()[-1].startswith("  the frame at 0.0")


@pytest.mark.parametrize(
    ("plan", "absent"),
    [
        ("+near(Who) / (free()) >> [greet(Who)]", "+near(Who) did not occur"),
        ("greet(Who) / (free()) >> []", "the goal greet(Who) was not adopted"),
        ("+!greet(Who) : free <- say(hello).", "+!greet(Who) did not occur"),
        ("wet", "its event did not occur"),
    ],
)
def test_event_of_a_plan_is_named(plan, absent):
    assert _absent(plan) == absent


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--action", 7], "there is no action 7"),
        (["--at", "99"], "the run does not contain 99.00 s"),
        (["--not", "dance"], "no plan 'dance' was ever considered"),
    ],
)
def test_refuses_unknown_actions_and_times(run, options, message):
    with pytest.raises(RunError, match=message) as caught:
        ask("why", run, *options)
    assert (caught.value.exit_code, bool(caught.value.remedy)) == (3, True)


def test_refuses_several_questions(run):
    with pytest.raises(ParameterError, match="these options do not combine"):
        ask("why", run, "--action", 1, "--at", "3")


def test_run_without_actions(tmp_path):
    empty = greeting(tmp_path / "empty", comes=100)
    assert ask("why", empty, "--list") == (0, "the run has no actions\n")
    with pytest.raises(RunError, match="the run has no actions"):
        ask("why", empty)


def test_a_run_contains_the_time_after_its_last_record(tmp_path):
    quiet = greeting(tmp_path / "quiet")
    file = quiet / "results.json"
    results = json.loads(file.read_text()) if file.exists() else {}
    file.write_text(json.dumps({**results, "seconds": 100.0, "bag": {}}))
    code, told = ask("why", quiet, "--at", "99")
    assert (code, told.startswith("Nothing was decided at 99.00 s; the last decision was at")) == (0, True)
    with pytest.raises(RunError, match=r"does not contain 100.50 s") as caught:
        ask("why", quiet, "--at", "100.5")
    assert "from 0 to 100.00 s" in str(caught.value.remedy)


def test_times_are_seconds_or_minutes_and_seconds():
    assert (seconds_of("8.9"), seconds_of("1:23.4"), seconds_of("0:05")) == (8.9, 83.4, 5.0)
    for wrong in ("soon", "1:2:3", "", "1.5:2"):
        with pytest.raises(ParameterError, match="is not a time"):
            seconds_of(wrong)


def test_answers_as_json(run, later):
    (explanation,) = json.loads(ask("why", run, "--json")[1])
    assert explanation["chain"][0]["sentence"] == 'Waldo said "Hello! Nice to see you."'
    assert json.loads(ask("why", run, "--not", "several", "--json")[1])[0]["chosen_s"] == []
    assert json.loads(ask("why", run, "--list", "--json")[1])[0]["kind"] == "utterance"
    assert json.loads(ask("diff", run, later, "--json")[1])["same"] is False


def test_exit_code_of_different_runs(run, later):
    assert ask("diff", run, run) == (0, "Both runs decide the same, at the same times: 1 decisions.\n")
    code, told = ask("diff", run, later)
    assert code == 1
    assert "Decision 1 of Waldo comes out the same, but at another time." in told
    assert "detections differ first:" in told


def test_writes_page_of_two_runs(run, later, tmp_path):
    assert ask("diff", run, later, "--html", tmp_path / "both.html")[0] == 1
    assert "First different decision" in (tmp_path / "both.html").read_text("utf-8")


def test_writes_page_of_a_run_again(run):
    code, told = ask("report", run)
    assert (code, told.split()) == (0, [str(run / "report.html")])
    assert "Hello! Nice to see you." in (run / "report.html").read_text("utf-8")


def test_explains_a_run_with_a_trimmed_beginning(tmp_path):
    folder = long_run(tmp_path / "long", visits=6, max_bytes=500_000)
    code, told = ask("why", folder, "--list")
    assert code == 0
    actions = told.splitlines()
    assert 2 <= len(actions) <= 10
    for number in range(1, len(actions) + 1):
        code, told = ask("why", folder, "--action", number)
        assert (code, told.splitlines()[0].startswith("At ")) == (0, True)
    assert ask("diff", folder, folder)[0] == 0
    code, told = ask("report", folder)
    assert code == 0
    assert (folder / "report.html").stat().st_size > 10_000
