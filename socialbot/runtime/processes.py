"""Operating-system processes: start, watch, stop, and when to restart them."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from socialbot.bridge import environment
from socialbot.core.process import ENDING_SIGNALS
from socialbot.runtime.supervisor_channel import CHANNEL_VARIABLE

GRACE_S = 8.0
"""How long processes may take to end after SIGINT before they are killed."""

ASKED_AGAIN_S = 3.0
"""After this time they get another SIGINT."""


class Process(Protocol):
    """A child of this process, as `subprocess.Popen` has them."""

    @property
    def pid(self) -> int: ...

    def poll(self) -> int | None: ...

    def wait(self, timeout: float | None = None) -> int: ...

    def send_signal(self, sig: int) -> None: ...

    def kill(self) -> None: ...


def environment_of(log_folder: Path) -> dict[str, str]:
    """The environment of processes whose logs go to ``log_folder``."""
    inherited = dict(os.environ)
    environment.prepare(inherited, log_folder=log_folder / "ros")
    inherited["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    return inherited


def start_process(
    arguments: list[str], log: Path, *, variables: Mapping[str, str] | None = None, lifeline: int | None = None
) -> subprocess.Popen[bytes]:
    """Starts ``socialbot *arguments``, which ends when this process does.

    ``variables`` come on top of the environment; ``lifeline`` is the file that the process speaks to its supervisor by.
    """
    inherited = {**environment_of(log.parent), **(variables or {})}
    if lifeline is not None:
        inherited[CHANNEL_VARIABLE] = str(lifeline)
    with log.open("ab") as output, blocked_signals():
        return subprocess.Popen(
            [sys.executable, "-m", "socialbot", *until_parent_ends(arguments)],
            env=inherited,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
            pass_fds=() if lifeline is None else (lifeline,),
        )


def until_parent_ends(arguments: list[str]) -> list[str]:
    """``arguments`` for a process that ends when this one does."""
    return [*arguments, "--parent", str(os.getpid())]


@contextlib.contextmanager
def blocked_signals() -> Iterator[None]:
    """A child that is started here inherits the mask, and lets signals through once it can end well."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_processes(processes: Mapping[str, Process]) -> dict[str, int]:
    """Ends them by SIGINT, after a time of grace by SIGKILL; returns their exit codes."""
    # Twice, as a signal may be lost that comes just while a process imports a module.
    for grace_s in (ASKED_AGAIN_S, GRACE_S - ASKED_AGAIN_S):
        living = [process for process in processes.values() if process.poll() is None]
        for process in living:
            process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + grace_s
        for process in living:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, deadline - time.monotonic()))
    for process in processes.values():
        if process.poll() is None:
            process.kill()
    return {name: process.wait() for name, process in processes.items()}


def how_it_ended(code: int) -> str:
    """An exit code in words."""
    return f"was ended by signal {-code}" if code < 0 else f"ended with exit code {code}"


@dataclass(frozen=True)
class RestartPolicy:
    """How patient a supervisor is.

    What dies after it has lived for longer than ``longest_s`` is started again at once. When it dies sooner it is left
    alone for ``first_s``, and each time that it does so again for twice as long, up to ``longest_s``. What has died
    more than ``times`` times in ``within_s`` is given up. A node is hung, and its process is killed, when it has not
    said for ``hung_s`` that it is well; to get ready it may take ``ready_s``.
    """

    times: int = 5
    within_s: float = 60.0
    first_s: float = 0.2
    longest_s: float = 5.0
    hung_s: float = 10.0
    ready_s: float = 60.0


class RestartBackoff:
    """The patience with one process. Times are those of a clock that only goes forward, in s."""

    def __init__(self, policy: RestartPolicy) -> None:
        self._policy = policy
        self._deaths: deque[float] = deque()
        self._started = 0.0
        self._pause_s = 0.0

    def started(self, now: float) -> None:
        """Notes that it was started."""
        self._started = now

    def died(self, now: float) -> float | None:
        """Notes that it died. Returns how long (s) to wait before it is started again; None to give it up."""
        policy = self._policy
        self._deaths.append(now)
        while self._deaths[0] < now - policy.within_s:
            self._deaths.popleft()
        if len(self._deaths) > policy.times:
            return None
        lived_long = now - self._started > policy.longest_s
        self._pause_s = 0.0 if lived_long else min(max(policy.first_s, 2 * self._pause_s), policy.longest_s)
        return self._pause_s


def in_time(pause_s: float) -> str:
    """``pause_s`` in words."""
    return f"in {pause_s:.1f} s" if pause_s else "at once"
