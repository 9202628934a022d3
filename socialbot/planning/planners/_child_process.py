"""Child processes of planners with limits of time, memory and output.

The time of a process is that in which it runs or sleeps. Time in which it waits for a processor does not count, so the
load of the machine does not change the result.
"""

from __future__ import annotations

import os
import selectors
import signal
import subprocess
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from socialbot.core.process import proc_stat

POLL_S = 0.02
MAX_OUTPUT = 16_000_000
"""Bytes of output that are kept, from its end."""
RUNNABLE = "R"
"""State of a process that runs or waits for a processor."""
TICKS = os.sysconf("SC_CLK_TCK")
"""Clock ticks per second in the processor times of Linux."""


@dataclass(frozen=True, slots=True)
class ChildExit:
    """Result of a child process.

    Attributes:
        code: Exit code, or minus the number of the signal that killed it.
        seconds: Time that it has used.
    """

    how: Literal["by itself", "late", "cancelled"]
    code: int
    output: str
    errors: str
    seconds: float

    @property
    def crash(self) -> str:
        """Description of a crash, with the last lines of the error output."""
        tail = " / ".join(line.strip() for line in self.errors.splitlines()[-5:] if line.strip())[-600:]
        return f"{self._code()}: {tail}" if tail else self._code()

    def _code(self) -> str:
        if self.code >= 0:
            return f"ended with code {self.code}"
        try:
            return f"was killed by {signal.Signals(-self.code).name}"
        except ValueError:
            return f"was killed by signal {-self.code}"


def run(command: Sequence[str], folder: Path, timeout_s: float, cancelled: threading.Event) -> ChildExit:
    """Run a command until it ends, has used ``timeout_s``, or ``cancelled`` is set; then kill its process group.

    Raises OSError if it cannot be started.
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
            how = _communicate(process, {process.stdout: output, process.stderr: errors}, used, timeout_s, cancelled)
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
    texts = (buffers.decode("utf-8", "replace") for buffers in (output, errors))
    return ChildExit(how, process.returncode, *texts, seconds=used.seconds)


class ProcessTime:
    """Time that a process has used, running or sleeping; elapsed time where /proc is missing."""

    def __init__(self, pid: int) -> None:
        self._process = Path(f"/proc/{pid}")
        self._looked = time.monotonic()
        self._worked = self._slept = 0.0

    @property
    def seconds(self) -> float:
        """Time (s) at the last `update`."""
        return self._worked + self._slept

    def update(self) -> float:
        now, worked = time.monotonic(), self._worked
        with suppress(OSError):  # it has just ended, or this is not Linux
            worked = sum(map(int, proc_stat(self._process)[11:13])) / TICKS
        if worked == self._worked and not self._is_runnable():
            self._slept += now - self._looked
        self._looked, self._worked = now, worked
        return self.seconds

    def _is_runnable(self) -> bool:
        try:
            return any(proc_stat(thread)[0] == RUNNABLE for thread in (self._process / "task").iterdir())
        except OSError:
            return False


def _communicate(
    process: subprocess.Popen[bytes], buffers: dict, used: ProcessTime, timeout_s: float, cancelled: threading.Event
) -> Literal["by itself", "late", "cancelled"]:
    with selectors.DefaultSelector() as selector:
        for pipe, buffer in buffers.items():
            selector.register(pipe, selectors.EVENT_READ, buffer)
        while True:
            over = process.poll() is not None
            read = _read(selector, 0.0 if over else POLL_S)
            if over and not read:
                return "by itself"
            if cancelled.is_set():
                return "cancelled"
            if used.update() >= timeout_s:
                return "late"
            if not selector.get_map():
                with suppress(subprocess.TimeoutExpired):
                    process.wait(POLL_S)


def _read(selector: selectors.BaseSelector, wait_s: float) -> bool:
    any_read = False
    for key, _ in selector.select(wait_s) if selector.get_map() else []:
        data = os.read(key.fd, 1 << 16)
        if data:
            any_read = True
            key.data.extend(data)
            del key.data[:-MAX_OUTPUT]
        else:
            selector.unregister(key.fileobj)
    return any_read
