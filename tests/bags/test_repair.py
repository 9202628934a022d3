"""Repair of damaged bags: truncated MCAP files, and wrong clocks."""

from __future__ import annotations

import logging
import struct
import tracemalloc
from pathlib import Path

import pytest

from socialbot.bags.repair import MAGIC, salvage
from socialbot.core.clock import SECOND
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
    """What becomes of ``stamps``, as they are in the headers."""
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


def test_transport_delay_is_not_corrected(tmp_path: Path) -> None:
    stamps = [stamp - SECOND // 2 for stamp in times(3)]
    assert stamps_of(tmp_path / "bag", stamps) == stamps


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


def test_hour_without_a_message_is_no_leap(tmp_path: Path) -> None:
    received = [START, START + 3599 * SECOND]
    bag = make_with_rosbags(tmp_path / "bag", [(RAW, time, picture(time)) for time in received])
    assert [message.stamp for _, message in contents(bag)] == received


def test_single_backward_stamp_does_not_affect_others(tmp_path: Path) -> None:
    tenth, begin = SECOND // 10, times(1)[0]
    stamps = [begin + stamp for stamp in (1 * tenth, 2 * tenth, 2 * tenth - 1, 4 * tenth, 4 * tenth)]
    found = [stamp - begin for stamp in stamps_of(tmp_path / "bag", stamps)]
    assert found == [1 * tenth, 2 * tenth, 3 * tenth, 4 * tenth, 4 * tenth]
