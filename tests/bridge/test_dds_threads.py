"""Threads of DDS that work without a wait."""

from __future__ import annotations

import threading
from time import sleep

from socialbot.bridge import dds_threads
from tests.bridge.dds_threads import busy_dds_thread, dds_thread
from tests.system.running import eventually


def test_a_thread_that_works_without_a_wait_is_busy() -> None:
    with busy_dds_thread():
        assert eventually(dds_threads.is_busy)
    assert not dds_threads.is_busy()


def test_a_thread_that_waits_now_and_then_is_not_busy() -> None:
    end = threading.Event()

    def work_and_wait() -> None:
        while not end.is_set():
            sum(range(10_000))
            sleep(0.001)

    with dds_thread(work_and_wait):
        try:
            assert eventually(lambda: not dds_threads.is_busy())
        finally:
            end.set()
