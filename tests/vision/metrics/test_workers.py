from __future__ import annotations

import subprocess
import sys
import time

import psutil
import pytest

from socialbot.core.errors import NodeError, TruthError
from socialbot.vision.metrics.pipeline import Found, FoundFrame
from socialbot.vision.metrics.workers import run_in_processes
from tests.system.running import next_line
from tests.vision.metrics.calls import crash, double, give_back, wait
from tests.vision.metrics.scenes import found


def test_results_are_in_the_order_of_the_arguments():
    assert run_in_processes(wait, [(0.3,), (0.0,), (0.1,)], 2) == [0.3, 0.0, 0.1]
    assert run_in_processes(double, [], 2) == []


def test_results_are_reported_as_they_come():
    reported = []
    run_in_processes(double, [(3,), (4,)], 1, done=lambda number, result: reported.append((number, result)))
    assert reported == [(0, 6), (1, 8)]


def test_crashed_process_is_an_error():
    with pytest.raises(NodeError, match="crashed") as caught:
        run_in_processes(crash, [(3,)], 1)
    assert caught.value.remedy


def test_error_cancels_running_calls():
    def refuse(number: int, result: float) -> None:
        raise TruthError("no")

    begun = time.monotonic()
    with pytest.raises(TruthError):
        run_in_processes(wait, [(0.0,), (300.0,)], 2, done=refuse)
    assert time.monotonic() - begun < 60


def test_results_and_errors_are_pickled():
    frames: tuple[FoundFrame, ...] = (found(),)
    there = Found(frames, 1, "damaged")
    assert run_in_processes(give_back, [(there,)], 1) == [there]
    with pytest.raises(TruthError, match="where: what") as caught:
        run_in_processes(give_back, [(TruthError("what", where="where", remedy="that"),)], 1)
    assert caught.value.remedy == "that"


@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux")
def test_processes_end_with_a_killed_parent():
    code = """
import os
import time
from socialbot.vision.metrics.workers import run_in_processes
run_in_processes(time.sleep, [(600.0,), (600.0,)], 2, initializer=os.write, initargs=(1, b"begun\\n"))
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        assert [next_line(parent) for _ in range(2)] == ["begun\n", "begun\n"]
        workers = psutil.Process(parent.pid).children()
        assert len(workers) >= 2
        parent.kill()
    gone, alive = psutil.wait_procs(workers, timeout=60.0)
    for process in alive:
        process.kill()
    assert (len(gone), alive) == (len(workers), [])
