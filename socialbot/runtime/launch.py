"""Launch a graph in separate processes.

A crashed process ends them all, as a replay requires; `socialbot.runtime._supervisor` restarts it instead.
"""

from __future__ import annotations

from pathlib import Path

from socialbot.bridge import environment
from socialbot.core.errors import NodeError, SocialbotError
from socialbot.graph.files import dump_graph
from socialbot.graph.node import Graph
from socialbot.runtime._processes import Process, end_processes, how_it_ended
from socialbot.runtime.fork_server import ForkServer

LOG_TAIL_LINES = 8
DOCUMENTED = frozenset({3, 4, 5, 7})
"""Exit codes with a documented meaning; any other failure of a node is 6."""


class Launch:
    """Processes of one graph, as a context manager that ends them all.

    ``folder`` receives the graph (graph.yaml) and a log of each process.
    """

    def __init__(self, graph: Graph, folder: Path, *, sim_time: bool = False, composed: bool = False) -> None:
        self._graph = graph
        self._folder = folder
        self._sim_time = sim_time
        self._composed = composed
        self._fork_server = ForkServer(graph, folder)
        self._processes: dict[str, Process] = {}
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

    def start(self, name: str, arguments: list[str]) -> Process:
        """Start ``socialbot *arguments`` as the process ``name`` with its log."""
        process = self._processes[name] = self._fork_server.start(arguments, log_file(self._folder, name))
        return process

    def check(self) -> None:
        """Raises NodeError if a process has failed."""
        for name, process in self._processes.items():
            code = process.poll()
            if code:
                raise failure(name, code, log_file(self._folder, name))

    def stop(self) -> None:
        """End all processes and set ``exit_codes``."""
        self._fork_server.close()
        self.exit_codes.update(end_processes(self._processes))

    @property
    def pids(self) -> dict[str, int]:
        return {name: process.pid for name, process in self._processes.items()}


def write_graph(graph: Graph, folder: Path) -> Path:
    """Write ``graph`` to ``folder``; return the file."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "graph.yaml"
    file.write_text(dump_graph(graph), encoding="utf-8")
    return file


def processes_of(graph: Graph, *, composed: bool) -> dict[str, list[str]]:
    """The nodes of each process by its name: one process for each node, or a single ``composed`` one."""
    names = [placement.name for placement in graph.placements]
    return {graph.name: names} if composed else {name: [name] for name in names}


def node_arguments(graph_file: Path, nodes: list[str], *, sim_time: bool = False) -> list[str]:
    """The arguments of ``socialbot`` to run ``nodes``."""
    return ["node", "--graph", str(graph_file), *(["--sim-time"] if sim_time else []), *nodes]


def log_file(folder: Path, name: str) -> Path:
    """The log file of the process ``name``."""
    return folder / f"{name}.log"


def failure(name: str, code: int, log: Path) -> SocialbotError:
    """Return the error for a failed process, with its exit code and the end of its log."""
    lines = log.read_text("utf-8", errors="replace").splitlines()[-LOG_TAIL_LINES:]
    what = "\n    ".join([f"the process {how_it_ended(code)}", *lines])
    error = NodeError(what, where=name, remedy=f"the whole log: {log}")
    if code in DOCUMENTED:
        error.exit_code = code
    return error
