"""Memory of a process that handles images."""

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
