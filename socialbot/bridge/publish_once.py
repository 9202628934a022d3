"""Single messages from outside into a running graph."""

from __future__ import annotations

import os
import time
from typing import Any, get_args

import msgspec
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from socialbot.agents.registry import STRUCTURED
from socialbot.bags.codec import ros_type
from socialbot.bridge.qos import publisher_qos
from socialbot.bridge.topics import Ended, topics_now
from socialbot.bridge.transport import wire
from socialbot.core.errors import GraphError, MessageError, NodeError
from socialbot.core.messages import Structured
from socialbot.core.yaml import load_yaml
from socialbot.graph.node import Delivery, WireForm, suggestion

LOOK_AGAIN_S = 0.05
STEADY_S = 0.5
"""So long all who are known to listen have to be connected: others may be known only a moment later."""
ALL_CONNECTED_S = 3.0
"""After so long it is sent to those who are connected: what has been killed stays known for a while."""
ACKNOWLEDGED_S = 5.0


def message_from(schema: str, text: str, *, stamp: int) -> Structured:
    """The message of a ``schema``, such as DesireItem, whose fields the YAML or JSON ``text`` gives.

    ``stamp`` (ns) is used where it gives none. Raises MessageError when there is no such schema, or the text does not
    fit it.
    """
    kinds = {kind.__name__: kind for kind in STRUCTURED}
    if schema not in kinds:
        raise MessageError(f"there is no schema {schema!r}", remedy=suggestion(schema, kinds))
    try:
        fields = load_yaml(YAML(typ="safe", pure=True), text)
    except YAMLError as error:
        raise MessageError(f"no valid YAML: {error}", where=schema) from error
    if not isinstance(fields, dict):
        raise MessageError(f"expected names with values, got {text!r}", where=schema)
    kind = kinds[schema]
    known = {field.encode_name for field in msgspec.structs.fields(kind)}
    for name in fields:
        if name not in known:
            raise MessageError(f"no field {name!r}", where=schema, remedy=suggestion(str(name), known))
    try:
        message = msgspec.convert({"stamp": stamp, **fields, "schema": kind.__struct_config__.tag}, kind)
        msgspec.json.encode(message)  # texts may hold what UTF-8 has no bytes for
    except (msgspec.ValidationError, UnicodeError) as error:
        raise MessageError(str(error), where=schema, remedy=f"see docs/schemas/{schema}.json") from error
    return message


def send(ros: Any, name: str, message: Structured, *, timeout_s: float, ended: Ended = lambda: False) -> None:
    """Sends ``message`` on the topic ``name`` to all who listen, in the form they want, and waits until it has arrived.

    Raises GraphError when nobody listens to the topic within ``timeout_s``, or takes another type, NodeError when it
    does not arrive, SecurityError when the keys cannot be used.
    """
    from rclpy.duration import Duration

    kind = type(message)
    deadline = time.monotonic() + timeout_s
    while (form := _form_wanted(ros, name, kind)) is None:
        if ended():
            return
        if time.monotonic() >= deadline:
            raise _not_wanted(ros, name, ros_type(kind))
        time.sleep(LOOK_AGAIN_S)
    own = wire(form=form)
    publisher = ros.create_publisher(own.message_class(kind), name, publisher_qos(Delivery.EVERY))
    outlet = own.outlet(publisher)
    _await_all(ros, publisher, name, ros_type(kind, form), ended)
    if not publisher.get_subscription_count():
        raise _not_wanted(ros, name, ros_type(kind))
    outlet.publish(message)
    if not publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGED_S)):
        raise NodeError(f"it has not arrived after {ACKNOWLEDGED_S:.0f} s", where=name)


def _form_wanted(ros: Any, name: str, kind: type[Structured]) -> WireForm | None:
    """In which form those who listen take messages of this ``kind``; None while nobody takes them."""
    taken = {each.topic_type for each in ros.get_subscriptions_info_by_topic(name)}
    return next((form for form in get_args(WireForm) if ros_type(kind, form) in taken), None)


def _await_all(ros: Any, publisher: Any, name: str, type_name: str, ended: Ended) -> None:
    """Waits until ``publisher`` is connected to all who are known to listen, and has been for a moment."""
    begun = steady_since = time.monotonic()
    connected = publisher.get_subscription_count()
    while time.monotonic() - begun < ALL_CONNECTED_S and not ended():
        before, connected = connected, publisher.get_subscription_count()
        known = sum(each.topic_type == type_name for each in ros.get_subscriptions_info_by_topic(name))
        if connected != before or connected < known:
            steady_since = time.monotonic()
        if time.monotonic() - steady_since >= STEADY_S:
            return
        time.sleep(LOOK_AGAIN_S)


def _not_wanted(ros: Any, name: str, type_name: str) -> GraphError:
    topics = [topic for topic in topics_now(ros) if topic.subscribers and not topic.hidden]
    other = next((", ".join(topic.types) for topic in topics if topic.name == name), "")
    where = f"domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
    if other:
        return GraphError(f"{name} is for {other}, not {type_name}", where=where)
    return GraphError(
        f"nobody listens to {name}", where=where, remedy=suggestion(name, [topic.name for topic in topics])
    )
