"""Checks of an MCAP file before rosbags decompresses its chunks, of which it may hold many at once.

An index can name one chunk again and again, and each of many small chunks can become a gigabyte.
"""

from __future__ import annotations

from typing import BinaryIO

from rosbags.rosbag2.storage_mcap import McapReader

from socialbot.core.limits import BAG_CHUNK_BYTES, BAG_RATIO

_CHUNK, _HEAD_BYTES = 6, 9
_TIMES_BYTES = 16  # start and end of a chunk, before its size


def install() -> None:
    """Make the reader of rosbags read only files with checked chunks."""
    read_index, meta_scan = McapReader.read_index, McapReader.meta_scan

    def checked_index(reader: McapReader) -> None:
        read_index(reader)
        check_index(reader)

    def checked_scan(reader: McapReader) -> None:
        assert reader.bio is not None
        _check_size(_stated_bytes(reader.bio, reader.data_start, reader.data_end), reader.bio)
        meta_scan(reader)

    McapReader.read_index = checked_index  # type: ignore[method-assign]
    McapReader.meta_scan = checked_scan  # type: ignore[method-assign]


def check_index(reader: McapReader) -> None:
    """Raise ValueError if chunks of the index overlap, or become too large."""
    assert reader.bio is not None
    end = 0
    for chunk in sorted(reader.chunks, key=lambda chunk: chunk.chunk_start_offset):
        if chunk.chunk_start_offset < end or chunk.compressed_size > chunk.chunk_length:
            raise ValueError("chunks of its index overlap")
        end = chunk.chunk_start_offset + chunk.chunk_length
    _check_size(sum(chunk.uncompressed_size for chunk in reader.chunks), reader.bio)


def _stated_bytes(file: BinaryIO, start: int, end: int) -> int:
    """Sum of the sizes that the chunks between two places state."""
    total, place = 0, start
    while place < end:
        file.seek(place)
        head = file.read(_HEAD_BYTES)
        if head[:1] == bytes([_CHUNK]):
            total += int.from_bytes(file.read(_TIMES_BYTES + 8)[_TIMES_BYTES:], "little")
        place += _HEAD_BYTES + int.from_bytes(head[1:], "little")
    return total


def _check_size(stated: int, file: BinaryIO) -> None:
    size = file.seek(0, 2)
    if stated > BAG_RATIO * size + BAG_CHUNK_BYTES:
        raise ValueError(f"its chunks become {stated} bytes, more than {BAG_RATIO} times the {size} of the file")
