"""Script that sets limits and executes a planner.

``python -I -S _exec_with_limits.py MEMORY_BYTES CPU_S PARENT COMMAND...`` limits itself, lets Linux kill it with the
process PARENT, and executes COMMAND. It is a script because a process with threads cannot run code between fork and
exec, and it imports no package to start fast.
"""

from __future__ import annotations

import os
import resource
import sys

# From the headers of Linux: importing the module signal would take half of the start time.
PR_SET_PDEATHSIG = 1
SIGKILL = 9


def main() -> None:
    memory, cpu, parent = (int(word) for word in sys.argv[1:4])
    command = sys.argv[4:]
    _limit(resource.RLIMIT_AS, memory)
    _limit(resource.RLIMIT_CPU, cpu)
    _limit(resource.RLIMIT_CORE, 0)
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        sys.exit("the parent process has ended")
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
