"""MCAP files whose chunks become many times larger than the file."""

from __future__ import annotations

import resource
import struct
from pathlib import Path

import pytest
from rosbags.rosbag2 import storage_mcap

from socialbot.bags import _storage_checks
from socialbot.bags.reader import open_bag
from socialbot.bags.repair import MAGIC
from socialbot.core.errors import BagError

zstd = vars(storage_mcap)["zstd"]
TIME, TOPIC = 10**18, "/say"


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def bomb(file: Path, *, size: int, chunks: int = 1, entries: int = 1, indexed: bool = True, apart_ns: int = 0) -> Path:
    """A file of some chunks, each with one sentence of ``size`` zeros, and of index ``entries`` for each."""
    types = record(3, struct.pack("<H", 1) + text("std_msgs/msg/String") + text("ros2msg") + text("string data"))
    types += record(4, struct.pack("<HH", 1, 1) + text(TOPIC) + text("cdr") + text(""))
    whole, summary = MAGIC + record(1, text("ros2") + text("")) + types, types
    for number in range(chunks):
        time = TIME + number * apart_ns
        message = record(5, struct.pack("<HIQQ", 1, 0, time, time) + struct.pack("<II", 0x100, size) + bytes(size))
        packed = zstd.compress(message)
        sizes = text("zstd") + struct.pack("<Q", len(packed))
        chunk = record(6, struct.pack("<QQQI", time, time, len(message), 0) + sizes + packed)
        index = record(7, struct.pack("<HIQQ", 1, 16, time, 0))
        place = struct.pack("<QQQQ", time, time, len(whole), len(chunk))
        offsets = struct.pack("<IHQQ", 10, 1, len(whole) + len(chunk), len(index))
        summary += entries * record(8, place + offsets + sizes + struct.pack("<Q", len(message)))
        whole += chunk + index
    whole += record(15, bytes(4))
    end = summary + record(2, struct.pack("<QQI", len(whole), 0, 0)) if indexed else record(2, bytes(20))
    file.write_bytes(whole + end + MAGIC)
    return file


def test_the_messages_of_the_files_below_are_read(tmp_path: Path) -> None:
    for indexed in (True, False):
        with open_bag(bomb(tmp_path / f"{indexed}.mcap", size=1000, chunks=3, indexed=indexed)) as bag:
            assert not bag.damage
            assert bag.topic(TOPIC).count == 3
            assert len(list(bag.raw_messages({TOPIC: TOPIC}))) == 3


def test_a_chunk_that_its_index_names_many_times_is_read_once(tmp_path: Path) -> None:
    """Chunks of one time are decompressed together: 40 times 30 MB."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with open_bag(bomb(tmp_path / "bomb.mcap", size=30_000_000, entries=40)) as bag:
        assert len(list(bag.raw_messages({TOPIC: TOPIC}))) == 1
        assert bag.damage
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000


@pytest.mark.parametrize("apart_ns", [0, 1000])
def test_only_chunks_of_one_moment_must_not_become_much_larger_than_the_file(
    tmp_path: Path, apart_ns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chunks of other moments are read one after the other, such as hours of a covered camera."""
    monkeypatch.setattr(_storage_checks, "BAG_CHUNK_BYTES", 1_000_000)
    file = bomb(tmp_path / "bomb.mcap", size=1_000_000, chunks=20, apart_ns=apart_ns)
    if not apart_ns:
        with pytest.raises(BagError, match="its chunks of one moment become"):
            open_bag(file)
        return
    with open_bag(file) as bag:
        assert len(list(bag.raw_messages({TOPIC: TOPIC}))) == 20
