"""Brings up a graph in processes of its own, watches them and takes them down."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from socialbot.bridge import environment
from socialbot.ending import ENDING_SIGNALS
from socialbot.errors import NodeError, SocialbotError
from socialbot.graph import Graph
from socialbot.graph_file import dump_graph

GRACE_S = 8.0
"""How long processes may take to end after SIGINT before they are killed."""

LOG_TAIL_LINES = 8
DOCUMENTED = frozenset({3, 4, 5, 7})
"""Exit codes by which a process says why it failed; any other failure of a node is 6."""


class Launch:
    """The processes of one graph. Use it as a context manager: leaving it ends them all.

    ``folder`` takes the graph as it runs (graph.yaml) and a log for each process.
    """

    def __init__(self, graph: Graph, folder: Path, *, sim_time: bool = False, composed: bool = False) -> None:
        self._graph = graph
        self._folder = folder
        self._sim_time = sim_time
        self._composed = composed
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self.exit_codes: dict[str, int] = {}

    def __enter__(self) -> Launch:
        environment.require_ros()
        self._folder.mkdir(parents=True, exist_ok=True)
        graph_file = self._folder / "graph.yaml"
        graph_file.write_text(dump_graph(self._graph), encoding="utf-8")
        names = [placement.name for placement in self._graph.placements]
        sim_time = ["--sim-time"] if self._sim_time else []
        try:
            for group in [names] if self._composed else [[name] for name in names]:
                process = self._graph.name if self._composed else group[0]
                self.start(process, ["node", "--graph", str(graph_file), *sim_time, *group])
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, name: str, arguments: list[str]) -> subprocess.Popen[bytes]:
        """Starts ``socialbot *arguments`` as the process ``name``, with its log in the folder."""
        variables = dict(os.environ)
        environment.prepare(variables, log_folder=self._folder / "ros")
        variables["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
        command = [sys.executable, "-m", "socialbot", *arguments, "--parent", str(os.getpid())]
        # The child inherits the mask and lets signals through once it can end well.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING_SIGNALS)
        try:
            with self._log(name).open("ab") as log:
                process = subprocess.Popen(
                    command, env=variables, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
                )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        self._processes[name] = process
        return process

    def check(self) -> None:
        """Raises NodeError when a process has ended with an error."""
        for name, process in self._processes.items():
            code = process.poll()
            if code:
                raise _failed(name, code, self._log(name))

    def stop(self) -> None:
        """Ends all processes: SIGINT, a time of grace, SIGKILL; then ``exit_codes`` holds how they ended."""
        for process in self._processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + GRACE_S
        for name, process in self._processes.items():
            try:
                process.wait(max(0.1, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            self.exit_codes[name] = process.returncode

    @property
    def pids(self) -> dict[str, int]:
        """The process ids by name."""
        return {name: process.pid for name, process in self._processes.items()}

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"


def _failed(name: str, code: int, log: Path) -> SocialbotError:
    lines = log.read_text("utf-8", errors="replace").splitlines()[-LOG_TAIL_LINES:]
    how = f"was ended by signal {-code}" if code < 0 else f"ended with exit code {code}"
    error = NodeError("\n    ".join([f"the process {how}", *lines]), where=name, remedy=f"the whole log: {log}")
    if code in DOCUMENTED:
        error.exit_code = code
    return error
