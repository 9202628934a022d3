"""Open the files of a bag with rosbags: folders, single files, and the intact part of a truncated file.

Compressed data has limits: a file of 100 KB may otherwise decompress to gigabytes. The readers of rosbags take the
decompressors of their modules, which `install` replaces.
"""

from __future__ import annotations

import bz2
import contextlib
import re
from collections.abc import Callable, Collection, Generator, Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import IO, Any, BinaryIO, Protocol

from lz4.frame import LZ4FrameDecompressor
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, Qos
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import reader as ros1_reader
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.rosbag2 import reader as ros2_reader
from rosbags.rosbag2 import storage_mcap, storage_sqlite3
from rosbags.rosbag2.metadata import parse_qos
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from socialbot.bags import _storage_checks
from socialbot.bags.repair import salvage, with_profile_of_ros2
from socialbot.bags.writer import qos_of
from socialbot.core import reading
from socialbot.core.errors import BagError
from socialbot.core.limits import BAG_CHUNK_BYTES, BAG_FILE_BYTES, BAG_RATIO, TEXT_BYTES
from socialbot.core.paths import decoded
from socialbot.core.yaml import check_depth, load_yaml

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


def _definition(schema: storage_mcap.Schema | None) -> MessageDefinition:
    """Definition in a schema of an .mcap file."""
    return _storage_checks.definition(schema.encoding if schema else "", schema.data if schema else "")


_parse_qos: Callable[[Any], list[Qos]] = parse_qos
_NEVER = {"sec": 0, "nsec": 0}
_NO_QOS = {
    "depth": 0,
    **dict.fromkeys(("deadline", "lifespan", "liveliness_lease_duration"), _NEVER),
    "avoid_ros_namespace_conventions": False,
}


def _qos(profiles: Any) -> list[Qos]:
    """QoS profiles of a topic, as far as they can be read. Programs other than rosbag2 leave out keys."""
    try:
        items = load_yaml(YAML(typ="safe"), profiles) if isinstance(profiles, str) else profiles
    except YAMLError:
        items = None
    found: list[Qos] = []
    for item in items if isinstance(items, list) else ():
        durability = item.get("durability") if isinstance(item, dict) else None
        for given in (item, {"durability": durability}):
            with contextlib.suppress(AttributeError, KeyError, TypeError, ValueError):
                found += _parse_qos([{**_NO_QOS, **given}])
                break
    return found


_qos_of_ros2 = storage_mcap.get_qos


def _offered_qos(metadata: bytes) -> list[Qos]:
    """QoS profiles of a channel of an .mcap file; converters of ROS 1 bags write ``latching`` instead."""
    found, file = _qos_of_ros2(metadata), BytesIO(metadata)
    while not found and file.tell() < len(metadata):
        key, value = storage_mcap.read_string(file), storage_mcap.read_string(file)
        if (key, value) == ("latching", "1"):
            found = [qos_of(latched=True)]
    return found


_read_bytes_of_ros1 = ros1_reader.read_bytes


def _read_part(file: BinaryIO, size: int) -> bytes:
    """Read a header, a chunk or a message of a .bag file. Raises ValueError if it is too large."""
    if size > BAG_CHUNK_BYTES:
        raise ValueError(f"a chunk, or a part of one, has more than {BAG_CHUNK_BYTES} bytes")
    return _read_bytes_of_ros1(file, size)


def install() -> None:
    """Make the readers of rosbags use bounded decompressors, and accept .mcap files with topics in other encodings."""
    storage_mcap.get_msgdef = _definition
    storage_mcap.get_qos = _offered_qos
    for module in (storage_mcap, storage_sqlite3, ros2_reader):
        module.parse_qos = _qos  # type: ignore[attr-defined]
    storage_mcap.read_string = lambda file: storage_mcap.read_bytes(file).decode(errors="replace")
    storage_mcap.DECOMPRESSORS["zstd"] = _of_chunk(_zstd_decompressor)
    storage_mcap.DECOMPRESSORS["lz4"] = _of_chunk(LZ4FrameDecompressor)
    ros1_reader.read_bytes = _read_part
    ros1_reader.decompressors["bz2"] = _of_message(bz2.BZ2Decompressor)
    ros1_reader.decompressors["lz4"] = _of_message(LZ4FrameDecompressor)
    ros2_reader.zstd = _BoundedZstd  # type: ignore[attr-defined]
    _storage_checks.install()


_ZSTD_FRAME = b"\x28\xb5\x2f\xfd"


class _Ros2Reader(Ros2Reader):
    """Reader that decompresses messages also without metadata.yaml, which a killed recorder does not write.

    A message of ROS begins with 0, so it is no zstd frame.
    """

    def messages(
        self, connections: Collection[Connection] = (), start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        for connection, time, data in super().messages(connections, start, stop):
            packed = isinstance(data, bytes) and data.startswith(_ZSTD_FRAME)
            yield connection, time, _BoundedZstd.decompress(data) if packed else data


_CHUNKS_BYTES = 1 << 26  # of the decompressed chunks that a reader keeps


class _Ros1Reader(Ros1Reader):
    """Reader that decompresses no more than a file may hold.

    Messages of a merged bag alternate in time between chunks, so the last chunks stay decompressed.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._file, self._size, self._index_bytes, self._chunk_bytes = path, 0, 0, 0
        self._chunks: dict[int, bytes] = {}

    def open(self) -> None:
        with reading.open_file(self._file) as file:
            if not file.read(_FIRST_LINE_BYTES).partition(b"\n")[1]:
                raise ValueError("the file magic is invalid")
        self._size = self._file.stat().st_size
        super().open()

    def read_index_data(self, pos: int, indexes: dict[int, list[Any]]) -> None:
        assert self.bio
        begin = self.bio.tell()
        super().read_index_data(pos, indexes)
        self._index_bytes += self.bio.tell() - begin
        if self._index_bytes > self._size:
            raise ValueError("its index names chunks many times")

    def read_chunk(self) -> ros1_reader.Chunk:
        chunk = super().read_chunk()
        return chunk._replace(decompressor=lambda data: self._decompressed(chunk, data))

    def _decompressed(self, chunk: ros1_reader.Chunk, data: bytes) -> bytes:
        found = self._chunks.pop(chunk.datapos, None)
        if found is None:
            found = chunk.decompressor(data)
            self._chunk_bytes += len(found)
            if self._chunk_bytes > BAG_RATIO * self._size + BAG_CHUNK_BYTES:
                why = f"its chunks have more than {BAG_RATIO} times the bytes of the file, or alternate in time"
                raise ValueError(why)
        while self._chunks and sum(map(len, self._chunks.values())) + len(found) > _CHUNKS_BYTES:
            del self._chunks[next(iter(self._chunks))]
        self._chunks[chunk.datapos] = found
        return found

    def messages(
        self, connections: Collection[Connection] = (), start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        self._chunk_bytes = 0
        yield from super().messages(connections, start, stop)
        self._chunks.clear()


Reader = Ros1Reader | Ros2Reader

install()

_STORAGE = (".mcap", ".db3")
_REPAIRS = {
    ".mcap": "copy the file again, or repair it with `mcap recover`",
    ".db3": "copy the file again, or repair it with `sqlite3 FILE .recover | sqlite3 NEW.db3`",
    ".bag": "copy the file again, or repair it with `rosbag reindex` of ROS 1",
}

_READ = "the .mcap and .db3 files are read"

_FIRST_LINE_BYTES = 64

_LFS_POINTER = b"version https://git-lfs.github.com/"


def open_folder(path: Path, damage: list[str]) -> list[Reader]:
    """Open the files of a rosbag2 folder, and add missing parts to ``damage``. Raises BagError."""
    metadata = path / "metadata.yaml"
    for file in path.iterdir():
        _expect_end(file)
    files = sorted((file for file in path.iterdir() if file.suffix in _STORAGE), key=natural)
    damage += [unread for file in files if (unread := _write_ahead_log(file))]
    packed = [file.name for file in sorted(path.glob("*.zstd"), key=natural) if Path(file.stem).suffix in _STORAGE]
    unpack = f"decompress with `zstd -d {path}/*.zstd`"
    read = f"{_READ}, not {', '.join(packed)}: {unpack}" if packed else _READ
    if not metadata.exists() and not files and packed:
        what = "compressed files without the metadata.yaml that describes them"
        raise BagError(what, where=str(path), remedy=unpack)
    if not metadata.exists() and not files:
        what = "not a bag: the folder has no metadata.yaml and no .mcap or .db3 file"
        inner = sorted(file.parent.name for kind in _STORAGE for file in path.glob(f"*/*{kind}"))
        remedy = "give the folder that `bag record` made; for a folder of images use `bag import`"
        if inner:
            remedy = f"give one of the bags in it, such as {path / inner[0]}"
        raise BagError(what, where=str(path), remedy=remedy)
    if metadata.exists():
        try:
            return [_open(path, damage)]
        except BagError as error:
            if not files:
                raise
            damage.append(f"{metadata}: cannot be used: {str(error.__cause__ or error.what).rstrip('.')}; {read}")
    else:
        damage.append(f"{metadata}: missing; {read}")
    return [_open_file(file, damage) for file in files]


def open_file(path: Path, damage: list[str]) -> Reader:
    """Open one file, or the intact part of a truncated one, which is added to ``damage``. Raises BagError."""
    if unread := _write_ahead_log(path):
        damage.append(unread)
    return _open_file(path, damage)


def _write_ahead_log(path: Path) -> str:
    """Return the damage by messages beside a file of SQLite, which a killed recorder has not moved into it, or ''."""
    log = path.with_name(f"{path.name}-wal")
    if path.suffix != ".db3" or not log.is_file() or not log.stat().st_size:
        return ""
    return f"{log}: its messages are not read; move them into the bag: sqlite3 {path} 'PRAGMA wal_checkpoint(TRUNCATE)'"


def _open_file(path: Path, damage: list[str]) -> Reader:
    if path.suffix == ".zstd":
        raise BagError("a compressed file of a bag", where=str(path), remedy=f"decompress with `zstd -d {path}`")
    if path.suffix == ".active":
        remedy = (
            f"end `rosbag record`, or repair it after a crash with `rosbag reindex` of ROS 1 as {path.with_suffix('')}"
        )
        raise BagError("a recording that has not ended", where=str(path), remedy=remedy)
    if path.suffix not in _REPAIRS:
        remedy = "give a bag folder, or an .mcap, .db3 or .bag file; `bag import` makes one of a video or images"
        raise BagError(f"not a bag: {path.suffix or 'no suffix'}", where=str(path), remedy=remedy)
    _expect_end(path)
    is_mcap = path.suffix == ".mcap"
    mended = with_profile_of_ros2(path) if is_mcap else None
    try:
        return _open(mended or path, damage)
    except BagError:
        salvaged = salvage(path) if is_mcap else None
        if salvaged is None:
            raise
    if mended is not None:
        salvaged = replace(salvaged, head=mended.head)
    damage.append(f"{path}: truncated; the first {salvaged.whole} of {salvaged.size} bytes are intact and are read")
    return _open(salvaged, damage)


def _expect_end(path: Path) -> None:
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise BagError("is a device or a pipe, not a file", where=str(path), remedy="copy the bag to files")


def _open(path: Any, damage: list[str]) -> Reader:
    try:
        is_folder = isinstance(path, Path) and path.is_dir()
        if is_folder:
            check_depth(decoded(reading.read_bytes(path / "metadata.yaml", TEXT_BYTES)))
        reader = _Ros2Reader(path) if is_folder or path.suffix != ".bag" else _Ros1Reader(path)
        reader.open()
        # Rosbags does not check the types.
        texts = [text for each in reader.connections for text in (each.topic, each.msgtype)]
        numbers = [each.msgcount for each in reader.connections]
        numbers += [reader.message_count, reader.start_time, reader.end_time]
        if not all(isinstance(text, str) for text in texts) or not all(type(number) is int for number in numbers):
            raise ValueError("a topic name or type is not a text, or a count is not a number")
    except Exception as error:
        raise broken(path, error) from error
    if isinstance(reader, Ros2Reader):
        if isinstance(reader.storage, ros2_reader.DirectoryReader):
            _list_topics_of_files(reader.storage)
        _keep_ros(reader, path, damage)
    return reader


def _list_topics_of_files(folder: ros2_reader.DirectoryReader) -> None:
    """Let the topics of the files be those of metadata.yaml, since rosbags reads no others, without an error.

    The QoS profiles of metadata.yaml replace those of the files: they are edited by hand to change a playback.
    """
    for storage in folder.storages:
        for index, own in enumerate(storage.connections):
            listed = next((x for x in folder.connections if (x.topic, x.msgtype) == (own.topic, own.msgtype)), None)
            if listed is None:
                folder.connections.append(own._replace(id=len(folder.connections) + 1, owner=folder))
            else:
                storage.connections[index] = own._replace(ext=listed.ext, digest=listed.digest)


def _keep_ros(reader: Ros2Reader, path: object, damage: list[str]) -> None:
    """Leave out topics whose messages have no encoding of ROS. Raises BagError if no others are left."""
    others: dict[str, list[str]] = {}
    kept: list[Connection] = []
    for each in reader.connections:
        encoding = each.ext.serialization_format if isinstance(each.ext, ConnectionExtRosbag2) else "cdr"
        if encoding in _storage_checks.ENCODINGS:
            name = each.msgtype  # in ROS 1, sensor_msgs/Image
            kept.append(each._replace(msgtype=name.replace("/", "/msg/")) if name.count("/") == 1 else each)
        else:
            others.setdefault(encoding, []).append(each.topic)
    if others and not kept:
        reader.close()
        what = f"no ROS messages: its topics are encoded as {', '.join(sorted(others))}"
        raise BagError(what, where=str(path), remedy="record the topics of ROS, or convert the file to ROS messages")
    damage += [
        f"{path}: encoded as {encoding}, not as ROS messages, and left out: {', '.join(sorted(topics))}"
        for encoding, topics in sorted(others.items())
    ]
    reader.connections[:] = kept


def broken(path: Any, error: Exception) -> BagError:
    """Return the error for a failure of rosbags to read ``path``, with the remedy for its format."""
    if isinstance(error, PermissionError):
        return BagError("permission denied", where=str(path), remedy="ask its owner for read permission")
    if isinstance(path, Path) and path.is_file() and _is_lfs_pointer(path):
        return BagError("not a bag, but a pointer of Git LFS to one", where=str(path), remedy="run `git lfs pull`")
    what = str(error) or type(error).__name__
    return BagError(f"the bag is damaged: {what}", where=str(path), remedy=_REPAIRS.get(path.suffix, "copy it again"))


def _is_lfs_pointer(path: Path) -> bool:
    with reading.open_file(path) as file:
        return file.read(len(_LFS_POINTER)) == _LFS_POINTER


def natural(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Sort key for natural order: 2 before 10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], path.name
