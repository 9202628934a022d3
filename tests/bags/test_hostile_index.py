"""Bags whose index lies about places, lengths and counts, or that name types of others."""

from __future__ import annotations

import os
import struct
import sys
import time
import tracemalloc
from pathlib import Path

import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore

from socialbot.bags import _files
from socialbot.bags.reader import open_bag
from socialbot.bags.types import installed_definition
from socialbot.core.errors import SocialbotError
from tests.bags.making_bags import RAW, START, make, make_ros1

FOOTER_BYTES = 20 + 8
LIES = [
    struct.pack("<Q", 2**64 - 1),
    struct.pack("<Q", 2**62),
    struct.pack("<Q", 2**33),
    struct.pack("<Q", 8),  # a record points to the beginning
    struct.pack("<I", 2**31 - 1),
]


@pytest.mark.parametrize("step", [149, pytest.param(1, marks=pytest.mark.slow)])
def test_an_index_that_lies_is_refused_or_ignored(tmp_path: Path, step: int) -> None:
    (path,) = make(tmp_path / "bag", count=3).glob("*.mcap")
    whole = path.read_bytes()
    (summary,) = struct.unpack_from("<Q", whole, len(whole) - FOOTER_BYTES)
    assert 0 < summary < len(whole)
    for at in range(summary, len(whole) - 8, step):
        for lie in LIES:
            path.write_bytes(whole[:at] + lie + whole[at + len(lie) :])
            begun = time.process_time()
            try:
                with open_bag(path) as bag:
                    bag.check()
            except SocialbotError:
                pass
            assert time.process_time() - begun < 1.0, (at, lie)


def test_a_chunk_of_ros_1_that_is_named_many_times_is_refused(tmp_path: Path) -> None:
    """5000 times an index of 1200 entries: a gigabyte."""
    path, copies = make_ros1(tmp_path / "bag.bag", count=1000), 5000
    whole = bytearray(path.read_bytes())
    last = whole.rindex(b"\x04\0\0\0op=\x06") - 4  # the record of the only chunk
    (count,) = struct.unpack_from("<I", whole, place := whole.index(b"chunk_count=") + len("chunk_count="))
    assert count == 1
    struct.pack_into("<I", whole, place, copies)
    path.write_bytes(whole + whole[last:] * (copies - 1))
    begun = time.process_time()
    with pytest.raises(SocialbotError, match="its index names chunks many times"):
        open_bag(path)
    assert time.process_time() - begun < 5.0


def hole(path: Path, begin: bytes) -> Path:
    """A file of 600 MB that takes no room on the disk."""
    path.write_bytes(begin)
    os.truncate(path, 600_000_000)
    return path


@pytest.mark.parametrize("begin", [b"", b"#ROSBAG V2.0"])
def test_a_first_line_of_ros_1_without_end_is_not_read(tmp_path: Path, begin: bytes) -> None:
    path = hole(tmp_path / "bag.bag", begin)
    tracemalloc.start()
    with pytest.raises(SocialbotError, match="magic is invalid"):
        open_bag(path)
    assert tracemalloc.get_traced_memory()[1] < 50_000_000
    tracemalloc.stop()


def test_a_huge_chunk_of_ros_1_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A chunk without compression may be gigabytes of holes."""
    path = make_ros1(tmp_path / "bag.bag", count=30)
    monkeypatch.setattr(_files, "BAG_CHUNK_BYTES", 5000)
    with pytest.raises(SocialbotError, match="has more than 5000 bytes"), open_bag(path) as bag:
        list(bag.messages({RAW: RAW}))


def alternating(path: Path, chunks: int, size: int) -> list[str]:
    """A .bag file of chunks of 400 messages that alternate in time. Each begins with a message of ``size`` bytes."""
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Ros1Writer(path)
    writer.chunk_threshold = 1 << 30
    writer.set_compression(Ros1Writer.CompressionFormat.BZ2)
    with writer:
        topics = [writer.add_connection(f"/t{odd}", "std_msgs/msg/String", typestore=store) for odd in range(chunks)]
        for odd, topic in enumerate(topics):
            writer.write(topic, START + odd, struct.pack("<I", size) + bytes(size))
            for number in range(1, 400):
                writer.write(topic, START + chunks * number + odd, b"\x01\0\0\0a")
            writer.write_chunk(writer.chunks[-1])
    return [topic.topic for topic in topics]


def test_chunks_of_ros_1_that_alternate_in_time_are_not_decompressed_again_and_again(tmp_path: Path) -> None:
    """Five chunks of 20 MB, of which each is needed 400 times: 40 GB from a file of 150 KB."""
    topics = alternating(tmp_path / "bag.bag", 5, 20_000_000)
    assert (tmp_path / "bag.bag").stat().st_size < 200_000
    begun = time.process_time()
    with open_bag(tmp_path / "bag.bag") as bag, pytest.raises(SocialbotError, match="alternate in time"):
        list(bag.ros_messages(topics))
    assert time.process_time() - begun < 20.0


def test_two_recordings_of_ros_1_merged_one_after_the_other_are_read(tmp_path: Path) -> None:
    """Their times alternate: with each message decompressed anew, these 800 messages would be 5 GB."""
    topics = alternating(tmp_path / "bag.bag", 2, 6_000_000)
    begun = time.process_time()
    with open_bag(tmp_path / "bag.bag") as bag:
        found = [time for _, time, _ in bag.ros_messages(topics)]
    assert found == [START + number for number in range(800)]
    assert time.process_time() - begun < 5.0


@pytest.mark.parametrize(
    "name", ["this", "this/msg/Zen", "this/msg", "../../etc/passwd", "os/path/join", "a/b/c/d", ""]
)
def test_a_type_of_a_bag_imports_no_other_module(name: str) -> None:
    sys.modules.pop("this", None)
    assert installed_definition(name) == ""
    assert "this" not in sys.modules


def test_an_installed_type_is_found() -> None:
    pytest.importorskip("std_msgs")
    assert installed_definition("std_msgs/msg/String") == "string data\n"
