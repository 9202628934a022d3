"""Subscriptions of observers: with the quality of service of the publishers, and with seals if there are keys."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from socialbot.bags.codec import STRING
from socialbot.bridge.detached_seals import seal_topic
from socialbot.bridge.transport import Transport, is_sealed, log_refusal, matching_qos, message_class
from socialbot.core.errors import MessageError

ADAPT_PERIOD_S = 0.5
DEPTH = 100


@dataclass
class AdaptiveSubscription:
    """Subscription whose quality of service matches all publishers, including new ones."""

    ros: Any
    name: str
    kind: Any
    take: Callable[[Any], None]
    raw: bool
    depth: int = DEPTH
    _qos: Any = field(default=None, init=False)
    _subscription: Any = field(default=None, init=False)
    _adapted: float = field(default=-math.inf, init=False)

    @property
    def latched(self) -> bool:
        """Whether all publishers are transient local."""
        from rclpy.qos import DurabilityPolicy

        return self._qos is not None and self._qos.durability == DurabilityPolicy.TRANSIENT_LOCAL

    def adapt(self) -> None:
        """Subscribe again if the publishers have changed."""
        from rclpy.event_handler import SubscriptionEventCallbacks

        if time.monotonic() - self._adapted < ADAPT_PERIOD_S:
            return
        self._adapted = time.monotonic()
        publishers = publishers_of(self.ros, self.name)
        qos = matching_qos(publishers, self.depth)
        if qos == self._qos or (not publishers and self._subscription is not None):
            return
        if self._subscription is not None:
            self.ros.destroy_subscription(self._subscription)
        self._qos = qos
        self._subscription = self.ros.create_subscription(
            self.kind,
            self.name,
            self.take,
            qos,
            raw=self.raw,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )


def verified_subscriptions(
    ros: Any,
    transport: Transport,
    topic: str,
    ros_class: Any,
    take: Callable[[bytes], None],
    refuse: Callable[[MessageError], None],
    *,
    depth: int = DEPTH,
) -> list[AdaptiveSubscription]:
    """Subscribe to a topic of a standard type, and to its seals if there are keys.

    Strings may be structured messages with seals of their own, without which ``take`` gets them.
    """
    name = ros.resolve_topic_name(topic)
    matcher = transport.matcher(name, lambda cdr, _: take(cdr), refuse, latched=True)
    if matcher is None:
        return [AdaptiveSubscription(ros, name, ros_class, lambda cdr: take(cdr), raw=True, depth=depth)]
    from rclpy.serialization import deserialize_message, serialize_message

    text_class = message_class(STRING)
    receiver = transport.receiver(name, latched=True)

    def take_message(cdr: bytes) -> None:
        text = deserialize_message(cdr, ros_class) if ros_class is text_class else None
        if text is None or not is_sealed(text.data):
            matcher.take_message(cdr)
            return
        try:
            opened = receiver.open(text)
        except MessageError as error:
            refuse(error)
            return
        if opened is not None:
            take(serialize_message(opened))

    def take_seal(text: Any) -> None:
        matcher.take_seal(text.data)

    return [
        AdaptiveSubscription(ros, seal_topic(name), text_class, take_seal, raw=False),
        AdaptiveSubscription(ros, name, ros_class, take_message, raw=True, depth=depth),
    ]


def log_refusals(topic: str) -> Callable[[MessageError], None]:
    """Return a function that logs refused messages of ``topic``."""
    counts = itertools.count(1)
    return lambda error: log_refusal(topic, next(counts), error)


def publishers_of(ros: Any, name: str) -> list[Any]:
    """Return rclpy's information on the publishers of a topic, except those of the node ``ros``."""
    return [each for each in ros.get_publishers_info_by_topic(name) if each.node_name != ros.get_name()]
