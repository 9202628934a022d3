"""How processes end on signals."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

SLOW_TO_GO = """
import time
from socialbot.core.process import exit_on_signals

class Slow:
    def __del__(self):
        print("going", flush=True)
        time.sleep(1)

exit_on_signals()
slow = Slow()
"""


@pytest.mark.parametrize("asked", [signal.SIGINT, signal.SIGTERM])
def test_who_is_asked_again_while_going_ends_well_all_the_same(asked):
    with subprocess.Popen([sys.executable, "-c", SLOW_TO_GO], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "going\n"
        process.send_signal(asked)
        assert process.wait(30) == 0
