"""One operating-system process with some nodes of a graph in it: one, or all of them composed."""

from __future__ import annotations

import gc
import inspect
import logging
import os
import tempfile
import threading
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from socialbot.bridge import environment
from socialbot.bridge.graph_observer import expect_free_names
from socialbot.core.errors import SocialbotError
from socialbot.core.messages import CompressedImage, Image
from socialbot.core.process import Ending
from socialbot.graph.node import Graph

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from socialbot.bridge.host import NodeHost, SupervisorLink

LOOK_ROUND_S = 0.2
"""How often the process looks whether it should end."""


def run_nodes(
    graph: Graph,
    names: Collection[str],
    *,
    sim_time: bool,
    parent: int | None = None,
    ros_args: list[str] | None = None,
    supervisor: SupervisorLink | None = None,
) -> None:
    """Runs the nodes ``names`` of ``graph`` until SIGINT or SIGTERM comes, or the process ``parent`` has ended.

    Raises the error of a node that cannot start, and NodeError when others of these names are running; a ``parent`` has
    seen to that. A ``supervisor`` decides when the nodes are activated.
    """
    environment.require_ros()
    from rclpy.executors import SingleThreadedExecutor

    from socialbot.bridge.environment import ros_context
    from socialbot.bridge.host import NodeHost

    _read_by_udp(graph, names)
    with Ending(parent).on_signals() as ending, ros_context(ros_args) as context:
        hosts: list[NodeHost] = []
        executor = SingleThreadedExecutor(context=context)
        try:
            if parent is None:
                _expect_free_names(graph, names)
            for name in names if not ending.asked else ():
                placement = graph.placement(name)
                hosts.append(NodeHost(graph, placement, ros_context=context, sim_time=sim_time, supervisor=supervisor))
                executor.add_node(hosts[-1].ros_node)
            # What there is by now stays: to look through it for garbage would take 50 ms each time.
            gc.freeze()
            with _logging_to(hosts):
                for host in hosts:
                    host.start()
                if supervisor is not None:
                    threading.Thread(
                        target=_obey, args=(supervisor, hosts, executor), name="orders", daemon=True
                    ).start()
                while not ending.asked and not any(host.ended for host in hosts):
                    executor.spin_once(timeout_sec=LOOK_ROUND_S)
        finally:
            executor.shutdown()
            for host in hosts:
                host.stop()
    _raise_failure(host.failure for host in hosts)


def _read_by_udp(graph: Graph, names: Collection[str]) -> None:
    """What is not a picture comes by UDP to the nodes of this process."""
    topics = {
        topic
        for name in names
        for topic, port in graph.placement(name).subscriptions
        if not issubclass(port.message_type, (Image, CompressedImage))
    }
    environment.prepare()
    folder = Path(os.environ.get("ROS_LOG_DIR") or tempfile.gettempdir())
    environment.read_by_udp(topics, folder / f"dds_{'_'.join(names)[:80]}.xml")


def _obey(supervisor: SupervisorLink, hosts: list[NodeHost], executor: Executor) -> None:
    """Has the executor take nodes to the states that the supervisor orders."""
    named = {host.name: host for host in hosts}
    while (order := supervisor.wait()) is not None:
        name, state = order
        executor.create_task(named[name].go, state)


def _expect_free_names(graph: Graph, names: Collection[str]) -> None:
    from socialbot.bridge.environment import spinning_node

    for name in names:
        graph.placement(name)
    with spinning_node("newcomer") as ros:
        expect_free_names(ros, graph, names)


def _raise_failure(failures: Iterable[SocialbotError | None]) -> None:
    for failure in failures:
        if failure is not None:
            raise failure


class _RosLog(logging.Handler):
    """Hands log records to the ROS logger of the node they come from, and so to /rosout."""

    def __init__(self, loggers: dict[str, Any]) -> None:
        super().__init__()
        self._loggers = loggers

    def emit(self, record: logging.LogRecord) -> None:
        logger = self._loggers.get(record.name.rpartition(".")[2]) or next(iter(self._loggers.values()))
        text = self.format(record)
        try:
            # A call for each level: rclpy refuses another level from a place in the code that has logged before.
            if record.levelno >= logging.ERROR:
                logger.error(text)
            elif record.levelno >= logging.WARNING:
                logger.warning(text)
            else:
                logger.info(text)
        except Exception:  # noqa: BLE001 - a log that fails must not end the node that logs
            self.handleError(record)


@contextmanager
def _logging_to(hosts: Iterable[Any]) -> Iterator[None]:
    # rclpy asks `inspect` where each record comes from: the first time that takes 50 ms, which a node has not always.
    inspect.stack()
    handler = _RosLog({host.name: host.ros_node.get_logger() for host in hosts})
    root = logging.getLogger("socialbot")
    level = root.level
    root.addHandler(handler)
    root.setLevel(logging.INFO)
    try:
        yield
    finally:
        root.removeHandler(handler)
        root.setLevel(level)
