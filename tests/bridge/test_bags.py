from __future__ import annotations

import logging
import re
import shutil
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from socialbot.bridge.bags import BagWriter, RosbagsTypes, open_bag
from socialbot.bridge.codec import encode
from socialbot.clock import SECOND
from socialbot.errors import BagError
from socialbot.messages import CameraInfo, CompressedImage, Image, Message, PersonDetections, Utterance

TYPES = RosbagsTypes()
START = 1_700_000_000 * SECOND
RAW, INFO, SAY = "/camera/image_raw", "/camera/camera_info", "/speech/say"
K = (500.0, 0.0, 4.0, 0.0, 500.0, 3.0, 0.0, 0.0, 1.0)


def picture(stamp: int, *, size: tuple[int, int] = (6, 8)) -> Image:
    pixels = np.full((*size, 3), stamp % 251, np.uint8)
    return Image.from_bgr(pixels, stamp=stamp, frame_id="camera")


def times(count: int) -> list[int]:
    return [START + index * SECOND // 10 for index in range(count)]


def fill(bag: BagWriter, count: int = 10, *, size: tuple[int, int] = (6, 8)) -> None:
    """Pictures taken 5 ms before they are received, with a sentence and camera information now and then."""
    for index, time in enumerate(times(count)):
        bag.write(RAW, picture(time - 5_000_000, size=size), time)
        if index % 5 == 0:
            bag.write(INFO, CameraInfo(stamp=time, frame_id="camera", width=8, height=6, k=K), time + 1)
            bag.write(SAY, Utterance(stamp=time, id=f"u{index}", text="hello"), time + 2)


def make(path: Path, *, storage: str = "mcap", count: int = 10, size: tuple[int, int] = (6, 8)) -> Path:
    with BagWriter(path, storage=storage) as bag:
        fill(bag, count, size=size)
    return path


def make_with_rosbags(
    path: Path, contents: Sequence[tuple[str, int, Message | bytes]], *, mode: CompressionMode = CompressionMode.NONE,
    storage: StoragePlugin = StoragePlugin.SQLITE3,
) -> Path:  # fmt: skip
    """A bag with any bytes in it; those that are no messages are said to be pictures."""
    writer = Writer(path, version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    store = get_typestore(Stores.ROS2_JAZZY)
    with writer:
        connections = {}
        for topic, time, message in contents:
            if isinstance(message, bytes):
                name, data = "sensor_msgs/msg/Image", message
            else:
                ros = encode(message, TYPES)
                name, data = ros.__msgtype__, TYPES.serialize(ros)
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            writer.write(connections[topic], time, data)
    return path


def make_ros1(path: Path, count: int = 10) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    header, time_type = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    with Ros1Writer(path) as writer:
        pictures = writer.add_connection(RAW, "sensor_msgs/msg/Image", typestore=store)
        infos = writer.add_connection(INFO, "sensor_msgs/msg/CameraInfo", typestore=store)
        for index, time in enumerate(times(count)):
            seconds, rest = divmod(time - 5_000_000, SECOND)
            stamped = header(seq=index, stamp=time_type(sec=seconds, nanosec=rest), frame_id="camera")
            image = encode(picture(time - 5_000_000), TYPES)
            image.header = stamped
            writer.write(pictures, time, store.serialize_ros1(image, "sensor_msgs/msg/Image"))
            if index % 5 == 0:
                info = encode(CameraInfo(stamp=1, frame_id="camera", width=8, height=6, k=K), TYPES)
                region = store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
                ros1 = store.types["sensor_msgs/msg/CameraInfo"](
                    stamped, 6, 8, "plumb_bob", info.d, info.k, info.r, info.p, 0, 0, region
                )
                writer.write(infos, time + 1, store.serialize_ros1(ros1, "sensor_msgs/msg/CameraInfo"))
    return path


def contents(path: Path, *topics: str) -> list[tuple[str, Message]]:
    with open_bag(path) as bag:
        names = topics or tuple(topic.name for topic in bag.topics)
        return list(bag.messages({name: name for name in names}))


def check_pictures(path: Path, count: int = 10) -> None:
    found = contents(path, RAW)
    assert [message.stamp for _, message in found] == [time - 5_000_000 for time in times(count)]
    for _, message in found:
        assert isinstance(message, Image)
        assert np.array_equal(message.bgr(), picture(message.stamp).bgr())


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_what_is_written_can_be_read(tmp_path: Path, storage: str) -> None:
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


def test_messages_come_in_the_order_of_the_bag_under_the_names_of_the_graph(tmp_path: Path) -> None:
    path = make(tmp_path / "bag", count=6)
    with open_bag(path) as bag:
        found = [
            (topic, type(message).__name__) for topic, message in bag.messages({RAW: "/eye", SAY: "/say", INFO: "/k"})
        ]
    first = [("/eye", "Image"), ("/k", "CameraInfo"), ("/say", "Utterance")]
    assert found == [*first, *[("/eye", "Image")] * 4, *first]


def test_the_schema_in_the_json_decides_what_a_string_becomes(tmp_path: Path) -> None:
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


def test_ros1_bags(tmp_path: Path) -> None:
    path = make_ros1(tmp_path / "old.bag")
    check_pictures(path)
    infos = contents(path, INFO)
    assert [message.k for _, message in infos if isinstance(message, CameraInfo)] == [K, K]
    with open_bag(path) as bag:
        assert (bag.start, bag.end) == (START, times(10)[-1])


@pytest.mark.parametrize("builder", [make, lambda path: make_ros1(path.with_suffix(".bag"))])
def test_raw_messages_are_cdr(tmp_path: Path, builder: Callable[[Path], Path]) -> None:
    with open_bag(builder(tmp_path / "bag")) as bag:
        raw = list(bag.raw_messages({RAW: "/eye"}))
    assert [(topic, time, name) for topic, time, name, _ in raw] == [
        ("/eye", time, "sensor_msgs/msg/Image") for time in times(10)
    ]
    for _, time, name, data in raw:
        assert data == TYPES.serialize(encode(picture(time - 5_000_000), TYPES)), name


def test_a_bag_can_be_read_twice(tmp_path: Path) -> None:
    with open_bag(make(tmp_path / "bag")) as bag:
        assert len(list(bag.messages({RAW: RAW}))) == len(list(bag.messages({RAW: RAW}))) == 10


def test_types_without_definition_in_the_bag(tmp_path: Path) -> None:
    path = make(tmp_path / "bag", storage="sqlite3")
    with sqlite3.connect(path / "bag.db3") as database:
        database.execute("DELETE FROM message_definitions")
    check_pictures(path)


# Stamps


def stamps_of(path: Path, stamps: list[int]) -> list[int]:
    """What becomes of ``stamps``, as they are in the headers."""
    bag = make_with_rosbags(
        path, [(RAW, time, picture(stamp)) for time, stamp in zip(times(len(stamps)), stamps, strict=True)]
    )
    return [message.stamp for _, message in contents(bag)]


def test_zero_stamps_become_the_time_of_reception(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        assert stamps_of(tmp_path / "bag", [0, 0, 0]) == times(3)
    assert len([record for record in caplog.records if "zero" in record.message]) == 1


def test_stamps_that_go_back_go_on_with_the_time_of_reception(tmp_path: Path) -> None:
    tenth, begin = SECOND // 10, times(1)[0]
    found = stamps_of(tmp_path / "bag", [begin + 50, begin + 51, begin + 7, begin + 8, 0])
    assert [stamp - begin for stamp in found] == [50, 51, 51 + tenth, 51 + 2 * tenth, 51 + 3 * tenth]


@pytest.mark.parametrize("apart", [-3600 * SECOND, 3600 * SECOND, 2 * SECOND])
def test_a_sender_with_another_clock_is_set_right(tmp_path: Path, apart: int, caplog: pytest.LogCaptureFixture) -> None:
    received = times(3)
    with caplog.at_level(logging.WARNING):
        assert stamps_of(tmp_path / "bag", [stamp + apart for stamp in received]) == received
    assert len([record for record in caplog.records if "clock" in record.message]) == 1


def test_a_delay_of_the_transport_is_no_other_clock(tmp_path: Path) -> None:
    stamps = [stamp - SECOND // 2 for stamp in times(3)]
    assert stamps_of(tmp_path / "bag", stamps) == stamps


YEAR = 365 * 24 * 3600 * SECOND


def test_stamps_that_leap_into_the_future_are_not_followed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    received = times(6)
    stamps = [stamp + (YEAR if index in (2, 4, 5) else 0) for index, stamp in enumerate(received)]
    with caplog.at_level(logging.WARNING):
        assert stamps_of(tmp_path / "bag", stamps) == received
    assert [record.message for record in caplog.records if "in the future" in record.message]


@pytest.mark.parametrize(("senders_too", "tenths"), [(True, [0, 1, 2, 2, 3, 4, 4, 5, 6]), (False, [*range(9)])])
def test_time_goes_on_where_the_clock_of_a_bag_leaps(
    tmp_path: Path, senders_too: bool, tenths: list[int], caplog: pytest.LogCaptureFixture
) -> None:
    """As when a robot without a clock of its own begins in 1970 and then hears of NTP."""
    tenth, leaps = SECOND // 10, [index // 3 * YEAR for index in range(9)]
    pictures = [
        (RAW, time + leap, picture(time + leap if senders_too else time))
        for time, leap in zip(times(9), leaps, strict=True)
    ]
    with caplog.at_level(logging.WARNING):
        found = [message.stamp for _, message in contents(make_with_rosbags(tmp_path / "bag", pictures))]
    assert [round((stamp - START) / tenth) for stamp in found] == tenths
    assert len([record for record in caplog.records if "leaps ahead" in record.message]) == 2


def test_an_hour_without_a_message_is_no_leap(tmp_path: Path) -> None:
    received = [START, START + 3599 * SECOND]
    bag = make_with_rosbags(tmp_path / "bag", [(RAW, time, picture(time)) for time in received])
    assert [message.stamp for _, message in contents(bag)] == received


def test_a_single_stamp_that_goes_back_does_not_spoil_the_others(tmp_path: Path) -> None:
    tenth, begin = SECOND // 10, times(1)[0]
    stamps = [begin + stamp for stamp in (1 * tenth, 2 * tenth, 2 * tenth - 1, 4 * tenth, 4 * tenth)]
    found = [stamp - begin for stamp in stamps_of(tmp_path / "bag", stamps)]
    assert found == [1 * tenth, 2 * tenth, 3 * tenth, 4 * tenth, 4 * tenth]


# Topics


def test_the_only_image_topic_is_chosen(tmp_path: Path) -> None:
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


def test_a_bag_without_pictures(tmp_path: Path) -> None:
    path = make_with_rosbags(tmp_path / "bag", [(SAY, START, Utterance(stamp=1, id="u", text="x"))])
    with open_bag(path) as bag, pytest.raises(BagError, match="no pictures") as caught:
        bag.choose_image_topic()
    assert SAY in str(caught.value.remedy)


def test_camera_info_stands_in_the_namespace_of_the_pictures(tmp_path: Path) -> None:
    with open_bag(make(tmp_path / "bag")) as bag:
        for name in (RAW, f"{RAW}/compressed"):
            info = bag.camera_info_topic_for(name)
            assert info is not None
            assert info.name == INFO
        assert bag.camera_info_topic_for("/other/image_raw") is None


def test_topics_that_the_bag_lacks_or_nobody_understands(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        writer.write_raw("/imu", "sensor_msgs/msg/Imu", bytes(8), 1)
        writer.write_raw("/odd", "nobody_msgs/msg/Thing", b"\0\1\0\0abcd", 1)
    with open_bag(path) as bag:
        for read in (bag.messages, bag.raw_messages):
            with pytest.raises(BagError, match="no topic '/imus'"):
                read({"/imus": "/imu"})
        for name, kind in (("/imu", "sensor_msgs/msg/Imu"), ("/odd", "nobody_msgs/msg/Thing")):
            with pytest.raises(BagError, match=kind):
                bag.messages({name: name})
        assert list(bag.raw_messages({"/odd": "/odd"})) == [("/odd", 1, "nobody_msgs/msg/Thing", b"\0\1\0\0abcd")]


# Damage


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


def test_a_truncated_mcap_file_is_read_as_far_as_it_is_whole(tmp_path: Path) -> None:
    data = (make(tmp_path / "bag", count=24, size=(360, 480)) / "bag.mcap").read_bytes()
    expected = [message.stamp for _, message in contents(tmp_path / "bag", RAW)]
    file = tmp_path / "cut.mcap"
    lengths = []
    for part in (0.2, 0.4, 0.6, 0.8, 0.97):
        file.write_bytes(data[: int(len(data) * part)])
        with open_bag(file) as bag:
            found = [message.stamp for _, message in bag.messages({RAW: RAW})]
            assert bag.topic(RAW).count == len(found)
            assert "breaks off" in bag.damage[0]
        assert found == expected[: len(found)]
        lengths.append(len(found))
    assert lengths == sorted(set(lengths))
    assert lengths[0] > 0


def test_a_cut_through_the_index_costs_no_picture(tmp_path: Path) -> None:
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


def test_a_recording_that_was_killed_is_read_without_metadata(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
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


def test_whole_messages_come_before_the_break(tmp_path: Path) -> None:
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


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("nothing", None, "no such file"),
        ("folder/", None, "the folder is no bag"),
        ("film.mp4", b"x", "not a bag: .mp4"),
        ("bag", b"x", "not a bag: no suffix"),
        ("empty.mcap", b"", "empty"),
        ("empty.db3", b"", "tables"),
        ("empty.bag", b"", "empty"),
        ("text.mcap", b"hello world" * 100, "magic"),
        ("text.db3", b"hello world" * 100, "not a database"),
        ("text.bag", b"hello world" * 100, "magic"),
    ],
)
def test_what_is_no_bag(tmp_path: Path, name: str, content: bytes | None, complaint: str) -> None:
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
def test_a_folder_with_useless_metadata_is_read_by_its_files(tmp_path: Path, text: str) -> None:
    path = make(tmp_path / "bag")
    (path / "metadata.yaml").write_text(text)
    check_pictures(path)
    (path / "bag.mcap").unlink()
    with pytest.raises(BagError, match="damaged"):
        open_bag(path)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_without_messages(tmp_path: Path, storage: str) -> None:
    with BagWriter(tmp_path / "bag", storage=storage):
        pass
    with pytest.raises(BagError, match="no messages"):
        open_bag(tmp_path / "bag")


# Writing


def test_an_existing_path_is_left_alone(tmp_path: Path) -> None:
    path = make(tmp_path / "bag")
    with pytest.raises(BagError, match="already exists") as caught:
        BagWriter(path)
    assert "another name" in str(caught.value.remedy)
    check_pictures(path)


def test_an_unknown_storage(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="no storage 'mcaps'") as caught:
        BagWriter(tmp_path / "bag", storage="mcaps")
    assert "did you mean 'mcap'" in str(caught.value.remedy)


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="cannot be written"), BagWriter(tmp_path / "file" / "bag"):
        pass


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("interruption", [KeyboardInterrupt, ValueError, SystemExit])
def test_the_bag_can_be_read_however_writing_ended(
    tmp_path: Path, storage: str, interruption: type[BaseException]
) -> None:
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
def test_a_topic_without_a_name_or_a_type_is_damage(tmp_path: Path, column: str) -> None:
    path = make(tmp_path / "bag", storage="sqlite3") / "bag.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE others AS SELECT * FROM topics")
        database.execute("DROP TABLE topics")
        database.execute("ALTER TABLE others RENAME TO topics")
        database.execute(f"UPDATE topics SET {column} = NULL WHERE id = 1")
    with pytest.raises(BagError, match="damaged"):
        open_bag(path)


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
        assert "damaged" in bag.damage[0]
    check_pictures(path)
