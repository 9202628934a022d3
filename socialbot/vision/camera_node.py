"""Image sources (device, video file, folder), and the node that publishes images."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

import cv2
import msgspec
import numpy as np

from socialbot.bags.image_files import SUFFIXES, check_video, decoder_limit, read_image, too_many_pixels, unread_images
from socialbot.bags.reader import natural
from socialbot.core import paths
from socialbot.core.clock import nanoseconds
from socialbot.core.errors import DeviceError, ImageError
from socialbot.core.limits import DECODER_BYTES, IMAGE_PIXELS
from socialbot.core.memory_limit import memory_limit
from socialbot.core.messages import CameraInfo, Image
from socialbot.graph.node import Context, Node, Timer
from socialbot.graph.ports import Delivery, Output, Parameter
from socialbot.vision.camera import (
    USUAL_HFOV_RAD,
    CameraModel,
    calibration_at,
    scaled_info,
    shape_problem,
    size_problem,
)

_USUAL_RATE_HZ = 30.0
_FOLDER_RATE_HZ = 10.0


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
        try:
            check_video(source)
        except ImageError as error:
            raise DeviceError(error.what, where=source, remedy=error.remedy) from error
        return _VideoFrames(source)
    raise DeviceError("no such camera, video file or folder", where=repr(source), remedy="check the parameter 'source'")


class _VideoFrames:
    def __init__(self, source: str | int) -> None:
        self._source = source
        with memory_limit(DECODER_BYTES):
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
        if width * height > IMAGE_PIXELS:
            self._capture.release()
            raise DeviceError(too_many_pixels(), where=str(self._source), remedy="use smaller images")

    def read(self) -> np.ndarray | None:
        with decoder_limit(self._capture):
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
            if os.path.exists(path) and not os.access(path, os.R_OK | os.W_OK):
                remedy = "add the user to the group 'video', and log in again"
                raise DeviceError("no permission to use the camera", where=path, remedy=remedy) from None
            remedy = "end other programs that use it, or choose one of /dev/video* that takes pictures"
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
        self._paths = sorted((path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES), key=natural)
        self._next = 0
        if not self._paths:
            remedy = unread_images(folder) or "put jpg or png files there"
            raise DeviceError("no images in this folder", where=str(folder), remedy=remedy)
        height, width = read_image(self._paths[0]).shape[:2]
        self.size = (width, height)

    def read(self) -> np.ndarray | None:
        if self._next == len(self._paths):
            return None
        self._next += 1
        return read_image(self._paths[self._next - 1])

    def close(self) -> None:
        self._paths = self._paths[: self._next]


_RETRY_S = 2.0
_RETRIED = f"retried every {_RETRY_S:g} s"
_DEVICES = Path("/dev")


class Camera(Node):
    """Publishes images at a steady rate, and the intrinsics of the camera once.

    A missing or lost camera is reported once and retried every two seconds. A file stops at its end, or restarts with
    ``loop``; if that fails, it is retried like a camera.
    """

    image_raw = Output(Image, "/camera/image_raw", Delivery.NEWEST)
    camera_info = Output(CameraInfo, "/camera/camera_info", Delivery.LATCHED)

    source = Parameter("0", "camera index, device file, video file or folder of images", fixed=True)
    rate_hz = Parameter(0.0, "images per second; 0: the rate of the source", minimum=0.0, maximum=1000.0)
    loop = Parameter(False, "restart a file or folder at its end")
    width = Parameter(0, "width of the images, pixels; 0: that of the source", minimum=0, maximum=16384, fixed=True)
    height = Parameter(0, "height of the images, pixels; 0: that of the source", minimum=0, maximum=16384, fixed=True)
    hfov_rad = Parameter(USUAL_HFOV_RAD, "horizontal field of view, rad", minimum=0.1, maximum=3.0)
    camera_info_url = Parameter(
        "", "calibration of the camera, a file of camera_calibration in YAML; it replaces hfov_rad", fixed=True
    )
    frame_id = Parameter("camera_color_optical_frame", "name of the camera's frame", fixed=True)

    @classmethod
    def expect_available(cls, parameters: Mapping[str, object]) -> None:
        """Raise DeviceError for a file or folder without images; a camera may be plugged in later."""
        source = str(parameters.get("source", cls.source.default))
        if not is_device(source):
            open_frames(source).close()

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._frames: Frames | None = None
        self._timer: Timer | None = None
        self._told = ""
        self._due = 0
        self._calibration: CameraInfo | None = None

    def start(self) -> None:
        """Open the source.

        Raises:
            DeviceError: The file or folder cannot be read.
            ImageError: Its first image is damaged.
            ParameterError: It is outside the folders that the user allows, or the calibration cannot be used.
        """
        self._calibration = calibration_at(self.camera_info_url, where=f"{self.name}.camera_info_url")
        if self._calibration is not None and self.hfov_rad != USUAL_HFOV_RAD:
            self.log.warning("hfov_rad has no effect: camera_info_url gives the intrinsics")
        if not self.source.isdecimal():
            paths.within(self.source, (*paths.workspace(), _DEVICES), where=f"{self.name}.source")
        self._due = self.clock.now()
        try:
            self._open()
        except DeviceError as error:
            if not is_device(self.source):
                raise
            problem = f"{error.where}: {error.what}; {error.remedy}; {_RETRIED}"
            self.report_health("failed", problem)
            self.log.warning(problem)
            self._schedule_retry()
            return
        if isinstance(self._frames, _FolderFrames) and (unread := unread_images(Path(self.source))):
            self.log.warning("%s: %s", self.source, unread)
        self._publish_info()
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
                    self.report_health("failed", f"{self.source}: cannot be opened again; restore it; {_RETRIED}")
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
        what, remedy = "the camera sends no more images", f"check the connection; {_RETRIED}"
        self.report_health("failed", f"{self.source}: {what}; {remedy}")
        raise DeviceError(what, where=self.source, remedy=remedy)

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
        if self._calibration is not None:
            problem = size_problem(self._calibration, width, height)
            info = scaled_info(self._calibration, width, height)
        else:
            problem = shape_problem(*self._frames.size)
            model = CameraModel.from_field_of_view(width, height, self.hfov_rad)
            k = (model.fx, 0.0, model.cx, 0.0, model.fy, model.cy, 0.0, 0.0, 1.0)
            info = CameraInfo(stamp=0, frame_id="", width=width, height=height, k=k, d=(0.0,) * 5)
        if problem and problem != self._told:
            self.log.warning("%s: %s", self.source, problem)
        self._told = problem
        stamped = {"stamp": self.clock.now(), "frame_id": self.frame_id}
        self.camera_info.publish(msgspec.structs.replace(info, **stamped))
