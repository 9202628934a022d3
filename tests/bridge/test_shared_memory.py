"""Segments of ended processes, and lost ports, of real processes too."""

from __future__ import annotations

import fcntl
import os
import pwd
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import sleep

import pytest
from rclpy.node import Node
from std_msgs.msg import String

from socialbot.bridge import shared_memory
from socialbot.bridge.environment import ros_context
from socialbot.bridge.shared_memory import (
    CHECK_S,
    LOST_CHECKS,
    SHARED,
    YOUNG_S,
    PortWatch,
    other_users,
    remove_stale,
    stale_locks,
)  # fmt: skip
from tests.system.running import eventually, next_line

DEAD, ALIVE, YOUNG = "0123456789abcdef", "fedcba9876543210", "00000000deadbeef"


def segment(folder: Path, name: str, age_s: float = YOUNG_S + 60) -> Path:
    (folder / f"fastrtps_{name}").write_bytes(bytes(5000))
    lock = folder / f"fastrtps_{name}_el"
    lock.touch()
    then = time.time() - age_s
    os.utime(lock, (then, then))
    return lock


def test_removes_only_stale_segments(tmp_path: Path) -> None:
    segment(tmp_path, DEAD)
    segment(tmp_path, YOUNG, age_s=0.0)
    port = segment(tmp_path, "port7411")
    notes = tmp_path / "notes_el"
    notes.touch()
    with segment(tmp_path, ALIVE).open("rb") as alive:
        fcntl.flock(alive, fcntl.LOCK_EX)
        assert remove_stale(tmp_path) == 1
        assert remove_stale(tmp_path) == 0
    assert port.exists()
    assert notes.exists()
    assert {path.name for path in tmp_path.glob("fastrtps_*")} == {
        f"fastrtps_{name}{end}" for name in (YOUNG, ALIVE, "port7411") for end in ("", "_el")
    }


def test_removes_stale_segments_of_before_the_clock_was_set_back(tmp_path: Path) -> None:
    segment(tmp_path, DEAD, age_s=-3600.0)
    segment(tmp_path, YOUNG, age_s=0.0)
    assert remove_stale(tmp_path) == 1
    assert {path.name for path in tmp_path.iterdir()} == {f"fastrtps_{YOUNG}", f"fastrtps_{YOUNG}_el"}


@pytest.mark.parametrize("offset_s", [-86400.0, 86400.0])
def test_age_of_a_segment_is_told_by_the_clock_of_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, offset_s: float
) -> None:
    segment(tmp_path, DEAD)
    segment(tmp_path, YOUNG, age_s=0.0)
    now = time.time()
    monkeypatch.setattr(shared_memory.time, "time", lambda: now + offset_s)
    assert [lock.name for lock in stale_locks(tmp_path)] == [f"fastrtps_{DEAD}_el"]


def test_removes_a_lock_without_a_segment(tmp_path: Path) -> None:
    segment(tmp_path, DEAD)
    (tmp_path / f"fastrtps_{DEAD}").unlink()
    assert remove_stale(tmp_path) == 1
    assert list(stale_locks(tmp_path)) == []


def test_nothing_is_stale_without_shared_memory(tmp_path: Path) -> None:
    assert remove_stale(tmp_path / "none") == 0


@pytest.mark.parametrize("look", [remove_stale, lambda folder: list(stale_locks(folder))])
def test_does_not_test_young_locks_and_ports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, look: Callable[[Path], object]
) -> None:
    tried: list[str] = []
    monkeypatch.setattr(shared_memory, "is_free", lambda path: bool(tried.append(path.name)))
    for name in ("port7400", "port7411", DEAD):
        segment(tmp_path, name)
    segment(tmp_path, YOUNG, age_s=0.0)
    look(tmp_path)
    assert tried == [f"fastrtps_{DEAD}_el"]


READER = """
import fcntl, mmap, sys
lock = open(sys.argv[1] + "_el", "w")
fcntl.flock(lock, fcntl.LOCK_EX)
for line in sys.stdin:
    file = open(sys.argv[1], "r+b")
    port = mmap.mmap(file.fileno(), 0)
    file.close()
    print("mapped", flush=True)
"""


@pytest.fixture
def port(tmp_path: Path) -> Path:
    return new_port(tmp_path / "fastrtps_port7411")


def new_port(file: Path) -> Path:
    """Replace a port, as those do who write to it."""
    beside = file.with_name("new")
    beside.write_bytes(bytes(5000))
    beside.rename(file)
    return file


@pytest.fixture
def reader(port: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that reads the port, and opens it again for each line that it gets."""
    command = [sys.executable, "-c", READER, str(port)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        open_port(process)
        yield process
        process.kill()


def open_port(reader: subprocess.Popen[str]) -> None:
    assert reader.stdin
    print("open", file=reader.stdin, flush=True)
    assert next_line(reader) == "mapped\n"


class Checks:
    """Checks of a `PortWatch`, one after the other."""

    def __init__(self, pid: int, folder: Path) -> None:
        self.now = 100.0
        self.watch = PortWatch(pid, lambda: self.now, folder)

    def __call__(self, *, runs: bool = True, after_s: float = CHECK_S) -> bool:
        self.now += after_s
        return self.watch.is_lost(self.now if runs else 100.0)


def test_a_port_whose_file_was_replaced_is_lost_until_its_reader_opens_the_new_one(
    reader: subprocess.Popen[str], port: Path
) -> None:
    checks = Checks(reader.pid, port.parent)
    assert [checks() for _ in range(5)] == [False] * 5
    new_port(port)
    assert [checks() for _ in range(LOST_CHECKS + 2)] == [False] * (LOST_CHECKS - 1) + [True] * 3
    open_port(reader)
    assert not checks()
    port.unlink()
    assert [checks() for _ in range(LOST_CHECKS)] == [False] * (LOST_CHECKS - 1) + [True]


def test_a_port_without_its_lock_file_is_lost_too(reader: subprocess.Popen[str], port: Path) -> None:
    port.with_name(f"{port.name}_el").unlink()
    checks = Checks(reader.pid, port.parent)
    assert [checks() for _ in range(5)] == [False] * 5
    new_port(port)
    assert [checks() for _ in range(LOST_CHECKS)] == [False] * (LOST_CHECKS - 1) + [True]


def test_a_paused_reader_has_lost_nothing(reader: subprocess.Popen[str], port: Path) -> None:
    """It opens the new file when it goes on."""
    checks = Checks(reader.pid, port.parent)
    checks()
    new_port(port)
    assert [checks(runs=False) for _ in range(20)] == [False] * 20


def test_quick_checks_count_once(reader: subprocess.Popen[str], port: Path) -> None:
    checks = Checks(reader.pid, port.parent)
    checks()
    new_port(port)
    assert [checks(after_s=CHECK_S / 100) for _ in range(90)] == [False] * 90


def test_processes_without_ports_have_lost_none(port: Path) -> None:
    own, ended = Checks(os.getpid(), port.parent), Checks(2**22 + 1, port.parent)
    assert not any(own() or ended() for _ in range(LOST_CHECKS + 1))


SUBSCRIBER = """
from socialbot.bridge.environment import prepare, ros_context
prepare()
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String
with ros_context() as context:
    node = Node("subscriber", context=context)
    node.create_subscription(String, "/words", lambda message: print("heard", message.data, flush=True), 10)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    executor.spin()
"""


@contextmanager
def subscriber() -> Iterator[tuple[subprocess.Popen[str], set[str]]]:
    """A process that hears words, and the words that it has heard."""
    heard: set[str] = set()
    with subprocess.Popen([sys.executable, "-c", SUBSCRIBER], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        lines = process.stdout
        reading = threading.Thread(target=lambda: heard.update(line.split()[-1] for line in lines))
        reading.start()
        yield process, heard
        process.kill()
        reading.join()


@contextmanager
def publisher(name: str) -> Iterator[Callable[[str], None]]:
    """Publishes words by a DDS participant of its own."""
    with ros_context() as context:
        node = Node(name, context=context, enable_rosout=False, start_parameter_services=False)
        words = node.create_publisher(String, "/words", 10)
        yield lambda word: words.publish(String(data=word))
        node.destroy_node()


@pytest.mark.ros
def test_a_new_publisher_does_not_reach_a_subscriber_whose_port_was_removed() -> None:
    with subscriber() as (process, heard), publisher("one") as say:
        assert eventually(lambda: say("before") or "before" in heard)
        checks = Checks(process.pid, SHARED)
        assert not any(checks() for _ in range(LOST_CHECKS))
        ports = list(checks.watch.ports)
        assert ports
        for port in ports:
            port.unlink()
        with publisher("other") as say_else:
            for _ in range(20):
                say_else("after")
                say("still")
                sleep(0.1)
        assert "after" not in heard
        assert [checks() for _ in range(LOST_CHECKS)][-1]


def test_other_users_of_a_domain_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("fastrtps_port7411", "fastrtps_port7661", "fastrtps_port7411_el", "fastrtps_0123456789abcdef"):
        (tmp_path / name).touch()
    assert other_users(0, tmp_path) == []
    monkeypatch.setattr(shared_memory.os, "getuid", lambda: os.geteuid() + 1)
    assert other_users(0, tmp_path) == other_users(1, tmp_path) == [pwd.getpwuid(os.geteuid()).pw_name]
    assert other_users(2, tmp_path) == []
