from __future__ import annotations

import os
import time

import pytest

from socialbot.core.errors import NodeError, TruthError
from socialbot.vision.metrics.pipeline import Found, FoundFrame
from socialbot.vision.metrics.workers import run_in_processes
from tests.vision.metrics.scenes import found


def double(number: int) -> int:
    return 2 * number


def crash(number: int) -> int:
    os._exit(number)


def dawdle(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def test_results_are_in_the_order_of_the_arguments():
    assert run_in_processes(dawdle, [(0.3,), (0.0,), (0.1,)], 2) == [0.3, 0.0, 0.1]
    assert run_in_processes(double, [], 2) == []


def test_results_are_reported_as_they_come():
    told = []
    run_in_processes(double, [(3,), (4,)], 1, done=lambda number, result: told.append((number, result)))
    assert told == [(0, 6), (1, 8)]


def test_crashed_process_is_an_error():
    with pytest.raises(NodeError, match="crashed") as caught:
        run_in_processes(crash, [(3,)], 1)
    assert caught.value.remedy


def test_error_cancels_running_calls():
    def refuse(number: int, result: float) -> None:
        raise TruthError("no")

    begun = time.monotonic()
    with pytest.raises(TruthError):
        run_in_processes(dawdle, [(0.0,), (300.0,)], 2, done=refuse)
    assert time.monotonic() - begun < 60


def send(value: Found | TruthError) -> Found:
    if isinstance(value, TruthError):
        raise value
    return value


def test_results_and_errors_are_pickled():
    frames: tuple[FoundFrame, ...] = (found(),)
    there = Found(frames, 1, "damaged")
    assert run_in_processes(send, [(there,)], 1) == [there]
    with pytest.raises(TruthError, match="where: what") as caught:
        run_in_processes(send, [(TruthError("what", where="where", remedy="that"),)], 1)
    assert caught.value.remedy == "that"
