"""Cameras: intrinsics, pose above the floor, and the directions of pixels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import msgspec
import numpy as np

from socialbot.core.errors import MessageError, ParameterError
from socialbot.core.messages import CameraInfo
from socialbot.vision.transforms import AXES

Box = Sequence[float]
"""x, y, w, h in pixels."""


PoseSource = Literal["given", "tf", "floor", "file", "people", "assumed"]
"""Where a pose comes from: parameters, transforms, points of the floor, a pose file, people in view, or nowhere."""

_SOURCES: Mapping[PoseSource, str] = {
    "given": "given",
    "tf": "from transforms",
    "floor": "from the floor",
    "file": "from a file",
    "people": "from people",
    "assumed": "assumed",
}

_USUAL_HEIGHT_M, _USUAL_PITCH_RAD = 1.25, 0.05
_HEIGHT_SPREAD, _PITCH_SPREAD = 0.45, 0.15  # Standard deviations of log height and pitch (rad) of unknown cameras.


UNKNOWN_HEIGHT, UNKNOWN_PITCH = 0.0, 2.0
"""Values of the parameters ``mount_height_m`` and ``pitch_rad`` of a camera whose pose is not known."""


class CameraPose(msgspec.Struct, frozen=True, kw_only=True):
    """Height above the floor (m), pitch (rad, down positive) and roll (rad, clockwise positive) of a camera.

    ``height_std_m``, ``pitch_std_rad`` and ``correlation`` describe the error. ``people`` have been observed for it.
    """

    height_m: float
    pitch_rad: float
    roll_rad: float = 0.0
    height_std_m: float = 0.0
    pitch_std_rad: float = 0.0
    correlation: float = 0.0
    source: PoseSource = "given"
    people: int = 0

    @classmethod
    def stated(cls, height_m: float, pitch_rad: float, known: CameraPose | None = None) -> CameraPose:
        """The pose of parameters, in which `UNKNOWN_HEIGHT` and `UNKNOWN_PITCH` are taken from ``known``.

        Args:
            height_m: Height, m, or `UNKNOWN_HEIGHT`.
            pitch_rad: Pitch, rad, or `UNKNOWN_PITCH`.
            known: Pose from a file or from transforms; default: `ASSUMED`.
        """
        pose = known or ASSUMED
        if pose.source == "given" and height_m <= UNKNOWN_HEIGHT and pitch_rad >= UNKNOWN_PITCH:
            return pose
        if height_m > UNKNOWN_HEIGHT:
            pose = msgspec.structs.replace(pose, height_m=height_m, height_std_m=0.0, correlation=0.0)
        if pitch_rad < UNKNOWN_PITCH:
            pose = msgspec.structs.replace(pose, pitch_rad=pitch_rad, pitch_std_rad=0.0, correlation=0.0)
        both = height_m > UNKNOWN_HEIGHT and pitch_rad < UNKNOWN_PITCH
        return msgspec.structs.replace(pose, source="given", roll_rad=0.0) if both else pose

    def __str__(self) -> str:
        height = f"{self.height_m:.2f}" + (f" +- {self.height_std_m:.2f}" if self.height_std_m else "")
        pitch = f"{self.pitch_rad:.3f}" + (f" +- {self.pitch_std_rad:.3f}" if self.pitch_std_rad else "")
        source = "1 person" if self.people == 1 else f"{self.people} people" if self.people else _SOURCES[self.source]
        return f"{height} m high, {pitch} rad down ({source})"


ASSUMED = CameraPose(
    height_m=_USUAL_HEIGHT_M,
    pitch_rad=_USUAL_PITCH_RAD,
    height_std_m=_HEIGHT_SPREAD * _USUAL_HEIGHT_M,
    pitch_std_rad=_PITCH_SPREAD,
    source="assumed",
)
"""Pose of a camera of which nothing is known."""


@dataclass(frozen=True)
class CameraModel:
    """A pinhole camera at a ``pose`` above the floor.

    ``fx``, ``fy``, ``cx``, ``cy`` in pixels of an image of ``width`` x ``height``. ``yaw_rad`` is the direction of the
    camera in the base of the robot, positive to the left, if it is known. Raises ParameterError when a focal length, a
    size or the height of the pose is not above zero.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    pose: CameraPose = ASSUMED
    yaw_rad: float | None = None

    def __post_init__(self) -> None:
        sizes = {"fx": self.fx, "fy": self.fy, "width": self.width, "height": self.height}
        for name, value in {**sizes, "pose.height_m": self.pose.height_m}.items():
            if not (math.isfinite(value) and value > 0):
                raise ParameterError(f"{value!r} is not above zero", where=f"camera model: {name}")

    @classmethod
    def from_info(cls, info: CameraInfo, pose: CameraPose = ASSUMED) -> CameraModel:
        """The camera of ``info``. Raises MessageError when it is not calibrated (focal length or size 0)."""
        where = f"camera_info of {info.frame_id or 'a camera without a frame'}"
        if len(info.k) != 9:
            raise MessageError(f"k has {len(info.k)} numbers, not 9", where=where)
        fx, _, cx, _, fy, cy = info.k[:6]
        if not all(math.isfinite(value) and value > 0 for value in (fx, fy, info.width, info.height)):
            raise MessageError(
                f"focal lengths {fx:g}, {fy:g} for {info.width}x{info.height} pixels",
                where=where,
                remedy="calibrate the camera, or let it publish no camera_info and set hfov_rad",
            )
        return cls(fx, fy, cx, cy, info.width, info.height, pose)

    @classmethod
    def from_field_of_view(cls, width: int, height: int, hfov_rad: float, pose: CameraPose = ASSUMED) -> CameraModel:
        """A camera with square pixels, its axis in the middle, that sees ``hfov_rad`` from left to right.

        Raises ParameterError when ``hfov_rad`` is not between 0 and pi.
        """
        if not 0 < hfov_rad < math.pi:
            raise ParameterError(f"{hfov_rad!r} rad is no field of view", where="hfov_rad", remedy="0 < hfov_rad < pi")
        focal = width / 2 / math.tan(hfov_rad / 2)
        return cls(focal, focal, width / 2, height / 2, width, height, pose)

    @classmethod
    def of_images(
        cls,
        info: CameraInfo | None,
        width: int,
        height: int,
        *,
        hfov_rad: float,
        pose: CameraPose,
    ) -> CameraModel:
        """The camera of images of ``width`` x ``height`` pixels; without ``info``, its field of view is ``hfov_rad``.

        Raises MessageError for an uncalibrated camera.
        """
        known = cls.from_field_of_view(width, height, hfov_rad, pose) if info is None else cls.from_info(info, pose)
        return known.scaled(width, height)

    def scaled(self, width: int, height: int) -> CameraModel:
        """The same camera with images scaled to ``width`` x ``height`` pixels."""
        across, down = width / self.width, height / self.height
        axes = {"fx": self.fx * across, "cx": self.cx * across, "fy": self.fy * down, "cy": self.cy * down}
        return replace(self, **axes, width=width, height=height)

    def direction(self, u: float, v: float) -> tuple[float, float]:
        """Bearing (rad, left positive) and elevation (rad, up positive) of the pixel at ``u``, ``v``."""
        right, down = (u - self.cx) / self.fx, (v - self.cy) / self.fy
        if self.pose.roll_rad:
            cos, sin = math.cos(self.pose.roll_rad), math.sin(self.pose.roll_rad)
            right, down = cos * right - sin * down, sin * right + cos * down
        forward = math.cos(self.pose.pitch_rad) - down * math.sin(self.pose.pitch_rad)
        up = -math.sin(self.pose.pitch_rad) - down * math.cos(self.pose.pitch_rad)
        return math.atan2(-right, forward), math.atan2(up, math.hypot(right, forward))

    def turn_from(self, before: CameraModel) -> np.ndarray | None:
        """Homography (3, 3) that moves far points of an image of the camera ``before`` to where this one shows them.

        None if the direction of either is unknown.
        """
        if self.yaw_rad is None or before.yaw_rad is None:
            return None
        turn = _rotation(self.pose, self.yaw_rad).T @ _rotation(before.pose, before.yaw_rad)
        return self._intrinsics() @ turn @ np.linalg.inv(before._intrinsics())

    def _intrinsics(self) -> np.ndarray:
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def at(self, pose: CameraPose) -> CameraModel:
        """The same camera at another ``pose``."""
        return replace(self, pose=pose)

    @property
    def horizon(self) -> float:
        """Height of the horizon as a share of the image: 0 at the top, 1 at the bottom; may be outside."""
        return (self.cy - self.fy * math.tan(self.pose.pitch_rad)) / self.height


def _rotation(pose: CameraPose, yaw_rad: float) -> np.ndarray:
    """Rotation of directions in the optical frame (right, down, forward) to the base (forward, left, up)."""
    cos, sin = (each((yaw_rad, pose.pitch_rad, pose.roll_rad)) for each in (np.cos, np.sin))
    yaw = np.array([[cos[0], -sin[0], 0.0], [sin[0], cos[0], 0.0], [0.0, 0.0, 1.0]])
    pitch = np.array([[cos[1], 0.0, sin[1]], [0.0, 1.0, 0.0], [-sin[1], 0.0, cos[1]]])
    roll = np.array([[cos[2], -sin[2], 0.0], [sin[2], cos[2], 0.0], [0.0, 0.0, 1.0]])
    return yaw @ pitch @ AXES[:3, :3].T @ roll


_FISHEYE = ("equidistant", "fisheye", "kannala_brandt", "kannala_brandt4")


def lens_error_rad(info: CameraInfo) -> float:
    """Largest error of a direction at the middles of the image's edges if the lens of ``info`` is taken as a pinhole.

    It is 0 for unknown distortion models.
    """
    fx, _, cx, _, fy, cy = info.k[:6]
    edges = ((-cx / fx, 0.0), ((info.width - cx) / fx, 0.0), (0.0, -cy / fy), (0.0, (info.height - cy) / fy))
    if info.distortion_model in _FISHEYE:
        angles = np.linspace(0.0, math.pi / 2, 1000)
        powers = angles[:, None] ** np.arange(3, 3 + 2 * len(info.d), 2)
        radii = np.maximum.accumulate(angles + powers @ np.array(info.d, np.float64))
        return max(
            abs(float(np.interp(math.hypot(*edge), radii, angles)) - math.atan(math.hypot(*edge))) for edge in edges
        )
    if info.distortion_model not in ("plumb_bob", "rational_polynomial") or len(info.d) not in (4, 5, 8, 12, 14):
        return 0.0
    straight = cv2.undistortPoints(np.array([edges], np.float64), np.eye(3), np.array(info.d, np.float64)).reshape(
        -1, 2
    )
    return max(
        abs(math.atan(math.hypot(*there)) - math.atan(math.hypot(*edge)))
        for there, edge in zip(straight.tolist(), edges, strict=True)
    )
