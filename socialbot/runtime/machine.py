"""Run a graph on live sensors under supervision, or the nodes of one machine of a deployment."""

from __future__ import annotations

import logging
import os
import secrets
import time
from collections.abc import Callable, Collection, Iterator, Mapping, MutableMapping
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from socialbot.agents.base.agent_node import AgentNode
from socialbot.bridge import environment
from socialbot.bridge.dds_threads import ENDLESS_S, EndlessWork
from socialbot.bridge.diagnostics import MACHINE_VARIABLE, health_in, unconnected
from socialbot.bridge.environment import DRIVERS_VARIABLE, KEYS_VARIABLE, OPEN_TOPICS_VARIABLE, give_up
from socialbot.bridge.graph_observer import LostWatch, SpinWatch, expect_free_names, observe_graph
from socialbot.bridge.ros_checks import shared_memory
from socialbot.bridge.run_announcer import RunAnnouncer, run_lock
from socialbot.bridge.shared_memory import LOST_PORT, PortWatch
from socialbot.bridge.translator import with_standard_types
from socialbot.core import paths
from socialbot.core.clock import WallClock
from socialbot.core.errors import ParameterError
from socialbot.core.messages import Health
from socialbot.core.process_guard import report_alive
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.node import Graph
from socialbot.runs.record import MINDS
from socialbot.runtime._lost_publishers import RENEWAL_PAUSE_S, RenewalBackoff
from socialbot.runtime._network import DiscoveryServer, Network
from socialbot.runtime._processes import RestartPolicy, node_arguments, write_graph
from socialbot.runtime.deployment import Deployment, is_own
from socialbot.runtime.launch import DeadNodeDiagnostics, RecordDiagnostics, Supervisor, Variables
from socialbot.runtime.run import Execution, Runner, RunSource, observed_topics, with_speech_files

ATTEND_S = 0.1

CLOCK_JUMP_S = 0.5  # threshold below which clock changes are not logged
DEAF_S = 5.0
"""Longest time (s) for which a restarted process may receive nothing after the clock was set back."""
log = logging.getLogger("socialbot.runtime.live")


@dataclass
class LiveSource(RunSource):
    """Live sensors as a source, until SIGINT, SIGTERM or ``socialbot down``. Restarts crashed processes.

    Attributes:
        nodes: Names of the nodes to run and observe; None means all.
        state_folder: Folder of the agents' saved state; by default a new one in the record.
        policy: Restart policy of processes.
        variables: Additional environment variables of a process, by its nodes.
        services: Context of the services beside the graph; entered again after each restart of all processes.
        missed: Start times (monotonic s) of processes that missed a service, returned once after it came up.
    """

    nodes: Collection[str] | None = None
    state_folder: Path | None = None
    policy: RestartPolicy | None = None
    variables: Variables = lambda nodes: {}
    services: Callable[[], AbstractContextManager[object]] = nullcontext
    missed: Callable[[], tuple[float, float] | None] = lambda: None

    def prepare(self, graph: Graph, runner: Runner, folder: Path) -> Graph:
        return with_state_files(with_speech_files(graph, folder), self.state_folder or folder / MINDS)

    def execute(self, execution: Execution) -> None:
        """Raises what `Supervisor.attend` does."""
        watch = ClockWatch(WallClock())
        if (memory := shared_memory()) is not None and memory.state != "ok":
            log.warning("%s: %s", memory.text, memory.remedy)
        well: frozenset[str] | None = None
        while not execution.ending.asked:
            up = _NodesUp(self, execution, watch, well)
            with self.services(), run_lock(up.run), closing(up):
                while fault := up.attend():
                    log.error("%s; up observes the graph again with a new DDS participant; see docs/attacks.md", fault)
            well = up.supervisor.well
            if not execution.ending.asked:
                log.warning("restart everything: %s", up.why)


class _NodesUp:
    """Supervised nodes of a ``source``, with the observer that records them; ``well`` is None at the first start."""

    def __init__(
        self, source: LiveSource, execution: Execution, watch: ClockWatch, well: frozenset[str] | None
    ) -> None:
        self._source, self._execution, self._graph = source, execution, execution.graph
        self._watch = watch
        self.run = secrets.token_hex(8)
        self._begun = time.monotonic()
        self._is_first = well is None
        self._outputs = {config.name: tuple(topic for topic, _ in config.publications) for config in self._graph.nodes}
        self.why = "a service came up after the start"
        """Why all processes are started again, if they are."""
        self._observers = 0
        self._given_up: frozenset[int] = frozenset()
        self._renewals = RenewalBackoff()
        self.supervisor = Supervisor(
            self._graph,
            execution.logs,
            composed=execution.composed,
            policy=source.policy,
            nodes=source.nodes,
            variables=source.variables,
            well=well,
        )

    def attend(self) -> str:
        """Observe the nodes, which are started unless they run, until all shall end.

        Returns:
            Why DDS gives the observer nothing, if so. The nodes go on then, without an observer.
        """
        graph, source, ending = self._graph, self._source, self._execution.ending
        self.supervisor.prepare()
        self._observers += 1
        name = f"observer_{self._observers}" if self._observers > 1 else "observer"
        observed = observed_topics(graph, source.nodes)
        topics = {topic: kind for topic, kind in observed.items() if kind is not Health}  # /diagnostics has it
        with (
            with_standard_types(graph, self._execution.observe, source.nodes) as observe,
            observe_graph(topics, observe, self._note, graph.wire, name=name) as observer,
            ExitStack() as ends,
        ):
            announcer = RunAnnouncer(observer.ros, graph.name, ending.ask, self.run)
            if self._is_first and self._observers == 1:  # a duplicate that appears later is only logged
                expect_free_names(observer.ros, graph, source.nodes)
            ends.push(announcer)
            self.supervisor.is_observed = lambda nodes: not unconnected(observer.connections(graph, nodes))
            if self._observers == 1:
                ends.enter_context(self.supervisor)
            else:
                ends.push(self.supervisor)
            spin, work, lost = (
                SpinWatch(observer.ros),
                EndlessWork(os.getpid(), self._given_up),
                LostWatch(observer, graph),
            )
            ports = PortWatch(os.getpid())
            self._renewals.started()
            diagnostics = DeadNodeDiagnostics(observer.ros, self.supervisor)
            record_diagnostics = RecordDiagnostics(observer.ros, graph.name, self._execution.record)
            while not (ending.asked or restarted(self.supervisor, self._begun, source.missed()) or self._is_deaf()):
                report_alive()
                self.supervisor.attend(ATTEND_S)
                if spin.is_blocked() or work.longest_s(time.monotonic()) >= ENDLESS_S:
                    self._given_up |= give_up(observer.ros)
                    ends.pop_all()
                    return "DDS does not answer this process"
                topic = LOST_PORT if ports.is_lost(time.monotonic()) else self.supervisor.running.lost(lost.lost)
                if self._renewals.is_due(is_lost=bool(topic)):
                    ends.pop_all()
                    return f"this process does not receive {topic} any more"
                diagnostics.publish()
                record_diagnostics.publish()
                announcer.announce()
                self._watch.check()
        return ""

    def _is_deaf(self) -> bool:
        """Return whether a process died after the clock was set back.

        The shared memory of DDS finds dead readers by the time of day. Until the clock has caught up, the others may
        write for the dead process, and not for the new one in its place. Fault runs show this even if all processes
        have begun since the clock was set. Then the graph must have lived for a while, so that a process that crashes
        again and again is given up by its restart policy.
        """
        watch = self._watch
        if self._begun > watch.set_back_at and time.monotonic() - self._begun < RENEWAL_PAUSE_S:
            return False
        again = (one.started for one in self.supervisor.members.values() if one.restarts and one.process is not None)
        if not any(watch.set_back_at < at < watch.caught_up_at for at in again):
            return False
        self.why = "a process died after the clock was set back, so that DDS would send it nothing"
        return True

    def close(self) -> None:
        """End the nodes, if that was not done before."""
        self.supervisor.stop()

    def _note(self, name: str, values: dict[str, str]) -> None:
        if name in self._outputs:  # other programs may publish on /diagnostics, too
            now = self._watch.clock.now()
            self._execution.record.note_node(now, name, values)
            if (health := health_in(name, values, now, self._outputs[name])) is not None:
                self._execution.observe(HEALTH_TOPIC, health)
            if self._source.nodes is not None and name not in self._source.nodes:  # the others report directly
                self.supervisor.running.note(name, values.get("state", ""))


def restarted(supervisor: Supervisor, begun: float, missed: tuple[float, float] | None) -> bool:
    """Restart processes that ``missed`` a service; return True if the caller, started at ``begun``, missed it too."""
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
    set_back_at: float = 0.0
    """When the clock was set back by more than `DEAF_S` (monotonic s)."""
    caught_up_at: float = 0.0
    """When it will be as late as it was before (monotonic s)."""

    def check(self) -> None:
        """Compare the clocks once."""
        behind_s = self.clock.behind_s
        if abs(behind_s - self.logged_s) < CLOCK_JUMP_S:
            return
        back_s = self.logged_s - behind_s
        if back_s > DEAF_S:
            self.set_back_at = time.monotonic()
            self.caught_up_at = max(self.caught_up_at, self.set_back_at + back_s)
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
    for config in graph.nodes:
        known = config.type.parameters()
        for parameter in {"mind_file", "memory_file"} & known.keys() - config.parameters.keys():
            if not issubclass(config.type, AgentNode) or config.type.keeps_mind:
                files[config.name] = {parameter: str((folder / f"{config.name}.json").resolve())}
    return graph.with_parameters(files)


def enter(
    deployment: Deployment,
    machine: str,
    variables: MutableMapping[str, str] = os.environ,
    *,
    raw_pictures: bool = False,
) -> None:
    """Set the ``variables`` of ``machine``: ROS domain, discovery, key and name; see `environment.prepare`.

    For this process, call it before rclpy starts. Raises GraphError for an unknown machine.
    """
    deployment.address(machine)
    across = deployment.across(machine)
    environment.prepare(variables, domain=deployment.domain, across=across, raw_pictures=raw_pictures)
    variables[MACHINE_VARIABLE] = machine
    if deployment.keys is not None:
        variables[KEYS_VARIABLE] = f"{deployment.keys}:{machine}"
        variables[OPEN_TOPICS_VARIABLE] = ":".join(deployment.open_topics)
    if deployment.drivers is not None:
        variables[DRIVERS_VARIABLE] = deployment.drivers.text()


@dataclass(frozen=True)
class NodeProcess:
    """Process of one node: name, arguments of ``socialbot node`` and additional environment variables."""

    name: str
    arguments: tuple[str, ...]
    variables: Mapping[str, str]


@contextmanager
def machine_source(
    deployment: Deployment, machine: str, logs: Path, state_folder: Path | None = None
) -> Iterator[LiveSource]:
    """Configure this process for ``machine``; return the source of its nodes, and monitor its network meanwhile.

    Machines may start in any order. ``state_folder`` overrides that of the deployment. Raises GraphError for an unknown
    machine.
    """
    enter(deployment, machine)

    def variables(nodes: Collection[str]) -> Mapping[str, str]:
        prepared: dict[str, str] = {}
        raw = any(map(deployment.raw_pictures, nodes))
        environment.prepare(prepared, across=deployment.across(machine), raw_pictures=raw)
        settings = [deployment.processes[node] for node in nodes if node in deployment.processes]
        own = settings[0].variables() if settings else {}
        return {environment.DATAGRAM_VARIABLE: prepared[environment.DATAGRAM_VARIABLE], **own}

    with Network(deployment.address(machine)) as network:
        yield LiveSource(
            nodes=[config.name for config in deployment.half(machine)],
            state_folder=state_folder or deployment.minds,
            policy=deployment.restart,
            variables=variables,
            services=lambda: discovery(deployment, machine, logs),
            missed=network.missed,
        )


def discovery(deployment: Deployment, machine: str, logs: Path) -> AbstractContextManager[object]:
    """Run the discovery server of the deployment within the block, if assigned to ``machine``."""
    server = deployment.server
    if server is None or server.machine != machine or not is_own(address := deployment.address(machine)):
        return nullcontext()
    return DiscoveryServer(address, server.port, logs / "discovery_server.log", deployment.restart)


def graph_processes(
    graph: Graph, folder: Path, *, state_folder: Path | None = None, sim_time: bool = False
) -> list[NodeProcess]:
    """Return a process for each node of ``graph``, for ``ros2 launch``; they end with the caller.

    ``folder`` receives the graph file and, without a ``state_folder``, the saved state of agents.
    """
    file = write_graph(with_state_files(graph, state_folder or folder / MINDS), folder.resolve())
    prepared = dict(os.environ)
    environment.prepare(prepared)
    paths.allow(folder, prepared)
    parent = ("--parent", str(os.getpid()))
    return [
        NodeProcess(
            name=config.name,
            arguments=(*node_arguments(file, [config.name], sim_time=sim_time)[1:], *parent),
            variables=_changed(prepared),
        )
        for config in graph.nodes
    ]


def machine_processes(
    deployment: Deployment, machine: str, folder: Path, graph: Graph | None = None
) -> list[NodeProcess]:
    """Return a process for each node of one machine; ``graph`` overrides that of the deployment.

    Raises GraphError for an unknown machine.
    """
    names = {config.name for config in deployment.half(machine)}
    found = []
    for process in graph_processes(graph or deployment.graph, folder, state_folder=deployment.minds):
        if process.name in names:
            prepared = dict(os.environ)
            enter(deployment, machine, prepared, raw_pictures=deployment.raw_pictures(process.name))
            if process.name in deployment.processes:
                prepared |= deployment.processes[process.name].variables()
            found.append(replace(process, variables={**process.variables, **_changed(prepared)}))
    return found


def _changed(prepared: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in prepared.items() if os.environ.get(name) != value}
