"""Readers of MCAP and SQLite files: rosbags reads them, after checks, and with a whole index.

Writers of MCAP files may leave out each part of the index: rosbag2 writes no chunks with its preset ``fastwrite``.
Without a part, rosbags finds no messages, or refuses them if they are not in the order of time.

rosbags holds all chunks of one moment of an MCAP file at once. An index can name one chunk again and again, and each of
many small chunks can become a gigabyte.

A SQLite file is a program as well: a view can have rows without end, a generated column can make gigabytes of each row,
and pages can be used many times. So rosbags reads only files whose tables hold no more than the file has.
"""

from __future__ import annotations

import heapq
import struct
import threading
from array import array
from collections import Counter
from collections.abc import Collection, Generator, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import apsw
import numpy as np
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import reader as ros2_reader
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from socialbot.core.limits import BAG_CHUNK_BYTES, BAG_RATIO

ENCODINGS = ("cdr", "ros1")
"""Encodings of messages that are read: those of ROS 2 and ROS 1."""

_MESSAGE, _CHUNK, _MESSAGE_INDEX = 5, 6, 7
_Messages = Generator[tuple[Connection, int, bytes], None, None]


class IndexedMcapReader(McapReader):
    """Reader of .mcap files that makes the index of a file without a whole one."""

    def __init__(self, path: Any) -> None:
        super().__init__(path)
        self._loose = np.empty((0, 4), np.uint64)
        """Time (ns), place, bytes and channel of each message outside of chunks, in the order of time."""

    def read_index(self) -> None:
        super().read_index()
        if self._is_whole():
            check_index(self)
            return
        # rosbags scans a file without statistics and chunks.
        self.statistics = None
        for part in (self.chunks, self.connections, self.channels, self.schemas):
            part.clear()

    def _is_whole(self) -> bool:
        """Whether the index has all messages, and the types of those that are read."""
        counts: Counter[int] = Counter()
        for chunk in self.chunks:
            counts.update(chunk.channel_count)
        if self.statistics is not None:
            have_all = counts.total() == self.statistics.message_count
        else:
            have_all = bool(self.chunks) and all(chunk.channel_count for chunk in self.chunks)
        read = [channel for channel in self.channels.values() if channel.message_encoding in ENCODINGS]
        have_types = all(channel.schema != "__schemaless__" for channel in read)
        return have_all and have_types and counts.keys() <= self.channels.keys()

    def meta_scan(self) -> None:
        super().meta_scan()
        self._list_records()
        check_index(self)

    def _list_records(self) -> None:
        """Find the chunks, and the messages outside of chunks."""
        assert self.bio is not None
        self.chunks.clear()
        loose = array("Q")
        at = self.data_start
        while at < self.data_end:
            self.bio.seek(at)
            kind, size = struct.unpack("<BQ", self.bio.read(9))
            begin, at = at, at + 9 + size
            if kind == _MESSAGE:
                channel, _, time = struct.unpack("<HIQ", self.bio.read(14))
                loose.extend((time, begin + 31, size - 22, channel))
            elif kind == _CHUNK:
                first, last, unpacked, _, length = struct.unpack("<QQQII", self.bio.read(32))
                compression = self.bio.read(min(length, size)).decode()
                (packed,) = struct.unpack("<Q", self.bio.read(8))
                info = ChunkInfo(first, last, begin, 9 + size, {}, 0, compression, packed, unpacked, {})
                self.chunks.append(info)
            elif kind == _MESSAGE_INDEX and self.chunks:
                channel, length = struct.unpack("<HI", self.bio.read(6))
                self.chunks[-1].channel_count[channel] = length // 16
        for chunk in self.chunks:
            # That of the last chunk of a truncated file may have lost a part.
            if chunk is self.chunks[-1] or not chunk.channel_count:
                chunk.channel_count.update(dict.fromkeys(self.channels, 1))
        found = np.frombuffer(loose, np.uint64).reshape(-1, 4)
        self._loose = found[np.argsort(found[:, 0], kind="stable")]

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> _Messages:
        """Yield the messages of ``connections`` from ``start`` until before ``stop`` (ns), in the order of time."""
        in_chunks = super().messages(connections, start, stop) if self.chunks else ()
        outside = self._outside(connections, start or 0, 2**64 if stop is None else stop)
        yield from heapq.merge(in_chunks, outside, key=lambda each: each[1])

    def _outside(
        self, connections: Collection[Connection], start: int, stop: int
    ) -> Iterator[tuple[Connection, int, bytes]]:
        wanted = {each.id: each for each in connections}
        for time, place, size, channel in map(np.ndarray.tolist, self._loose):
            if start <= time < stop and channel in wanted:
                assert self.bio is not None
                self.bio.seek(place)
                yield wanted[channel], time, self.bio.read(size)

    def close(self) -> None:
        self._loose = self._loose[:0]
        super().close()


def check_index(reader: McapReader) -> None:
    """Raise ValueError if chunks of the index overlap in the file, or those of one moment become too large."""
    assert reader.bio is not None
    end = 0
    for chunk in sorted(reader.chunks, key=lambda chunk: chunk.chunk_start_offset):
        if chunk.chunk_start_offset < end or chunk.compressed_size > chunk.chunk_length:
            raise ValueError("chunks of its index overlap")
        end = chunk.chunk_start_offset + chunk.chunk_length
    file_bytes = reader.bio.seek(0, 2)
    together = _together(reader)
    if together > BAG_RATIO * file_bytes + BAG_CHUNK_BYTES:
        raise ValueError(f"its chunks of one moment become {together} bytes, but the file has {file_bytes}")


def _together(reader: McapReader) -> int:
    """Most bytes of chunks whose times share a moment. Images of one colour may become a thousand times larger."""
    begins = [(chunk.message_start_time, 0, chunk.uncompressed_size) for chunk in reader.chunks]
    ends = [(chunk.message_end_time, 1, -chunk.uncompressed_size) for chunk in reader.chunks]
    most = held = 0
    for _, _, change in sorted(begins + ends):
        held += change
        most = max(most, held)
    return most


_TABLES = ("schema", "topics", "message_definitions", "messages")
_MAX_OBJECTS = 1000
_STEPS = 10_000
"""Instructions of SQLite between two looks at their number."""
_LEAST_STEPS, _STEPS_A_BYTE = 10_000_000, 20
"""Instructions that the checks may take: each row has about 20 bytes, and takes some tens of instructions."""


def install() -> None:
    """Make the readers of rosbags open only checked files, and SQLite files also if their name has a ``%`` or ``?``."""
    for each in (ros2_reader.DirectoryReader, ros2_reader.Reader):
        named = {name: IndexedMcapReader for name, kind in each.STORAGE_PLUGINS.items() if kind is McapReader}
        each.STORAGE_PLUGINS = {**each.STORAGE_PLUGINS, **named}
    open_unchecked = Sqlite3Reader.open

    def open_checked(reader: Sqlite3Reader) -> None:
        path = reader.path
        if isinstance(path, Path):
            # rosbags writes the path into a URI.
            reader.path = Path(quote(str(path.absolute())))
            check(path)

        thread = threading.get_ident()

        def read_definitions(database: apsw.Connection) -> None:
            if threading.get_ident() == thread:
                database.row_trace = _row_of_rosbags

        apsw.connection_hooks.append(read_definitions)
        try:
            open_unchecked(reader)
        finally:
            apsw.connection_hooks.remove(read_definitions)
            reader.path = path
        if reader.dbconn is not None:
            reader.dbconn.row_trace = None

    Sqlite3Reader.open = open_checked  # type: ignore[method-assign]


_DEFINITION_COLUMNS = ["topic_type", "encoding", "encoded_message_definition", "type_description_hash"]
_LANGUAGES = {
    "ros1msg": MessageDefinitionFormat.MSG,
    "ros2msg": MessageDefinitionFormat.MSG,
    "ros2idl": MessageDefinitionFormat.IDL,
    "omgidl": MessageDefinitionFormat.IDL,
}
_HEADLINE = "=" * 80 + "\nSRV: "


def definition(language: str, text: str) -> MessageDefinition:
    """Definition of a type in a bag; none if it has another language, such as Protobuf.

    rosbag2 of Jazzy writes ``unknown`` for types without a definition, and for services without parts of other types.
    """
    known = "ros2msg" if language == "unknown" and text.startswith(_HEADLINE) else language
    format = _LANGUAGES.get(known, MessageDefinitionFormat.NONE)
    return MessageDefinition(format, text if format is not MessageDefinitionFormat.NONE else "")


def _row_of_rosbags(cursor: apsw.Cursor, row: tuple[Any, ...]) -> tuple[Any, ...]:
    """Row of a SQLite file. rosbags knows no definition in another language, and none of a service for its event."""
    if [name for name, *_ in cursor.get_description()] != _DEFINITION_COLUMNS:
        return row
    name, language, text, digest = (each if isinstance(each, str) else "" for each in row)
    found = definition(language, text)
    is_service = "/srv/" in name and not name.endswith("_Event")
    language = "ros2idl" if found.format is MessageDefinitionFormat.IDL else "ros2msg"
    return f"{name}_Event" if is_service else name, language, found.data, digest


def check(path: Path) -> None:
    """Raise ValueError or apsw.Error if a SQLite file is no plain bag."""
    size = path.stat().st_size
    left = (_LEAST_STEPS + _STEPS_A_BYTE * size) // _STEPS

    def is_over() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    uri = f"file:{quote(str(path.absolute()))}?immutable=1"
    database = apsw.Connection(uri, flags=apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI)
    try:
        database.set_progress_handler(is_over, _STEPS)
        _check_objects(database)
        held = round(sum(_size(database, table) for table in _TABLES))
    except apsw.InterruptError as error:
        raise ValueError(f"its tables have more rows than fit into {size} bytes") from error
    finally:
        database.close()
    if held > size:
        raise ValueError(f"its tables hold {held} bytes, but the file has {size}")


def _check_objects(database: apsw.Connection) -> None:
    objects = database.execute("SELECT type, name, rootpage FROM sqlite_master LIMIT ?", (_MAX_OBJECTS,)).fetchall()
    if len(objects) == _MAX_OBJECTS:
        raise ValueError(f"it has {_MAX_OBJECTS} tables or more")
    for kind, name, page in objects:
        # Views, triggers and virtual tables have no page.
        if kind not in ("table", "index") or not page:
            raise ValueError(f"it has a {kind} {name!r} that holds no rows of its own")


def _size(database: apsw.Connection, table: str) -> int:
    """Bytes of the texts and blobs of a table, by its rows or those of an index; 0 if it does not exist."""
    columns = database.execute("SELECT name, hidden FROM pragma_table_xinfo(?)", (table,)).fetchall()
    for name, hidden in columns:
        if hidden:
            raise ValueError(f"column {name!r} of {table} is generated")
    if not columns:
        return 0
    names = [_quoted(name) for name, _ in columns]
    total = " + ".join(f"iif(typeof({name}) IN ('text', 'blob'), length({name}), 0)" for name in names)
    indices = database.execute("SELECT name FROM pragma_index_list(?)", (table,)).fetchall()
    ways = ["NOT INDEXED", *(f"INDEXED BY {_quoted(name)}" for (name,) in indices)]
    return max(database.execute(f"SELECT total({total}) FROM {table} {way}").get for way in ways)


def _quoted(name: object) -> str:
    return '"' + str(name).replace('"', '""') + '"'
