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

_LOCK = re.compile(r"fastrtps_([\da-z]{16}|port\d{1,5})_[es]l")
_SEGMENT_LOCK = re.compile(r"fastrtps_[\da-z]{16}_el")


def stale_locks(folder: Path = SHARED) -> Iterator[Path]:
    """The lock files in ``folder`` that no process holds."""
    return (path for path in sorted(folder.glob("fastrtps_*")) if _LOCK.fullmatch(path.name) and is_free(path))


def is_free(path: Path) -> bool:
    """Whether no process holds the lock file ``path``; whoever wants to take it in this moment is refused it."""
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False  # Held, gone by now, or another user's.
    return True


def remove_stale(folder: Path = SHARED) -> int:
    """Removes the segments of dead processes; returns how many.

    Ports stay, and their locks are not even tried: whoever comes next takes them over, perhaps in this moment, and a
    process that is refused its port is heard and hears by UDP only.
    """
    removed, youngest = 0, time.time() - YOUNG_S
    for lock in folder.glob("fastrtps_*_el"):
        with contextlib.suppress(OSError):  # gone by now, or another user's
            if _SEGMENT_LOCK.fullmatch(lock.name) and lock.stat().st_mtime < youngest and is_free(lock):
                lock.with_name(lock.name.removesuffix("_el")).unlink(missing_ok=True)
                lock.unlink()
                removed += 1
    return removed
