"""Looks on from outside while a graph runs: messages of some topics, and how the nodes fare."""

from __future__ import annotations

import functools
import logging
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from socialbot.bridge import environment
from socialbot.bridge.diagnostics import Connection, subscription_connection
from socialbot.bridge.transport import Receiver, wire
from socialbot.core.errors import MessageError
from socialbot.core.messages import Message
from socialbot.graph.node import Graph, WireForm

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


def rounded(count: int) -> bool:
    """Whether ``count`` is 1, 10, 100, ...: often enough to tell of something that happens again and again."""
    return str(count).strip("0") == "1"


@contextmanager
def observing(
    topics: Mapping[str, type[Message]],
    observe: Callable[[str, Message], None],
    note: Callable[[str, dict[str, str]], None],
    form: WireForm = "json",
    *,
    latched: Collection[str] = (),
) -> Iterator[Onlooker]:
    """Calls ``observe`` with each message of ``topics``, and ``note`` with each node's statistics, from one thread.

    Of those that are ``latched`` it hears what was said last before it came. ``form`` is that of the graph's messages.
    Raises InstallationError when there is no ROS, or not that form.
    """
    environment.require_ros()
    from socialbot.bridge.diagnostics import DiagnosticsInlet
    from socialbot.bridge.qos import onlooker_qos
    from socialbot.bridge.rclpy_context import spinning_node

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
        DiagnosticsInlet(ros, note)
        yield Onlooker(ros, subscriptions)
