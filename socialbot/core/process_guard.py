"""Guard of a process: a second process that ends it when libraries block it, and no child outlives it for long.

Fast DDS can block a call without end, and rclpy keeps Python's lock meanwhile. Such a process cannot even handle a
signal. Its guard, which uses neither, then kills it.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from socialbot.core.process import proc_stat

END_S = 30.0
"""Time limit (s) for the end of a guarded process after SIGINT or SIGTERM."""

HUNG_S = 60.0
"""Longest time (s) between two calls of `report_alive`."""

CHILDREN_S = 8.0
"""Time limit (s) for children to end after their parent."""

ALIVE_PERIOD_S = 1.0
GUARD_END_S = 10.0  # time limit for a guard to end that is not needed any more

SCRIPT = Path(__file__).with_name("_process_guard.py")


class _Guard:
    """Guard of this process, with its time limits as `guarded` has them."""

    def __init__(self, *limits_s: float) -> None:
        self._limits = [f"{limit_s:g}" for limit_s in limits_s]
        self._children: set[int] = set()
        self._alive_at = 0.0
        self._start()

    def _start(self) -> None:
        self._end, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._end.setblocking(False)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", str(SCRIPT), str(os.getpid()), *self._limits],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )

    def fileno(self) -> int:
        return self._end.fileno()

    def send(self, message: str) -> bool:
        """Send a message; return False if the guard has ended."""
        try:
            self._end.send(message.encode(), socket.MSG_NOSIGNAL)
        except BlockingIOError:
            return True
        except OSError:
            return False
        return True

    def add_child(self, pid: int) -> None:
        self._children = {pid, *filter(_is_child, self._children)}
        self.send(f"child {pid}")

    def report_alive(self) -> None:
        """Report, and replace a guard that has ended."""
        if (now := time.monotonic()) < self._alive_at + ALIVE_PERIOD_S:
            return
        self._alive_at = now
        if not self.send("alive"):
            self._process.wait()
            self._end.close()
            self._start()
            signal.set_wakeup_fd(self.fileno(), warn_on_full_buffer=False)
            for pid in filter(_is_child, self._children):
                self.send(f"child {pid}")
            self.send("alive")

    def close(self) -> None:
        self.send("done")
        self._end.close()
        try:
            self._process.wait(GUARD_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _is_child(pid: int) -> bool:
    """Whether a process is a child of this one: the number of an ended one may be that of another."""
    try:
        return int(proc_stat(Path(f"/proc/{pid}"))[1]) == os.getpid()
    except OSError:
        return False


_guard: _Guard | None = None


@contextmanager
def guarded(end_s: float = END_S, hung_s: float = HUNG_S, children_s: float = CHILDREN_S) -> Iterator[None]:
    """Guard this process within the block: SIGINT and SIGTERM end the block, or kill the process after ``end_s``.

    The time does not count while the process is stopped (SIGSTOP, Ctrl-Z, a debugger) or the computer is suspended.
    Before, SIGQUIT lets the process write the stacks of its threads, as a crash of native code does. Only in the main
    thread, and on Linux; without effect in a guarded process.

    Args:
        end_s: Time limit (s) after a signal, or after the last call of `report_alive` if that was later.
        hung_s: Longest time (s) between two calls of `report_alive`, after the first.
        children_s: Time (s) for children of `guard_child` to end after this process, when they are killed.
    """
    global _guard
    is_main = threading.current_thread() is threading.main_thread()
    if _guard is not None or not is_main or sys.platform != "linux":
        yield
        return
    guard = _guard = _Guard(end_s, hung_s, children_s)
    before = signal.set_wakeup_fd(guard.fileno(), warn_on_full_buffer=False)
    faulthandler.register(signal.SIGQUIT, file=2, chain=True)
    if not (tells_crashes := faulthandler.is_enabled()):
        faulthandler.enable(file=2)
    try:
        yield
    finally:
        _guard = None
        signal.set_wakeup_fd(before)
        if not tells_crashes:
            faulthandler.disable()
        faulthandler.unregister(signal.SIGQUIT)
        guard.close()


def guard_child(pid: int) -> None:
    """Let the guard of this process, if it has one, kill the child ``pid`` if it outlives this process."""
    if _guard is not None:
        _guard.add_child(pid)


def report_alive() -> None:
    """Report to the guard of this process, if it has one, that this process works. Cheap; call it often.

    A killed guard is replaced. Only the main thread may call this.
    """
    if _guard is not None:
        _guard.report_alive()
