"""Looks on from outside while a graph runs: messages of some topics, and how the nodes fare."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from socialbot.bridge import environment
from socialbot.bridge.codec import decode, ros_type
from socialbot.bridge.readiness import Connection, subscription_connection
from socialbot.errors import MessageError
from socialbot.graph import Delivery, Graph
from socialbot.messages import Message

log = logging.getLogger("socialbot.observer")


class Fates:
    """The latest statistics of each node of ``graph``, as /diagnostics tells them; others may speak there, too."""

    def __init__(self, graph: Graph) -> None:
        self._names = {placement.name for placement in graph.placements}
        self.latest: dict[str, dict[str, str]] = {}

    def note(self, name: str, values: dict[str, str]) -> None:
        """Takes the statistics of one node."""
        if name in self._names:
            self.latest[name] = values


@dataclass(frozen=True)
class Onlooker:
    """The rclpy node that looks on, and its subscriptions by topic."""

    ros: Any
    subscriptions: Mapping[str, Any]

    def connections(self, graph: Graph) -> list[Connection]:
        """The onlooker's own connections to ``graph``."""
        return [subscription_connection(graph, topic, one) for topic, one in self.subscriptions.items()]


@contextmanager
def observing(
    topics: Mapping[str, type[Message]],
    observe: Callable[[str, Message], None],
    note: Callable[[str, dict[str, str]], None],
) -> Iterator[Onlooker]:
    """Calls ``observe`` with each message of ``topics``, and ``note`` with each node's statistics, from one thread."""
    environment.require_ros()
    from diagnostic_msgs.msg import DiagnosticArray

    from socialbot.bridge.qos import subscription_qos
    from socialbot.bridge.ros_types import message_class
    from socialbot.bridge.session import spinning_node

    def receive(topic: str, kind: type[Message], ros_message: Any) -> None:
        try:
            observe(topic, decode(kind, ros_message))
        except MessageError as error:
            log.warning("%s: %s", topic, error)

    def diagnose(array: Any) -> None:
        for status in array.status:
            note(status.name, {pair.key: pair.value for pair in status.values})

    with spinning_node("observer") as ros:
        subscriptions = {
            topic: ros.create_subscription(
                message_class(ros_type(kind)),
                topic,
                functools.partial(receive, topic, kind),
                subscription_qos(Delivery.EVERY, outside=False),
            )
            for topic, kind in topics.items()
        }
        ros.create_subscription(DiagnosticArray, "/diagnostics", diagnose, 100)
        yield Onlooker(ros, subscriptions)
