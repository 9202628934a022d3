from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from socialbot.core.process import with_parent
from socialbot.planning.planners.planner import MAX_OUTPUT, run
from tests.planning import busy
from tests.system.running import eventually, is_alive

pytestmark = busy.in_turn

SOON_S = 60.0
"""No test here takes as long, however busy the machine is."""


def shell(script: str, folder: Path, timeout_s: float = SOON_S, cancelled: threading.Event | None = None):
    return run(["/bin/sh", "-c", script], folder, timeout_s, cancelled or threading.Event())


def worker(seconds: float, folder: Path, timeout_s: float):
    """A child that needs so much of a processor, s."""
    code = f"import time\nwhile time.process_time() < {seconds}: pass"
    return run([sys.executable, "-I", "-S", "-c", code], folder, timeout_s, threading.Event())


def is_gone(pid: int) -> bool:
    return eventually(lambda: not is_alive(pid), SOON_S)


def test_output_and_exit_of_a_child_are_reported(tmp_path):
    ended = shell("echo yes; echo no >&2; pwd; exit 3", tmp_path)
    assert (ended.how, ended.code, ended.errors) == ("by itself", 3, "no\n")
    assert ended.output == f"yes\n{tmp_path}\n"
    assert ended.crash == "ended with code 3: no"


def test_a_signal_that_kills_it_is_named(tmp_path):
    assert shell("echo ouch >&2; kill -SEGV $$", tmp_path).crash == "was killed by SIGSEGV: ouch"


def test_much_output_is_read_to_its_end_and_too_much_is_cut_at_the_front(tmp_path):
    ended = shell(f"head -c {MAX_OUTPUT} /dev/zero | tr '\\0' x; echo; echo end", tmp_path)
    assert ended.how == "by itself"
    assert len(ended.output) == MAX_OUTPUT
    assert ended.output.endswith("x\nend\n")


def test_one_that_takes_too_long_is_killed_with_all_it_started(tmp_path):
    ended = shell("sleep 1000 & echo $! > pid; wait", tmp_path, timeout_s=0.3)
    assert ended.how == "late"
    assert ended.code == -signal.SIGKILL
    assert is_gone(int((tmp_path / "pid").read_text()))


@busy.can_be_made
def test_while_others_have_the_processor_none_of_its_time_passes(tmp_path):
    begin = time.monotonic()
    with busy.busy_machine():
        ended = worker(0.3, tmp_path, timeout_s=0.8)
    assert time.monotonic() - begin > 0.8, "nobody was in its way"
    assert ended.how == "by itself"
    assert 0.2 < ended.seconds < 0.8


def test_the_time_in_which_it_works_or_sleeps_passes(tmp_path):
    assert worker(1000, tmp_path, timeout_s=0.3).how == "late"
    ended = shell("sleep 0.3", tmp_path)
    assert ended.how == "by itself"
    assert 0.2 < ended.seconds < 2.0


def test_children_of_a_child_are_killed_with_it(tmp_path):
    begin = time.monotonic()
    ended = shell("sleep 1000 & echo $! > pid", tmp_path)
    assert ended.how == "by itself"
    assert time.monotonic() - begin < SOON_S
    assert is_gone(int((tmp_path / "pid").read_text()))


def test_one_that_closes_its_output_is_still_waited_for(tmp_path):
    assert shell("exec >&- 2>&-; sleep 0.2; exit 7", tmp_path).code == 7


def test_a_cancelled_child_ends_within_a_tenth_of_a_second(tmp_path):
    for _ in range(20):  # the machine may be busy with other processes
        cancelled, times = threading.Event(), []
        timer = threading.Timer(0.1, lambda c=cancelled, t=times: (t.append(time.monotonic()), c.set()))
        timer.start()
        assert shell("sleep 1000", tmp_path, cancelled=cancelled).how == "cancelled"
        if time.monotonic() - times[0] < 0.1:
            return
    pytest.fail("every one ended later")


def test_a_program_that_is_not_there_is_an_error_of_the_system(tmp_path):
    with pytest.raises(FileNotFoundError):
        run([str(tmp_path / "missing")], tmp_path, 1.0, threading.Event())


def test_the_guard_limits_memory_and_time_and_becomes_the_program(tmp_path):
    command = with_parent(["/bin/sh", "-c", "ulimit -v; ulimit -t; ulimit -c; echo $$"], limits=(100_000_000, 8))
    ended = run(command, tmp_path, SOON_S, threading.Event())
    assert ended.output.split()[:3] == [str(100_000_000 // 1024), "8", "0"]


def test_the_guard_does_not_begin_when_its_parent_has_ended(tmp_path):
    command = with_parent(["/bin/sh", "-c", "echo begun"], limits=(100_000_000, 7))
    command[command.index(str(os.getpid()))] = "1"
    ended = run(command, tmp_path, SOON_S, threading.Event())
    assert ended.output == ""
    assert "has ended" in ended.errors


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a child that its parent has died")
def test_a_child_is_killed_with_its_parent(tmp_path):
    code = f"""if True:
        import threading
        from pathlib import Path
        from socialbot.planning.planners.planner import run
        from socialbot.core.process import with_parent
        command = with_parent(["/bin/sh", "-c", "echo $$ > pid; exec sleep 1000"], limits=(1_000_000_000, 1000))
        run(command, Path({str(tmp_path)!r}), 1000, threading.Event())
    """
    parent = subprocess.Popen([sys.executable, "-c", code])
    written = tmp_path / "pid"
    end = time.monotonic() + SOON_S
    while not (written.exists() and written.read_text().endswith("\n")) and time.monotonic() < end:
        time.sleep(0.01)
    child = int(written.read_text())
    os.kill(child, 0)
    parent.kill()
    parent.wait()
    assert is_gone(child)
