"""Records what runs over ROS into a bag: the bytes as they come, without looking inside.

Only seals are opened: a bag holds what was said, and nothing that was not to be believed.
"""

from __future__ import annotations

import logging
import math
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialbot.bags.codec import STRING
from socialbot.bags.writer import BagWriter
from socialbot.bridge import environment
from socialbot.bridge.topics import HIDDEN, AdaptingSubscription
from socialbot.bridge.transport import message_class, open_transport, refusal_reason
from socialbot.core.clock import Clock, WallClock
from socialbot.core.errors import InstallationError, MessageError

log = logging.getLogger("socialbot.recorder")

DISCOVERY_PERIOD_S = 0.2
FLUSH_PERIOD_S = 0.5
"""What came longer ago is in the file, whatever happens to this process."""
_SPIN_S = 0.05


@dataclass(frozen=True)
class Recording:
    """What was recorded: messages by topic, and the topics of which all or some could not be, with the reason."""

    path: Path
    duration_s: float
    counts: Mapping[str, int]
    refused: Mapping[str, str]


def record(
    out: str | Path,
    *,
    topics: Collection[str] = (),
    duration_s: float | None = None,
    storage: str = "mcap",
    clock: Clock | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Recording:
    """Records ``topics``, or all, to the new bag ``out`` until ``duration_s`` is over or ``stopped``.

    Topics that appear later are recorded too; hidden ones (``/rosout``, ``/_name``, ...) only when they are asked
    for. ``clock`` gives the times of reception. Raises BagError when ``out`` exists or cannot be written,
    InstallationError when there is no ROS.
    """
    environment.require_ros()
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    from socialbot.bridge.environment import ros_context

    with BagWriter(out, storage=storage) as bag, ros_context() as context:
        node = Node("bag_recorder", context=context, start_parameter_services=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        listener = _Listener(node, bag, topics, clock or WallClock())
        began = time.monotonic()
        looked = flushed = -math.inf
        try:
            while not stopped() and (duration_s is None or time.monotonic() - began < duration_s):
                if time.monotonic() - looked >= DISCOVERY_PERIOD_S:
                    looked = time.monotonic()
                    listener.look()
                if time.monotonic() - flushed >= FLUSH_PERIOD_S:
                    flushed = time.monotonic()
                    bag.flush()
                executor.spin_once(timeout_sec=_SPIN_S)
        finally:
            executor.shutdown()
            node.destroy_node()
        return Recording(bag.path, time.monotonic() - began, dict(bag.counts), listener.refusals())


class _Listener:
    """Subscribes to each topic once it has a publisher."""

    def __init__(self, node: Any, bag: BagWriter, topics: Collection[str], clock: Clock) -> None:
        self._refused: dict[str, str] = {}
        self._unbelieved: dict[str, Counter[str]] = {}
        self._transport = open_transport()
        self._node = node
        self._bag = bag
        self._topics = {topic if topic.startswith("/") else f"/{topic}" for topic in topics}
        self._clock = clock
        self._heard: set[tuple[str, str]] = set()
        self._subscriptions: list[AdaptingSubscription] = []

    def refusals(self) -> dict[str, str]:
        """The topics of which all or some could not be recorded, with the reason."""
        unbelieved = {
            topic: ", ".join(f"{count} {reason}" for reason, count in reasons.items())
            for topic, reasons in self._unbelieved.items()
        }
        return self._refused | unbelieved

    def look(self) -> None:
        """Subscribes to topics that are new, and anew where a new publisher offers less."""
        for subscription in self._subscriptions:
            subscription.adapt()
        for topic, type_names in self._node.get_topic_names_and_types():
            if topic in self._topics or not (self._topics or topic in HIDDEN or "/_" in topic):
                for type_name in type_names:
                    self._hear(topic, type_name)

    def _hear(self, topic: str, type_name: str) -> None:
        publishers = [each for each in self._node.get_publishers_info_by_topic(topic) if each.topic_type == type_name]
        if (topic, type_name) in self._heard or not publishers:
            return
        self._heard.add((topic, type_name))
        try:
            kind = message_class(type_name)
        except InstallationError as error:
            self._refused[topic] = error.what
            log.warning("%s is not recorded: %s", topic, error.what)
            return
        type_hash = str(publishers[0].topic_type_hash)

        def write(data: bytes) -> None:
            now, latched = self._clock.now(), subscription.latched
            self._bag.write_raw(topic, type_name, data, now, latched=latched, type_hash=type_hash)

        sealed = self._transport.sealed and type_name == STRING
        take = self._opening(topic, write) if sealed else write
        subscription = AdaptingSubscription(self._node, topic, kind, take, raw=not sealed)
        subscription.adapt()
        self._subscriptions.append(subscription)
        log.info("recording %s (%s)", topic, type_name)

    def _opening(self, topic: str, write: Callable[[bytes], None]) -> Callable[[Any], None]:
        """Takes sealed Strings of ``topic``, and writes what they say."""
        from rclpy.serialization import serialize_message

        receiver = self._transport.receiver(topic, latched=True)

        def take(ros_message: Any) -> None:
            try:
                opened = receiver.open(ros_message)
            except MessageError as error:
                reasons = self._unbelieved.setdefault(topic, Counter())
                if not reasons:
                    log.warning("%s is not recorded in full: %s", topic, error)
                reasons[refusal_reason(error)] += 1
                return
            if opened is not None:
                write(serialize_message(opened))

        return take
