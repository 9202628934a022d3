"""Processes end on signals."""

from __future__ import annotations

import signal
import subprocess
import sys
from threading import Thread

import pytest

from socialbot.core.process import Ending
from tests.system.running import next_line

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


SIGNAL_IN_DESTRUCTOR = """
import os, sys
from socialbot.core.process import Ending, exit_on_signals

class Signalling:
    def __del__(self):
        os.kill(os.getpid(), int(sys.argv[1]))

exit_on_signals()
Signalling()
with Ending().on_signals() as ending:
    print("asked" if ending.asked else "not asked")
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_second_signal_during_a_slow_exit_keeps_exit_code_0(number):
    with subprocess.Popen([sys.executable, "-c", SLOW_TO_GO], stdout=subprocess.PIPE, text=True) as process:
        assert next_line(process) == "going\n"
        process.send_signal(number)
        assert process.wait(180) == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_lost_in_a_destructor_ends_the_next_wait(number):
    command = [sys.executable, "-c", SIGNAL_IN_DESTRUCTOR, str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "asked\n"


def test_other_threads_wait_without_signal_handlers():
    before, endings = signal.getsignal(signal.SIGINT), []

    def wait() -> None:
        with Ending().on_signals() as ending:
            endings.append((ending.asked, signal.getsignal(signal.SIGINT)))

    thread = Thread(target=wait)
    thread.start()
    thread.join()
    assert endings == [(False, before)]
