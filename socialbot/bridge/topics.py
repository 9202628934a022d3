"""List, print, measure and publish topics of a running graph."""

from __future__ import annotations

import array
import io
import math
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar, get_args

import msgspec
import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.representer import SafeRepresenter

from socialbot.bags.codec import decode, ros_type
from socialbot.bridge import discovery, environment
from socialbot.bridge.adaptive_subscriptions import (
    DEPTH,
    AdaptiveSubscription,
    publishers_of,
    verified_subscriptions,
)
from socialbot.bridge.environment import POLL_S, ros_domain, wait_for
from socialbot.bridge.transport import is_installed, log_refusals, message_class, open_transport
from socialbot.core.clock import SECOND
from socialbot.core.decoding import from_builtins, from_json
from socialbot.core.errors import GraphError, MessageError, NodeError, suggestion
from socialbot.core.messages import NO_JSON, Message, RosMessage, Structured, ros_message
from socialbot.core.references import load_reference
from socialbot.core.registry import message_types
from socialbot.core.yaml import load_yaml
from socialbot.graph.calls import fill_message
from socialbot.graph.node import WireForm

T = TypeVar("T")

MAX_ITEMS = 64  # maximum array length; longer arrays are replaced by their size


def message_text(message: Any, *, raw: bool = False) -> str:
    """Format an rclpy message as YAML. Unless ``raw``, decode JSON and replace long arrays by their size."""
    value = _plain(message, raw=raw)
    text = _yaml(value)
    # Escape control characters, which could change the terminal.
    return text if all(line.isprintable() for line in text.splitlines()) else _yaml(value, allow_unicode=False)


def _yaml(value: Any, *, allow_unicode: bool = True) -> str:
    yaml = YAML(typ="safe", pure=True)
    yaml.Representer = _Representer
    yaml.default_flow_style, yaml.allow_unicode, yaml.width = False, allow_unicode, sys.maxsize
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.indent(mapping=2, sequence=4, offset=2)
    text = io.StringIO()
    yaml.dump(value, text)
    return text.getvalue().rstrip("\n")


class _Representer(SafeRepresenter):
    """Writes short lists in one line."""

    def represent_list(self, data: list[Any]) -> Any:
        nested = any(isinstance(item, (list, dict)) for item in data)
        letters = sum(len(item) for item in data if isinstance(item, str))
        short = not nested and letters <= MAX_ITEMS
        return self.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=short)


_Representer.add_representer(list, _Representer.represent_list)


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
        return f"<{len(value)} {_kind(value)}>"
    items: Iterable[Any] = value.tolist() if isinstance(value, np.ndarray) else value
    return [_plain(item, raw=raw) for item in items]


def _decoded(message: Any) -> Any:
    text = getattr(message, "data", None)
    if not isinstance(text, str) or not text.startswith("{"):
        return None
    try:
        return from_json(text, Any)
    except NO_JSON:
        return None


def _kind(values: Any) -> str:
    if isinstance(values, (bytes, bytearray)) or (isinstance(values, array.array) and values.itemsize == 1):
        return "bytes"
    return "numbers" if isinstance(values, (array.array, np.ndarray)) else "items"


QUIET_S = 1.0
SETTLE_TIMEOUT_S = 3.0

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
        return is_hidden(self.name)


def is_hidden(topic: str) -> bool:
    """Whether ``topic`` belongs to every ROS node, or has a name such as ``/_name``."""
    return topic in ("/parameter_events", "/rosout") or "/_" in topic


@contextmanager
def observer_node(name: str = "_topic") -> Iterator[Any]:
    """Open an rclpy node without parameter services, hidden by default. Raises InstallationError without ROS."""
    environment.require_ros()
    from socialbot.bridge.environment import ros_context
    from socialbot.bridge.wait_sets import FilteredNode

    with ros_context() as context:
        ros = FilteredNode(
            f"{name}_{os.getpid()}", context=context, enable_rosout=False, start_parameter_services=False
        )
        try:
            yield ros
        finally:
            ros.destroy_node()


def list_topics(ros: Any) -> tuple[TopicInfo, ...]:
    """List the topics discovered by ``ros`` by name, without its own endpoints."""
    seen = (
        TopicInfo(name, tuple(types), len(publishers_of(ros, name)), len(_subscribers(ros, name)))
        for name, types in discovery.topics(ros)
    )
    return tuple(sorted(topic for topic in seen if topic.publishers or topic.subscribers))


def settled_topics(ros: Any, ended: Ended = lambda: False) -> tuple[TopicInfo, ...]:
    """List the topics once they are stable for ``QUIET_S``, or after ``SETTLE_TIMEOUT_S``."""
    # An empty list may mean that discovery has not finished.
    return settled(lambda: list_topics(ros), bool, QUIET_S, SETTLE_TIMEOUT_S, ended)


def settled(
    get: Callable[[], T],
    is_complete: Callable[[T], bool],
    steady_s: float,
    timeout_s: float,
    ended: Ended = lambda: False,
    pause: Callable[[], None] = lambda: time.sleep(POLL_S),
) -> T:
    """Poll ``get``, with a ``pause`` between, until its value is complete and has not changed for ``steady_s``.

    Returns:
        The last value, also after ``timeout_s`` or when ``ended``.
    """
    begun = steady_since = time.monotonic()
    value = get()
    while time.monotonic() - begun < timeout_s and not ended():
        if is_complete(value) and time.monotonic() - steady_since >= steady_s:
            break
        pause()
        before, value = value, get()
        if value != before or not is_complete(value):
            steady_since = time.monotonic()
    return value


def await_publisher(ros: Any, name: str, *, timeout_s: float, ended: Ended = lambda: False) -> str | None:
    """Wait for a publisher of the topic ``name``; return its type, or None if ``ended`` came first.

    Raises:
        GraphError: There is no publisher within ``timeout_s``.
    """
    if publishers := wait_for(lambda: publishers_of(ros, name), timeout_s, ended):
        kinds = [each.topic_type for each in publishers]
        return next(filter(is_installed, kinds), kinds[0])
    if ended():
        return None
    raise _missing("publisher", name, [topic.name for topic in list_topics(ros) if topic.publishers])


def messages(
    ros: Any, name: str, *, timeout_s: float, raw: bool = False, ended: Ended = lambda: False
) -> Generator[Any | None, None, None]:
    """Yield the messages of the topic ``name`` until ``ended``; as bytes if ``raw``.

    Yields None at least every ``POLL_S`` seconds, for callers with a deadline.

    Raises:
        GraphError: There is no publisher within ``timeout_s``.
        InstallationError: The type of the topic is not installed.
    """
    type_name = await_publisher(ros, name, timeout_s=timeout_s, ended=ended)
    if type_name is None:
        return
    arrived: deque[Any] = deque()
    # rclpy does not accept a built-in function such as `arrived.append` as a callback.
    subscription = AdaptiveSubscription(
        ros, name, message_class(type_name), lambda message: arrived.append(message), raw=raw
    )
    yield from _arrivals(ros, [subscription], arrived, ended)


def _arrivals(
    ros: Any, subscriptions: Sequence[AdaptiveSubscription], arrived: deque[T], ended: Ended
) -> Generator[T | None, None, None]:
    """Spin ``ros``, and yield what its subscriptions put into ``arrived``, or None after ``POLL_S``."""
    with environment.executor_of(ros) as executor:
        while not ended():
            for each in subscriptions:
                each.adapt()
            executor.spin_once(timeout_sec=POLL_S)
            yield arrived.popleft() if arrived else None


def merged_messages(
    ros: Any, topics: Mapping[str, type[Message]], *, newest: Collection[str] = (), ended: Ended = lambda: False
) -> Generator[tuple[str, Message] | None]:
    """Yield topic and decoded message of all ``topics`` as they arrive, until ``ended``; invalid ones are logged.

    Yields None at least every ``POLL_S`` seconds. Of the ``newest`` topics, unread messages are dropped.
    """
    arrived: deque[tuple[str, Message]] = deque()
    transport = open_transport()
    subscriptions: list[AdaptiveSubscription] = []
    for name, kind in topics.items():
        ros_class = message_class(ros_type(kind))
        refuse = log_refusals(name)
        take = _decoding(kind, ros_class, lambda message, name=name: arrived.append((name, message)), refuse)
        depth = 1 if name in newest else DEPTH
        subscriptions += verified_subscriptions(ros, transport, name, ros_class, take, refuse, depth=depth)
    yield from _arrivals(ros, subscriptions, arrived, ended)


def _decoding(
    kind: type[Message], ros_class: Any, take: Callable[[Message], None], refuse: Callable[[MessageError], None]
) -> Callable[[bytes], None]:
    from rclpy.serialization import deserialize_message

    def take_bytes(cdr: bytes) -> None:
        try:
            message = decode(kind, deserialize_message(cdr, ros_class))
        except MessageError as error:
            refuse(error)
        else:
            take(message)

    return take_bytes


@dataclass(frozen=True)
class TopicRate:
    """Rate of a topic: mean rate, periods (s), bytes per second, and the number of measured messages."""

    hz: float
    min_s: float
    max_s: float
    deviation_s: float
    bytes_per_s: float
    messages: int


def topic_rate(received: Sequence[tuple[float, int]]) -> TopicRate | None:
    """Rate of messages received at times (s) with sizes (bytes); None with fewer than two."""
    times = [time_s for time_s, _ in received]
    if len(times) < 2 or times[-1] <= times[0]:
        return None
    periods, span = np.diff(times), times[-1] - times[0]
    return TopicRate(
        hz=len(periods) / span,
        min_s=float(periods.min()),
        max_s=float(periods.max()),
        deviation_s=float(periods.std()),
        bytes_per_s=sum(size for _, size in list(received)[1:]) / span,
        messages=len(times),
    )


def _subscribers(ros: Any, name: str) -> list[Any]:
    return [each for each in discovery.subscriptions(ros, name) if each.node_name != ros.get_name()]


def _missing(end: str, name: str, found: Collection[str]) -> GraphError:
    """Error for a topic without a publisher or subscriber; ``found`` are the topics that have one."""
    visible = [topic for topic in found if not is_hidden(topic)]
    others = "" if visible else ", nor of any other topic"
    start = "start a graph; if one runs, use its ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE"
    remedy = suggestion(name, visible) if visible else start
    return GraphError(f"no {end} of {name}{others}", where=f"domain {ros_domain()}", remedy=remedy)


STEADY_S = 0.5  # time for which all discovered subscribers must be connected; discovery may still be running
CONNECT_TIMEOUT_S = 3.0  # timeout of connections to subscribers: a killed process stays discovered for a while
ACKNOWLEDGE_TIMEOUT_S = 5.0


def parse_message(schema: str, text: str, *, stamp: int) -> Structured | RosMessage:
    """Parse a message from YAML or JSON. ``stamp`` (ns) is the default stamp.

    Args:
        schema: Message of an agent package, such as DesireItem; ``module:Class`` of another `Structured` class; or
            ROS type, such as std_msgs/msg/Float32.
        text: Fields with their values.
        stamp: Stamp of a message that states none, ns.

    Raises:
        MessageError: The schema is unknown or cannot be loaded, or the text does not fit it.
        GraphError: The schema is no valid name of a ROS type.
        InstallationError: The package of the ROS type is not installed.
    """
    kinds = {kind.__name__: kind for kind in message_types()}
    if ":" in schema:
        kinds[schema] = _own_message(schema)
    elif schema not in kinds and "/" not in schema:
        remedy = (
            f"{suggestion(schema, kinds)}; or module:Class for a message of your own; "
            "or a ROS type, such as std_msgs/msg/Float32"
        )
        raise MessageError(f"there is no schema {schema!r}", remedy=remedy)
    try:
        fields = load_yaml(YAML(typ="safe", pure=True), text)
    except YAMLError as error:
        raise MessageError(f"not valid YAML: {error}", where=schema) from error
    if not isinstance(fields, dict):
        raise MessageError(f"expected names with values, got {text!r}", where=schema)
    if schema not in kinds:
        return _ros_message(ros_message(schema), fields, stamp)
    kind = kinds[schema]
    known = {field.encode_name for field in msgspec.structs.fields(kind)}
    for name in fields:
        if name not in known:
            raise MessageError(f"no field {name!r}", where=schema, remedy=suggestion(str(name), known))
    try:
        message = from_builtins({"stamp": stamp, **fields, "schema": kind.__struct_config__.tag}, kind)
        msgspec.json.encode(message)  # the text may hold lone surrogates
    except (msgspec.ValidationError, UnicodeError) as error:
        remedy = f"see the class {kind.__name__}" if ":" in schema else f"see docs/schemas/{schema}.json"
        raise MessageError(str(error), where=schema, remedy=remedy) from error
    for place, number in _not_finite(fields):
        remedy = "give a number that JSON can hold, or leave an optional field out"
        raise MessageError(f"{place} is {number}, and no finite number", where=schema, remedy=remedy)
    return message


def _not_finite(value: Any, place: str = "") -> Iterator[tuple[str, float]]:
    """Yield infinite numbers and NaN in values of YAML, with their places: ``persons[0].x``."""
    if isinstance(value, float) and not math.isfinite(value):
        yield place, value
    elif isinstance(value, dict):
        for key, each in value.items():
            yield from _not_finite(each, f"{place}.{key}".removeprefix("."))
    elif isinstance(value, list):
        for index, each in enumerate(value):
            yield from _not_finite(each, f"{place}[{index}]")


def _own_message(reference: str) -> type[Structured]:
    found = load_reference(reference, "message", _is_message, error=MessageError)
    if not _is_message(found):
        raise MessageError(f"{reference!r} is no message", remedy="give a subclass of socialbot.Structured")
    return found


def _is_message(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, Structured)


def _ros_message(kind: type[RosMessage], fields: dict[Any, Any], stamp: int) -> RosMessage:
    ros = message_class(kind.ros_type)()
    fill_message(ros, fields, kind.ros_type)
    header = getattr(ros, "header", None)
    if header is not None and not (header.stamp.sec or header.stamp.nanosec):
        header.stamp.sec, header.stamp.nanosec = divmod(stamp, SECOND)
    return kind.of(ros, stamp)


def publish_once(
    ros: Any, name: str, message: Structured | RosMessage, *, timeout_s: float, ended: Ended = lambda: False
) -> None:
    """Publish ``message`` once in the form of the subscribers of the topic ``name``, and wait for its arrival.

    Raises:
        GraphError: There is no subscriber within ``timeout_s``, or it uses another type.
        NodeError: The message was not acknowledged.
        SecurityError: The keys are invalid.
    """
    from rclpy.duration import Duration

    kind = type(message)
    form: WireForm | None = wait_for(lambda: _subscribed_form(ros, name, kind), timeout_s, ended)
    if form is None and ended():
        return
    if form is None:
        raise _no_subscriber(ros, name, ros_type(kind))
    sender = open_transport(form=form).advertise(ros, name, kind)
    publisher = sender.publisher

    def is_complete(connected: int) -> bool:
        known = [each for each in discovery.subscriptions(ros, name) if each.topic_type == ros_type(kind, form)]
        return connected >= len(known)

    if not settled(publisher.get_subscription_count, is_complete, STEADY_S, CONNECT_TIMEOUT_S, ended):
        raise _no_subscriber(ros, name, ros_type(kind))
    sender.publish(message)
    if not publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_TIMEOUT_S)):
        raise NodeError(f"the message was not acknowledged after {ACKNOWLEDGE_TIMEOUT_S:.0f} s", where=name)


def _subscribed_form(ros: Any, name: str, kind: type[Message]) -> WireForm | None:
    taken = {each.topic_type for each in discovery.subscriptions(ros, name)}
    return next((form for form in get_args(WireForm) if ros_type(kind, form) in taken), None)


def _no_subscriber(ros: Any, name: str, type_name: str) -> GraphError:
    topics = {topic.name: topic for topic in list_topics(ros) if topic.subscribers}
    if name in topics:
        return GraphError(
            f"the type of {name} is {', '.join(topics[name].types)}, not {type_name}", where=f"domain {ros_domain()}"
        )
    return _missing("subscriber", name, topics)
