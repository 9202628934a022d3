"""The heap of a process through which pictures pass."""

import subprocess
import sys

FAULTS = """
import resource
from socialbot.bridge.heap import keep_freed_memory
{keep}
def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(100):
        bytearray(1_000_000), bytearray(1_000_000)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
faults()
print(faults())
"""


def faults(keep):
    return int(subprocess.check_output([sys.executable, "-c", FAULTS.format(keep=keep)], text=True))


def test_the_memory_of_one_picture_serves_the_next():
    assert faults("assert keep_freed_memory()") < 1000 < faults("")
