"""Launch the processes of a graph; supervise their activation, restarts, logs, and the diagnostics of dead nodes."""

from __future__ import annotations

import contextlib
import logging
import math
import signal
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector
from typing import Any

from socialbot.bridge import environment
from socialbot.bridge.dds_threads import ENDLESS_S, EndlessWork
from socialbot.bridge.diagnostics import LAST_ERROR_VARIABLE, RESTARTS_VARIABLE, DiagnosticsPublisher, status_of
from socialbot.bridge.process import Report, SupervisorChannel, channel_pair
from socialbot.bridge.shared_memory import LOST_PORT, PortWatch, remove_stale
from socialbot.core.bounded_log import Rotation
from socialbot.core.errors import DeviceError, InstallationError, NodeError
from socialbot.core.process import kill_before_others
from socialbot.core.process_guard import report_alive
from socialbot.graph.node import Graph
from socialbot.graph.status import ACTIVE
from socialbot.runs.record import RunTrace
from socialbot.runtime._lost_publishers import RenewalBackoff, RunningNodes
from socialbot.runtime._processes import (
    DOCUMENTED,
    Process,
    ProcessorWaits,
    RestartBackoff,
    RestartPolicy,
    end_processes,
    failure,
    how_it_ended,
    in_time,
    is_late,
    log_file,
    memory_kills,
    node_arguments,
    processes_of,
    reported_error,
    write_graph,
)
from socialbot.runtime.fork_server import ForkServer


@contextmanager
def _starting(graph: Graph, stop: Callable[[], None]) -> Iterator[None]:
    """Call ``stop`` if the processes of ``graph`` cannot be started. Raises NodeError if the system refuses one."""
    try:
        yield
    except BaseException as error:
        stop()
        if not isinstance(error, OSError):
            raise
        remedy = "allow more open files (ulimit -n) and processes (ulimit -u), or free some memory"
        what = f"a process cannot be started: {error.strerror}"
        raise NodeError(what, where=graph.name, remedy=remedy) from error


class Launch:
    """Processes of one graph, as a context manager that ends them all. A replay requires every one of them.

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
        with _starting(self._graph, self.stop):
            for name, nodes in processes_of(self._graph, composed=self._composed).items():
                self.start(name, node_arguments(graph_file, nodes, sim_time=self._sim_time))
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, name: str, arguments: list[str]) -> Process:
        """Start ``socialbot *arguments`` as the process ``name`` with its log."""
        process = self._processes[name] = self._fork_server.start(arguments, log_file(self._folder, name))
        return process

    def check(self) -> None:
        """Report that this process is alive. Raises NodeError if a process of the graph has failed."""
        report_alive()
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


CONFIGURED_S = 10.0  # time limit for all nodes to be configured and observed; then the configured ones start
ACTIVE_S = 1.0  # time limit for a node to become active before the next one is activated


def sinks_first(graph: Graph) -> list[str]:
    """Return the names of the nodes, subscribers before publishers as far as possible."""
    subscribers = {
        config.name: {
            other.name
            for other in graph.nodes
            if other is not config
            and {topic for topic, _ in other.subscriptions} & {topic for topic, _ in config.publications}
        }
        for config in graph.nodes
    }
    left = list(reversed(subscribers))
    order: list[str] = []
    while left:
        # In a cycle of subscriptions, take the node with the fewest remaining subscribers.
        name = min(left, key=lambda name: len(subscribers[name].intersection(left)))
        left.remove(name)
        order.append(name)
    return order


class BringUp:
    """Bring-up sequence: calls ``activate`` for the nodes in ``order``, one after the other. Times are in s.

    ``is_observed`` tells whether the recorder is connected to nodes.
    """

    def __init__(
        self,
        order: Collection[str],
        activate: Callable[[str], None],
        now: float,
        is_observed: Callable[[Collection[str]], bool] = lambda nodes: True,
    ) -> None:
        self._waiting = list(order)
        self._activate = activate
        self._begun = now
        self._is_observed = is_observed
        self._asked = ""
        self._asked_at = now

    def look(self, inactive: Collection[str], dead: Collection[str], now: float) -> None:
        """Activate further nodes if possible. ``inactive`` nodes are configured, ``dead`` ones are skipped.

        The first one waits until all are configured and observed, up to `CONFIGURED_S`.
        """
        self._waiting = [name for name in self._waiting if name not in dead]
        is_early = not self._asked and now < self._begun + CONFIGURED_S
        if is_early and (set(self._waiting) - set(inactive) or not self._is_observed(self._waiting)):
            return
        while self._waiting and not self._is_busy(inactive, dead, now):
            name = self._asked = self._waiting.pop(0)
            self._asked_at = now
            self._activate(name)

    @property
    def done(self) -> bool:
        return not self._waiting

    def _is_busy(self, inactive: Collection[str], dead: Collection[str], now: float) -> bool:
        name = self._asked
        return name in inactive and name not in dead and now < self._asked_at + ACTIVE_S


log = logging.getLogger("socialbot.supervisor")

INACTIVE = "inactive"  # reported state of a configured node
ROTATE_EVERY_S = 5.0

_LACKS = frozenset({InstallationError.exit_code, DeviceError.exit_code})  # exit codes without which others can go on

ABSENT_S = 1.0  # polls later than this are treated as a system suspend, which nodes share
SILENT_S = 1.0  # time without a report from which on the wait for a processor is measured
Variables = Callable[[Collection[str]], Mapping[str, str]]
"""Function that returns environment variables for a process with these nodes."""


@dataclass(eq=False)
class Member:
    """Supervised process: its nodes, their last reports with times (s), and its restarts."""

    name: str
    nodes: list[str]
    backoff: RestartBackoff
    process: Process | None = None
    channel: SupervisorChannel | None = None
    states: dict[str, str] = field(default_factory=dict)
    reported_at: dict[str, float] = field(default_factory=dict)
    waits: dict[str, ProcessorWaits] = field(default_factory=dict)
    """Waits for a processor of silent nodes since they became silent."""
    work: EndlessWork | None = None
    restarts: int = 0
    was_well: bool = False
    is_down: bool = False
    is_given_up: bool = False
    hung: str = ""
    lost: dict[str, Mapping[str, int]] = field(default_factory=dict)
    """How many publishers each of its nodes has lost, by topic."""
    renewal: str = ""
    """What it does not receive, so that it is started again with a new DDS participant."""
    renewals: RenewalBackoff = field(default_factory=RenewalBackoff)
    ports: PortWatch | None = None
    started: float = 0.0
    due: float | None = None
    last_error: str = ""

    @property
    def state(self) -> str:
        """One of ``starting``, ``active``, ``waiting`` (for a restart), ``ended`` (by itself) and ``given up``."""
        if self.process is not None:
            well = all(self.states.get(node) == ACTIVE for node in self.nodes)
            return ACTIVE if well else "starting"
        if self.due is not None:
            return "waiting"
        return "given up" if self.is_given_up else "ended"

    @property
    def has_lost_port(self) -> bool:
        """Whether it runs, and others do not reach it in shared memory."""
        return self.ports is not None and self.ports.is_lost(max(self.reported_at.values()))


class Supervisor:
    """Supervisor of the processes of one graph; restarts crashed ones. Leaving the context ends them all.

    ``folder`` receives the graph file and logs. ``well`` are the names of processes that ran in an earlier supervisor;
    None at the first start, which fails if the folder cannot be written. A later one waits until it can.
    """

    def __init__(
        self,
        graph: Graph,
        folder: Path,
        *,
        composed: bool = False,
        policy: RestartPolicy | None = None,
        nodes: Collection[str] | None = None,
        variables: Variables = lambda nodes: {},
        well: Collection[str] | None = None,
    ) -> None:
        self._graph = graph
        self._folder = folder
        self._policy = policy or RestartPolicy()
        self._rotation = Rotation()
        self._rotate_at = 0.0
        self._memory_kills = (memory_kills(),) * 2  # some seconds ago, and now
        self._attended = math.inf
        self._fork_server = ForkServer(graph, folder)
        self._variables = variables
        self._file = folder / "graph.yaml"
        self._is_first = well is None
        self._bring_up = BringUp((), self._activate, 0.0)
        self.running = RunningNodes(graph)
        self.is_observed: Callable[[Collection[str]], bool] = lambda nodes: True
        """Whether the recorder is connected to nodes, which become active after that, or after `CONFIGURED_S`."""
        own = {config.name for config in graph.nodes} if nodes is None else set(nodes)
        self.members = {
            name: Member(name, nodes, RestartBackoff(self._policy), was_well=name in (well or ()))
            for name, nodes in processes_of(graph, composed=composed).items()
            if own.issuperset(nodes)
        }

    def prepare(self) -> None:
        """Begin with what the processes need, in the background: their modules are imported once for all."""
        self._fork_server.prepare()

    def __enter__(self) -> Supervisor:
        environment.require_ros()
        remove_stale()
        if self._is_first:
            write_graph(self._graph, self._folder)
        own = {node for member in self.members.values() for node in member.nodes}
        order = [node for node in sinks_first(self._graph) if node in own]
        self._bring_up = BringUp(order, self._activate, time.monotonic(), self.is_observed)
        with _starting(self._graph, self.stop):
            for member in self.members.values():
                self._start(member) if self._is_first else self._restart(member, time.monotonic())
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def attend(self, timeout_s: float) -> None:
        """Handle all events once; wait at most ``timeout_s`` for the next one. Call it continuously.

        Raises NodeError when every process is given up. An error of a first start that would recur is raised too,
        unless the others can go on without this process: it lacks a device, or a part of the installation.
        """
        self._listen(timeout_s)
        now = time.monotonic()
        self._discount_suspend(now - self._attended - timeout_s, now)
        self._attended = now
        if not self._bring_up.done:
            self._go_on_bringing_up(now)
        if now >= self._rotate_at:
            self._rotate_at = now + ROTATE_EVERY_S
            self._memory_kills = self._memory_kills[1], memory_kills()
            with contextlib.suppress(OSError):  # a full disk, or a folder that was removed meanwhile
                logs = self._folder.glob("*.log")  # of nodes, the discovery server and the fork server
                self._rotation.rotate_all([*logs, *environment.own_ros_logs()], self._folder / "ros")
        for member in self.members.values():
            if member.process is not None:
                code = member.process.poll()
                if code is not None:
                    self._on_exit(member, code, now)
                elif not member.hung and (hung := self._hung(member, now)):
                    member.hung = hung
                    member.process.kill()
                elif not member.renewal:
                    lost = next(filter(None, map(self.running.lost, member.lost.values())), "")
                    lost = LOST_PORT if member.has_lost_port else lost
                    if member.renewals.is_due(is_lost=bool(lost)):
                        member.renewal = lost
                        member.process.send_signal(signal.SIGINT)
            elif member.due is not None and now >= member.due:
                self._restart(member, now)
        if self.members and all(member.state == "given up" for member in self.members.values()):
            raise NodeError(
                "all processes have crashed too often, or cannot start",
                where=self._graph.name,
                remedy=f"their logs are in {self._folder}",
            )

    def renew(self, begin: float, end: float) -> None:
        """Restart the processes started between two times (monotonic s), without counting a crash."""
        renewed = [one for one in self.members.values() if one.process is not None and begin <= one.started <= end]
        for member in renewed:
            log.warning("%s is started again, because a service came up after it", member.name)
        end_processes({one.name: one.process for one in renewed if one.process is not None})
        for member in renewed:
            self._part(member)
            member.due, member.is_down = time.monotonic(), True
            member.restarts += 1

    def stop(self) -> None:
        self._fork_server.close()
        end_processes({name: one.process for name, one in self.members.items() if one.process is not None})
        report_alive()  # before the caller leaves DDS
        for member in self.members.values():
            self._part(member)
            member.due = None

    @property
    def well(self) -> frozenset[str]:
        """Names of the processes that have become active."""
        return frozenset(member.name for member in self.members.values() if member.was_well)

    @property
    def pids(self) -> dict[str, int]:
        return {name: one.process.pid for name, one in self.members.items() if one.process is not None}

    def _restart(self, member: Member, now: float) -> None:
        try:
            if not self._file.exists():  # the folder of the run was removed
                write_graph(self._graph, self._folder)
            self._start(member)
        except OSError as error:
            log.warning("%s cannot be started: %s; again in %.0f s", member.name, error, self._policy.longest_s)
            member.due = now + self._policy.longest_s

    def _start(self, member: Member) -> None:
        report_alive()  # a start takes long on a busy machine
        channel, theirs = channel_pair()
        with theirs:
            member.process = self._fork_server.start(
                node_arguments(self._file, member.nodes),
                log_file(self._folder, member.name),
                variables={
                    RESTARTS_VARIABLE: str(member.restarts),
                    LAST_ERROR_VARIABLE: member.last_error,
                    **self._variables(member.nodes),
                },
                channel=theirs.fileno(),
            )
        kill_before_others(member.process.pid)
        member.work = EndlessWork(member.process.pid)
        now = time.monotonic()
        member.channel, member.due, member.hung, member.renewal = channel, None, "", ""
        member.started = now
        member.ports = PortWatch(member.process.pid)
        member.renewals.started()
        member.lost.clear()
        member.states.clear()
        member.waits.clear()
        member.reported_at = dict.fromkeys(member.nodes, now)
        member.backoff.started(now)

    def _listen(self, timeout_s: float) -> None:
        due = [one.due - time.monotonic() for one in self.members.values() if one.due is not None]
        wait_s = max(0.0, min([timeout_s, *due]))
        with DefaultSelector() as selector:
            for one in self.members.values():
                if one.channel is not None and not one.channel.broken:
                    selector.register(one.channel, EVENT_READ, one)
            for key, _ in selector.select(wait_s):
                for report in key.data.channel.receive():
                    self._note(key.data, report)

    def _go_on_bringing_up(self, now: float) -> None:
        members = self.members.values()
        inactive = [node for one in members for node, state in one.states.items() if state == INACTIVE]
        dead = [node for one in members if one.process is None for node in one.nodes]
        self._bring_up.look(inactive, dead, now)

    def _activate(self, node: str) -> None:
        for member in self.members.values():
            if node in member.nodes and member.channel is not None:
                member.channel.send(node, ACTIVE)

    def _note(self, member: Member, report: Report) -> None:
        node, state, lost = report
        self.running.note(node, state)
        member.lost[node] = lost
        if state == INACTIVE and member.restarts and node not in member.states:
            self._activate(node)
        member.reported_at[node] = time.monotonic()
        member.waits.pop(node, None)
        member.states[node] = state
        if member.state == ACTIVE and (member.is_down or not member.was_well):
            if member.is_down:
                log.warning("%s is back", member.name)
            member.was_well, member.is_down = True, False

    def _discount_suspend(self, absent_s: float, now: float) -> None:
        """Exclude the time of a suspend from timeouts."""
        if absent_s > ABSENT_S:
            for member in self.members.values():
                member.reported_at = {node: min(now, time + absent_s) for node, time in member.reported_at.items()}

    def _hung(self, member: Member, now: float) -> str:
        """Return why a process hangs, if it does: a node has not reported, or DDS works without end.

        Time in which a thread of its process waited for a processor does not count, up to `STARVED_LIMITS`.
        """
        for node, reported_at in member.reported_at.items():
            limit_s = self._policy.hung_s if member.states.get(node) == ACTIVE else self._policy.ready_s
            silent_s = now - reported_at
            starved_s = 0.0
            if silent_s > min(SILENT_S, limit_s / 2) and member.process is not None:
                waits = member.waits.setdefault(node, ProcessorWaits(member.process.pid))
                starved_s = waits.total_s(now)
            if is_late(silent_s, starved_s, limit_s):
                return f"{node} sent no report"
        is_endless = member.work is not None and member.work.longest_s(now) >= ENDLESS_S
        return "DDS works without end" if is_endless else ""

    def _on_exit(self, member: Member, code: int, now: float) -> None:
        self._part(member)
        remove_stale()
        file = log_file(self._folder, member.name)
        if member.renewal:
            what = f"does not receive {member.renewal} any more"
            member.last_error, member.is_down, member.due = what, True, now
            member.restarts += 1
            log.warning("%s %s; started again with a new DDS participant (no. %d)", member.name, what, member.restarts)
            return
        if code == 0:
            log.warning("%s has ended", member.name)
            return
        if code in DOCUMENTED and not member.was_well:
            if code not in _LACKS or len(self.members) == 1:
                raise failure(member.name, code, file)
            self._go_on_without(member, code, reported_error(file), now)
            return
        hung = f"hung ({member.hung})" if member.hung else ""
        what = hung or how_it_ended(code, reported_error(file))
        if code == -signal.SIGKILL and not hung and memory_kills() > self._memory_kills[0]:
            what += ", by Linux, as the memory of the computer or of its cgroup is full"
        member.last_error, member.is_down = what, True
        pause_s = member.backoff.killed(now) if hung else member.backoff.crashed(now)
        if pause_s is None:
            member.is_given_up = True
            log.error(
                "%s is given up: it has crashed more than %d times in %g s; at last it %s; its log: %s",
                *(member.name, self._policy.times, self._policy.within_s, what, file),
            )
            return
        member.due = now + pause_s
        member.restarts += 1
        log.warning("%s %s; started again %s (no. %d)", member.name, what, in_time(pause_s), member.restarts)

    def _go_on_without(self, member: Member, code: int, error: str, now: float) -> None:
        """Go on without a process that lacks a device, which is retried, or a part of the installation."""
        what = f"cannot start: {error}"
        is_new, member.last_error, member.is_down = member.last_error != what, what, True
        again = ""
        if code == DeviceError.exit_code:
            member.due = now + self._policy.longest_s
            member.restarts += 1
            again = f"; tried again every {self._policy.longest_s:g} s"
        else:
            member.is_given_up = True
        if is_new:
            log.error("%s %s%s; the others go on without it", member.name, what, again)

    @staticmethod
    def _part(member: Member) -> None:
        member.process = None
        if member.channel is not None:
            member.channel.close()
            member.channel = None


EVERY_S = 1.0


class RecordDiagnostics:
    """Publisher of a status on /diagnostics while the record of a run cannot be written; checks once a second."""

    def __init__(self, ros: Any, graph: str, record: RunTrace) -> None:
        self._name, self._record = f"{graph} record", record
        self._publisher = DiagnosticsPublisher(ros)
        self._due, self._problem = 0.0, ""

    def publish(self) -> None:
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + EVERY_S
        before, self._problem = self._problem, self._record.check()
        if self._problem or before:
            values = {"problem": self._problem, "lost": str(self._record.lost)}
            level, text = ("WARN", f"not written: {self._problem}") if self._problem else ("OK", "written")
            self._publisher.publish([status_of(self._name, level, text, values)])


class DeadNodeDiagnostics:
    """Publisher of the status of nodes without a process, by the rclpy node ``ros``: on change and every second."""

    def __init__(self, ros: Any, supervisor: Supervisor) -> None:
        self._supervisor = supervisor
        self._publisher = DiagnosticsPublisher(ros)
        self._states: dict[str, str] = {}
        self._published_at = 0.0

    def publish(self) -> None:
        dead = [one for one in self._supervisor.members.values() if one.process is None]
        states = {one.name: f"{one.state}: {one.last_error}" for one in dead}
        now = time.monotonic()
        if not dead or (states == self._states and now < self._published_at + EVERY_S):
            self._states = states
            return
        self._states, self._published_at = states, now
        self._publisher.publish_dead(
            {
                node: {"state": one.state, "restarts": str(one.restarts), "last_error": one.last_error}
                for one in dead
                for node in one.nodes
            }
        )
