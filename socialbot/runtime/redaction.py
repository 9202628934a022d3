"""Redact bags: blur or remove pictures of people, and store their detections for identical replays."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from socialbot.bags import codec
from socialbot.bags.reader import IMAGE_TYPES, OTHER_IMAGE_TYPES, Bag, open_bag
from socialbot.bags.types import RosbagsTypes, types_with
from socialbot.bags.writer import BagWriter
from socialbot.core.errors import BagError, ImageError
from socialbot.core.messages import CompressedImage, Image
from socialbot.core.paths import replace_file, temporary_folder, writing
from socialbot.core.reading import read_bytes
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph
from socialbot.runs.record import Privacy
from socialbot.runtime._cache_files import CacheFolder
from socialbot.runtime.bag_source import graph_of, replay
from socialbot.runtime.perception_cache import SEEN_FILE, PerceptionCache
from socialbot.vision.annotate import NEAR_NS, PeopleFinder, blurred
from socialbot.vision.camera_pose import pose_beside
from socialbot.vision.images import bgr_from_compressed, bgr_from_image, encode_jpeg
from socialbot.vision.metrics.truth import truth_beside

POINTS = "sensor_msgs/msg/PointCloud2"
QUALITY = 90
_BYTES_FIELD = re.compile(r"\b(?:uint8|byte|char|octet)\s*[\[>,]")
_IMAGE_FIELD = re.compile(
    r"^[ \t]*sensor_msgs/(?:msg/)?(?:Compressed)?Image\b|\bsensor_msgs::msg::(?:Compressed)?Image\b", re.MULTILINE
)
Boxes = np.ndarray


@dataclass
class Redaction:
    """Result of a redaction.

    Attributes:
        path: The new bag.
        images: Numbers of changed images by topic.
        regions: Number of blurred regions.
        emptied: Numbers of emptied messages by topic: images without pixels, clouds without points.
        kept: Number of messages that were copied byte for byte.
        unreadable: Numbers of images by topic that could not be decoded and were emptied.
        depth: Depth topics that were kept: they show shapes of people, without faces.
        left_out: Numbers of messages by topic that were not copied: they hold pictures that cannot be redacted.
        unknown: Types by topic of kept messages that may hold pictures: of another package, with bytes.
        perception: State of the perception for replays: "recorded", or why it is missing.
        files: Files that were copied beside the bag.
    """

    path: Path
    images: dict[str, int] = field(default_factory=dict)
    regions: int = 0
    emptied: dict[str, int] = field(default_factory=dict)
    kept: int = 0
    unreadable: dict[str, int] = field(default_factory=dict)
    depth: tuple[str, ...] = ()
    left_out: dict[str, int] = field(default_factory=dict)
    unknown: dict[str, str] = field(default_factory=dict)
    perception: str = ""
    files: tuple[str, ...] = ()


def redact(
    source: Path,
    out: Path,
    privacy: Privacy,
    *,
    whole: bool = False,
    graph: Graph | str | None = None,
    storage: str = "mcap",
    advance: Callable[[int, str], None] = lambda done, what: None,
) -> Redaction:
    """Write the bag ``source`` as the new bag ``out`` without recognisable pictures of people.

    Video and types with images in their fields are left out; all other messages are copied byte for byte. The
    detections of ``graph`` in the images are stored in the folder of the new bag, so that replays of it make the same
    decisions.

    Args:
        source: The bag.
        out: New folder.
        privacy: "blur" blurs people; "no-images" leaves headers of images, and no pixels or points.
        whole: Blur whole people instead of their heads.
        graph: Graph whose perception is kept; by default that of the bag, else Waldo's.
        storage: "mcap" or "sqlite3".
        advance: Called with the number of finished images and the current task.

    Raises:
        BagError: The bag cannot be read, has no images, or ``out`` cannot be written.
    """
    if privacy == "none":
        raise BagError("nothing to redact", where=str(source), remedy="choose blur or no-images")
    with open_bag(source) as bag:
        if not has_pictures(source):
            raise BagError("the bag has no images", where=str(source), remedy="it can be shared as it is")
        seen, why = _perception(source, graph, advance)
        depth = {topic.name for topic in bag.depth_topics}
        with BagWriter(out, storage=storage, only_whole=True) as writer:
            made = Redaction(writer.path, perception=why)
            blurrer = None
            if privacy == "blur":
                pictures = [each.name for each in (*bag.image_topics, *bag.map_topics)]
                blurrer = PeopleBlurrer(bag, pictures, whole, advance)
                made.depth = tuple(sorted(depth))
            _copy(bag, writer, made, blurrer, depth if privacy == "blur" else set())
            with writing(writer.path, BagError):
                if seen is not None:
                    (writer.path / SEEN_FILE).write_bytes(seen)
                made.files = _copy_files(source, writer.path)
    return made


def has_pixels(path: Path) -> bool:
    """Whether the first image of each image topic has pixels. Raises BagError."""
    with open_bag(path) as bag:
        for topic in bag.image_topics:
            for _, message in bag.messages({topic.name: topic.name}):
                if isinstance(message, CompressedImage | Image) and message.data.size:
                    return True
                break
    return False


def has_pictures(path: Path) -> bool:
    """Whether a bag has images or point clouds. Raises BagError."""
    with open_bag(path) as bag:
        return any(
            topic.count and (topic.type in (*IMAGE_TYPES, POINTS) or _holds_hidden_pictures(bag, topic.type))
            for topic in bag.topics
        )


def _holds_hidden_pictures(bag: Bag, name: str) -> bool:
    """Whether messages of a type hold video or images in a field. Textures of visualization_msgs are no pictures."""
    if name in OTHER_IMAGE_TYPES:
        return True
    fields = name not in IMAGE_TYPES and not name.startswith("visualization_msgs/")
    return fields and _IMAGE_FIELD.search(bag.definition(name)[0]) is not None


def _may_hold_pictures(bag: Bag, name: str) -> bool:
    """Whether a type is not one of ROS or socialbot, and has bytes or no definition."""
    if name in types_with(name).types:
        return False
    definition, _ = bag.definition(name)
    return not definition or _BYTES_FIELD.search(definition) is not None


def _perception(
    source: Path, graph: Graph | str | None, advance: Callable[[int, str], None]
) -> tuple[bytes | None, str]:
    """Return the recorded perception of a bag as a file, or None and the reason."""
    advance(0, "storing detections")
    chosen = graph_of(source) if graph is None else load_graph(graph) if isinstance(graph, str) else graph
    with temporary_folder("socialbot-redact-") as folder:
        cache = CacheFolder(Path(folder) / "cache", 1 << 40)
        try:
            result = replay(source, chosen, Path(folder) / "run", cache=PerceptionCache(cache))
        except BagError as error:
            return None, error.what
        files = cache.files()
        return (read_bytes(files[0].path), "recorded") if files else (None, result.results["bag"]["cache"])


def _copy(bag: Bag, writer: BagWriter, made: Redaction, blurrer: PeopleBlurrer | None, kept: set[str]) -> None:
    types = RosbagsTypes()
    latched = {topic.name: bag.is_latched(topic.name) for topic in bag.topics}
    hidden = {topic.name for topic in bag.topics if _holds_hidden_pictures(bag, topic.type)}
    others = [topic for topic in bag.topics if topic.name not in hidden and _may_hold_pictures(bag, topic.type)]
    made.unknown = {topic.name: topic.type for topic in others}
    for topic, time, name, data in bag.raw_messages({each.name: each.name for each in bag.topics}):
        if topic in hidden:
            made.left_out[topic] = made.left_out.get(topic, 0) + 1
            continue
        if topic not in kept and name in (*IMAGE_TYPES, POINTS):
            if name == POINTS and blurrer is not None:
                made.depth = tuple(sorted({*made.depth, topic}))
                made.kept += 1
            else:
                data = _redacted(types, topic, time, name, data, made, blurrer)
        else:
            made.kept += 1
        definition, type_hash = bag.definition(name)
        writer.write_raw(topic, name, data, time, latched=latched[topic], type_hash=type_hash, definition=definition)


def _redacted(
    types: RosbagsTypes, topic: str, time: int, name: str, data: bytes, made: Redaction, blurrer: PeopleBlurrer | None
) -> bytes:
    """Return a message with an image or points, redacted."""
    message = types.deserialize(data, name)
    if blurrer is not None:
        try:
            count = blurrer.blur(topic, time, name, message)
        except ImageError:
            made.unreadable[topic] = made.unreadable.get(topic, 0) + 1
        else:
            if count:
                made.images[topic] = made.images.get(topic, 0) + 1
                made.regions += count
                return types.serialize(message)
            made.kept += 1
            return data
    made.emptied[topic] = made.emptied.get(topic, 0) + 1
    message.data = np.zeros(0, np.uint8)
    for name in ("width", "height", "step", "row_step"):
        if hasattr(message, name):
            setattr(message, name, 0)
    return types.serialize(message)


def _copy_files(source: Path, out: Path) -> tuple[str, ...]:
    """Copy the graph in a bag, and the pose and the ground truth beside it."""
    copied = []
    pairs = [(pose_beside(source), pose_beside(out)), (truth_beside(source), truth_beside(out))]
    if source.is_dir():
        pairs += [(file, out / file.name) for file in source.glob("*.yaml") if file.name != "metadata.yaml"]
    for one, other in pairs:
        if one.is_file() and not other.exists():
            replace_file(other, read_bytes(one))
            copied.append(other.name)
    return tuple(copied)


class PeopleBlurrer:
    """Blurs people in the images of a bag: where the detector finds them now, or shortly before or after."""

    def __init__(
        self,
        bag: Bag,
        topics: Sequence[str],
        whole: bool,
        advance: Callable[[int, str], None] = lambda done, what: None,
    ) -> None:
        self._whole = whole
        self._types = RosbagsTypes()
        finder = PeopleFinder()
        self._times: dict[str, list[int]] = {}
        self._boxes: dict[str, list[Boxes]] = {}
        done = 0
        for topic, time, name, data in bag.raw_messages({each: each for each in topics}):
            done += 1
            advance(done, "searching people")
            try:
                boxes = finder.find(_pixels(name, self._types.deserialize(data, name)))
            except ImageError:
                continue
            self._times.setdefault(topic, []).append(time)
            self._boxes.setdefault(topic, []).append(boxes)

    def blur(self, topic: str, time: int, name: str, message: Any) -> int:
        """Blur people in a ROS image; return the number of regions. Raises ImageError."""
        boxes = self.boxes_at(topic, time)
        pixels = _pixels(name, message)
        if not len(boxes):
            return 0
        pixels = blurred(pixels, boxes, whole=self._whole)
        if name == IMAGE_TYPES[0]:
            message.encoding, message.step, message.is_bigendian = "bgr8", 3 * pixels.shape[1], 0
            message.data = np.ascontiguousarray(pixels).reshape(-1)
        elif "png" in message.format.lower():
            message.data = cv2.imencode(".png", _in_order(pixels, message.format))[1].reshape(-1)
        else:
            message.data = encode_jpeg(_in_order(pixels, message.format), QUALITY)
        return len(boxes)

    def boxes_at(self, topic: str, time: int) -> Boxes:
        """Return the boxes of people in the images of ``topic`` around ``time`` of reception (ns), (n, 4)."""
        times = self._times.get(topic, [])
        first, last = bisect_left(times, time - NEAR_NS), bisect_right(times, time + NEAR_NS)
        found = self._boxes[topic][first:last] if times else []
        return np.vstack(found) if found else np.zeros((0, 4))


def _in_order(pixels: np.ndarray, format: str) -> np.ndarray:
    """Exchange red and blue where the format says that the file has them exchanged."""
    return pixels[:, :, ::-1] if "compressed rgb" in format.lower() else pixels


def _pixels(name: str, message: Any) -> np.ndarray:
    kind = codec.decodable_types()[name]
    decoded = codec.decode(kind, message, stamp=0)
    if isinstance(decoded, CompressedImage):
        return bgr_from_compressed(decoded)
    assert isinstance(decoded, Image)
    return bgr_from_image(decoded)
