"""Image topics by camera and by kind: colour, grey, infrared or depth."""

from __future__ import annotations

import enum
import re
from collections.abc import Mapping

from socialbot.core.messages import CompressedImage, Image, Message


class ImageKind(enum.IntEnum):
    """Kind of images, best first for a person detector. Only a depth image has distances as pixels."""

    COLOUR = 0
    GREY = 1
    INFRARED = 2
    DEPTH_VIEW = 3
    DEPTH = 4


_TRANSPORTS = ("compressed", "compressedDepth", "theora", "ffmpeg", "zstd")
_GREY = frozenset({"mono8", "8UC1", "mono16"})
_DEPTH = frozenset({"16UC1", "32FC1"})
_PNG = b"\x89PNG\r\n\x1a\n"
# A word of a topic name: between slashes, underscores and digits.
_INFRARED_NAME = re.compile(r"(?:^|[/_\d])(?:infra|infrared|ir|thermal|lwir|fir|nir)(?:[/_\d]|$)", re.IGNORECASE)
_DEPTH_NAME = re.compile(r"(?:^|[/_\d])(?:depth|disparity|sw_registered|hw_registered)(?:[/_\d]|$)", re.IGNORECASE)
_RECTIFIED = ("image_rect_color", "image_rect", "rgb_rect", "image_color", "image_raw", "image")


def image_kind(topic: str, first: Message | None) -> ImageKind:
    """Kind of the images on ``topic``.

    A 16-bit or float encoding means depth, except for a 16-bit image on an infrared or thermal topic.

    Args:
        topic: Name of the topic.
        first: Its first image, or None if that is unreadable: the name decides then.
    """
    base, _, transport = topic.rpartition("/")
    if transport == "compressedDepth":
        return ImageKind.DEPTH
    name = base if transport in _TRANSPORTS else topic
    infrared = _INFRARED_NAME.search(name) is not None
    encoding = _encoding(first)
    if encoding in ("compressedDepth", "32FC1"):
        return ImageKind.DEPTH
    named_depth = _DEPTH_NAME.search(name) is not None
    if (encoding == "16UC1" and not infrared) or (encoding == "mono16" and named_depth):
        return ImageKind.DEPTH
    if infrared:
        return ImageKind.INFRARED
    if not encoding:
        return ImageKind.DEPTH if named_depth else ImageKind.COLOUR
    if named_depth:
        return ImageKind.DEPTH_VIEW  # such as depth in false colours
    return ImageKind.GREY if encoding in _GREY else ImageKind.COLOUR


def _encoding(image: Message | None) -> str:
    """Encoding of the pixels before compression; empty if unknown."""
    if isinstance(image, Image):
        return image.encoding
    if not isinstance(image, CompressedImage):
        return ""
    if "compresseddepth" in image.format.lower():
        return "compressedDepth"
    encoding = image.format.partition(";")[0].strip()
    if encoding in _DEPTH or encoding in _GREY:
        return encoding
    head = bytes(image.data[:26])
    # A PNG header has the bits of a sample at 24 and the colour type, 0 for grey, at 25.
    if head.startswith(_PNG) and len(head) == 26 and head[25] == 0:
        return "mono16" if head[24] == 16 else "mono8"
    return image.format


def camera_of(topic: str) -> str:
    """Namespace of the camera: ``/camera`` for ``/camera/image_raw`` and ``/camera/image_raw/compressed``."""
    base, _, transport = topic.rpartition("/")
    return (base if transport in _TRANSPORTS else topic).rpartition("/")[0]


def best(kinds: Mapping[str, ImageKind]) -> list[str]:
    """The best topic of each camera with images of the best kind, from the kinds by topic."""
    least = min(kinds.values())
    cameras: dict[str, list[str]] = {}
    for topic, kind in kinds.items():
        if kind == least:
            cameras.setdefault(camera_of(topic), []).append(topic)
    return [min(topics, key=_order) for topics in cameras.values()]


def _order(topic: str) -> tuple[int, bool, str]:
    base, _, transport = topic.rpartition("/")
    compressed = transport in _TRANSPORTS
    name = (base if compressed else topic).rpartition("/")[2]
    return _RECTIFIED.index(name) if name in _RECTIFIED else len(_RECTIFIED), compressed, topic
