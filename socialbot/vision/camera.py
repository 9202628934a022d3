"""Cameras: intrinsics, pose above the floor, and the directions of pixels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from socialbot.core.errors import MessageError, ParameterError
from socialbot.core.messages import CameraInfo
from socialbot.core.paths import in_workspace, read_text
from socialbot.core.yaml import read_page
from socialbot.vision.lens import LENS_MODELS, Lens, is_known
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

_BENT_RAD = 0.05  # Largest change of the field of view by a lens that is nearly straight.
_WIDEST_SHAPE = 2.5  # Cinema has 2.4, two pictures of 4:3 have 2.67.
_SPHERE_SHAPE = 2  # A picture of all directions, and two round pictures; but also films of some phones.
_LENS_ERROR_RAD = 0.1  # Larger errors of directions are told.
_SAME_SHAPE = 0.02  # Logarithm of the ratio of two shapes of images that are the same, but for rounded sizes.

USUAL_HFOV_RAD = 1.09
"""Field of view that is assumed where nothing is known, along the longer side of the image, rad."""

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
        pitch = f"{round(self.pitch_rad, 3) + 0.0:.3f}" + (
            f" +- {self.pitch_std_rad:.3f}" if self.pitch_std_rad else ""
        )
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
    """A camera at a ``pose`` above the floor.

    ``fx``, ``fy``, ``cx``, ``cy`` in pixels of an image of ``width`` x ``height``. ``yaw_rad`` is the direction of the
    camera in the base of the robot, positive to the left, if it is known. ``lens`` is None for a pinhole and for
    rectified images. Raises ParameterError when a focal length, a size or the height of the pose is not above zero.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    pose: CameraPose = ASSUMED
    yaw_rad: float | None = None
    lens: Lens | None = None

    def __post_init__(self) -> None:
        names = ("fx", "fy", "width", "height", "pose.height_m")
        for name, value in zip(names, (self.fx, self.fy, self.width, self.height, self.pose.height_m), strict=True):
            if not 0 < value < math.inf:
                raise ParameterError(f"{value!r} is not above zero", where=f"camera model: {name}")

    @classmethod
    def from_info(cls, info: CameraInfo, pose: CameraPose = ASSUMED) -> CameraModel:
        """The camera of ``info``: its region of interest, if it has one.

        Raises:
            MessageError: It is not calibrated (focal length or size 0), or its distortion does not fit its model.
        """
        where = f"camera_info of {info.frame_id or 'a camera without a frame'}"
        if len(info.k) != 9:
            raise MessageError(f"k has {len(info.k)} numbers, not 9", where=where)
        fx, _, cx, _, fy, cy = info.k[:6]
        usable = all(math.isfinite(value) and value > 0 for value in (fx, fy, info.width, info.height))
        if not usable or not (math.isfinite(cx) and math.isfinite(cy)):
            raise MessageError(
                f"focal lengths {fx:g}, {fy:g} and middle {cx:g}, {cy:g} for {info.width}x{info.height} pixels",
                where=where,
                remedy="calibrate the camera, or let it publish no camera_info and set hfov_rad",
            )
        left, top, width, height = info.roi
        if not (width and height):
            left, top, width, height = 0, 0, info.width, info.height
        return cls(fx, fy, cx - left, cy - top, width, height, pose, lens=Lens.of(info))

    @classmethod
    def from_field_of_view(cls, width: int, height: int, hfov_rad: float, pose: CameraPose = ASSUMED) -> CameraModel:
        """A camera with square pixels, its axis in the middle, that sees ``hfov_rad`` from left to right.

        `USUAL_HFOV_RAD` is no known value: images that are higher than wide see it from top to bottom.
        Raises ParameterError when ``hfov_rad`` is not between 0 and pi.
        """
        if not 0 < hfov_rad < math.pi:
            raise ParameterError(f"{hfov_rad!r} rad is no field of view", where="hfov_rad", remedy="0 < hfov_rad < pi")
        across = max(width, height) if hfov_rad == USUAL_HFOV_RAD else width
        focal = across / 2 / math.tan(hfov_rad / 2)
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
        """The camera of images of ``width`` x ``height`` pixels.

        Without ``info``, or if it is not calibrated, the field of view is ``hfov_rad``. Raises MessageError for
        invalid intrinsics.
        """
        if info is None or not is_calibrated(info):
            return cls.from_field_of_view(width, height, hfov_rad, pose)
        return cls.from_info(info, pose).scaled(width, height)

    def scaled(self, width: int, height: int) -> CameraModel:
        """The same camera with images of ``width`` x ``height`` pixels.

        Images of another shape are those of a camera mode that cuts off both sides, or top and bottom.
        """
        across, down = width / self.width, height / self.height
        if self.is_cut_by(width, height):
            across = down = max(across, down)
        left, top = (across * self.width - width) / 2, (down * self.height - height) / 2
        axes = {"fx": self.fx * across, "cx": self.cx * across - left, "fy": self.fy * down, "cy": self.cy * down - top}
        return replace(self, **axes, width=width, height=height)

    def is_cut_by(self, width: int, height: int) -> bool:
        """Whether images of ``width`` x ``height`` pixels have another shape."""
        return abs(math.log(width / self.width * self.height / height)) > _SAME_SHAPE

    def point(self, u: float, v: float) -> tuple[float, float]:
        """The point x, y of the pixel ``u``, ``v`` on the plane 1 m before the camera: to the right and down, m."""
        x, y = (u - self.cx) / self.fx, (v - self.cy) / self.fy
        if self.lens is not None:
            right, down = self.lens.straightened(np.array(x), np.array(y))
            return float(right), float(down)
        return x, y

    def points(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same for many pixels."""
        x, y = (u - self.cx) / self.fx, (v - self.cy) / self.fy
        return (x, y) if self.lens is None else self.lens.straightened(x, y)

    def pixels(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The pixels of points on the plane 1 m before the camera; NaN where the lens has none."""
        if self.lens is not None:
            x, y = self.lens.bent(x, y)
        return self.cx + self.fx * x, self.cy + self.fy * y

    def direction(self, u: float, v: float) -> tuple[float, float]:
        """Bearing (rad, left positive) and elevation (rad, up positive) of the pixel at ``u``, ``v``."""
        right, down = self.point(u, v)
        if self.pose.roll_rad:
            cos, sin = math.cos(self.pose.roll_rad), math.sin(self.pose.roll_rad)
            right, down = cos * right - sin * down, sin * right + cos * down
        forward = math.cos(self.pose.pitch_rad) - down * math.sin(self.pose.pitch_rad)
        up = -math.sin(self.pose.pitch_rad) - down * math.cos(self.pose.pitch_rad)
        return math.atan2(-right, forward), math.atan2(up, math.hypot(right, forward))

    def turn_from(self, before: CameraModel) -> np.ndarray | None:
        """Homography (3, 3) that moves far points of an image of the camera ``before`` to where this one shows them.

        None if the direction of either is unknown, or the lens bends the image too much for a homography.
        """
        if self.yaw_rad is None or before.yaw_rad is None or self._is_bent() or before._is_bent():
            return None
        turn = _rotation(self.pose, self.yaw_rad).T @ _rotation(before.pose, before.yaw_rad)
        return self._intrinsics() @ turn @ np.linalg.inv(before._intrinsics())

    def _is_bent(self) -> bool:
        return self.lens is not None and abs(self.hfov_rad - replace(self, lens=None).hfov_rad) > _BENT_RAD

    def _intrinsics(self) -> np.ndarray:
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def at(self, pose: CameraPose) -> CameraModel:
        """The same camera at another ``pose``."""
        return replace(self, pose=pose)

    @property
    def horizon(self) -> float:
        """Height of the horizon as a share of the image: 0 at the top, 1 at the bottom; may be outside."""
        _, v = self.pixels(np.zeros(()), np.array(-math.tan(self.pose.pitch_rad)))
        return float(v) / self.height if math.isfinite(v) else math.copysign(1e6, -self.pose.pitch_rad)

    @property
    def hfov_rad(self) -> float:
        """Horizontal field of view."""
        edges = (self.point(u, self.cy)[0] for u in (0.0, self.width))
        left, right = map(math.atan, edges)
        return right - left


def _rotation(pose: CameraPose, yaw_rad: float) -> np.ndarray:
    """Rotation of directions in the optical frame (right, down, forward) to the base (forward, left, up)."""
    cos, sin = (each((yaw_rad, pose.pitch_rad, pose.roll_rad)) for each in (np.cos, np.sin))
    yaw = np.array([[cos[0], -sin[0], 0.0], [sin[0], cos[0], 0.0], [0.0, 0.0, 1.0]])
    pitch = np.array([[cos[1], 0.0, sin[1]], [0.0, 1.0, 0.0], [-sin[1], 0.0, cos[1]]])
    roll = np.array([[cos[2], -sin[2], 0.0], [sin[2], cos[2], 0.0], [0.0, 0.0, 1.0]])
    return yaw @ pitch @ AXES[:3, :3].T @ roll


def lens_error_rad(info: CameraInfo) -> float:
    """Largest error of a direction at the middles of the image's edges if the lens of ``info`` is taken as a pinhole.

    It is 0 for unknown distortion models.
    """
    bent = CameraModel.from_info(info)
    straight = replace(bent, lens=None)
    edges = ((0.0, bent.cy), (bent.width, bent.cy), (bent.cx, 0.0), (bent.cx, bent.height))
    angles = ([math.atan(math.hypot(*camera.point(*edge))) for edge in edges] for camera in (bent, straight))
    return max(abs(one - other) for one, other in zip(*angles, strict=True))


def intrinsics_problems(info: CameraInfo | None, width: int, height: int, hfov_rad: float) -> list[str]:
    """What is assumed of the intrinsics of images of ``width`` x ``height`` pixels, and what is doubtful in ``info``.

    Without intrinsics, the field of view is ``hfov_rad``. Raises MessageError for invalid intrinsics.
    """
    problems = [shape_problem(width, height)] if info is None or not is_calibrated(info) else []
    problems = list(filter(None, problems))
    if info is None:
        return [*problems, f"no camera_info yet: distances assume a field of view of {hfov_rad:.2f} rad"]
    if not is_calibrated(info):
        problems.append(
            f"camera_info of {info.frame_id or 'the camera'} is not calibrated (k is 0): distances assume a field "
            f"of view of {hfov_rad:.2f} rad; calibrate the camera, or set hfov_rad"
        )
        return problems
    error = lens_error_rad(info)
    if not is_known(info):
        problems.append(
            f"the distortion model {info.distortion_model!r} is not known, so the lens is taken as straight: "
            f"rectify the images, for example with image_proc, or use one of {', '.join(LENS_MODELS)}"
        )
    elif error > _LENS_ERROR_RAD:
        problems.append(
            f"the lens ({info.distortion_model}) bends directions at the edge of the image by {error:.2f} rad: "
            "directions and distances are corrected, but people look bent there, and may be missed; "
            "rectified images are better, for example by image_proc with rectified: true"
        )
    return [*problems, *filter(None, [size_problem(info, width, height)])]


def size_problem(info: CameraInfo, width: int, height: int) -> str:
    """That the intrinsics ``info`` are those of images of another size; empty if they are not."""
    known = CameraModel.from_info(info)
    if (known.width, known.height) == (width, height):
        return ""
    cut = known.is_cut_by(width, height)
    return (
        f"camera_info is for {known.width}x{known.height} pixels but images have {width}x{height}: "
        f"its intrinsics are scaled{', as if the sides of another shape were cut off' if cut else ''}"
    )


def shape_problem(width: int, height: int) -> str:
    """Why images of unknown intrinsics cannot be those of one lens, by their shape; empty if they can."""
    if width <= _WIDEST_SHAPE * height and width != _SPHERE_SHAPE * height:
        return ""
    are = "are" if width > _WIDEST_SHAPE * height else "may be"
    return (
        f"images of {width}x{height} {are} a panorama or pictures side by side: directions and distances are wrong "
        "then, since one straight lens is assumed; use one picture of one lens, with its camera_info"
    )


def is_calibrated(info: CameraInfo) -> bool:
    """Whether ``info`` has intrinsics: in ROS, a driver without a calibration leaves ``k`` zeroed."""
    return len(info.k) != 9 or any(info.k)


class _Matrix(msgspec.Struct):
    data: list[float]
    rows: int = 0
    cols: int = 0


_Pixels = Annotated[int, msgspec.Meta(ge=1, le=65_535, description="a number of pixels")]


class _Calibration(msgspec.Struct):
    image_width: _Pixels
    image_height: _Pixels
    camera_matrix: _Matrix
    distortion_coefficients: _Matrix
    distortion_model: str = "plumb_bob"
    camera_name: str = ""
    rectification_matrix: _Matrix | None = None
    projection_matrix: _Matrix | None = None


def read_calibration(path: Path) -> CameraInfo:
    """Intrinsics in a YAML file of ROS, as camera_calibration and camera_info_manager write it.

    Raises:
        ParameterError: The file cannot be read, or is no such calibration.
    """
    if path.suffix in (".ini", ".txt"):
        remedy = "give the file in YAML: camera_calibration writes ost.yaml beside ost.txt"
        raise ParameterError("a calibration in the INI format is not read", where=str(path), remedy=remedy)
    page = read_page(read_text(path, ParameterError), where=str(path), error=ParameterError, foreign=True)
    found = page.read(_Calibration)
    info = CameraInfo(
        stamp=0, frame_id="", width=found.image_width, height=found.image_height, k=tuple(found.camera_matrix.data),
        d=tuple(found.distortion_coefficients.data), distortion_model=found.distortion_model,
    )  # fmt: skip
    try:
        CameraModel.from_info(info)
    except MessageError as error:
        remedy = "calibrate the camera again: ros2 run camera_calibration cameracalibrator"
        raise ParameterError(error.what, where=str(path), remedy=remedy) from error
    return info


def calibration_file(url: str) -> Path:
    """Path of a ``camera_info_url``. Raises ParameterError for other URLs than those of files."""
    kind, is_url, path = url.rpartition("://")
    if is_url and kind != "file":
        remedy = "give the path of the file, with or without file://"
        raise ParameterError(f"no file: {url!r}", where="camera_info_url", remedy=remedy)
    return Path(path).expanduser()


def calibration_at(url: str, *, where: str, rectified: bool = False) -> CameraInfo | None:
    """Intrinsics at the ``camera_info_url`` of a node; None if it is empty.

    Those of ``rectified`` images have no distortion. Raises ParameterError as `read_calibration` does, and for a file
    outside the folders that the user allows; ``where`` names the parameter.
    """
    if not url:
        return None
    info = read_calibration(in_workspace(calibration_file(url), where=where))
    return without_lens(info) if rectified else info


def calibrated_info(info: CameraInfo | None, calibration: CameraInfo | None) -> CameraInfo | None:
    """The intrinsics of a topic, or those of a file if it has none or is not calibrated."""
    is_usable = info is not None and is_calibrated(info)
    return info if is_usable or calibration is None else calibration


def scaled_info(info: CameraInfo, width: int, height: int) -> CameraInfo:
    """The intrinsics ``info`` for images of ``width`` x ``height`` pixels. Raises MessageError as `from_info` does."""
    camera = CameraModel.from_info(info).scaled(width, height)
    k = (camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0)
    return msgspec.structs.replace(info, width=width, height=height, k=k, roi=(0, 0, 0, 0))


def without_lens(info: CameraInfo) -> CameraInfo:
    """The ``info`` of rectified images: without distortion."""
    return msgspec.structs.replace(info, d=(), distortion_model="plumb_bob")
