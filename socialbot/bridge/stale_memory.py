"""Shared memory of Fast DDS that dead processes have left behind.

Each process has a segment, and beside it an empty file that it keeps locked. Who is killed loses the lock, but the
segment stays, with all the memory that it was ever used for.
"""

from __future__ import annotations

import contextlib
import fcntl
import re
import time
from collections.abc import Iterator
from pathlib import Path

SHARED = Path("/dev/shm")

YOUNG_S = 3.0
"""A segment that is as young may not have been locked yet."""

_LOCK = re.compile(r"fastrtps_[\da-z]{16}_el")
"""Of segments only. Ports are taken over by whoever comes next, perhaps in this moment: a process that is refused its
port because somebody tries the lock hears by UDP only, and so no pictures at all."""


def stale_locks(folder: Path = SHARED) -> Iterator[Path]:
    """The lock files in ``folder`` of segments that no process holds."""
    youngest = time.time() - YOUNG_S
    for path in sorted(folder.glob("fastrtps_*_el")):
        with contextlib.suppress(OSError):  # gone by now, or another user's
            if _LOCK.fullmatch(path.name) and path.stat().st_mtime < youngest and is_free(path):
                yield path


def is_free(path: Path) -> bool:
    """Whether no process holds the lock file ``path``; whoever wants to take it in this moment is refused it."""
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False  # Held, gone by now, or another user's.
    return True


def remove_stale(folder: Path = SHARED) -> int:
    """Removes the segments of dead processes; returns how many."""
    removed = 0
    for lock in stale_locks(folder):
        with contextlib.suppress(OSError):
            lock.with_name(lock.name.removesuffix("_el")).unlink(missing_ok=True)
            lock.unlink()
            removed += 1
    return removed
