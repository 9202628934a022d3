"""Makes a bag of pictures from elsewhere: a video file, a folder of images or a camera."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from socialbot.bags.reader import natural
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND, Clock, WallClock, nanoseconds
from socialbot.core.errors import BagError, ParameterError, SocialbotError
from socialbot.core.messages import CameraInfo, CompressedImage
from socialbot.core.progress import Advance, unseen
from socialbot.vision.camera import CameraModel
from socialbot.vision.cameras import is_device, open_frames

log = logging.getLogger("socialbot.bags")

TOPIC = "/camera/image_raw/compressed"
FRAME_ID = "camera_color_optical_frame"

_IMAGES = frozenset({".bmp", ".jpeg", ".jpg", ".png", ".ppm", ".tif", ".tiff", ".webp"})
_USUAL_RATE_HZ = 30.0

Frames = Iterator[tuple[int, np.ndarray]]
"""Stamp (ns) and picture of shape (height, width, 3), uint8, blue first."""


@dataclass(frozen=True)
class Imported:
    """What an import has made: pictures of ``width`` x ``height`` pixels, and how long they last."""

    path: Path
    images: int
    width: int
    height: int
    duration_s: float


@dataclass(frozen=True)
class Picturing:
    """How pictures are stored: made ``width`` pixels wide where that is given, as JPEG of a quality from 1 to 100.

    ``hfov_deg`` is what the camera sees from left to right; it makes the CameraInfo.
    """

    hfov_deg: float = 60.0
    jpeg_quality: int = 90
    width: int | None = None

    def __post_init__(self) -> None:
        _check("hfov_deg", self.hfov_deg, 0 < self.hfov_deg < 180)
        _check("jpeg_quality", self.jpeg_quality, 1 <= self.jpeg_quality <= 100)
        _check("width", self.width, self.width is None or 2 <= self.width <= 65500)

    def scaled(self, pixels: np.ndarray) -> np.ndarray:
        """``pixels`` in the width to be stored."""
        height, width = pixels.shape[:2]
        if self.width is None or self.width == width:
            return pixels
        size = (self.width, max(1, round(height * self.width / width)))
        return cv2.resize(pixels, size, interpolation=cv2.INTER_AREA if self.width < width else cv2.INTER_LINEAR)

    def image(self, stamp: int, pixels: np.ndarray) -> CompressedImage:
        """``pixels`` as JPEG."""
        _, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, self.jpeg_quality])
        return CompressedImage(
            stamp=stamp, frame_id=FRAME_ID, format="bgr8; jpeg compressed bgr8", data=data.reshape(-1)
        )

    def camera_info(self, stamp: int, width: int, height: int) -> CameraInfo:
        """A camera without distortion."""
        model = CameraModel.from_field_of_view(width, height, math.radians(self.hfov_deg))
        k = (model.fx, 0.0, model.cx, 0.0, model.fy, model.cy, 0.0, 0.0, 1.0)
        return CameraInfo(stamp=stamp, frame_id=FRAME_ID, width=width, height=height, k=k, d=(0.0,) * 5)


def import_bag(
    source: str | Path,
    out: str | Path,
    *,
    rate_hz: float = 10.0,
    start: int = SECOND,
    hfov_deg: float = 60.0,
    jpeg_quality: int = 90,
    topic: str = TOPIC,
    limit_s: float | None = None,
    width: int | None = None,
    clock: Clock | None = None,
    stopped: Callable[[], bool] = lambda: False,
    advance: Advance = unseen,
) -> Imported:
    """Writes the pictures of ``source`` and, once a second, the CameraInfo to the new bag ``out``.

    A folder is played at ``rate_hz``, in natural order; a video by its own time stamps; both begin at
    the stamp ``start`` (ns). A camera is stamped by ``clock`` and recorded until ``limit_s`` or until ``stopped``.
    ``advance`` is told how many pictures are written.

    Raises BagError when ``source`` cannot be read, its images differ in size, or ``out`` exists;
    DeviceError when a camera cannot be opened; ParameterError for a value out of range. No bag is left then.
    """
    _check("rate_hz", rate_hz, 0 < rate_hz <= 1000)
    _check("limit_s", limit_s, limit_s is None or limit_s > 0)
    picturing = Picturing(hfov_deg, jpeg_quality, width)
    until = math.inf if limit_s is None else nanoseconds(limit_s)
    with BagWriter(out) as bag:
        try:
            with closing(_frames(str(source), rate_hz, start, clock or WallClock())) as frames:
                return _write(frames, bag, picturing, topic, until, stopped, advance, str(source))
        except SocialbotError:
            bag.discard()
            raise


def _write(
    frames: Frames,
    bag: BagWriter,
    picturing: Picturing,
    topic: str,
    until: float,
    stopped: Callable[[], bool],
    advance: Advance,
    source: str,
) -> Imported:
    info_topic = f"{topic.removesuffix('/compressed').rpartition('/')[0]}/camera_info"
    first = last = next_info = 0
    height = width = images = 0
    for stamp, original in frames:
        first = first if images else stamp
        if stamp - first >= until or stopped():
            break
        pixels = picturing.scaled(original)
        height, width = pixels.shape[:2]
        if stamp >= next_info:
            bag.write(info_topic, picturing.camera_info(stamp, width, height), stamp)
            next_info = stamp + SECOND
        bag.write(topic, picturing.image(stamp, pixels), stamp)
        images, last = images + 1, stamp
        advance(images)
    if not images:
        raise BagError("no picture could be read", where=source, remedy="check that it is not empty or damaged")
    return Imported(bag.path, images, width, height, (last - first) / SECOND)


def _frames(source: str, rate_hz: float, start: int, clock: Clock) -> Generator[tuple[int, np.ndarray], None, None]:
    if is_device(source):
        return _camera(source, clock)
    path = Path(source)
    if path.is_dir():
        return _folder(path, rate_hz, start)
    if path.is_file():
        return _video(path, start)
    raise BagError(
        "no such video, folder or camera", where=source, remedy="check the path; a camera is 0 or /dev/video0"
    )


def _camera(source: str, clock: Clock) -> Generator[tuple[int, np.ndarray], None, None]:
    with closing(open_frames(source)) as frames:
        while (pixels := frames.read()) is not None:
            yield clock.now(), pixels
    log.warning("%s: the camera gives no more pictures", source)


def _folder(folder: Path, rate_hz: float, start: int) -> Generator[tuple[int, np.ndarray], None, None]:
    paths = sorted((path for path in folder.iterdir() if path.suffix.lower() in _IMAGES), key=natural)
    if not paths:
        raise BagError("no images in this folder", where=str(folder), remedy="put jpg or png files there")
    first = _load(paths[0])
    for index, path in enumerate(paths):
        pixels = _load(path)
        if pixels.shape != first.shape:
            raise BagError(
                f"is {_size(pixels)} pixels large, but {paths[0].name} is {_size(first)}",
                where=str(path),
                remedy="take it out, or bring all images to one size",
            )
        yield start + round(index * SECOND / rate_hz), pixels


def _load(path: Path) -> np.ndarray:
    pixels = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if pixels is None:
        raise BagError("cannot be decoded", where=str(path), remedy="remove or replace this image")
    return pixels


def _size(pixels: np.ndarray) -> str:
    return f"{pixels.shape[1]}x{pixels.shape[0]}"


def _video(path: Path, start: int) -> Generator[tuple[int, np.ndarray], None, None]:
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise BagError("is no video that can be opened", where=str(path), remedy="convert it to mp4, avi or mkv")
        rate = capture.get(cv2.CAP_PROP_FPS)
        period = round(SECOND / (rate if 0 < rate <= 1000 else _USUAL_RATE_HZ))
        first = last = None
        while True:
            good, pixels = capture.read()
            if not good:
                break
            time = round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
            first = time if first is None else first
            # Some containers carry no time stamps, and some repeat them.
            last = start if last is None else start + time - first if start + time - first > last else last + period
            yield last, pixels
    finally:
        capture.release()


def _check(name: str, value: object, good: bool) -> None:
    if not good:
        raise ParameterError(f"{value!r} is out of range", where=name)
