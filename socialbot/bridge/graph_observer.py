"""Observe a running graph from outside: its messages, node statistics and connections."""

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

from socialbot.bridge import environment
from socialbot.bridge.diagnostics import (
    UNCONNECTED,
    Connection,
    DiagnosticsSubscriber,
    subscription_connection,
    unconnected,
)
from socialbot.bridge.transport import Receiver, wire
from socialbot.core.errors import MessageError, NodeError
from socialbot.core.messages import Message
from socialbot.graph.node import Graph, WireForm

log = logging.getLogger("socialbot.observer")


class LatestStatistics:
    """The latest statistics of each node of ``graph``, as /diagnostics tells them; others may speak there, too."""

    def __init__(self, graph: Graph) -> None:
        self._names = {placement.name for placement in graph.placements}
        self.latest: dict[str, dict[str, str]] = {}

    def note(self, name: str, values: dict[str, str]) -> None:
        """Takes the statistics of one node."""
        if name in self._names:
            self.latest[name] = values


@dataclass(frozen=True)
class GraphObserver:
    """The rclpy node that looks on, and its subscriptions by topic."""

    ros: Any
    subscriptions: Mapping[str, Any]

    def connections(self, graph: Graph) -> list[Connection]:
        """The onlooker's own connections to ``graph``."""
        return [subscription_connection(graph, topic, one) for topic, one in self.subscriptions.items()]


def rounded(count: int) -> bool:
    """Whether ``count`` is 1, 10, 100, ...: often enough to tell of something that happens again and again."""
    return str(count).strip("0") == "1"


@contextmanager
def observe_graph(
    topics: Mapping[str, type[Message]],
    observe: Callable[[str, Message], None],
    note: Callable[[str, dict[str, str]], None],
    form: WireForm = "json",
    *,
    latched: Collection[str] = (),
) -> Iterator[GraphObserver]:
    """Calls ``observe`` with each message of ``topics``, and ``note`` with each node's statistics, from one thread.

    Of those that are ``latched`` it hears what was said last before it came. ``form`` is that of the graph's messages.
    Raises InstallationError when there is no ROS, or not that form.
    """
    environment.require_ros()
    from socialbot.bridge.diagnostics import DiagnosticsSubscriber
    from socialbot.bridge.environment import spinning_node
    from socialbot.bridge.transport import onlooker_qos

    def receive(topic: str, kind: type[Message], inlet: Receiver, ros_message: Any) -> None:
        try:
            message = inlet.decode(kind, ros_message)
        except MessageError as error:
            refused[topic] += 1
            if rounded(refused[topic]):
                log.warning("%s, refused %d: %s", topic, refused[topic], error)
            return
        if message is not None:
            observe(topic, message)

    refused: Counter[str] = Counter()
    own = wire(form=form)
    with spinning_node("observer") as ros:
        subscriptions = {
            topic: ros.create_subscription(
                own.message_class(kind),
                topic,
                functools.partial(receive, topic, kind, own.inlet(topic, latched=topic in latched)),
                onlooker_qos(latched=topic in latched),
            )
            for topic, kind in topics.items()
        }
        DiagnosticsSubscriber(ros, note)
        yield GraphObserver(ros, subscriptions)


LOOK_AGAIN_S = 0.02
LOOK_ROUND_S = 0.8
SPEAKS_S = 2.5
"""Every node that is alive says something on /diagnostics within this time."""


class Readiness:
    """Watches, through the rclpy node ``ros``, whether ``graph`` stands."""

    def __init__(self, ros: Any, graph: Graph) -> None:
        self._lacking = dict.fromkeys((placement.name for placement in graph.placements), "everything")
        self._inlet = DiagnosticsSubscriber(ros, self._note)

    def missing(self) -> list[str]:
        """What is missing, such as "head: /head/command"; empty when the graph stands."""
        return [f"{name}: {lacking}" for name, lacking in self._lacking.items() if lacking]

    def _note(self, name: str, values: Mapping[str, str]) -> None:
        if UNCONNECTED in values and name in self._lacking:
            self._lacking[name] = values[UNCONNECTED]


def await_graph(
    ros: Any,
    graph: Graph,
    own: list[Connection] | None = None,
    *,
    timeout_s: float,
    ended: Callable[[], bool] = lambda: False,
) -> list[str]:
    """Waits until ``graph`` and the caller's ``own`` connections stand, or ``ended`` says stop.

    Returns what is missing when that, or the time, is up.
    """
    readiness = Readiness(ros, graph)
    deadline = time.monotonic() + timeout_s
    while True:
        lacking = unconnected(own or [])
        missing = [*readiness.missing(), *([f"{ros.get_name()}: {lacking}"] if lacking else [])]
        if not missing or ended() or time.monotonic() > deadline:
            return missing
        time.sleep(LOOK_AGAIN_S)


def expect_free_names(ros: Any, graph: Graph, only: Collection[str] | None = None) -> None:
    """Raises NodeError when nodes of these names run in the ROS domain already: both graphs would hear each other.

    ``only`` names those nodes of ``graph`` that are about to be started; without it all are. ``ros`` has to be
    spinning: a node that was killed stays known for a while, but does not speak on /diagnostics any more. With keys
    only who has one counts: a stranger keeps no graph from starting.
    """
    ours = {placement.name for placement in graph.placements if only is None or placement.name in only}
    speaking: set[str] = set()

    def note(name: str, _: Mapping[str, str]) -> None:
        speaking.add(name)

    inlet = DiagnosticsSubscriber(ros, note)
    begun = time.monotonic()
    look_s = LOOK_ROUND_S
    while time.monotonic() - begun < look_s:
        known = ours & set(ros.get_node_names())
        taken = known & speaking
        if taken:
            raise NodeError(
                f"nodes of these names are running already: {', '.join(sorted(taken))}",
                where=f"ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}",
                remedy="end them, or set ROS_DOMAIN_ID to another number (0 to 101)",
            )
        look_s = SPEAKS_S if known else LOOK_ROUND_S
        time.sleep(LOOK_AGAIN_S)
    ros.destroy_subscription(inlet.subscription)
