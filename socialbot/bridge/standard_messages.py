"""What is seen and done, in messages that other packages of ROS know: frames, joints, markers, boxes, bodies.

Frames are those of REP-105 and REP-155, axes those of REP-103.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from socialbot.bridge.codec import TypeFactory
from socialbot.bridge.mounting import (
    AHEAD,
    BASE,
    CAMERA,
    HEIGHT_M,
    PAN,
    TILT,
    HeadPose,
    Mounting,
    Vector,
    place_of,
)  # fmt: skip
from socialbot.clock import SECOND, nanoseconds
from socialbot.messages import PersonDetection, PersonDetections

BODY_HEIGHT_M, BODY_WIDTH_M, HIPS_HEIGHT_M = 1.7, 0.45, 0.9
PERSON = "person"

_CYLINDER, _TEXT = 3, 9
_ADD, _DELETE_ALL = 0, 3
_NO_BYTES = np.zeros(0, np.uint8)
_SHOWN_S = 0.5
"""So long a marker is shown if nothing new is said."""

Rotation = tuple[float, float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)

_TIMES = range(2**31 * SECOND)
_NO_LETTERS = re.compile(r"[^A-Za-z0-9]+")
_ID_LETTERS = 64


def body_id(person: PersonDetection) -> str:
    """The track of ``person`` as an id that may stand in the name of a topic: letters, digits and _, no digit first."""
    words = _NO_LETTERS.sub("_", person.track_id)[:_ID_LETTERS].strip("_")
    return words if words[:1].isalpha() else f"b{words}"


def fits_time(stamp: int) -> bool:
    """Whether a Time of ROS can hold ``stamp`` (ns)."""
    return stamp in _TIMES


class StandardMessages:
    """Makes them, with ``types``."""

    def __init__(self, types: TypeFactory) -> None:
        self._make = types.make

    def time(self, stamp: int) -> Any:
        """``stamp`` (ns) as a Time."""
        seconds, rest = divmod(stamp, SECOND)
        return self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)

    def header(self, stamp: int, frame_id: str = "") -> Any:
        """A Header."""
        return self._make("std_msgs/msg/Header", stamp=self.time(stamp), frame_id=frame_id)

    def camera(self, stamp: int, mounting: Mounting) -> Any:
        """A TFMessage: where the camera sits, on the head or on the base, and the frame of its pictures."""
        holder, place = (TILT, ORIGIN) if mounting.on_head else (BASE, (0.0, 0.0, mounting.height_m))
        frames = [self._transform(stamp, holder, CAMERA, place, _looking_up(-mounting.pitch_rad))]
        if mounting.optical not in (BASE, PAN, TILT, CAMERA):
            # From "x forward, y left, z up" to "z forward, x right, y down".
            frames.append(self._transform(stamp, CAMERA, mounting.optical, rotation=(-0.5, 0.5, -0.5, 0.5)))
        return self._frames(frames)

    def head(self, stamp: int, pose: HeadPose, height_m: float = HEIGHT_M) -> Any:
        """A TFMessage: where the head points."""
        turned = (0.0, 0.0, math.sin(pose.pan / 2), math.cos(pose.pan / 2))
        return self._frames(
            [
                self._transform(stamp, BASE, PAN, (0.0, 0.0, height_m), turned),
                self._transform(stamp, PAN, TILT, rotation=_looking_up(pose.tilt)),
            ]
        )

    def bodies(self, found: PersonDetections, head: HeadPose = AHEAD) -> Any:
        """A TFMessage: a frame ``body_<id>`` for each person of whom it is known where they stand.

        It is between their hips; how they are turned is not known.
        """
        frames = []
        for person in found.persons:
            place = place_of(person, head)
            if person.track_id and place is not None:
                hips = (*place[:2], HIPS_HEIGHT_M)
                frames.append(self._transform(found.stamp, BASE, f"body_{body_id(person)}", hips))
        return self._frames(frames)

    def joints(self, stamp: int, names: Sequence[str], positions_rad: Sequence[float]) -> Any:
        """A JointState."""
        return self._make(
            "sensor_msgs/msg/JointState",
            header=self.header(stamp),
            name=list(names),
            position=np.array(positions_rad, np.float64),
            velocity=np.zeros(0),
            effort=np.zeros(0),
        )

    def markers(self, found: PersonDetections, head: HeadPose = AHEAD) -> Any:
        """A MarkerArray for RViz: a cylinder with id and distance for each person; it takes the place of the last."""
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
        """A Detection2DArray of vision_msgs, in pixels, centres and sizes."""
        return self._make(
            "vision_msgs/msg/Detection2DArray",
            header=self.header(found.stamp, found.frame_id),
            detections=[self._box(found, person) for person in found.persons],
        )

    def ids(self, found: PersonDetections) -> Any:
        """An IdsList of hri_msgs: who is followed."""
        return self._make(
            "hri_msgs/msg/IdsList",
            header=self.header(found.stamp, found.frame_id),
            ids=[body_id(person) for person in found.persons if person.track_id],
        )

    def region(self, found: PersonDetections, person: PersonDetection) -> Any:
        """A NormalizedRegionOfInterest2D of hri_msgs: a person's box as shares, 0 to 1, of the picture's size."""

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
        """A Pose at ``place`` that is not turned."""
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
    """A turn by ``angle`` (rad), up; one about y that is positive looks down."""
    return (0.0, -math.sin(angle / 2), 0.0, math.cos(angle / 2))


def _named(names: str, numbers: Iterable[float]) -> dict[str, float]:
    return {name: float(number) for name, number in zip(names, numbers, strict=True)}
