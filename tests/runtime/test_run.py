"""Folders, guard and results of runs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest

from socialbot.graph.node import Graph
from socialbot.runs.record import RunTrace
from socialbot.runtime.run import Execution, RunSource, new_run_folder, run

TWO_FOLDERS = """
from pathlib import Path
from socialbot.runtime.run import new_run_folder
used, unused = new_run_folder(), new_run_folder()
(used / "trace.jsonl").touch()
"""


def test_runs_that_begin_in_the_same_second_have_folders_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folders = [new_run_folder() for _ in range(5)]
    assert len(set(folders)) == 5
    assert all(folder.is_dir() for folder in folders)


@pytest.mark.parametrize(("first", "left"), [("pass", ["runs"]), ("(used / 'trace.jsonl').unlink()", [])])
def test_a_folder_without_a_run_is_removed(first: str, left: list[str], tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", TWO_FOLDERS + first], cwd=tmp_path, check=True)
    assert [each.name for each in tmp_path.iterdir()] == left
    assert len(list(tmp_path.rglob("trace.jsonl"))) == len(left)
    assert len(list(tmp_path.glob("runs/*"))) == len(left)


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "runs").touch()
    assert new_run_folder(tmp_path / "runs").parent == tmp_path / "runs"


class NotedSource(RunSource):
    """Notes how many guards this process has."""

    def execute(self, execution: Execution) -> None:
        self.during = guards()

    def results(self, execution: Execution) -> dict[str, Any]:
        self.after = guards()
        return {}


def guards() -> int:
    commands = [" ".join(child.cmdline()) for child in psutil.Process().children()]
    return sum("_process_guard.py" in command for command in commands)


@pytest.mark.ros
def test_results_have_no_time_limit(tmp_path: Path) -> None:
    """The guard would kill a process that scores a long recording."""
    source = NotedSource()
    with RunTrace(tmp_path / "run") as record:
        run(Graph("empty", ()), source, record, runner="ros")
    assert (source.during, source.after) == (1, 0)
