"""Says again what a running graph sees and does, in messages that other packages of ROS know.

RViz, rqt, ROS4HRI and others take these; see docs/ros-installation.md. A package that is not installed is left out.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from socialbot.bridge.transport import RclpyTypes, message_class, publisher_qos
from socialbot.core.errors import InstallationError, ParameterError
from socialbot.core.messages import JointTrajectory, Message, PersonDetections
from socialbot.graph.node import Delivery, Graph
from socialbot.runs.standard_messages import (
    AHEAD,
    HEAD_HZ,
    HeadPose,
    Joints,
    Neck,
    StandardMessages,
    body_id,
    fits_time,
    mounting_of,
    neck_of,
)

TF, TF_STATIC, JOINTS = "/tf", "/tf_static", "/joint_states"
MARKERS, BOXES, TRACKED = "/humans/bodies/markers", "/humans/bodies/boxes", "/humans/bodies/tracked"
REGION = "/humans/bodies/{}/roi"

TYPES: Mapping[str, str] = {
    TF: "tf2_msgs/msg/TFMessage",
    MARKERS: "visualization_msgs/msg/MarkerArray",
    BOXES: "vision_msgs/msg/Detection2DArray",
    TRACKED: "hri_msgs/msg/IdsList",
}
HEAD_TYPES: Mapping[str, str] = {TF_STATIC: "tf2_msgs/msg/TFMessage", JOINTS: "sensor_msgs/msg/JointState"}
REGION_TYPE = "hri_msgs/msg/NormalizedRegionOfInterest2D"


def translated_topics(graph: Graph) -> dict[str, type[Message]]:
    """The topics of ``graph`` that a `Translator` has to hear."""
    kinds = (PersonDetections, JointTrajectory)
    return {topic: kind for topic, kind in graph.topics().items() if issubclass(kind, kinds)}


class Translator:
    """Takes messages of ``graph`` from any thread; says them again by ``ros``, a node that spins.

    With ``head`` it also says where the head is, as it was told: on a robot the drivers do that. ``missing`` names the
    packages that are not installed, or whose libraries are not found. Raises ParameterError when there is no head to
    tell of.
    """

    def __init__(self, ros: Any, graph: Graph, *, head: bool) -> None:
        neck = neck_of(graph)
        if head and neck is None:
            raise ParameterError(f"no node of {graph.name} turns a head", where="--head", remedy="leave it out")
        self._ros = ros
        self._say = StandardMessages(RclpyTypes())
        self._neck = neck or Neck("", "")
        self._mounting = mounting_of(graph)
        self._joints = Joints((self._neck.pan, self._neck.tilt))
        self._bodies: dict[str, Any] = {}
        self._lock = threading.Lock()
        self.missing: set[str] = set()
        self._publishers: dict[str, Any] = {}
        for topic, kind in (*TYPES.items(), *(HEAD_TYPES.items() if head else ())):
            self._offer(topic, kind, Delivery.LATCHED if topic == TF_STATIC else Delivery.EVERY)
        if head:
            self._tell_camera()
            ros.create_timer(1 / HEAD_HZ, self._tell_head)

    @property
    def topics(self) -> list[str]:
        """What it says, each with its type; there is one for the box of each body."""
        offered = {**TYPES, **HEAD_TYPES}
        told = [f"{topic}  {offered[topic]}" for topic in self._publishers]
        return [*told, f"{REGION.format('<id>')}  {REGION_TYPE}"] if TRACKED in self._publishers else told

    def take(self, topic: str, message: Message) -> None:
        """Says a message of a graph again, unless no Time of ROS can hold its stamp."""
        if not fits_time(message.stamp):
            return
        with self._lock:
            if isinstance(message, JointTrajectory):
                self._joints.tell(message)
            elif isinstance(message, PersonDetections):
                self._tell_people(message)

    def _tell_people(self, found: PersonDetections) -> None:
        if found.frame_id not in ("", self._mounting.optical):
            # Whose pictures these are is not for the graph to say: another driver's, or those of a bag.
            self._mounting = replace(self._mounting, optical=found.frame_id)
            self._tell_camera()
        head = self._pose(found.stamp) if self._mounting.on_head else AHEAD
        if found.persons:
            self._tell(TF, lambda: self._say.bodies(found, head))
        self._tell(MARKERS, lambda: self._say.markers(found, head))
        self._tell(BOXES, lambda: self._say.boxes(found))
        if TRACKED in self._publishers:
            self._tell_regions(found)
            self._tell(TRACKED, lambda: self._say.ids(found))

    def _tell_regions(self, found: PersonDetections) -> None:
        """By a topic for each body, which goes when the body does."""
        there = {body_id(person): person for person in found.persons if person.track_id}
        for gone in self._bodies.keys() - there.keys():
            self._ros.destroy_publisher(self._bodies.pop(gone))
        if not (found.width and found.height):
            return
        for name, person in there.items():
            if name not in self._bodies:
                # Who hears of a body only now gets the box that it has by then.
                self._bodies[name] = self._ros.create_publisher(
                    message_class(REGION_TYPE), REGION.format(name), publisher_qos(Delivery.LATCHED)
                )
            self._bodies[name].publish(self._say.region(found, person))

    def _tell_camera(self) -> None:
        self._tell(TF_STATIC, lambda: self._say.camera(self._now(), self._mounting))

    def _tell_head(self) -> None:
        with self._lock:
            now = self._now()
            pose = self._pose(now)
        self._tell(JOINTS, lambda: self._say.joints(now, self._joints.names, pose))
        self._tell(TF, lambda: self._say.head(now, pose, self._mounting.height_m))

    def _tell(self, topic: str, make: Callable[[], Any]) -> None:
        """Publishes what is made, where the type of ``topic`` is installed."""
        publisher = self._publishers.get(topic)
        if publisher is not None:
            publisher.publish(make())

    def _pose(self, stamp: int) -> HeadPose:
        return HeadPose(self._joints.at(self._neck.pan, stamp), self._joints.at(self._neck.tilt, stamp))

    def _now(self) -> int:
        return self._ros.get_clock().now().nanoseconds

    def _offer(self, topic: str, kind: str, delivery: Delivery) -> None:
        from rosidl_generator_py.import_type_support_impl import UnsupportedTypeSupport

        try:
            found = message_class(kind)
            if topic == TRACKED:
                message_class(REGION_TYPE)
            self._publishers[topic] = self._ros.create_publisher(found, topic, publisher_qos(delivery))
        except (InstallationError, UnsupportedTypeSupport):
            # The second is for a package whose libraries are not found.
            self.missing.add(kind.partition("/")[0])
