"""Plays the world of a bag to agents over ROS: what sensors told, as far as the agents have come.

The clock waits for all nodes at every step. A world does as it is told; the recorded one, too, waits for each command
that it was given then. So agents that are a little later than they were find the world as it was for them.
"""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Mapping
from typing import Any

import msgspec

from socialbot.bridge.bags import Bag, Skipped
from socialbot.bridge.codec import STRING, encode, ros_type
from socialbot.bridge.readiness import Connection, publisher_connection, subscription_connection
from socialbot.bridge.ros_types import RclpyTypes, message_class
from socialbot.bridge.timekeeper import Timekeeper
from socialbot.clock import SECOND, nanoseconds
from socialbot.ending import Ending
from socialbot.graph import Delivery, Graph
from socialbot.messages import Message, TraceRecord

log = logging.getLogger("socialbot.player")

STEP_S = 1 / 30
"""How far the clock goes at once."""

PATIENCE_S = 2.0
"""How long (s, simulated) the world waits for a command."""


class Played(msgspec.Struct):
    """How it went: messages sent, what the graph did not answer in time, and the damaged messages of each topic.

    Where the graph takes pictures, only they count; else it is commands to the world that count as answers.
    """

    sent: int = 0
    unanswered: int = 0
    skipped: dict[str, Skipped] = {}


class Reenactment:
    """Plays ``topics`` (bag topic to graph topic) of ``bag`` to ``graph``, which has no world of its own."""

    def __init__(
        self, ros: Any, bag: Bag, topics: Mapping[str, str], graph: Graph, rate: float, ending: Ending
    ) -> None:
        from socialbot.bridge.qos import publisher_qos, subscription_qos

        self._bag, self._topics, self._rate, self._ending = bag, dict(topics), rate, ending
        self._kinds = graph.topics()
        self._types = RclpyTypes()
        self._publishers = {
            topic: ros.create_publisher(
                message_class(ros_type(self._kinds[topic])), topic, publisher_qos(Delivery.EVERY)
            )
            for topic in topics.values()
        }
        self._given: Counter[str] = Counter()
        self._subscriptions = {
            topic: ros.create_subscription(
                message_class(STRING),
                topic,
                lambda _, topic=topic: self._given.update([topic]),
                subscription_qos(Delivery.EVERY, outside=False),
            )
            for topic in commands(bag, graph)
        }
        self._keeper = Timekeeper(ros, [placement.name for placement in graph.placements], start=bag.start)
        self._late = 0
        self._waited: Counter[str] = Counter()

    def connections(self, graph: Graph) -> list[Connection]:
        """The player's own connections to ``graph``."""
        return [
            *(publisher_connection(graph, topic, one) for topic, one in self._publishers.items()),
            *(subscription_connection(graph, topic, one) for topic, one in self._subscriptions.items()),
        ]

    def play(self) -> Played:
        """Plays from the first message to the last, or until asked to end."""
        played = Played(skipped=self._bag.skipped)
        begun = time.monotonic()
        everything = self._topics | {topic: topic for topic in self._subscriptions}
        self._keeper.advance(0.0)
        for topic, message in self._bag.messages(everything, self._kinds):
            if self._ending.asked:
                break
            if topic in self._subscriptions:
                played.unanswered += not self._await_command(topic)
                continue
            now = message.stamp + self._late
            self._advance(now)
            self._publishers[topic].publish(encode(msgspec.structs.replace(message, stamp=now), self._types))
            played.sent += 1
            time.sleep(max(0.0, begun + (now - self._bag.start) / SECOND / self._rate - time.monotonic()))
        return played

    def _advance(self, until: int) -> None:
        while self._keeper.now < until and not self._ending.asked:
            self._keeper.advance(min(nanoseconds(STEP_S), until - self._keeper.now) / SECOND)

    def _await_command(self, topic: str) -> bool:
        """Lets time pass until the agents have given as many commands as they had then."""
        self._waited[topic] += 1
        begun = self._keeper.now
        while self._given[topic] < self._waited[topic] and not self._ending.asked:
            if self._keeper.now - begun >= nanoseconds(PATIENCE_S):
                log.warning("%s: no command number %d", topic, self._waited[topic])
                return False
            self._keeper.advance(STEP_S)
        self._late += self._keeper.now - begun
        return True


def commands(bag: Bag, graph: Graph) -> dict[str, type[Message]]:
    """The topics of ``bag`` by which nodes of ``graph`` tell the world what to do: those that no node listens to."""
    heard = {topic for placement in graph.placements for topic, _ in placement.subscriptions}
    names = {topic.name for topic in bag.topics if topic.count}
    return {
        topic: port.message_type
        for placement in graph.placements
        for topic, port in placement.publications
        if topic in names and topic not in heard and port.message_type is not TraceRecord
    }
