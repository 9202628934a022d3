"""Repair of damaged bags: truncated MCAP files, and wrong clocks."""

from __future__ import annotations

import logging
import struct
import tracemalloc
from pathlib import Path

import pytest

from socialbot.bags.repair import MAGIC, clock_offsets, salvage
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message, Transform, Transforms
from tests.bags.making_bags import RAW, START, contents, make_with_rosbags, picture, times

CHUNK = 6


def test_wrong_length_allocates_no_memory(tmp_path: Path) -> None:
    times, size, checksum, name_length = bytes(16), bytes(8), bytes(4), b"\xff\xff\xff\xff"
    chunk = times + size + checksum + name_length + b"zstd" + bytes(8)
    file = tmp_path / "lies.mcap"
    file.write_bytes(MAGIC + struct.pack("<BQ", CHUNK, len(chunk)) + chunk)
    tracemalloc.start()
    try:
        assert salvage(file) is None
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1 << 20


def stamps_of(path: Path, stamps: list[int]) -> list[int]:
    """Return the repaired header stamps."""
    bag = make_with_rosbags(
        path, [(RAW, time, picture(stamp)) for time, stamp in zip(times(len(stamps)), stamps, strict=True)]
    )
    return [message.stamp for _, message in contents(bag)]


def test_zero_stamps_become_the_time_of_reception(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        assert stamps_of(tmp_path / "bag", [0, 0, 0]) == times(3)
    assert len([record for record in caplog.records if "zero" in record.message]) == 1


def test_stamps_that_go_backwards_continue_with_the_time_of_reception(tmp_path: Path) -> None:
    tenth, begin = SECOND // 10, times(1)[0]
    found = stamps_of(tmp_path / "bag", [begin + 50, begin + 51, begin + 7, begin + 8, 0])
    assert [stamp - begin for stamp in found] == [50, 51, 51 + tenth, 51 + 2 * tenth, 51 + 3 * tenth]


@pytest.mark.parametrize("apart", [-3600 * SECOND, 3600 * SECOND, 2 * SECOND])
def test_clock_offset_of_the_sender_is_corrected(tmp_path: Path, apart: int, caplog: pytest.LogCaptureFixture) -> None:
    received = times(3)
    with caplog.at_level(logging.WARNING):
        assert stamps_of(tmp_path / "bag", [stamp + apart for stamp in received]) == received
    assert len([record for record in caplog.records if "clock" in record.message]) == 1


@pytest.mark.parametrize("lag_ms", [500, 999, 1001, 1400, 4000])
def test_lag_of_processing_is_not_corrected(tmp_path: Path, lag_ms: int, caplog: pytest.LogCaptureFixture) -> None:
    stamps = [stamp - lag_ms * 1_000_000 for stamp in times(3)]
    assert stamps_of(tmp_path / "bag", stamps) == stamps
    assert not caplog.records


def test_sensors_of_one_machine_have_one_clock() -> None:
    lags = {"/info": 0.05, "/rgb": 1.0, "/depth": 1.4, "/scan": 5.2, "/lab": 40.0, "/lab/depth": 41.0, "/ahead": -7.5}
    offsets = clock_offsets({topic: round(lag * SECOND) for topic, lag in lags.items()})
    expected = {"/lab": 40.0, "/lab/depth": 40.0, "/ahead": -7.5}
    assert offsets == {topic: round(expected.get(topic, 0) * SECOND) for topic in lags}


def test_wrong_clock_leaves_colour_and_depth_synchronous(tmp_path: Path) -> None:
    """The stamps of one instant stay equal, although the two images arrive with different lags."""
    wrong, depth = 3600 * SECOND, "/camera/depth/image_raw"
    images = [
        (topic, time + lag, picture(time - wrong))
        for time in times(4)
        for topic, lag in ((RAW, 10**9), (depth, 14 * 10**8))
    ]
    bag = make_with_rosbags(tmp_path / "bag", sorted(images, key=lambda each: each[1]))
    found = contents(bag, RAW, depth)
    expected = [time + 10**9 for time in times(4)]
    assert [message.stamp for topic, message in found if topic == RAW] == expected
    assert [message.stamp for topic, message in found if topic == depth] == expected
    assert [message.stamp for _, message in contents(bag, depth)] == expected, "also if it is read alone"


def test_images_have_different_stamps(tmp_path: Path) -> None:
    begin, tenth = times(1)[0], SECOND // 10
    assert stamps_of(tmp_path / "bag", [begin] * 4) == [begin + index * tenth for index in range(4)]


YEAR = 365 * 24 * 3600 * SECOND


def test_stamps_in_the_future_are_replaced(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    received = times(6)
    stamps = [stamp + (YEAR if index in (2, 4, 5) else 0) for index, stamp in enumerate(received)]
    with caplog.at_level(logging.WARNING):
        assert stamps_of(tmp_path / "bag", stamps) == received
    assert [record.message for record in caplog.records if "in the future" in record.message]


@pytest.mark.parametrize(("senders_too", "tenths"), [(True, [0, 1, 2, 2, 3, 4, 4, 5, 6]), (False, [*range(9)])])
def test_leaps_of_the_recording_clock_are_removed(
    tmp_path: Path, senders_too: bool, tenths: list[int], caplog: pytest.LogCaptureFixture
) -> None:
    """As for a robot without a battery-backed clock that starts in 1970 and then synchronises by NTP."""
    tenth, leaps = SECOND // 10, [index // 3 * YEAR for index in range(9)]
    pictures = [
        (RAW, time + leap, picture(time + leap if senders_too else time))
        for time, leap in zip(times(9), leaps, strict=True)
    ]
    with caplog.at_level(logging.WARNING):
        found = [message.stamp for _, message in contents(make_with_rosbags(tmp_path / "bag", pictures))]
    assert [round((stamp - START) / tenth) for stamp in found] == tenths
    assert len([record for record in caplog.records if "leaps ahead" in record.message]) == 2


def test_hour_without_a_message_is_no_leap(tmp_path: Path) -> None:
    received = [START, START + 3599 * SECOND]
    bag = make_with_rosbags(tmp_path / "bag", [(RAW, time, picture(time)) for time in received])
    assert [message.stamp for _, message in contents(bag)] == received


def test_single_backward_stamp_does_not_affect_others(tmp_path: Path) -> None:
    tenth, begin = SECOND // 10, times(1)[0]
    stamps = [begin + stamp for stamp in (1 * tenth, 2 * tenth, 2 * tenth - 1, 4 * tenth, 4 * tenth)]
    found = [stamp - begin for stamp in stamps_of(tmp_path / "bag", stamps)]
    assert found == [1 * tenth, 2 * tenth, 3 * tenth, 4 * tenth, 5 * tenth]


def transforms_at(stamp: int, frame: str = "camera") -> Transforms:
    turn = Transform(
        stamp=stamp, parent="base_link", child=frame, translation=(0.0, 0.0, 1.2), rotation=(0.0, 0.0, 0.0, 1.0)
    )
    return Transforms(stamp=stamp, transforms=(turn,))


@pytest.mark.parametrize("apart_s", [0, 3600, -3600, 3, -8, -1_600_000_000])
def test_transforms_stay_on_the_clock_of_the_images(tmp_path: Path, apart_s: int) -> None:
    received, apart = times(20), apart_s * SECOND
    mixed: list[tuple[str, int, Message | bytes]] = [(RAW, time, picture(time + apart)) for time in received]
    mixed += [("/tf", time + 1, transforms_at(time + apart)) for time in received]
    bag = make_with_rosbags(tmp_path / "bag", sorted(mixed, key=lambda each: each[1]))
    turns = [each.transforms[0].stamp for _, each in contents(bag, "/tf", RAW) if isinstance(each, Transforms)]
    assert turns == [message.stamp for _, message in contents(bag, RAW)] == received


@pytest.mark.parametrize("leap_s", [-3600, -5, 3600])
def test_transforms_follow_a_clock_that_is_set_while_recording(tmp_path: Path, leap_s: int) -> None:
    received = times(20)
    stamps = [time + (leap_s * SECOND if index >= 10 else 0) for index, time in enumerate(received)]
    mixed: list[tuple[str, int, Message | bytes]] = []
    for time, stamp in zip(received, stamps, strict=True):
        mixed += [(RAW, time, picture(stamp)), ("/tf", time, transforms_at(stamp))]
    bag = make_with_rosbags(tmp_path / "bag", mixed)
    turns = [each.transforms[0].stamp for _, each in contents(bag, "/tf", RAW) if isinstance(each, Transforms)]
    assert turns == [message.stamp for _, message in contents(bag, RAW)] == received


def test_transforms_of_several_publishers_keep_their_stamps(tmp_path: Path) -> None:
    """One states the pose of a second ago, another that of the near future; static ones have any stamp."""
    mixed: list[tuple[str, int, Message | bytes]] = []
    expected: list[int] = []
    for time in times(20):
        stamps = [time, time - 9 * SECOND // 10, time + 9 * SECOND // 10 - SECOND // 2]
        mixed += [("/tf", time, transforms_at(stamp, f"frame{index}")) for index, stamp in enumerate(stamps)]
        mixed += [("/tf_static", time, transforms_at(5, "fixed")), (RAW, time, picture(time))]
        expected += stamps
    found = contents(make_with_rosbags(tmp_path / "bag", mixed), "/tf", "/tf_static")
    turns = {name: [each.transforms[0].stamp for topic, each in found if isinstance(each, Transforms) if topic == name]
             for name in ("/tf", "/tf_static")}  # fmt: skip
    assert turns == {"/tf": expected, "/tf_static": [5] * 20}
