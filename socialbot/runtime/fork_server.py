"""Where the processes of a graph come from: forks of a zygote, which start in a fraction of the time."""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import msgspec

from socialbot.graph.node import Graph
from socialbot.runtime.fork_server_main import Order
from socialbot.runtime.processes import Process, blocked_signals, environment_of, start_process, until_parent_ends

log = logging.getLogger("socialbot.nursery")

ANSWER_S = 30.0
"""So long a zygote may take to import what it needs, and to fork."""

ZYGOTES = 3
"""So many are tried before all processes are started without one."""

LOOK_AGAIN_S = 0.005
LONGEST_ANSWER = 64
PR_SET_CHILD_SUBREAPER = 36
"""From Linux' headers."""


class Fork:
    """A child of this process that something else has forked, as `subprocess.Popen` has its own."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._code: int | None = None

    def poll(self) -> int | None:
        """Its exit code, minus the signal that ended it; None while it lives."""
        if self._code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self._code = os.waitstatus_to_exitcode(status)
        return self._code

    def wait(self, timeout: float | None = None) -> int:
        """Waits for its exit code. Raises subprocess.TimeoutExpired after ``timeout`` s."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if deadline is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
            time.sleep(LOOK_AGAIN_S)
        return code

    def send_signal(self, sig: int) -> None:
        """Sends it a signal, if it lives."""
        if self.poll() is None:
            os.kill(self.pid, sig)

    def kill(self) -> None:
        """Kills it, if it lives."""
        self.send_signal(signal.SIGKILL)


class ForkServer:
    """Starts processes with nodes of ``graph``, whose logs lie in ``folder``; `close` when no more are needed.

    What it has started outlives it, and its zygote. Where there can be no zygote, processes start as any program does.
    """

    def __init__(self, graph: Graph, folder: Path) -> None:
        # Others may do anything when they are imported, threads included.
        own = {placement.type.__module__ for placement in graph.placements}
        self._modules = sorted(module for module in own if module.startswith("socialbot."))
        self._folder = folder
        self._left = ZYGOTES if sys.platform == "linux" else 0
        self._zygote: subprocess.Popen[bytes] | None = None
        self._line: socket.socket | None = None

    def prepare(self) -> None:
        """Starts the zygote, which takes a while to be ready."""
        if self._line is not None or not self._left:
            return
        self._left -= 1
        self._line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._line.settimeout(ANSWER_S)
        with theirs, blocked_signals():
            self._zygote = subprocess.Popen(
                [sys.executable, "-m", "socialbot.runtime.fork_server_main", str(theirs.fileno()), *self._modules],
                env=environment_of(self._folder),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
                pass_fds=(theirs.fileno(),),
            )

    def start(
        self,
        arguments: list[str],
        log: Path,
        *,
        variables: Mapping[str, str] | None = None,
        lifeline: int | None = None,
    ) -> Process:
        """Starts ``socialbot *arguments``, as `start_process` does."""
        self.prepare()
        pid = self._order(arguments, log, variables or {}, lifeline)
        return start_process(arguments, log, variables=variables, lifeline=lifeline) if pid is None else Fork(pid)

    @property
    def zygote(self) -> int | None:
        """The id of the zygote, if there is one."""
        return None if self._zygote is None else self._zygote.pid

    def close(self) -> None:
        """Ends the zygote."""
        if self._zygote is not None:
            self._zygote.kill()
            self._zygote.wait()
        if self._line is not None:
            self._line.close()
        self._zygote = self._line = None

    def _order(
        self, arguments: list[str], file: Path, variables: Mapping[str, str], lifeline: int | None
    ) -> int | None:
        """The id of a fork; None where there is no zygote any more."""
        if self._line is None:
            return None
        order = msgspec.json.encode(Order(file.stem, until_parent_ends(arguments), dict(variables)))
        with file.open("ab") as output:
            files = [output.fileno(), *([] if lifeline is None else [lifeline])]
            try:
                with _adopting():
                    socket.send_fds(self._line, [order], files)
                    if answer := self._line.recv(LONGEST_ANSWER):
                        return int(answer)
                error = "the zygote has ended"
            except OSError as failure:
                error = str(failure)
        log.warning("%s is started without a zygote: %s", file.stem, error)
        self.close()
        return None


@contextmanager
def _adopting() -> Iterator[None]:
    """Orphans beneath this process become its children. Raises OSError where that cannot be."""
    _be_subreaper(True)
    try:
        yield
    finally:
        _be_subreaper(False)


def _be_subreaper(wanted: bool) -> None:
    if ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, int(wanted), 0, 0, 0):
        raise OSError(ctypes.get_errno(), "orphans cannot be adopted")
