"""Make bags from videos, image folders and cameras, and convert bags between message forms."""

from __future__ import annotations

import heapq
import logging
import math
import shutil
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import cv2
import msgspec
import numpy as np

from socialbot.bags import codec
from socialbot.bags.image_files import SUFFIXES, open_video, read_depth, read_image, unread_images, video_stamps
from socialbot.bags.other_images import decoded_images, image_topic_of
from socialbot.bags.reader import DECODED_TYPES, Bag, RosbagsTypes, Skipped, natural, open_bag
from socialbot.bags.sound import AUDIO_TOPIC, has_decoder, video_sound
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND, Clock, WallClock, nanoseconds
from socialbot.core.errors import BagError, ImageError, MessageError, ParameterError
from socialbot.core.installation import extra_command
from socialbot.core.messages import AudioData, CameraInfo, CompressedDepth, CompressedImage, Structured
from socialbot.core.paths import writing
from socialbot.core.reading import read_bytes
from socialbot.graph.node import WireForm

log = logging.getLogger("socialbot.bags")

TOPIC = "/camera/image_raw/compressed"
FRAME_ID = "camera_color_optical_frame"

Frames = Generator[tuple[int, np.ndarray], None, None]
"""Stamp (ns) and image: uint8, shape (height, width, 3), BGR."""


Intrinsics = Callable[[int, int], CameraInfo]


class FrameSource(Protocol):
    """An open camera."""

    def read(self) -> np.ndarray | None:
        """The next image, or None when the camera delivers no more."""
        ...

    def close(self) -> None:
        """Release the camera."""
        ...


@dataclass(frozen=True)
class Imported:
    """Result of an import: the bag, the number, size (pixels) and duration of its images, and its sound and depths."""

    path: Path
    images: int
    width: int
    height: int
    duration_s: float
    sound_s: float = 0.0
    depths: int = 0


USUAL_FOV_DEG = 60.0
"""Field of view that is assumed along the longer side of images, degrees."""


@dataclass(frozen=True)
class _ImageFormat:
    hfov_deg: float | None
    jpeg_quality: int
    width: int | None
    camera_info: Intrinsics | None

    def __post_init__(self) -> None:
        _check("hfov_deg", self.hfov_deg, self.hfov_deg is None or 0 < self.hfov_deg < 180)
        _check("jpeg_quality", self.jpeg_quality, 1 <= self.jpeg_quality <= 100)
        _check("width", self.width, self.width is None or 2 <= self.width <= 65500)

    def image(self, stamp: int, pixels: np.ndarray) -> tuple[CompressedImage, CameraInfo]:
        """Scale and encode an image; an unknown camera is a pinhole with square pixels and no distortion."""
        height, width = pixels.shape[:2]
        if self.width is not None and self.width != width:
            method = cv2.INTER_AREA if self.width < width else cv2.INTER_LINEAR
            height, width = max(1, round(height * self.width / width)), self.width
            pixels = cv2.resize(pixels, (width, height), interpolation=method)
        _, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, self.jpeg_quality])
        kind = "bgr8; jpeg compressed bgr8"
        compressed = CompressedImage(stamp=stamp, frame_id=FRAME_ID, format=kind, data=data.reshape(-1))
        if self.camera_info is not None:
            known = self.camera_info(width, height)
            return compressed, msgspec.structs.replace(known, stamp=stamp, frame_id=FRAME_ID)
        across, seen = (max(width, height), USUAL_FOV_DEG) if self.hfov_deg is None else (width, self.hfov_deg)
        focal = across / 2 / math.tan(math.radians(seen) / 2)
        k = (focal, 0.0, width / 2, 0.0, focal, height / 2, 0.0, 0.0, 1.0)
        info = CameraInfo(stamp=stamp, frame_id=FRAME_ID, width=width, height=height, k=k, d=(0.0,) * 5)
        return compressed, info


def import_bag(
    source: str | Path,
    out: str | Path,
    *,
    camera: FrameSource | None = None,
    rate_hz: float = 10.0,
    start: int = SECOND,
    hfov_deg: float | None = None,
    camera_info: Intrinsics | None = None,
    jpeg_quality: int = 90,
    topic: str = TOPIC,
    limit_s: float | None = None,
    width: int | None = None,
    sound: bool = True,
    clock: Clock | None = None,
    stopped: Callable[[], bool] = lambda: False,
    advance: Callable[[int], None] = lambda done: None,
) -> Imported:
    """Write images, once a second their CameraInfo, and the sound of a video to the new bag ``out``.

    Args:
        source: A video file, a folder of images, or one of TUM RGB-D with depth; with ``camera``, its name.
        out: The bag folder to create. It is removed again if the import fails.
        camera: An open camera to record; it is closed at the end.
        rate_hz: Image rate of a folder, whose images are taken in natural order. A video and TUM RGB-D have
            their own time stamps.
        start: Stamp (ns) of the first image of a folder or video.
        hfov_deg: Horizontal field of view, for the CameraInfo; default: `USUAL_FOV_DEG` along the longer side.
        camera_info: The CameraInfo of images of a width and height (pixels), in place of ``hfov_deg``.
        jpeg_quality: From 1 to 100.
        topic: The topic of the images.
        limit_s: The maximum duration of the import.
        width: The width (pixels) to scale images to.
        sound: Whether to keep the sound of a video, on `AUDIO_TOPIC`, if PyAV is installed.
        clock: The clock for the stamps of camera images.
        stopped: Whether to end the import now.
        advance: Called with the number of images written so far.

    Raises:
        ImageError: An image or video cannot be read, or is too large.
        BagError: ``source`` cannot be read, its images differ in size, or ``out`` exists.
        ParameterError: A value is out of range.
    """
    _check("rate_hz", rate_hz, 0 < rate_hz <= 1000)
    _check("limit_s", limit_s, limit_s is None or limit_s > 0)
    image_format = _ImageFormat(hfov_deg, jpeg_quality, width, camera_info)
    until = math.inf if limit_s is None else nanoseconds(limit_s)
    info_topic = f"{topic.removesuffix('/compressed').rpartition('/')[0]}/camera_info"
    first = last = next_info = images = 0
    sound_ns = depths = 0
    rgbd = None if camera is not None else _Rgbd.find(Path(source), start)
    sounds = _Sounds(_sounds(Path(source), start, limit_s) if sound and camera is None else iter(()))
    info = None
    try:
        with BagWriter(out, only_whole=True) as bag:
            with closing(
                rgbd.frames() if rgbd else _frames(str(source), camera, rate_hz, start, clock or WallClock())
            ) as frames:
                for stamp, pixels in frames:
                    first = first if images else stamp
                    if stamp - first >= until or stopped():
                        break
                    image, info = image_format.image(stamp, pixels)
                    sound_ns += sounds.write(bag, stamp)
                    depths += rgbd.write_depth(bag, info_topic, stamp) if rgbd else 0
                    if stamp >= next_info:
                        bag.write(info_topic, info, stamp)
                        next_info = stamp + SECOND
                    bag.write(topic, image, stamp)
                    images, last = images + 1, stamp
                    advance(images)
            if info is None:
                remedy = "check that it is not empty or damaged"
                raise BagError("no image could be read", where=str(source), remedy=remedy)
            if not stopped():
                sound_ns += sounds.write(bag, None)
                depths += rgbd.write_depth(bag, info_topic, last + _SAME_NS) if rgbd else 0
    except ImageError as error:
        raise BagError(error.what, where=error.where, remedy=error.remedy) from error
    return Imported(bag.path, images, info.width, info.height, (last - first) / SECOND, sound_ns / SECOND, depths)


_TUM_UNITS_PER_MM = 5
_CONFIG_BYTES = 12  # Before the PNG of compressed_depth_image_transport.
_SAME_NS = SECOND // 10  # Depth of an image is at most so much later.


@dataclass
class _Rgbd:
    """Folder of TUM RGB-D: rgb.txt and depth.txt list stamps (s) and images; the depth is registered to the colours."""

    images: list[tuple[int, Path]]
    depths: deque[tuple[int, Path]]

    @classmethod
    def find(cls, folder: Path, start: int) -> _Rgbd | None:
        """The images of ``folder``, the first of them at ``start`` (ns); None if it has no such lists."""
        lists = folder / "rgb.txt", folder / "depth.txt"
        if not all(path.is_file() for path in lists):
            return None
        images, depths = map(_listed, lists)
        shift = start - images[0][0] if images else 0
        return cls([(stamp + shift, path) for stamp, path in images], deque((at + shift, path) for at, path in depths))

    def frames(self) -> Frames:
        return _same_size(self.images)

    def write_depth(self, bag: BagWriter, info_topic: str, until: int) -> int:
        """Write the depth images up to a stamp (ns); return their number."""
        topic, count = f"{info_topic.rpartition('/')[0]}/depth/image_raw/compressedDepth", 0
        while self.depths and self.depths[0][0] <= until:
            stamp, path = self.depths.popleft()
            if stamp < max(self.images[0][0] - _SAME_NS, 0):
                continue
            _, png = cv2.imencode(".png", np.rint(read_depth(path) / _TUM_UNITS_PER_MM).astype(np.uint16))
            data = np.concatenate([np.zeros(_CONFIG_BYTES, np.uint8), png.reshape(-1)])
            kind = "16UC1; compressedDepth png"
            bag.write(topic, CompressedDepth(stamp=stamp, frame_id=FRAME_ID, format=kind, data=data), stamp)
            count += 1
        return count


def _listed(path: Path) -> list[tuple[int, Path]]:
    """Stamps (ns) and paths in a list of TUM RGB-D, in order of stamps. Raises BagError for another line."""
    found: list[tuple[int, Path]] = []
    try:
        lines = read_bytes(path).decode().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise BagError(f"cannot be read: {error}", where=str(path), remedy="save it as text") from error
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            seconds, name = words
            found.append((round(float(seconds) * SECOND), path.parent / name))
        except (ValueError, OverflowError) as error:
            remedy = "write a stamp in seconds and the path of an image"
            raise BagError(
                f"no stamp and image: {line[:60]!r}", where=f"{path}, line {number}", remedy=remedy
            ) from error
    return sorted(found)


class _Sounds:
    """Sound of a video, one piece ahead; the video is opened at the first `write`."""

    def __init__(self, pieces: Iterator[AudioData]) -> None:
        self._pieces = pieces
        self._next: AudioData | None = None
        self._opened = False

    def write(self, bag: BagWriter, until: int | None) -> int:
        """Write the pieces up to a stamp (ns), or all; return their duration (ns)."""
        duration = 0
        if not self._opened:
            self._opened, self._next = True, next(self._pieces, None)
        while self._next is not None and (until is None or self._next.stamp <= until):
            bag.write(AUDIO_TOPIC, self._next, self._next.stamp)
            duration += len(self._next.samples) // (2 * self._next.channels) * SECOND // self._next.sample_rate
            self._next = next(self._pieces, None)
        return duration


def _sounds(path: Path, start: int, limit_s: float | None) -> Iterator[AudioData]:
    if not path.is_file():
        return iter(())
    if not has_decoder():
        log.warning("%s: its sound, if it has any, is left out: %s", path, extra_command("hear"))
        return iter(())
    return video_sound(path, start, until=None if limit_s is None else start + nanoseconds(limit_s))


def _frames(source: str, camera: FrameSource | None, rate_hz: float, start: int, clock: Clock) -> Frames:
    if camera is not None:
        return _camera(source, camera, clock)
    path = Path(source)
    if path.is_dir():
        return _folder(path, rate_hz, start)
    if path.is_file():
        return _video(path, start)
    remedy = "check the path; a camera is 0 or /dev/video0"
    raise BagError("no such video, folder or camera", where=source, remedy=remedy)


def _camera(source: str, camera: FrameSource, clock: Clock) -> Frames:
    with closing(camera):
        while (pixels := camera.read()) is not None:
            yield clock.now(), pixels
    log.warning("%s: the camera delivers no more images", source)


def _folder(folder: Path, rate_hz: float, start: int) -> Frames:
    paths = sorted((path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES), key=natural)
    if not paths:
        below = {path.parent for path in folder.glob("*/*") if path.suffix.lower() in SUFFIXES}
        names = ", ".join(path.name for path in sorted(below, key=natural)[:8])
        remedy = f"name one of its folders with images: {names}" if names else "put jpg or png files there"
        raise BagError("no images in this folder", where=str(folder), remedy=unread_images(folder) or remedy)
    if unread := unread_images(folder):
        log.warning("%s: %s", folder, unread)
    yield from _same_size([(start + round(index * SECOND / rate_hz), path) for index, path in enumerate(paths)])


def _same_size(images: Sequence[tuple[int, Path]]) -> Frames:
    shape: tuple[int, ...] = ()
    for stamp, path in images:
        pixels = read_image(path)
        shape = shape or pixels.shape
        if pixels.shape != shape:
            size, other = (f"{each[1]}x{each[0]}" for each in (pixels.shape, shape))
            what = f"the image has {size} pixels, but {images[0][1].name} has {other}"
            raise BagError(what, where=str(path), remedy="remove it, or scale all images to one size")
        yield stamp, pixels


def _video(path: Path, start: int) -> Frames:
    capture = open_video(path)
    try:
        for stamp in video_stamps(capture):
            good, pixels = capture.retrieve()
            if not good:
                break
            yield start + stamp, pixels
    finally:
        capture.release()


def _check(name: str, value: object, good: bool) -> None:
    if not good:
        raise ParameterError(f"{value!r} is out of range", where=name)


@dataclass
class Conversion:
    """Result of a conversion: the bag, its message count, and the number of converted messages.

    ``kept`` counts structured messages without the requested form by topic, ``skipped`` damaged messages.
    """

    path: Path
    messages: int = 0
    converted: int = 0
    kept: dict[str, Skipped] = field(default_factory=dict)
    skipped: dict[str, Skipped] = field(default_factory=dict)


def convert_bag(
    source: str | Path, out: str | Path, form: WireForm | None, *, decode: bool = False, storage: str = "mcap"
) -> Conversion:
    """Write the bag ``source`` as the new bag ``out``, with structured messages in ``form``.

    Other messages are copied, and other files in the folder of the bag, such as its graph. So nothing is lost, but the
    packets of decoded video.

    Args:
        form: Form of structured messages; None leaves them as they are.
        decode: Whether images replace the messages of `DECODED_TYPES`: JPEG images those of video.

    Raises:
        BagError: ``source`` cannot be read or has nothing to decode, or ``out`` exists or cannot be written.
        InstallationError: Video is decoded, and PyAV is missing.
    """
    types = RosbagsTypes()
    source = Path(source)
    with open_bag(source) as bag, BagWriter(out, storage=storage, only_whole=True) as writer:
        made = Conversion(writer.path, skipped=bag.skipped)
        latched = {topic.name: bag.is_latched(topic.name) for topic in bag.topics}
        decoded = _decoded_topics(bag) if decode else []
        copied = bag.raw_messages({each.name: each.name for each in bag.topics if each.name not in decoded})
        for topic, time, name, data in heapq.merge(
            copied, _decoded(types, bag, decoded, made), key=lambda item: item[1]
        ):
            if form is not None and (name == codec.STRING or name in codec.typed_messages()):
                try:
                    name, data, changed = _converted(types, name, data, form)
                    made.converted += changed
                except MessageError as error:
                    made.kept.setdefault(topic, Skipped(0, str(error))).count += 1
            definition, type_hash = bag.definition(name)
            writer.write_raw(
                topic, name, data, time, latched=latched.get(topic, False), type_hash=type_hash, definition=definition
            )
            made.messages += 1
        for file in source.iterdir() if source.is_dir() else ():
            if file.is_file() and file.name != "metadata.yaml" and file.suffix not in (".mcap", ".db3", ".zstd"):
                with writing(writer.path / file.name, BagError):
                    shutil.copyfile(file, writer.path / file.name)
    return made


def _decoded_topics(bag: Bag) -> list[str]:
    """Topics of ``bag`` that are decoded. Raises BagError if there are none, or their images have no topic."""
    topics = [topic for topic in bag.topics if topic.type in DECODED_TYPES and topic.count]
    kept = [each.name for each in bag.topics if each.count and each not in topics]
    names = Counter([*kept, *map(image_topic_of, topics)])
    taken = sorted(name for name, count in names.items() if count > 1)
    if taken:
        what, remedy = f"has messages on {taken[0]} already", "use those images, or leave them out of the bag"
    else:
        what, remedy = "has no images that can be decoded", f"known are {', '.join(DECODED_TYPES)}"
    if taken or not topics:
        raise BagError(what, where=str(bag.path), remedy=remedy)
    return [topic.name for topic in topics]


def _decoded(
    types: RosbagsTypes, bag: Bag, names: Sequence[str], made: Conversion
) -> Iterator[tuple[str, int, str, bytes]]:
    """Yield topic, time, type and bytes of the images of the topics ``names``."""
    for topic, time, image in decoded_images(bag, names, made.skipped):
        ros_message = codec.encode(image, types)
        made.converted += 1
        yield topic, time, ros_message.__msgtype__, types.serialize(ros_message)


def _converted(types: RosbagsTypes, name: str, data: bytes, form: WireForm) -> tuple[str, bytes, bool]:
    """Return type and bytes of the message in ``form``, and whether they changed. Raises MessageError if that fails."""
    ros_message = types.deserialize(data, name)
    if name == codec.STRING and not ros_message.data.lstrip().startswith("{"):
        raise MessageError("plain text")
    message = codec.decode(codec.decodable_types()[name], ros_message)
    assert isinstance(message, Structured)
    wanted = codec.ros_type(type(message), form)
    if wanted == name:
        return name, data, False
    written = types.serialize(codec.encode(message, types, form))
    if codec.decode(type(message), types.deserialize(written, wanted)) != message:
        raise MessageError(f"{wanted} cannot express it")
    return wanted, written, True
