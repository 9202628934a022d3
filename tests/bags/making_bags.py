"""Bags for tests: with pictures, camera information and sentences, written by us and by others."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from socialbot.bags.codec import encode
from socialbot.bags.reader import BagWriter, RosbagsTypes, open_bag
from socialbot.bags.repair import MAGIC
from socialbot.core.clock import SECOND
from socialbot.core.messages import CameraInfo, Image, Message, Utterance

TYPES = RosbagsTypes()
START = 1_700_000_000 * SECOND
RAW, INFO, SAY = "/camera/image_raw", "/camera/camera_info", "/speech/say"
K = (500.0, 0.0, 4.0, 0.0, 500.0, 3.0, 0.0, 0.0, 1.0)


def picture(stamp: int, *, size: tuple[int, int] = (6, 8)) -> Image:
    pixels = np.full((*size, 3), stamp % 251, np.uint8)
    return Image.from_bgr(pixels, stamp=stamp, frame_id="camera")


def times(count: int) -> list[int]:
    return [START + index * SECOND // 10 for index in range(count)]


def fill(bag: BagWriter, count: int = 10, *, size: tuple[int, int] = (6, 8)) -> None:
    """Pictures taken 5 ms before they are received, with a sentence and camera information now and then."""
    for index, time in enumerate(times(count)):
        bag.write(RAW, picture(time - 5_000_000, size=size), time)
        if index % 5 == 0:
            bag.write(INFO, CameraInfo(stamp=time, frame_id="camera", width=8, height=6, k=K), time + 1)
            bag.write(SAY, Utterance(stamp=time, id=f"u{index}", text="hello"), time + 2)


def make(path: Path, *, storage: str = "mcap", count: int = 10, size: tuple[int, int] = (6, 8)) -> Path:
    with BagWriter(path, storage=storage) as bag:
        fill(bag, count, size=size)
    return path


def make_with_rosbags(
    path: Path, contents: Sequence[tuple[str, int, Message | bytes]], *, mode: CompressionMode = CompressionMode.NONE,
    storage: StoragePlugin = StoragePlugin.SQLITE3,
) -> Path:  # fmt: skip
    """A bag with any bytes in it; those that are no messages are said to be pictures."""
    writer = Writer(path, version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    store = get_typestore(Stores.ROS2_JAZZY)
    with writer:
        connections = {}
        for topic, time, message in contents:
            if isinstance(message, bytes):
                name, data = "sensor_msgs/msg/Image", message
            else:
                ros = encode(message, TYPES)
                name, data = ros.__msgtype__, TYPES.serialize(ros)
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            writer.write(connections[topic], time, data)
    return path


def make_ros1(path: Path, count: int = 10) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    header, time_type = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    with Ros1Writer(path) as writer:
        pictures = writer.add_connection(RAW, "sensor_msgs/msg/Image", typestore=store)
        infos = writer.add_connection(INFO, "sensor_msgs/msg/CameraInfo", typestore=store)
        for index, time in enumerate(times(count)):
            seconds, rest = divmod(time - 5_000_000, SECOND)
            stamped = header(seq=index, stamp=time_type(sec=seconds, nanosec=rest), frame_id="camera")
            image = encode(picture(time - 5_000_000), TYPES)
            image.header = stamped
            writer.write(pictures, time, store.serialize_ros1(image, "sensor_msgs/msg/Image"))
            if index % 5 == 0:
                info = encode(CameraInfo(stamp=1, frame_id="camera", width=8, height=6, k=K), TYPES)
                region = store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
                ros1 = store.types["sensor_msgs/msg/CameraInfo"](
                    stamped, 6, 8, "plumb_bob", info.d, info.k, info.r, info.p, 0, 0, region
                )
                writer.write(infos, time + 1, store.serialize_ros1(ros1, "sensor_msgs/msg/CameraInfo"))
    return path


def make_mcap(
    path: Path,
    profile: str,
    channels: Sequence[tuple[str, str, str, bytes, str, Sequence[bytes]]],
    metadata: Mapping[str, str] | None = None,
) -> Path:
    """An .mcap file without index, of channels: topic, type, language of the schema, schema, encoding, messages."""

    def text(content: str | bytes) -> bytes:
        data = content.encode() if isinstance(content, str) else content
        return struct.pack("<I", len(data)) + data

    notes = b"".join(text(each) for pair in (metadata or {}).items() for each in pair)
    records = [(1, text(profile) + text("recorder of others"))]
    for number, (topic, kind, language, schema, encoding, _) in enumerate(channels, 1):
        records.append((3, struct.pack("<H", number) + text(kind) + text(language) + text(schema)))
        records.append((4, struct.pack("<HH", number, number) + text(topic) + text(encoding) + text(notes)))
    messages = [(time, number, data) for number, channel in enumerate(channels, 1)
                for time, data in zip(times(len(channel[5])), channel[5], strict=True)]  # fmt: skip
    records += [(5, struct.pack("<HIQQ", number, 0, time, time) + data) for time, number, data in sorted(messages)]
    records += [(15, bytes(4)), (2, bytes(20))]
    path.write_bytes(MAGIC + b"".join(struct.pack("<BQ", kind, len(data)) + data for kind, data in records) + MAGIC)
    return path


def contents(path: Path, *topics: str) -> list[tuple[str, Message]]:
    with open_bag(path) as bag:
        names = topics or tuple(topic.name for topic in bag.topics)
        return list(bag.messages({name: name for name in names}))


def check_pictures(path: Path, count: int = 10) -> None:
    found = contents(path, RAW)
    assert [message.stamp for _, message in found] == [time - 5_000_000 for time in times(count)]
    for _, message in found:
        assert isinstance(message, Image)
        assert np.array_equal(message.bgr(), picture(message.stamp).bgr())
