"""SQLite files of bags that have more rows than bytes, or whose name means another file."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

import pytest

from socialbot.bags.reader import open_bag
from socialbot.core.errors import BagError
from tests.bags.making_bags import RAW, SAY, make

PAGE = 4096


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return make(tmp_path / "bag", storage="sqlite3") / "bag.db3"


def change(file: Path, *statements: str) -> None:
    with closing(sqlite3.connect(file)) as database:
        for statement in statements:
            database.execute(statement)
        database.commit()


def refusal(file: Path) -> str:
    with pytest.raises(BagError) as caught:
        open_bag(file)
    return str(caught.value)


def remake(table: str, columns: str) -> tuple[str, str]:
    """Make an empty table in place of one of a bag."""
    return f"ALTER TABLE {table} RENAME TO {table}_before", f"CREATE TABLE {table}({columns})"


ENDLESS = "WITH RECURSIVE t(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM t)"


def test_a_view_without_end_is_refused(file: Path) -> None:
    columns = "id, 'a' topic_type, 'ros2msg' encoding, '' encoded_message_definition, '' type_description_hash"
    change(
        file,
        "ALTER TABLE message_definitions RENAME TO before",
        f"CREATE VIEW message_definitions AS {ENDLESS} SELECT {columns} FROM t",
    )
    assert "it has a view 'message_definitions'" in refusal(file)


def test_generated_blobs_are_refused(file: Path) -> None:
    """Ten rows of 100 MB, which are sorted by time."""
    data = "data BLOB GENERATED ALWAYS AS (zeroblob(100000000))"
    change(
        file,
        *remake("messages", f"id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, {data}"),
        "INSERT INTO messages(topic_id, timestamp) SELECT topic_id, timestamp FROM messages_before",
    )
    assert "column 'data' of messages is generated" in refusal(file)


def test_a_default_of_many_rows_is_refused(file: Path) -> None:
    blob = "00" * 10_000
    change(
        file,
        *remake("messages", "id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER"),
        "INSERT INTO messages(topic_id, timestamp) SELECT topic_id, timestamp FROM messages_before, "
        f"({ENDLESS} SELECT id FROM t LIMIT 100)",
        f"ALTER TABLE messages ADD COLUMN data BLOB DEFAULT x'{blob}'",
    )
    assert "its tables hold" in refusal(file)


@pytest.mark.parametrize("name", ["messages", "by_time"])
def test_pages_that_are_used_many_times_are_refused(file: Path, name: str) -> None:
    """Each row is read 400^6 times if the pages of the tree, or of an index, have the same children."""
    change(
        file,
        f"PRAGMA page_size = {PAGE}",
        f"INSERT INTO messages(topic_id, timestamp, data) {ENDLESS} SELECT 1, id, x'00010000' FROM t LIMIT 60000",
        "CREATE INDEX by_time ON messages (timestamp)",
    )
    with closing(sqlite3.connect(file)) as database:
        ((root,),) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = ?", (name,))
    tree = bytearray(file.read_bytes())
    begin = (root - 1) * PAGE
    for _ in range(6):
        # A copy of the root at the end, and the root with this copy as each of its children.
        tree += tree[begin : begin + PAGE]
        (count,) = struct.unpack_from(">H", tree, begin + 3)
        places = (struct.unpack_from(">H", tree, begin + 12 + 2 * each)[0] for each in range(count))
        for place in (8, *places):
            struct.pack_into(">I", tree, begin + place, len(tree) // PAGE)
    struct.pack_into(">I", tree, 28, len(tree) // PAGE)
    file.write_bytes(tree)
    assert "more rows than fit into" in refusal(file)


def test_a_name_with_a_percent_sign_is_that_of_its_own_file(file: Path, tmp_path: Path) -> None:
    (tmp_path / "stranger").mkdir()
    other = make(tmp_path / "other", storage="sqlite3") / "other.db3"
    change(other, f"UPDATE topics SET name = '/secret' WHERE name = '{SAY}'")
    named = shutil.copy(file, tmp_path / "stranger" / "%2e%2e%2fother%2fother.db3")
    with open_bag(Path(named)) as bag:
        assert {topic.name for topic in bag.topics} >= {RAW, SAY}
    with open_bag(tmp_path / "stranger") as bag:
        assert {topic.name for topic in bag.topics} >= {RAW, SAY}


@pytest.mark.parametrize("name", ["a?b.db3", "a#b.db3", "a%b.db3", "a b.db3", "ä.db3"])
def test_any_name_of_a_file_is_read(file: Path, tmp_path: Path, name: str) -> None:
    with open_bag(Path(shutil.copy(file, tmp_path / name))) as bag:
        assert bag.topic(SAY).count == 2
        assert not bag.check()
