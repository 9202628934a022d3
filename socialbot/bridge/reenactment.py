"""Plays the world of a bag to agents over ROS: what sensors told, as far as the agents have come.

The clock waits for all nodes at every step. A world does as it is told; the recorded one, too, waits for each command
that it was given then. So agents that are a little later than they were find the world as it was for them.
"""

from __future__ import annotations

import functools
import logging
import time
from collections.abc import Mapping
from typing import Any

import msgspec

from socialbot.bridge.bags import Bag, Skipped
from socialbot.bridge.readiness import Connection, publisher_connection, subscription_connection
from socialbot.bridge.recorded_world import STEP_S, Script, play
from socialbot.bridge.timekeeper import Timekeeper
from socialbot.bridge.wire import Inlet, wire
from socialbot.clock import SECOND, nanoseconds
from socialbot.ending import Ending
from socialbot.errors import MessageError
from socialbot.graph import Delivery, Graph
from socialbot.messages import Message

log = logging.getLogger("socialbot.player")


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

        self._rate, self._ending = rate, ending
        self._script = Script(bag, topics, graph)
        self._skipped = bag.skipped
        own = wire(form=graph.wire)
        self._publishers = {
            topic: ros.create_publisher(own.message_class(graph.topics()[topic]), topic, publisher_qos(Delivery.EVERY))
            for topic in topics.values()
        }
        self._outlets = {topic: own.outlet(publisher) for topic, publisher in self._publishers.items()}
        self._subscriptions = {
            topic: ros.create_subscription(
                own.message_class(kind),
                topic,
                functools.partial(self._hear, topic, kind, own.inlet(topic)),
                subscription_qos(Delivery.EVERY, outside=False),
            )
            for topic, kind in self._script.told.items()
        }
        self._keeper = Timekeeper(ros, [placement.name for placement in graph.placements], start=bag.start)
        self._start, self._begun = bag.start, 0.0

    def connections(self, graph: Graph) -> list[Connection]:
        """The player's own connections to ``graph``."""
        return [
            *(publisher_connection(graph, topic, one) for topic, one in self._publishers.items()),
            *(subscription_connection(graph, topic, one) for topic, one in self._subscriptions.items()),
        ]

    def play(self) -> Played:
        """Plays from the first message to the last, or until asked to end."""
        self._begun = time.monotonic()
        play(self._script, self, self._ending)
        return Played(self._script.sent, self._script.unanswered, self._skipped)

    @property
    def now(self) -> int:
        """The time of the graph, ns."""
        return self._keeper.now

    def advance(self, until: int) -> None:
        """Moves the clock, no faster than at the rate."""
        self._keeper.advance(0.0)
        while self._keeper.now < until and not self._ending.asked:
            self._keeper.advance(min(nanoseconds(STEP_S), until - self._keeper.now) / SECOND)
        time.sleep(max(0.0, self._begun + (self._keeper.now - self._start) / SECOND / self._rate - time.monotonic()))

    def say(self, topic: str, message: Message) -> None:
        """Sends a message to the agents."""
        self._outlets[topic].publish(message)

    def _hear(self, topic: str, kind: type[Message], inlet: Inlet, ros_message: Any) -> None:
        try:
            command = inlet.decode(kind, ros_message)
        except MessageError as error:
            log.warning("%s: %s", topic, error)
            return
        if command is not None:
            self._script.hear(topic, command)
