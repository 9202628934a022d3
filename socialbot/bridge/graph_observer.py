"""Observe a running graph: its messages, node statistics and connections."""

from __future__ import annotations

import functools
import logging
import os
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from socialbot.bridge.diagnostics import (
    UNCONNECTED,
    Connection,
    DiagnosticsSubscriber,
    OnStatus,
    is_power_of_ten,
    subscription_connection,
    unconnected,
)
from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import Receiver, observer_qos, open_transport
from socialbot.core.errors import MessageError, NodeError
from socialbot.core.messages import Message
from socialbot.graph.node import Graph, WireForm

log = logging.getLogger("socialbot.observer")

POLL_S = 0.02
DISCOVERY_S = 0.8
STATUS_PERIOD_S = 2.5
"""Maximum time between two statuses of a live node."""


class LatestStatistics:
    """Latest statistics of each node of ``graph``, from /diagnostics."""

    def __init__(self, graph: Graph) -> None:
        self._names = {placement.name for placement in graph.placements}
        self.latest: dict[str, dict[str, str]] = {}

    def note(self, name: str, values: dict[str, str]) -> None:
        """Store the statistics of one node; ignore other programs."""
        if name in self._names:
            self.latest[name] = values


@dataclass(frozen=True)
class GraphObserver:
    """Observing rclpy node, and its subscriptions by topic."""

    ros: Any
    subscriptions: Mapping[str, Any]

    def connections(self, graph: Graph) -> list[Connection]:
        """Connections of this observer to ``graph``."""
        return [subscription_connection(graph, topic, one) for topic, one in self.subscriptions.items()]


@contextmanager
def observe_graph(
    topics: Mapping[str, type[Message]],
    observe: Callable[[str, Message], None],
    on_status: OnStatus,
    form: WireForm = "json",
    *,
    latched: Collection[str] = (),
) -> Iterator[GraphObserver]:
    """Observe a graph from one thread inside the block.

    Args:
        topics: The topics to subscribe to, with their message types.
        observe: Called with topic and message.
        on_status: Called with the name and the statistics of a node.
        form: The message form of the graph.
        latched: The topics whose last message is also received if older than the observer.

    Raises:
        InstallationError: ROS, or the message package for this form, is not installed.
    """

    def receive(topic: str, kind: type[Message], receiver: Receiver, ros_message: Any) -> None:
        try:
            message = receiver.decode(kind, ros_message)
        except MessageError as error:
            refused[topic] += 1
            if is_power_of_ten(refused[topic]):
                log.warning("%s: refused %d messages: %s", topic, refused[topic], error)
            return
        if message is not None:
            observe(topic, message)

    refused: Counter[str] = Counter()
    with spinning_node("observer") as ros:
        transport = open_transport(form=form)
        subscriptions = {
            topic: ros.create_subscription(
                transport.message_class(kind),
                topic,
                functools.partial(receive, topic, kind, transport.receiver(topic, latched=topic in latched)),
                observer_qos(latched=topic in latched),
            )
            for topic, kind in topics.items()
        }
        DiagnosticsSubscriber(ros, on_status)
        yield GraphObserver(ros, subscriptions)


def await_graph(
    ros: Any,
    graph: Graph,
    own: list[Connection] | None = None,
    *,
    timeout_s: float,
    ended: Callable[[], bool] = lambda: False,
) -> list[str]:
    """Wait until all nodes of ``graph``, and the ``own`` connections, are connected.

    Returns:
        The missing connections at the timeout, or when ``ended``: such as "head: /head/command".
    """
    lacking = {placement.name: "everything" for placement in graph.placements}

    def note(name: str, values: Mapping[str, str]) -> None:
        if UNCONNECTED in values and name in lacking:
            lacking[name] = values[UNCONNECTED]

    DiagnosticsSubscriber(ros, note)
    deadline = time.monotonic() + timeout_s
    while True:
        both = {**lacking, ros.get_name(): unconnected(own or [])}
        missing = [f"{name}: {topics}" for name, topics in both.items() if topics]
        if not missing or ended() or time.monotonic() > deadline:
            return missing
        time.sleep(POLL_S)


def expect_free_names(ros: Any, graph: Graph, only: Collection[str] | None = None) -> None:
    """Check that no other node in this ROS domain has a name from ``graph``.

    A killed node stays discovered for a while, so only names on /diagnostics count. If keys are set, their status needs
    a valid seal, so that an intruder cannot block the start.

    Args:
        ros: A spinning rclpy node.
        graph: The graph to start.
        only: The nodes to start; default: all.

    Raises:
        NodeError: A name is in use.
    """
    names = {placement.name for placement in graph.placements if only is None or placement.name in only}
    alive: set[str] = set()

    def note(name: str, _: Mapping[str, str]) -> None:
        alive.add(name)

    subscriber = DiagnosticsSubscriber(ros, note)
    begun = time.monotonic()
    wait_s = DISCOVERY_S
    while time.monotonic() - begun < wait_s:
        known = names & set(ros.get_node_names())
        if taken := known & alive:
            raise NodeError(
                f"nodes with these names are running already: {', '.join(sorted(taken))}",
                where=f"ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}",
                remedy="stop them, or set ROS_DOMAIN_ID to another number (0 to 101)",
            )
        wait_s = STATUS_PERIOD_S if known else DISCOVERY_S
        time.sleep(POLL_S)
    ros.destroy_subscription(subscriber.subscription)
