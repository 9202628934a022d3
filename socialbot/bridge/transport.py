"""Message transport over ROS topics: conversion, signatures and quality of service."""

from __future__ import annotations

import array
import functools
import importlib
import math
import os
import re
import threading
from collections import Counter
from collections.abc import Callable, Collection, Mapping, MutableMapping
from importlib.util import find_spec
from logging import getLogger
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from weakref import WeakKeyDictionary, WeakSet

import numpy as np

from socialbot.bags.codec import BULK_TYPES, ROS_TYPES, STRING, TypeFactory, decode, ros_type
from socialbot.bags.types import PACKAGE, RosbagsTypes, field_types, own_types
from socialbot.bridge._endpoints import Listener, Receiver, Sender, Subscription
from socialbot.bridge._endpoints import is_power_of_ten as is_power_of_ten
from socialbot.bridge._endpoints import is_sealed as is_sealed
from socialbot.bridge._endpoints import log_refusal as log_refusal
from socialbot.bridge._endpoints import log_refusals as log_refusals
from socialbot.bridge._endpoints import refusal_reason as refusal_reason
from socialbot.bridge.driver_domain import DriverDomain, driver_domain
from socialbot.bridge.environment import (
    KEYS_VARIABLE,
    OPEN_TOPICS_VARIABLE,
    has_keys,
    ros_domain,
    ros_remedy,
    steady_timer,
)
from socialbot.bridge.qos import QUEUE_DEPTH, SEALED_DEPTH, profile, publisher_qos, sealed_qos, subscription_qos
from socialbot.bridge.stream_watch import BEACON_S, Backoff, Note, Watch, WatchedSubscription, noting, replace_faulty
from socialbot.core.errors import InstallationError, MessageError, ParameterError
from socialbot.core.installation import interfaces_command
from socialbot.core.messages import Message, Structured
from socialbot.graph.node import WireForm
from socialbot.graph.ports import TOPIC_NAME, Delivery

if TYPE_CHECKING:
    from socialbot.bridge.detached_seals import SealMatcher
    from socialbot.bridge.security import Opener, Seal, Stream

M = TypeVar("M", bound=Message)

log = getLogger("socialbot.transport")

STANDARD_PACKAGES = frozenset(name.partition("/")[0] for name in ROS_TYPES.values())
"""Packages of the message types that socialbot itself uses."""

ROBOT_PACKAGES = frozenset(
    {"communication_skills", "control_msgs", "hri_msgs", "naoqi_bridge_msgs", "nav2_msgs", "std_skills", "tts_msgs"}
)
"""Packages that interfaces/robot_interfaces builds for the ROS wheels."""


_TYPE_NAME = re.compile(r"([A-Za-z]\w*)/(msg|srv|action)/([A-Za-z]\w*)", re.ASCII)


@functools.cache
def message_class(type_name: str) -> Any:
    """Return the rclpy class of a type such as ``sensor_msgs/msg/Image``.

    The name may come from the network, so no package is imported that has no ROS types.

    Raises:
        InstallationError: ROS, or the package of this type, is not installed.
    """
    package = type_name.partition("/")[0]
    try:
        if not (match := _TYPE_NAME.fullmatch(type_name)):
            raise ValueError("not a name of a type")
        _, folder, name = match.groups()
        if not _has_types(package, folder):
            raise ImportError(f"no package {package!r} has ROS types")
        return getattr(importlib.import_module(f"{package}.{folder}"), name)
    except (ImportError, AttributeError, ValueError) as error:
        what = f"the ROS type {type_name} is not installed: {error}"
        raise InstallationError(what, remedy=_remedy(package)) from error


def is_installed(type_name: str) -> bool:
    """Whether ROS and the package of a type are installed."""
    try:
        message_class(type_name)
    except InstallationError:
        return False
    return True


def _has_types(package: str, folder: str) -> bool:
    """Whether an installed package has a ``folder`` of types. It is not imported."""
    spec = find_spec(package)
    places = (spec is not None and spec.submodule_search_locations) or ()
    return any((Path(place) / folder / "__init__.py").is_file() for place in places)


def _remedy(package: str) -> str:
    """How to install a package of ROS types."""
    if package == PACKAGE:
        return f"{interfaces_command(PACKAGE)}, or write messages: json in the graph"
    if find_spec("rclpy") is None or package in STANDARD_PACKAGES:
        return ros_remedy()
    if package in ROBOT_PACKAGES:
        return f"source a ROS installation that has the package {package}, or {interfaces_command('robot_interfaces')}"
    return f"source the ROS workspace that has the package {package}, or install it with pip"


def _check_own_types() -> None:
    """Raise InstallationError if the package of the own types is missing, or does not fit this socialbot."""
    for name, struct in own_types().items():
        wanted, installed = field_types(struct), message_class(name).get_fields_and_field_types()
        if wanted != installed:
            other = next(key for key in {**wanted, **installed} if wanted.get(key) != installed.get(key))
            raise InstallationError(
                f"the installed package {PACKAGE} is of another version of socialbot: field {other!r} of {name} is "
                f"{installed.get(other, 'missing')}, not {wanted.get(other, 'missing')}",
                remedy=f"install it again: {interfaces_command(PACKAGE)}",
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
MIN_WINDOW_S, MAX_WINDOW_S = 0.1, 60.0
RENEWALS_PER_WINDOW = 2
"""Number of renewals of latched messages per window, so that they stay valid for late subscribers."""


class Transport:
    """Factory of the senders and receivers of one node.

    Args:
        seal: Signs and verifies messages; without it they are unsealed.
        form: The form of structured messages: JSON or ROS types.
        open_topics: Fully qualified topics of standard types, services and actions that need no seal.
        drivers: Domain where messages of some topics of standard types are published as well, and some services and
            actions are called.
    """

    def __init__(
        self,
        types: TypeFactory,
        seal: Seal | None = None,
        form: WireForm = "json",
        open_topics: Collection[str] = (),
        drivers: DriverDomain | None = None,
    ) -> None:
        self._types = types
        self._form: WireForm = form
        self._seal = seal
        self._open_topics = frozenset(open_topics)
        self._drivers = drivers
        self._lock = threading.Lock()
        """Guards the sets below, which threads may extend while another one renews."""
        self._senders: WeakSet[Sender] = WeakSet()
        self._matchers: WeakSet[SealMatcher] = WeakSet()
        self._watched: WeakSet[WatchedSubscription] = WeakSet()
        self._backoff = Backoff()
        self._timers: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()
        self.resubscribed: Counter[str] = Counter()
        """How often subscriptions were replaced, by the topic whose messages did not arrive."""

    @property
    def sealed(self) -> bool:
        return self._seal is not None

    @property
    def drivers(self) -> DriverDomain | None:
        """Domain of drivers, for commands in standard types, services and actions."""
        return self._drivers

    @property
    def renewal_s(self) -> float:
        """Period (s) of `renew`; infinite without keys."""
        return math.inf if self._seal is None else min(self._seal.window_s / RENEWALS_PER_WINDOW, BEACON_S)

    def message_class(self, message_type: type[Message]) -> Any:
        """Return the rclpy class for ``message_type``. Raises InstallationError when it is not installed."""
        return message_class(ros_type(message_type, self._form))

    def has_detached_seals(self, topic: str) -> bool:
        """Whether messages of standard types on the fully qualified ``topic`` need a seal."""
        return not self.is_open(topic)

    def is_open(self, name: str) -> bool:
        """Whether what others send on the fully qualified topic, service or action needs no seal."""
        return self._seal is None or name in self._open_topics

    def advertise(self, ros: Any, topic: str, kind: type[Message], delivery: Delivery = Delivery.EVERY) -> Sender:
        """Make a publisher of the rclpy node ``ros``, and its sender."""
        standard = not issubclass(kind, Structured)
        return self.advertise_class(ros, topic, self.message_class(kind), delivery, standard=standard)

    def advertise_class(
        self, ros: Any, topic: str, ros_class: Any, delivery: Delivery = Delivery.EVERY, *, standard: bool
    ) -> Sender:
        """Make a publisher of messages of ``ros_class``: of a ``standard`` type, or structured."""
        qos = publisher_qos(delivery)
        publisher = ros.create_publisher(ros_class, topic, qos)
        seals = None
        if standard and self.has_detached_seals(publisher.topic_name):
            from socialbot.bridge.detached_seals import seal_topic

            seals = ros.create_publisher(message_class(STRING), seal_topic(publisher.topic_name), qos)
        sender = self.sender(publisher, latched=delivery is Delivery.LATCHED, standard=standard, seals=seals)
        self._schedule_renewal(ros)
        if standard and self._drivers is not None and publisher.topic_name in self._drivers.topics:
            sender.drivers = self._drivers.node(ros, ros_class, publisher.topic_name, qos)
        return sender

    def sender(self, publisher: Any, *, latched: bool = False, standard: bool = False, seals: Any = None) -> Sender:
        """Make the sender of an rclpy publisher, and of one for detached ``seals`` if its type is ``standard``.

        `renew` repeats the last message if it is ``latched``. Without ``seals`` messages of standard types are open.
        """
        stream = None if self._seal is None or (standard and seals is None) else self._seal.stream(publisher.topic_name)
        sender = Sender(publisher, self._types, stream, self._form, seals, latched)
        with self._lock:
            self._senders.add(sender)
        return sender

    def subscribe(
        self,
        ros: Any,
        topic: str,
        kind: type[M],
        take: Callable[[M], None],
        *,
        qos: Any = None,
        latched: bool = False,
        now: Callable[[], int] = lambda: 0,
    ) -> Subscription[M]:
        """Subscribe the rclpy node ``ros`` to a topic of the graph, by default to every message.

        ``take`` gets the valid messages in the thread that spins the node; refused ones are logged. ``now`` is that of
        `listen`.
        """
        made = Subscription(topic, take)
        qos = qos or subscription_qos(Delivery.EVERY)
        made.listener = self.listen(ros, topic, kind, made.receive, made.refuse, qos=qos, latched=latched, now=now)
        return made

    def listen(
        self,
        ros: Any,
        topic: str,
        kind: type[M],
        take: Callable[[M, Any], None],
        refuse: Callable[[MessageError], None],
        *,
        qos: Any,
        latched: bool = False,
        now: Callable[[], int] = lambda: 0,
    ) -> Listener:
        """Subscribe the rclpy node ``ros`` to ``topic``, in the thread that spins it.

        Args:
            take: Gets each valid message and its information from rclpy.
            refuse: Gets the reason for each other message.
            latched: Accept messages that are older than the subscription.
            now: Stamp (ns) of messages without one.

        Raises:
            InstallationError: The ROS type of ``kind`` is not installed.
        """
        name, ros_class = ros.resolve_topic_name(topic), self.message_class(kind)
        if issubclass(kind, BULK_TYPES) or (not issubclass(kind, Structured) and self.has_detached_seals(name)):
            deserialize = _deserializer(kind, ros_class)

            def take_bytes(cdr: bytes, info: Any) -> None:
                try:
                    message = decode(kind, deserialize(cdr), stamp=now())
                except MessageError as error:
                    refuse(error)
                else:
                    take(message, info)

            return self.listen_bytes(ros, name, ros_class, take_bytes, refuse, qos=qos, latched=latched)
        receiver = self.receiver(name, latched=latched)

        def receive(ros_message: Any, info: Any) -> None:
            try:
                message = receiver.decode(kind, ros_message, stamp=now())
            except MessageError as error:
                refuse(error)
            else:
                if message is not None:
                    take(message, info)

        if receiver.opener is not None:
            from rclpy.qos import ReliabilityPolicy

            receiver.opener.watch.expects_all = qos.reliability == ReliabilityPolicy.RELIABLE
            receiver.opener.watch.keeps_all = qos.depth >= QUEUE_DEPTH[Delivery.EVERY]
            qos = sealed_qos(qos)
        return Listener(
            self.watched(
                ros,
                lambda note: ros.create_subscription(ros_class, name, noting(note, receive), qos),
                receiver.opener,
            )
        )

    def listen_bytes(
        self,
        ros: Any,
        topic: str,
        ros_class: Any,
        take: Callable[[bytes, Any], None],
        refuse: Callable[[MessageError], None],
        *,
        qos: Any,
        latched: bool = False,
    ) -> Listener:
        """Subscribe to serialised messages of a standard type, as `listen` does to decoded ones."""
        matcher = self.matcher(topic, take, refuse, latched=latched)
        # rclpy passes the information on a message only to a function with two parameters, which a partial hides.
        if matcher is None:
            return Listener(ros.create_subscription(ros_class, topic, lambda cdr, info: take(cdr, info), qos, raw=True))
        from socialbot.bridge.detached_seals import seal_topic

        seal_qos = profile(SEALED_DEPTH, latched=latched)

        def messages(note: Note) -> Any:
            return ros.create_subscription(ros_class, topic, noting(note, matcher.take_message), qos, raw=True)

        def seals(note: Note) -> Any:
            take_seal = noting(note, lambda text, _: matcher.take_seal(text.data))
            return ros.create_subscription(message_class(STRING), seal_topic(topic), take_seal, seal_qos)

        return Listener(self._watch(ros, messages, matcher.watch), self._watch(ros, seals, matcher.opener.watch))

    def watched(self, ros: Any, create: Callable[[Note], Any], opener: Opener | None) -> Any:
        """Make a subscription to sealed messages that is replaced when they do not arrive; a plain one without keys.

        Args:
            ros: The node of the subscription, which must be spun.
            create: Makes the subscription, which calls the given function with each message first.
            opener: Verifies its messages.
        """
        return create(lambda _: None) if opener is None else self._watch(ros, create, opener.watch)

    def _watch(self, ros: Any, create: Callable[[Note], Any], watch: Watch) -> WatchedSubscription:
        made = WatchedSubscription(ros, create, watch, backoff=self._backoff)
        with self._lock:
            self._watched.add(made)
        self._schedule_renewal(ros)
        return made

    def _replace_faulty(self, subscriptions: Collection[WatchedSubscription]) -> None:
        for topic, reason in replace_faulty(subscriptions).items():
            self.resubscribed[topic] += 1
            if is_power_of_ten(count := self.resubscribed[topic]):
                log.warning("%s: all topics of the node are subscribed again (%d): %s", topic, count, reason)

    def _schedule_renewal(self, ros: Any) -> None:
        """Call `renew` in the thread that spins ``ros``, once in its period."""
        if self._seal is None or ros in self._timers:
            return
        self._timers[ros] = steady_timer(ros, self.renewal_s, self.renew)

    def matcher(
        self,
        topic: str,
        take: Callable[[bytes, Any], None],
        refuse: Callable[[MessageError], None],
        *,
        latched: bool = False,
    ) -> SealMatcher | None:
        """Make the matcher of messages of a standard type with their seals; None if the topic needs none."""
        if self._seal is None or not self.has_detached_seals(topic):
            return None
        from socialbot.bridge.detached_seals import SealMatcher

        matcher = SealMatcher(self._seal.opener(topic, joins_late=latched), take, refuse)
        with self._lock:
            self._matchers.add(matcher)
        return matcher

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
        """Make the verifier of text that `stream` has sealed; None without keys."""
        return None if self._seal is None else self._seal.opener(topic)

    def renew(self) -> None:
        """Do what is due with keys.

        It publishes the last messages of latched senders again with new seals, and beacons of idle senders. It refuses
        messages without a seal, and replaces subscriptions that miss messages.
        """
        with self._lock:
            senders, matchers, watched = tuple(self._senders), tuple(self._matchers), tuple(self._watched)
        for sender in senders:
            sender.renew()
        for matcher in matchers:
            matcher.expire()
        self._replace_faulty(watched)

    def close(self) -> None:
        """Refuse the messages that still wait for a seal."""
        with self._lock:
            matchers = tuple(self._matchers)
        for matcher in matchers:
            matcher.close()

    def end_renewal(self) -> None:
        """End the timers of `renew`."""
        for ros, timer in tuple(self._timers.items()):
            ros.destroy_timer(timer)
        self._timers.clear()


def _deserializer(kind: type[Message], ros_class: Any) -> Callable[[bytes], Any]:
    """Return what reads serialised messages. That of rosbags copies no pixels, but needs 0.1 s to load its types."""
    if issubclass(kind, BULK_TYPES):
        return functools.partial(RosbagsTypes().deserialize, type_name=ros_type(kind))
    return functools.partial(deserialized, ros_class=ros_class)


def deserialized(cdr: bytes, ros_class: Any) -> Any:
    """Read a serialised message of ``ros_class``. Raises MessageError for damaged bytes."""
    from rclpy.impl.implementation_singleton import rclpy_implementation
    from rclpy.serialization import deserialize_message

    try:
        return deserialize_message(cdr, ros_class)
    except rclpy_implementation.RMWError as error:
        raise MessageError(f"{len(cdr)} bytes are no {ros_class.__name__}: {error}") from error


def open_transport(environment: MutableMapping[str, str] = os.environ, *, form: WireForm = "json") -> Transport:
    """Make the transport of the ``environment``, sealed if `KEYS_VARIABLE` is set.

    Raises:
        SecurityError: The keys cannot be used.
        ParameterError: A variable is invalid, or keys are set and ``form`` is "typed".
        InstallationError: ``form`` is "typed" and the package of these types is missing or of another version.
    """
    if form == "typed":
        if has_keys(environment):
            raise ParameterError(
                "sealed messages travel as text",
                where="messages: socialbot",
                remedy=f"write messages: json, or unset {KEYS_VARIABLE}",
            )
        _check_own_types()
    seal = _seal(environment) if has_keys(environment) else None
    return Transport(RclpyTypes(), seal, form, open_topics(environment), driver_domain(environment))


def open_topics(environment: MutableMapping[str, str] = os.environ) -> frozenset[str]:
    """Topics of `OPEN_TOPICS_VARIABLE`. Raises ParameterError if one is not a fully qualified name."""
    names = [name for name in environment.get(OPEN_TOPICS_VARIABLE, "").split(":") if name]
    for name in names:
        if not TOPIC_NAME.fullmatch(name):
            raise ParameterError(
                f"{name!r} is not a full topic name",
                where=OPEN_TOPICS_VARIABLE,
                remedy="write names such as /camera/image_raw, separated by colons",
            )
    return frozenset(names)


def split_keys(text: str) -> tuple[str, str]:
    """Split FOLDER:NAME; the name may be empty."""
    folder, colon, name = text.rpartition(":")
    return (folder, name) if colon and "/" not in name else (text, "")


def _seal(environment: MutableMapping[str, str]) -> Seal:
    from socialbot.bridge.accepted_times import AcceptedTimes, state_folder
    from socialbot.bridge.keys import KeyRing, SecurityError
    from socialbot.bridge.security import Seal

    folder, name = split_keys(environment[KEYS_VARIABLE])
    if not folder:
        # An empty variable is probably a mistake, not a request for no protection.
        raise SecurityError("no folder is named", where=KEYS_VARIABLE, remedy="name one, or unset the variable")
    keys, realm = KeyRing(Path(folder), name), f"ROS domain {ros_domain(environment)}"
    accepted = AcceptedTimes(state_folder(realm, Path(folder), keys.latest().name))
    return Seal(keys, realm, window_s(environment), accepted)


def window_s(environment: Mapping[str, str]) -> float:
    """The allowed clock difference plus travel time of a message. Raises ParameterError for an invalid one."""
    from socialbot.bridge.keys import WINDOW_S

    text = environment.get(WINDOW_VARIABLE) or str(WINDOW_S)
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not MIN_WINDOW_S <= found <= MAX_WINDOW_S:
        raise ParameterError(
            f"{text!r} is not a valid window",
            where=WINDOW_VARIABLE,
            remedy=f"set it to {MIN_WINDOW_S} to {MAX_WINDOW_S} seconds",
        )
    return found
