"""Paths that nobody can use, in arguments and in files of strangers."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tests.system.running import socialbot_here

RUN = Path(__file__).parents[1] / "data" / "run_0_1"
LONG = "x" * 5000


@pytest.mark.parametrize(
    "arguments",
    [
        ("graph", LONG),
        ("why", LONG),
        ("diff", LONG, LONG),
        ("forget", LONG, "--person", "t1"),
        ("bag", "info", LONG),
        ("bag", "convert", LONG, LONG, "--wire", "json"),
        ("asl", "test", LONG),
        ("evaluate", "--images", LONG),
        ("sweep", LONG, "--set", "a.b=1"),
        ("status", LONG),
        ("key", "list", "--folder", LONG),
        ("new", LONG),
    ],
)
def test_long_paths_end_with_one_message(arguments: tuple[str, ...], tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = socialbot_here(*arguments)
    assert result.returncode in (3, 4)
    assert result.stderr.startswith("error: ")


@pytest.mark.parametrize("command", [("report",), ("visitors",), ("why", "--list")])
@pytest.mark.parametrize("bag", [LONG, "b" * 256])
def test_a_run_may_name_a_bag_that_no_path_can_have(bag: str, command: tuple[str, ...], tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(RUN, run)
    results = json.loads((run / "results.json").read_text("utf-8"))
    (run / "results.json").write_text(json.dumps({**results, "bag": {"path": bag, "topics": []}}))
    result = socialbot_here(command[0], run, *command[1:])
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.asl", f'{{ include("{LONG}") }}\n'),
        ("a.mas2j", f'MAS m {{ agents: a; aslSourcePath: "{LONG}"; }}'),
    ],
)
def test_programs_may_name_such_files(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    result = socialbot_here("asl", "check", tmp_path / name)
    assert result.returncode == 4
    assert "does not exist" in result.stderr


def test_a_graph_may_name_such_a_robot(tmp_path: Path) -> None:
    (tmp_path / "g.yaml").write_text(f"name: a\nrobot: {LONG}\nnodes: {{camera: {{type: camera}}}}\n")
    result = socialbot_here("graph", tmp_path / "g.yaml")
    assert result.returncode == 4
    assert result.stderr.startswith("error: ")
