"""What a robot must answer for its profile or a graph to work: topics, services, actions, types, daemon and camera."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from socialbot.bags.codec import ros_type
from socialbot.core.errors import DeviceError, SocialbotError
from socialbot.core.messages import CameraInfo, CompressedImage, Image, Message, PersonDetections, Transforms
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.robots.binding import NODE_TYPES, PART_BASES, part_class
from socialbot.robots.daemon_client import DaemonClient
from socialbot.robots.profile import NAMES, CameraProfile, HeadProfile, Part, RobotProfile
from socialbot.vision.camera_node import is_device

Kind = Literal["publisher", "subscriber", "service", "action"]
"""What a robot has under a name: it publishes a topic, subscribes to one, or offers a service or an action."""


@dataclass(frozen=True)
class Requirement:
    """Topic, service or action that a part of the robot needs.

    Attributes:
        part: Part of the robot, such as "head".
        kind: What the robot does with the name.
        name: Full name.
        type: Its ROS type.
        needed: Whether the part does not work without it.
        joints: Joints that messages of joint states must have.
        message: Class as which the graph reads the messages of a topic.
        places: Topic of the images whose camera the transforms on this topic must place.
    """

    part: str
    kind: Kind
    name: str
    type: str
    needed: bool = True
    joints: tuple[str, ...] = ()
    message: type[Message] | None = None
    places: str = ""


def requirements(profile: RobotProfile) -> Iterator[Requirement]:
    """Yield the topics and actions that a profile needs, part by part.

    Raises:
        GraphError: A node class of one's own cannot be loaded, or does not fit its part.
    """
    namespace, profile = profile.namespace, profile.resolved
    if profile.camera is not None:
        yield from _camera(profile.camera, namespace)
    if profile.head is not None:
        yield from _head(profile.head, namespace)
    for name, part in (("speech", profile.speech), ("people", profile.people), ("base", profile.base)):
        if part is not None:
            yield from _part(name, part, namespace)
    for name, base in PART_BASES.items():
        part: Part | CameraProfile | None = getattr(profile, name)
        if part is not None and part.type and part.type not in {*NAMES.get(name, ()), *NODE_TYPES[base]}:
            remap = part.names if isinstance(part, Part) else {}
            yield from _own_node(NodeConfig(name, part_class(part, base, profile), remap=remap), base)


def _own_node(config: NodeConfig, base: type[Node]) -> Iterator[Requirement]:
    """Yield what a node of one's own uses beyond the ports of its base class; people are for the agent."""
    known = {**base.inputs(), **base.outputs(), **base.clients()}
    for topic, port in config.subscriptions:
        if port.name not in known:
            yield Requirement(config.name, "publisher", topic, ros_type(port.message_type), needed=False)
    for topic, port in config.publications:
        if port.name not in known and port.message_type is not PersonDetections:
            yield Requirement(config.name, "subscriber", topic, ros_type(port.message_type), needed=False)
    for topic, port in config.clients:
        if port.name not in known:
            kind = "action" if port.interface.is_action else "service"
            yield Requirement(config.name, kind, topic, port.interface.name, needed=not port.optional)


def graph_requirements(graph: Graph) -> Iterator[Requirement]:
    """Yield the topics, services and actions of nodes outside a graph, by the node that uses them.

    A topic is not needed at once, as drivers may publish rarely.
    """
    for config in graph.nodes:
        for topic, port in config.subscriptions:
            if topic in graph.inputs:
                kind = ros_type(port.message_type, graph.wire)
                yield Requirement(config.name, "publisher", topic, kind, needed=False, message=port.message_type)
        for topic, port in config.clients:
            if topic in graph.services:
                kind = "action" if port.interface.is_action else "service"
                yield Requirement(config.name, kind, topic, port.interface.name, needed=not port.optional)


def _camera(camera: CameraProfile, namespace: str) -> Iterator[Requirement]:
    topics: tuple[tuple[str, type[Message], bool], ...] = (
        (camera.image, Image, not camera.compressed),
        (camera.compressed, CompressedImage, not camera.image),
        (camera.info, CameraInfo, False),
    )
    for topic, kind, needed in topics:
        if topic:
            yield Requirement("camera", "publisher", topic, ros_type(kind), needed, message=kind)
    if (images := camera.image or camera.compressed) and not camera.height_m:
        yield Requirement(
            "camera", "publisher", f"{namespace}/tf_static", ros_type(Transforms), needed=False, places=images
        )


def _head(head: HeadProfile, namespace: str) -> Iterator[Requirement]:
    if "action" in head.names:
        yield Requirement("head", "action", head.names["action"], "control_msgs/action/FollowJointTrajectory")
    elif "trajectory" in head.names:
        yield Requirement("head", "subscriber", head.names["trajectory"], "trajectory_msgs/msg/JointTrajectory")
    elif "angles" in head.names:
        yield Requirement("head", "subscriber", head.names["angles"], "naoqi_bridge_msgs/msg/JointAnglesWithSpeed")
    else:
        return
    joints = tuple(filter(None, (head.pan.joint, head.tilt.joint)))
    states = head.names.get("joint_states", f"{namespace}/joint_states")
    yield Requirement("head", "publisher", states, "sensor_msgs/msg/JointState", False, joints)


_TYPES: dict[str, tuple[Kind, str, str]] = {
    "tts": ("action", "action", "tts_msgs/action/TTS"),
    "say_skill": ("action", "action", "communication_skills/action/Say"),
    "topic": ("subscriber", "topic", "std_msgs/msg/String"),
    "ros4hri": ("publisher", "bodies", "hri_msgs/msg/IdsList"),
    "nav2": ("action", "action", "nav2_msgs/action/NavigateToPose"),
}
"""Kind, key of the name and ROS type by type of a part."""


def _part(name: str, part: Part, namespace: str) -> Iterator[Requirement]:
    if part.type in _TYPES:
        kind, key, ros_type = _TYPES[part.type]
        yield Requirement(name, kind, part.names[key], ros_type)
    if part.type in ("ros4hri", "nav2"):
        yield Requirement(name, "publisher", f"{namespace}/tf", "tf2_msgs/msg/TFMessage")


@dataclass(frozen=True)
class Answer:
    """Answer of the robot to one check: ``problem`` is empty if all is well."""

    part: str
    text: str
    problem: str = ""
    remedy: str = ""


def daemon_answers(profile: RobotProfile) -> Iterator[Answer]:
    """Ask the daemon of a robot, if the profile names one, for its state, motors, pose and media."""
    if not profile.url:
        return
    client = DaemonClient(profile.url)
    try:
        status = client.status()
    except SocialbotError as error:
        yield Answer("daemon", profile.url, error.what, _start(profile, error))
        return
    state, version = status.get("state"), status.get("version")
    kind = "a simulation" if status.get("mockup_sim_enabled") or status.get("simulation_enabled") else "a robot"
    text = f"{profile.url}: version {version}, {kind}"
    if state != "running":
        yield Answer(
            "daemon", text, f"{text}; it is {state}: {status.get('error') or 'no reason'}", "wake up the robot"
        )
        return
    yield Answer("daemon", text)
    yield from _motors(client)
    yield _media(client, profile)


def _motors(client: DaemonClient) -> Iterator[Answer]:
    try:
        mode, state = client.motor_mode(), client.full_state()
        head: Any = state["head_pose"]
        text = f"motors {mode}; yaw {head['yaw']:.2f}, pitch {0.0 - head['pitch']:.2f} rad"
    except (DeviceError, KeyError, TypeError, ValueError) as error:
        yield Answer("head", "", f"the daemon tells no pose: {error}", "update reachy-mini")
        return
    yield Answer("head", text, "" if mode == "enabled" else text, "wake up the robot: its motors are off")


def _media(client: DaemonClient, profile: RobotProfile) -> Answer:
    camera = profile.camera
    try:
        available = client.media_available()
    except DeviceError as error:
        return Answer("speech", "", error.what, error.remedy or "")
    if available and camera is not None and is_device(camera.device):
        return Answer("speech", "on this computer, while its camera is open here")
    return Answer("speech", "on the robot" if available else "on this computer: the daemon has no sound")


def _start(profile: RobotProfile, error: SocialbotError) -> str:
    return f"start it: {profile.hint}" if profile.hint else error.remedy or ""
