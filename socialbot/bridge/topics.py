"""List, print, measure and publish topics of a running graph."""

from __future__ import annotations

import array
import itertools
import json
import math
import os
import re
import time
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, get_args

import msgspec
import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from socialbot.bags.codec import ros_type
from socialbot.bridge import environment
from socialbot.bridge.transport import matching_qos, message_class, open_transport, publisher_qos
from socialbot.core.errors import GraphError, MessageError, NodeError, suggestion
from socialbot.core.messages import Structured
from socialbot.core.registry import message_types
from socialbot.core.yaml import load_yaml
from socialbot.graph.node import Delivery, WireForm

MAX_ITEMS = 64
"""Maximum array length; longer arrays are replaced by their size."""

_PLAIN = re.compile(r"[A-Za-z_/][\w/.+-]*(?: [\w/.+-]+)*", re.ASCII)
_WORDS_OF_YAML = frozenset({"true", "false", "null", "yes", "no", "on", "off"})


def message_text(message: Any, *, raw: bool = False) -> str:
    """Format an rclpy message as YAML. Unless ``raw``, decode JSON and replace long arrays by their size."""
    return "\n".join(_lines(_plain(message, raw=raw)))


class _Cut(str):
    """Text in place of a long array."""

    __slots__ = ()


def _plain(value: Any, *, raw: bool) -> Any:
    if hasattr(value, "get_fields_and_field_types"):
        decoded = None if raw else _decoded(value)
        if decoded is not None:
            return {"data": decoded}
        return {name: _plain(getattr(value, name), raw=raw) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes) and len(value) == 1:
        return value[0]
    if isinstance(value, str) or (not isinstance(value, Sequence) and not hasattr(value, "dtype")):
        return value
    if len(value) > MAX_ITEMS and not raw:
        return _Cut(f"<{len(value)} {_kind(value)}>")
    items: Iterable[Any] = value.tolist() if isinstance(value, np.ndarray) else value
    return [_plain(item, raw=raw) for item in items]


def _decoded(message: Any) -> Any:
    text = getattr(message, "data", None)
    if not isinstance(text, str) or not text.startswith("{"):
        return None
    try:
        return msgspec.json.decode(text)
    except (msgspec.MsgspecError, UnicodeError, RecursionError):
        return None


def _kind(values: Any) -> str:
    if isinstance(values, (bytes, bytearray)) or (isinstance(values, array.array) and values.itemsize == 1):
        return "bytes"
    if isinstance(values, (array.array, np.ndarray)):
        return "numbers"
    return "items"


def _lines(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping) and value:
        for name, item in value.items():
            yield from _entry(f"{_scalar(name)}:", item)
    elif isinstance(value, list) and not _short(value):
        for item in value:
            first, *rest = _lines(item)
            yield f"- {first}"
            yield from (f"  {line}" for line in rest)
    else:
        yield _inline(value)


def _entry(name: str, value: Any) -> Iterator[str]:
    if (isinstance(value, Mapping) and value) or (isinstance(value, list) and not _short(value)):
        yield name
        yield from (f"  {line}" for line in _lines(value))
    else:
        yield f"{name} {_inline(value)}"


def _short(values: list[Any]) -> bool:
    if any(isinstance(value, (list, Mapping)) for value in values):
        return False
    return (
        all(not isinstance(value, str) for value in values) or sum(len(_scalar(value)) for value in values) <= MAX_ITEMS
    )


def _inline(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_scalar, value))}]"
    return "{}" if isinstance(value, Mapping) else _scalar(value)


def _scalar(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else f"{'-' if value < 0 else ''}.inf"
    if isinstance(value, _Cut) or not isinstance(value, str):
        return str(value)
    if _PLAIN.fullmatch(value) and value.lower() not in _WORDS_OF_YAML:
        return value
    if value.isprintable() and '"' in value:
        return "'" + value.replace("'", "''") + "'"
    # Escape control characters, which could change the terminal.
    return json.dumps(value, ensure_ascii=not value.isprintable())


HIDDEN = ("/parameter_events", "/rosout")
"""Topics of every ROS node. Names like ``/_name`` are hidden, too."""

POLL_S = 0.05
ADAPT_PERIOD_S = 0.5
QUIET_S = 1.0
SETTLE_TIMEOUT_S = 3.0
DEPTH = 100

Ended = Callable[[], bool]


@dataclass(frozen=True, order=True)
class TopicInfo:
    """Name and types of a topic, and its numbers of publishers and subscribers."""

    name: str
    types: tuple[str, ...]
    publishers: int
    subscribers: int

    @property
    def hidden(self) -> bool:
        return self.name in HIDDEN or "/_" in self.name


@contextmanager
def observer_node() -> Iterator[Any]:
    """Open a hidden rclpy node without parameter services. Raises InstallationError without ROS."""
    environment.require_ros()
    from rclpy.node import Node

    from socialbot.bridge.environment import ros_context

    with ros_context() as context:
        ros = Node(f"_topic_{os.getpid()}", context=context, enable_rosout=False, start_parameter_services=False)
        try:
            yield ros
        finally:
            ros.destroy_node()


def list_topics(ros: Any) -> tuple[TopicInfo, ...]:
    """List the topics discovered by ``ros`` by name, without its own endpoints."""
    seen = (
        TopicInfo(name, tuple(types), len(_publishers(ros, name)), len(_subscribers(ros, name)))
        for name, types in ros.get_topic_names_and_types()
    )
    return tuple(sorted(topic for topic in seen if topic.publishers or topic.subscribers))


def settled_topics(ros: Any, ended: Ended = lambda: False) -> tuple[TopicInfo, ...]:
    """List the topics once they are stable for ``QUIET_S``, or after ``SETTLE_TIMEOUT_S``."""
    begun = changed = time.monotonic()
    topics = list_topics(ros)
    while time.monotonic() - begun < SETTLE_TIMEOUT_S and not ended():
        # An empty list may mean that discovery has not finished.
        if topics and time.monotonic() - changed >= QUIET_S:
            break
        time.sleep(POLL_S)
        before, topics = topics, list_topics(ros)
        if topics != before:
            changed = time.monotonic()
    return topics


def await_publisher(ros: Any, name: str, *, timeout_s: float, ended: Ended = lambda: False) -> str | None:
    """Wait for a publisher of the topic ``name``; return its type, or None if ``ended`` came first.

    Raises:
        GraphError: There is no publisher within ``timeout_s``.
    """
    deadline = time.monotonic() + timeout_s
    while not (publishers := _publishers(ros, name)):
        if ended():
            return None
        if time.monotonic() >= deadline:
            raise _nobody(name, list_topics(ros))
        time.sleep(POLL_S)
    return publishers[0].topic_type


def messages(
    ros: Any, name: str, *, timeout_s: float, raw: bool = False, ended: Ended = lambda: False
) -> Generator[Any | None, None, None]:
    """Yield the messages of the topic ``name`` until ``ended``; as bytes if ``raw``.

    Yields None at least every ``POLL_S`` seconds, for callers with a deadline.

    Raises:
        GraphError: There is no publisher within ``timeout_s``.
        InstallationError: The type of the topic is not installed.
    """
    from rclpy.executors import SingleThreadedExecutor

    type_name = await_publisher(ros, name, timeout_s=timeout_s, ended=ended)
    if type_name is None:
        return
    arrived: deque[Any] = deque()
    # rclpy does not accept a built-in function such as `arrived.append` as a callback.
    subscription = AdaptiveSubscription(
        ros, name, message_class(type_name), lambda message: arrived.append(message), raw=raw
    )
    executor = SingleThreadedExecutor(context=ros.context)
    executor.add_node(ros)
    try:
        while not ended():
            subscription.adapt()
            executor.spin_once(timeout_sec=POLL_S)
            yield arrived.popleft() if arrived else None
    finally:
        executor.shutdown()


class AdaptiveSubscription:
    """Subscription whose quality of service matches all publishers, including new ones."""

    def __init__(self, ros: Any, name: str, kind: Any, take: Callable[[Any], None], *, raw: bool) -> None:
        self._ros = ros
        self._name = name
        self._kind = kind
        self._take = take
        self._raw = raw
        self._qos: Any = None
        self._subscription: Any = None
        self._adapted = -math.inf

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
        publishers = _publishers(self._ros, self._name)
        qos = matching_qos(publishers, DEPTH)
        if qos == self._qos or (not publishers and self._subscription is not None):
            return
        if self._subscription is not None:
            self._ros.destroy_subscription(self._subscription)
        self._qos = qos
        self._subscription = self._ros.create_subscription(
            self._kind,
            self._name,
            self._take,
            qos,
            raw=self._raw,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )


@dataclass(frozen=True)
class TopicRate:
    """Rate of a topic: mean rate, periods (s), bytes per second, and the number of measured messages."""

    hz: float
    min_s: float
    max_s: float
    deviation_s: float
    bytes_per_s: float
    messages: int


class RateMeter:
    """Rate over the last ``window`` messages."""

    def __init__(self, window: int) -> None:
        self._last: deque[tuple[float, int]] = deque(maxlen=window)

    def note(self, time_s: float, size: int) -> None:
        self._last.append((time_s, size))

    def rate(self) -> TopicRate | None:
        """Rate over the window; None with fewer than two messages."""
        times = [time_s for time_s, _ in self._last]
        if len(times) < 2 or times[-1] <= times[0]:
            return None
        periods = [later - earlier for earlier, later in itertools.pairwise(times)]
        span = times[-1] - times[0]
        mean = span / len(periods)
        return TopicRate(
            hz=1 / mean,
            min_s=min(periods),
            max_s=max(periods),
            deviation_s=math.sqrt(sum((period - mean) ** 2 for period in periods) / len(periods)),
            bytes_per_s=sum(size for _, size in itertools.islice(self._last, 1, None)) / span,
            messages=len(times),
        )


def _publishers(ros: Any, name: str) -> list[Any]:
    return [each for each in ros.get_publishers_info_by_topic(name) if each.node_name != ros.get_name()]


def _subscribers(ros: Any, name: str) -> list[Any]:
    return [each for each in ros.get_subscriptions_info_by_topic(name) if each.node_name != ros.get_name()]


def _nobody(name: str, topics: Collection[TopicInfo]) -> GraphError:
    domain = f"domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
    published = [topic.name for topic in topics if topic.publishers and not topic.hidden]
    if not published:
        return GraphError(
            f"no publisher of {name}, nor of any other topic",
            where=domain,
            remedy="start a graph; if one runs, use its ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE",
        )
    return GraphError(f"no publisher of {name}", where=domain, remedy=suggestion(name, published))


POLL_S = 0.05
STEADY_S = 0.5
"""Time for which all discovered subscribers must be connected; discovery may still be running."""
CONNECT_TIMEOUT_S = 3.0
"""Timeout of connections to subscribers: a killed process stays discovered for a while."""
ACKNOWLEDGE_TIMEOUT_S = 5.0


def parse_message(schema: str, text: str, *, stamp: int) -> Structured:
    """Parse a message of a ``schema``, such as DesireItem, from YAML or JSON. ``stamp`` (ns) is the default stamp.

    Raises:
        MessageError: The schema is unknown, or the text does not fit it.
    """
    kinds = {kind.__name__: kind for kind in message_types()}
    if schema not in kinds:
        raise MessageError(f"there is no schema {schema!r}", remedy=suggestion(schema, kinds))
    try:
        fields = load_yaml(YAML(typ="safe", pure=True), text)
    except YAMLError as error:
        raise MessageError(f"not valid YAML: {error}", where=schema) from error
    if not isinstance(fields, dict):
        raise MessageError(f"expected names with values, got {text!r}", where=schema)
    kind = kinds[schema]
    known = {field.encode_name for field in msgspec.structs.fields(kind)}
    for name in fields:
        if name not in known:
            raise MessageError(f"no field {name!r}", where=schema, remedy=suggestion(str(name), known))
    try:
        message = msgspec.convert({"stamp": stamp, **fields, "schema": kind.__struct_config__.tag}, kind)
        msgspec.json.encode(message)  # the text may hold lone surrogates
    except (msgspec.ValidationError, UnicodeError) as error:
        raise MessageError(str(error), where=schema, remedy=f"see docs/schemas/{schema}.json") from error
    return message


def publish_once(ros: Any, name: str, message: Structured, *, timeout_s: float, ended: Ended = lambda: False) -> None:
    """Publish ``message`` once in the form of the subscribers of the topic ``name``, and wait for its arrival.

    Raises:
        GraphError: There is no subscriber within ``timeout_s``, or it uses another type.
        NodeError: The message was not acknowledged.
        SecurityError: The keys are invalid.
    """
    from rclpy.duration import Duration

    kind = type(message)
    deadline = time.monotonic() + timeout_s
    while (form := _subscribed_form(ros, name, kind)) is None:
        if ended():
            return
        if time.monotonic() >= deadline:
            raise _no_subscriber(ros, name, ros_type(kind))
        time.sleep(POLL_S)
    own = open_transport(form=form)
    publisher = ros.create_publisher(own.message_class(kind), name, publisher_qos(Delivery.EVERY))
    sender = own.sender(publisher)
    _await_subscribers(ros, publisher, name, ros_type(kind, form), ended)
    if not publisher.get_subscription_count():
        raise _no_subscriber(ros, name, ros_type(kind))
    sender.publish(message)
    if not publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_TIMEOUT_S)):
        raise NodeError(f"the message was not acknowledged after {ACKNOWLEDGE_TIMEOUT_S:.0f} s", where=name)


def _subscribed_form(ros: Any, name: str, kind: type[Structured]) -> WireForm | None:
    taken = {each.topic_type for each in ros.get_subscriptions_info_by_topic(name)}
    return next((form for form in get_args(WireForm) if ros_type(kind, form) in taken), None)


def _await_subscribers(ros: Any, publisher: Any, name: str, type_name: str, ended: Ended) -> None:
    """Wait until ``publisher`` has been connected to all discovered subscribers for ``STEADY_S``."""
    begun = steady_since = time.monotonic()
    connected = publisher.get_subscription_count()
    while time.monotonic() - begun < CONNECT_TIMEOUT_S and not ended():
        before, connected = connected, publisher.get_subscription_count()
        known = sum(each.topic_type == type_name for each in ros.get_subscriptions_info_by_topic(name))
        if connected != before or connected < known:
            steady_since = time.monotonic()
        if time.monotonic() - steady_since >= STEADY_S:
            return
        time.sleep(POLL_S)


def _no_subscriber(ros: Any, name: str, type_name: str) -> GraphError:
    topics = [topic for topic in list_topics(ros) if topic.subscribers and not topic.hidden]
    other = next((", ".join(topic.types) for topic in topics if topic.name == name), "")
    where = f"domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
    if other:
        return GraphError(f"the type of {name} is {other}, not {type_name}", where=where)
    return GraphError(
        f"no subscriber of {name}", where=where, remedy=suggestion(name, [topic.name for topic in topics])
    )
