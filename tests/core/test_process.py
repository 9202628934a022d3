"""End of processes, each in a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from threading import Thread

import pytest

from socialbot.core.process import Ending
from tests.system.running import next_line


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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_second_signal_during_a_slow_exit_keeps_exit_code_0(number):
    with subprocess.Popen([sys.executable, "-c", SLOW_TO_GO], stdout=subprocess.PIPE, text=True) as process:
        assert next_line(process) == "going\n"
        process.send_signal(number)
        assert process.wait(180) == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signal_lost_in_a_destructor_ends_the_next_wait(number):
    command = [sys.executable, "-c", SIGNAL_IN_DESTRUCTOR, str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "asked\n"


def test_a_process_of_nohup_outlives_its_terminal():
    command = ["nohup", sys.executable, "-c", SIGNAL_IN_DESTRUCTOR, str(int(signal.SIGHUP))]
    done = subprocess.run(command, capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL)
    assert done.stdout == "not asked\n"


def test_other_threads_wait_without_signal_handlers():
    before, endings = signal.getsignal(signal.SIGINT), []

    def wait() -> None:
        with Ending().on_signals() as ending:
            endings.append((ending.asked, signal.getsignal(signal.SIGINT)))

    thread = Thread(target=wait)
    thread.start()
    thread.join()
    assert endings == [(False, before)]


FAULTS = """
import resource
from socialbot.core.process import keep_freed_memory
{keep}
def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(100):
        bytearray(1_000_000), bytearray(1_000_000)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
faults()
print(faults())
"""

APART = """
import ctypes
from socialbot.core.process import keep_freed_memory
{keep}
class Info(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks".split()] + [
        ("rest", ctypes.c_size_t * 3)]
libc = ctypes.CDLL(None)
libc.malloc.restype, libc.free.argtypes, libc.mallinfo2.restype = ctypes.c_void_p, [ctypes.c_void_p], Info
blocks = [libc.malloc(40) for _ in range(1000)]
free, info = libc.free, libc.mallinfo2
info()  # A large allocation after the loop would merge the blocks.
for block in blocks:
    free(block)
print(info().fsmblks)
"""


def figure(script, keep):
    return int(subprocess.check_output([sys.executable, "-c", script.format(keep=keep)], text=True))


def faults(keep):
    return figure(FAULTS, keep)


def test_memory_of_an_image_is_reused_for_the_next():
    assert faults("assert keep_freed_memory()") < 1000 < faults("")


def test_small_freed_blocks_are_merged():
    assert figure(APART, "assert keep_freed_memory()") == 0
    assert figure(APART, "") > 40_000


START_PROCESS = """
from pathlib import Path
from socialbot.runtime._processes import start_process
print(start_process(["node", "--help"], Path("log/node.log")).wait())
"""
START_SERVER = """
from pathlib import Path
from socialbot.graph.node import Graph
from socialbot.runtime.fork_server import ForkServer
server = ForkServer(Graph("empty", ()), Path("log"))
print(server.start(["node", "--help"], Path("log/node.log")).wait())
server.close()
"""
START_WORKER = """
from socialbot.vision.metrics.workers import run_in_processes
if __name__ == "__main__":
    print(run_in_processes(abs, [(0,)], 1)[0])
"""


@pytest.mark.skipif(sys.version_info < (3, 11), reason="Python 3.10 has no option for that")
@pytest.mark.parametrize("program", [START_PROCESS, START_SERVER, START_WORKER], ids=["node", "server", "worker"])
def test_processes_import_nothing_from_the_working_directory(program: str, tmp_path: Path):
    """It may be the folder of a bag or data set from somebody else, or hold files of the same names by chance."""
    here, script = tmp_path / "here", tmp_path / "program.py"
    here.mkdir()
    script.write_text(program)
    for name in ("msgspec", "socket", "pickle", "typer", "random"):
        (here / f"{name}.py").write_text(f"raise SystemExit('{name} was imported from the working directory')")
    ended = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        cwd=here,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    assert (ended.returncode, ended.stdout) == (0, "0\n"), ended.stderr


HALTED = """
import hashlib, os, threading, time
from pathlib import Path
from socialbot.core.process import halt_thread
work = threading.Thread(target=hashlib.pbkdf2_hmac, args=("sha256", b"", b"", 2**31 - 1), daemon=True)
work.start()
def used_ns():
    return int(Path(f"/proc/self/task/{work.native_id}/schedstat").read_text().split()[0])
while used_ns() < 1e8:
    time.sleep(0.01)
halt_thread(work.native_id)
time.sleep(0.1)
before = used_ns()
time.sleep(0.5)
os._exit(used_ns() != before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="it is a system call of Linux")
def test_a_thread_of_a_library_is_halted_for_good():
    assert subprocess.run([sys.executable, "-c", HALTED], timeout=60, check=False).returncode == 0
