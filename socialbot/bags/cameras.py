"""Image topics by camera and by kind, their CameraInfo, and the sensors that measure distances."""

from __future__ import annotations

import enum
import re
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

from socialbot.core.clock import nanoseconds
from socialbot.core.messages import CompressedImage, Image, Message

T = TypeVar("T")


class ImageKind(enum.IntEnum):
    """Kind of images, best first for a person detector.

    Only a depth image has distances as pixels. A map has other values, such as disparities, confidences or classes.
    """

    COLOUR = 0
    GREY = 1
    INFRARED = 2
    DEPTH_VIEW = 3
    DEPTH = 4
    MAP = 5


_TRANSPORTS = ("compressed", "compressedDepth", "theora", "ffmpeg", "zstd")
_GREY = frozenset({"mono8", "8UC1", "mono16"})
_DEPTH = frozenset({"16UC1", "32FC1"})
_DEEP = frozenset({*_DEPTH, "mono16", "compressedDepth"})
_PNG = b"\x89PNG\r\n\x1a\n"
# A word of a topic name: between slashes, underscores and digits. Behind "to", it names the camera of aligned depth.
_INFRARED_NAME = re.compile(
    r"(?:^|[/_\d])(?<!_to_)(?:infra|infrared|ir|thermal|temperature|lwir|fir|nir|flir|boson|lepton|amplitude|intensity)"
    r"(?:[/_\d]|$)",
    re.IGNORECASE,
)
_DEPTH_NAME = re.compile(r"(?:^|[/_\d])(?:depth|disparity|sw_registered|hw_registered)(?:[/_\d]|$)", re.IGNORECASE)
_MAP_NAME = re.compile(
    r"(?:^|[/_\d])(?:confidence|disparity|segmentation|semantic|instance|labels?|mask|body_index|flow|noise)(?:[/_\d]|$)",
    re.IGNORECASE,
)
_MAP_ENCODING = re.compile(r"(?:8S|16S|32S|16F|32F|64F)C\d")
_RECTIFIED_NAME = re.compile(r"(?:^|_)rect(?:ified)?(?:_|$)", re.IGNORECASE)
_RECTIFIED = ("image_rect_color", "image_rect", "rgb_rect", "image_color", "image_raw", "image")


def image_kind(topic: str, first: Message | None) -> ImageKind:
    """Kind of the images on ``topic``.

    A 16-bit or float encoding means depth, except for a 16-bit image on an infrared or thermal topic, and for a topic
    that is named as a map. The makers of thermal cameras make colour cameras, too, and only these have a Bayer filter.

    Args:
        topic: Name of the topic.
        first: Its first image, or None if that is unreadable: the name decides then.
    """
    name, transport = _without_transport(topic)
    encoding = _encoding(first)
    infrared = _INFRARED_NAME.search(name) is not None and not encoding.startswith("bayer")
    named_depth = _DEPTH_NAME.search(name) is not None
    deep = encoding in _DEEP or transport == "compressedDepth"
    named_map = _MAP_NAME.search("/".join(name.split("/")[-2:])) is not None
    if (named_map and (deep or encoding in _GREY)) or (infrared and encoding == "32FC1"):
        return ImageKind.MAP
    if encoding not in _DEEP and _MAP_ENCODING.fullmatch(encoding):
        return ImageKind.MAP
    if transport == "compressedDepth" or encoding in ("compressedDepth", "32FC1"):
        return ImageKind.DEPTH
    if (encoding == "16UC1" and not infrared) or (encoding == "mono16" and named_depth):
        return ImageKind.DEPTH
    if infrared:
        return ImageKind.INFRARED
    if not encoding:
        return ImageKind.DEPTH if named_depth else ImageKind.COLOUR
    if named_depth:
        return ImageKind.DEPTH_VIEW  # such as depth in false colours
    return ImageKind.GREY if encoding in _GREY else ImageKind.COLOUR


def _without_transport(topic: str) -> tuple[str, str]:
    """Name of the raw images of ``topic``, and the transport that its last word names; empty for raw images."""
    base, _, transport = topic.rpartition("/")
    return (base, transport) if transport in _TRANSPORTS else (topic, "")


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
    return _without_transport(topic)[0].rpartition("/")[0]


def camera_info_of(image: str, infos: Collection[str], images: Collection[str], frame: Callable[[str], str]) -> str:
    """CameraInfo topic of the images on ``image``; empty if there is none.

    It lies in the namespace of the images, or below their topic, or in the namespace around: there it may belong to
    other images, and does if these have another frame. Else it lies deeper in the namespace around, if that has no
    other images. Else it is one with the frame of the images, such as that of the depth registered to them.

    Args:
        image: Topic of the images.
        infos: CameraInfo topics.
        images: Topics with images.
        frame: Frame of the first message on a topic; empty if unknown.
    """
    name = _without_transport(image)[0]
    space = name.rpartition("/")[0]
    around = space.rpartition("/")[0]
    for place in dict.fromkeys((space, name, around)):
        found = [info for info in infos if info.rpartition("/")[0] == place]
        if place == around != space and any(camera_of(other) == around for other in images):
            found = [info for info in found if frame(info) in ("", frame(image))]
        if len(found) > 1:
            found.sort(key=lambda info: (frame(info) != frame(image), -_shared(info, name), info))
        if found:
            return found[0]
    if around and not any(other.startswith(f"{around}/") and _without_transport(other)[0] != name for other in images):
        found = [info for info in infos if info.startswith(f"{around}/") and frame(info) in ("", frame(image))]
        if len(found) == 1:
            return found[0]
    alike = [info for info in infos if frame(info) == frame(image) != ""]
    return min(alike, key=lambda info: (-_shared(info.split("/"), name.split("/")), info), default="")


def is_rectified(topic: str) -> bool:
    """Whether the images on ``topic`` are rectified, by its name: image_rect, image_rect_color and the like."""
    name = _without_transport(topic)[0].rpartition("/")[2]
    return _RECTIFIED_NAME.search(name) is not None


def best(kinds: Mapping[str, ImageKind]) -> list[str]:
    """The best topic of each camera with images of the best kind, from the kinds by topic."""
    least = min(kinds.values())
    cameras: dict[str, list[str]] = {}
    for topic, kind in kinds.items():
        if kind == least:
            cameras.setdefault(camera_of(topic), []).append(topic)
    return [min(topics, key=_order) for topics in cameras.values()]


def _order(topic: str) -> tuple[int, bool, str]:
    base, transport = _without_transport(topic)
    name = base.rpartition("/")[2]
    return _RECTIFIED.index(name) if name in _RECTIFIED else len(_RECTIFIED), transport != "", topic


_REGISTERED = re.compile(r"aligned|registered|to_color|to_rgb")
_LIDAR = re.compile(r"velodyne|lidar|ouster|livox|hesai|rslidar|points_raw")
_DERIVED = re.compile(r"ground|map|obstacle|costmap|cluster|filtered|plane|object|segment|disparity")


def best_depth(image: str, frame: str, topics: Mapping[str, str]) -> str | None:
    """The depth topic for the pictures on ``image`` in ``frame``: in this frame, of the same camera, registered, raw.

    Args:
        topics: Frame of the images by depth topic.
    """

    def order(topic: str) -> tuple[bool, bool, int, bool, bool, str]:
        derived, registered = (pattern.search(topic) is not None for pattern in (_DERIVED, _REGISTERED))
        in_frame = frame != "" and topics[topic] == frame
        shared = _shared(image.split("/"), topic.split("/"))
        return derived, not in_frame, -shared, not registered, topic.endswith("/compressedDepth"), topic

    return min(topics, key=order, default=None)


def best_points(topics: Mapping[str, str], *, with_depth: bool) -> str | None:
    """The best topic with point clouds, by their frame: that of a lidar.

    Clouds of a depth camera repeat its depth image, so they are left out ``with_depth``.
    """
    names = [topic for topic, frame in topics.items() if not (with_depth and "optical" in frame)]
    return min(names, key=lambda topic: (bool(_DERIVED.search(topic)), not _LIDAR.search(topic), topic), default=None)


def transform_topics(image: str, topics: Iterable[str]) -> list[str]:
    """Those of the ``topics`` with transforms that place the camera of ``image``: tf and tf_static of its robot."""
    words = {topic: topic.rpartition("/") for topic in topics}
    found: list[str] = []
    for name in ("tf", "tf_static"):
        around = [topic for topic, (space, _, last) in words.items() if last == name and image.startswith(f"{space}/")]
        found += sorted(around, key=len)[-1:]
    return found


def _shared(one: Sequence[str], other: Sequence[str]) -> int:
    """Number of leading words that two topics share, or of leading characters."""
    pairs = zip(one, other, strict=False)
    return next((number for number, (a, b) in enumerate(pairs) if a != b), min(len(one), len(other)))


_LONGEST_WAIT_S = 2.0
_MOST_WAITING = 120


def depth_first(
    items: Iterable[T],
    topic_and_stamp: Callable[[T], tuple[str, int]],
    depth: Collection[str],
    pictures: Collection[str],
) -> Iterator[T]:
    """Reorder messages so that each picture follows the depth of its stamp, which often arrives later.

    A picture waits for at most 2 s of the recording. Other messages keep their order.

    Args:
        items: Messages in the order of the bag.
        topic_and_stamp: Topic and stamp (ns) of a message.
        depth: Topics with depth images and point clouds.
        pictures: Topics with pictures.
    """
    waiting: deque[tuple[str, int, T]] = deque()
    latest = dict.fromkeys(depth, -(2**63))
    for item in items:
        topic, stamp = topic_and_stamp(item)
        if topic in latest:
            latest[topic] = max(latest[topic], stamp)
            yield item
        else:
            waiting.append((topic, stamp, item))
        measured = min(latest.values(), default=stamp)
        while waiting:
            first, taken, head = waiting[0]
            late = max(stamp, waiting[-1][1]) - taken > nanoseconds(_LONGEST_WAIT_S) or len(waiting) > _MOST_WAITING
            if first in pictures and measured < taken and not late:
                break
            waiting.popleft()
            yield head
    yield from (item for _, _, item in waiting)
