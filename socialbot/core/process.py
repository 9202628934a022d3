"""Settings of one operating-system process: how it ends on signals, how malloc returns memory."""

from __future__ import annotations

import atexit
import ctypes
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def end_well_on_signals() -> None:
    """From now on signals end the process with exit code 0; ones that came while they were blocked do so at once.

    One that comes while it is going already changes nothing.
    """
    atexit.register(_ignore_signals)
    for number in ENDING_SIGNALS:
        signal.signal(number, lambda *_: sys.exit(0))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING_SIGNALS)


def _ignore_signals() -> None:
    # Python takes its handlers away before it lets go of modules, which takes long on a busy machine.
    for number in ENDING_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


class Ending:
    """Notes that SIGINT or SIGTERM came, or that the parent process is gone."""

    def __init__(self, parent: int | None = None) -> None:
        self._asked = False
        self._parent = parent

    @property
    def asked(self) -> bool:
        """Whether it is time to end."""
        return self._asked or (self._parent is not None and os.getppid() != self._parent)

    def ask(self, signum: int = 0, frame: FrameType | None = None) -> None:
        """Asks for the end; serves as a signal handler."""
        self._asked = True

    @contextmanager
    def on_signals(self) -> Iterator[Ending]:
        """Ends on SIGINT and SIGTERM within this context."""
        before = {number: signal.signal(number, self.ask) for number in ENDING_SIGNALS}
        try:
            yield self
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


MXFAST, TRIM_THRESHOLD, TOP_PAD, MMAP_THRESHOLD = 1, -1, -2, -3
"""The names of glibc's malloc.h for what `mallopt` sets."""

KEPT_BYTES = 64 << 20
SPARE_BYTES = 16 << 20
LARGEST_BYTES = 32 << 20
"""What glibc takes at most for its threshold; an 8-bit picture of 3840x2160 has 25 million bytes."""


def keep_freed_memory() -> bool:
    """Has this process keep what it frees, up to `KEPT_BYTES`, for the next picture. Returns False without glibc.

    Otherwise glibc gives the memory of each picture back and asks for it anew, and the kernel clears every page of it:
    640x480 at 30 Hz cost a camera and its sender 40 000 page faults a second, a fifth of their time.

    What is small joins what is free beside it at once. Otherwise it lies apart until somebody asks for something large,
    and of threads that never do, as those of DDS, the heap grew by nearly 6 MB an hour, of which nothing was in use.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    taken = [
        mallopt(MXFAST, 0),
        mallopt(MMAP_THRESHOLD, LARGEST_BYTES),
        mallopt(TRIM_THRESHOLD, KEPT_BYTES),
        mallopt(TOP_PAD, SPARE_BYTES),
    ]
    return all(taken)
