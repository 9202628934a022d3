"""Bags whose compressed parts explode, or that name files outside of their folder."""

from __future__ import annotations

import bz2
import io
import shutil
import struct
from pathlib import Path

import lz4.frame
import pytest
import rosbags.rosbag1.reader
import rosbags.rosbag2.reader
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS

from socialbot.bags import _files
from socialbot.bags.reader import open_bag
from socialbot.core.errors import BagError
from tests.bags.making_bags import RAW, make

zstd = vars(storage_mcap)["zstd"]
ZEROS = 50_000_000
COMPRESS = {"zstd": zstd.compress, "lz4": lz4.frame.compress}


@pytest.fixture
def low_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_files, "BAG_CHUNK_BYTES", 1_000_000)
    monkeypatch.setattr(_files, "BAG_FILE_BYTES", 1_000_000)


@pytest.mark.parametrize("kind", COMPRESS)
def test_a_chunk_has_its_stated_size_at_most(kind: str) -> None:
    data = COMPRESS[kind](bytes(1000)) + COMPRESS[kind](b"end")
    assert DECOMPRESSORS[kind](data, 1003) == bytes(1000) + b"end"
    with pytest.raises(ValueError, match="larger than 999 bytes"):
        DECOMPRESSORS[kind](data, 999)
    with pytest.raises(ValueError, match="ends too early"):
        DECOMPRESSORS[kind](data[:-2], 1003)


@pytest.mark.parametrize("kind", COMPRESS)
def test_a_chunk_that_states_a_huge_size_is_refused(kind: str, low_limits: None) -> None:
    with pytest.raises(ValueError, match="larger than 1000000 bytes"):
        DECOMPRESSORS[kind](COMPRESS[kind](bytes(ZEROS)), ZEROS)


@pytest.mark.parametrize(("kind", "compress"), [("bz2", bz2.compress), ("lz4", lz4.frame.compress)])
def test_chunks_of_ros_1_are_bounded(kind: str, compress, low_limits: None) -> None:
    decompress = rosbags.rosbag1.reader.decompressors[kind]
    assert decompress(compress(bytes(1000))) == bytes(1000)
    with pytest.raises(ValueError, match="larger than 1000000 bytes"):
        decompress(compress(bytes(ZEROS)))


def test_compressed_messages_and_files_of_a_folder_are_bounded(low_limits: None) -> None:
    library = vars(rosbags.rosbag2.reader)["zstd"]
    data = zstd.compress(bytes(ZEROS))
    with pytest.raises(ValueError, match="larger than 1000000 bytes"):
        library.decompress(data)
    with library.open(io.BytesIO(data), "rb") as file, pytest.raises(ValueError, match="larger than 1000000 bytes"):
        shutil.copyfileobj(file, io.BytesIO())
    with library.open(io.BytesIO(zstd.compress(bytes(1000))), "rb") as file:
        assert file.read() == bytes(1000)


def test_a_file_of_a_folder_is_bounded_by_its_compressed_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_files, "BAG_CHUNK_BYTES", 1000)
    library = vars(rosbags.rosbag2.reader)["zstd"]
    data = zstd.compress(bytes(1_000_000))
    limit = 200 * len(data) + 1000
    with library.open(io.BytesIO(data), "rb") as file:
        assert file.read(limit) == bytes(limit)
        with pytest.raises(ValueError, match=f"larger than {limit} bytes"):
            file.read(1)


def test_a_chunk_that_explodes_ends_the_reading(tmp_path: Path, low_limits: None) -> None:
    """An mcap file whose only chunk of zeros is compressed a thousandfold."""
    data = zstd.compress(bytes(ZEROS))
    chunk = struct.pack("<QQQII4sQ", 1, 2, ZEROS, 0, 4, b"zstd", len(data)) + data
    records = [(1, struct.pack("<I4sI", 4, b"ros2", 0)), (6, chunk), (15, bytes(4)), (2, bytes(20))]
    magic = b"\x89MCAP0\r\n"
    body = b"".join(struct.pack("<BQ", kind, len(content)) + content for kind, content in records)
    file = tmp_path / "bomb.mcap"
    file.write_bytes(magic + body + magic)
    with pytest.raises(BagError):
        open_bag(file).check()


def test_compressed_bags_are_read_as_before(tmp_path: Path) -> None:
    path = make(tmp_path / "bag", count=5)
    with open_bag(path) as bag:
        assert len(list(bag.messages({RAW: RAW}))) == 5


@pytest.mark.parametrize("place", ["../outside.mcap", "{folder}/outside.mcap"])
def test_split_files_outside_of_the_folder_are_not_read(tmp_path: Path, place: str) -> None:
    path = make(tmp_path / "bag", count=5)
    (file,) = path.glob("*.mcap")
    shutil.move(file, tmp_path / "outside.mcap")
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(file.name, place.format(folder=tmp_path)))
    with pytest.raises(BagError):
        open_bag(path)
