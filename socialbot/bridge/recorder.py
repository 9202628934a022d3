"""Records what runs over ROS into a bag: the bytes as they come, without looking inside."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialbot.bridge import environment
from socialbot.bridge.bag_writer import BagWriter
from socialbot.bridge.ros_types import message_class
from socialbot.clock import Clock, WallClock
from socialbot.errors import InstallationError

log = logging.getLogger("socialbot.recorder")

LEFT_OUT = ("/parameter_events", "/rosout")
"""Topics that are recorded only when they are asked for; so are hidden ones (``/_name``, ``/name/_action/...``)."""

DEPTH = 100
DISCOVERY_PERIOD_S = 0.2
_SPIN_S = 0.05


@dataclass(frozen=True)
class Recording:
    """What was recorded: messages by topic, and the topics that could not be, with the reason."""

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

    Topics that appear later are recorded too. ``clock`` gives the times of reception. Raises BagError
    when ``out`` exists or cannot be written, InstallationError when there is no ROS.
    """
    environment.require_ros()
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    from socialbot.bridge.session import ros_context

    with BagWriter(out, storage=storage) as bag, ros_context() as context:
        node = Node("bag_recorder", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        listener = _Listener(node, bag, topics, clock or WallClock())
        began = time.monotonic()
        looked = -math.inf
        try:
            while not stopped() and (duration_s is None or time.monotonic() - began < duration_s):
                if time.monotonic() - looked >= DISCOVERY_PERIOD_S:
                    looked = time.monotonic()
                    listener.look()
                executor.spin_once(timeout_sec=_SPIN_S)
        finally:
            executor.shutdown()
            node.destroy_node()
        return Recording(bag.path, time.monotonic() - began, dict(bag.counts), dict(listener.refused))


class _Listener:
    """Subscribes to each topic once it has a publisher."""

    def __init__(self, node: Any, bag: BagWriter, topics: Collection[str], clock: Clock) -> None:
        self.refused: dict[str, str] = {}
        self._node = node
        self._bag = bag
        self._topics = {topic if topic.startswith("/") else f"/{topic}" for topic in topics}
        self._clock = clock
        self._heard: set[tuple[str, str]] = set()

    def look(self) -> None:
        """Subscribes to topics that are new."""
        for topic, type_names in self._node.get_topic_names_and_types():
            if topic in self._topics or not (self._topics or topic in LEFT_OUT or "/_" in topic):
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
            self.refused[topic] = error.what
            log.warning("%s is not recorded: %s", topic, error.what)
            return
        qos, latched = _matching_qos(publishers)
        type_hash = str(publishers[0].topic_type_hash)

        def write(data: bytes) -> None:
            self._bag.write_raw(topic, type_name, data, self._clock.now(), latched=latched, type_hash=type_hash)

        self._node.create_subscription(kind, topic, write, qos, raw=True)
        log.info("recording %s (%s)", topic, type_name)


def _matching_qos(publishers: Collection[Any]) -> tuple[Any, bool]:
    """As much as all publishers offer: who asks for more gets nothing. And whether they keep the last message."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    offers = [publisher.qos_profile for publisher in publishers]
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = reliable and all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    qos = QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
    return qos, latched
