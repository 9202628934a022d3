"""Images of the messages in bags that no node takes: of ffmpeg_image_transport and of Foxglove."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import cv2
import numpy as np

from socialbot.bags.reader import FFMPEG_PACKET, FOXGLOVE_IMAGE, FOXGLOVE_RAW_IMAGE, Bag, BagTopic, Skipped
from socialbot.core.errors import BagError, InstallationError
from socialbot.core.installation import extra_command
from socialbot.core.limits import DECODER_BYTES, IMAGE_PIXELS
from socialbot.core.memory_limit import memory_limit
from socialbot.core.messages import CompressedImage, Image

_DECODERS = {
    "264": "h264",
    "265": "hevc",
    "hevc": "hevc",
    "av1": "libdav1d",
    "vp9": "vp9",
    "vp8": "vp8",
    "mpeg4": "mpeg4",
}
"""Decoders by a part of the name of an encoding: encoders are named, too, such as ``libx264`` or ``hevc_nvenc``."""

_TRANSPORTS = ("ffmpeg", "foxglove", "h264", "h265", "hevc", "video")
"""Last parts of the names of topics that become ``compressed``."""


def image_topic_of(topic: BagTopic) -> str:
    """Topic for the images of ``topic``: ``/camera/image_raw/ffmpeg`` becomes that of JPEG images.

    Images of Foxglove keep their topic.
    """
    if topic.type in (FOXGLOVE_IMAGE, FOXGLOVE_RAW_IMAGE):
        return topic.name
    base, _, last = topic.name.rpartition("/")
    return f"{base if base and last in _TRANSPORTS else topic.name}/compressed"


def decoded_images(
    bag: Bag, names: Sequence[str], skipped: dict[str, Skipped]
) -> Iterator[tuple[str, int, CompressedImage | Image]]:
    """Yield topic, time of reception (ns) and image of each message on the topics ``names``.

    Video becomes JPEG images; images of Foxglove keep their encoding and data.

    Args:
        skipped: Gets the number of packets without an image by topic: damaged ones, and those before a key frame.

    Raises:
        BagError: The encoding of a video is unknown, or none of its packets can be decoded.
        InstallationError: PyAV is missing for a video.
    """
    decoders: dict[str, _Decoder] = {}
    topics = {name: bag.topic(name) for name in names}
    for name, time, message in bag.ros_messages(names):
        topic, where = image_topic_of(topics[name]), f"{bag.path}: {name}"
        try:
            found = _packet_or_image(topics[name].type, message, time)
        except AttributeError as error:
            what = f"{topics[name].type} has other fields than the one of its makers ({error})"
            raise BagError(what, where=where, remedy="leave out the topic") from error
        if not isinstance(found, _Packet):
            yield topic, time, found
            continue
        if name not in decoders:
            decoders[name] = _Decoder(_codec_of(found.encoding, where))
        for of, pixels in decoders[name].images(found.source, found.data):
            yield topic, of.time, _jpeg(pixels, of)
    for name, decoder in decoders.items():
        for of, pixels in decoder.rest():
            yield image_topic_of(topics[name]), of.time, _jpeg(pixels, of)
        if decoder.without_image == decoder.packets:
            what = f"no image can be decoded: {decoder.first_error or 'it has no key frame'}"
            raise BagError(what, where=f"{bag.path}: {name}", remedy="record the video from a key frame on")
        if decoder.without_image:
            damaged = skipped.setdefault(name, Skipped(0, decoder.first_error or "before the first key frame"))
            damaged.count += decoder.without_image


@dataclass(frozen=True)
class _Source:
    """Source of an image, with the time of reception (ns)."""

    time: int
    stamp: int
    frame_id: str


class _Packet(NamedTuple):
    source: _Source
    encoding: str
    data: np.ndarray


def _packet_or_image(kind: str, message: Any, time: int) -> _Packet | CompressedImage | Image:
    """Packet or image in a ROS message of type ``kind``. Raises AttributeError if it has other fields."""
    head = message.header if kind == FFMPEG_PACKET else message
    at = head.stamp if kind == FFMPEG_PACKET else head.timestamp
    stamp = at.sec * 10**9 + at.nanosec
    if kind == FOXGLOVE_RAW_IMAGE:
        return Image(
            stamp=stamp,
            frame_id=head.frame_id,
            height=message.height,
            width=message.width,
            encoding=message.encoding,
            step=message.step,
            data=message.data,
        )
    encoding = message.encoding if kind == FFMPEG_PACKET else message.format
    if kind == FOXGLOVE_IMAGE:
        return CompressedImage(stamp=stamp, frame_id=head.frame_id, format=encoding, data=message.data)
    return _Packet(_Source(time, stamp, head.frame_id), encoding, message.data)


@dataclass
class _Decoder:
    """Decoder of one topic. Images come in the order of their times, some of them a few packets later."""

    codec: str
    first_error: str = ""
    packets: int = 0
    _latest: int = 0
    _pending: dict[int, _Source] = field(default_factory=dict)

    def __post_init__(self) -> None:
        try:
            import av  # pyright: ignore[reportMissingImports] - extra hear
            from av.error import FFmpegError  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise InstallationError(f"PyAV is not installed ({error})", remedy=extra_command("hear")) from error
        self._packet, self._error = av.Packet, FFmpegError
        self._context: Any = av.CodecContext.create(self.codec, "r")
        self._context.options = {"max_pixels": str(IMAGE_PIXELS)}
        self._context.thread_count = 1  # so that images come at once, and each time the same

    @property
    def without_image(self) -> int:
        """Number of packets that gave no image."""
        return len(self._pending)

    def images(self, source: _Source, data: np.ndarray) -> Iterator[tuple[_Source, np.ndarray]]:
        self._pending[self.packets] = source
        packet = self._packet(data.tobytes())
        packet.pts = packet.dts = self.packets
        self.packets += 1
        yield from self._decode(packet)

    def rest(self) -> Iterator[tuple[_Source, np.ndarray]]:
        """The images that the decoder holds back."""
        yield from self._decode(None)

    def _decode(self, packet: Any) -> Iterator[tuple[_Source, np.ndarray]]:
        try:
            with memory_limit(DECODER_BYTES):
                frames = [(frame.pts, frame.to_ndarray(format="bgr24")) for frame in self._context.decode(packet)]
        except (self._error, MemoryError) as error:
            self.first_error = self.first_error or f"{type(error).__name__}: {error}"
            return
        for number, pixels in frames:
            if number in self._pending:
                source = self._pending.pop(number)
                self._latest = max(self._latest, source.time)
                yield replace(source, time=self._latest), pixels


def _codec_of(encoding: str, where: str) -> str:
    name = encoding.partition(";")[0].lower()
    for part, codec in _DECODERS.items():
        if part in name:
            return codec
    known = "h264, hevc, av1, vp9, vp8, mpeg4"
    raise BagError(f"the video encoding {encoding!r} is unknown", where=where, remedy=f"known: {known}")


def _jpeg(pixels: np.ndarray, source: _Source) -> CompressedImage:
    _, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 90])
    return CompressedImage(
        stamp=source.stamp, frame_id=source.frame_id, format="bgr8; jpeg compressed bgr8", data=data.reshape(-1)
    )
