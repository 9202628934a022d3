"""MCAP files without parts of their index: all layouts that the format allows."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Sequence
from pathlib import Path

import pytest
from rosbags.rosbag2 import storage_mcap

from socialbot.bags.reader import open_bag
from socialbot.bags.repair import MAGIC
from tests.bags.making_bags import START

zstd = vars(storage_mcap)["zstd"]
TOPICS = ("/a", "/b")
COUNT, IN_A_CHUNK = 24, 6


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def sentence(number: int) -> bytes:
    return struct.pack("<II", 0x100, number + 1) + b"x" * number + b"\0"


SCHEMA = record(3, struct.pack("<H", 1) + text("std_msgs/msg/String") + text("ros2msg") + text("string data"))
CHANNELS = b"".join(
    record(4, struct.pack("<HH", number, 1) + text(topic) + text("cdr") + text(""))
    for number, topic in enumerate(TOPICS, 1)
)
PARTS = ("chunks", "schemas", "channels", "statistics", "chunk index", "message index")
LAYOUTS = [
    frozenset(each) for count in range(len(PARTS) + 1) for each in itertools.combinations(PARTS, count)
    if "chunks" in each or not {"chunk index", "message index"} & set(each)
]  # fmt: skip


def write(file: Path, parts: frozenset[str], numbers: Sequence[int], *, types_in_chunks: bool = True) -> None:
    """A file of sentences in the order of ``numbers``, with these parts; one each 10 ms."""

    def stamp(number: int) -> int:
        return START + number * 10_000_000

    def message(number: int) -> bytes:
        head = struct.pack("<HIQQ", 1 + number % 2, 0, stamp(number), stamp(number))
        return record(5, head + sentence(number))

    data, summary, begun = MAGIC + record(1, text("ros2") + text("")), b"", False
    if not types_in_chunks or "chunks" not in parts:
        data += SCHEMA + CHANNELS
        begun = True
    groups = [numbers[at : at + IN_A_CHUNK] for at in range(0, len(numbers), IN_A_CHUNK)]
    indices = b""
    for group in groups:
        if "chunks" not in parts:
            data += b"".join(map(message, group))
            continue
        content, places = b"" if begun else SCHEMA + CHANNELS, []
        begun = True
        for number in group:
            places.append((number, len(content)))
            content += message(number)
        packed = zstd.compress(content)
        times = struct.pack("<QQ", stamp(min(group)), stamp(max(group)))
        sizes = text("zstd") + struct.pack("<Q", len(packed))
        chunk = record(6, times + struct.pack("<QI", len(content), 0) + sizes + packed)
        index, offsets = b"", b""
        for channel in (1, 2):
            entries = b"".join(struct.pack("<QQ", stamp(n), at) for n, at in places if 1 + n % 2 == channel)
            offsets += struct.pack("<HQ", channel, len(data) + len(chunk) + len(index))
            index += record(7, struct.pack("<HI", channel, len(entries)) + entries)
        if "message index" not in parts:
            index = offsets = b""
        place = struct.pack("<QQI", len(data), len(chunk), len(offsets)) + offsets + struct.pack("<Q", len(index))
        indices += record(8, times + place + sizes + struct.pack("<Q", len(content)))
        data += chunk + index
    data += record(15, bytes(4))
    summary = (SCHEMA if "schemas" in parts else b"") + (CHANNELS if "channels" in parts else b"")
    if "statistics" in parts:
        counts = struct.pack("<IHQHQ", 20, 1, len(numbers) // 2, 2, len(numbers) // 2)
        number_of_chunks = len(groups) if "chunks" in parts else 0
        times = struct.pack("<QQ", stamp(0), stamp(len(numbers) - 1))
        summary += record(11, struct.pack("<QHIIII", len(numbers), 1, 2, 0, 0, number_of_chunks) + times + counts)
    if "chunk index" in parts:
        summary += indices
    footer = record(2, struct.pack("<QQI", len(data) if summary else 0, 0, 0))
    file.write_bytes(data + summary + footer + MAGIC)


IN_ORDER = list(range(COUNT))
ALMOST = [0, *(number + (1, -1)[number % 2 == 0] for number in range(1, COUNT - 1)), COUNT - 1]
"""Messages of two topics whose receptions were written in another order."""


@pytest.mark.parametrize("order", [IN_ORDER, ALMOST], ids=["in order", "almost"])
@pytest.mark.parametrize("parts", LAYOUTS, ids=lambda parts: "+".join(sorted(parts)) or "nothing")
def test_all_messages_are_read_in_the_order_of_time(tmp_path: Path, parts: frozenset[str], order: list[int]) -> None:
    file = tmp_path / "run.mcap"
    for types_in_chunks in (True, False):
        write(file, parts, order, types_in_chunks=types_in_chunks)
        with open_bag(file) as bag:
            assert not bag.damage
            assert [(topic.name, topic.count) for topic in bag.topics] == [(name, COUNT // 2) for name in TOPICS]
            found = list(bag.raw_messages({topic: topic for topic in TOPICS}))
            assert [len(data) - 9 for *_, data in found] == IN_ORDER
            assert [time for _, time, *_ in found] == [START + number * 10_000_000 for number in IN_ORDER]
            assert [len(data) - 9 for *_, data in bag.raw_messages({"/b": "/b"})] == IN_ORDER[1::2]


def test_two_readings_of_a_file_without_chunks_do_not_disturb_each_other(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    write(file, frozenset(), ALMOST)
    with open_bag(file) as bag:
        pairs = zip(bag.raw_messages({"/a": "/a"}), bag.raw_messages({"/b": "/b"}), strict=True)
        assert [(len(a) - 9, len(b) - 9) for (*_, a), (*_, b) in pairs] == list(
            zip(IN_ORDER[::2], IN_ORDER[1::2], strict=True)
        )


@pytest.mark.parametrize("parts", [frozenset({"chunks"}), frozenset({"chunks", "message index"}), frozenset()])
def test_a_truncated_file_is_read_as_far_as_its_records_are_whole(tmp_path: Path, parts: frozenset[str]) -> None:
    file = tmp_path / "run.mcap"
    write(file, parts, ALMOST)
    whole = file.read_bytes()
    lengths = []
    for end in range(len(whole) - 200, len(whole) // 3, -97):
        file.write_bytes(whole[:end])
        with open_bag(file) as bag:
            assert "truncated" in bag.damage[0]
            found = [len(data) - 9 for *_, data in bag.raw_messages({topic: topic for topic in TOPICS})]
            assert found == sorted(ALMOST[: len(found)])
            assert sum(topic.count for topic in bag.topics) == len(found)
            lengths.append(len(found))
    assert lengths == sorted(lengths, reverse=True)
    assert lengths[0] >= COUNT - IN_A_CHUNK
