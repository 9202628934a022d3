"""What a planner's process is before it becomes the planner: a script that sets its limits.

``python -I -S guard.py MEMORY_BYTES CPU_S PARENT COMMAND...`` takes the limits upon itself, asks the kernel to be
killed when the process PARENT dies (on Linux), and becomes COMMAND. A script of its own, because a process with
threads cannot safely do anything between fork and exec. ``bridge/bound.py`` does the same without limits; they share
nothing, because planning does not know the bridge, and a script that starts this fast has no package to import from.
"""

from __future__ import annotations

import os
import resource
import sys

# From Linux' headers; the module signal takes half as long to import as all else here together.
PR_SET_PDEATHSIG = 1
SIGKILL = 9


def main() -> None:
    """Does what the module says; never returns."""
    memory, cpu, parent = (int(word) for word in sys.argv[1:4])
    command = sys.argv[4:]
    _limit(resource.RLIMIT_AS, memory)
    _limit(resource.RLIMIT_CPU, cpu)
    _limit(resource.RLIMIT_CORE, 0)
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        sys.exit("the process that wanted a plan has ended")
    try:
        os.execv(command[0], command)
    except OSError as error:
        sys.exit(f"{command[0]}: {error.strerror}")


def _limit(which: int, value: int) -> None:
    _, most = resource.getrlimit(which)
    value = value if most == resource.RLIM_INFINITY else min(value, most)
    resource.setrlimit(which, (value, value))


if __name__ == "__main__":
    main()
