"""Runs from strangers, or damaged: no value of a record gives a traceback, and what is left out is reported."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from socialbot.cli.main import app
from socialbot.core.errors import SocialbotError
from socialbot.runs.folder import NAMED_LINES, open_run
from socialbot.runs.record import TRACE
from tests.fuzz.run_folders import RECORDED, WRONGS, mutated, places, read_all, recorded_lines, with_wrong, write_run

RUNS = tuple(recorded_lines())
WORST_CPU_S = 5.0
"""For all that `read_all` does, which takes 0.2 s for a run without wrong values."""


@pytest.mark.parametrize("name", RUNS)
def test_recorded_runs_are_whole(name: str, tmp_path: Path) -> None:
    lines, _ = recorded_lines()[name]
    run = read_all(write_run(tmp_path / "run", name, b"\n".join(lines) + b"\n"))
    assert not [each for each in run.damage if TRACE in each]


@pytest.mark.parametrize("first", [0, *(pytest.param(first, marks=pytest.mark.slow) for first in (10, 20, 30))])
def test_runs_with_wrong_values_are_read(first: int, tmp_path: Path) -> None:
    _read(range(first, first + 10), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(40, 2040, 200))
def test_runs_with_many_wrong_values_are_read(first: int, tmp_path: Path) -> None:
    _read(range(first, first + 200), tmp_path)


def _read(numbers: range, folder: Path) -> None:
    for number in numbers:
        begun = time.process_time()
        read_all(write_run(folder / "run", *mutated(str(number).encode())))
        assert time.process_time() - begun < WORST_CPU_S, number


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
@pytest.mark.parametrize("wrong", WRONGS, ids=lambda wrong: repr(wrong)[:12])
def test_each_value_of_each_kind_may_be_wrong(name: str, wrong: object, tmp_path: Path) -> None:
    """All values at once, each in a copy of its record, so that one command meets all of them."""
    lines, _ = recorded_lines()[name]
    wrongs = ((each, *(with_wrong(each, at, wrong) for at in places(json.loads(each)))) for each in lines)
    changed = [line for each in wrongs for line in each]
    read_all(write_run(tmp_path / "run", name, b"\n".join(changed) + b"\n"))


def test_a_record_with_a_wrong_value_is_skipped_and_named(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(RECORDED, folder)
    lines = (folder / TRACE).read_bytes().splitlines()
    number = next(n for n, line in enumerate(lines) if json.loads(line)["kind"] == "plan_start")
    lines[number] = with_wrong(lines[number], ("detail", "steps"), 5)
    (folder / TRACE).write_bytes(b"\n".join(lines) + b"\n")
    run = open_run(folder)
    assert len(run.history) == len(lines) - 1
    assert run.damage == [
        f"{TRACE}:{number + 1}: detail.steps of a record of kind 'plan_start': Expected `array`, got `int`:"
        " the line is skipped"
    ]


def test_many_unreadable_lines_are_counted(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(RECORDED, folder)
    text = b"[" * 100_000 + b"\n" + b"{}\n" * 100
    (folder / TRACE).write_bytes(text + (RECORDED / TRACE).read_bytes())
    run = open_run(folder)
    assert len(run.damage) == NAMED_LINES + 1
    assert run.damage[-1] == f"{TRACE}: 101 lines are skipped; the first {NAMED_LINES} are named above"
    assert len(run.history) == len(open_run(RECORDED).history)


@pytest.mark.parametrize("number", range(3))
def test_commands_end_with_a_documented_exit_code(number: int, tmp_path: Path) -> None:
    name, trace = mutated(f"commands {number}".encode())
    folder = write_run(tmp_path / "run", name, trace)
    for arguments in (
        ("why", folder), ("why", folder, "--list"), ("why", folder, "--not", "e"), ("why", folder, "--at", "0.5"),
        ("ask", folder, "Why did you do that?"), ("diff", folder, folder), ("report", folder), ("visitors", folder),
        ("export", folder, tmp_path / "run.csv"), ("export", folder, tmp_path / "run.eaf"),
    ):  # fmt: skip
        done = CliRunner().invoke(app, list(map(str, arguments)))
        assert done.exception is None or isinstance(done.exception, (SystemExit, SocialbotError)), arguments
