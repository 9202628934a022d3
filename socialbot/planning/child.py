"""Child processes for planners: started with limits, listened to, and ended with all they started.

A planner that crashes, hangs or eats the memory costs one plan, not the robot.
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
_GUARD = str(Path(__file__).with_name("guard.py"))


@dataclass(frozen=True, slots=True)
class Ended:
    """How a child ended. ``code`` is its exit code, or minus the number of the signal that killed it."""

    how: Literal["by itself", "late", "cancelled"]
    code: int
    output: str
    errors: str

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


def run(command: Sequence[str], folder: Path, timeout_s: float, cancelled: threading.Event) -> Ended:
    """Runs ``command`` in ``folder`` until it ends, ``timeout_s`` are over, or ``cancelled`` is set.

    Its standard input is a pipe that closes when this process ends. When it ends, by itself or not, its whole
    process group is killed. Raises OSError when it cannot be started.
    """
    end = time.monotonic() + timeout_s
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
    with process:
        try:
            how = _listen(process, {process.stdout: output, process.stderr: errors}, end, cancelled)
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
    return Ended(how, process.returncode, output.decode("utf-8", "replace"), errors.decode("utf-8", "replace"))


def _listen(
    process: subprocess.Popen[bytes], heard: dict, end: float, cancelled: threading.Event
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
            if time.monotonic() >= end:
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
