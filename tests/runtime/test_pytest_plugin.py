"""The pytest plugin: expectations as tests, the fixture, and no effect on other test suites."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from pathlib import Path

import pytest

from socialbot.cli.new import write_project
from tests.system.running import socialbot_here

NUMBERS = itertools.count()
BEHAVIOURS = """
from socialbot.testing import expect, person, said

greets = expect(said("Hello*")).within(2).after(person(nearer_than=3))
early = expect(said("Hello*")).within(0.5).after(person(nearer_than=4))
offers = expect(said("help*")).within(2).after(said("Sorry*"))
"""
OTHER = """
import sys

def test_other():
    loaded = [name for name in sys.modules if name.startswith("socialbot")]
    assert not [name for name in loaded if name.startswith(("socialbot.runs", "socialbot.graph", "socialbot.bdi"))]
    assert "numpy" not in sys.modules
"""
USER = """
from socialbot.testing import GraphTester, expect, person, said

def expectation(seconds):
    return expect(said("Hello*")).within(seconds).after(person(nearer_than=4)).named("early")

def run():
    with GraphTester("graph.yaml", parameters={"speech": {"playback": "off"}}) as tester:
        tester.run(12)
    return tester

def test_in_time(check_behaviours):
    (verdict,) = check_behaviours([expectation(2)], run())
    assert verdict.outcome == "passed"

def test_too_late(check_behaviours):
    check_behaviours([expectation(0.5)], run())
"""


def run_pytest(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "socialbot.runtime.pytest_plugin", "-p", "no:cacheprovider"]
    environment = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    return subprocess.run(
        [*command, *arguments], cwd=folder, env=environment, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return write_project(f"plugged{next(NUMBERS)}", "python", tmp_path)


def test_other_suites_load_nothing(tmp_path: Path) -> None:
    (tmp_path / "test_other.py").write_text(OTHER, "utf-8")
    done = run_pytest(tmp_path)
    assert (done.returncode, "1 passed" in done.stdout) == (0, True), done.stdout


def test_each_expectation_is_a_test(project: Path) -> None:
    (project / "expected.py").write_text(BEHAVIOURS, "utf-8")
    done = run_pytest(project, "--behaviours", "expected.py", "--on", "graph.yaml", "-rs")
    assert done.returncode == 1
    assert "1 failed" in done.stdout
    assert "1 skipped" in done.stdout
    assert "early[graph.yaml]" in done.stdout
    assert "0.10 s too late; within(0.6) would pass" in done.stdout
    assert "untested: nothing in this run" in done.stdout
    assert "Traceback" not in done.stdout


def test_a_graph_for_bags_can_be_named(project: Path) -> None:
    (project / "expected.py").write_text(BEHAVIOURS, "utf-8")
    assert socialbot_here("run", project / "graph.yaml", "--bag", "--out", project / "ran").returncode == 0
    (bag,) = {path.parent for path in project.rglob("ran/**/metadata.yaml")}
    (bag / "graph.yaml").unlink()
    done = run_pytest(
        project, "--behaviours", "expected.py", "--on", str(bag), "--on", "graph.yaml",
        "--behaviours-graph", "graph.yaml", "-k", "greets",
    )  # fmt: skip
    assert "2 passed" in done.stdout, done.stdout


def test_the_fixture_checks_what_a_graph_tester_has_seen(project: Path) -> None:
    (project / "tests" / "test_behaviours_of_robot.py").write_text(USER, "utf-8")
    done = run_pytest(project, "tests/test_behaviours_of_robot.py")
    assert "1 failed, 1 passed" in done.stdout, done.stdout
    assert "early failed" in done.stdout
    assert "too late" in done.stdout


def test_mistakes_are_usage_errors(tmp_path: Path) -> None:
    one = run_pytest(tmp_path, "--behaviours", "none.py")
    assert (one.returncode, "need each other" in one.stderr) == (4, True)
    none = run_pytest(tmp_path, "--behaviours", "none.py", "--on", "runs/x")
    assert (none.returncode, "there is no such file" in none.stderr + none.stdout) == (4, True), none.stdout


def test_the_plugin_is_declared() -> None:
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8")
    assert '[project.entry-points.pytest11]\nsocialbot = "socialbot.runtime.pytest_plugin"' in text
