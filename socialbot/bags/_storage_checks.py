"""Checks of MCAP and SQLite files before rosbags reads them.

rosbags holds all chunks of one moment of an MCAP file at once. An index can name one chunk again and again, and each of
many small chunks can become a gigabyte.

A SQLite file is a program as well: a view can have rows without end, a generated column can make gigabytes of each row,
and pages can be used many times. So rosbags reads only files whose tables hold no more than the file has.
"""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

import apsw
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from socialbot.core.limits import BAG_CHUNK_BYTES, BAG_RATIO


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
    read_index = McapReader.read_index

    def checked_index(reader: McapReader) -> None:
        read_index(reader)
        check_index(reader)

    McapReader.read_index = checked_index  # type: ignore[method-assign]
    open_unchecked = Sqlite3Reader.open

    def open_checked(reader: Sqlite3Reader) -> None:
        path = reader.path
        if isinstance(path, Path):
            # rosbags writes the path into a URI.
            reader.path = Path(quote(str(path.absolute())))
            check(path)
        try:
            open_unchecked(reader)
        finally:
            reader.path = path

    Sqlite3Reader.open = open_checked  # type: ignore[method-assign]


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
