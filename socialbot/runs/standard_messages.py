"""Detections, beliefs, speech and head pose as standard ROS messages: transforms, joints, markers, vision_msgs."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from socialbot.bags.codec import TypeFactory
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Image, JointTrajectory, PersonDetection, PersonDetections
from socialbot.graph.node import Graph, check_parameters

if TYPE_CHECKING:
    from socialbot.runs._streams import HeadTarget


BASE, PAN, TILT, CAMERA = "base_link", "head_pan_link", "head_tilt_link", "camera_link"
OPTICAL = "camera_color_optical_frame"
"""Frames from the base to the camera; the optical frame looks along z, with the usual name of drivers."""

HEIGHT_M = 1.2
"""Default height of the head."""

Vector = tuple[float, float, float]


class HeadPose(NamedTuple):
    """Head direction in rad: pan left, tilt up."""

    pan: float
    tilt: float


AHEAD = HeadPose(0.0, 0.0)


@dataclass(frozen=True)
class Mounting:
    """Camera ``height_m`` above the floor, tilted down by ``pitch_rad``, on the base or on the head.

    ``optical`` is the frame of its images.
    """

    height_m: float = HEIGHT_M
    pitch_rad: float = 0.0
    on_head: bool = False
    optical: str = OPTICAL


def mounting_of(graph: Graph) -> Mounting:
    """Return the camera mounting from the parameters of the detector."""
    seeing = parameters_of(graph, "mount_height_m", "pitch_rad")
    turning = parameters_of(graph, "camera_on_head")
    return Mounting(
        float(seeing.get("mount_height_m", HEIGHT_M)),
        float(seeing.get("pitch_rad", 0.0)),
        bool(turning.get("camera_on_head")),
        _camera_frame(graph),
    )


def parameters_of(graph: Graph, *names: str) -> Mapping[str, Any]:
    """Return the parameters of the first node that has all ``names``; empty without one."""
    for placement in graph.placements:
        if placement.type.parameters().keys() >= set(names):
            return check_parameters(placement.type, placement.parameters, where=placement.place(graph.name))
    return {}


def _camera_frame(graph: Graph) -> str:
    for placement in graph.placements:
        if "frame_id" in placement.type.parameters() and Image in (
            port.message_type for _, port in placement.publications
        ):
            values = check_parameters(placement.type, placement.parameters, where=placement.place(graph.name))
            return str(values["frame_id"])
    return OPTICAL


def place_of(person: PersonDetection, head: HeadPose = AHEAD) -> Vector | None:
    """Return the position (m) of a person in the base frame; ``head`` is the direction of the camera."""
    if person.distance_m is None or person.bearing_rad is None:
        return None
    bearing = head.pan + _levelled(person.bearing_rad, person.elevation_rad, head.tilt)
    return person.distance_m * math.cos(bearing), person.distance_m * math.sin(bearing), 0.0


def _levelled(bearing: float, elevation: float | None, tilt: float) -> float:
    if elevation is None or not tilt:
        return bearing
    ahead, left, up = (
        math.cos(elevation) * math.cos(bearing),
        math.cos(elevation) * math.sin(bearing),
        math.sin(elevation),
    )
    return math.atan2(left, ahead * math.cos(tilt) - up * math.sin(tilt))


HEAD_HZ = 20.0
"""Publishing rate of the head pose."""

_KEPT = 32
"""Remembered turns of each joint: at least 3 s at ten targets a second."""


@dataclass(frozen=True)
class Neck:
    """Names of the pan and tilt joints."""

    pan: str
    tilt: str


def neck_of(graph: Graph) -> Neck | None:
    """Return the joints of the first node that turns a head."""
    values = parameters_of(graph, "pan_joint", "tilt_joint")
    return Neck(values["pan_joint"], values["tilt_joint"]) if values else None


@dataclass(frozen=True)
class Turn:
    """Motion of a joint (rad) from ``start`` to ``target`` since ``begin`` (ns)."""

    start: float
    target: float
    begin: int
    duration_s: float

    def at(self, stamp: int) -> float:
        if self.duration_s <= 0:
            return self.target
        share = min(max((stamp - self.begin) / SECOND / self.duration_s, 0.0), 1.0)
        return self.start + share * (self.target - self.start)


class Joints:
    """Positions of joints, initially 0."""

    def __init__(self, names: Iterable[str]) -> None:
        self._turns = {name: deque([Turn(0.0, 0.0, 0, 0.0)], maxlen=_KEPT) for name in names}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._turns)

    def tell(self, told: JointTrajectory) -> None:
        """Process a target; unknown joints are ignored."""
        for name, target in zip(told.joint_names, told.positions, strict=False):
            if name in self._turns and math.isfinite(target):
                start = self.at(name, told.stamp)
                self._turns[name].append(Turn(start, target, told.stamp, told.duration_s))

    def at(self, name: str, stamp: int) -> float:
        """Return the position (rad) of a joint at ``stamp`` (ns)."""
        turns = self._turns[name]
        return next((turn for turn in reversed(turns) if turn.begin <= stamp), turns[0]).at(stamp)


class HeadCourse:
    """Direction of a head over time, from its target poses in order."""

    def __init__(self, poses: Iterable[HeadTarget]) -> None:
        self._begins: list[int] = []
        self._turns: list[tuple[Turn, Turn]] = []
        for stamp, pan, tilt, duration_s in poses:
            start = self.at(stamp)
            self._begins.append(stamp)
            self._turns.append(
                (Turn(start.pan, pan, stamp, duration_s), Turn(start.tilt, tilt, stamp, duration_s)),
            )

    def at(self, stamp: int) -> HeadPose:
        begun = bisect_right(self._begins, stamp)
        if not begun:
            return AHEAD
        pan, tilt = self._turns[begun - 1]
        return HeadPose(pan.at(stamp), tilt.at(stamp))


BODY_HEIGHT_M, BODY_WIDTH_M, HIPS_HEIGHT_M = 1.7, 0.45, 0.9
PERSON = "person"

_CYLINDER, _TEXT = 3, 9
_ADD, _DELETE_ALL = 0, 3
_NO_BYTES = np.zeros(0, np.uint8)
_SHOWN_S = 0.5
"""Lifetime of a marker."""

Rotation = tuple[float, float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)

_TIMES = range(2**31 * SECOND)
_NO_LETTERS = re.compile(r"[^A-Za-z0-9]+")
_ID_LETTERS = 64


def body_id(person: PersonDetection) -> str:
    """Return a track id that is valid in topic names: letters, digits and _, not starting with a digit."""
    words = _NO_LETTERS.sub("_", person.track_id)[:_ID_LETTERS].strip("_")
    return words if words[:1].isalpha() else f"b{words}"


def fits_time(stamp: int) -> bool:
    """Return whether ``stamp`` (ns) fits a ROS Time."""
    return stamp in _TIMES


class StandardMessages:
    """Builds standard ROS messages with ``types``."""

    def __init__(self, types: TypeFactory) -> None:
        self._make = types.make

    def time(self, stamp: int) -> Any:
        seconds, rest = divmod(stamp, SECOND)
        return self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)

    def header(self, stamp: int, frame_id: str = "") -> Any:
        return self._make("std_msgs/msg/Header", stamp=self.time(stamp), frame_id=frame_id)

    def camera(self, stamp: int, mounting: Mounting) -> Any:
        """Return a TFMessage with the camera and its optical frame."""
        holder, place = (TILT, ORIGIN) if mounting.on_head else (BASE, (0.0, 0.0, mounting.height_m))
        frames = [self._transform(stamp, holder, CAMERA, place, _looking_up(-mounting.pitch_rad))]
        if mounting.optical not in (BASE, PAN, TILT, CAMERA):
            # From "x forward, y left, z up" to "z forward, x right, y down".
            frames.append(self._transform(stamp, CAMERA, mounting.optical, rotation=(-0.5, 0.5, -0.5, 0.5)))
        return self._frames(frames)

    def head(self, stamp: int, pose: HeadPose, height_m: float = HEIGHT_M) -> Any:
        turned = (0.0, 0.0, math.sin(pose.pan / 2), math.cos(pose.pan / 2))
        return self._frames(
            [
                self._transform(stamp, BASE, PAN, (0.0, 0.0, height_m), turned),
                self._transform(stamp, PAN, TILT, rotation=_looking_up(pose.tilt)),
            ]
        )

    def bodies(self, found: PersonDetections, head: HeadPose = AHEAD) -> Any:
        """Return a TFMessage with a frame ``body_<id>`` at the hips of each located person."""
        frames = []
        for person in found.persons:
            place = place_of(person, head)
            if person.track_id and place is not None:
                hips = (*place[:2], HIPS_HEIGHT_M)
                frames.append(self._transform(found.stamp, BASE, f"body_{body_id(person)}", hips))
        return self._frames(frames)

    def joints(self, stamp: int, names: Sequence[str], positions_rad: Sequence[float]) -> Any:
        return self._make(
            "sensor_msgs/msg/JointState",
            header=self.header(stamp),
            name=list(names),
            position=np.array(positions_rad, np.float64),
            velocity=np.zeros(0),
            effort=np.zeros(0),
        )

    def markers(self, found: PersonDetections, head: HeadPose = AHEAD) -> Any:
        """Return a MarkerArray with a cylinder and a label per person; it replaces the last one."""
        shapes = [self._marker(found.stamp, 0, _CYLINDER, action=_DELETE_ALL)]
        for number, person in enumerate(found.persons):
            place = place_of(person, head)
            if place is None:
                continue
            x, y, _ = place
            size = (BODY_WIDTH_M, BODY_WIDTH_M, BODY_HEIGHT_M)
            shapes.append(
                self._marker(found.stamp, 2 * number, _CYLINDER, (x, y, BODY_HEIGHT_M / 2), size, (0.1, 0.8, 0.3, 0.6))
            )
            said = f"{person.track_id or PERSON} {person.distance_m:.1f} m"
            above = (x, y, BODY_HEIGHT_M + 0.2)
            shapes.append(
                self._marker(found.stamp, 2 * number + 1, _TEXT, above, (0.2, 0.2, 0.2), (1.0, 1.0, 1.0, 1.0), said)
            )
        return self._make("visualization_msgs/msg/MarkerArray", markers=shapes)

    def boxes(self, found: PersonDetections) -> Any:
        """Return a Detection2DArray of vision_msgs, in pixels."""
        return self._make(
            "vision_msgs/msg/Detection2DArray",
            header=self.header(found.stamp, found.frame_id),
            detections=[self._box(found, person) for person in found.persons],
        )

    def ids(self, found: PersonDetections) -> Any:
        """Return an IdsList of hri_msgs."""
        return self._make(
            "hri_msgs/msg/IdsList",
            header=self.header(found.stamp, found.frame_id),
            ids=[body_id(person) for person in found.persons if person.track_id],
        )

    def region(self, found: PersonDetections, person: PersonDetection) -> Any:
        """Return a NormalizedRegionOfInterest2D of hri_msgs, as fractions of the image."""

        def share(pixels: float, whole: int) -> float:
            return min(max(pixels / whole, 0.0), 1.0)

        return self._make(
            "hri_msgs/msg/NormalizedRegionOfInterest2D",
            header=self.header(found.stamp, found.frame_id),
            xmin=share(person.x, found.width),
            ymin=share(person.y, found.height),
            xmax=share(person.x + person.w, found.width),
            ymax=share(person.y + person.h, found.height),
            c=min(max(person.score, 0.0), 1.0),
        )

    def _box(self, found: PersonDetections, person: PersonDetection) -> Any:
        make = self._make
        centre = make("vision_msgs/msg/Point2D", x=person.x + person.w / 2, y=person.y + person.h / 2)
        hypothesis = make("vision_msgs/msg/ObjectHypothesis", class_id=PERSON, score=float(person.score))
        return make(
            "vision_msgs/msg/Detection2D",
            header=self.header(found.stamp, found.frame_id),
            results=[
                make(
                    "vision_msgs/msg/ObjectHypothesisWithPose",
                    hypothesis=hypothesis,
                    pose=make("geometry_msgs/msg/PoseWithCovariance", pose=self._pose(ORIGIN), covariance=np.zeros(36)),
                )
            ],
            bbox=make(
                "vision_msgs/msg/BoundingBox2D",
                center=make("vision_msgs/msg/Pose2D", position=centre, theta=0.0),
                size_x=float(person.w),
                size_y=float(person.h),
            ),
            id=person.track_id,
        )

    def _marker(
        self,
        stamp: int,
        number: int,
        kind: int,
        place: Vector = ORIGIN,
        size: Vector = ORIGIN,
        colour: Rotation = (0.0, 0.0, 0.0, 0.0),
        text: str = "",
        *,
        action: int = _ADD,
    ) -> Any:
        make = self._make
        seconds, rest = divmod(nanoseconds(_SHOWN_S), SECOND)
        return make(
            "visualization_msgs/msg/Marker",
            header=self.header(stamp, BASE),
            ns="people",
            id=number,
            type=kind,
            action=action,
            pose=self._pose(place),
            scale=make("geometry_msgs/msg/Vector3", **_named("xyz", size)),
            color=make("std_msgs/msg/ColorRGBA", **_named("rgba", colour)),
            lifetime=make("builtin_interfaces/msg/Duration", sec=seconds, nanosec=rest),
            text=text,
            frame_locked=False,
            points=[],
            colors=[],
            uv_coordinates=[],
            texture_resource="",
            texture=make("sensor_msgs/msg/CompressedImage", header=self.header(0), format="", data=_NO_BYTES),
            mesh_resource="",
            mesh_file=make("visualization_msgs/msg/MeshFile", filename="", data=_NO_BYTES),
            mesh_use_embedded_materials=False,
        )

    def _pose(self, place: Vector) -> Any:
        point = self._make("geometry_msgs/msg/Point", **_named("xyz", place))
        upright = self._make("geometry_msgs/msg/Quaternion", **_named("xyzw", (0.0, 0.0, 0.0, 1.0)))
        return self._make("geometry_msgs/msg/Pose", position=point, orientation=upright)

    def _frames(self, transforms: list[Any]) -> Any:
        return self._make("tf2_msgs/msg/TFMessage", transforms=transforms)

    def _transform(
        self,
        stamp: int,
        parent: str,
        child: str,
        place: Vector = ORIGIN,
        rotation: Rotation = (0.0, 0.0, 0.0, 1.0),
    ) -> Any:
        moved = self._make("geometry_msgs/msg/Vector3", **_named("xyz", place))
        turned = self._make("geometry_msgs/msg/Quaternion", **_named("xyzw", rotation))
        transform = self._make("geometry_msgs/msg/Transform", translation=moved, rotation=turned)
        header = self.header(stamp, parent)
        return self._make(
            "geometry_msgs/msg/TransformStamped", header=header, child_frame_id=child, transform=transform
        )


def _looking_up(angle: float) -> Rotation:
    """Return the rotation by ``angle`` (rad) up; positive rotations about y point down."""
    return (0.0, -math.sin(angle / 2), 0.0, math.cos(angle / 2))


def _named(names: str, numbers: Iterable[float]) -> dict[str, float]:
    return {name: float(number) for name, number in zip(names, numbers, strict=True)}
