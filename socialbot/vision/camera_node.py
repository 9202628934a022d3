"""The node that publishes the pictures of a camera, a video file or a folder of images."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from socialbot.clock import nanoseconds
from socialbot.errors import DeviceError, ImageError
from socialbot.graph import Context, Delivery, Node, Output, Parameter, Timer
from socialbot.messages import CameraInfo, Image
from socialbot.security import paths
from socialbot.vision.camera import CameraModel
from socialbot.vision.frames import Frames, is_device, open_frames

__all__ = ["Camera"]

_RETRY_S = 2.0
_DEVICES = Path("/dev")


class Camera(Node):
    """Publishes pictures at a steady rate, and once the camera's intrinsics.

    A camera that vanishes is an error once; then it is looked for every two seconds. A file
    that ends stops quietly, or begins again with ``loop``; one that cannot is looked for like a camera.
    """

    image_raw = Output(Image, "/camera/image_raw", Delivery.NEWEST)
    camera_info = Output(CameraInfo, "/camera/camera_info", Delivery.LATCHED)

    source = Parameter("0", "camera index, device file, video file or folder of images", fixed=True)
    rate_hz = Parameter(0.0, "pictures a second; 0: the source's own rate", minimum=0.0, maximum=1000.0)
    loop = Parameter(False, "begin a file or folder again when it ends")
    width = Parameter(0, "width of the pictures, pixels; 0: the source's own", minimum=0, maximum=16384, fixed=True)
    height = Parameter(0, "height of the pictures, pixels; 0: the source's own", minimum=0, maximum=16384, fixed=True)
    hfov_rad = Parameter(1.09, "horizontal field of view, rad", minimum=0.1, maximum=3.0)
    frame_id = Parameter("camera_color_optical_frame", "name of the camera's frame", fixed=True)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._frames: Frames | None = None
        self._timer: Timer | None = None
        self._due = 0

    def start(self) -> None:
        """Raises DeviceError when there is no such source, ImageError when its first image is damaged.

        Raises ParameterError for a file or folder outside of those that the user allows.
        """
        if not self.source.isdecimal():
            paths.within(self.source, (*paths.workspace(), _DEVICES), where=f"{self.name}.source")
        self._frames = self._open()
        self._publish_info()
        self._due = self.clock.now()
        self._timer = self.call_after(0.0, self._tick)

    def stop(self) -> None:
        if self._timer:
            self._timer.cancel()
        self._close()

    def on_parameter(self, name: str) -> None:
        if name == "hfov_rad" and self._frames:
            self._publish_info()

    def _open(self) -> Frames:
        return open_frames(self.source, width=self.width, height=self.height)

    def _close(self) -> None:
        if self._frames:
            self._frames.close()
            self._frames = None

    def _tick(self) -> None:
        """Publishes one picture; the next is arranged for first, so that a damaged one stops nothing."""
        if self._frames is None:
            return
        self._arrange_next(self._frames)
        pixels = self._read(self._frames)
        if pixels is None:
            self._on_end()
        else:
            self._publish(pixels)

    def _arrange_next(self, frames: Frames) -> None:
        """Keeps the rate without drift; what is a whole period late begins a new beat."""
        period, now = nanoseconds(1 / (self.rate_hz or frames.rate_hz)), self.clock.now()
        due = self._due + period
        self._due = due if due > now else now + period
        self._timer = self.context.call_at(self._due, self._tick)

    def _read(self, frames: Frames) -> np.ndarray | None:
        pixels = frames.read()
        if pixels is not None or not self.loop or is_device(self.source):
            return pixels
        self._close()
        try:
            self._frames = self._open()
        except (DeviceError, ImageError):
            self._look_again()
            self.say_health("failed", f"{self.source} cannot begin again")
            raise
        return self._frames.read()

    def _on_end(self) -> None:
        self._close()
        if not (self.loop or is_device(self.source)):
            if self._timer:
                self._timer.cancel()
            self.log.info("%s has ended", self.source)
            self.say_health("waiting", f"{self.source} has ended")
            return
        self._look_again()
        self.say_health("failed", f"{self.source} sends no more pictures")
        raise DeviceError(
            "the camera sends no more pictures",
            where=self.source,
            remedy=f"check that it is there; it is tried again every {_RETRY_S:g} s",
        )

    def _look_again(self) -> None:
        if self._timer:
            self._timer.cancel()
        self._timer = self.call_after(_RETRY_S, self._reopen)

    def _reopen(self) -> None:
        """Looks for a camera that has vanished; it is back when it gives a picture."""
        self._look_again()
        try:
            self._frames = self._open()
            pixels = self._frames.read()
        except (DeviceError, ImageError):
            pixels = None
        if self._frames is None or pixels is None:
            self._close()
            return
        if self._timer:
            self._timer.cancel()
        self.log.info("camera %s is back", self.source)
        self.say_health("ok")
        self._publish_info()
        self._publish(pixels)
        self._arrange_next(self._frames)

    def _publish(self, pixels: np.ndarray) -> None:
        self.image_raw.publish(Image.from_bgr(self._fitted(pixels), stamp=self.clock.now(), frame_id=self.frame_id))

    def _fitted(self, pixels: np.ndarray) -> np.ndarray:
        height, width = pixels.shape[:2]
        size = self._size(width, height)
        return pixels if size == (width, height) else cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)

    def _size(self, width: int, height: int) -> tuple[int, int]:
        """The size to publish for a picture of ``width`` x ``height``; one given alone keeps the proportions."""
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
