"""Guards of processes, which a library may block without end while it keeps Python's lock."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from socialbot.core._process_guard import STARVED_LIMITS, Guard
from tests.system.running import eventually, is_alive

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="guards need Linux")

BEGIN = """
import ctypes, os, signal, subprocess, sys, time
from socialbot.core.process import Ending
from socialbot.core.process_guard import guard_child, guarded, report_alive

def keep_the_lock():
    mutex, lock = ctypes.create_string_buffer(64), ctypes.PyDLL(None).pthread_mutex_lock
    lock(mutex)
    lock(mutex)  # a deadlock, which signals do not end

def say(*words):
    print(*words, flush=True)
"""


class Guarded:
    """A process with a guard, which runs a program."""

    def __init__(self, program: str, folder: Path) -> None:
        self._output, self._errors = folder / "output", folder / "errors"
        with self._output.open("w") as output, self._errors.open("w") as errors:
            command = [sys.executable, "-c", BEGIN + program]
            self.process = subprocess.Popen(command, stdout=output, stderr=errors, stdin=subprocess.DEVNULL)
        assert eventually(lambda: "ready" in self.output), self.errors

    @property
    def output(self) -> str:
        return self._output.read_text()

    @property
    def errors(self) -> str:
        return self._errors.read_text()

    def guards(self) -> list[int]:
        found: list[int] = []
        for each in psutil.Process(self.process.pid).children():
            with suppress(psutil.Error):  # it has ended
                if is_alive(each.pid) and "_process_guard.py" in " ".join(each.cmdline()):
                    found.append(each.pid)
        return found


@pytest.fixture
def started(tmp_path: Path) -> Iterator[list[Guarded]]:
    """Started processes, which end with the test."""
    processes: list[Guarded] = []
    yield processes
    for each in processes:
        each.process.kill()
        each.process.wait()


def start(program: str, folder: Path, started: list[Guarded]) -> Guarded:
    started.append(Guarded(program, folder))
    return started[-1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_blocked_process_ends_after_a_signal(tmp_path: Path, started: list[Guarded], number: signal.Signals) -> None:
    program = """
with guarded(end_s=0.5), Ending().on_signals():
    say("ready")
    keep_the_lock()
"""
    blocked = start(program, tmp_path, started)
    (guard,) = blocked.guards()
    blocked.process.send_signal(number)
    assert eventually(lambda: blocked.process.poll() is not None)
    assert blocked.process.returncode in (-signal.SIGQUIT, -signal.SIGKILL)
    assert f"process {blocked.process.pid} did not end within 0.5 s after a signal and is killed" in blocked.errors
    assert "in keep_the_lock" in blocked.errors
    assert eventually(lambda: not is_alive(guard))


def test_a_crash_of_native_code_writes_the_stacks(tmp_path: Path, started: list[Guarded]) -> None:
    program = """
def call_native_code():
    os.kill(os.getpid(), signal.SIGSEGV)
with guarded():
    say("ready")
    call_native_code()
"""
    crashed = start(program, tmp_path, started)
    assert eventually(lambda: crashed.process.poll() is not None)
    assert crashed.process.returncode == -signal.SIGSEGV
    assert "Segmentation fault" in crashed.errors
    assert "in call_native_code" in crashed.errors


@pytest.mark.slow
def test_a_process_that_waits_for_a_processor_is_not_hung(tmp_path: Path, started: list[Guarded]) -> None:
    program = """
def waited_s():
    return int(open("/proc/self/schedstat").read().split()[1]) / 1e9

os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])
with guarded(hung_s=1.0, children_s=0.0):
    others = [subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]) for _ in range(5)]
    for other in others:
        guard_child(other.pid)
    report_alive()
    say("ready")
    before = waited_s()
    while waited_s() < before + 3:
        pass
    for other in others:
        other.kill()
say("done")
"""
    starved = start(program, tmp_path, started)
    assert eventually(lambda: starved.process.poll() is not None)
    assert "done" in starved.output, starved.errors


@pytest.mark.parametrize("message", [b"alive", bytes([signal.SIGTERM])], ids=["hung", "ending"])
def test_waits_for_a_processor_do_not_count(tmp_path: Path, message: bytes) -> None:
    """Up to a limit, else a guard would never kill a process on a busy machine."""
    task = tmp_path / str(os.getpid()) / "task" / "1"
    task.mkdir(parents=True)
    waited_s = 5.0

    def passes(waits: float) -> bool:
        """Let half a second pass, with this part of it in a queue; return whether the process is well."""
        nonlocal waited_s
        waited_s += 0.5 * waits
        (task / "schedstat").write_text(f"1 {waited_s * 1e9:.0f} 1")
        guard.count(0.5)
        return not guard.reason()

    guard = Guard(os.getpid(), 1.0, 1.0, 0.0, proc=str(tmp_path))
    assert passes(0.0)
    guard.note(message)
    limits = [passes(1.0) for _ in range(2 * STARVED_LIMITS + 1)]
    assert limits == [*(2 * STARVED_LIMITS * [True]), False]
    guard = Guard(os.getpid(), 1.0, 1.0, 0.0, proc=str(tmp_path))
    assert passes(0.0)
    guard.note(message)
    assert [passes(0.0), passes(0.0), passes(0.0)] == [True, True, False]


def test_a_process_that_ends_needs_no_guard(tmp_path: Path, started: list[Guarded]) -> None:
    program = """
with guarded(end_s=0.5), Ending().on_signals() as ending:
    say("ready")
    while not ending.asked:
        time.sleep(0.01)
say("left")
time.sleep(1.5)
sys.exit(3)
"""
    well = start(program, tmp_path, started)
    (guard,) = well.guards()
    well.process.send_signal(signal.SIGTERM)
    assert eventually(lambda: "left" in well.output)
    assert not is_alive(guard)
    assert well.process.wait(60) == 3
    assert well.errors == ""


def test_signs_of_life_extend_the_time_after_a_signal(tmp_path: Path, started: list[Guarded]) -> None:
    program = """
from socialbot.core import process_guard
process_guard.ALIVE_PERIOD_S = 0.0
with guarded(end_s=1.5), Ending().on_signals() as ending:
    say("ready")
    while not ending.asked:
        time.sleep(0.01)
    for _ in range(30):
        time.sleep(0.1)
        report_alive()
    say("left")
    time.sleep(60)
"""
    slow = start(program, tmp_path, started)
    slow.process.send_signal(signal.SIGTERM)
    assert eventually(lambda: slow.process.poll() is not None)
    assert "left" in slow.output


def test_a_hung_process_is_killed(tmp_path: Path, started: list[Guarded]) -> None:
    program = """
with guarded(hung_s=1.0):
    say("ready")
    time.sleep(1.5)
    say("unmoved before its first sign of life")
    report_alive()
    keep_the_lock()
"""
    hung = start(program, tmp_path, started)
    assert eventually(lambda: hung.process.poll() is not None)
    assert "unmoved" in hung.output
    assert f"process {hung.process.pid} hung for 1 s and is killed" in hung.errors


def test_a_stopped_process_is_not_hung(tmp_path: Path, started: list[Guarded]) -> None:
    program = """
with guarded(hung_s=1.5):
    say("ready")
    while True:
        report_alive()
        time.sleep(0.05)
"""
    stopped = start(program, tmp_path, started)
    stopped.process.send_signal(signal.SIGSTOP)
    with pytest.raises(subprocess.TimeoutExpired):
        stopped.process.wait(3.0)
    stopped.process.send_signal(signal.SIGCONT)
    with pytest.raises(subprocess.TimeoutExpired):
        stopped.process.wait(3.0)


def test_children_that_outlive_a_killed_process_are_killed(tmp_path: Path, started: list[Guarded]) -> None:
    program = """
own, foreign = (subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"]) for _ in range(2))
with guarded(children_s=0.5):
    guard_child(own.pid)
    say("ready", own.pid, foreign.pid)
    keep_the_lock()
"""
    parent = start(program, tmp_path, started)
    own, foreign = map(int, parent.output.split()[1:])
    try:
        parent.process.kill()
        assert eventually(lambda: not is_alive(own))
        assert is_alive(foreign)
    finally:
        psutil.Process(foreign).kill()


def test_one_guard_is_enough(tmp_path: Path, started: list[Guarded]) -> None:
    program = """
with guarded(), guarded():
    say("ready")
    time.sleep(600)
"""
    assert len(start(program, tmp_path, started).guards()) == 1


def test_a_killed_guard_is_replaced(tmp_path: Path, started: list[Guarded]) -> None:
    program = """
from pathlib import Path
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
with guarded(end_s=0.5, children_s=0.5), Ending().on_signals() as ending:
    guard_child(child.pid)
    say("ready", child.pid)
    while not ending.asked:
        report_alive()
        time.sleep(0.05)
    keep_the_lock()
"""
    process = start(program, tmp_path, started)
    (first,) = process.guards()
    psutil.Process(first).kill()
    assert eventually(lambda: process.guards() not in ([], [first]))
    process.process.send_signal(signal.SIGTERM)
    assert eventually(lambda: process.process.poll() is not None)
    child = int(process.output.split()[1])
    assert eventually(lambda: not is_alive(child))
    assert "Traceback" not in process.errors
