from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from socialbot.bridge.environment import split_ros_args

OURS = ["--graph", "waldo", "head"]


@pytest.mark.parametrize(
    ("arguments", "ours", "ros"),
    [
        (OURS, OURS, []),
        ([*OURS, "--ros-args"], OURS, ["--ros-args"]),
        ([*OURS, "--ros-args", "-p", "a:=1"], OURS, ["--ros-args", "-p", "a:=1"]),
        (["--ros-args", "-p", "a:=1", "--", *OURS], OURS, ["--ros-args", "-p", "a:=1", "--"]),
        (
            ["--ros-args", "-p", "a:=1", "--", "head", "--ros-args", "-p", "b:=2"],
            ["head"],
            ["--ros-args", "-p", "a:=1", "--", "--ros-args", "-p", "b:=2"],
        ),
        (["head", "--", "-p"], ["head", "--", "-p"], []),
    ],
)
def test_what_is_for_ros_goes_from_its_word_to_the_dashes_or_the_end(arguments, ours, ros):
    assert split_ros_args(arguments) == (ours, ros)


def run_node(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "socialbot", "node", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "200"})


@pytest.mark.slow
@pytest.mark.ros
def test_a_value_from_ros_that_does_not_fit_is_one_message():
    done = run_node("head", "--ros-args", "-r", "__node:=head", "-p", "dead_band_rad:=ten")
    assert done.returncode == 4
    assert "head.dead_band_rad" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
@pytest.mark.ros
def test_arguments_that_ros_cannot_use_are_one_message(tmp_path: Path):
    done = run_node("head", "--ros-args", "--params-file", str(tmp_path / "none.yaml"))
    assert done.returncode == 4
    assert "error: --ros-args: ROS rejects the arguments" in done.stderr
    assert "Traceback" not in done.stderr
