"""What a camera of a running graph sees, as JPEG, as long as somebody looks."""

from __future__ import annotations

import threading
import time
from bisect import bisect_right
from collections import deque
from typing import Any

from socialbot.bags.codec import decode, ros_type
from socialbot.bridge.qos import subscription_qos
from socialbot.bridge.transport import message_class
from socialbot.core.clock import SECOND
from socialbot.core.errors import ImageError, MessageError
from socialbot.core.messages import CompressedImage, Image
from socialbot.graph.node import Delivery, Graph
from socialbot.runs.run import Picture
from socialbot.vision.images import as_jpeg

MOST_HZ = 10.0
UNWATCHED_S = 3.0
"""When nobody has asked for so long, nothing is subscribed to any more."""

FIRST_WITHIN_S = 1.0
"""So long the first picture is waited for."""

KEPT = 600
"""So many pictures are kept: a minute of them."""


class LivePictures:
    """The pictures on ``topic``, heard by ``ros``, a node that spins, as long as they are asked for."""

    def __init__(self, ros: Any, topic: str, kind: type[Image] | type[CompressedImage]) -> None:
        self._ros = ros
        self._topic = topic
        self._kind = kind
        self._ros_class = message_class(ros_type(kind))
        self._subscription: Any = None
        self._asked = 0.0
        self._made = 0.0
        self._kept: deque[Picture] = deque(maxlen=KEPT)
        self._came = threading.Condition()
        ros.create_timer(1.0, self._rest)

    def at(self, stamp: int) -> Picture | None:
        """The newest picture that is kept and not later than ``stamp`` (ns)."""
        with self._came:
            self._asked = time.monotonic()
            if self._subscription is None:
                self._subscription = self._ros.create_subscription(
                    self._ros_class, self._topic, self._take, subscription_qos(Delivery.NEWEST, outside=True), raw=True
                )
                self._came.wait(FIRST_WITHIN_S)
            kept = list(self._kept)
        # What is to be shown now may have come after the last record.
        count = bisect_right([picture.stamp for picture in kept], stamp + SECOND // 2)
        return kept[count - 1] if count else None

    def _take(self, data: bytes) -> None:
        """Makes a JPEG of a picture, unless one was made just before."""
        from rclpy.serialization import deserialize_message

        now = time.monotonic()
        if now - self._made < 1.0 / MOST_HZ:
            return
        self._made = now
        try:
            message = decode(self._kind, deserialize_message(data, self._ros_class))
            picture = Picture(message.stamp, as_jpeg(message))
        except (ImageError, MessageError):
            return
        with self._came:
            if not self._kept or picture.stamp > self._kept[-1].stamp:
                self._kept.append(picture)
            self._came.notify_all()

    def _rest(self) -> None:
        with self._came:
            if self._subscription is not None and time.monotonic() - self._asked > UNWATCHED_S:
                self._ros.destroy_subscription(self._subscription)
                self._subscription = None


def picture_topic(graph: Graph) -> tuple[str, type[Image] | type[CompressedImage]] | None:
    """A topic of ``graph`` with pictures: those of its own nodes first, compressed ones first; None without any."""
    published = {topic for placement in graph.placements for topic, _ in placement.publications}
    found: list[tuple[str, type[Image] | type[CompressedImage]]] = []
    for topic, kind in graph.topics().items():
        if issubclass(kind, (Image, CompressedImage)):
            found.append((topic, kind))
    return min(found, key=lambda each: (each[0] not in published, each[1] is Image), default=None)
