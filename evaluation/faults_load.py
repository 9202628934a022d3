"""Busy processes beside a measurement."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

BUSY = """
import os, sys
while os.getppid() == int(sys.argv[1]):
    sum(range(300_000))
"""


@contextmanager
def busy_processes(count: int) -> Iterator[list[int]]:
    """Run ``count`` processes that always use a processor core; yields their ids. They end with this process."""
    started = [
        subprocess.Popen([sys.executable, "-I", "-c", BUSY, str(os.getpid())], stdin=subprocess.DEVNULL)
        for _ in range(count)
    ]
    try:
        yield [process.pid for process in started]
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.wait()
