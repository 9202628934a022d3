"""Processes from a zygote: children like any others, and none is lost when it dies."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from socialbot.graph.files import load_graph
from socialbot.runtime.fork_server import Fork, ForkServer
from tests.system.running import eventually

pytestmark = [pytest.mark.ros, pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there are no zygotes")]

UNKNOWN_NODE = ["node", "nobody"]
WAIT_S = 30.0
PR_GET_CHILD_SUBREAPER = 37


@pytest.fixture(scope="module")
def nursery(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ForkServer]:
    nursery = ForkServer(load_graph("waldo"), tmp_path_factory.mktemp("nursery"))
    yield nursery
    nursery.close()


def is_subreaper() -> bool:
    answer = ctypes.c_int(-1)
    ctypes.CDLL(None).prctl(PR_GET_CHILD_SUBREAPER, ctypes.byref(answer), 0, 0, 0)
    return bool(answer.value)


def test_a_fork_runs_the_command_line_and_its_log_says_why_it_failed(nursery: ForkServer, tmp_path: Path):
    log = tmp_path / "nobody.log"
    log.write_text("before\n")
    process = nursery.start(UNKNOWN_NODE, log)
    assert isinstance(process, Fork)
    assert process.wait(WAIT_S) == 4
    before, *said = log.read_text().splitlines()
    assert before == "before"
    assert "'nobody'" in "".join(said)
    assert "Traceback" not in log.read_text()


def test_only_while_it_orders_a_process_adopts_orphans(nursery: ForkServer, tmp_path: Path):
    nursery.start(UNKNOWN_NODE, tmp_path / "log").wait(WAIT_S)
    assert not is_subreaper()


def test_a_fork_is_a_child_and_says_how_it_was_ended(nursery: ForkServer, tmp_path: Path):
    process = nursery.start(["node", "head"], tmp_path / "head.log")
    assert process.poll() is None
    assert f"PPid:\t{os.getpid()}\n" in Path(f"/proc/{process.pid}/status").read_text()
    process.kill()
    assert process.wait(WAIT_S) == process.poll() == -signal.SIGKILL
    process.send_signal(signal.SIGINT)  # to nobody, as it is known to be dead


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_at_its_very_first_moment_ends_a_fork_well(nursery: ForkServer, tmp_path: Path, how: signal.Signals):
    process = nursery.start(["node", "head"], tmp_path / "head.log")
    process.send_signal(how)
    assert process.wait(WAIT_S) == 0
    assert (tmp_path / "head.log").read_text() == ""


def test_who_waits_too_long_is_told_so(nursery: ForkServer, tmp_path: Path):
    process = nursery.start(["node", "head"], tmp_path / "head.log")
    os.kill(process.pid, signal.SIGSTOP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.01)
    process.kill()
    process.wait(WAIT_S)


def test_when_the_zygote_dies_its_forks_live_and_others_are_started(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    nursery = ForkServer(load_graph("waldo"), tmp_path)
    try:
        head = nursery.start(["node", "head"], tmp_path / "head.log")
        assert eventually(lambda: Path(f"/proc/{head.pid}/comm").read_text() == "head\n")
        os.kill(head.pid, signal.SIGSTOP)
        assert nursery.zygote
        os.kill(nursery.zygote, signal.SIGKILL)
        plain = nursery.start(UNKNOWN_NODE, tmp_path / "plain.log")
        assert not isinstance(plain, Fork)
        assert [record.getMessage().partition(":")[0] for record in caplog.records] == [
            "plain is started without a zygote"
        ]
        fork = nursery.start(UNKNOWN_NODE, tmp_path / "fork.log")
        assert isinstance(fork, Fork)
        assert plain.wait(WAIT_S) == fork.wait(WAIT_S) == 4
        assert head.poll() is None
        head.kill()
        head.wait(WAIT_S)
    finally:
        nursery.close()
