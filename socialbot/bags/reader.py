"""Read bags without ROS: rosbag2 folders, .mcap and .db3 files, split or compressed, and ROS 1 .bag files.

A damaged message is counted in `Bag.skipped`, and reading continues. A file with a broken structure raises one BagError
after all intact messages. A truncated .mcap file, such as after a power failure, is read up to the end of its intact
part, and `Bag.damage` describes it.
"""

from __future__ import annotations

import functools
import heapq
import itertools
import logging
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from rosbags.interfaces import Connection, ConnectionExtRosbag2, QosDurability

from socialbot.bags import codec
from socialbot.bags._files import Reader, broken, open_file, open_folder
from socialbot.bags._files import natural as natural
from socialbot.bags.cameras import (
    ImageKind,
    best,
    best_depth,
    best_points,
    camera_info_of,
    depth_first,
    image_kind,
    transform_topics,
)
from socialbot.bags.repair import CLOCKS_APART_S, Receptions, Stamps, clock_offsets, nearest_offset
from socialbot.bags.types import RosbagsTypes, TypeProblem, deserialize, is_ros1, to_cdr, type_problem
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, suggestion
from socialbot.core.messages import (
    CameraInfo,
    CompressedDepth,
    CompressedImage,
    DepthImage,
    DepthInfo,
    Image,
    Message,
    PointCloud,
    Structured,
    Transforms,
)

__all__ = ["IMAGE_TYPES", "Bag", "BagWriter", "RosbagsTypes", "Skipped", "BagTopic", "open_bag"]

log = logging.getLogger("socialbot.bags")

_reported: set[tuple[Path, str]] = set()
"""Damage that was logged, by bag: a command opens its bag several times, but says this once."""

T = TypeVar("T")

IMAGE_TYPES = (codec.ROS_TYPES[Image], codec.ROS_TYPES[CompressedImage])
FFMPEG_PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
FOXGLOVE_VIDEO = "foxglove_msgs/msg/CompressedVideo"
FOXGLOVE_IMAGE = "foxglove_msgs/msg/CompressedImage"
FOXGLOVE_RAW_IMAGE = "foxglove_msgs/msg/RawImage"
DECODED_TYPES = (FFMPEG_PACKET, FOXGLOVE_VIDEO, FOXGLOVE_IMAGE, FOXGLOVE_RAW_IMAGE)
OTHER_IMAGE_TYPES = (*DECODED_TYPES, "theora_image_transport/msg/Packet")
"""Types with images or video that no node takes. A new bag with images can be made of `DECODED_TYPES`."""

SENSOR_TYPES = (*IMAGE_TYPES, codec.ROS_TYPES[PointCloud])
"""Types whose header has the time of a measurement; latched types may be older than their reception."""

MEASURED = (DepthImage, CompressedDepth, PointCloud)
"""Messages with distances."""

SHORTEST_S = 0.01
"""Shortest duration of a bag from which rates are computed: one frame and its camera_info arrive together."""


@dataclass(frozen=True)
class BagTopic:
    """Topic of a bag, with its ROS type and message count."""

    name: str
    type: str
    count: int


@dataclass(frozen=True)
class MessageLocation:
    """Location of a message: the index of the file, the topic and the time of reception (ns).

    ``stamp`` (ns) is that of `Bag.messages`, ``header`` that in the message.
    """

    stamp: int
    file: int
    topic: str
    time: int
    header: int


@dataclass
class Skipped:
    """Damaged messages of one topic: their number, and the first error."""

    count: int
    first: str


def open_bag(path: str | Path) -> Bag:
    """Open the bag at ``path``. Close it, or use it as a context manager.

    Raises:
        BagError: There is no bag, it has no readable messages, or its files are broken.
    """
    path = Path(path)
    if not os.path.exists(path):
        raise BagError("no such file or folder", where=str(path), remedy="check the path of the bag")
    damage: list[str] = []
    readers = open_folder(path, damage) if path.is_dir() else [open_file(path, damage)]
    bag = Bag(path, readers, tuple(damage))
    if not any(topic.count for topic in bag.topics):
        bag.close()
        raise BagError("the bag holds no messages", where=str(path), remedy="record again while the robot publishes")
    for what in damage:
        key = (path.resolve(), what.removeprefix(str(path)))
        if key not in _reported:
            _reported.add(key)
            log.warning("%s", what)
    return bag


class Bag(AbstractContextManager["Bag"]):
    """Bag opened by `open_bag`.

    ``damage`` describes missing parts of the files, ``skipped`` the damaged messages in the last pass over each topic.
    """

    def __init__(self, path: Path, readers: Sequence[Reader], damage: tuple[str, ...] = ()) -> None:
        self.path = path
        self.damage = damage
        self.skipped: dict[str, Skipped] = {}
        self._readers = readers
        self._connections = [connection for reader in readers for connection in reader.connections]
        self._kinds: dict[str, ImageKind] = {}
        self._lags: dict[str, int] | None = None
        """Time (ns) from the first stamp to its reception, by topic of a sensor."""
        topics: dict[str, BagTopic] = {}
        for each in self._connections:
            before = topics.get(each.topic)
            topics[each.topic] = BagTopic(each.topic, each.msgtype, each.msgcount + (before.count if before else 0))
        self.topics: tuple[BagTopic, ...] = tuple(topics[name] for name in sorted(topics))
        filled = [reader for reader in readers if reader.message_count]
        self.start: int = min((reader.start_time for reader in filled), default=0)
        self.end: int = max((reader.end_time - 1 for reader in filled), default=0)

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        for reader in self._readers:
            reader.close()
        self._readers = ()

    @property
    def duration_s(self) -> float:
        """Duration from the first to the last message."""
        return (self.end - self.start) / SECOND

    @property
    def image_topics(self) -> tuple[BagTopic, ...]:
        """Topics with raw or compressed pictures, colour first and infrared last, without depth images and maps."""
        kinds = {topic: self.image_kind(topic) for topic in self._filled(*IMAGE_TYPES)}
        return tuple(sorted((topic for topic, kind in kinds.items() if kind < ImageKind.DEPTH), key=kinds.__getitem__))

    @property
    def preferred_image_topics(self) -> list[str]:
        """The best image topic of each camera with images of the best kind."""
        kinds = {topic.name: self.image_kind(topic) for topic in self.image_topics}
        return best(kinds) if kinds else []

    @property
    def depth_topics(self) -> tuple[BagTopic, ...]:
        """Topics with depth images, raw or compressed."""
        return tuple(topic for topic in self._filled(*IMAGE_TYPES) if self.image_kind(topic) is ImageKind.DEPTH)

    @property
    def map_topics(self) -> tuple[BagTopic, ...]:
        """Topics with images of other values: disparities, confidences, classes and the like."""
        return tuple(topic for topic in self._filled(*IMAGE_TYPES) if self.image_kind(topic) is ImageKind.MAP)

    def image_kind(self, topic: BagTopic) -> ImageKind:
        """Kind of the images on ``topic``, from its name and its first image."""
        if topic.name not in self._kinds:
            kind = codec.decodable_types()[topic.type]
            first = self._first(topic.name)
            message = None
            if first is not None:
                try:
                    message = codec.decode(kind, deserialize(first[0], first[2]))
                except Exception as error:  # noqa: BLE001 - damaged bytes make rosbags fail in any way
                    log.debug("%s: the first image of %s cannot be read: %s", self.path, topic.name, error)
            self._kinds[topic.name] = image_kind(topic.name, message)
        return self._kinds[topic.name]

    def _filled(self, *types: str) -> list[BagTopic]:
        return [topic for topic in self.topics if topic.type in types and topic.count]

    def _first(self, name: str) -> tuple[Connection, int, bytes] | None:
        """First message of a topic, with its connection and time of reception; None if there is none."""
        found = []
        for reader in self._readers:
            wanted = [connection for connection in reader.connections if connection.topic == name]
            try:
                found += list(itertools.islice(reader.messages(wanted), 1)) if wanted else []
            except Exception as error:  # noqa: BLE001 - reading the topic itself reports the damage
                log.debug("%s: %s cannot be read: %s", self.path, name, error)
        timed = [each for each in found if isinstance(each[1], int)]  # a column of SQLite holds anything
        return min(timed, key=lambda each: each[1], default=None)

    def rate_hz(self, topic: BagTopic) -> float | None:
        """Messages of ``topic`` per second of the bag; None for one message, or a bag shorter than `SHORTEST_S`."""
        if topic.count < 2 or self.duration_s < SHORTEST_S:
            return None
        return (topic.count - 1) / self.duration_s

    def topic(self, name: str) -> BagTopic:
        """Return the topic ``name``. Raises BagError if the bag has none."""
        found = next((topic for topic in self.topics if topic.name == name), None)
        if found is None:
            raise self._refused(f"no topic {name!r} in the bag", suggestion(name, self._names()))
        return found

    def definition(self, type_name: str) -> tuple[str, str]:
        """Definition and hash of a ROS 2 type in the bag, or empty texts."""
        for connection in self._connections:
            if connection.msgtype == type_name and not is_ros1(connection):
                return connection.msgdef.data, connection.digest
        return "", ""

    def is_latched(self, name: str) -> bool:
        """Whether the topic was latched (transient local)."""
        extras = [connection.ext for connection in self._connections if connection.topic == name]
        return any(
            any(qos.durability is QosDurability.TRANSIENT_LOCAL for qos in extra.offered_qos_profiles)
            if isinstance(extra, ConnectionExtRosbag2)
            else bool(extra.latching)
            for extra in extras
        )

    def choose_image_topic(self, wanted: str | None = None) -> BagTopic:
        """Return the ``wanted`` image topic, or else the best one of the only camera.

        Colour is preferred to grey and infrared images, rectified to raw ones of one camera, and raw to compressed.

        Raises:
            BagError: There is none, there are several cameras and none is ``wanted``, or the wanted one has no images.
        """
        topics = self.image_topics
        names = [topic.name for topic in topics]
        if wanted is None and names:
            chosen = self.preferred_image_topics
            if len(chosen) > 1:
                raise self._refused(f"the bag has {len(names)} image topics", f"choose one of {', '.join(names)}")
            if len(names) > 1:
                others = ", ".join(name for name in names if name != chosen[0])
                log.info("%s: images are taken from %s, not from %s", self.path, chosen[0], others)
            return self.topic(chosen[0])
        if wanted in names:
            return self.topic(wanted)
        maps = [topic.name for topic in self.map_topics]
        if wanted is not None and wanted in (*maps, *(topic.name for topic in self.depth_topics)):
            what = "values such as confidences, disparities or classes" if wanted in maps else "depth images"
            remedy = f"choose one of {', '.join(names)}" if names else "record a colour image as well"
            raise self._refused(f"{wanted} has {what}, not pictures", remedy)
        if not names:
            depth = " but those of depth" if self.depth_topics else ""
            depth += f" but values, not pictures, on {', '.join(maps)}" if maps and not depth else ""
            empty = [topic.name for topic in self.topics if topic.type in IMAGE_TYPES and not topic.count]
            remedy = f"record an image topic; the bag has {', '.join(self._names())}"
            if empty:
                remedy = f"record while the camera publishes: no messages on {', '.join(empty)}"
            if videos := [topic.name for topic in self._filled(*OTHER_IMAGE_TYPES)]:
                remedy = f"republish {', '.join(videos)} as raw or JPEG images"
            if self._filled(*DECODED_TYPES):
                remedy = f"decode its images first: socialbot bag convert {self.path} NEW --decode"
            raise self._refused(f"the bag has no images{depth}", remedy)
        assert wanted is not None
        known = wanted in self._names()
        what = f"{wanted} is {self.topic(wanted).type}" if known else f"no topic {wanted!r} in the bag"
        if known and not self.topic(wanted).count:
            what = f"{wanted} has no messages"
        raise self._refused(what, suggestion(wanted, names))

    def camera_info_topic_for(self, image_topic: str) -> BagTopic | None:
        """CameraInfo topic of the images on ``image_topic``, if the bag has one.

        ``/camera/image_raw`` and ``/camera/image_raw/compressed`` both belong to ``/camera/camera_info``.
        """
        infos = [topic.name for topic in self._filled(codec.ROS_TYPES[CameraInfo])]
        images = [topic.name for topic in self._filled(*IMAGE_TYPES)]
        found = camera_info_of(image_topic, infos, images, self._frame)
        return self.topic(found) if found else None

    def depth_sensors_for(self, image_topic: str, wanted: str | None = None) -> dict[str, type[Message]]:
        """Topics that measure the distances of what ``image_topic`` shows, and their message types.

        A depth image with its CameraInfo, a point cloud, and the transforms that place them in the camera. Empty if the
        bag has none. ``wanted`` selects one of the topics with distances, by its name or the beginning of its name.

        Raises:
            BagError: No topic with distances fits ``wanted``.
        """
        frame = self._frame(image_topic)
        names = [topic.name for topic in (*self.depth_topics, *self._filled(codec.ROS_TYPES[PointCloud]))]
        if wanted is not None:
            fitting = [name for name in names if name == wanted or name.startswith(f"{wanted.rstrip('/')}/")]
            if not fitting:
                remedy = suggestion(wanted, names) if names else "record a depth or point cloud topic"
                raise self._refused(f"{wanted} has no depth images or point clouds", remedy)
            names = fitting
        depths = {topic.name: self._frame(topic.name) for topic in self.depth_topics if topic.name in names}
        clouds = {name: self._frame(name) for name in names if name not in depths}
        found: dict[str, type[Message]] = {}
        if (depth := best_depth(image_topic, frame, depths)) is not None:
            raw = self.topic(depth).type == codec.ROS_TYPES[DepthImage]
            found[depth] = DepthImage if raw else CompressedDepth
            info = self.camera_info_topic_for(depth)
            if info is not None and info != self.camera_info_topic_for(image_topic):
                found[info.name] = DepthInfo
        if (points := best_points(clouds, with_depth=depth is not None)) is not None:
            found[points] = PointCloud
        if any(self._frame(name) != frame for name in found):
            found |= self.transforms_for(image_topic)
        return found

    def transforms_for(self, image_topic: str) -> dict[str, type[Message]]:
        """The topics of transforms in the namespace of ``image_topic``, or in one around it, and their types."""
        types = codec.decodable_types()
        names = [topic.name for topic in self.topics if types.get(topic.type) is Transforms]
        return dict.fromkeys(transform_topics(image_topic, names), Transforms)

    def _frame(self, name: str) -> str:
        """Frame of the first message on a topic; empty if unknown."""
        first = self._first(name)
        if first is None:
            return ""
        try:
            return deserialize(first[0], first[2]).header.frame_id.lstrip("/")
        except Exception as error:  # noqa: BLE001 - damaged bytes make rosbags fail in any way
            log.debug("%s: the first message of %s cannot be read: %s", self.path, name, error)
            return ""

    def messages(
        self, topics: Mapping[str, str], kinds: Mapping[str, type[Message]] | None = None
    ) -> Iterator[tuple[str, Message]]:
        """Yield graph topic and message of ``topics`` (bag topic to graph topic), in the order of the bag.

        Header stamps are used; those of images are converted to the clock of the reception. A stamp of zero, or before
        the previous one of the topic, is replaced: by the previous stamp plus the time between the two receptions. A
        first stamp of zero becomes the time of reception. Depth of the graph comes before the picture of its stamp.

        Args:
            topics: The bag topics to read, and their names in the graph.
            kinds: Message types by graph topic; default: the schema of a structured message.

        Raises:
            BagError: A topic is missing, its type is unknown, or the file is truncated.
        """
        self._expect_known_types(topics, codec.decodable_types())
        decoded = self._decoded(topics, kinds or {})
        depth = {topic for topic in topics.values() if (kinds or {}).get(topic) in MEASURED}
        if not depth:
            return decoded
        pictures = {topic for name, topic in topics.items() if self.topic(name).type in IMAGE_TYPES} - depth
        return depth_first(decoded, lambda each: (each[0], each[1].stamp), depth, pictures)

    def _expect_known_types(self, names: Collection[str], known: Collection[str]) -> None:
        """Raise BagError if a topic is missing, or its type is neither ``known`` nor defined."""
        for name in names:
            problem = None if self.topic(name).type in known else self._type_problem(name)
            if problem is not None:
                raise self._refused(f"the type of {name}, {self.topic(name).type}, {problem.what}", problem.remedy)

    def _type_problem(self, name: str) -> TypeProblem | None:
        """Reason why messages of a topic cannot be read."""
        found = [type_problem(one) for reader in self._readers for one in reader.connections if one.topic == name]
        return next(filter(None, found), None)

    def locations(self, name: str) -> Iterator[MessageLocation]:
        """Yield the locations of intact messages of a topic with headers, with the stamps of `messages`.

        Raises:
            BagError: The file is truncated.
        """
        stamps = self.stamps(name)
        times = Receptions(str(self.path))
        for file, connection, time, data in self._read_files([name]):
            ros_message = self._attempt(connection, functools.partial(deserialize, connection, data))
            header = None if ros_message is None else codec.header_stamp(ros_message)
            received = times.next(time)
            if header is not None:
                yield MessageLocation(stamps.next(header, received), file, name, time, header)

    def stamps(self, name: str) -> Stamps:
        """New correction of the header stamps of the topic ``name``.

        All sensors of a bag share one clock, so that images and depth stay synchronous. So do transforms that move.
        """
        kind = self.topic(name).type
        moving = codec.decodable_types().get(kind) is Transforms and not self._is_static(name)
        if kind not in SENSOR_TYPES and not moving:
            return Stamps(name)
        if self._lags is None:
            stamped = self._filled(*SENSOR_TYPES, codec.ROS_TYPES[CameraInfo])
            lags = {topic.name: self._first_lag(topic.name) for topic in stamped}
            self._lags = {topic: lag for topic, lag in lags.items() if lag is not None}
        offsets = clock_offsets(self._lags)
        if not moving:
            return Stamps(name, offset=offsets.get(name, 0), repeats=False)
        lag = self._first_lag(name)
        offset = 0 if lag is None else nearest_offset(lag, self._lags, offsets)
        return Stamps(name, offset=offset, slack_s=2 * CLOCKS_APART_S)

    def _is_static(self, name: str) -> bool:
        return name.endswith("tf_static") or self.is_latched(name)

    def _first_lag(self, name: str) -> int | None:
        """Time (ns) from the header stamp of the first message of a topic to its reception; None without a stamp."""
        first = self._first(name)
        if first is None:
            return None
        connection, time, data = first
        try:
            ros_message = deserialize(connection, data)
            stamp = codec.header_stamp(ros_message)
            if codec.decodable_types().get(connection.msgtype) is Transforms:
                stamp = codec.decode(Transforms, ros_message).newest
        except Exception as error:  # noqa: BLE001 - damaged bytes make rosbags fail in any way
            log.debug("%s: the first message of %s cannot be read: %s", self.path, name, error)
            return None
        return time - stamp if stamp else None

    def message_at(self, place: MessageLocation) -> Message | None:
        """Read the message at one of `locations`, with its stamp; None if it is damaged. Raises BagError."""
        reader = self._readers[place.file]
        wanted = [connection for connection in reader.connections if connection.topic == place.topic]
        try:
            found = next(iter(reader.messages(wanted, place.time, place.time + 1)), None)
        except Exception as error:
            raise broken(self.path, error) from error
        if found is None:
            return None
        connection, _, data = found
        kind = codec.message_type_of(connection.msgtype)
        return self._attempt(connection, lambda: codec.decode(kind, deserialize(connection, data), stamp=place.stamp))

    def raw_messages(self, topics: Mapping[str, str]) -> Iterator[tuple[str, int, str, bytes]]:
        """Yield graph topic, time of reception (ns), ROS type and CDR bytes of ``topics``.

        Messages of ROS 1 bags are converted to ROS 2. Unknown types are accepted; other errors are those of `messages`.
        """
        for name in topics:
            self.topic(name)

        def read() -> Iterator[tuple[str, int, str, bytes]]:
            for connection, time, data in self._read(topics):
                cdr = self._attempt(connection, functools.partial(to_cdr, connection, data))
                if cdr is not None:
                    yield topics[connection.topic], time, connection.msgtype, cdr

        return read()

    def ros_messages(self, names: Sequence[str]) -> Iterator[tuple[str, int, Any]]:
        """Yield topic, time of reception (ns) and deserialized message of the topics ``names``, of any type.

        Raises:
            BagError: A topic is missing, its type is unknown, or the file is truncated.
        """
        self._expect_known_types(names, ())
        for connection, time, data in self._read(names):
            message = self._attempt(connection, functools.partial(deserialize, connection, data))
            if message is not None:
                yield connection.topic, time, message

    def check(self) -> Mapping[str, Skipped]:
        """Read all messages, and return the damaged ones by topic. Raises BagError if a file is truncated."""
        for connection, _, data in self._read(self._names()):
            read = deserialize if type_problem(connection) is None else to_cdr
            self._attempt(connection, functools.partial(read, connection, data))
        return self.skipped

    def _decoded(self, topics: Mapping[str, str], kinds: Mapping[str, type[Message]]) -> Iterator[tuple[str, Message]]:
        stamps = {name: self.stamps(name) for name in topics}
        statics = {name for name in topics if self._is_static(name)}

        def decode(connection: Connection, time: int, data: bytes) -> Message:
            ros_message = deserialize(connection, data)
            kind = kinds.get(topics[connection.topic]) or codec.message_type_of(connection.msgtype)
            message = codec.decode(kind, ros_message, stamp=time)
            if isinstance(message, Transforms) and connection.topic not in statics:
                newest = message.newest
                return (
                    message if newest is None else message.shifted(stamps[connection.topic].next(newest, time) - newest)
                )
            header = codec.header_stamp(ros_message)
            if header is None or isinstance(message, Structured):
                return message
            stamp = stamps[connection.topic].next(header, time)
            return message if stamp == message.stamp else msgspec.structs.replace(message, stamp=stamp)

        for item in self._read(topics):
            message = self._attempt(item[0], functools.partial(decode, *item))
            if message is not None:
                yield topics[item[0].topic], message

    def _read(self, names: Collection[str]) -> Iterator[tuple[Connection, int, bytes]]:
        for name in names:
            self.skipped.pop(name, None)
        times = Receptions(str(self.path))
        for _, connection, time, data in self._read_files(names):
            yield connection, times.next(time), data

    def _read_files(self, names: Collection[str]) -> Iterator[tuple[int, Connection, int, bytes]]:
        """Yield file index, connection, uncorrected time of reception and bytes, in the order of time."""
        streams = []
        for file, reader in enumerate(self._readers):
            wanted = [connection for connection in reader.connections if connection.topic in names]
            if wanted:
                streams.append(_numbered(file, reader.messages(wanted)))
        try:
            yield from heapq.merge(*streams, key=lambda item: item[2])
        except Exception as error:
            raise broken(self.path, error) from error

    def _attempt(self, connection: Connection, read: Callable[[], T]) -> T | None:
        try:
            return read()
        except Exception as error:  # noqa: BLE001 - damaged bytes make rosbags fail in any way
            first = f"{type(error).__name__}: {error}"
            skipped = self.skipped.setdefault(connection.topic, Skipped(0, first))
            if not skipped.count:
                log.warning("%s: %s: skipping damaged messages: %s", self.path, connection.topic, first)
            skipped.count += 1
            return None

    def _names(self) -> list[str]:
        return [topic.name for topic in self.topics]

    def _refused(self, what: str, remedy: str) -> BagError:
        return BagError(what, where=str(self.path), remedy=remedy)


def _numbered(
    file: int, messages: Iterator[tuple[Connection, int, bytes]]
) -> Iterator[tuple[int, Connection, int, bytes]]:
    for connection, time, data in messages:
        if not isinstance(time, int):  # a column of SQLite holds anything
            raise TypeError(f"a message was received at {time!r}")
        yield file, connection, time, data
