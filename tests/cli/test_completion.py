"""Shell completion of ``socialbot``."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from unittest.mock import patch

import pytest

from socialbot.cli._options import graph_names, paths, run_folders
from socialbot.cli.main import command


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def completion_request(line: str) -> dict[str, str]:
    """Environment in which bash asks to complete the last word of ``line``."""
    return {"_SOCIALBOT_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}


def offered(line: str, folder: Path) -> list[str]:
    """The completions that the command ``socialbot`` offers."""
    done = subprocess.run(
        [Path(sys.executable).with_name("socialbot")],
        env={**os.environ, **completion_request(line)},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_completes_commands_graphs_and_nodes(folder: Path):
    assert offered("socialbot repl", folder) == ["replay"]
    assert offered_here("socialbot up ware") == ["warehouse"]
    assert offered_here("socialbot node --graph hospital coord") == ["coordinator"]
    assert "speech" not in offered_here("socialbot node speech ")


def offered_here(line: str) -> list[str]:
    """As `offered`, in this process."""
    output = StringIO()
    request = patch.dict(os.environ, completion_request(line))
    with request, redirect_stdout(output), pytest.raises(SystemExit, match="0"):
        command().main([], "socialbot")
    return output.getvalue().split()


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
    assert offered_here("socialbot node --graph nothing.yaml x") == []
