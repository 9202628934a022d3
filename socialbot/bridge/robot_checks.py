"""Checks of ``socialbot doctor``: whether topics, services and actions outside a graph are there, with their types."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from typing import Any, NamedTuple, Protocol

from socialbot.bags.codec import decode
from socialbot.bags.typed import header_stamp
from socialbot.bridge.discovery import publishers, readable, subscriptions, topics
from socialbot.bridge.qos import observer_qos
from socialbot.bridge.ros_checks import Finding
from socialbot.bridge.transport import is_installed, message_class
from socialbot.core.clock import SECOND
from socialbot.core.errors import SocialbotError
from socialbot.core.installation import interfaces_command
from socialbot.core.messages import CameraInfo, CompressedImage, Image, Message, Transforms
from socialbot.vision.camera import CameraModel, CameraPose, is_calibrated
from socialbot.vision.camera_pose import pose_from_transforms, unusable_placement
from socialbot.vision.images import bgr_from_compressed, bgr_from_image
from socialbot.vision.transforms import TransformTree

DISCOVERY_S = 5.0
"""Time for the nodes of a robot to be discovered, and for a message."""

POLL_S = 0.05

CLOCKS_S = 2.0
"""Age of an image at its arrival from which its stamp is of another clock."""

_MOST_TRANSFORMS = 300
"""Messages of transforms that are kept for the pose of a camera."""

_STREAMS = (Image, CompressedImage)
"""Messages that come one after the other, each with a stamp of its own."""

_NEWEST = 2**63
"""Stamp after those of all transforms."""


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

    @property
    def message(self) -> type[Message] | None: ...

    @property
    def places(self) -> str: ...


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
        ages_s: dict[Requirement, float] = {}
        for each in needed:
            if each.kind == "publisher":
                _listen(ros, each, heard.setdefault(each, []), ages_s)
        end = time.monotonic() + timeout_s
        while time.monotonic() < end and not all(_is_there(ros, each, heard) for each in needed):
            time.sleep(POLL_S)
        start = f"start the drivers of the robot ({hint})" if hint else "start the drivers of the robot"
        for each in needed:
            finding = _finding(ros, each, heard, f"{start}; or correct the name in the {source}", source)
            if finding.state == "ok" and abs(age_s := ages_s.get(each, 0.0)) > CLOCKS_S:
                finding = _other_clock(finding, each, age_s)
            if finding.text.startswith(tuple(_WHAT.values())):
                start = "as above"
            yield finding


def _other_clock(finding: Finding, each: Requirement, age_s: float) -> Finding:
    lag = f"{abs(age_s):.1f} s {'behind' if age_s > 0 else 'ahead of'} the clock of this computer"
    remedy = (
        "set the clocks of both computers by NTP; a simulated robot must take the time of day (use_sim_time: false)"
    )
    return Finding(finding.name, "warning", f"{each.name}: its stamps are {lag}", remedy)


def _listen(ros: Any, each: Requirement, heard: list[Any], ages_s: dict[Requirement, float]) -> None:
    from rclpy.qos import qos_profile_sensor_data

    if not is_installed(each.type):
        return

    def keep(message: Any) -> None:
        if each.message in _STREAMS:
            age_s = (time.time_ns() - (header_stamp(message) or 0)) / SECOND
            ages_s[each] = min(ages_s.get(each, age_s), age_s, key=abs)
        if len(heard) < (_MOST_TRANSFORMS if each.places else _expected(each)):
            heard.append(message)

    ros.create_subscription(
        message_class(each.type),
        each.name,
        keep,
        observer_qos(latched=True) if each.places else qos_profile_sensor_data,
    )
    if each.places:
        moving = each.name.removesuffix("_static")
        ros.create_subscription(message_class(each.type), moving, keep, qos_profile_sensor_data)


def _expected(each: Requirement) -> int:
    """How many messages of a topic are needed for its check."""
    return 2 if each.message in _STREAMS else 1


def _endpoints(ros: Any, each: Requirement) -> list[Any]:
    """The publishers or subscribers of the robot; those of the status topic of an action; the servers of a service."""
    if each.kind == "service":
        return _servers(ros, each.name)
    if each.kind == "subscriber":
        return subscriptions(ros, each.name)
    name = f"{each.name}/_action/status" if each.kind == "action" else each.name
    return publishers(ros, name)


def _servers(ros: Any, service: str) -> list[_Server]:
    found = []
    for name, namespace in readable(ros.get_node_names_and_namespaces) or ():
        with contextlib.suppress(UnicodeDecodeError, RuntimeError):  # the node has ended meanwhile
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
    if each.kind != "publisher" or _wrong_type(ros, each) or not is_installed(each.type):
        return True
    if each.places:
        return isinstance(camera_placement(each.places, _images_of(each, heard), heard[each]), CameraPose)
    return len(heard[each]) >= _expected(each)


def _wrong_type(ros: Any, each: Requirement) -> str:
    """The other type under the name of a topic; empty if the type is right. Actions are not compared."""
    if each.kind == "action":
        return ""
    kinds = {endpoint.topic_type for endpoint in _endpoints(ros, each)}
    return "" if each.type in kinds or not kinds else ", ".join(sorted(kinds))


def _others(ros: Any, each: Requirement) -> str:
    """Return which names have the type of a missing one, the most similar first."""
    if each.kind == "service":
        found = [name for name, kinds in readable(ros.get_service_names_and_types) or () if each.type in kinds]
    else:
        end, kind = ("/_action/feedback", f"{each.type}_FeedbackMessage") if each.kind == "action" else ("", each.type)
        look_up = subscriptions if each.kind == "subscriber" else publishers
        found = [
            name.removesuffix(end)
            for name, kinds in topics(ros)
            if name.endswith(end) and kind in kinds and any(kind == each.topic_type for each in look_up(ros, name))
        ]
    alike = sorted(found, key=lambda name: (-SequenceMatcher(None, name, each.name).ratio(), name))[:_MOST_OTHERS]
    return f"; of this type there is {', '.join(alike)}" if alike else ""


_MOST_OTHERS = 3
"""Names of a type that a remedy tells."""

_WHAT = {
    "publisher": "nobody publishes",
    "subscriber": "nobody subscribes to",
    "action": "no action server",
    "service": "nobody offers",
}


def _finding(
    ros: Any, each: Requirement, heard: Mapping[Requirement, Sequence[Any]], remedy: str, source: str
) -> Finding:
    bad = "error" if each.needed else "warning"
    if not is_installed(each.type):
        package = each.type.partition("/")[0]
        own = f"{interfaces_command('robot_interfaces')}, or source a ROS installation that has {package}"
        state = "warning" if each.places else "error"
        return Finding(each.part, state, f"{each.name}: the package {package} is not installed", own)
    endpoints = _endpoints(ros, each)
    if not endpoints:
        return Finding(each.part, bad, f"{_WHAT[each.kind]} {each.name}", remedy + _others(ros, each))
    if other := _wrong_type(ros, each):
        right = f"name the right one in the {source}"
        return Finding(each.part, "error", f"{each.name} is {other}, not {each.type}", right + _others(ros, each))
    node = f"{endpoints[0].node_namespace.rstrip('/')}/{endpoints[0].node_name}"
    if each.kind != "publisher":
        return Finding(each.part, "ok", f"{each.name}, by {node}")
    if not heard[each]:
        asleep = f"look at {node}: is the robot awake, and the sensor on?"
        return Finding(each.part, bad, f"{each.name}: {node} publishes nothing", asleep)
    text, first = f"{each.name}, by {node}", heard[each][0]
    if each.places:
        placed = camera_placement(each.places, _images_of(each, heard), heard[each])
        text, problem = f"{text}: camera {placed}", placed if isinstance(placed, tuple) else None
    else:
        problem = _joints_problem(each, first) if each.joints else _content_problem(each, first)
        if problem is None and each.message in _STREAMS:
            problem = _stream_problem(heard[each])
    if problem is not None:
        return Finding(each.part, bad, f"{each.name} {problem[0]}", problem[1])
    if hasattr(first, "encoding"):
        text += f": {first.width}x{first.height} {first.encoding}"
    return Finding(each.part, "ok", text)


Problem = tuple[str, str]
"""What is wrong with the messages on a topic, and the remedy."""


def _joints_problem(each: Requirement, message: Any) -> Problem | None:
    """Find a joint without a position."""
    missing = [joint for joint in each.joints if joint not in message.name]
    if missing:
        remedy = f"correct the names in the profile; there are {', '.join(message.name)}"
        return f"has no joint {', '.join(missing)}", remedy
    positions = dict(zip(message.name, message.position, strict=False))
    unknown = [joint for joint in each.joints if not math.isfinite(positions.get(joint, math.nan))]
    return (f"has no position of {', '.join(unknown)}", "check the encoders and their driver") if unknown else None


def _content_problem(each: Requirement, message: Any) -> Problem | None:
    """Find out whether a graph cannot use the content of a message."""
    try:
        read = None if each.message is None else decode(each.message, message)
        if type(read) is Image:
            bgr_from_image(read)
        elif type(read) is CompressedImage:
            bgr_from_compressed(read)
        elif type(read) is CameraInfo:
            if not is_calibrated(read):
                return (
                    "is not calibrated: k is 0",
                    "calibrate the camera, or give its hfov_rad in the profile or to the person detector",
                )
            CameraModel.from_info(read)
    except SocialbotError as error:
        return f"cannot be used: {error.what}", error.remedy or "check the driver"
    return None


def _stream_problem(messages: Sequence[Any]) -> Problem | None:
    """Find out whether messages are no stream: it has stamps, which differ."""
    if len(messages) < 2:
        return "comes once only", "check the frame rate of the driver: a graph needs a stream of images"
    first, second = ((message.header.stamp.sec, message.header.stamp.nanosec) for message in messages[:2])
    remedy = "set header.stamp in the driver to the time of each exposure"
    if first == (0, 0):
        return "has no time: header.stamp is 0", remedy
    return (f"has the same time twice: header.stamp is {first[0]}.{first[1]:09}", remedy) if first == second else None


def camera_placement(topic: str, images: Sequence[Any], transforms: Sequence[Any]) -> CameraPose | Problem:
    """Return the pose of a camera by transforms, or why they do not place it.

    Args:
        topic: Topic of its images.
        images: ROS messages on ``topic``; the first one counts.
        transforms: ROS messages on /tf and /tf_static.
    """
    if not images:
        return f"places no camera: nothing is published on {topic}", "as above"
    remedy = "publish the robot's URDF with robot_state_publisher; or set height_m and pitch_rad in the profile"
    if not (frame := images[0].header.frame_id):
        return f"places no camera: {topic} has no frame_id", f"set it in the driver; {remedy}"
    tree = TransformTree()
    for message in transforms:
        tree.add(decode(Transforms, message).transforms)
    pose = pose_from_transforms(tree, frame, _NEWEST)
    if pose is None and (unusable := unusable_placement(tree, frame, _NEWEST)) is not None:
        return f"places {unusable[0]}", unusable[1]
    if pose is None:
        return f"does not place the camera {frame!r} above the floor", f"correct the frame_id of {topic}; {remedy}"
    return pose


def _images_of(each: Requirement, heard: Mapping[Requirement, Sequence[Any]]) -> Sequence[Any]:
    return next((messages for other, messages in heard.items() if other.name == each.places), ())
