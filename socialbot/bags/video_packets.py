"""Images of the video packets in bags: of ffmpeg_image_transport, and CompressedVideo of Foxglove."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np

from socialbot.bags.reader import FFMPEG_PACKET, FOXGLOVE_VIDEO, Bag, Skipped
from socialbot.core.errors import BagError, InstallationError
from socialbot.core.installation import extra_command
from socialbot.core.limits import DECODER_BYTES, IMAGE_PIXELS
from socialbot.core.memory_limit import memory_limit
from socialbot.core.messages import CompressedImage

DECODED_TYPES = (FFMPEG_PACKET, FOXGLOVE_VIDEO)

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


def image_topic_of(name: str) -> str:
    """Topic for the images of the packets on ``name``: ``/camera/image_raw/ffmpeg`` becomes that of JPEG images."""
    base, _, last = name.rpartition("/")
    return f"{base if base and last in _TRANSPORTS else name}/compressed"


def decoded_images(
    bag: Bag, names: Sequence[str], skipped: dict[str, Skipped]
) -> Iterator[tuple[str, int, CompressedImage]]:
    """Yield topic, time of reception (ns) and JPEG image of each packet on the topics ``names``.

    Args:
        skipped: Gets the number of packets without an image by topic: damaged ones, and those before a key frame.

    Raises:
        BagError: The encoding of a topic is unknown, or none of its packets can be decoded.
        InstallationError: PyAV is missing.
    """
    decoders: dict[str, _Decoder] = {}
    for name, time, packet in bag.ros_messages(names):
        ffmpeg = hasattr(packet, "header")
        encoding = packet.encoding if ffmpeg else packet.format
        stamp, frame_id = (
            (packet.header.stamp, packet.header.frame_id) if ffmpeg else (packet.timestamp, packet.frame_id)
        )
        if name not in decoders:
            decoders[name] = _Decoder(_codec_of(encoding, f"{bag.path}: {name}"))
        source = _Source(time, stamp.sec * 10**9 + stamp.nanosec, frame_id)
        for of, pixels in decoders[name].images(packet.data, source):
            yield image_topic_of(name), of.time, _jpeg(pixels, of)
    for name, decoder in decoders.items():
        for of, pixels in decoder.rest():
            yield image_topic_of(name), of.time, _jpeg(pixels, of)
        if decoder.without_image == decoder.packets:
            what = f"no image can be decoded: {decoder.first_error or 'it has no key frame'}"
            raise BagError(what, where=f"{bag.path}: {name}", remedy="record the video from a key frame on")
        if decoder.without_image:
            damaged = skipped.setdefault(name, Skipped(0, decoder.first_error or "before the first key frame"))
            damaged.count += decoder.without_image


@dataclass(frozen=True)
class _Source:
    time: int
    stamp: int
    frame_id: str


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

    def images(self, data: np.ndarray, source: _Source) -> Iterator[tuple[_Source, np.ndarray]]:
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
