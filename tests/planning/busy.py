"""A machine that is busy with something else: one processor for many."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

RIVALS = 9
"""So many others want the same processor: one who works there takes about ten times as long."""

in_turn = pytest.mark.xdist_group("a busy machine")
"""For tests that make the machine busy, and those that time something on the wall: never two of them at once."""

can_be_made = pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="processes cannot be bound to processors")


@contextmanager
def busy_machine(rivals: int = RIVALS) -> Iterator[None]:
    """Has this thread, and what it starts meanwhile, share one processor with ``rivals`` that always work."""
    here = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(here)})
    others = []
    try:
        # Linux may share the processor out by session: a session for each, as the child under test has its own.
        busy = ["/bin/sh", "-c", "while :; do :; done"]
        others += [subprocess.Popen(busy, start_new_session=True) for _ in range(rivals)]
        yield
    finally:
        for other in others:
            other.send_signal(signal.SIGKILL)
            other.wait()
        os.sched_setaffinity(0, here)
