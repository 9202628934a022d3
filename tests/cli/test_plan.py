from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.planning.moving import DOMAIN, HARD_DOMAIN, PLAN, PROBLEM
from tests.system.running import children, eventually, is_alive, socialbot_here

pytest.importorskip("kairos", reason="kairos-planner is not installed")

HARD_PROBLEM = f"""(define (problem far) (:domain hard) (:objects {" ".join(f"o{number}" for number in range(40))})
  (:init (p o0 o1 o2) (= (n) 0) {" ".join(f"(q o{number})" for number in range(40))})
  (:goal (and (p o39 o38 o37) (> (n) 5000))))"""


@pytest.fixture(autouse=True)
def _wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")


def socialbot(*args: object) -> subprocess.CompletedProcess[str]:
    return socialbot_here("plan", *args)


@pytest.fixture
def files(tmp_path) -> tuple[Path, Path]:
    """A domain and a problem that has a plan of 14 s."""
    return written(tmp_path, DOMAIN, PROBLEM)


def written(folder: Path, *texts: str) -> tuple[Path, Path]:
    domain, problem = folder / "moving.pddl", folder / "tea.pddl"
    domain.write_text(texts[0], "utf-8")
    problem.write_text(texts[1], "utf-8")
    return domain, problem


def test_plan_in_a_pipe_has_the_format_of_planners(files, tmp_path):
    ended = socialbot(*files, "--timeout", 60)
    assert ended.returncode == 0
    summary, *steps = ended.stdout.splitlines()
    assert summary.startswith("; 4 steps, makespan 14.000 s; solved by kairos in ")
    assert steps[1] == "5.000: (take rob cup kitchen) [2.000]"
    plan = tmp_path / "plan"
    plan.write_text(ended.stdout, "utf-8")
    checked = socialbot(*files, "--validate", plan)
    assert (checked.stdout, checked.returncode) == ("valid: 4 steps, makespan 14.000 s\n", 0)


def test_plan_on_a_terminal_is_a_table(files, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "dumb")
    ended = socialbot(*files, "--timeout", 60)
    assert ended.returncode == 0
    assert "rob cup kitchen" in ended.stdout
    assert "start, s" in ended.stdout
    assert "4 steps, makespan 14.000 s; solved by kairos" in ended.stdout


def test_as_json(files):
    ended = socialbot(*files, "--timeout", 60, "--json")
    answer = json.loads(ended.stdout)
    assert (answer["planner"], answer["verdict"], answer["makespan_s"]) == ("kairos", "solved", 14.0)
    assert answer["steps"][0] == {
        "start_s": 0.0, "action": "go", "args": ["rob", "hall", "kitchen"], "duration_s": 5.0
    }  # fmt: skip


COSTS = """(define (domain way) (:requirements :typing :action-costs) (:types place) (:predicates (at ?p - place))
  (:functions (total-cost) - number (cost ?a ?b - place) - number)
  (:action go :parameters (?a ?b - place) :precondition (at ?a)
    :effect (and (not (at ?a)) (at ?b) (increase (total-cost) (cost ?a ?b)))))"""

WAY = """(define (problem p) (:domain way) (:objects a b c - place) (:init (at a) (= (total-cost) 0) (= (cost a c) 30))
  (:goal (at c)) (:metric minimize (+ (total-cost) (total-time))))"""


def test_the_value_of_the_metric_is_part_of_the_summary(tmp_path):
    files, plan = written(tmp_path, COSTS, WAY), tmp_path / "plan"
    ended = socialbot(*files)
    assert ended.stdout.startswith("; 1 step, makespan 0.000 s, metric 30; solved by kairos in ")
    assert json.loads(socialbot(*files, "--json").stdout)["metric"] == 30
    plan.write_text("2.5: (go a c)", "utf-8")
    checked = socialbot(*files, "--validate", plan)
    assert checked.stdout == "valid: 1 step, makespan 2.500 s, metric 32.5\n"
    assert json.loads(socialbot(*files, "--validate", plan, "--json").stdout)["metric"] == 32.5


@pytest.mark.parametrize(
    ("metric", "note"),
    [
        (
            "minimize (total-cost)",
            "planners return the first valid plan that they find, which need not minimize the metric",
        ),
        (
            "maximize (total-cost)",
            "planners return the first valid plan that they find, which need not maximize the metric",
        ),
        (
            "minimize (cost c a)",
            "the metric has no value after the plan: write one into :init for each of its functions",
        ),
    ],
)
def test_a_note_says_that_a_plan_need_not_be_the_best_one_for_the_metric(tmp_path, metric, note):
    files = written(tmp_path, COSTS, WAY.replace("minimize (+ (total-cost) (total-time))", metric))
    ended = socialbot(*files)
    assert (ended.returncode, ended.stderr.strip()) == (0, f"note: {note}")
    assert json.loads(socialbot(*files, "--json").stdout)["message"] == note


def test_functions_without_a_value_are_named_if_there_is_no_plan(tmp_path):
    files = written(tmp_path, COSTS, WAY.replace("(= (cost a c) 30)", ""))
    ended = socialbot(*files)
    assert ended.returncode == 10
    hint = "no value is given for (cost ?a ?b - place), and conditions on it never hold: write one into :init"
    assert ended.stderr.strip().endswith(f"; {hint}")
    assert json.loads(socialbot(*files, "--json").stdout)["message"].endswith(f"; {hint}")


def test_impossible_problem_has_an_exit_code(tmp_path):
    files = written(tmp_path, DOMAIN, PROBLEM.replace("(at rob hall)", ""))
    ended = socialbot(*files)
    assert (ended.returncode, ended.stdout) == (10, "")
    reason = "nothing can make (lies cup hall) true, which needs (has ?r cup), which needs (at ?r ?x)"
    assert ended.stderr.strip() == f"impossible: {reason}"
    assert json.loads(socialbot(*files, "--json").stdout)["steps"] is None


@pytest.mark.slow
def test_exceeded_limit_has_an_exit_code(tmp_path):
    ended = socialbot(*written(tmp_path, HARD_DOMAIN, HARD_PROBLEM), "--timeout", 0.2)
    assert (ended.returncode, ended.stderr) == (11, "gave up: kairos found no plan in 0.2 s\n")


def test_deadline_too_early(files):
    ended = socialbot(*files, "--timeout", 1, "--deadline", 13)
    assert ended.returncode == 11
    assert "longer than the 13 s there are" in ended.stderr


def test_without_a_goal(tmp_path):
    ended = socialbot(*written(tmp_path, DOMAIN, PROBLEM.replace("(:goal (lies cup hall))", "")))
    assert (ended.returncode, ended.stderr) == (4, "refused: the problem has no goal\n")


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("(lies cup kitchen)", "(lies mug kitchen)", "tea.pddl:5: "),
        ("(has ?r - robot ?t - thing)", "(has ?r - robot ?t - thang)", "moving.pddl:5: "),
        ("(at end (lies ?t ?x))", "(at end (lays ?t ?x))", "moving.pddl:"),
        ("(:goal (lies cup hall)))", "(:goal (lies cup hall))", "tea.pddl:"),
    ],
)
def test_malformed_file_is_reported_with_line(tmp_path, old, new, place):
    ended = socialbot(*written(tmp_path, DOMAIN.replace(old, new), PROBLEM.replace(old, new)))
    assert ended.returncode == 4
    assert ended.stderr.startswith(f"error: {tmp_path / place}")
    assert "Traceback" not in ended.stderr


def test_unreadable_files(files, tmp_path):
    missing = socialbot(files[0], tmp_path / "none.pddl")
    assert (missing.returncode, missing.stderr) == (
        4,
        f"error: {tmp_path / 'none.pddl'}: cannot be read: No such file or directory\n  remedy: check the path\n",
    )
    files[0].write_bytes(b"\xff\xfe")
    assert "is not UTF-8 text" in socialbot(*files).stderr


def test_unknown_or_missing_planners(files):
    assert socialbot(*files, "--planner", "lpg").returncode == 4
    absent = socialbot(*files, "--planner", "popf:/nowhere/popf")
    assert absent.returncode == 5
    assert "put popf on the PATH" in absent.stderr


@pytest.mark.parametrize(
    ("line", "other", "said"),
    [
        ("5.001: (take", "4.001: (take", "(at rob kitchen)"),
        ("7.002: (go rob kitchen hall) [5.000]", "7.002: (go rob kitchen hall) [4.000]", "go rob kitchen hall"),
        ("12.003: (put rob cup hall) [2.000]", "", "(lies cup hall)"),
        ("(take rob cup kitchen)", "(take rob mug kitchen)", "mug"),
    ],
)
def test_faults_of_an_invalid_plan(files, tmp_path, line, other, said):
    plan = tmp_path / "plan"
    plan.write_text(PLAN.replace(line, other), "utf-8")
    ended = socialbot(*files, "--validate", plan)
    assert (ended.returncode, ended.stdout) == (12, "")
    assert all(line.startswith("not valid: ") for line in ended.stderr.splitlines())
    assert said in ended.stderr
    assert json.loads(socialbot(*files, "--validate", plan, "--json").stdout)["valid"] is False


def test_valid_plan_may_exceed_the_deadline(files, tmp_path):
    plan = tmp_path / "plan"
    plan.write_text(PLAN, "utf-8")
    assert socialbot(*files, "--validate", plan, "--deadline", 14).returncode == 0
    ended = socialbot(*files, "--validate", plan, "--deadline", 13)
    assert (ended.returncode, ended.stderr) == (12, "not valid: the plan lasts 14.003 s, longer than 13 s\n")


def test_unreadable_plan(files, tmp_path):
    plan = tmp_path / "plan"
    plan.write_text("0.0: (go rob hall kitchen) [5.0]\nthen take the cup\n", "utf-8")
    ended = socialbot(*files, "--validate", plan)
    assert ended.returncode == 4
    assert ended.stderr.startswith(f"error: {plan}:2: ")


def test_signal_ends_command_and_planner(tmp_path):
    files = written(tmp_path, HARD_DOMAIN, HARD_PROBLEM)
    command = [sys.executable, "-m", "socialbot", "plan", *map(str, files), "--timeout", "1000"]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as running:
        assert eventually(lambda: bool(children(running.pid)), 60)
        planners = children(running.pid)
        running.send_signal(signal.SIGINT)
        _, errors = running.communicate(timeout=180)
    assert (running.returncode, errors) == (0, b"")
    assert eventually(lambda: not any(map(is_alive, planners)), 60)
