"""Detection of blocked threads."""

import os
import threading
import time

import pytest

from socialbot.bridge._node_thread import SCHEDSTAT, Stopwatch

pytestmark = pytest.mark.skipif(not os.path.exists(SCHEDSTAT), reason="Linux counts no waiting here")


def at_work(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def test_sleep_is_blocked_time():
    watch = Stopwatch()
    time.sleep(0.05)
    whole, blocked = watch.seconds()
    assert whole >= 0.05
    assert blocked == pytest.approx(0.05, abs=0.02)


def test_work_is_not_blocked_time():
    watch = Stopwatch()
    at_work(0.05)
    whole, blocked = watch.seconds()
    assert whole >= 0.05
    assert blocked < 0.02


def test_waiting_for_a_processor_is_not_blocked_time():
    here = os.sched_getaffinity(0)
    one = {min(here)}
    reader, writer = os.pipe()
    rival = os.fork()
    if rival == 0:
        os.sched_setaffinity(0, one)
        os.write(writer, b"!")
        while True:
            pass
    try:
        os.sched_setaffinity(0, one)
        os.read(reader, 1)
        watch = Stopwatch()
        at_work(0.05)
        whole, blocked = watch.seconds()
    finally:
        os.sched_setaffinity(0, here)
        os.kill(rival, 9)
        os.waitpid(rival, 0)
        os.close(reader)
        os.close(writer)
    assert whole > 0.07, "somebody else had the processor meanwhile"
    assert blocked < 0.02


def test_each_thread_is_measured_alone():
    told = []

    def sleeper():
        watch = Stopwatch()
        time.sleep(0.05)
        told.extend(watch.seconds())

    thread = threading.Thread(target=sleeper)
    watch = Stopwatch()
    thread.start()
    at_work(0.05)
    _, blocked = watch.seconds()
    thread.join()
    assert told[1] > 0.03
    assert blocked < 0.03
