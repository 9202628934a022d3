"""What the shell offers after ``socialbot``."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from socialbot.cli._options import graph_names, paths, run_folders


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def offered(line: str, folder: Path) -> list[str]:
    """What bash gets to complete the last word of ``line``."""
    asked = {"_SOCIALBOT_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}
    done = subprocess.run(
        [Path(sys.executable).with_name("socialbot")],
        env={**os.environ, **asked},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_completes_commands_graphs_and_nodes(folder: Path):
    assert offered("socialbot repl", folder) == ["replay"]
    assert offered("socialbot up ware", folder) == ["warehouse"]
    assert offered("socialbot node --graph hospital coord", folder) == ["coordinator"]
    assert "speech" not in offered("socialbot node speech ", folder)


def test_completes_graph_files(folder: Path):
    (folder / "wave.yaml").touch()
    (folder / "wave.txt").touch()
    (folder / "walk").mkdir()
    assert graph_names("wa") == ["waldo", "warehouse", "walk/", "wave.yaml"]


def test_completes_runs_newest_first(folder: Path):
    for age, name in ((30, "old"), (10, "new"), (20, "middle")):
        trace = folder / "runs" / name / "trace.jsonl"
        trace.parent.mkdir(parents=True)
        trace.touch()
        os.utime(trace, times=(100 - age, 100 - age))
    (folder / "runs" / "empty").mkdir()
    assert run_folders("") == ["runs/new", "runs/middle", "runs/old", "runs/"]
    assert run_folders("runs/") == ["runs/new", "runs/middle", "runs/old", "runs/empty/"]
    assert run_folders("runs/o") == ["runs/old"]


def test_completes_unreadable_paths_without_error(folder: Path):
    assert list(paths("nowhere/x", ())) == []
    (folder / ".hidden").mkdir()
    assert list(paths("", ())) == []
    assert list(paths(".h", ())) == [".hidden/"]
    assert list(paths(f"{folder}/.h", ())) == [f"{folder}/.hidden/"]


def test_completes_no_nodes_of_an_unreadable_graph(folder: Path):
    assert offered("socialbot node --graph nothing.yaml x", folder) == []
