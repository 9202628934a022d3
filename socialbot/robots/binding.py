"""Connect a graph with a robot: its camera, head, base, speech and people replace those of this computer."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from socialbot.agents.waldo.head import Head
from socialbot.bags.cameras import is_rectified
from socialbot.core.errors import GraphError
from socialbot.core.messages import HeadCommand, PersonDetections, Utterance
from socialbot.core.yaml import YamlSection
from socialbot.graph.files import node_type
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input
from socialbot.robots.head import NO_PAN, NO_TILT, TARGET, RobotHead
from socialbot.robots.profile import (
    STANDARD_TOPICS,
    USUAL_HFOV_RAD,
    CameraProfile,
    HeadProfile,
    Part,
    RobotProfile,
    load_profile,
    read_profile,
)
from socialbot.speech.speaker import Speaker
from socialbot.vision.camera_node import Camera
from socialbot.vision.images import ImageConverter
from socialbot.vision.person_detector import PersonDetector

HEAD_NODE = "robot_head"
"""Name of the node that moves the head of a robot."""

NODE_TYPES: Mapping[type[Node], Mapping[str, str]] = {
    Camera: {"reachy_mini": "reachy_camera"},
    RobotHead: {"ros2_control": "robot_head_topic", "naoqi": "naoqi_head", "reachy_mini": "reachy_head"},
    Speaker: {
        "tts": "tts_speaker",
        "say_skill": "say_skill_speaker",
        "topic": "topic_speaker",
        "reachy_mini": "reachy_speaker",
    },
    Node: {"ros4hri": "robot_people"},
}
"""Node types by base class and type of a part."""


PART_BASES: Mapping[str, type[Node]] = {"camera": Camera, "head": RobotHead, "speech": Speaker, "people": Node}
"""Base classes of the nodes of parts."""


def bind(graph: Graph, robot: str | YamlSection, *, where: str, folder: Path | None = None) -> Graph:
    """Return ``graph`` on a robot: the name or file of a profile, or a section of a graph file with a profile.

    Relative files start at ``folder``. Raises GraphError for an unknown robot or an invalid profile.
    """
    if isinstance(robot, YamlSection):
        return with_robot(graph, read_profile(robot, where=where, name=graph.name, folder=folder or Path()))
    beside = None if folder is None else folder / robot
    try:
        return with_robot(graph, load_profile(str(beside) if beside is not None and os.path.isfile(beside) else robot))
    except GraphError as error:
        if error.where == "robot":
            raise GraphError(error.what, where=where, remedy=error.remedy) from error
        raise


def with_robot(graph: Graph, profile: RobotProfile) -> Graph:
    """Return ``graph`` with the parts of a robot in place of its own.

    Parts that the profile lacks remain those of the graph; those that the graph does not use have no effect.

    Raises:
        GraphError: A node type of the profile is unknown or does not fit its part.
        ParameterError: A parameter of the profile is invalid.
    """
    namespace, profile = profile.namespace, profile.resolved
    for part, change in _CHANGES.items():
        value = getattr(profile, part)
        if value is not None:
            graph = change(graph, value, profile)
    if namespace:
        graph = _in_namespace(graph, namespace)
    if profile.url:
        nodes = [
            _changed(each, {"url": profile.url}) if "url" in each.type.parameters() else each for each in graph.nodes
        ]
        graph = replace(graph, nodes=tuple(nodes))
    return graph


def _in_namespace(graph: Graph, namespace: str) -> Graph:
    """Connect inputs for the standard topics of a robot with those in its ``namespace``."""
    published = {topic for config in graph.nodes for topic, _ in config.publications}
    moved = {topic: namespace + topic for topic in STANDARD_TOPICS if topic not in published}
    nodes = [
        _changed(each, remap={port.name: moved[topic] for topic, port in each.subscriptions if topic in moved})
        for each in graph.nodes
    ]
    inputs = frozenset(moved.get(topic, topic) for topic in graph.inputs)
    return replace(graph, nodes=tuple(nodes), inputs=inputs)


def _with_camera(graph: Graph, camera: CameraProfile, profile: RobotProfile) -> Graph:
    nodes: list[NodeConfig] = []
    info = camera.info
    for config in graph.nodes:
        if issubclass(config.type, Camera):
            if not camera.device:
                continue
            config = _changed(config, {"source": camera.device, "hfov_rad": camera.hfov_rad})
            if camera.type:
                config = replace(config, type=part_class(camera, Camera, profile))
        elif issubclass(config.type, ImageConverter) and not camera.device:
            config = _changed(config, remap={"image_raw": camera.image, "image_compressed": camera.compressed})
        elif issubclass(config.type, PersonDetector):
            values: dict[str, Any] = {}
            if camera.device or camera.hfov_rad != USUAL_HFOV_RAD:
                values["hfov_rad"] = camera.hfov_rad
            if is_rectified(camera.image or camera.compressed):
                values["rectified"] = True
            if camera.height_m:
                values["mount_height_m"] = camera.height_m
            if camera.pitch_rad < _UNKNOWN_PITCH_RAD:
                values["pitch_rad"] = camera.pitch_rad
            config = _changed(config, values, {} if camera.device else {"camera_info": camera.info})
            info = info or config.topic(PersonDetector.camera_info)  # which nobody publishes
        elif issubclass(config.type, Head):
            config = _changed(config, {"camera_on_head": camera.on_head})
        nodes.append(config)
    return _joined(graph, nodes, () if camera.device else (camera.image, camera.compressed, info))


_UNKNOWN_PITCH_RAD = 2.0


FRAME_PREFIXES: Mapping[str, str] = {"bodies": "body_", "faces": "face_", "persons": "person_"}
"""Beginning of the names of frames by kind of people (REP-155)."""


def _with_people(graph: Graph, people: Part, profile: RobotProfile) -> Graph:
    if people.type == "detector":
        return graph
    kind = part_class(people, Node, profile)
    detections = next((port for port in kind.outputs().values() if port.message_type is PersonDetections), None)
    if detections is None:
        raise GraphError(f"{people.type} publishes no people", where=profile.where, remedy="name a node that does")
    nodes: list[NodeConfig] = []
    for config in graph.nodes:
        if issubclass(config.type, PersonDetector):
            topic = config.topic(config.type.detections)
            remap = {**people.names, detections.name: topic}
            values = {**people.settings, **people.parameters}
            if people.type == "ros4hri":  # REP-155
                kinds = [name for name in FRAME_PREFIXES if f"/{name}/" in people.names["bodies"]]
                values = {"frame_prefix": FRAME_PREFIXES[kinds[0] if kinds else "bodies"], **values}
            config = NodeConfig(config.name, kind, values, remap, config.where)
        elif issubclass(config.type, Head):
            config = _changed(config, {"camera_on_head": False})  # people are in the frame of the base
        nodes.append(config)
    needed = {topic for config in nodes for topic, _ in config.subscriptions}
    kept = [
        config
        for config in nodes
        if not issubclass(config.type, (Camera, ImageConverter))
        or any(topic in needed for topic, _ in config.publications if not issubclass(config.type, Camera))
    ]
    return _joined(graph, kept, people.names.values())


_JOINT_KEYS = ("joint", "lower_rad", "upper_rad", "speed_rad_s", "straight_rad")


def _with_head(graph: Graph, head: HeadProfile, profile: RobotProfile) -> Graph:
    turned = [config for config in graph.nodes if issubclass(config.type, Head)]
    if not turned:
        return graph
    kind = part_class(head, RobotHead, profile)
    if head.type == "ros2_control" and "action" in head.names:
        kind = node_type("robot_head_action", where=profile.where)
    joints: dict[str, Any] = {}
    for name, joint in (("pan", head.pan), ("tilt", head.tilt)):
        joints |= {f"{name}_{key}": getattr(joint, key) for key in _JOINT_KEYS}
        joints[f"{name}_sign"] = joint.sign
    ports = {**kind.outputs(), **kind.clients(), **kind.inputs()}
    keys = {"action": "follow"}
    remap = {keys.get(key, key): name for key, name in head.names.items() if keys.get(key, key) in ports}
    body = NodeConfig(HEAD_NODE, kind, {**joints, **head.settings, **head.parameters}, remap, profile.where)
    limits = {
        "pan_joint": head.pan.joint or NO_PAN,
        "tilt_joint": head.tilt.joint or NO_TILT,
        "pan_limit_rad": min(head.pan.reach_rad, math.pi),
        "tilt_limit_rad": min(head.tilt.reach_rad, math.pi / 2),
        "max_speed_rad_s": min(head.pan.speed_rad_s, head.tilt.speed_rad_s),
    }
    nodes = [_changed(each, limits, {"trajectory": TARGET}) if each in turned else each for each in graph.nodes]
    commands = {each.topic(each.type.command) for each in turned if issubclass(each.type, Head)}
    body = _listening(body, graph, commands)
    return _joined(graph, [*nodes, body], (), body)


def _with_speech(graph: Graph, speech: Part, profile: RobotProfile) -> Graph:
    if speech.type == "speaker":
        return graph
    kind = part_class(speech, Speaker, profile)
    keys = {"action": next(iter(kind.clients()), ""), "topic": "text"}
    nodes, robots = [], []
    for config in graph.nodes:
        if issubclass(config.type, Speaker):
            names = {keys.get(key, key): name for key, name in speech.names.items()}
            values = {**config.parameters, **speech.settings, **speech.parameters}
            config = replace(config, type=kind, parameters=values, remap={**config.remap, **names})
            robots.append(config)
        nodes.append(config)
    return _joined(graph, nodes, (), *robots)


def _with_base(graph: Graph, base: Part, profile: RobotProfile) -> Graph:
    nodes, moved = [], []
    for config in graph.nodes:
        ports = [port.name for port in config.type.clients().values() if port.interface.name == NAVIGATE]
        if ports:
            known = config.type.parameters()
            values = {key: value for key, value in {**base.settings, **base.parameters}.items() if key in known}
            config = _changed(config, values, dict.fromkeys(ports, base.names["action"]))
            moved.append(config)
        nodes.append(config)
    return _joined(graph, nodes, (), *moved)


NAVIGATE = "nav2_msgs/action/NavigateToPose"

_CHANGES: Mapping[str, Callable[[Graph, Any, RobotProfile], Graph]] = {
    "camera": _with_camera,
    "head": _with_head,
    "people": _with_people,
    "speech": _with_speech,
    "base": _with_base,
}
"""Changes of a graph by part, in their order."""


def part_class(part: Part | CameraProfile, base: type[Node], profile: RobotProfile) -> type[Node]:
    """Return the node class of a part. Raises GraphError if it cannot be loaded, or is no subclass of ``base``."""
    kind = node_type(NODE_TYPES[base].get(part.type, part.type), where=profile.where)
    if not issubclass(kind, base):
        remedy = f"give a subclass of {base.__module__}.{base.__qualname__}"
        raise GraphError(f"{part.type} does not fit this part of a robot", where=profile.where, remedy=remedy)
    return kind


def _listening(body: NodeConfig, graph: Graph, commands: set[str]) -> NodeConfig:
    """Connect the inputs of a head for head commands and utterances, which gestures follow, with those of the graph."""
    said = {topic for each in graph.nodes for topic, port in each.publications if port.message_type is Utterance}
    found = {HeadCommand: commands, Utterance: said}
    names = {port.name: min(found.get(port.message_type) or {""}) for port in body.type.inputs().values()}
    return _changed(body, remap={**names, **body.remap})


def _changed(
    config: NodeConfig, parameters: Mapping[str, Any] | None = None, remap: Mapping[str, str] | None = None
) -> NodeConfig:
    names = {port: name for port, name in (remap or {}).items() if name}
    return replace(config, parameters={**config.parameters, **(parameters or {})}, remap={**config.remap, **names})


def _joined(graph: Graph, nodes: list[NodeConfig], topics: Any, *robots: NodeConfig) -> Graph:
    """Return ``graph`` with other ``nodes``; ``topics`` and what the ``robots`` nodes use come from outside."""
    published = {topic for config in nodes for topic, _ in config.publications}
    inputs = {topic for topic in (*graph.inputs, *topics) if topic and topic not in published}
    inputs |= {topic for one in robots for topic, port in one.subscriptions if _is_open(port, topic, published)}
    offered = {topic for config in nodes for topic, _ in config.servers}
    called = {topic for one in robots for topic, _ in one.clients}
    services = {*graph.services, *called} - offered
    return replace(graph, nodes=tuple(nodes), inputs=frozenset(inputs), services=frozenset(services))


def _is_open(port: Input[Any], topic: str, published: set[str]) -> bool:
    return not port.optional and topic not in published
