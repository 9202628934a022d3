"""Files that break off, or lie about themselves, cost no more than what is in them."""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path

from socialbot.bags.repair import MAGIC, salvage

CHUNK = 6


def test_a_length_that_lies_takes_no_memory(tmp_path: Path) -> None:
    times, size, checksum, name_length = bytes(16), bytes(8), bytes(4), b"\xff\xff\xff\xff"
    chunk = times + size + checksum + name_length + b"zstd" + bytes(8)
    file = tmp_path / "lies.mcap"
    file.write_bytes(MAGIC + struct.pack("<BQ", CHUNK, len(chunk)) + chunk)
    tracemalloc.start()
    try:
        assert salvage(file) is None
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1 << 20
