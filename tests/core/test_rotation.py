"""Logs of bounded length."""

from __future__ import annotations

import os
from pathlib import Path

from socialbot.core.bounded_log import Rotation


def test_a_long_log_is_rotated_while_its_writer_continues(tmp_path: Path) -> None:
    log = tmp_path / "head.log"
    rotation = Rotation(longest=10, kept=2)
    with log.open("ab", buffering=0) as writer:
        for number in range(4):
            writer.write(b"%d" % number * 11)
            assert rotation.rotate(log)
        writer.write(b"end")
    assert not rotation.rotate(log)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        "head.log": "end",
        "head.log.1": "3" * 11,
        "head.log.2": "2" * 11,
    }


def test_a_log_that_is_not_there_is_none_to_rotate(tmp_path: Path) -> None:
    assert not Rotation().rotate(tmp_path / "head.log")


def test_of_the_logs_of_ros_the_latest_are_kept(tmp_path: Path) -> None:
    for number in range(5):
        path = tmp_path / f"{number}.log"
        path.write_text("x" * 20 * (number == 4))
        os.utime(path, (number, number))
    Rotation(longest=10, kept=0, most=2).rotate_all([], tmp_path)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"3.log": "", "4.log": ""}
