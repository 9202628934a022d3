"""Senders and receivers of the messages of one topic, sealed or plain."""

from __future__ import annotations

import itertools
import math
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from logging import getLogger
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from msgspec.structs import replace

from socialbot.bags.codec import BULK_TYPES, STRING, TypeFactory, decode, encode
from socialbot.bags.types import RosbagsTypes
from socialbot.bridge.stream_watch import BEACON_S, WatchedSubscription
from socialbot.core.errors import MessageError
from socialbot.core.messages import CompressedImage, Image, Message, PointCloud, Structured
from socialbot.graph.node import WireForm

if TYPE_CHECKING:
    from socialbot.bridge.driver_domain import DriverNode
    from socialbot.bridge.security import Opener, Stream

M = TypeVar("M", bound=Message)

_BYTES = RosbagsTypes()
_NO_ITEMS = bytes(4)  # CDR of an empty sequence: its length

log = getLogger("socialbot.transport")

_SEALED_PREFIX = '{"schema":"socialbot/Sealed/'
"""Prefix of every sealed message, which processes without keys recognise without a cryptography library."""


@dataclass(eq=False)
class Sender:
    """Thread-safe sender of messages through one rclpy ``publisher``.

    Attributes:
        stream: Seals the messages; None without keys.
        seals: Publisher of detached seals, for messages of standard types; None for structured messages.
        latched: Whether late subscribers get the last message.
        sent: Number of messages, without renewals and beacons.
        drivers: Node with a publisher of the plain messages, in the domain of drivers.
    """

    publisher: Any
    types: TypeFactory
    stream: Stream | None
    form: WireForm = "json"
    seals: Any = None
    latched: bool = False
    sent: int = 0
    drivers: DriverNode | None = None
    clock: Callable[[], float] = time.monotonic
    _last: str | None = field(default=None, init=False)
    _destroyed: bool = field(default=False, init=False)
    _sealed_at: float = field(default=-math.inf, init=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False)

    def publish(self, message: Message) -> None:
        """Encode, seal if there are keys, and publish ``message``."""
        if self.stream is not None and self.drivers is None and isinstance(message, BULK_TYPES):
            self.publish_encoded(_serialized_bulk(message))
            return
        ros_message = encode(message, self.types, self.form)
        if self.seals is None and isinstance(message, Structured):
            self.forward(ros_message)
        else:
            self.publish_encoded(ros_message)

    def publish_encoded(self, ros_message: Any) -> None:
        """Publish an encoded or serialised message of a standard type, with a detached seal if there are keys."""
        if self.stream is None:
            self.publisher.publish(ros_message)
        else:
            from socialbot.bridge.detached_seals import padded

            cdr = padded(ros_message if isinstance(ros_message, bytes) else _serialized(ros_message))
            with self._lock:
                self._last, seal = self.stream.seal_detached(cdr, latched=self.latched)
                # The seal comes first, so that receivers seldom have to keep messages.
                self.seals.publish(self._text(seal))
                self.publisher.publish(cdr)
        if self.drivers is not None:
            self.drivers.publisher.publish(ros_message)
        self.sent += 1

    def forward(self, ros_message: Any) -> None:
        """Publish an encoded structured message: a String, if it has to be sealed."""
        if self.stream is None:
            self.publisher.publish(ros_message)
        else:
            with self._lock:
                self._last = text = ros_message.data
                self.publisher.publish(self._text(self.stream.seal(text)))
        self.sent += 1

    def renew(self) -> None:
        """Publish the last message again with a new seal if it is latched; else a beacon if no seal was sent lately."""
        with self._lock:
            if self.stream is None or self._destroyed:
                return
            if self.latched and self._last is not None:
                self._publish_seal(self.stream.seal(self._last, renew=True))
            elif self.clock() - self._sealed_at > BEACON_S / 2:
                self._publish_seal(self.stream.beacon())

    def _publish_seal(self, text: str) -> None:
        publisher = self.publisher if self.seals is None else self.seals
        publisher.publish(self._text(text))

    def _text(self, sealed: str) -> Any:
        self._sealed_at = self.clock()
        return self.types.make(STRING, data=sealed)

    def destroy(self, ros: Any) -> None:
        """Remove the publishers from the rclpy node ``ros``."""
        with self._lock:
            self._destroyed = True
        ros.destroy_publisher(self.publisher)
        if self.seals is not None:
            ros.destroy_publisher(self.seals)
        if self.drivers is not None:
            self.drivers.close()


def _serialized_bulk(message: Image | CompressedImage | PointCloud) -> bytes:
    """Serialize ``message`` with a single copy of its data, if they are its last field."""
    data = np.asarray(message.data)
    if isinstance(message, PointCloud) or data.dtype != np.uint8 or data.ndim != 1:
        return _BYTES.serialize(encode(message, _BYTES))
    head = _BYTES.serialize(encode(replace(message, data=data[:0]), _BYTES))[: -len(_NO_ITEMS)]
    return b"".join((head, len(data).to_bytes(len(_NO_ITEMS), sys.byteorder), np.ascontiguousarray(data).data))


def _serialized(ros_message: Any) -> bytes:
    from rclpy.serialization import serialize_message

    return serialize_message(ros_message)


@dataclass
class Receiver:
    """Decoder of the verified messages of one subscription."""

    types: TypeFactory
    opener: Opener | None

    def decode(self, message_type: type[M], ros_message: Any, *, stamp: int = 0) -> M | None:
        """Decode ``ros_message`` as `codec.decode` does; None for a known message with a renewed seal.

        Raises:
            MessageError: The message does not fit the type.
            SealError: The seal is missing or invalid.
        """
        if issubclass(message_type, Structured):
            ros_message = self.open(ros_message)
            if ros_message is None:
                return None
        return decode(message_type, ros_message, stamp=stamp)

    def open(self, ros_message: Any) -> Any | None:
        """Return a String without its seal, if a seal is required. Returns None and raises errors as `decode` does."""
        text = getattr(ros_message, "data", None)
        if self.opener is None:
            if isinstance(text, str) and is_sealed(text):
                from socialbot.bridge.security import SealError

                raise SealError("sealed", "this process has no key")
            return ros_message
        if not isinstance(text, str):
            raise MessageError(f"not a valid {STRING}: {type(ros_message).__name__} holds no text")
        payload = self.opener.open(text)
        return None if payload is None else self.types.make(STRING, data=payload)


@dataclass
class Listener:
    """Subscription to valid messages of one topic; see `Transport.listen`.

    Attributes:
        endpoint: The rclpy subscription, or a `WatchedSubscription` with keys.
        seals: The subscription to detached seals, if the topic has them.
    """

    endpoint: Any
    seals: WatchedSubscription | None = None

    def lost(self, wanted: int) -> int:
        """How many of the ``wanted`` publishers with keys are lost: see `WatchedSubscription.lost`."""
        endpoints = (self.endpoint, self.seals)
        return max((each.lost(wanted) for each in endpoints if isinstance(each, WatchedSubscription)), default=0)

    def destroy(self, ros: Any) -> None:
        """Remove the subscriptions from the rclpy node ``ros``."""
        if isinstance(self.endpoint, WatchedSubscription):
            self.endpoint.destroy()
        else:
            ros.destroy_subscription(self.endpoint)
        if self.seals is not None:
            self.seals.destroy()


@dataclass
class Subscription(Generic[M]):
    """Subscription that passes valid messages to ``take``; see `Transport.subscribe`.

    Attributes:
        endpoint: That of the listener.
        refused: Number of invalid messages.
        taken: Number of messages, without renewals. ``on_taken`` is called after each.
    """

    topic: str
    take: Callable[[M], None]
    listener: Listener | None = None
    refused: int = 0
    taken: int = 0
    on_taken: Callable[[], None] | None = None

    @property
    def endpoint(self) -> Any:
        return None if self.listener is None else self.listener.endpoint

    def receive(self, message: M, info: Any = None) -> None:
        self.take(message)
        self._count()

    def refuse(self, error: MessageError) -> None:
        self.refused += 1
        log_refusal(self.topic, self.refused, error)
        self._count()

    def _count(self) -> None:
        self.taken += 1
        if self.on_taken is not None:
            self.on_taken()


def is_sealed(text: str) -> bool:
    """Whether ``text`` claims to be a sealed message."""
    return text.startswith(_SEALED_PREFIX)


def refusal_reason(error: MessageError) -> str:
    """Refusal reason in one or two words, as a key for counts."""
    return getattr(error, "reason", "unfit")


def log_refusal(topic: str, count: int, error: MessageError) -> None:
    """Log the first, tenth, hundredth, ... refused message of a topic."""
    if is_power_of_ten(count):
        log.warning("%s: refused %d messages (%s): %s", topic, count, refusal_reason(error), error)


def log_refusals(topic: str) -> Callable[[MessageError], None]:
    """Return a function that logs refused messages of ``topic`` as `log_refusal` does."""
    counts = itertools.count(1)
    return lambda error: log_refusal(topic, next(counts), error)


def is_power_of_ten(count: int) -> bool:
    """Whether ``count`` is 1, 10, 100, ...; repeated failures are logged at these counts."""
    return str(count).strip("0") == "1"
