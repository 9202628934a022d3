"""Lines on disk that do not fill it."""

from __future__ import annotations

import os
import resource
import shutil
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from socialbot.core.bounded_log import PARTS, RETRY_S, BoundedLog, LossyLog, Rotation, is_whole, parts


def lines(path) -> list[bytes]:
    return [line for part in parts(path) for line in part.read_bytes().splitlines()]


def test_without_a_limit_it_is_one_file(tmp_path):
    journal = BoundedLog(tmp_path / "j")
    for number in range(1000):
        journal.write(b"%d" % number)
    assert parts(tmp_path / "j") == [tmp_path / "j"]
    assert lines(tmp_path / "j") == [b"%d" % number for number in range(1000)]
    assert journal.size == (tmp_path / "j").stat().st_size
    assert is_whole(tmp_path / "j")


def test_the_newest_lines_are_kept_in_order_and_in_the_room_there_is(tmp_path):
    path, room = tmp_path / "j", 4000
    journal = BoundedLog(path, room)
    for number in range(2000):
        journal.write(b"line %06d" % number)
        assert sum(part.stat().st_size for part in tmp_path.iterdir()) == journal.size <= room + PARTS * 12
    kept = lines(path)
    assert kept == [b"line %06d" % number for number in range(2000 - len(kept), 2000)]
    assert len(kept) * 12 > room * (PARTS - 1) / PARTS - 12
    assert not is_whole(path)


def test_it_is_complete_until_a_part_was_dropped(tmp_path):
    journal = BoundedLog(tmp_path / "j", 400)
    for number in range(20):
        journal.write(b"line %06d" % number)
    assert len(parts(tmp_path / "j")) > 1
    assert is_whole(tmp_path / "j")
    assert len(lines(tmp_path / "j")) == 20


def test_each_part_starts_with_the_one_time_records(tmp_path):
    journal = BoundedLog(tmp_path / "j", 400, lambda: [b"opening"])
    for number in range(20):
        journal.write(b"line %06d" % number)
    assert [part.read_bytes().splitlines()[0] == b"opening" for part in parts(tmp_path / "j")] == [False, True, True]


def test_files_beside_it_that_are_none_of_its_parts_are_left_alone(tmp_path):
    for name in ("j.old", "j.٣", "j.0", "other.1"):
        (tmp_path / name).write_text("mine\n")
    journal = BoundedLog(tmp_path / "j", 100)
    for number in range(100):
        journal.write(b"line %06d" % number)
    assert len(parts(tmp_path / "j")) == PARTS
    assert all((tmp_path / name).read_text() == "mine\n" for name in ("j.old", "j.٣", "j.0", "other.1"))


def test_existing_files_are_not_overwritten(tmp_path):
    (tmp_path / "j").write_text("mine")
    with pytest.raises(FileExistsError):
        BoundedLog(tmp_path / "j")


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """The system refuses to write more to a file, as to a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_line_is_written_whole_or_not_at_all(tmp_path):
    log = BoundedLog(tmp_path / "j")
    log.write(b"first")
    with files_of_at_most(50), pytest.raises(OSError, match="File too large"):
        log.write(b"x" * 100)
    log.write(b"last")
    assert lines(tmp_path / "j") == [b"first", b"last"]


def test_lines_are_counted_while_the_disk_is_full_and_written_again_later(tmp_path):
    now = [100.0]
    log = LossyLog(BoundedLog(tmp_path / "j"), steady_s=lambda: now[0])
    log.write(b"first")
    with files_of_at_most(50):
        for _ in range(3):
            log.write(b"x" * 100)
        assert (log.problem, log.lost) == ("File too large", 3)
    log.write(b"too soon")
    assert log.lost == 4
    now[0] += RETRY_S
    log.write(b"last")
    assert (log.problem, log.lost) == ("", 4)
    assert lines(tmp_path / "j") == [b"first", b"last"]


def test_a_removed_folder_is_made_again(tmp_path):
    now = [100.0]
    log = LossyLog(_log_in(tmp_path), lambda: now[0])
    log.write(b"first")
    shutil.rmtree(tmp_path / "run")
    now[0] += RETRY_S
    log.write(b"second")
    assert lines(tmp_path / "run" / "j") == [b"opening", b"second"]
    assert (log.problem, log.lost) == ("", 0)


def _log_in(folder):
    (folder / "run").mkdir()
    return BoundedLog(folder / "run" / "j", opening=lambda: [b"opening"])


def test_a_folder_removed_when_a_part_is_full_is_made_again(tmp_path):
    path, now = tmp_path / "run" / "j", [0.0]
    path.parent.mkdir()
    log = LossyLog(BoundedLog(path, 400), steady_s=lambda: now[0])
    for number in range(9):
        log.write(b"line %06d" % number)
    shutil.rmtree(path.parent)
    log.write(b"the part is full")  # nothing looks at the folder so soon again
    assert (log.lost, bool(log.problem)) == (1, True)
    now[0] += RETRY_S
    log.write(b"after")
    assert lines(path) == [b"after"]
    log.restore()
    log.close()


def test_a_part_that_cannot_begin_loses_no_line_before_it(tmp_path, monkeypatch):
    path, can_open = tmp_path / "j", Path.open

    def cannot_open(self: Path, *args, **kwargs):
        raise OSError(30, "Read-only file system", str(self))

    now = [0.0]
    log = LossyLog(BoundedLog(path, 400), steady_s=lambda: now[0])
    for number in range(9):
        log.write(b"line %06d" % number)
    monkeypatch.setattr(Path, "open", cannot_open)
    log.write(b"lost")
    now[0] += RETRY_S
    log.write(b"lost again")
    monkeypatch.setattr(Path, "open", can_open)
    log.restore()
    now[0] += RETRY_S
    for number in range(9, 20):
        log.write(b"line %06d" % number)
    assert log.lost == 2
    assert lines(path) == [b"line %06d" % number for number in range(20)]


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


def test_the_parts_of_a_private_log_are_private(tmp_path: Path) -> None:
    log = tmp_path / "head.log"
    for _ in range(3):
        log.write_text("a line\n")
        log.chmod(0o600)
        Rotation(longest=1, kept=1).rotate(log)
    assert {path.name: path.stat().st_mode & 0o777 for path in tmp_path.iterdir()} == {
        "head.log": 0o600,
        "head.log.1": 0o600,
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


def test_threads_may_write_while_another_one_looks_for_a_removed_file(tmp_path: Path) -> None:
    """The record of a live run: its folder is removed while one thread writes and another one checks it."""
    path = tmp_path / "run" / "j"
    path.parent.mkdir()
    log, interval = LossyLog(BoundedLog(path, 400)), sys.getswitchinterval()
    ended, errors = threading.Event(), []

    def check() -> None:
        try:
            while not ended.is_set():
                log.restore()
        except Exception as error:  # noqa: BLE001 - the test asserts that there is none
            errors.append(error)

    checker = threading.Thread(target=check)
    sys.setswitchinterval(1e-6)
    try:
        checker.start()
        for number in range(6000):
            if number % 100 == 0:
                shutil.rmtree(path.parent, ignore_errors=True)  # the file may come again meanwhile
            log.write(b"line %06d" % number)
    finally:
        sys.setswitchinterval(interval)
        ended.set()
        checker.join()
    assert errors == []
    log.restore()
    log.write(b"last")
    assert lines(path)[-1] == b"last"


def test_after_its_folder_was_moved_a_new_file_begins_in_its_place(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    journal = LossyLog(BoundedLog(folder / "j", 400, lambda: [b"opening"]), lambda: 0.0)
    journal.write(b"line 000001")
    folder.rename(tmp_path / "moved")
    journal.restore()
    for number in range(2, 20):
        journal.write(b"line %06d" % number)
    assert (journal.problem, journal.lost) == ("", 0)
    assert lines(tmp_path / "moved" / "j") == [b"line 000001"]
    assert [line for line in lines(folder / "j") if line != b"opening"] == [b"line %06d" % n for n in range(2, 20)]


def test_the_log_of_another_run_in_its_place_is_left_alone(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    journal = LossyLog(BoundedLog(folder / "j", 400))
    folder.rename(tmp_path / "moved")
    folder.mkdir()
    (folder / "j").write_bytes(b"of another run\n")
    for number in range(40):
        journal.write(b"line %06d" % number)
    assert (folder / "j").read_bytes() == b"of another run\n"
    assert journal.problem == "File exists"
    assert lines(tmp_path / "moved" / "j")[0] == b"line 000000"


def test_a_moved_folder_with_a_link_in_its_place_goes_on(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    journal = LossyLog(BoundedLog(folder / "j", 400))
    journal.write(b"before")
    folder.rename(tmp_path / "moved")
    folder.symlink_to(tmp_path / "moved")
    for number in range(30):
        journal.write(b"line %06d" % number)
    assert lines(tmp_path / "moved" / "j") == [b"before", *(b"line %06d" % number for number in range(30))]
