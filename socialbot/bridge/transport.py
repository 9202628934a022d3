"""Message transport over ROS topics: conversion, signatures and quality of service."""

from __future__ import annotations

import array
import functools
import importlib
import math
import os
import threading
from collections.abc import Callable, Collection, MutableMapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from logging import getLogger
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from socialbot.bags.codec import ROS_TYPES, STRING, TypeFactory, decode, encode, ros_type
from socialbot.bags.types import PACKAGE, field_types, own_types
from socialbot.bridge.environment import KEYS_VARIABLE, has_keys, ros_domain
from socialbot.core.errors import InstallationError, MessageError, ParameterError
from socialbot.core.messages import Message, Structured
from socialbot.graph.node import Delivery, WireForm

if TYPE_CHECKING:
    from socialbot.bridge.security import Opener, Seal, Stream

M = TypeVar("M", bound=Message)

log = getLogger("socialbot.transport")

_REMEDY = (
    "install the ROS wheels (pip install ros-jazzy-rclpy ros-jazzy-common-interfaces ros-jazzy-rmw-fastrtps-cpp) "
    "or source a ROS 2 Jazzy installation"
)
STANDARD_PACKAGES = frozenset(name.partition("/")[0] for name in ROS_TYPES.values())
"""Packages of the message types that socialbot itself uses."""

_REMEDY_TYPED = "pip install ./interfaces/socialbot_msgs (see docs/interfaces.md), or write wire: json in the graph"


@functools.cache
def message_class(type_name: str) -> Any:
    """Return the rclpy class of a type such as ``sensor_msgs/msg/Image``.

    Raises:
        InstallationError: ROS, or the package of this type, is not installed.
    """
    module, _, name = type_name.replace("/", ".").rpartition(".")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        package = type_name.partition("/")[0]
        known = find_spec("rclpy") is not None and package not in STANDARD_PACKAGES
        own = f"source the ROS workspace that has the package {package}, or install it with pip"
        remedy = _REMEDY_TYPED if package == PACKAGE else own if known else _REMEDY
        raise InstallationError(f"the ROS type {type_name} is not installed: {error}", remedy=remedy) from error


def _check_own_types() -> None:
    """Raise InstallationError if the package of the own types is missing, or does not fit this socialbot."""
    for name, struct in own_types().items():
        wanted, installed = field_types(struct), message_class(name).get_fields_and_field_types()
        if wanted != installed:
            other = next(key for key in {**wanted, **installed} if wanted.get(key) != installed.get(key))
            raise InstallationError(
                f"the installed package {PACKAGE} is of another version of socialbot: field {other!r} of {name} is "
                f"{installed.get(other, 'missing')}, not {wanted.get(other, 'missing')}",
                remedy=f"install it again: make interfaces, or {_REMEDY_TYPED}",
            )


class RclpyTypes:
    """`codec.TypeFactory` for rclpy messages."""

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """Make a message of ``type_name``. Raises InstallationError when its package is not installed."""
        arrays = {name: value for name, value in fields.items() if isinstance(value, np.ndarray)}
        message = message_class(type_name)(**{name: value for name, value in fields.items() if name not in arrays})
        for name, numbers in arrays.items():
            # The setter takes 250 ms to check a numpy array of 640x480x3, and 2 ms to copy an array.array. Filling the
            # array of the message takes 0.04 ms.
            own = getattr(message, name)
            if isinstance(own, array.array):
                own.frombytes(np.ascontiguousarray(numbers, np.dtype(own.typecode)).data.cast("B"))
            else:
                setattr(message, name, numbers)
        return message

    def owns(self, ros_message: Any) -> bool:
        return hasattr(ros_message, "get_fields_and_field_types")


WINDOW_VARIABLE = "SOCIALBOT_KEYS_WINDOW_S"
_SEALED_PREFIX = '{"schema":"socialbot/Sealed/'
"""Prefix of every sealed message, which processes without keys recognise without a cryptography library."""

MIN_WINDOW_S, MAX_WINDOW_S = 0.1, 60.0
RENEWALS_PER_WINDOW = 2
"""Number of renewals of latched messages per window, so that they stay valid for late subscribers."""


@dataclass
class Sender:
    """Thread-safe sender of messages through one rclpy ``publisher``. ``sent`` counts them, without renewals."""

    publisher: Any
    types: TypeFactory
    stream: Stream | None
    form: WireForm = "json"
    sent: int = 0
    _last: str | None = field(default=None, init=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False)

    def publish(self, message: Message) -> None:
        """Encode, seal if there are keys, and publish ``message``."""
        ros_message = encode(message, self.types, self.form)
        if isinstance(message, Structured):
            self.forward(ros_message)
        else:
            self.publisher.publish(ros_message)
            self.sent += 1

    def forward(self, ros_message: Any) -> None:
        """Publish an encoded structured message: a String, if it has to be sealed."""
        if self.stream is None:
            self.publisher.publish(ros_message)
        else:
            with self._lock:
                self._last = text = ros_message.data
                ros_message.data = self.stream.seal(text)
                self.publisher.publish(ros_message)
        self.sent += 1

    def renew(self) -> None:
        """Publish the last message again with a new seal. Receivers ignore a known message."""
        with self._lock:
            if self.stream is not None and self._last is not None:
                self.publisher.publish(self.types.make(STRING, data=self.stream.seal(self._last, renew=True)))


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
        """Return the String without its seal, if a seal is required. None and errors are those of `decode`."""
        text = getattr(ros_message, "data", None)
        if self.opener is None:
            if isinstance(text, str) and text.startswith(_SEALED_PREFIX):
                from socialbot.bridge.security import SealError

                raise SealError("sealed", "this process has no key")
            return ros_message
        if not isinstance(text, str):
            raise MessageError(f"not a valid {STRING}: {type(ros_message).__name__} holds no text")
        payload = self.opener.open(text)
        return None if payload is None else self.types.make(STRING, data=payload)


@dataclass
class Subscription(Generic[M]):
    """Subscription that passes valid messages to ``take``; see `Transport.subscribe`.

    Attributes:
        endpoint: The rclpy subscription.
        refused: Number of invalid messages.
        taken: Number of messages, without renewals. ``on_taken`` is called after each.
    """

    topic: str
    kind: type[M]
    receiver: Receiver
    take: Callable[[M], None]
    endpoint: Any = None
    refused: int = 0
    taken: int = 0
    on_taken: Callable[[], None] | None = None

    def receive(self, ros_message: Any) -> None:
        try:
            message = self.receiver.decode(self.kind, ros_message)
        except MessageError as error:
            self.refused += 1
            log_refusal(self.topic, self.refused, error)
        else:
            if message is None:
                return
            self.take(message)
        self.taken += 1
        if self.on_taken is not None:
            self.on_taken()


class Transport:
    """Factory of the senders and receivers of one node.

    Args:
        seal: Signs and verifies structured messages; without it they are unsealed.
        form: The form of structured messages: JSON or ROS types.
    """

    def __init__(self, types: TypeFactory, seal: Seal | None = None, form: WireForm = "json") -> None:
        self._types = types
        self._form: WireForm = form
        self._seal = seal
        self._latched: list[Sender] = []

    @property
    def sealed(self) -> bool:
        return self._seal is not None

    @property
    def renewal_s(self) -> float:
        """Period (s) of `renew`; infinite without keys."""
        return math.inf if self._seal is None else self._seal.window_s / RENEWALS_PER_WINDOW

    def message_class(self, message_type: type[Message]) -> Any:
        """Return the rclpy class for ``message_type``. Raises InstallationError when it is not installed."""
        return message_class(ros_type(message_type, self._form))

    def advertise(self, ros: Any, topic: str, kind: type[Message], delivery: Delivery = Delivery.EVERY) -> Sender:
        """Make a publisher of the rclpy node ``ros``, and its sender."""
        publisher = ros.create_publisher(self.message_class(kind), topic, publisher_qos(delivery))
        return self.sender(publisher, latched=delivery is Delivery.LATCHED)

    def subscribe(
        self,
        ros: Any,
        topic: str,
        kind: type[M],
        take: Callable[[M], None],
        *,
        qos: Any = None,
        latched: bool = False,
    ) -> Subscription[M]:
        """Subscribe the rclpy node ``ros`` to a topic of the graph, by default to every message.

        ``take`` gets the valid messages in the thread that spins the node; refused ones are logged.
        """
        subscription = Subscription(topic, kind, self.receiver(topic, latched=latched), take)
        subscription.endpoint = ros.create_subscription(
            self.message_class(kind), topic, subscription.receive, qos or subscription_qos(Delivery.EVERY)
        )
        return subscription

    def sender(self, publisher: Any, *, latched: bool = False) -> Sender:
        """Make the sender of an rclpy publisher. `renew` includes it if it is ``latched``."""
        stream = None if self._seal is None else self._seal.stream(publisher.topic_name)
        sender = Sender(publisher, self._types, stream, self._form)
        if latched:
            self._latched.append(sender)
        return sender

    def receiver(self, topic: str, *, latched: bool = False) -> Receiver:
        """Make the receiver of a subscription to the fully qualified ``topic``.

        A ``latched`` one accepts messages older than the subscription.
        """
        opener = None if self._seal is None else self._seal.opener(topic, joins_late=latched)
        return Receiver(self._types, opener)

    def stream(self, topic: str) -> Stream | None:
        """Make the sealer of text in messages of another type on ``topic``; None without keys."""
        return None if self._seal is None else self._seal.stream(topic)

    def opener(self, topic: str) -> Opener | None:
        """Make the verifier of such text; None without keys."""
        return None if self._seal is None else self._seal.opener(topic)

    def renew(self) -> None:
        """Publish the last messages of latched senders again with new seals."""
        for sender in self._latched:
            sender.renew()


def open_transport(environment: MutableMapping[str, str] = os.environ, *, form: WireForm = "json") -> Transport:
    """Make the transport of the ``environment``, sealed if `KEYS_VARIABLE` is set.

    Raises:
        SecurityError: The keys cannot be used.
        ParameterError: The window is invalid, or keys are set and ``form`` is "typed".
        InstallationError: ``form`` is "typed" and the package of these types is missing or of another version.
    """
    if form == "typed":
        if has_keys(environment):
            raise ParameterError(
                "sealed messages travel as text",
                where="wire: typed",
                remedy=f"write wire: json, or unset {KEYS_VARIABLE}",
            )
        _check_own_types()
    return Transport(RclpyTypes(), _seal(environment) if has_keys(environment) else None, form)


def refusal_reason(error: MessageError) -> str:
    """Refusal reason in one or two words, as a key for counts."""
    return getattr(error, "reason", "unfit")


def log_refusal(topic: str, count: int, error: MessageError) -> None:
    """Log the first, tenth, hundredth, ... refused message of a topic."""
    if is_power_of_ten(count):
        log.warning("%s: refused %d messages (%s): %s", topic, count, refusal_reason(error), error)


def is_power_of_ten(count: int) -> bool:
    """Whether ``count`` is 1, 10, 100, ...; repeated failures are logged at these counts."""
    return str(count).strip("0") == "1"


def split_keys(text: str) -> tuple[str, str]:
    """Split FOLDER:NAME; the name may be empty."""
    folder, colon, name = text.rpartition(":")
    return (folder, name) if colon and "/" not in name else (text, "")


def _seal(environment: MutableMapping[str, str]) -> Seal:
    from socialbot.bridge.security import WINDOW_S, Seal, SecurityError, load_keys

    folder, name = split_keys(environment[KEYS_VARIABLE])
    if not folder:
        # An empty variable is probably a mistake, not a request for no protection.
        raise SecurityError("no folder is named", where=KEYS_VARIABLE, remedy="name one, or unset the variable")
    text = environment.get(WINDOW_VARIABLE) or str(WINDOW_S)
    try:
        window_s = float(text)
    except ValueError:
        window_s = math.nan
    if not MIN_WINDOW_S <= window_s <= MAX_WINDOW_S:
        raise ParameterError(
            f"{text!r} is not a valid window",
            where=WINDOW_VARIABLE,
            remedy=f"set it to {MIN_WINDOW_S} to {MAX_WINDOW_S} seconds",
        )
    domain = ros_domain(environment)
    return Seal(load_keys(Path(folder), name), realm=f"ROS domain {domain}", window_s=window_s)


QUEUE_DEPTH = {Delivery.EVERY: 100, Delivery.NEWEST: 10, Delivery.LATCHED: 1}
"""History depth of publishers, and of subscriptions, which have at least `LEAST_DEPTH`."""

LEAST_DEPTH = 10
"""Least history depth of a subscription. With less, messages of several publishers or of one moment are lost."""

OBSERVER_DEPTH = 2000  # history depth of an observer, which may fall behind on many topics


def publisher_qos(delivery: Delivery) -> Any:
    """Profile of publishers: reliable, to match all subscriptions; transient local for latched topics."""
    return _qos(QUEUE_DEPTH[delivery], latched=delivery is Delivery.LATCHED)


def subscription_qos(delivery: Delivery, *, outside: bool = False) -> Any:
    """Profile of subscriptions: that of the publisher within the graph.

    Drivers ``outside`` the graph may publish best effort and volatile. A stricter subscription would not match them, so
    this one requests the least.
    """
    undemanding = outside and delivery is not Delivery.EVERY
    latched = delivery is Delivery.LATCHED and not undemanding
    return _qos(max(LEAST_DEPTH, QUEUE_DEPTH[delivery]), reliable=not undemanding, latched=latched)


def observer_qos(*, latched: bool) -> Any:
    """Profile of an observer that records a topic of the graph."""
    return _qos(OBSERVER_DEPTH, latched=latched)


def matching_qos(publishers: Collection[Any], depth: int) -> Any:
    """Strictest profile that matches all ``publishers``."""
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    offers = [publisher.qos_profile for publisher in publishers]
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = reliable and all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return _qos(depth, reliable=reliable, latched=latched)


def _qos(depth: int, *, reliable: bool = True, latched: bool = False) -> Any:
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
