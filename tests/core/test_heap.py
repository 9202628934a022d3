"""The heap of a process through which pictures pass."""

import subprocess
import sys

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
for block in [libc.malloc(40) for _ in range(1000)]:
    libc.free(block)
print(libc.mallinfo2().fsmblks)
"""


def told(script, keep):
    return int(subprocess.check_output([sys.executable, "-c", script.format(keep=keep)], text=True))


def faults(keep):
    return told(FAULTS, keep)


def test_the_memory_of_one_picture_serves_the_next():
    assert faults("assert keep_freed_memory()") < 1000 < faults("")


def test_what_is_small_and_freed_does_not_lie_apart():
    assert told(APART, "assert keep_freed_memory()") == 0 < 40_000 < told(APART, "")
