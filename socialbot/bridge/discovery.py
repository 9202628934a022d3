"""Nodes, topics and publishers that DDS has discovered.

Anybody in the network can choose a name. If one in a list is no text, rclpy raises UnicodeDecodeError for the list.
Anybody can also announce endpoints without end, of which rclpy makes objects at each look.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, TypeVar

from socialbot.bridge.qos import profile
from socialbot.graph.ports import TOPIC_NAME

T = TypeVar("T")


SHARE = 0.1
"""Largest share of the time that looks with a `Pace` take."""


@dataclass
class Pace:
    """Pace of looks at discovered endpoints.

    Attributes:
        period_s: Shortest time from one look to the next; it grows with the processor time of a look.
        clock: Steady clock (s).
    """

    period_s: float = 0.0
    clock: Callable[[], float] = time.monotonic
    _due: float = field(default=-math.inf, init=False)

    @property
    def is_due(self) -> bool:
        return self.clock() >= self._due

    @contextmanager
    def looking(self) -> Iterator[None]:
        """Measure a look inside the block."""
        begun, spent = self.clock(), time.thread_time()
        yield
        self._due = begun + max(self.period_s, (time.thread_time() - spent) / SHARE)


def readable(look_up: Callable[[], T]) -> T | None:
    """Result of a look-up of rclpy; None if a name in it is no text."""
    try:
        return look_up()
    except UnicodeDecodeError:
        return None


def topics(ros: Any) -> list[tuple[str, list[str]]]:
    """Topics with their types, without names that rclpy refuses. If one is no text: those of the other nodes."""
    found = readable(ros.get_topic_names_and_types)
    found = _topics_of_nodes(ros) if found is None else found
    return [(topic, types) for topic, types in found if TOPIC_NAME.fullmatch(topic)]


def _topics_of_nodes(ros: Any) -> list[tuple[str, list[str]]]:
    of_nodes: dict[str, set[str]] = {}
    for name, space in readable(ros.get_node_names_and_namespaces) or ():
        for look_up in (ros.get_publisher_names_and_types_by_node, ros.get_subscriber_names_and_types_by_node):
            with suppress(UnicodeDecodeError, RuntimeError):  # the node has ended meanwhile
                for topic, types in look_up(name, space):
                    of_nodes.setdefault(topic, set()).update(types)
    return sorted((topic, sorted(types)) for topic, types in of_nodes.items())


@dataclass(frozen=True)
class UnknownEndpoint:
    """Publisher or subscription of a topic with a name among its endpoints that is no text. It demands the least."""

    topic_type: str
    node_name: str = ""
    node_namespace: str = ""
    topic_type_hash: str = ""
    qos_profile: Any = field(default_factory=lambda: profile(1, reliable=False))


def publishers(ros: Any, name: str) -> list[Any]:
    """What rclpy knows of the publishers of a topic. If a name is no text: an `UnknownEndpoint` of each type."""
    found = readable(lambda: ros.get_publishers_info_by_topic(name))
    return _unknown(ros, name, ros.count_publishers(name)) if found is None else found


def subscriptions(ros: Any, name: str) -> list[Any]:
    """What rclpy knows of the subscriptions of a topic. If a name is no text: as `publishers`."""
    found = readable(lambda: ros.get_subscriptions_info_by_topic(name))
    return _unknown(ros, name, ros.count_subscribers(name)) if found is None else found


def _unknown(ros: Any, name: str, count: int) -> list[UnknownEndpoint]:
    return [UnknownEndpoint(kind) for kind in dict(topics(ros)).get(name, ())] if count else []
