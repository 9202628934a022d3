"""A node that is killed after the clock was set back is heard again at once, not when the clock has caught up."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import psutil
import pytest

from evaluation.faults_clocks import CLOCK_VARIABLE, build_library, set_clock
from evaluation.faults_deaths import SCENE, SETTINGS
from evaluation.faults_plan import write_pictures
from tests.system.running import eventually, running

BACK_S = 3600


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_a_node_killed_after_the_clock_was_set_back_receives_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, run = tmp_path / "clock", tmp_path / "run"
    pictures = write_pictures(tmp_path / "pictures", SCENE)
    set_clock(clock, 0)
    monkeypatch.setenv("LD_PRELOAD", str(build_library(tmp_path)))
    monkeypatch.setenv(CLOCK_VARIABLE, str(clock))
    settings = [word for setting, value in SETTINGS.items() for word in ("--set", f"{setting}={value}")]

    def detections() -> int:
        return sum(b'"kind":"detection"' in line for line in (run / "trace.jsonl").read_bytes().splitlines())

    with running("up", "--camera", pictures, "--out", run, *settings) as up:
        assert eventually(lambda: (run / "trace.jsonl").exists() and detections() > 20)
        set_clock(clock, -BACK_S)
        assert eventually(lambda: "was set back" in up.output())
        for times in (1, 2):  # after the first time, all processes have begun after the clock was set
            os.kill(_process(up.pid, "image_converter"), signal.SIGKILL)
            assert eventually(lambda times=times: up.output().count("image_converter was ended by signal 9") == times)
            assert eventually(lambda times=times: up.output().count("restart everything") == times)
            seen = detections()
            assert eventually(lambda seen=seen: detections() > seen + 50), up.output()[-3000:]


def _process(up: int, name: str) -> int:
    found = (each for each in psutil.Process(up).children(recursive=True) if each.name() == name)
    return next(each.pid for each in found)
