"""Read and write bags."""

from __future__ import annotations

import re
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from socialbot.bags.codec import encode
from socialbot.bags.reader import DECODED_TYPES, OTHER_IMAGE_TYPES, open_bag
from socialbot.bags.writer import STORAGES, BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError
from socialbot.core.messages import CameraInfo, CompressedImage, PersonDetections, Utterance
from tests.bags.making_bags import (
    INFO,
    RAW,
    SAY,
    START,
    TYPES,
    K,
    check_pictures,
    contents,
    fill,
    make,
    make_mcap,
    make_ros1,
    make_with_rosbags,
    picture,
    times,
)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_written_bag_can_be_read(tmp_path: Path, storage: str) -> None:
    path = make(tmp_path / "bag", storage=storage)
    check_pictures(path)
    with open_bag(path) as bag:
        assert [(topic.name, topic.type.rpartition("/")[2], topic.count) for topic in bag.topics] == [
            (INFO, "CameraInfo", 2),
            (RAW, "Image", 10),
            (SAY, "String", 2),
        ]
        assert (bag.start, bag.end) == (START, times(10)[-1])
        assert bag.duration_s == pytest.approx(0.9)
        assert (bag.skipped, bag.damage) == ({}, ())


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_single_files_of_a_bag(tmp_path: Path, storage: str) -> None:
    folder = make(tmp_path / "bag", storage=storage)
    (file,) = (file for file in folder.iterdir() if file.suffix != ".yaml")
    check_pictures(file)


def test_messages_are_in_bag_order_with_graph_names(tmp_path: Path) -> None:
    path = make(tmp_path / "bag", count=6)
    with open_bag(path) as bag:
        found = [
            (topic, type(message).__name__) for topic, message in bag.messages({RAW: "/eye", SAY: "/say", INFO: "/k"})
        ]
    first = [("/eye", "Image"), ("/k", "CameraInfo"), ("/say", "Utterance")]
    assert found == [*first, *[("/eye", "Image")] * 4, *first]


def test_schema_in_the_json_selects_the_type(tmp_path: Path) -> None:
    detections = PersonDetections(stamp=5, frame_id="c", width=8, height=6, persons=())
    path = make_with_rosbags(
        tmp_path / "bag", [("/a", START, detections), ("/b", START, Utterance(stamp=1, id="u", text="x"))]
    )
    assert [message for _, message in contents(path)] == [detections, Utterance(stamp=1, id="u", text="x")]


@pytest.mark.parametrize(
    ("plugin", "mode"),
    [
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    ],
)
def test_compressed_bags(tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode) -> None:
    pictures = [(RAW, time, picture(time - 5_000_000)) for time in times(10)]
    check_pictures(make_with_rosbags(tmp_path / "bag", pictures, mode=mode, storage=plugin))


def split(path: Path, parts: Path) -> Path:
    """One bag of two files, made of two bags, as ``ros2 bag record --max-bag-duration`` leaves them."""
    path.mkdir()
    text = ""
    pictures = [(RAW, time, picture(time - 5_000_000)) for time in times(10)]
    for number, piece in enumerate((pictures[:5], pictures[5:])):
        part = make_with_rosbags(parts / f"part_{number}", piece)
        shutil.copy(part / f"part_{number}.db3", path / f"part_{number}.db3")
        text = (part / "metadata.yaml").read_text()
    text = text.replace("message_count: 5", "message_count: 10")
    (path / "metadata.yaml").write_text(text.replace("- part_1.db3", "- part_0.db3\n  - part_1.db3", 1))
    return path


def test_split_bags(tmp_path: Path) -> None:
    path = split(tmp_path / "bag", tmp_path)
    check_pictures(path)
    (path / "metadata.yaml").unlink()
    check_pictures(path)


def test_metadata_that_cannot_be_used_is_told(tmp_path: Path) -> None:
    path = make_with_rosbags(tmp_path / "bag", [(RAW, time, picture(time - 5_000_000)) for time in times(10)])
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("serialization_format: cdr", "serialization_format: protobuf"))
    check_pictures(path)
    with open_bag(path) as bag:
        (told,) = bag.damage
    assert told.startswith(f"{metadata}: cannot be used: ")
    assert "protobuf" in told
    assert "damaged" not in told
    assert told.endswith("; the .mcap and .db3 files are read")


def test_ros1_bags(tmp_path: Path) -> None:
    path = make_ros1(tmp_path / "old.bag")
    check_pictures(path)
    infos = contents(path, INFO)
    assert [message.k for _, message in infos if isinstance(message, CameraInfo)] == [K, K]
    with open_bag(path) as bag:
        assert (bag.start, bag.end) == (START, times(10)[-1])


@pytest.mark.parametrize("suffix", [".bag", ".mcap"])
def test_ros1_messages_may_have_bytes_behind_their_fields(tmp_path: Path, suffix: str) -> None:
    """The recorder of librealsense appends a field that the definition lacks, and ROS 1 ignores it."""
    packed = [message + bytes(4) for message in channel("ros1")[-1]]
    path = tmp_path / f"viewer{suffix}"
    if suffix == ".bag":
        with Ros1Writer(path) as writer:
            pictures = writer.add_connection(RAW, "sensor_msgs/msg/Image", typestore=get_typestore(Stores.ROS1_NOETIC))
            for time, message in zip(times(3), packed, strict=True):
                writer.write(pictures, time, message)
    else:
        make_mcap(path, "ros1", [(*channel("ros1")[:-1], packed)])
    check_pictures(path, 3)
    with open_bag(path) as bag:
        assert [TYPES.deserialize(data, name).width for *_, name, data in bag.raw_messages({RAW: RAW})] == [8, 8, 8]
        assert bag.check() == {}


def channel(encoding: str, *, count: int = 3) -> tuple[str, str, str, bytes, str, list[bytes]]:
    """Pictures in an encoding of ROS, as a converter writes them to an .mcap file."""
    ros1 = encoding == "ros1"
    store, name = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY), "sensor_msgs/msg/Image"
    messages = []
    for time in times(count):
        image = encode(picture(time - 5_000_000), TYPES)
        if ros1:
            stamp = image.header.stamp
            image.header = store.types["std_msgs/msg/Header"](seq=1, stamp=stamp, frame_id="camera")
        messages.append(bytes(store.serialize_ros1(image, name) if ros1 else store.serialize_cdr(image, name)))
    schema = store.generate_msgdef(name)[0].encode()
    return (RAW, "sensor_msgs/Image" if ros1 else name, "ros1msg" if ros1 else "ros2msg", schema, encoding, messages)


PROTOBUF = ("/lidar", "foxglove.PointCloud", "protobuf", b"\xff\xfe\x0a", "protobuf", [b"\x08\x01"] * 3)
"""Messages of Foxglove; the schema is not text."""


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
@pytest.mark.parametrize("profile", ["", "ros1", "ros2", "protobuf"])
def test_mcap_files_of_other_recorders(tmp_path: Path, encoding: str, profile: str) -> None:
    path = make_mcap(tmp_path / "run.mcap", profile, [channel(encoding), PROTOBUF])
    check_pictures(path, 3)
    with open_bag(path) as bag:
        assert [(topic.name, topic.type) for topic in bag.topics] == [(RAW, "sensor_msgs/msg/Image")]
        assert bag.damage == (f"{path}: encoded as protobuf, not as ROS messages, and left out: /lidar",)
        assert [TYPES.deserialize(data, name).width for *_, name, data in bag.raw_messages({RAW: RAW})] == [8, 8, 8]
    path.write_bytes(path.read_bytes()[:-60])  # a power failure
    with open_bag(path) as bag:
        assert len(list(bag.messages({RAW: RAW}))) in (2, 3)


@pytest.mark.parametrize(("latching", "latched"), [("1", True), ("0", False), ("", False)])
def test_latched_topics_of_converted_ros1_bags(tmp_path: Path, latching: str, latched: bool) -> None:
    metadata = {"callerid": "/driver", "latching": latching} if latching else {}
    with open_bag(make_mcap(tmp_path / "old.mcap", "ros1", [channel("ros1")], metadata)) as bag:
        assert bag.is_latched(RAW) is latched


def test_mcap_file_without_messages_of_ros(tmp_path: Path) -> None:
    path = make_mcap(tmp_path / "run.mcap", "", [PROTOBUF])
    with pytest.raises(BagError, match="no ROS messages: its topics are encoded as protobuf") as caught:
        open_bag(path)
    assert caught.value.where == str(path)
    assert "convert the file" in str(caught.value.remedy)


@pytest.mark.parametrize("builder", [make, lambda path: make_ros1(path.with_suffix(".bag"))])
def test_raw_messages_are_cdr(tmp_path: Path, builder: Callable[[Path], Path]) -> None:
    with open_bag(builder(tmp_path / "bag")) as bag:
        raw = list(bag.raw_messages({RAW: "/eye"}))
    assert [(topic, time, name) for topic, time, name, _ in raw] == [
        ("/eye", time, "sensor_msgs/msg/Image") for time in times(10)
    ]
    for _, time, name, data in raw:
        assert data == TYPES.serialize(encode(picture(time - 5_000_000), TYPES)), name


def test_bag_can_be_read_twice(tmp_path: Path) -> None:
    with open_bag(make(tmp_path / "bag")) as bag:
        assert len(list(bag.messages({RAW: RAW}))) == len(list(bag.messages({RAW: RAW}))) == 10


def test_types_without_definition_in_the_bag(tmp_path: Path) -> None:
    path = make(tmp_path / "bag", storage="sqlite3")
    with sqlite3.connect(path / "bag.db3") as database:
        database.execute("DELETE FROM message_definitions")
    check_pictures(path)


@pytest.mark.parametrize("encoding", ["unknown", "", "protobuf", None])
def test_types_whose_definition_is_in_an_unknown_language(tmp_path: Path, encoding: str | None) -> None:
    """rosbag2 writes ``unknown`` for types whose definition it does not find."""
    path = make(tmp_path / "bag", storage="sqlite3")
    with sqlite3.connect(path / "bag.db3") as database:
        columns = "id INTEGER PRIMARY KEY, topic_type, encoding, encoded_message_definition, type_description_hash"
        database.execute("ALTER TABLE message_definitions RENAME TO before")
        database.execute(f"CREATE TABLE message_definitions({columns})")
        database.execute("INSERT INTO message_definitions SELECT id, topic_type, ?, 'text', '' FROM before", [encoding])
    check_pictures(path)


# Topics


def test_only_image_topic_is_chosen(tmp_path: Path) -> None:
    with open_bag(make(tmp_path / "bag")) as bag:
        assert bag.choose_image_topic().name == RAW
        assert bag.choose_image_topic(RAW).count == 10
        with pytest.raises(BagError, match="no topic '/camera/image_row'") as caught:
            bag.choose_image_topic("/camera/image_row")
        assert f"did you mean {RAW!r}" in str(caught.value.remedy)
        with pytest.raises(BagError, match="is std_msgs/msg/String"):
            bag.choose_image_topic(SAY)


def test_of_several_image_topics_one_must_be_named(tmp_path: Path) -> None:
    jpeg = CompressedImage(stamp=1, frame_id="c", format="jpeg", data=np.zeros(3, np.uint8))
    path = make_with_rosbags(tmp_path / "bag", [(RAW, START, picture(1)), ("/left/image/compressed", START, jpeg)])
    with open_bag(path) as bag:
        assert [topic.name for topic in bag.image_topics] == [RAW, "/left/image/compressed"]
        with pytest.raises(BagError, match="2 image topics") as caught:
            bag.choose_image_topic()
        assert "/left/image/compressed" in str(caught.value.remedy)
        assert bag.choose_image_topic("/left/image/compressed").type == "sensor_msgs/msg/CompressedImage"


def test_bag_without_images(tmp_path: Path) -> None:
    path = make_with_rosbags(tmp_path / "bag", [(SAY, START, Utterance(stamp=1, id="u", text="x"))])
    with open_bag(path) as bag, pytest.raises(BagError, match="no images") as caught:
        bag.choose_image_topic()
    assert SAY in str(caught.value.remedy)


def test_image_topics_without_messages_are_named(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.write(writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store), START, bytes(8))
        for topic in ("/left/image_raw", "/right/image_raw"):
            writer.add_connection(topic, "sensor_msgs/msg/Image", typestore=store)
    with open_bag(tmp_path / "bag") as bag, pytest.raises(BagError, match="the bag has no images") as caught:
        bag.choose_image_topic()
    assert "no messages on /left/image_raw, /right/image_raw" in str(caught.value)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("suffix", [".bag", ".mcap", ".db3"])
def test_folders_may_be_named_like_files(tmp_path: Path, suffix: str, storage: str) -> None:
    path = make(tmp_path / f"visit{suffix}", storage=storage)
    with open_bag(path) as bag:
        assert bag.damage == ()
    check_pictures(path)


def test_camera_info_is_in_the_namespace_of_the_images(tmp_path: Path) -> None:
    with open_bag(make(tmp_path / "bag")) as bag:
        for name in (RAW, f"{RAW}/compressed"):
            info = bag.camera_info_topic_for(name)
            assert info is not None
            assert info.name == INFO
        assert bag.camera_info_topic_for("/other/image_raw") is None


def test_refuses_missing_and_unknown_topics(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        writer.write_raw("/imu", "sensor_msgs/msg/Imu", bytes(8), 1)
        writer.write_raw("/odd", "nobody_msgs/msg/Thing", b"\0\1\0\0abcd", 1)
    with open_bag(path) as bag:
        for read in (bag.messages, bag.raw_messages):
            with pytest.raises(BagError, match="no topic '/imus'"):
                read({"/imus": "/imu"})
        with pytest.raises(BagError, match="the type of /odd, nobody_msgs/msg/Thing, is unknown"):
            bag.messages({"/odd": "/odd"})
        assert list(bag.messages({"/imu": "/imu"})) == []
        assert bag.skipped["/imu"].count == 1
        assert list(bag.raw_messages({"/odd": "/odd"})) == [("/odd", 1, "nobody_msgs/msg/Thing", b"\0\1\0\0abcd")]


def defined(path: Path, **definitions: str) -> Path:
    """A bag with one message on a topic for each definition, 64 bytes of zeros."""
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for name, text in definitions.items():
            kind = f"odd_msgs/msg/{name}"
            topic = writer.add_connection(f"/{name}", kind, msgdef=text, rihs01=f"RIHS01_{0:064}")
            writer.write(topic, START, b"\0\1\0\0" + bytes(64))
    return path


def test_types_that_cannot_be_read_are_not_damage(tmp_path: Path) -> None:
    path = defined(tmp_path / "bag", Wide="wstring text\n", Torn="int32 a\nother_msgs/Lost[] parts\n")
    reasons = {
        "/Wide": "the type of /Wide, odd_msgs/msg/Wide, has a wstring",
        "/Torn": "the type of /Torn, odd_msgs/msg/Torn, needs other_msgs/msg/Lost, which is unknown",
    }
    with open_bag(path) as bag:
        assert bag.check() == {}
        for topic, reason in reasons.items():
            with pytest.raises(BagError, match=reason) as caught:
                bag.messages({topic: topic})
            assert caught.value.remedy
            assert len(list(bag.raw_messages({topic: topic}))) == 1


def test_parts_of_ros_that_a_definition_leaves_out_are_known(tmp_path: Path) -> None:
    path = defined(tmp_path / "bag", Stamped="builtin_interfaces/Time stamp\ngeometry_msgs/Pose[] poses\n")
    with open_bag(path) as bag:
        assert len(list(bag.messages({"/Stamped": "/Stamped"}))) == 1
        assert bag.skipped == {}


# Writing


def test_existing_path_is_left_alone(tmp_path: Path) -> None:
    path = make(tmp_path / "bag")
    with pytest.raises(BagError, match="already exists") as caught:
        BagWriter(path)
    assert "another name" in str(caught.value.remedy)
    check_pictures(path)


def test_unknown_storage(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="no storage 'mcaps'") as caught:
        BagWriter(tmp_path / "bag", storage="mcaps")
    assert "did you mean 'mcap'" in str(caught.value.remedy)


def test_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="cannot be written"), BagWriter(tmp_path / "file" / "bag"):
        pass


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("interruption", [KeyboardInterrupt, ValueError, SystemExit])
def test_bag_can_be_read_however_writing_ended(tmp_path: Path, storage: str, interruption: type[BaseException]) -> None:
    path = tmp_path / "bag"
    bag = BagWriter(path, storage=storage)
    with pytest.raises(interruption):
        fill_and_raise(bag, interruption)
    check_pictures(path)
    assert bag.counts == {RAW: 10, INFO: 2, SAY: 2}


def fill_and_raise(bag: BagWriter, interruption: type[BaseException]) -> None:
    with bag:
        fill(bag)
        raise interruption


def test_camera_info_is_offered_to_late_joiners(tmp_path: Path) -> None:
    text = (make(tmp_path / "bag") / "metadata.yaml").read_text()
    assert text.count("durability: transient_local") == 1
    assert text.count("durability: volatile") == 2


@pytest.mark.parametrize("column", ["name", "type"])
def test_topic_without_a_name_or_a_type_is_damage(tmp_path: Path, column: str) -> None:
    path = make(tmp_path / "bag", storage="sqlite3") / "bag.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE others AS SELECT * FROM topics")
        database.execute("DROP TABLE topics")
        database.execute("ALTER TABLE others RENAME TO topics")
        database.execute(f"UPDATE topics SET {column} = NULL WHERE id = 1")
    with pytest.raises(BagError, match="damaged"):
        open_bag(path)


@pytest.mark.parametrize("time", ["NULL", "'noon'", "1.5", "x'00'"])
def test_message_without_a_time_is_damage(tmp_path: Path, time: str) -> None:
    path = make(tmp_path / "bag", storage="sqlite3") / "bag.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE others AS SELECT * FROM messages")
        database.execute("DROP TABLE messages")
        database.execute("ALTER TABLE others RENAME TO messages")
        database.execute(f"UPDATE messages SET timestamp = {time} WHERE id = 5")
    with pytest.raises(BagError, match="damaged"), open_bag(path) as bag:
        list(bag.messages({RAW: RAW}))


def test_metadata_that_is_nested_too_deeply_is_done_without(tmp_path: Path) -> None:
    path = make(tmp_path / "bag")
    (path / "metadata.yaml").write_text("{" * 10_000)
    with open_bag(path) as bag:
        assert "nested more than" in bag.damage[0]
    check_pictures(path)


@pytest.mark.parametrize("number", ["many", "[1]", "1.5", "null"])
def test_metadata_that_counts_in_no_numbers_is_done_without(tmp_path: Path, number: str) -> None:
    path = make(tmp_path / "bag")
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(re.sub(r"message_count: \d+", f"message_count: {number}", text))
    with open_bag(path) as bag:
        assert "cannot be used" in bag.damage[0]
    check_pictures(path)


SAID, ECHO = "/speech/say", "/speech/echo"


def say(bag: BagWriter, topic: str, number: int) -> None:
    bag.write(topic, Utterance(stamp=number, id=f"u{number}", text="hello"), number * SECOND)


@pytest.mark.parametrize("storage", STORAGES)
def test_flushed_messages_survive_a_kill(tmp_path: Path, storage: str) -> None:
    with BagWriter(tmp_path / "bag", storage=storage) as bag:
        bag.flush()
        for number in (1, 2, 3):
            say(bag, SAID, number)
        bag.flush()
        bag.flush()
        say(bag, ECHO, 4)
        bag.flush()
        say(bag, SAID, 5)
        shutil.copytree(tmp_path / "bag", tmp_path / "killed")
    with open_bag(tmp_path / "killed") as killed:
        found = [(topic, at) for topic, at, *_ in killed.raw_messages({SAID: SAID, ECHO: ECHO})]
    assert found == [(SAID, SECOND), (SAID, 2 * SECOND), (SAID, 3 * SECOND), (ECHO, 4 * SECOND)]
    with open_bag(tmp_path / "bag") as whole:
        assert not whole.damage
        assert {topic.name: topic.count for topic in whole.topics} == {SAID: 4, ECHO: 1}


def test_compressed_text_is_much_smaller(tmp_path):
    sizes = {}
    for compressed in (False, True):
        path = tmp_path / f"bag{compressed}"
        with BagWriter(path, compressed=compressed) as bag:
            for number in range(500):
                text = f"tea for number {number % 7}"
                bag.write(SAY, Utterance(stamp=1, id="u", text=text), number * SECOND)
        sizes[compressed] = sum(file.stat().st_size for file in path.glob("*.mcap"))
        with open_bag(path) as opened:
            assert len(list(opened.messages({SAY: SAY}))) == 500
    assert sizes[True] < sizes[False] / 3


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_messages_of_one_time_keep_their_order(tmp_path, storage):
    said = [
        (topic, Utterance(stamp=1, id="u", text=f"{topic}{number}"))
        for number in range(20)
        for topic in ("/b", "/a", "/c")
    ]
    with BagWriter(tmp_path / "bag", storage=storage, compressed=True) as bag:
        for topic, message in said:
            bag.write(topic, message, message.stamp + int(message.text[2:]))
    with open_bag(tmp_path / "bag") as opened:
        messages = opened.messages({"/a": "/a", "/b": "/b", "/c": "/c"})
        found = [message.text for _, message in messages if isinstance(message, Utterance)]
    assert found == [message.text for _, message in said]


@pytest.mark.parametrize("kind", OTHER_IMAGE_TYPES)
def test_images_that_no_node_takes_are_named_where_a_bag_has_no_images(tmp_path: Path, kind: str) -> None:
    writer = Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3)
    with writer:
        packets = writer.add_connection("/camera/video", kind, msgdef="uint8[] data", rihs01="unknown")
        writer.write(packets, START, bytes(12))
    with open_bag(tmp_path / "bag") as bag, pytest.raises(BagError, match="the bag has no images") as caught:
        bag.choose_image_topic()
    assert caught.value.remedy is not None
    decoded = f"decode its images first: socialbot bag convert {tmp_path / 'bag'} NEW --decode"
    republished = "republish /camera/video as raw or JPEG images"
    assert caught.value.remedy == (decoded if kind in DECODED_TYPES else republished)
