"""Checks of ``socialbot doctor``: whether topics, services and actions outside a graph are there, with their types."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, Protocol

from socialbot.bridge.ros_checks import Finding
from socialbot.bridge.transport import message_class
from socialbot.core.errors import InstallationError
from socialbot.core.installation import interfaces_command

DISCOVERY_S = 5.0
"""Time for the nodes of a robot to be discovered, and for a message."""

POLL_S = 0.05


class Requirement(Protocol):
    """Topic, service or action that a robot must have, such as those that `socialbot.robots.requirements` lists."""

    @property
    def part(self) -> str: ...

    @property
    def kind(self) -> str: ...

    @property
    def name(self) -> str: ...

    @property
    def type(self) -> str: ...

    @property
    def needed(self) -> bool: ...

    @property
    def joints(self) -> tuple[str, ...]: ...


def check_topics(
    needed: Sequence[Requirement], hint: str, timeout_s: float = DISCOVERY_S, *, source: str = "profile"
) -> Iterator[Finding]:
    """Look for the topics, services and actions of a robot, and yield a finding for each.

    Args:
        needed: What the robot must have.
        hint: How to start its drivers, for remedies.
        timeout_s: Time to wait for all of them.
        source: Where the names come from, for remedies.
    """
    from socialbot.bridge.environment import spinning_node

    with spinning_node("robot_check") as ros:
        heard: dict[Requirement, list[Any]] = {}
        for each in needed:
            if each.kind == "publisher":
                _listen(ros, each, heard.setdefault(each, []))
        end = time.monotonic() + timeout_s
        while time.monotonic() < end and not all(_is_there(ros, each, heard) for each in needed):
            time.sleep(POLL_S)
        start = f"start the drivers of the robot ({hint})" if hint else "start the drivers of the robot"
        for each in needed:
            finding = _finding(ros, each, heard.get(each, []), f"{start}; or correct the name in the {source}", source)
            if finding.text.startswith(tuple(_WHAT.values())):
                start = "as above"
            yield finding


def _listen(ros: Any, each: Requirement, heard: list[Any]) -> None:
    from rclpy.qos import qos_profile_sensor_data

    try:
        kind = message_class(each.type)
    except InstallationError:
        return
    ros.create_subscription(kind, each.name, lambda message: heard.append(message) if not heard else None,
                            qos_profile_sensor_data)  # fmt: skip


def _endpoints(ros: Any, each: Requirement) -> list[Any]:
    """The publishers or subscribers of the robot; those of the status topic of an action; the servers of a service."""
    if each.kind == "service":
        return _servers(ros, each.name)
    if each.kind == "subscriber":
        return ros.get_subscriptions_info_by_topic(each.name)
    name = f"{each.name}/_action/status" if each.kind == "action" else each.name
    return ros.get_publishers_info_by_topic(name)


def _servers(ros: Any, service: str) -> list[_Server]:
    found = []
    for name, namespace in ros.get_node_names_and_namespaces():
        with contextlib.suppress(RuntimeError):  # the node has ended meanwhile
            offered = dict(ros.get_service_names_and_types_by_node(name, namespace)).get(service, ())
            found += [_Server(name, namespace, kind) for kind in offered]
    return found


class _Server(NamedTuple):
    node_name: str
    node_namespace: str
    topic_type: str


def _is_there(ros: Any, each: Requirement, heard: dict[Requirement, list[Any]]) -> bool:
    if not _endpoints(ros, each):
        return False
    return each.kind != "publisher" or bool(heard[each]) or _wrong_type(ros, each) != "" or not _is_installed(each)


def _is_installed(each: Requirement) -> bool:
    try:
        message_class(each.type)
    except InstallationError:
        return False
    return True


def _wrong_type(ros: Any, each: Requirement) -> str:
    """The other type under the name of a topic; empty if the type is right. Actions are not compared."""
    if each.kind == "action":
        return ""
    kinds = {endpoint.topic_type for endpoint in _endpoints(ros, each)}
    return "" if each.type in kinds or not kinds else ", ".join(sorted(kinds))


_WHAT = {
    "publisher": "nobody publishes",
    "subscriber": "nobody subscribes to",
    "action": "no action server",
    "service": "nobody offers",
}


def _finding(ros: Any, each: Requirement, heard: Sequence[Any], remedy: str, source: str) -> Finding:
    bad = "error" if each.needed else "warning"
    if not _is_installed(each):
        package = each.type.partition("/")[0]
        own = f"{interfaces_command('robot_interfaces')}, or source a ROS installation that has {package}"
        return Finding(each.part, "error", f"{each.name}: the package {package} is not installed", own)
    endpoints = _endpoints(ros, each)
    if not endpoints:
        return Finding(each.part, bad, f"{_WHAT[each.kind]} {each.name}", remedy)
    if other := _wrong_type(ros, each):
        return Finding(
            each.part, "error", f"{each.name} is {other}, not {each.type}", f"name the right one in the {source}"
        )
    node = f"{endpoints[0].node_namespace.rstrip('/')}/{endpoints[0].node_name}"
    if each.kind != "publisher":
        return Finding(each.part, "ok", f"{each.name}, by {node}")
    if not heard:
        asleep = f"look at {node}: is the robot awake, and the sensor on?"
        return Finding(each.part, bad, f"{each.name}: {node} publishes nothing", asleep)
    return _content(each, heard[0], f"{each.name}, by {node}", bad)


def _content(each: Requirement, message: Any, text: str, bad: Any) -> Finding:
    """Check the joints of joint states, and tell the size of images."""
    missing = [joint for joint in each.joints if joint not in message.name] if each.joints else []
    if missing:
        remedy = f"correct the names in the profile; there are {', '.join(message.name)}"
        return Finding(each.part, bad, f"{each.name} has no joint {', '.join(missing)}", remedy)
    if hasattr(message, "encoding"):
        text += f": {message.width}x{message.height} {message.encoding}"
    return Finding(each.part, "ok", text)
