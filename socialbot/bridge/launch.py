"""Brings up a graph in processes of its own, watches them and takes them down.

Here one that dies ends them all, as is right for a replay; `socialbot.bridge.supervisor` starts it anew.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

from socialbot.bridge import environment
from socialbot.bridge.lifeline import LIFELINE_VARIABLE
from socialbot.ending import ENDING_SIGNALS
from socialbot.errors import NodeError, SocialbotError
from socialbot.graph import Graph
from socialbot.graph_file import dump_graph

GRACE_S = 8.0
"""How long processes may take to end after SIGINT before they are killed."""

ASKED_AGAIN_S = 3.0
"""After this time they get another SIGINT."""

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
        graph_file = write_graph(self._graph, self._folder)
        try:
            for name, nodes in processes_of(self._graph, composed=self._composed).items():
                self.start(name, node_arguments(graph_file, nodes, sim_time=self._sim_time))
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, name: str, arguments: list[str]) -> subprocess.Popen[bytes]:
        """Starts ``socialbot *arguments`` as the process ``name``, with its log in the folder."""
        process = self._processes[name] = start_process(arguments, log_file(self._folder, name))
        return process

    def check(self) -> None:
        """Raises NodeError when a process has ended with an error."""
        for name, process in self._processes.items():
            code = process.poll()
            if code:
                raise failure(name, code, log_file(self._folder, name))

    def stop(self) -> None:
        """Ends all processes; then ``exit_codes`` holds how they ended."""
        self.exit_codes.update(end_processes(self._processes))

    @property
    def pids(self) -> dict[str, int]:
        """The process ids by name."""
        return {name: process.pid for name, process in self._processes.items()}


def write_graph(graph: Graph, folder: Path) -> Path:
    """Writes ``graph`` into ``folder``, for its processes to read."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "graph.yaml"
    file.write_text(dump_graph(graph), encoding="utf-8")
    return file


def processes_of(graph: Graph, *, composed: bool) -> dict[str, list[str]]:
    """The nodes of each process by its name: one each, or all of them ``composed``."""
    names = [placement.name for placement in graph.placements]
    return {graph.name: names} if composed else {name: [name] for name in names}


def node_arguments(graph_file: Path, nodes: list[str], *, sim_time: bool = False) -> list[str]:
    """The arguments of ``socialbot`` for a process with these ``nodes``."""
    return ["node", "--graph", str(graph_file), *(["--sim-time"] if sim_time else []), *nodes]


def log_file(folder: Path, name: str) -> Path:
    """The log of the process ``name``."""
    return folder / f"{name}.log"


def start_process(
    arguments: list[str], log: Path, *, variables: Mapping[str, str] | None = None, lifeline: int | None = None
) -> subprocess.Popen[bytes]:
    """Starts ``socialbot *arguments``, which ends when this process does.

    ``variables`` come on top of the environment; ``lifeline`` is the file that the process speaks to its supervisor by.
    """
    inherited = {**os.environ, **(variables or {})}
    environment.prepare(inherited, log_folder=log.parent / "ros")
    inherited["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    if lifeline is not None:
        inherited[LIFELINE_VARIABLE] = str(lifeline)
    command = [sys.executable, "-m", "socialbot", *arguments, "--parent", str(os.getpid())]
    # The child inherits the mask and lets signals through once it can end well.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING_SIGNALS)
    try:
        with log.open("ab") as output:
            return subprocess.Popen(
                command,
                env=inherited,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
                pass_fds=() if lifeline is None else (lifeline,),
            )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_processes(processes: Mapping[str, subprocess.Popen[bytes]]) -> dict[str, int]:
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
            process.wait()
    return {name: process.returncode for name, process in processes.items()}


def how_it_ended(code: int) -> str:
    """An exit code in words."""
    return f"was ended by signal {-code}" if code < 0 else f"ended with exit code {code}"


def failure(name: str, code: int, log: Path) -> SocialbotError:
    """The error that says that the process ``name`` ended with ``code``, and what it logged last."""
    lines = log.read_text("utf-8", errors="replace").splitlines()[-LOG_TAIL_LINES:]
    what = "\n    ".join([f"the process {how_it_ended(code)}", *lines])
    error = NodeError(what, where=name, remedy=f"the whole log: {log}")
    if code in DOCUMENTED:
        error.exit_code = code
    return error
