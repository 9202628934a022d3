"""Run one or several composed nodes of a graph in this process, and connect it to its supervisor."""

from __future__ import annotations

import gc
import inspect
import logging
import os
import socket
import threading
from collections.abc import Collection, Iterable, Iterator, Mapping, MutableMapping
from contextlib import contextmanager, nullcontext
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from socialbot.bridge import environment
from socialbot.bridge.detached_seals import seal_topic
from socialbot.bridge.environment import CHANNEL_VARIABLE, ros_context, spinning_node
from socialbot.bridge.graph_observer import expect_free_names
from socialbot.core.messages import CompressedImage, Image
from socialbot.core.process import Ending, end_within
from socialbot.core.process_guard import guarded
from socialbot.core.terminal import without_controls
from socialbot.graph.node import Graph
from socialbot.graph.ports import Delivery

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from socialbot.bridge._host import NodeHost

POLL_S = 0.2

LEAVE_S = 3.0
"""Time (s) for finished nodes to leave the ROS graph. Fast DDS may deadlock there with the news of another one that
leaves, and rclpy keeps Python's lock meanwhile.
"""


def run_nodes(
    graph: Graph,
    names: Collection[str],
    *,
    sim_time: bool,
    parent: int | None = None,
    ros_args: list[str] | None = None,
) -> None:
    """Run nodes of ``graph`` until SIGINT or SIGTERM, or until the parent process ends.

    They exchange messages without DDS where possible. A supervisor, if the process has one, commands their activation.

    Args:
        sim_time: Whether the time comes from /clock.
        parent: The process id of the parent, which has checked the names.
        ros_args: The arguments after ``--ros-args``.

    Raises:
        SocialbotError: A node cannot start, or nodes with these names are running already.
    """
    environment.require_ros()
    from socialbot.bridge._host import IntraProcess, NodeHost
    from socialbot.bridge.wait_sets import OneThreadExecutor

    configs = [graph.node(name) for name in names]
    supervisor = own_channel()
    _use_topics(graph, names)
    guard = guarded() if parent is None else nullcontext()  # that of the parent guards its children
    with guard, Ending(parent).on_signals() as ending, ros_context(ros_args) as context:
        hosts: list[NodeHost] = []
        executor = OneThreadExecutor(context=context)
        has_ended = False
        try:
            if parent is None:
                with spinning_node("name_check") as ros:
                    expect_free_names(ros, graph, names)
            intra_process = IntraProcess()
            for config in configs if not ending.asked else ():
                host = NodeHost(
                    graph,
                    config,
                    ros_context=context,
                    sim_time=sim_time,
                    supervisor=supervisor,
                    intra_process=intra_process,
                )
                hosts.append(host)
                executor.add_node(host.ros_node)
            # A garbage collection of all modules takes 50 ms each time.
            gc.freeze()
            with _logging_to(hosts):
                for host in hosts:
                    host.start()
                if supervisor is not None:
                    arguments = supervisor, hosts, executor, ending
                    threading.Thread(target=_follow_commands, args=arguments, name="supervisor", daemon=True).start()
                while not ending.asked and not any(host.ended for host in hosts):
                    executor.spin_once(timeout_sec=POLL_S)
            has_ended = True
        finally:
            executor.shutdown()
            for host in hosts:
                host.finish()
            if has_ended and not any(host.failure for host in hosts):
                end_within(LEAVE_S)
            for host in hosts:
                host.stop()
    for host in hosts:
        if host.failure is not None:
            raise host.failure


def _use_topics(graph: Graph, names: Collection[str]) -> None:
    """Receive everything but images by UDP in this process; on a network, repair what nodes with streams send fast."""
    configs = [graph.node(name) for name in names]
    by_udp = {
        topic
        for config in configs
        for topic, port in config.subscriptions
        if not issubclass(port.message_type, (Image, CompressedImage))
    }
    # What such a node sends beside its stream belongs to that: information on the camera, acknowledgements of images.
    fresh = {
        topic
        for config in configs
        if any(port.delivery in (Delivery.NEWEST, Delivery.FRESH) for _, port in config.publications)
        for topic, _ in config.publications
    }
    environment.prepare()
    name = f"dds_{'_'.join(names)[:80]}"
    environment.use_topics(name, by_udp=by_udp, fresh=fresh | set(map(seal_topic, fresh)))


def _follow_commands(supervisor: SupervisorChannel, hosts: list[NodeHost], executor: Executor, ending: Ending) -> None:
    """Run the transitions commanded by the supervisor, in the executor thread, until the process ends."""
    named = {host.name: host for host in hosts}
    while (command := supervisor.wait()) is not None and not ending.asked:
        name, state = command
        executor.create_task(named[name].transition_to, state)


class _RosLogHandler(logging.Handler):
    """Log handler that forwards records to the ROS logger of their node, and so to /rosout."""

    def __init__(self, loggers: dict[str, Any]) -> None:
        super().__init__()
        self._loggers = loggers

    def emit(self, record: logging.LogRecord) -> None:
        logger = self._loggers.get(record.name.rpartition(".")[2]) or next(iter(self._loggers.values()))
        text = without_controls(self.format(record))
        try:
            # One call per level: rclpy refuses to change the level of a line of code that has logged before.
            if record.levelno >= logging.ERROR:
                logger.error(text)
            elif record.levelno >= logging.WARNING:
                logger.warning(text)
            else:
                logger.info(text)
        except Exception:  # noqa: BLE001 - a failing log must not stop the node
            self.handleError(record)


@contextmanager
def _logging_to(hosts: Iterable[NodeHost]) -> Iterator[None]:
    # rclpy asks `inspect` for the place of each log call. The first call takes 50 ms, too long for a running node.
    inspect.stack()
    handler = _RosLogHandler({host.name: host.ros_node.get_logger() for host in hosts})
    root = logging.getLogger("socialbot")
    level = root.level
    root.addHandler(handler)
    root.setLevel(logging.INFO)
    try:
        yield
    finally:
        root.removeHandler(handler)
        root.setLevel(level)


_MAX_BYTES = 4096
_MAX_TOPICS = 12  # names of topics have up to 256 characters
NOTHING_LOST: Mapping[str, int] = MappingProxyType({})


class Report(NamedTuple):
    """Report of a node: its state, and how many publishers it has lost, by topic."""

    node: str
    state: str
    lost: Mapping[str, int] = NOTHING_LOST


class SupervisorChannel:
    """One end of the channel between a node process and its supervisor, for node states and commands.

    The ends are local sockets: private to both processes, and closed when either ends. A message is a node name, a
    state, and the numbers of lost publishers by topic; delivery is atomic.
    """

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self.broken = False

    def fileno(self) -> int:
        """The file descriptor, to wait for reports."""
        return self._end.fileno()

    def send(self, node: str, state: str, lost: Mapping[str, int] = NOTHING_LOST, /) -> None:
        """Send the state of ``node``; thread-safe. Never blocks: a full buffer drops the message.

        ``lost`` counts lost publishers by topic; some topics suffice.
        """
        words = [node, state, *(f"{topic}:{count}" for topic, count in list(lost.items())[:_MAX_TOPICS])]
        try:
            self._end.send(" ".join(words).encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self.broken = True

    def receive(self) -> list[Report]:
        """Reports received since the last call; sets ``broken`` after a disconnect."""
        received = []
        while (message := self._receive(socket.MSG_DONTWAIT)) is not None:
            received.append(message)
        return received

    def wait(self) -> tuple[str, str] | None:
        """Wait for the next node name and state; None after a disconnect."""
        report = self._receive(0)
        return None if report is None else (report.node, report.state)

    def close(self) -> None:
        self.broken = True
        self._end.close()

    def _receive(self, flags: int) -> Report | None:
        if self.broken:
            return None
        try:
            data = self._end.recv(_MAX_BYTES, flags)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError:
            data = b""
        if not data:
            self.broken = True
            return None
        node, state, *lost = data.decode(errors="replace").split(" ")
        return Report(node, state, {topic: int(count) for topic, _, count in (one.rpartition(":") for one in lost)})


def channel_pair() -> tuple[SupervisorChannel, socket.socket]:
    """The supervisor's end, and the socket of the process to start."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    return SupervisorChannel(ours), theirs


def own_channel(environment: MutableMapping[str, str] = os.environ) -> SupervisorChannel | None:
    """The channel to the supervisor of this process, if any. Child processes do not inherit it."""
    number = environment.pop(CHANNEL_VARIABLE, "")
    if not number:
        return None
    os.set_inheritable(int(number), False)
    return SupervisorChannel(socket.socket(fileno=int(number)))
