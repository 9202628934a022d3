"""Bags whose index lies about places, lengths and counts, or that name types of others."""

from __future__ import annotations

import struct
import sys
import time
from pathlib import Path

import pytest

from socialbot.bags.reader import open_bag
from socialbot.bags.types import installed_definition
from socialbot.core.errors import SocialbotError
from tests.bags.making_bags import make, make_ros1

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
