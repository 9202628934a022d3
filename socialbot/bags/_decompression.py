"""Limits for compressed bags: a file of 100 KB may otherwise decompress to gigabytes.

The readers of rosbags take the decompressors of their modules, which `install` replaces.
"""

from __future__ import annotations

import bz2
import contextlib
from collections.abc import Callable, Iterator
from typing import IO, Any, Protocol

from lz4.frame import LZ4FrameDecompressor
from rosbags.rosbag1 import reader as ros1_reader
from rosbags.rosbag2 import reader as ros2_reader
from rosbags.rosbag2 import storage_mcap

from socialbot.core.limits import BAG_CHUNK_BYTES, BAG_FILE_BYTES, BAG_RATIO

_zstd: Any = vars(storage_mcap)["zstd"]


class _Decompressor(Protocol):
    eof: bool

    @property
    def unused_data(self) -> bytes | None: ...

    def decompress(self, data: bytes, max_length: int = -1, /) -> bytes: ...


def decompressed(make: Callable[[], _Decompressor], data: bytes, limit: int) -> bytes:
    """Decompress ``data``, one or more frames, to at most ``limit`` bytes.

    Raises:
        ValueError: The result is larger, or ends too early.
    """
    result = b""
    while data:
        decompressor = make()
        result += decompressor.decompress(data, limit + 1 - len(result))
        if len(result) > limit:
            raise ValueError(f"compressed data is larger than {limit} bytes")
        if not decompressor.eof:
            raise ValueError("compressed data ends too early")
        data = decompressor.unused_data or b""
    return result


def _zstd_decompressor() -> Any:
    return _zstd.ZstdDecompressor()


def _of_chunk(make: Callable[[], Any]) -> Callable[[bytes, int], bytes]:
    return lambda data, size: decompressed(make, data, min(size, BAG_CHUNK_BYTES))


def _of_message(make: Callable[[], Any]) -> Callable[[bytes], bytes]:
    return lambda data: decompressed(make, data, BAG_CHUNK_BYTES)


class _BoundedReader:
    """Reader of a compressed file that stops at a limit."""

    def __init__(self, file: IO[bytes], limit: int) -> None:
        self._file, self._left, self._limit = file, limit, limit

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(size)
        self._left -= len(data)
        if self._left < 0:
            raise ValueError(f"compressed file is larger than {self._limit} bytes")
        return data


class _BoundedZstd:
    """The functions of the zstd module that the reader of rosbag2 folders calls."""

    decompress = staticmethod(_of_message(_zstd_decompressor))

    @staticmethod
    @contextlib.contextmanager
    def open(file: IO[bytes], mode: str) -> Iterator[_BoundedReader]:
        """Open a compressed file for reading."""
        size = file.seek(0, 2)
        file.seek(0)
        with _zstd.open(file, mode) as opened:
            yield _BoundedReader(opened, min(BAG_FILE_BYTES, BAG_RATIO * size + BAG_CHUNK_BYTES))


def install() -> None:
    """Make the readers of rosbags use bounded decompressors."""
    storage_mcap.DECOMPRESSORS["zstd"] = _of_chunk(_zstd_decompressor)
    storage_mcap.DECOMPRESSORS["lz4"] = _of_chunk(LZ4FrameDecompressor)
    ros1_reader.decompressors["bz2"] = _of_message(bz2.BZ2Decompressor)
    ros1_reader.decompressors["lz4"] = _of_message(LZ4FrameDecompressor)
    ros2_reader.zstd = _BoundedZstd  # type: ignore[attr-defined]
