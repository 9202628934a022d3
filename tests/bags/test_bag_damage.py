"""Bags that are cut off, damaged, or no bags at all."""

from __future__ import annotations

import contextlib
import logging
import shutil
import sqlite3
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from ruamel.yaml import YAML

from socialbot.bags.codec import encode
from socialbot.bags.reader import BagWriter, open_bag
from socialbot.core.errors import BagError
from socialbot.core.messages import Utterance
from tests.bags.making_bags import (
    RAW,
    SAY,
    START,
    TYPES,
    check_pictures,
    contents,
    make,
    make_mcap,
    make_ros1,
    make_with_rosbags,
    picture,
    times,
)
from tests.bags.test_bags import channel
from tests.vision.metrics.scenes import drawn_bag


def test_damaged_messages_are_counted_and_skipped(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    good = TYPES.serialize(encode(picture(5), TYPES))
    pieces = [good, b"", good[:-1], b"\0\1\0\0", good[:7], b"\xff" * 200, good]
    path = make_with_rosbags(tmp_path / "bag", [(RAW, time, data) for time, data in zip(times(7), pieces, strict=True)])
    with caplog.at_level(logging.WARNING), open_bag(path) as bag:
        for _ in range(2):
            assert len(list(bag.messages({RAW: RAW}))) == 2
            assert bag.skipped[RAW].count == 5
            assert "0 bytes" in bag.skipped[RAW].first
        assert [data for *_, data in bag.raw_messages({RAW: RAW})] == [good, good[:-1], good[:7], good]
        assert bag.check()[RAW].count == 5
    assert len([record for record in caplog.records if "skipping" in record.message]) == 4


def test_json_that_does_not_fit_is_counted_and_skipped(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        for text in ('{"schema": "socialbot/Mind/9"}', "hello"):
            writer.write_raw(
                SAY, "std_msgs/msg/String", TYPES.serialize(TYPES.make("std_msgs/msg/String", data=text)), 3
            )
    with open_bag(path) as bag:
        assert [message for _, message in bag.messages({SAY: SAY})] == [Utterance(stamp=3, id="text-3", text="hello")]
        assert "socialbot/Mind/9" in bag.skipped[SAY].first


def test_truncated_mcap_file_is_read_as_far_as_it_is_whole(tmp_path: Path) -> None:
    data = (make(tmp_path / "bag", count=24, size=(360, 480)) / "bag.mcap").read_bytes()
    expected = [message.stamp for _, message in contents(tmp_path / "bag", RAW)]
    file = tmp_path / "cut.mcap"
    lengths = []
    for part in (0.2, 0.4, 0.6, 0.8, 0.97):
        file.write_bytes(data[: int(len(data) * part)])
        with open_bag(file) as bag:
            found = [message.stamp for _, message in bag.messages({RAW: RAW})]
            assert bag.topic(RAW).count == len(found)
            assert "truncated" in bag.damage[0]
        assert found == expected[: len(found)]
        lengths.append(len(found))
    assert lengths == sorted(set(lengths))
    assert lengths[0] > 0


def test_damage_of_a_file_is_reported_once_in_a_process(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = (make(tmp_path / "bag", count=4) / "bag.mcap").read_bytes()
    monkeypatch.chdir(tmp_path)
    with caplog.at_level(logging.WARNING):
        for length in (len(data) - 9, len(data) - 400):
            Path("cut.mcap").write_bytes(data[:length])
            for path in ("cut.mcap", tmp_path / "cut.mcap"):
                with open_bag(path) as bag:
                    assert "truncated" in bag.damage[0]
    assert len([record for record in caplog.records if "truncated" in record.message]) == 2


def test_cut_through_the_index_costs_no_image(tmp_path: Path) -> None:
    data = (make(tmp_path / "bag", count=4, size=(600, 600)) / "bag.mcap").read_bytes()
    file = tmp_path / "cut.mcap"
    index = len(data) - data.rindex(b"\x0f\x04" + bytes(7))
    for missing in [1, 8, 30, 37, *range(50, index, 300), *range(index - 3, index + 60, 9)]:
        file.write_bytes(data[:-missing])
        with open_bag(file) as bag:
            assert len(list(bag.messages({RAW: RAW}))) == (4 if missing <= index else bag.topic(RAW).count)
            assert bag.topic(RAW).count >= 3


def test_files_that_lack_a_topic(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    path.mkdir()
    for number, topic in enumerate((RAW, "/other")):
        part = make_with_rosbags(tmp_path / f"part_{number}", [(topic, START + number, picture(5))])
        shutil.copy(part / f"part_{number}.db3", path)
    assert [topic for topic, _ in contents(path, "/other")] == ["/other"]


def test_recording_that_was_killed_is_read_without_metadata(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = make(tmp_path / "bag", count=24, size=(360, 480))
    file = path / "bag.mcap"
    file.write_bytes(file.read_bytes()[:-9000])
    with open_bag(path) as bag:
        assert len(list(bag.messages({RAW: RAW}))) > 15
        assert len(bag.damage) == 2
    (path / "metadata.yaml").unlink()
    with caplog.at_level(logging.WARNING), open_bag(path) as bag:
        assert len(list(bag.messages({RAW: RAW}))) > 15
    assert "missing" in caplog.text


def failure_of(file: Path) -> BagError | None:
    try:
        with open_bag(file) as bag:
            bag.check()
            list(bag.messages({topic.name: topic.name for topic in bag.topics if topic.name == RAW}))
    except BagError as error:
        return error
    return None


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(kind=st.sampled_from([".mcap", ".db3", ".bag"]), part=st.floats(0, 0.9999), flip=st.booleans())
def test_broken_files_are_bag_errors(
    built: dict[str, bytes], tmp_path: Path, kind: str, part: float, flip: bool
) -> None:
    data = bytearray(built[kind])
    place = int(len(data) * part)
    if flip:
        data[place : place + 9] = b"\xff" * len(data[place : place + 9])
    else:
        del data[place:]
    file = tmp_path / f"broken{kind}"
    file.write_bytes(data)
    error = failure_of(file)
    assert error is None or (error.where == str(file) and error.remedy)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("built")
    mcap, db3 = make(folder / "mcap"), make(folder / "db3", storage="sqlite3")
    return {
        ".mcap": (mcap / "mcap.mcap").read_bytes(),
        ".db3": (db3 / "db3.db3").read_bytes(),
        ".bag": make_ros1(folder / "old.bag").read_bytes(),
    }


@pytest.mark.parametrize("kind", [".db3", ".bag"])
@pytest.mark.parametrize("part", [0.1, 0.4, 0.7])
def test_truncated_files_without_rescue_name_their_repair(
    built: dict[str, bytes], tmp_path: Path, kind: str, part: float
) -> None:
    file = tmp_path / f"cut{kind}"
    file.write_bytes(built[kind][: int(len(built[kind]) * part)])
    with pytest.raises(BagError, match="damaged") as caught:
        open_bag(file)
    assert {".db3": "sqlite3", ".bag": "reindex"}[kind] in str(caught.value.remedy)


def test_intact_messages_are_read_before_the_damage(tmp_path: Path) -> None:
    path = make(tmp_path / "bag", count=24, size=(360, 480))
    data = bytearray((path / "bag.mcap").read_bytes())
    middle = data.index(b"\x05", len(data) // 2 - len(data) // 2 % 7)
    data[middle : middle + 600_000] = b"\xee" * 600_000
    (path / "bag.mcap").write_bytes(data)
    found: list[int] = []
    with open_bag(path) as bag, pytest.raises(BagError, match="damaged"):
        found.extend(message.stamp for _, message in bag.messages({RAW: RAW}))
    assert found == [time - 5_000_000 for time in times(24)][: len(found)]
    assert len(found) >= 8


LFS_POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:b90a\nsize 990\n"


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("nothing", None, "no such file"),
        ("folder/", None, "not a bag"),
        ("film.mp4", b"x", "not a bag: .mp4"),
        ("bag", b"x", "not a bag: no suffix"),
        ("visit.bag.active", b"x", "a recording that has not ended"),
        ("empty.mcap", b"", "empty"),
        ("empty.db3", b"", "tables"),
        ("empty.bag", b"", "empty"),
        ("text.mcap", b"hello world" * 100, "magic"),
        ("text.db3", b"hello world" * 100, "not a database"),
        ("text.bag", b"hello world" * 100, "magic"),
        *((f"pointer{suffix}", LFS_POINTER, "a pointer of Git LFS") for suffix in (".mcap", ".db3", ".bag")),
    ],
)
def test_refuses_other_files(tmp_path: Path, name: str, content: bytes | None, complaint: str) -> None:
    path = tmp_path / name
    if name.endswith("/"):
        path.mkdir()
    elif content is not None:
        path.write_bytes(content)
    with pytest.raises(BagError, match=complaint) as caught:
        open_bag(path)
    assert caught.value.remedy
    assert caught.value.where == str(path)


@pytest.mark.parametrize("text", ["", "a: [", "rosbag2_bagfile_information: {}", "- 1"])
def test_folder_with_useless_metadata_is_read_by_its_files(tmp_path: Path, text: str) -> None:
    path = make(tmp_path / "bag")
    (path / "metadata.yaml").write_text(text)
    check_pictures(path)
    (path / "bag.mcap").unlink()
    with pytest.raises(BagError, match="damaged"):
        open_bag(path)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_bag_without_messages(tmp_path: Path, storage: str) -> None:
    with BagWriter(tmp_path / "bag", storage=storage):
        pass
    with pytest.raises(BagError, match="no messages"):
        open_bag(tmp_path / "bag")


def test_a_folder_of_bags_names_one_of_them(tmp_path):
    drawn_bag(tmp_path, "visit", frames=1)
    with pytest.raises(BagError, match="not a bag") as refused:
        open_bag(tmp_path)
    assert str(tmp_path / "visit") in (refused.value.remedy or "")


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("difference", ["qos", "hash", "missing topic"])
def test_messages_are_read_if_the_metadata_describes_their_topic_differently(
    tmp_path: Path, storage: str, difference: str
) -> None:
    path = make(tmp_path / "bag", storage=storage)
    with open_bag(path) as bag:
        before = bag.topics
        assert not bag.is_latched(RAW)
    yaml, file = YAML(), path / "metadata.yaml"
    metadata = yaml.load(file)
    topics = metadata["rosbag2_bagfile_information"]["topics_with_message_count"]
    for index, topic in reversed(list(enumerate(topics))):
        if difference == "qos":
            for profile in topic["topic_metadata"]["offered_qos_profiles"]:
                profile["durability"] = "transient_local"
        elif difference == "hash":
            topic["topic_metadata"]["type_description_hash"] = "RIHS01_0"
        elif topic["topic_metadata"]["name"] == RAW:
            del topics[index]
    yaml.dump(metadata, file)
    with open_bag(path) as bag:
        assert bag.topics == before
        assert bag.is_latched(RAW) is (difference == "qos")
    check_pictures(path)


@pytest.mark.parametrize(
    ("profiles", "latched"),
    [
        ("- {history: 1, depth: 1, reliability: 1, durability: 1}", True),
        ("- {durability: transient_local, deadline: {sec: 0}, depth: many, liveliness: 1.5}", True),
        ("- {durability: 2}\n- {durability: 1}", True),
        ("- {durability: [1]}", False),
        ("latching: true", False),
        ("- 5", False),
        ("5", False),
        ("garbage: [", False),
        ("null", False),
    ],
)
@pytest.mark.parametrize("where", ["file.mcap", "file.db3", "metadata.yaml"])
def test_a_topic_with_a_part_of_a_qos_profile_is_read(tmp_path: Path, where: str, profiles: str, latched: bool) -> None:
    """Programs other than rosbag2 write only some keys of a profile."""
    path = make(tmp_path / "bag", storage="sqlite3")
    if where == "file.mcap":
        path = make_mcap(tmp_path / "bag.mcap", "ros2", [channel("cdr")], {"offered_qos_profiles": profiles})
    elif where == "file.db3":
        with sqlite3.connect(path / "bag.db3") as database:
            database.execute("UPDATE topics SET offered_qos_profiles = ?", [profiles])
        (path / "metadata.yaml").unlink()
    else:
        yaml, file = YAML(), path / "metadata.yaml"
        metadata = yaml.load(file)
        for topic in metadata["rosbag2_bagfile_information"]["topics_with_message_count"]:
            topic["topic_metadata"]["offered_qos_profiles"] = profiles
        yaml.dump(metadata, file)
    check_pictures(path, 3 if where == "file.mcap" else 10)
    with open_bag(path) as bag:
        assert bag.is_latched(RAW) is latched
        assert where != "metadata.yaml" or not bag.damage


@pytest.mark.parametrize("storage", StoragePlugin)
def test_compressed_messages_are_read_without_metadata(tmp_path: Path, storage: StoragePlugin) -> None:
    """A killed recorder leaves no metadata.yaml, which says that messages are compressed."""
    pictures = [(RAW, time, picture(time - 5_000_000)) for time in times(10)]
    path = make_with_rosbags(tmp_path / "bag", pictures, mode=CompressionMode.MESSAGE, storage=storage)
    (path / "metadata.yaml").unlink()
    check_pictures(path)
    (file,) = path.iterdir()
    check_pictures(file)


def test_compressed_files_without_metadata_are_named(tmp_path: Path) -> None:
    pictures = [(RAW, time, picture(time - 5_000_000)) for time in times(10)]
    path = make_with_rosbags(tmp_path / "bag", pictures, mode=CompressionMode.FILE)
    check_pictures(path)
    (path / "metadata.yaml").unlink()
    with pytest.raises(BagError, match="without the metadata") as caught:
        open_bag(path)
    assert caught.value.remedy == f"decompress with `zstd -d {path}/*.zstd`"
    with pytest.raises(BagError, match="a compressed file of a bag"):
        open_bag(path / "bag.db3.zstd")
    later = make_with_rosbags(tmp_path / "later", pictures)
    shutil.copy(later / "later.db3", path)
    with open_bag(path) as bag:
        assert "not bag.db3.zstd: decompress with" in bag.damage[0]


@pytest.mark.parametrize("kind", ["folder", "folder without metadata", "file"])
def test_a_write_ahead_log_of_sqlite_is_told(tmp_path: Path, kind: str) -> None:
    path = make(tmp_path / "bag", storage="sqlite3")
    (file,) = path.glob("*.db3")
    killed = tmp_path / "killed"
    with contextlib.closing(sqlite3.connect(file)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute(
            "INSERT INTO messages(topic_id, timestamp, data) SELECT topic_id, timestamp, data FROM messages"
        )
        database.commit()
        shutil.copytree(path, killed)
    with open_bag(path) as bag:
        assert not bag.damage
    if kind == "folder without metadata":
        (killed / "metadata.yaml").unlink()
    with open_bag(killed / file.name if kind == "file" else killed) as bag:
        (told,) = [each for each in bag.damage if "metadata" not in each]
    assert "bag.db3-wal: its messages are not read; move them into the bag: sqlite3" in told
