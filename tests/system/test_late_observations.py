"""Nobody acts on observations that arrive long after they were made."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import psutil
import pytest

from evaluation.faults_deaths import SCENE, SETTINGS
from evaluation.faults_plan import write_pictures
from socialbot.bridge._callback_queue import LATE_S
from socialbot.core.clock import SECOND
from tests.system.running import eventually, running

STOPPED_S = 5.0
TIMES = 3


@pytest.mark.ros
@pytest.mark.slow
def test_an_engine_that_stood_still_skips_what_was_seen_meanwhile(tmp_path: Path) -> None:
    run = tmp_path / "run"
    pictures = write_pictures(tmp_path / "pictures", SCENE)
    settings = [word for setting, value in SETTINGS.items() for word in ("--set", f"{setting}={value}")]

    def records() -> list[dict]:
        lines = (run / "trace.jsonl").read_bytes().split(b"\n")[:-1] if (run / "trace.jsonl").exists() else []
        return [json.loads(line) for line in lines]

    def percepts(since: int = 0) -> list[float]:
        """Return the ages (s) of the observations that percepts since then came from."""
        return [
            (each["stamp"] - int(each["cause"].removeprefix("detection-"))) / SECOND
            for each in records()
            if each["kind"] == "percept" and each["cause"].startswith("detection-") and each["stamp"] > since
        ]

    with running("up", "--camera", pictures, "--out", run, *settings) as up:
        assert eventually(lambda: len(percepts()) > 5), up.output()[-3000:]
        usual = max(percepts())
        children = psutil.Process(up.pid).children(recursive=True)
        engine = next(each.pid for each in children if each.name() == "bdi_engine")
        for _ in range(TIMES):
            os.kill(engine, signal.SIGSTOP)
            time.sleep(STOPPED_S)
            os.kill(engine, signal.SIGCONT)
            since = time.time_ns()
            assert eventually(lambda since=since: len(percepts(since)) > 5), up.output()[-3000:]
            assert max(percepts(since)) < LATE_S + usual + 0.5
