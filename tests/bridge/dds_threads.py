"""Threads with the names of those of Fast DDS."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from socialbot.runtime.fork_server import PR_SET_NAME


@contextmanager
def dds_thread(work: Callable[[], object]) -> Iterator[None]:
    """Run ``work`` in a thread of that name, which has it when the block begins; wait for it after the block."""
    libc, is_named = ctypes.CDLL(None), threading.Event()

    def run() -> None:
        libc.prctl(PR_SET_NAME, b"dds.udp.7410", 0, 0, 0)
        is_named.set()
        work()

    thread = threading.Thread(target=run)
    thread.start()
    is_named.wait()
    yield
    thread.join()


@contextmanager
def busy_dds_thread() -> Iterator[None]:
    """Let a thread work in the block, without Python's lock and without a wait."""
    libc, lock = ctypes.CDLL(None), ctypes.c_int()
    libc.pthread_spin_init(ctypes.byref(lock), 0)
    libc.pthread_spin_lock(ctypes.byref(lock))
    works = threading.Event()

    def work() -> None:
        works.set()
        libc.pthread_spin_lock(ctypes.byref(lock))

    with dds_thread(work):
        try:
            works.wait()
            yield
        finally:
            libc.pthread_spin_unlock(ctypes.byref(lock))
