"""Client of the services that other ROS nodes offer, of a graph or not; base of those for parameters and lifecycle."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from socialbot.bridge.environment import ros_domain
from socialbot.bridge.topics import observer_node
from socialbot.core.errors import GraphError, NodeError, suggestion

SETTLE_S = 1.0  # time without a new node, after which the list of nodes is complete


class NodeClient:
    """Client of other nodes through the rclpy node ``ros``; made from `observer`.

    Its methods wait ``timeout_s`` at most for a node and for each answer. They raise GraphError for an unknown node,
    and NodeError for one without an answer.
    """

    def __init__(self, ros: Any, executor: Any, timeout_s: float) -> None:
        self._ros = ros
        self._executor = executor
        self._timeout_s = timeout_s

    def nodes(self) -> list[str]:
        """The full names of the other nodes, without hidden ones, once no new ones appear."""
        found: list[str] = []
        since = time.monotonic()
        while time.monotonic() - since < SETTLE_S:
            before, found = found, self._nodes()
            if found != before:
                since = time.monotonic()
            self._executor.spin_once(timeout_sec=0.05)
        return found

    def _nodes(self) -> list[str]:
        pairs = self._ros.get_node_names_and_namespaces()
        names = sorted({f"{space.rstrip('/')}/{name}" for name, space in pairs if not name.startswith("_")})
        return [name for name in names if name.rpartition("/")[2] != self._ros.get_name()]

    def _expect_services(self, node: str, are_ready: Callable[[], bool], what: str, remedy: str) -> None:
        """Wait for the services of a node. Raises GraphError or NodeError that it has no ``what``."""
        if self._spin_until(are_ready):
            return
        known = self._nodes()
        if node not in known:
            start = "start it, or use its ROS_DOMAIN_ID"
            remedy = suggestion(node, known) if known else start
            raise GraphError(f"no node {node}", where=f"domain {ros_domain()}", remedy=remedy)
        raise NodeError(f"the node has no {what} services", where=node, remedy=remedy)

    def _answer(self, future: Any, node: str) -> Any:
        if not self._spin_until(future.done):
            remedy = "see the log of the node, or give it more time by --timeout"
            raise NodeError(f"no answer within {self._timeout_s:g} s", where=node, remedy=remedy)
        return future.result()

    def _spin_until(self, holds: Callable[[], bool]) -> bool:
        end = time.monotonic() + self._timeout_s
        while not (held := holds()) and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.05)
        return held


def full_name(node: str) -> str:
    """The full name of a node, which may be given without its slash."""
    return node if node.startswith("/") else f"/{node}"


@contextmanager
def observer(name: str) -> Iterator[tuple[Any, Any]]:
    """Open a hidden rclpy node ``name`` and its executor. Raises InstallationError without ROS."""
    with observer_node(name) as ros:
        from rclpy.executors import SingleThreadedExecutor

        executor = SingleThreadedExecutor(context=ros.context)
        executor.add_node(ros)
        try:
            yield ros, executor
        finally:
            executor.shutdown()
