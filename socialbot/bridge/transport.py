"""Convert, sign and verify messages on their way to and from ROS topics; and their quality of service."""

from __future__ import annotations

import array
import functools
import importlib
import math
import os
import threading
from collections.abc import Collection, MutableMapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from socialbot.bags.codec import STRING, TypeFactory, decode, encode, ros_type, typed_messages
from socialbot.bags.types import PACKAGE
from socialbot.bridge.environment import KEYS_VARIABLE, check_domain, has_keys
from socialbot.core.errors import InstallationError, MessageError, ParameterError
from socialbot.core.messages import Message, Structured
from socialbot.graph.node import Delivery, WireForm

if TYPE_CHECKING:
    from socialbot.bridge.security import Opener, Seal, Stream


_REMEDY = (
    "install the ROS wheels (pip install ros-jazzy-rclpy ros-jazzy-common-interfaces ros-jazzy-rmw-fastrtps-cpp) "
    "or source a ROS 2 Jazzy installation"
)
_REMEDY_TYPED = "pip install ./interfaces/socialbot_msgs (see docs/interfaces.md), or write wire: json in the graph"


class RclpyTypes:
    """A `codec.TypeFactory` that makes messages for rclpy."""

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """A message of ``type_name``. Raises InstallationError when its package is not installed."""
        message = message_class(type_name)(
            **{name: value for name, value in fields.items() if not isinstance(value, np.ndarray)}
        )
        for name, value in fields.items():
            if isinstance(value, np.ndarray):
                _fill(message, name, value)
        return message


@functools.cache
def message_class(type_name: str) -> Any:
    """The class of a type such as ``sensor_msgs/msg/Image``.

    Raises InstallationError when ROS, or the package of this type, is not installed.
    """
    module, _, name = type_name.replace("/", ".").rpartition(".")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        remedy = _REMEDY_TYPED if type_name.startswith(f"{PACKAGE}/") else _REMEDY
        raise InstallationError(f"the ROS type {type_name} is not installed: {error}", remedy=remedy) from error


def _fill(message: Any, name: str, numbers: np.ndarray) -> None:
    # The setter would copy an array.array, and take a numpy array apart number by number: for a picture of
    # 640x480, 2 ms and 250 ms, where filling the array that the message already has takes 0.04 ms.
    own = getattr(message, name)
    if isinstance(own, array.array):
        own.frombytes(np.ascontiguousarray(numbers, np.dtype(own.typecode)).data.cast("B"))
    else:
        setattr(message, name, numbers)


M = TypeVar("M", bound=Message)

WINDOW_VARIABLE = "SOCIALBOT_KEYS_WINDOW_S"
SEALED = '{"schema":"socialbot/Sealed/'
"""What is sealed begins so. Who has no keys need not load what opens it to know that."""

LEAST_WINDOW_S, LONGEST_WINDOW_S = 0.1, 60.0

RENEWALS_A_WINDOW = 2
"""How often in each window what is latched is sealed anew, so that it is never too old for who joins late."""


class Sender:
    """One publisher on one topic; safe to use from several threads."""

    def __init__(self, types: TypeFactory, publisher: Any, stream: Stream | None, form: WireForm = "json") -> None:
        self._types = types
        self._form: WireForm = form
        self._publisher = publisher
        self._stream = stream
        self._last: str | None = None
        self._in_order = threading.Lock()

    def publish(self, message: Message) -> None:
        """Sends ``message``."""
        ros_message = encode(message, self._types, self._form)
        if isinstance(message, Structured):
            self.forward(ros_message)
        else:
            self._publisher.publish(ros_message)

    def forward(self, ros_message: Any) -> None:
        """Sends a structured message that was made elsewhere: a String, if it is to be sealed."""
        if self._stream is None:
            self._publisher.publish(ros_message)
            return
        with self._in_order:
            self._last = text = ros_message.data
            ros_message.data = self._stream.seal(text)
            self._publisher.publish(ros_message)

    def renew(self) -> None:
        """Sends the last message once more, sealed anew; those who have heard it take no notice."""
        with self._in_order:
            if self._stream is not None and self._last is not None:
                self._publisher.publish(self._types.make(STRING, data=self._stream.seal(self._last, anew=True)))


class Receiver:
    """One subscription to one topic."""

    def __init__(self, types: TypeFactory, opener: Opener | None) -> None:
        self._types = types
        self._opener = opener

    def decode(self, message_type: type[M], ros_message: Any, *, stamp: int = 0) -> M | None:
        """``ros_message`` as `codec.decode` gives it; None when it was only sealed anew since it was last heard.

        Raises MessageError, or SealError when its seal is not to be believed.
        """
        if issubclass(message_type, Structured):
            ros_message = self.open(ros_message)
            if ros_message is None:
                return None
        return decode(message_type, ros_message, stamp=stamp)

    def open(self, ros_message: Any) -> Any | None:
        """A String without its seal, if it has to have one; None and errors as in `decode`."""
        text = getattr(ros_message, "data", None)
        if self._opener is None:
            if isinstance(text, str) and text.startswith(SEALED):
                from socialbot.bridge.security import SealError

                raise SealError("sealed", "there is no key here")
            return ros_message
        if not isinstance(text, str):
            raise MessageError(f"not a valid {STRING}: {type(ros_message).__name__} holds no text")
        payload = self._opener.open(text)
        return None if payload is None else self._types.make(STRING, data=payload)


class Wire:
    """Makes the outlets and inlets of one node. Without a ``seal`` messages travel open, in the ``form`` given."""

    def __init__(self, types: TypeFactory, seal: Seal | None = None, form: WireForm = "json") -> None:
        self._types = types
        self._form: WireForm = form
        self._seal = seal
        self._latched: list[Sender] = []

    @property
    def sealed(self) -> bool:
        """Whether messages are sealed."""
        return self._seal is not None

    @property
    def renewal_s(self) -> float:
        """How often (s) to call `renew`; infinite where nothing has to be renewed."""
        return math.inf if self._seal is None else self._seal.window_s / RENEWALS_A_WINDOW

    def message_class(self, message_type: type[Message]) -> Any:
        """The rclpy class of the messages that carry ``message_type``. Raises InstallationError when there is none."""
        return message_class(ros_type(message_type, self._form))

    def outlet(self, publisher: Any, *, latched: bool = False) -> Sender:
        """For an rclpy ``publisher``; one that is ``latched`` takes part in `renew`."""
        stream = None if self._seal is None else self._seal.stream(publisher.topic_name)
        outlet = Sender(self._types, publisher, stream, self._form)
        if latched:
            self._latched.append(outlet)
        return outlet

    def inlet(self, topic: str, *, latched: bool = False) -> Receiver:
        """For a subscription to ``topic``, in full; one that is ``latched`` hears what was said before it began."""
        opener = None if self._seal is None else self._seal.opener(topic, joins_late=latched)
        return Receiver(self._types, opener)

    def stream(self, topic: str) -> Stream | None:
        """Seals text that travels on ``topic`` within another type; None without keys."""
        return None if self._seal is None else self._seal.stream(topic)

    def opener(self, topic: str) -> Opener | None:
        """Opens such text; None without keys."""
        return None if self._seal is None else self._seal.opener(topic)

    def renew(self) -> None:
        """Has what is latched sent once more, sealed anew."""
        for outlet in self._latched:
            outlet.renew()


def wire(environment: MutableMapping[str, str] = os.environ, *, form: WireForm = "json") -> Wire:
    """The wire as the ``environment`` wants it: with a seal where `KEYS_VARIABLE` is set.

    Raises SecurityError when the keys cannot be used, ParameterError when the window cannot, or when there are keys
    and messages have ROS types of their own; InstallationError when these types are not installed.
    """
    if form == "typed":
        if has_keys(environment):
            raise ParameterError(
                "sealed messages travel as text",
                where="wire: typed",
                remedy=f"write wire: json, or unset {KEYS_VARIABLE}",
            )
        message_class(next(iter(typed_messages())))
    return Wire(RclpyTypes(), _seal(environment), form)


def reason_of(error: MessageError) -> str:
    """Why a message was refused, in a word or two, to be counted by."""
    return getattr(error, "reason", "unfit")


def _seal(environment: MutableMapping[str, str]) -> Seal | None:
    if not has_keys(environment):
        return None
    from socialbot.bridge.security import Seal, SecurityError, load_keys

    folder, name = split_keys(environment[KEYS_VARIABLE])
    if not folder:
        # An empty variable is more likely a slip than the wish to be without protection.
        raise SecurityError("no folder is named", where=KEYS_VARIABLE, remedy="name one, or unset the variable")
    check_domain(environment)
    domain = int(environment.get("ROS_DOMAIN_ID") or "0")
    return Seal(load_keys(Path(folder), name), realm=f"ROS domain {domain}", window_s=_window_s(environment))


def split_keys(text: str) -> tuple[str, str]:
    """Folder and name of FOLDER:NAME; the name is empty where none is given."""
    folder, colon, name = text.rpartition(":")
    return (folder, name) if colon and "/" not in name else (text, "")


def _window_s(environment: MutableMapping[str, str]) -> float:
    from socialbot.bridge.security import WINDOW_S

    text = environment.get(WINDOW_VARIABLE) or str(WINDOW_S)
    try:
        window_s = float(text)
    except ValueError:
        window_s = math.nan
    if not LEAST_WINDOW_S <= window_s <= LONGEST_WINDOW_S:
        raise ParameterError(
            f"no window: {text!r}",
            where=WINDOW_VARIABLE,
            remedy=f"give seconds from {LEAST_WINDOW_S} to {LONGEST_WINDOW_S}",
        )
    return window_s


DEPTH = {Delivery.EVERY: 100, Delivery.NEWEST: 10, Delivery.LATCHED: 1}
"""Messages that a writer keeps for a slow reader, and a reader for a slow node."""

ONLOOKER_DEPTH = 2000
"""Messages of a topic that are kept for who only records: it has many topics to hear, and may be late for a while."""


def publisher_qos(delivery: Delivery) -> Any:
    """Reliable always, so that readers of both kinds match; late joiners get the last of a latched topic."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    latched = delivery is Delivery.LATCHED
    return QoSProfile(
        depth=DEPTH[delivery],
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def subscription_qos(delivery: Delivery, *, outside: bool) -> Any:
    """The same as the publisher's within the graph.

    What comes from ``outside`` may come from any driver, and many publish streams best effort and
    volatile; a reader that asks for more would get nothing at all.
    """
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    undemanding = outside and delivery is not Delivery.EVERY
    latched = delivery is Delivery.LATCHED and not undemanding
    return QoSProfile(
        depth=DEPTH[delivery],
        reliability=ReliabilityPolicy.BEST_EFFORT if undemanding else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def onlooker_qos(*, latched: bool) -> Any:
    """What a reader asks for that records a topic of the graph; of those that are ``latched`` the last, too."""
    qos = subscription_qos(Delivery.LATCHED if latched else Delivery.EVERY, outside=False)
    qos.depth = ONLOOKER_DEPTH
    return qos


def matching_qos(publishers: Collection[Any], depth: int) -> Any:
    """As much as all ``publishers`` offer: who asks for more gets nothing."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    offers = [publisher.qos_profile for publisher in publishers]
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = reliable and all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
