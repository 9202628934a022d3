"""Depth sensors of a robot: their latest measurements and transforms, for pictures by stamp."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

import numpy as np

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import ImageError
from socialbot.core.messages import (
    CameraInfo,
    CompressedDepth,
    CompressedImage,
    DepthImage,
    DepthInfo,
    Image,
    Message,
    PointCloud,
    Transforms,
)
from socialbot.vision.camera import CameraModel, CameraPose
from socialbot.vision.camera_pose import base_frames, pose_from_transforms, unusable_placement, yaw_from_transforms
from socialbot.vision.depth import ProjectedPoints, RangeImage, RegisteredDepth, Source
from socialbot.vision.depth_images import depth_in_metres, points_of, raw_depth, unpacked_depth
from socialbot.vision.transforms import AXES, OPTICAL, Matrix, TransformTree, parse_pose

log = logging.getLogger("socialbot.depth")

M = TypeVar("M", bound=Message)

TOLERANCE_S = 0.15
"""Largest difference of the stamps of a picture and a measurement."""
_KEPT_S = 3.0
_KEPT_IMAGES, _KEPT_CLOUDS = 20, 5
_SAME = 0.03
"""Largest relative difference of the intrinsics of a registered depth image and the picture."""
_SAME_PLACE_M, _SAME_DIRECTION_RAD = 0.06, 0.05
"""Largest distance and angle between the frames of a registered depth image and the picture."""
_PLACED_NS = 2 * SECOND  # Transforms that place the camera come within this time of its first image.
_LOST_NS = 2 * SECOND  # Transforms of moving frames without news for this time have stopped.
_MOST_POINTS = 120_000
_LEAST_POINTS, _IN_FRONT, _FIELD = 50, 0.98, 0.25
"""Points from which their axes are known, and the share of them in the field of view of a camera: a cone of 75
degrees, by its cosine."""

_Axes = Literal["body", "optical"]
"""Axes forward, left and up, or right, down and forward (REP-103)."""


@dataclass
class DepthSensors:
    """Latest depth images, point clouds and transforms of a robot, for pictures by stamp.

    Args:
        tolerance_s: Largest difference of the stamps of a picture and a measurement.
    """

    tolerance_s: float = TOLERANCE_S
    _depth: deque[Image | CompressedImage] = field(default_factory=deque, init=False)
    _clouds: deque[PointCloud] = field(default_factory=deque, init=False)
    _info: CameraInfo | None = field(default=None, init=False)
    _transforms: TransformTree = field(default_factory=TransformTree, init=False)
    _pose: Matrix | None = field(default=None, init=False)
    _warned: set[str] = field(default_factory=set, init=False)
    _unplaced_since: int = field(default=2**62, init=False)
    _moved_at: int | None = field(default=None, init=False)
    """Stamp (ns) of the newest transforms that move the camera."""
    _moved_by: int = field(default=0, init=False)
    """Stamp (ns) of the first image after them, as the clocks may differ."""

    def set_pose(self, text: str) -> None:
        """Set the pose of the sensor, for frames without a transform.

        ``text`` is "x y z roll pitch yaw" in the camera's forward, left and up axes, m and rad; empty if unknown.
        Raises ParameterError for another text.
        """
        self._pose = parse_pose(text) if text else None

    def take(self, message: Message, *, moving: bool = False) -> None:
        """Keep a message of a sensor, or transforms, which may be ``moving`` as those of /tf."""
        if isinstance(message, Transforms):
            self._transforms.add(message.transforms, moving=moving)
        elif isinstance(message, DepthInfo):
            self._info = message
        elif isinstance(message, (DepthImage, CompressedDepth)):
            _keep(self._depth, message, _KEPT_IMAGES)
        elif isinstance(message, PointCloud):
            _keep(self._clouds, message, _KEPT_CLOUDS)

    def camera_pose(self, frame_id: str, stamp: int) -> CameraPose | None:
        """Pose of the camera ``frame_id`` at ``stamp`` (ns) by the transforms; None, logged once, if they lack it."""
        pose = pose_from_transforms(self._transforms, frame_id, stamp)
        if pose is not None or not (bases := base_frames(self._transforms)):
            return pose
        self._unplaced_since = min(self._unplaced_since, stamp)
        if stamp - self._unplaced_since > _PLACED_NS:
            unusable = unusable_placement(self._transforms, frame_id, stamp)
            self._warn(
                f"the transforms place {unusable[0]}: its pose is estimated from people; {unusable[1]}"
                if unusable is not None
                else f"the transforms do not place the camera {frame_id!r} above the floor of {bases[0]}: its pose is "
                "estimated from people; check frame_id of the images, and /tf_static"
            )
        return None

    def camera_yaw(self, frame_id: str, stamp: int) -> float | None:
        """Direction of the camera ``frame_id`` at ``stamp`` (ns) in the base of the robot, rad; None if unknown.

        It is not known, either, if the frames that move between both are no longer published.
        """
        known = (self._transforms.moved_at(base, frame_id) for base in base_frames(self._transforms))
        moved_at = max((at for at in known if at is not None), default=None)
        if moved_at != self._moved_at:
            self._moved_at, self._moved_by = moved_at, stamp
        elif moved_at is not None and stamp - self._moved_by > _LOST_NS:
            self._warn(
                f"the transforms of {frame_id!r} have stopped: the direction of the camera is estimated from commands "
                "to the head; is robot_state_publisher running, and does it get joint states?"
            )
            return None
        return yaw_from_transforms(self._transforms, frame_id, stamp)

    def at(self, stamp: int, frame_id: str, camera: CameraModel) -> tuple[RangeImage, ...]:
        """Measurements for the picture of ``stamp`` (ns) in ``frame_id``; unusable ones are logged once."""
        images: list[RangeImage | None] = []
        for message in (_nearest(self._depth, stamp), _nearest(self._clouds, stamp)):
            if message is None or abs(message.stamp - stamp) > nanoseconds(self.tolerance_s):
                continue
            age_s = abs(message.stamp - stamp) / SECOND
            try:
                if isinstance(message, PointCloud):
                    images.append(self._cloud(message, frame_id, age_s))
                else:
                    images.append(self._depth_image(message, frame_id, camera, age_s))
            except ImageError as error:
                self._warn(str(error))
        return tuple(image for image in images if image is not None)

    def _depth_image(
        self, message: Image | CompressedImage, frame_id: str, camera: CameraModel, age_s: float
    ) -> RangeImage | None:
        pixels = raw_depth(message) if isinstance(message, Image) else unpacked_depth(message)
        same_frame = not message.frame_id or not frame_id or message.frame_id.lstrip("/") == frame_id.lstrip("/")
        intrinsics = self._intrinsics(pixels.shape[1], pixels.shape[0])
        if intrinsics is None:
            same_view = abs(pixels.shape[1] * camera.height / (pixels.shape[0] * camera.width) - 1) < _SAME
        else:
            same_view = _is_same_view(intrinsics, camera)
        if same_view and (same_frame or (intrinsics is not None and self._looks_alike(message, frame_id))):
            return RegisteredDepth(pixels, age_s)
        to_camera = np.eye(4) if same_frame else self._to_camera(message.frame_id, frame_id, message.stamp, "depth")
        if to_camera is None:
            return None
        if intrinsics is None:
            self._warn(
                f"depth images in {message.frame_id} are not registered to {frame_id} and have no camera_info: "
                "they are not used; record the camera_info of the depth camera, or the registered depth topic"
            )
            return None
        return ProjectedPoints(_transformed(_points(pixels, intrinsics), to_camera), age_s, "depth")

    def _looks_alike(self, message: Image | CompressedImage, frame_id: str) -> bool:
        """Whether depth images with the intrinsics of the picture in ``frame_id`` are aligned with it.

        Drivers give them a frame of their own, which is that of the picture or unknown. The depth of another camera of
        the same kind has another pose.
        """
        found = self._transforms.lookup(frame_id, message.frame_id, message.stamp)
        if found is None:
            self._warn(
                f"depth images in {message.frame_id} are taken as registered to {frame_id}: they have its intrinsics, "
                "and no transform places them elsewhere; do both show the same?"
            )
            return True
        turned = math.acos(min(max((np.trace(found[:3, :3]) - 1) / 2, -1.0), 1.0))
        return float(np.linalg.norm(found[:3, 3])) < _SAME_PLACE_M and turned < _SAME_DIRECTION_RAD

    def _cloud(self, message: PointCloud, frame_id: str, age_s: float) -> RangeImage | None:
        points = points_of(message)
        points = points[:: 1 + len(points) // _MOST_POINTS]
        axes = _axes_of(points)
        same_frame = message.frame_id.lstrip("/") == frame_id.lstrip("/")
        if same_frame:
            to_camera = AXES if axes == "body" else np.eye(4)
        else:
            to_camera = self._to_camera(message.frame_id, frame_id, message.stamp, "points", axes)
        if to_camera is None:
            return None
        # An organised cloud of points in front of its sensor comes from a depth camera.
        camera = axes is not None or OPTICAL.search(message.frame_id)
        source: Source = "depth" if message.height > 1 and camera else "lidar"
        return ProjectedPoints(_transformed(points, to_camera), age_s, source)

    def _intrinsics(self, width: int, height: int) -> CameraModel | None:
        """Intrinsics of the depth camera for an image of ``width`` x ``height`` pixels, if known and valid."""
        info = self._info
        if info is None or len(info.k) != 9 or not (info.k[0] > 0 and info.k[4] > 0 and info.width and info.height):
            return None
        return CameraModel.from_info(info).scaled(width, height)

    def _to_camera(self, sensor: str, camera: str, stamp: int, what: str, axes: _Axes | None = None) -> Matrix | None:
        """Transform from the frame ``sensor`` to the optical axes of ``camera``; None, with a warning, if unknown.

        ``axes`` are those of the measurements, if these show them: drivers and simulators also name another frame.
        """
        found = self._transforms.lookup(camera, sensor, stamp)
        named_optical = OPTICAL.search(sensor) is not None
        sensor_is_optical = what == "depth" or axes == "optical" or (axes is None and named_optical)
        if found is not None:
            if found[2, 2] <= 0.7 or sensor_is_optical:  # the axes of both frames differ, or are both optical
                return found
            if named_optical:
                return found @ AXES
            # Some drivers name the body frame of a camera, whose z axis points up, as that of its images.
            return found if OPTICAL.search(camera) else AXES @ found
        if self._pose is not None:
            return AXES @ self._pose @ (AXES.T if sensor_is_optical else np.eye(4))
        self._warn(
            f"{what} in {sensor or 'a frame without a name'}: no transform to {camera or 'the camera'} is known, so "
            "they are not used; record /tf and /tf_static (over ROS, install the package tf2_msgs), or set depth_pose"
        )
        return None

    def _warn(self, text: str) -> None:
        if text not in self._warned:
            self._warned.add(text)
            log.warning("%s", text)


def _axes_of(points: np.ndarray) -> _Axes | None:
    """Axes of points (n, 3) that are all in the field of view of a camera; None if they are not, as of a lidar."""
    if len(points) < _LEAST_POINTS:
        return None
    distances = np.linalg.norm(points, axis=1, keepdims=True)
    ahead = (points > _FIELD * distances).mean(axis=0)
    is_body, is_optical = ahead[0] > _IN_FRONT, ahead[2] > _IN_FRONT
    if is_body == is_optical:
        return None
    return "body" if is_body else "optical"


def _nearest(kept: Iterable[M], stamp: int) -> M | None:
    return min(kept, key=lambda each: abs(each.stamp - stamp), default=None)


def _keep(kept: deque[Any], message: Message, most: int) -> None:
    if kept and message.stamp < kept[-1].stamp - nanoseconds(_KEPT_S):
        kept.clear()  # a new recording
    kept.append(message)
    while len(kept) > most or kept[0].stamp < message.stamp - nanoseconds(_KEPT_S):
        kept.popleft()


def _is_same_view(depth: CameraModel, camera: CameraModel) -> bool:
    if depth.is_cut_by(camera.width, camera.height):
        return False
    scaled = depth.scaled(camera.width, camera.height)
    pairs = ((scaled.fx, camera.fx, camera.fx), (scaled.fy, camera.fy, camera.fy))
    centres = ((scaled.cx, camera.cx, camera.width), (scaled.cy, camera.cy, camera.height))
    return all(abs(one - other) < _SAME * size for one, other, size in (*pairs, *centres))


def _points(pixels: np.ndarray, intrinsics: CameraModel) -> np.ndarray:
    """Points (n, 3) of a depth image in its optical frame."""
    step = 1 + int(math.sqrt(pixels.size / _MOST_POINTS))
    z = depth_in_metres(pixels[::step, ::step])
    rows, columns = np.nonzero(np.isfinite(z))
    z = z[rows, columns]
    x, y = intrinsics.points(columns * step + 0.5, rows * step + 0.5)
    return np.stack([x * z, y * z, z], axis=1)


def _transformed(points: np.ndarray, matrix: Matrix) -> np.ndarray:
    return points @ matrix[:3, :3].T.astype(np.float32) + matrix[:3, 3].astype(np.float32)
