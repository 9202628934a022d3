"""How long a thread was blocked: neither at work nor ready to work on a processor that others had."""

from __future__ import annotations

import os
import threading
import time

SCHEDSTAT = "/proc/thread-self/schedstat"
LONGEST = 80
"""Bytes of its three numbers at most."""


class _Scheduled(threading.local):
    """What Linux counts of each thread. A file is bound to the thread that opens it."""

    def __init__(self) -> None:
        known = os.path.exists(SCHEDSTAT)
        self._file = open(SCHEDSTAT, "rb", buffering=0) if known else None  # noqa: SIM115 - as long as the thread

    def ns(self) -> int:
        """At work and ready for it, together (ns); 0 where nobody counts."""
        if self._file is None:
            return 0
        at_work, ready, _ = os.pread(self._file.fileno(), LONGEST, 0).split()
        return int(at_work) + int(ready)


_scheduled = _Scheduled()


class Stopwatch:
    """Measures the calling thread from when it is made. Where Linux does not tell, all of it counts as blocked."""

    def __init__(self) -> None:
        self._scheduled = _scheduled.ns()
        self._begin = time.perf_counter_ns()

    def seconds(self) -> tuple[float, float]:
        """How long (s) it has been since then, and for how much of it the thread was blocked."""
        whole = time.perf_counter_ns() - self._begin
        blocked = whole - (_scheduled.ns() - self._scheduled)
        return whole / 1e9, max(0, blocked) / 1e9
