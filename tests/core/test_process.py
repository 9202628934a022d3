"""End of processes, each in a process of its own."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(("code", "expected"), [("0", 0), ("7", 7), ("None", 0), ("'failed'", 1)])
def test_a_process_whose_cleanup_would_not_return_ends_with_its_code(code: str, expected: int):
    program = f"""
import atexit, sys, threading
from socialbot.core.process import run_to_exit, skip_cleanup
atexit.register(threading.Event().wait)
def main():
    print("done")
    skip_cleanup()
    sys.exit({code})
run_to_exit(main)
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=120)
    assert (ended.returncode, ended.stdout) == (expected, "done\n")


def test_other_processes_end_as_usual():
    program = """
import atexit, sys
from socialbot.core.process import run_to_exit
atexit.register(print, "cleaned up")
run_to_exit(lambda: sys.exit(3))
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=120)
    assert (ended.returncode, ended.stdout) == (3, "cleaned up\n")
