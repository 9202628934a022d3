"""Run locks: shown per ROS domain, and released when their process ends."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from socialbot.runtime.run_lock import locked_runs, run_lock

HOLD = "from socialbot.runtime.run_lock import run_lock\nwith run_lock('abc'): print(); input()"


def test_a_lock_is_shown_in_its_domain_until_it_is_released(monkeypatch: pytest.MonkeyPatch):
    before = locked_runs()
    with run_lock("0123456789abcdef"):
        assert locked_runs() == {**before, "0123456789abcdef": os.getpid()}
        with monkeypatch.context() as elsewhere:
            elsewhere.setenv("ROS_DOMAIN_ID", "7")
            assert "0123456789abcdef" not in locked_runs()
    assert locked_runs() == before


def test_the_lock_of_a_killed_process_is_released():
    before = locked_runs()
    holder = subprocess.Popen([sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert holder.stdout is not None
    holder.stdout.readline()
    assert locked_runs() == {**before, "abc": holder.pid}
    holder.kill()
    holder.wait()
    assert locked_runs() == before
