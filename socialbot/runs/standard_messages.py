"""Detections, beliefs, speech and head pose as standard ROS messages: transforms, joints, markers, vision_msgs."""

from __future__ import annotations

import enum
import math
import re
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from socialbot.bags.codec import TypeFactory
from socialbot.bags.types import types_with
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import HeardSpeech, Image, JointTrajectory, PersonDetection, PersonDetections
from socialbot.graph.node import Graph, check_parameters

if TYPE_CHECKING:
    from socialbot.runs._streams import HeadTarget


BASE, PAN, TILT, CAMERA = "base_link", "head_pan_link", "head_tilt_link", "camera_link"
OPTICAL = "camera_color_optical_frame"
"""Frames from the base to the camera; the optical frame looks along z, with the usual name of drivers."""

HEIGHT_M = 1.2
_UNKNOWN_PITCH = 2.0
_POSES = {
    "given": "given",
    "people": "estimated from people",
    "floor": "estimated from the floor",
    "file": "from a file",
}
"""Sources of a camera pose that no transform tells."""
_MOVED_M, _TURNED_RAD = 0.02, 0.01  # A pose that differs by so much from that of the detector is replaced by it.
Vector = tuple[float, float, float]


class HeadPose(NamedTuple):
    """Head direction in rad: pan left, tilt up."""

    pan: float
    tilt: float


AHEAD = HeadPose(0.0, 0.0)


@dataclass(frozen=True)
class Mounting:
    """Camera ``height_m`` above the floor, tilted down by ``pitch_rad``, on the base or on the head.

    ``optical`` is the frame of its images, and ``source`` tells where the pose comes from.
    """

    height_m: float = HEIGHT_M
    pitch_rad: float = 0.0
    on_head: bool = False
    optical: str = OPTICAL
    source: str = "assumed"

    def updated(self, found: PersonDetections, head: HeadPose = AHEAD) -> Mounting:
        """Return the mounting with the frame of the images, and with the camera pose of the detector.

        Args:
            found: Detections.
            head: Direction of the head at their time; the pose of the detector includes its tilt.
        """
        # The frame of the images depends on the driver or the bag, not on the graph.
        known = replace(self, optical=found.frame_id or self.optical)
        source = _POSES.get(found.camera_pose_source, "")
        if not source or found.camera_height_m is None or found.camera_pitch_rad is None:
            return known
        height_m, pitch_rad = found.camera_height_m, found.camera_pitch_rad + (head.tilt if self.on_head else 0.0)
        moved = abs(height_m - self.height_m) >= _MOVED_M or abs(pitch_rad - self.pitch_rad) >= _TURNED_RAD
        return replace(known, height_m=height_m, pitch_rad=pitch_rad, source=source) if moved else known

    def __str__(self) -> str:
        return f"{self.height_m:.2f} m high, {self.pitch_rad:.3f} rad down ({self.source})"


def mounting_of(graph: Graph) -> Mounting:
    """Return the camera mounting from the parameters of the detector."""
    detector = parameters_of(graph, "mount_height_m", "pitch_rad")
    # The detector estimates a height of 0 and a pitch of 2, which are not known here.
    height_m, pitch_rad = float(detector.get("mount_height_m", 0.0)), float(detector.get("pitch_rad", 0.0))
    source = "given" if height_m and pitch_rad < _UNKNOWN_PITCH else "assumed"
    height_m, pitch_rad = height_m or HEIGHT_M, pitch_rad if pitch_rad < _UNKNOWN_PITCH else 0.0
    on_head = bool(parameters_of(graph, "camera_on_head").get("camera_on_head"))
    return Mounting(height_m, pitch_rad, on_head, _camera_frame(graph), source)


def parameters_of(graph: Graph, *names: str) -> Mapping[str, Any]:
    """Return the parameters of the first node that has all ``names``; empty without one."""
    for config in graph.nodes:
        if config.type.parameters().keys() >= set(names):
            return check_parameters(config.type, config.parameters, where=config.place(graph.name))
    return {}


def _camera_frame(graph: Graph) -> str:
    for node in graph.nodes:
        publishes_images = any(port.message_type is Image for _, port in node.publications)
        if publishes_images and "frame_id" in node.type.parameters():
            return str(check_parameters(node.type, node.parameters, where=node.place(graph.name))["frame_id"])
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
    ahead, left = math.cos(elevation) * math.cos(bearing), math.cos(elevation) * math.sin(bearing)
    return math.atan2(left, ahead * math.cos(tilt) - math.sin(elevation) * math.sin(tilt))


HEAD_HZ = 20.0
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

    def take(self, message: JointTrajectory) -> None:
        """Process a target; unknown joints are ignored."""
        for name, target in zip(message.joint_names, message.positions, strict=False):
            if name in self._turns and math.isfinite(target):
                start = self.at(name, message.stamp)
                self._turns[name].append(Turn(start, target, message.stamp, message.duration_s))

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
_SHOWN_S = 0.5
Rotation = tuple[float, float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)
UPRIGHT: Rotation = (0.0, 0.0, 0.0, 1.0)
TF_MESSAGE = "tf2_msgs/msg/TFMessage"

_TIMES = range(2**31 * SECOND)
_NO_LETTERS = re.compile(r"[^A-Za-z0-9]+")
_ID_LETTERS = 64
ANONYMOUS = "anonymous_speaker"
"""Id of ROS4HRI for the voice of an unknown speaker."""


def topic_id(name: str, prefix: str) -> str:
    """Return an id that is valid in topic names: letters, digits and _, with ``prefix`` before a digit."""
    words = _NO_LETTERS.sub("_", name)[:_ID_LETTERS].strip("_")
    return words if words[:1].isalpha() else f"{prefix}{words}"


def body_id(person: PersonDetection) -> str:
    """Return the id of a body, which is valid in topic names."""
    return topic_id(person.track_id, "b")


def fits_time(stamp: int) -> bool:
    """Return whether ``stamp`` (ns) fits a ROS Time."""
    return stamp in _TIMES


class StandardMessages:
    """Builds standard ROS messages with ``types``."""

    def __init__(self, types: TypeFactory) -> None:
        self._types = types

    def make(self, type_name: str, values: Any = ()) -> Any:
        """Build a message from plain values; missing fields are zero or empty.

        Args:
            type_name: ROS type, such as ``geometry_msgs/msg/Point``.
            values: Values by field, or in the order of the fields; for a time, its stamp (ns).
        """
        if isinstance(values, int):
            values = divmod(values, SECOND)
        fields = types_with(type_name).fielddefs[type_name][1]
        if not isinstance(values, Mapping):
            values = dict(zip((name for name, _ in fields), values, strict=False))
        made = {name: self._field(*kind, values.get(name)) for name, kind in fields}
        return self._types.make(type_name, **made)

    def _field(self, node: Any, kind: Any, value: Any) -> Any:
        match node.name:
            case "NAME":
                return self.make(kind, () if value is None else value)
            case "BASE":
                default: Any = {"string": "", "bool": False}.get(kind[0], 0)
                return float(value or 0) if kind[0].startswith("float") else default if value is None else value
        (item, item_kind), count = kind
        if item.name == "NAME" or item_kind[0] == "string":
            return [self._field(item, item_kind, each) for each in value or ()]
        size = count if node.name == "ARRAY" else 0
        return np.zeros(size, item_kind[0]) if value is None else np.array(value, item_kind[0])

    def camera(self, stamp: int, mounting: Mounting) -> Any:
        """Return a TFMessage with the camera and its optical frame."""
        holder, place = (TILT, ORIGIN) if mounting.on_head else (BASE, (0.0, 0.0, mounting.height_m))
        frames = [_transform(stamp, holder, CAMERA, place, _looking_up(-mounting.pitch_rad))]
        if mounting.optical not in (BASE, PAN, TILT, CAMERA):
            # From "x forward, y left, z up" to "z forward, x right, y down".
            frames.append(_transform(stamp, CAMERA, mounting.optical, rotation=(-0.5, 0.5, -0.5, 0.5)))
        return self.make(TF_MESSAGE, [frames])

    def head(self, stamp: int, pose: HeadPose, height_m: float = HEIGHT_M) -> Any:
        turned = (0.0, 0.0, math.sin(pose.pan / 2), math.cos(pose.pan / 2))
        pan = _transform(stamp, BASE, PAN, (0.0, 0.0, height_m), turned)
        return self.make(TF_MESSAGE, [[pan, _transform(stamp, PAN, TILT, rotation=_looking_up(pose.tilt))]])

    def bodies(self, found: PersonDetections, head: HeadPose = AHEAD) -> Any:
        """Return a TFMessage with a frame ``body_<id>`` at the hips of each located person."""
        frames = []
        for person in found.persons:
            place = place_of(person, head)
            if person.track_id and place is not None:
                hips = (*place[:2], HIPS_HEIGHT_M)
                frames.append(_transform(found.stamp, BASE, f"body_{body_id(person)}", hips))
        return self.make(TF_MESSAGE, [frames])

    def joints(self, stamp: int, names: Sequence[str], positions_rad: Sequence[float]) -> Any:
        return self.make("sensor_msgs/msg/JointState", ((stamp,), names, positions_rad))

    def markers(self, found: PersonDetections, head: HeadPose = AHEAD) -> Any:
        """Return a MarkerArray with a cylinder and a label per person; it replaces the last one."""
        shapes = [_marker(found.stamp, 0, _CYLINDER, action=_DELETE_ALL)]
        for number, person in enumerate(found.persons):
            place = place_of(person, head)
            if place is None:
                continue
            x, y, _ = place
            size = (BODY_WIDTH_M, BODY_WIDTH_M, BODY_HEIGHT_M)
            body, above = (x, y, BODY_HEIGHT_M / 2), (x, y, BODY_HEIGHT_M + 0.2)
            label = f"{person.track_id or PERSON} {person.distance_m:.1f} m"
            shapes += [
                _marker(found.stamp, 2 * number, _CYLINDER, body, size, (0.1, 0.8, 0.3, 0.6)),
                _marker(found.stamp, 2 * number + 1, _TEXT, above, (0.2, 0.2, 0.2), (1.0, 1.0, 1.0, 1.0), label),
            ]
        return self.make("visualization_msgs/msg/MarkerArray", [shapes])

    def boxes(self, found: PersonDetections) -> Any:
        """Return a Detection2DArray of vision_msgs, in pixels."""
        header = (found.stamp, found.frame_id)
        detections = [
            {
                "header": header,
                "results": [{"hypothesis": (PERSON, person.score), "pose": {"pose": (ORIGIN, UPRIGHT)}}],
                "bbox": (((person.x + person.w / 2, person.y + person.h / 2),), person.w, person.h),
                "id": person.track_id,
            }
            for person in found.persons
        ]
        return self.make("vision_msgs/msg/Detection2DArray", (header, detections))

    def ids(self, stamp: int, frame_id: str, names: Sequence[str]) -> Any:
        """Return an IdsList of hri_msgs with ``names``."""
        return self.make("hri_msgs/msg/IdsList", ((stamp, frame_id), list(names)))

    def live_speech(self, heard: HeardSpeech) -> Any:
        """Return a LiveSpeech of hri_msgs with a recognised sentence."""
        values = {"final": heard.text, "confidence": heard.confidence, "language": heard.language}
        return self.make("hri_msgs/msg/LiveSpeech", {"header": (heard.stamp, ""), **values})

    def region(self, found: PersonDetections, box: Sequence[float], score: float) -> Any:
        """Return a NormalizedRegionOfInterest2D of hri_msgs for ``box`` (x, y, w, h), as fractions of the image."""
        x, y, w, h = box
        corners = {
            "xmin": x / found.width,
            "ymin": y / found.height,
            "xmax": (x + w) / found.width,
            "ymax": (y + h) / found.height,
            "c": score,
        }
        values = {name: min(max(value, 0.0), 1.0) for name, value in corners.items()}
        header = (found.stamp, found.frame_id)
        return self.make("hri_msgs/msg/NormalizedRegionOfInterest2D", {"header": header, **values})

    def engagement(self, found: PersonDetections, person: PersonDetection) -> Any:
        """Return an EngagementLevel of hri_msgs."""
        values = ((found.stamp, found.frame_id), int(engagement_of(person)))
        return self.make("hri_msgs/msg/EngagementLevel", dict(zip(("header", "level"), values, strict=True)))


class Engagement(enum.IntEnum):
    """Levels of EngagementLevel of hri_msgs."""

    UNKNOWN = 0
    DISENGAGED = 1
    ENGAGING = 2
    ENGAGED = 3
    DISENGAGING = 4


_FACES_ROBOT_RAD, _TURNED_RAD = 0.6, 1.0  # Who looks at the robot, and who looks past it.
_NEAR_M = 3.0
_MOVING_MPS = 0.3


def engagement_of(person: PersonDetection) -> Engagement:
    """Engagement of ``person`` with the robot, from facing, distance and approach."""
    if person.facing_rad is None:
        return Engagement.UNKNOWN
    near = person.distance_m is not None and person.distance_m <= _NEAR_M
    leaving = person.approach_mps is not None and person.approach_mps <= -_MOVING_MPS
    if person.facing_rad <= _FACES_ROBOT_RAD:
        return Engagement.ENGAGED if near and not leaving else Engagement.ENGAGING
    if person.facing_rad < _TURNED_RAD:
        return Engagement.DISENGAGING if near else Engagement.UNKNOWN
    return Engagement.DISENGAGED


def _marker(
    stamp: int,
    number: int,
    kind: int,
    place: Vector = ORIGIN,
    size: Vector = ORIGIN,
    colour: Rotation = (0.0, 0.0, 0.0, 0.0),
    text: str = "",
    *,
    action: int = _ADD,
) -> dict[str, Any]:
    return {
        "header": (stamp, BASE),
        "ns": "people",
        "id": number,
        "type": kind,
        "action": action,
        "pose": (place, UPRIGHT),
        "scale": size,
        "color": colour,
        "lifetime": nanoseconds(_SHOWN_S),
        "text": text,
    }


def _transform(
    stamp: int, parent: str, child: str, place: Vector = ORIGIN, rotation: Rotation = UPRIGHT
) -> tuple[Any, ...]:
    return (stamp, parent), child, (place, rotation)


def _looking_up(angle: float) -> Rotation:
    """Return the rotation by ``angle`` (rad) up; positive rotations about y point down."""
    return (0.0, -math.sin(angle / 2), 0.0, math.cos(angle / 2))
