"""Watch over the threads of DDS, which one false packet can let count or fill memory without end."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from pathlib import Path

LOOK_S = 0.5
"""Shortest time (s) between two looks of `EndlessWork`."""
ENDLESS_S = 1.0
"""Processor time (s) without a wait after which a thread of DDS works without end."""
BUSY_S = 0.25
"""Time (s) in which a thread of DDS that works on usual packets waits at least once."""


class EndlessWork:
    """Watch over the threads of DDS in the process ``pid``.

    A thread that works on packets waits now and then: for the next one, or for a lock. ``ignored`` ones do not count.
    """

    def __init__(self, pid: int, ignored: Collection[int] = ()) -> None:
        self._tasks = Path(f"/proc/{pid}/task")
        self._ignored = frozenset(map(str, ignored))
        self._names: dict[str, bytes] = {}
        self._begun: dict[str, tuple[int, int]] = {}
        """Number of waits of a thread, and the time (ns) for which it had run when it last waited."""
        self._due = 0.0
        self._longest_s = 0.0

    def longest_s(self, now: float) -> float:
        """Look at most once in `LOOK_S`; return the longest time (s) for which a thread has run without a wait."""
        if now >= self._due:
            self._due = now + LOOK_S
            self._longest_s = max((self._unpaused_s(task) for task in self._tasks.glob("*")), default=0.0)
        return self._longest_s

    def _unpaused_s(self, task: Path) -> float:
        try:
            if task.name not in self._names:
                self._names[task.name] = _name(task)
            if task.name in self._ignored or not _is_dds(self._names[task.name]):
                return 0.0
            waits = _state_and_waits(task)[1]
            ran_ns = int((task / "schedstat").read_bytes().split()[0])
        except (OSError, ValueError, IndexError):  # the thread has ended
            return 0.0
        if self._begun.get(task.name, (-1, 0))[0] != waits:
            self._begun[task.name] = waits, ran_ns
        return (ran_ns - self._begun[task.name][1]) / 1e9


def is_busy() -> bool:
    """Whether a thread of DDS in this process works, or waits for a processor, for `BUSY_S` without another wait.

    It may hold the lock of discovery meanwhile. A new publisher or subscription would wait for that lock, while rclpy
    keeps Python's lock.
    """
    if not (before := set(_working())):
        return False
    time.sleep(BUSY_S)
    return not before.isdisjoint(_working())


def _working() -> Iterator[tuple[str, int]]:
    """Yield the id and the number of waits of each thread of DDS that is ready or runs."""
    for task in Path("/proc/self/task").glob("*"):
        try:
            if _is_dds(_name(task)):
                state, waits = _state_and_waits(task)
                if state == b"R":
                    yield task.name, waits
        except (OSError, ValueError, IndexError):  # the thread has ended
            continue


def _name(task: Path) -> bytes:
    return (task / "comm").read_bytes()


def _is_dds(name: bytes) -> bool:
    return name.startswith(b"dds.")


def _state_and_waits(task: Path) -> tuple[bytes, int]:
    """State of a thread, and how often it has waited. Raises OSError, ValueError or IndexError if it has ended."""
    status = (task / "status").read_bytes()
    state = status.partition(b"\nState:")[2].split(maxsplit=1)[0]
    return state, int(status.rpartition(b"\nvoluntary_ctxt_switches:")[2].split()[0])
