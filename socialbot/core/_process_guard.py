"""Script that kills a process which does not end or hangs, and its children that outlive it.

``python -I -S _process_guard.py PID END_S HUNG_S CHILDREN_S`` reads messages of the process PID from its standard
input, a socket; see `socialbot.core.process_guard`. A message is one of these:

- a byte with the number of a signal, which Python's handler in C writes also while a library holds Python's lock;
- ``child PID``: a child that ends when the process does;
- ``alive``: the process works; from the first one on, it must repeat this;
- ``done``: the process needs no guard any more.

It is a script that imports no package, so it starts fast and needs little memory.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time

STEP_S = 0.5
"""Longest step of a time limit: a computer that was suspended, or has no time for this process, takes more."""

STARVED_LIMITS = 6  # so many time limits are too many also for a process that waits for a processor
DUMP_S = 1.0  # time for a process to write the stacks of its threads
END_REQUESTS = {bytes([number]) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
MAX_BYTES = 64


class Guard:
    """Guard of the process ``pid`` with time limits (s): to end after a signal, without a sign of life, of children."""

    def __init__(self, pid: int, end_s: float, hung_s: float, children_s: float, *, proc: str = "/proc") -> None:
        self._pid, self._end_s, self._hung_s, self._children_s = pid, end_s, hung_s, children_s
        self._folder = f"{proc}/{pid}"
        self._process = os.pidfd_open(pid)
        self._children: set[int] = set()
        self._ending_s: float | None = None
        self._silent_s: float | None = None
        self._waits_s: dict[str, float] = {}

    def watch(self) -> None:
        """Watch until the process is done or has ended; then end its children."""
        before = time.monotonic()
        while True:
            ready, _, _ = select.select([0, *self._children], [], [], STEP_S)
            now = time.monotonic()
            if not self._is_stopped():
                self.count(min(now - before, STEP_S))
            before = now
            self._forget(ready)
            if 0 in ready:
                message = os.read(0, MAX_BYTES)
                if message == b"done":
                    return
                if not message:
                    break
                self.note(message)
            if reason := self.reason():
                self._kill(reason)
                break
        self._end_children()

    def count(self, passed_s: float) -> None:
        """Count the time since the last call, less that in which the process waited for a processor."""
        passed_s = max(passed_s - self._starved_s(), passed_s / STARVED_LIMITS)
        if self._ending_s is not None:
            self._ending_s += passed_s
        if self._silent_s is not None:
            self._silent_s += passed_s

    def _starved_s(self) -> float:
        """The wait for a processor (s) since the last look, of the thread that waited longest."""
        before, self._waits_s = self._waits_s, {}
        try:
            for thread in os.listdir(f"{self._folder}/task"):
                with open(f"{self._folder}/task/{thread}/schedstat", "rb") as file:
                    self._waits_s[thread] = int(file.read().split()[1]) / 1e9
        except (OSError, IndexError):  # a thread has ended, or Linux does not count
            pass
        return max((wait_s - before.get(thread, wait_s) for thread, wait_s in self._waits_s.items()), default=0.0)

    def note(self, message: bytes) -> None:
        """Note a message of the process."""
        word, _, number = message.partition(b" ")
        if message in END_REQUESTS:
            if self._ending_s is None:
                self._ending_s = 0.0
        elif message == b"alive":
            self._silent_s = 0.0
            self._ending_s = self._ending_s and 0.0
        elif word == b"child":
            try:
                self._children.add(os.pidfd_open(int(number)))
            except ProcessLookupError:
                return

    def reason(self) -> str:
        """Return why the process is killed; empty as long as it is well."""
        if self._ending_s is not None:
            return f"did not end within {self._end_s:g} s after a signal" if self._ending_s > self._end_s else ""
        if self._silent_s is not None and self._silent_s > self._hung_s:
            return f"hung for {self._hung_s:g} s"
        return ""

    def _kill(self, reason: str) -> None:
        """Let the process write the stacks of its threads, which needs no lock of Python; kill it."""
        os.write(2, f"process {self._pid} {reason} and is killed; its threads:\n".encode())
        for number in (signal.SIGQUIT, signal.SIGKILL):
            try:
                signal.pidfd_send_signal(self._process, number)
            except ProcessLookupError:
                return
            select.select([self._process], [], [], DUMP_S)

    def _end_children(self) -> None:
        """Kill children that do not end in time."""
        deadline = time.monotonic() + self._children_s
        while self._children and (left_s := deadline - time.monotonic()) > 0:
            self._forget(select.select(list(self._children), [], [], left_s)[0])
        for child in self._children:
            try:
                signal.pidfd_send_signal(child, signal.SIGKILL)
            except ProcessLookupError:
                continue

    def _forget(self, ended: list[int]) -> None:
        for child in self._children.intersection(ended):
            self._children.remove(child)
            os.close(child)

    def _is_stopped(self) -> bool:
        """Whether the process is stopped by a signal or a debugger."""
        try:
            with open(f"{self._folder}/stat", "rb") as stat:
                return stat.read().rpartition(b")")[2].split()[0] in b"Tt"
        except OSError:
            return False


if __name__ == "__main__":
    Guard(int(sys.argv[1]), *map(float, sys.argv[2:])).watch()
