"""Child processes for planners: started with limits, listened to, and ended with all they started.

A planner that crashes, hangs or eats the memory costs one plan, not the robot. Its time is that in which it works or
sleeps: while others have the processor none of it passes, so that how busy the machine is decides nothing.
"""

from __future__ import annotations

import math
import os
import selectors
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

POLL_S = 0.02
"""How often somebody looks whether the plan is still wanted."""
MOST_OUTPUT = 16_000_000
"""Bytes kept of what a child writes; of more the end is kept."""
MB = 1_000_000
READY = "R"
"""The state of a process that works, or could."""
TICKS = os.sysconf("SC_CLK_TCK")
"""In a second of the time that Linux says a process has worked."""
_GUARD = str(Path(__file__).with_name("exec_with_limits.py"))


@dataclass(frozen=True, slots=True)
class ChildExit:
    """How a child ended. ``code`` is its exit code, or minus the number of the signal that killed it.

    ``seconds`` is how much of its time it has used.
    """

    how: Literal["by itself", "late", "cancelled"]
    code: int
    output: str
    errors: str
    seconds: float

    @property
    def death(self) -> str:
        """How it ended, and the last lines that it wrote as errors."""
        tail = " / ".join(line.strip() for line in self.errors.splitlines()[-5:] if line.strip())[-600:]
        return f"{self._code()}: {tail}" if tail else self._code()

    def _code(self) -> str:
        if self.code >= 0:
            return f"ended with code {self.code}"
        try:
            return f"died of {signal.Signals(-self.code).name}"
        except ValueError:
            return f"died of signal {-self.code}"


def guarded(command: Sequence[str], memory_mb: int, cpu_s: float) -> list[str]:
    """``command`` such that it runs with limits on its address space and processor time, and dies with this process."""
    limits = (str(memory_mb * MB), str(math.ceil(cpu_s)), str(os.getpid()))
    return [sys.executable, "-I", "-S", _GUARD, *limits, *command]


def run(command: Sequence[str], folder: Path, timeout_s: float, cancelled: threading.Event) -> ChildExit:
    """Runs ``command`` in ``folder`` until it ends, has used ``timeout_s``, or ``cancelled`` is set.

    Its standard input is a pipe that closes when this process ends. When it ends, by itself or not, its whole
    process group is killed. Raises OSError when it cannot be started.
    """
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        bufsize=0,
    )
    output, errors = bytearray(), bytearray()
    used = ProcessTime(process.pid)
    with process:
        try:
            how = _listen(process, {process.stdout: output, process.stderr: errors}, used, timeout_s, cancelled)
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
    texts = (heard.decode("utf-8", "replace") for heard in (output, errors))
    return ChildExit(how, process.returncode, *texts, seconds=used.seconds)


class ProcessTime:
    """The time that a process has used since this was made: at work, or asleep, but not waiting for a processor.

    Where Linux does not tell, all of the time counts.
    """

    def __init__(self, pid: int) -> None:
        self._process = Path(f"/proc/{pid}")
        self._looked = time.monotonic()
        self._worked = self._slept = 0.0

    @property
    def seconds(self) -> float:
        """What it was (s) when `look` was called last."""
        return self._worked + self._slept

    def look(self) -> float:
        """What it is (s) by now."""
        now, worked = time.monotonic(), self._worked
        with suppress(OSError):  # it has just ended, or this is not Linux
            worked = sum(map(int, _stat(self._process)[11:13])) / TICKS
        if worked == self._worked and not self._is_ready():
            self._slept += now - self._looked
        self._looked, self._worked = now, worked
        return self.seconds

    def _is_ready(self) -> bool:
        """Whether one of its threads is at work, or waits for a processor."""
        try:
            return any(_stat(thread)[0] == READY for thread in (self._process / "task").iterdir())
        except OSError:
            return False


def _stat(process: Path) -> list[str]:
    """What Linux says of a process or thread: its state, and so on."""
    # What stands before is its name, in parentheses.
    return (process / "stat").read_text("ascii", "replace").rpartition(")")[2].split()


def _listen(
    process: subprocess.Popen[bytes], heard: dict, used: ProcessTime, timeout_s: float, cancelled: threading.Event
) -> Literal["by itself", "late", "cancelled"]:
    """Reads what a child writes until it has ended (nothing unread is left then), is late or is not wanted."""
    with selectors.DefaultSelector() as selector:
        for pipe, buffer in heard.items():
            selector.register(pipe, selectors.EVENT_READ, buffer)
        while True:
            over = process.poll() is not None
            read = _read(selector, 0.0 if over else POLL_S)
            if over and not read:
                return "by itself"
            if cancelled.is_set():
                return "cancelled"
            if used.look() >= timeout_s:
                return "late"
            if not selector.get_map():
                with suppress(subprocess.TimeoutExpired):
                    process.wait(POLL_S)


def _read(selector: selectors.BaseSelector, wait_s: float) -> bool:
    """Reads what is there, waiting for it; whether there was any."""
    any_read = False
    for key, _ in selector.select(wait_s) if selector.get_map() else []:
        data = os.read(key.fd, 1 << 16)
        if data:
            any_read = True
            key.data.extend(data)
            del key.data[:-MOST_OUTPUT]
        else:
            selector.unregister(key.fileobj)
    return any_read
