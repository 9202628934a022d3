"""The library by which an evaluation sets the clock of others."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from evaluation.faults_clocks import CLOCK_VARIABLE, build_library, set_clock

ASK = "import datetime as d, sys, time as t\nfor line in sys.stdin: print(t.time_ns(), int(t.time()), t.monotonic_ns())"


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_the_library_changes_only_clocks_that_can_be_set(tmp_path: Path) -> None:
    clock = tmp_path / "clock"
    set_clock(clock, 0)
    variables = {**os.environ, "LD_PRELOAD": str(build_library(tmp_path)), CLOCK_VARIABLE: str(clock)}
    with subprocess.Popen(
        [sys.executable, "-uc", ASK], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=variables
    ) as other:
        assert other.stdin is not None
        assert other.stdout is not None
        told = []
        for ahead_s in (0, -3600, 86400, 0):
            set_clock(clock, ahead_s)
            other.stdin.write("\n")
            other.stdin.flush()
            told.append([int(word) for word in other.stdout.readline().split()])
        other.stdin.close()
    begun = told[0]
    for ahead_s, (precise, coarse, steady) in zip((0, -3600, 86400, 0), told, strict=True):
        passed = steady - begun[2]
        assert 0 <= passed < 30 * 10**9
        assert abs(precise - begun[0] - passed - ahead_s * 10**9) < 10**8
        assert abs(coarse - begun[1] - ahead_s) <= 30
