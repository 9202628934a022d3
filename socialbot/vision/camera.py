"""Camera geometry, image sources (device, video file, folder), and the node that publishes images."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Protocol

import cv2
import msgspec
import numpy as np

from socialbot.core import paths
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import DeviceError, ImageError, MessageError, ParameterError
from socialbot.core.messages import CameraInfo, Image
from socialbot.graph.node import Context, Delivery, Node, Output, Parameter, Timer

Box = Sequence[float]
"""x, y, w, h in pixels."""


PoseSource = Literal["given", "tf", "floor", "file", "people", "assumed"]
"""Where a pose comes from: parameters, transforms, points of the floor, a pose file, people in view, or nowhere."""

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
        height = f"{self.height_m:.2f} +- {self.height_std_m:.2f} m"
        pitch = f"{self.pitch_rad:.3f} +- {self.pitch_std_rad:.3f} rad down"
        return f"{height} high, {pitch}"


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
    """A pinhole camera at ``mount_height_m`` above the floor, looking down by ``pitch_rad``.

    ``fx``, ``fy``, ``cx``, ``cy`` in pixels of an image of ``width`` x ``height``. The other fields are those of
    `CameraPose`. Raises ParameterError when
    a focal length, a size or the mount height is not above zero.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    mount_height_m: float = 1.62
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    height_std_m: float = 0.0
    pitch_std_rad: float = 0.0
    pose_correlation: float = 0.0
    pose_source: PoseSource = "given"

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "width", "height", "mount_height_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ParameterError(f"{value!r} is not above zero", where=f"camera model: {name}")

    @classmethod
    def from_info(cls, info: CameraInfo, *, mount_height_m: float = 1.62, pitch_rad: float = 0.0) -> CameraModel:
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
        return cls(fx, fy, cx, cy, info.width, info.height, mount_height_m, pitch_rad)

    @classmethod
    def from_field_of_view(
        cls, width: int, height: int, hfov_rad: float, *, mount_height_m: float = 1.62, pitch_rad: float = 0.0
    ) -> CameraModel:
        """A camera with square pixels, its axis in the middle, that sees ``hfov_rad`` from left to right.

        Raises ParameterError when ``hfov_rad`` is not between 0 and pi.
        """
        if not 0 < hfov_rad < math.pi:
            raise ParameterError(f"{hfov_rad!r} rad is no field of view", where="hfov_rad", remedy="0 < hfov_rad < pi")
        focal = width / 2 / math.tan(hfov_rad / 2)
        return cls(focal, focal, width / 2, height / 2, width, height, mount_height_m, pitch_rad)

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
        known = cls.from_field_of_view(width, height, hfov_rad) if info is None else cls.from_info(info)
        return known.scaled(width, height).at(pose)

    def scaled(self, width: int, height: int) -> CameraModel:
        """The same camera with images scaled to ``width`` x ``height`` pixels."""
        across, down = width / self.width, height / self.height
        axes = {"fx": self.fx * across, "cx": self.cx * across, "fy": self.fy * down, "cy": self.cy * down}
        return replace(self, **axes, width=width, height=height)

    def direction(self, u: float, v: float) -> tuple[float, float]:
        """Bearing (rad, left positive) and elevation (rad, up positive) of the pixel at ``u``, ``v``."""
        right, down = (u - self.cx) / self.fx, (v - self.cy) / self.fy
        if self.roll_rad:
            cos, sin = math.cos(self.roll_rad), math.sin(self.roll_rad)
            right, down = cos * right - sin * down, sin * right + cos * down
        forward = math.cos(self.pitch_rad) - down * math.sin(self.pitch_rad)
        up = -math.sin(self.pitch_rad) - down * math.cos(self.pitch_rad)
        return math.atan2(-right, forward), math.atan2(up, math.hypot(right, forward))

    def at(self, pose: CameraPose) -> CameraModel:
        """The same camera at another ``pose``."""
        return replace(
            self,
            mount_height_m=pose.height_m,
            pitch_rad=pose.pitch_rad,
            roll_rad=pose.roll_rad,
            height_std_m=pose.height_std_m,
            pitch_std_rad=pose.pitch_std_rad,
            pose_correlation=pose.correlation,
            pose_source=pose.source,
        )

    @property
    def pose(self) -> CameraPose:
        """Pose above the floor."""
        return CameraPose(
            height_m=self.mount_height_m,
            pitch_rad=self.pitch_rad,
            roll_rad=self.roll_rad,
            height_std_m=self.height_std_m,
            pitch_std_rad=self.pitch_std_rad,
            correlation=self.pose_correlation,
            source=self.pose_source,
        )

    @property
    def horizon(self) -> float:
        """Height of the horizon as a share of the image: 0 at the top, 1 at the bottom; may be outside."""
        return (self.cy - self.fy * math.tan(self.pitch_rad)) / self.height


_IMAGES = frozenset({".bmp", ".jpeg", ".jpg", ".png", ".ppm", ".tif", ".tiff", ".webp"})
_USUAL_RATE_HZ = 30.0
_FOLDER_RATE_HZ = 10.0


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


class Frames(Protocol):
    """Sequence of images."""

    rate_hz: float
    """Images per second; a default for folders."""
    size: tuple[int, int]
    """Width and height of the first image, pixels."""

    def read(self) -> np.ndarray | None:
        """The next image, shape (height, width, 3), uint8, BGR; None at the end.

        Raises ImageError for a damaged image; the next call reads the one after it.
        """
        ...

    def close(self) -> None:
        """Release the camera or file."""
        ...


def is_device(source: str) -> bool:
    """Whether ``source`` names a camera: an index ("0") or a device file ("/dev/video0")."""
    return source.isdecimal() or source.startswith("/dev/")


def open_frames(source: str, *, width: int = 0, height: int = 0) -> Frames:
    """Open ``source``; a camera is asked for ``width`` x ``height`` pixels (0: its default).

    Raises:
        DeviceError: The camera, file or folder does not exist or has no images.
    """
    if is_device(source):
        return _CameraFrames(source, width, height)
    path = Path(source)
    if path.is_dir():
        return _FolderFrames(path)
    if path.is_file():
        return _VideoFrames(source)
    raise DeviceError("no such camera, video file or folder", where=repr(source), remedy="check the parameter 'source'")


class _VideoFrames:
    def __init__(self, source: str | int) -> None:
        self._capture = cv2.VideoCapture(source)
        if not self._capture.isOpened():
            self._capture.release()
            raise DeviceError("cannot be opened", where=str(source), remedy="check that it is a video and not damaged")
        self._read_properties()

    def _read_properties(self) -> None:
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self.rate_hz = rate if 0 < rate < 1000 else _USUAL_RATE_HZ
        width, height = (self._capture.get(each) for each in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        self.size = (int(width), int(height))

    def read(self) -> np.ndarray | None:
        good, pixels = self._capture.read()
        return pixels if good else None

    def close(self) -> None:
        self._capture.release()


class _CameraFrames(_VideoFrames):
    def __init__(self, source: str, width: int, height: int) -> None:
        path = f"/dev/video{source}" if source.isdecimal() else source
        # OpenCV writes long complaints about a missing device to stderr.
        if sys.platform == "linux" and not Path(path).exists():
            raise DeviceError("no such camera", where=path, remedy="plug it in, or choose one of /dev/video*")
        try:
            super().__init__(int(source) if source.isdecimal() else source)
        except DeviceError:
            remedy = "is another program using it? may you read it (group 'video')?"
            raise DeviceError("the camera cannot be opened", where=path, remedy=remedy) from None
        # A longer buffer delivers old images to a slow reader.
        settings = {cv2.CAP_PROP_FRAME_WIDTH: width, cv2.CAP_PROP_FRAME_HEIGHT: height, cv2.CAP_PROP_BUFFERSIZE: 1}
        for name, value in settings.items():
            if value:
                self._capture.set(name, value)
        self._read_properties()


class _FolderFrames:
    """Images of a folder in natural order, 2 before 10."""

    rate_hz = _FOLDER_RATE_HZ

    def __init__(self, folder: Path) -> None:
        self._paths = sorted((path for path in folder.iterdir() if path.suffix.lower() in _IMAGES), key=_natural)
        self._next = 0
        if not self._paths:
            raise DeviceError("no images in this folder", where=str(folder), remedy="put jpg or png files there")
        height, width = _load(self._paths[0]).shape[:2]
        self.size = (width, height)

    def read(self) -> np.ndarray | None:
        if self._next == len(self._paths):
            return None
        self._next += 1
        return _load(self._paths[self._next - 1])

    def close(self) -> None:
        self._paths = self._paths[: self._next]


def _natural(path: Path) -> tuple[list[tuple[int, str]], str]:
    words = re.split(r"(\d+)", path.name)
    return [(int(word), "") if word.isdecimal() else (-1, word) for word in words], path.name


def _load(path: Path) -> np.ndarray:
    pixels = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if pixels is None:
        raise ImageError("cannot be decoded", where=str(path), remedy="remove or replace this image")
    return pixels


_RETRY_S = 2.0
_DEVICES = Path("/dev")


class Camera(Node):
    """Publishes images at a steady rate, and the intrinsics of the camera once.

    A lost camera is reported once and retried every two seconds. A file stops at its end, or restarts with ``loop``; if
    that fails, it is retried like a camera.
    """

    image_raw = Output(Image, "/camera/image_raw", Delivery.NEWEST)
    camera_info = Output(CameraInfo, "/camera/camera_info", Delivery.LATCHED)

    source = Parameter("0", "camera index, device file, video file or folder of images", fixed=True)
    rate_hz = Parameter(0.0, "images per second; 0: the rate of the source", minimum=0.0, maximum=1000.0)
    loop = Parameter(False, "restart a file or folder at its end")
    width = Parameter(0, "width of the images, pixels; 0: that of the source", minimum=0, maximum=16384, fixed=True)
    height = Parameter(0, "height of the images, pixels; 0: that of the source", minimum=0, maximum=16384, fixed=True)
    hfov_rad = Parameter(1.09, "horizontal field of view, rad", minimum=0.1, maximum=3.0)
    frame_id = Parameter("camera_color_optical_frame", "name of the camera's frame", fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._frames: Frames | None = None
        self._timer: Timer | None = None
        self._due = 0

    def start(self) -> None:
        """Open the source.

        Raises:
            DeviceError: The source does not exist.
            ImageError: Its first image is damaged.
            ParameterError: It is outside the folders that the user allows.
        """
        if not self.source.isdecimal():
            paths.within(self.source, (*paths.workspace(), _DEVICES), where=f"{self.name}.source")
        self._open()
        self._publish_info()
        self._due = self.clock.now()
        self._schedule(self._due, self._tick)

    def stop(self) -> None:
        if self._timer:
            self._timer.cancel()
        self._close()

    def on_parameter(self, name: str) -> None:
        if name == "hfov_rad":
            self._publish_info()

    def _open(self) -> Frames:
        self._frames = open_frames(self.source, width=self.width, height=self.height)
        return self._frames

    def _close(self) -> None:
        if self._frames:
            self._frames.close()
            self._frames = None

    def _schedule(self, due: int, callback: Callable[[], None]) -> None:
        if self._timer:
            self._timer.cancel()
        self._timer = self.context.call_at(due, callback)

    def _schedule_next(self, frames: Frames) -> None:
        """Schedule the next image without drift; restart the schedule after a delay of a whole period."""
        period, now = nanoseconds(1 / (self.rate_hz or frames.rate_hz)), self.clock.now()
        due = self._due + period
        self._due = due if due > now else now + period
        self._schedule(self._due, self._tick)

    def _schedule_retry(self) -> None:
        self._schedule(self.clock.now() + nanoseconds(_RETRY_S), self._reopen)

    def _tick(self) -> None:
        """Publish one image. The next one is scheduled first, so that a damaged image does not stop the node."""
        if self._frames is None:
            return
        self._schedule_next(self._frames)
        pixels = self._frames.read()
        if pixels is None and self.loop and not is_device(self.source):
            self._close()
            try:
                pixels = self._open().read()
            except (DeviceError, ImageError):
                if self._frames is None:
                    self._schedule_retry()
                    self.report_health("failed", f"{self.source} cannot be opened again")
                raise
        if pixels is None:
            self._on_end()
        else:
            self._publish(pixels)

    def _on_end(self) -> None:
        self._close()
        if not (self.loop or is_device(self.source)):
            if self._timer:
                self._timer.cancel()
            self.log.info("%s has ended", self.source)
            self.report_health("waiting", f"{self.source} has ended")
            return
        self._schedule_retry()
        self.report_health("failed", f"{self.source} sends no more images")
        raise DeviceError(
            "the camera sends no more images",
            where=self.source,
            remedy=f"check the connection; it is retried every {_RETRY_S:g} s",
        )

    def _reopen(self) -> None:
        """Retry a lost source; it is back when it delivers an image."""
        self._schedule_retry()
        try:
            pixels = self._open().read()
        except (DeviceError, ImageError):
            pixels = None
        if pixels is None or self._frames is None:
            self._close()
            return
        self.log.info("camera %s is back", self.source)
        self.report_health("ok")
        self._publish_info()
        self._publish(pixels)
        self._schedule_next(self._frames)

    def _publish(self, pixels: np.ndarray) -> None:
        height, width = pixels.shape[:2]
        size = self._size(width, height)
        if size != (width, height):
            pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
        self.image_raw.publish(Image.from_bgr(pixels, stamp=self.clock.now(), frame_id=self.frame_id))

    def _size(self, width: int, height: int) -> tuple[int, int]:
        """Published size of an image; width or height alone keeps the aspect ratio."""
        if not self.width and not self.height:
            return width, height
        return (
            self.width or max(1, round(width * self.height / height)),
            self.height or max(1, round(height * self.width / width)),
        )

    def _publish_info(self) -> None:
        if not self._frames:
            return
        width, height = self._size(*self._frames.size)
        model = CameraModel.from_field_of_view(width, height, self.hfov_rad)
        k = (model.fx, 0.0, model.cx, 0.0, model.fy, model.cy, 0.0, 0.0, 1.0)
        self.camera_info.publish(
            CameraInfo(stamp=self.clock.now(), frame_id=self.frame_id, width=width, height=height, k=k, d=(0.0,) * 5)
        )
