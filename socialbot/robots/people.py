"""People as a robot's own ROS4HRI detectors see them (REP-155), in place of the person detector of socialbot."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from socialbot.core import limits
from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetection, PersonDetections, RosMessage, Transforms
from socialbot.graph.health import SILENT_S
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Delivery, Input, Output, Parameter
from socialbot.vision.transforms import TransformTree

WIDTH, HEIGHT, FOCAL_PX = 640, 480, 526.0
"""Virtual image of the boxes: the pixels and focal length of a camera that looks straight ahead."""

_PERSON_M, _PERSON_WIDTH_M, _EYES_M = 1.7, 0.5, 1.0
_LACK_S = 2.0  # time without a place of any person that is reported
_PATH_S = 0.5  # time over which a speed is measured
_PATH_FRAMES = 100  # a sender whose time stands still adds no more


class RobotPeople(Node):
    """Publishes the bodies that a ROS4HRI detector tracks, with distance, bearing and facing from their frames.

    Each list of ids gives one message. The frame ``body_ID`` of a person gives the position in ``robot_frame``; its
    x axis points where the person faces. Lists of faces or persons have another ``frame_prefix``. A person without a
    frame has neither distance nor bearing; the health of the node tells why, if that holds for all. Boxes are those of
    a virtual camera at the robot's frame, 1 m above it. Of a longer list only the first `limits.PERSONS` ids count.
    """

    bodies = Input("hri_msgs/msg/IdsList", "/humans/bodies/tracked", deadline_s=SILENT_S)
    tf = Input(Transforms, "/tf", optional=True)
    tf_static = Input(Transforms, "/tf_static", Delivery.LATCHED, optional=True)
    detections = Output(PersonDetections, "/humans/bodies/detections")

    robot_frame = Parameter("base_link", "frame of the robot: x ahead, y to the left (REP-105)", fixed=True)
    frame_prefix = Parameter("body_", "name of the frame of a person before the id", fixed=True)
    oldest_s = Parameter(1.0, "oldest frame of a person that counts, s", minimum=0.05, maximum=60.0)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._frames = TransformTree()
        self._paths: dict[str, deque[tuple[int, float]]] = {}
        self._lack = ""
        self._lacks_since = self.clock.now()

    @tf
    def on_transforms(self, message: Transforms) -> None:
        self._frames.add(message.transforms, moving=True)

    @tf_static
    def on_static_transforms(self, message: Transforms) -> None:
        self._frames.add(message.transforms)

    @bodies
    def on_bodies(self, message: RosMessage) -> None:
        stamp, bodies = message.stamp, dict.fromkeys(map(str, message.ids[: limits.PERSONS]))
        persons = tuple(self._person(body, stamp) for body in bodies)
        self._report_lack(next(iter(bodies), ""), persons, stamp)
        self._paths = {body: path for body, path in self._paths.items() if body in bodies}
        self.detections.publish(
            PersonDetections(stamp=stamp, frame_id=self.robot_frame, width=WIDTH, height=HEIGHT, persons=persons)
        )

    def _person(self, body: str, stamp: int) -> PersonDetection:
        frame, is_old = self.frame_prefix + body, self._age_problem(body, stamp)
        matrix = None if is_old else self._frames.lookup(self.robot_frame, frame, stamp)
        if matrix is None:
            return PersonDetection(x=0.0, y=0.0, w=0.0, h=0.0, score=1.0, track_id=body)
        x, y = float(matrix[0, 3]), float(matrix[1, 3])
        distance, bearing = math.hypot(x, y), math.atan2(y, x)
        left, top, width, height = _box(distance, bearing)
        return PersonDetection(
            x=left,
            y=top,
            w=width,
            h=height,
            score=1.0,
            track_id=body,
            distance_m=distance,
            bearing_rad=bearing,
            facing_rad=_facing(matrix),
            approach_mps=self._approach(body, stamp, distance),
        )

    def _age_problem(self, body: str, stamp: int) -> str:
        """Why no frame of a person is recent; empty if one is."""
        frame = self.frame_prefix + body
        newest = self._frames.newest(frame)
        if newest is None:
            return f"/tf has no frame {frame}"
        age_s = (stamp - newest) / SECOND
        lag = f"{abs(age_s):.1f} s {'older' if age_s > 0 else 'newer'} than the list of people"
        return f"the frame {frame} is {lag}" if abs(age_s) > self.oldest_s else ""

    def _report_lack(self, body: str, persons: tuple[PersonDetection, ...], stamp: int) -> None:
        """Report why no person has a place, if that lasts."""
        now = self.clock.now()
        if not persons or any(person.distance_m is not None for person in persons):
            self._lacks_since = now
            lack = self._lack if not persons else ""
        elif now - self._lacks_since < _LACK_S * SECOND:
            return
        else:
            why = self._age_problem(body, stamp)
            why = why or f"no transform connects {self.frame_prefix}{body} with {self.robot_frame}, set robot_frame"
            lack = f"people have no place: {why}"
        if bool(lack) != bool(self._lack):
            self._lack = lack
            self.report_health("ok", lack)

    def _approach(self, body: str, stamp: int, distance: float) -> float | None:
        path = self._paths.setdefault(body, deque(maxlen=_PATH_FRAMES))
        path.append((stamp, distance))
        while len(path) > 2 and stamp - path[1][0] >= _PATH_S * SECOND:
            path.popleft()
        (begin, first), elapsed_s = path[0], (stamp - path[0][0]) / SECOND
        return (first - distance) / elapsed_s if elapsed_s >= _PATH_S / 2 and begin < stamp else None


def _facing(matrix: np.ndarray) -> float:
    """Angle between the x axis of a body and the direction to the robot."""
    toward, ahead = -matrix[:2, 3], matrix[:2, 0]
    length = float(np.linalg.norm(toward) * np.linalg.norm(ahead))
    return math.acos(float(np.clip(toward @ ahead / length, -1.0, 1.0))) if length > 0 else 0.0


def _box(distance: float, bearing: float) -> tuple[float, float, float, float]:
    """Box of a standing person in the virtual image; empty for one beside or behind the robot."""
    depth = distance * math.cos(bearing)
    if depth <= 0.1:
        return 0.0, 0.0, 0.0, 0.0
    centre = WIDTH / 2 - FOCAL_PX * math.tan(bearing)
    top, bottom = (HEIGHT / 2 - FOCAL_PX * (level - _EYES_M) / depth for level in (_PERSON_M, 0.0))
    width = FOCAL_PX * _PERSON_WIDTH_M / depth
    return centre - width / 2, top, width, bottom - top
