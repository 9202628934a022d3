"""Run a graph on live sensors under supervision, until a signal."""

from __future__ import annotations

import logging
import time
from collections.abc import Collection
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from socialbot.agents.base.agent_node import AgentNode
from socialbot.core import paths
from socialbot.core.clock import WallClock
from socialbot.core.errors import ParameterError
from socialbot.graph.node import Graph
from socialbot.runtime._processes import RestartPolicy
from socialbot.runtime._supervisor import Supervisor, Variables, no_variables
from socialbot.runtime.run import Execution, Runner, RunSource, observed_topics, with_speech_files
from socialbot.runtime.run_lock import run_lock

ATTEND_S = 0.1

CLOCK_JUMP_S = 0.5
"""Threshold below which clock changes are not logged."""

log = logging.getLogger("socialbot.runtime.live")


class RunServices:
    """Services of a live run besides its graph; none by default."""

    def running(self) -> AbstractContextManager[object]:
        """Context in which the services run; entered again after each restart of all processes."""
        return nullcontext()

    def missed(self) -> tuple[float, float] | None:
        """Start times (monotonic s) of processes that missed a service, returned once after it came up."""
        return None


@dataclass
class LiveSource(RunSource):
    """Live sensors as a source, until SIGINT, SIGTERM or ``socialbot down``. Restarts crashed processes.

    Attributes:
        nodes: Names of the nodes to run and observe; None means all.
        state_folder: Folder of the agents' saved state; by default a new one in the record.
        policy: Restart policy of processes.
        variables: Additional environment variables of a process, by its nodes.
        services: Services beside the graph.
    """

    nodes: Collection[str] | None = None
    state_folder: Path | None = None
    policy: RestartPolicy | None = None
    variables: Variables = no_variables
    services: RunServices = field(default_factory=RunServices)

    def prepare(self, graph: Graph, runner: Runner, folder: Path) -> Graph:
        return with_state_files(with_speech_files(graph, folder), self.state_folder or folder / "minds")

    def execute(self, execution: Execution) -> None:
        """Raises what `Supervisor.attend` does."""
        from socialbot.bridge.graph_observer import expect_free_names, observe_graph
        from socialbot.bridge.run_announcer import RunAnnouncer
        from socialbot.runtime._supervisor import DeadNodeDiagnostics

        graph, record, ending = execution.graph, execution.record, execution.ending
        clock, names = WallClock(), {config.name for config in graph.placements}

        def note(name: str, values: dict[str, str]) -> None:
            if name in names:  # other programs may publish on /diagnostics, too
                record.note_node(clock.now(), name, values)

        watch = ClockWatch(clock)
        well: frozenset[str] | None = None
        while not ending.asked:
            begun = time.monotonic()
            topics = observed_topics(graph, self.nodes)
            with self.services.running(), observe_graph(topics, execution.observe, note, graph.wire) as onlooker:
                announcer = RunAnnouncer(onlooker.ros, graph.name, ending.ask)
                with run_lock(announcer.run):
                    if well is None:  # a duplicate that appears later is only logged
                        expect_free_names(onlooker.ros, graph, self.nodes)
                    supervisor = Supervisor(
                        graph,
                        execution.logs,
                        composed=execution.composed,
                        policy=self.policy,
                        nodes=self.nodes,
                        variables=self.variables,
                        well=well or (),
                    )
                    with announcer, supervisor:
                        diagnostics = DeadNodeDiagnostics(onlooker.ros, supervisor)
                        while not (ending.asked or restarted(supervisor, begun, self.services)):
                            supervisor.attend(ATTEND_S)
                            diagnostics.publish()
                            announcer.announce()
                            watch.check()
                        well = supervisor.well
            if not ending.asked:
                log.warning("restart everything: a service came up after the start")


def restarted(supervisor: Supervisor, begun: float, services: RunServices) -> bool:
    """Restart processes that missed a service; return True if the caller, started at ``begun``, missed it too."""
    missed = services.missed()
    if missed is None:
        return False
    begin, end = missed
    if begin <= begun <= end:
        return True
    supervisor.renew(begin, end)
    return False


@dataclass
class ClockWatch:
    """Logger of changes of the system clock, which the ``clock`` of the graph does not follow."""

    clock: WallClock
    logged_s: float = 0.0
    """Difference of both clocks at the last log line."""

    def check(self) -> None:
        """Compare the clocks once."""
        behind_s = self.clock.behind_s
        if abs(behind_s - self.logged_s) < CLOCK_JUMP_S:
            return
        log.warning(
            "the clock of this computer was set %s by %.1f s; the graph keeps its own time, which is %.1f s %s:"
            " restart it to use the new time",
            "forward" if behind_s > self.logged_s else "back",
            abs(behind_s - self.logged_s),
            abs(behind_s),
            "behind" if behind_s > 0 else "ahead",
        )
        self.logged_s = behind_s


def with_state_files(graph: Graph, folder: Path) -> Graph:
    """Return ``graph`` with agents that save their state in ``folder``, unless they name a file of their own.

    Raises ParameterError when the folder cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        remedy = "name another folder"
        raise ParameterError(f"cannot make the folder: {error.strerror}", where=str(folder), remedy=remedy) from error
    paths.allow(folder)
    files: dict[str, dict[str, object]] = {}
    for config in graph.placements:
        known = config.type.parameters()
        for parameter in {"mind_file", "memory_file"} & known.keys() - config.parameters.keys():
            if not issubclass(config.type, AgentNode) or config.type.keeps_mind:
                files[config.name] = {parameter: str((folder / f"{config.name}.json").resolve())}
    return graph.with_parameters(files)
