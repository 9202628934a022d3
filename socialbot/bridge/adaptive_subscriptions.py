"""Subscriptions of observers: with the quality of service of the publishers, and with seals if there are keys."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from logging import getLogger
from typing import Any

from socialbot.bags.codec import STRING
from socialbot.bridge import discovery
from socialbot.bridge.detached_seals import seal_topic
from socialbot.bridge.qos import matching_qos
from socialbot.bridge.stream_watch import Backoff, Note, Watch, WatchedSubscription, noting
from socialbot.bridge.transport import Transport, is_power_of_ten, is_sealed, message_class
from socialbot.core.errors import MessageError

log = getLogger("socialbot.transport")

ADAPT_PERIOD_S = 0.5
DEPTH = 100


@dataclass
class AdaptiveSubscription:
    """Subscription whose quality of service matches all publishers, including new ones.

    It fits a weaker publisher at once. It is strict again after the weaker one has left, but ever more seldom if that
    happens often: a stranger may come and go. With a ``watch`` it is also replaced when messages do not arrive. The
    node ``ros`` must be spun.
    """

    ros: Any
    name: str
    kind: Any
    take: Callable[[Any], None]
    raw: bool
    depth: int = DEPTH
    watch: Watch | None = None
    clock: Callable[[], float] = time.monotonic
    _qos: Any = field(default=None, init=False)
    _subscription: Any = field(default=None, init=False)
    _watched: WatchedSubscription | None = field(default=None, init=False)
    _pace: discovery.Pace = field(init=False)
    _strict_again: Backoff = field(init=False)
    _replacements: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._pace = discovery.Pace(ADAPT_PERIOD_S, self.clock)
        self._strict_again = Backoff(self.clock)

    @property
    def latched(self) -> bool:
        """Whether all publishers are transient local."""
        from rclpy.qos import DurabilityPolicy

        return self._qos is not None and self._qos.durability == DurabilityPolicy.TRANSIENT_LOCAL

    def adapt(self) -> None:
        """Subscribe again if the publishers have changed, or messages do not arrive."""
        if not self._pace.is_due:
            return
        with self._pace.looking():
            found = publishers_of(self.ros, self.name)
        qos = matching_qos(found, self.depth)
        is_stricter = self._qos is not None and _strictness(qos) > _strictness(self._qos)
        is_fixed = not found and self._subscription is not None
        if qos == self._qos or is_fixed or (is_stricter and not self._strict_again.is_over):
            self._replace_faulty(expects_publishers=bool(found))
            return
        if is_stricter:
            self._strict_again.begin()
        self._qos = qos
        if self._watched is not None and not self._watched.overlaps:
            # Seals show which messages both receive, so none is lost. The old one may match no new publisher.
            self._watched.replace(may_fail=False)
            return
        self.destroy()
        if self.watch is None:
            self._subscription = self._create(lambda _: None)
        else:
            self._watched = WatchedSubscription(self.ros, self._create, self.watch, self.clock)
            self._subscription = self._watched

    def _replace_faulty(self, *, expects_publishers: bool) -> None:
        if self._watched is None or not (reason := self._watched.fault(expects_publishers=expects_publishers)):
            return
        self._replacements += 1
        if is_power_of_ten(self._replacements):
            log.warning("%s: subscribed again (%d): %s", self.name, self._replacements, reason)
        self._watched.replace()

    def _create(self, note: Note) -> Any:
        from rclpy.event_handler import SubscriptionEventCallbacks

        return self.ros.create_subscription(
            self.kind,
            self.name,
            noting(note, lambda message, _: self.take(message)),
            self._qos,
            raw=self.raw,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )

    def destroy(self) -> None:
        """Remove the subscription from its node."""
        if self._watched is not None:
            self._watched.destroy()
        elif self._subscription is not None:
            self.ros.destroy_subscription(self._subscription)


def _strictness(qos: Any) -> tuple[bool, bool]:
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    is_latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return qos.reliability == ReliabilityPolicy.RELIABLE, is_latched


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
    opener = receiver.opener
    assert opener is not None
    for each in (opener.watch, matcher.opener.watch):
        each.expects_all, each.has_foreign = False, True

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

    watch = opener.watch if ros_class is text_class else matcher.watch
    return [
        AdaptiveSubscription(ros, seal_topic(name), text_class, take_seal, raw=False, watch=matcher.opener.watch),
        AdaptiveSubscription(ros, name, ros_class, take_message, raw=True, depth=depth, watch=watch),
    ]


def publishers_of(ros: Any, name: str) -> list[Any]:
    """Return rclpy's information on the publishers of a topic, except those of the node ``ros``."""
    return [each for each in discovery.publishers(ros, name) if each.node_name != ros.get_name()]
