"""Script that executes a program which ends with its parent process; see `socialbot.core.process.with_parent`.

``python -I -S _exec_with_parent.py PARENT [MEMORY_BYTES CPU_S] -- COMMAND...`` asks Linux to kill it with the process
PARENT, limits itself, and executes COMMAND. It is a script because a process with threads cannot run code between fork
and exec, and it imports no package to start fast.
"""

from __future__ import annotations

import os
import resource
import sys

# From the headers of Linux: importing the module signal would take half of the start time.
PR_SET_PDEATHSIG = 1
SIGKILL = 9


def main() -> None:
    begin = sys.argv.index("--")
    (parent, *limits), command = [int(word) for word in sys.argv[1:begin]], sys.argv[begin + 1 :]
    if limits:
        for which, value in zip(
            (resource.RLIMIT_AS, resource.RLIMIT_CPU, resource.RLIMIT_CORE), (*limits, 0), strict=True
        ):
            _, most = resource.getrlimit(which)
            value = value if most == resource.RLIM_INFINITY else min(value, most)
            resource.setrlimit(which, (value, value))
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        sys.exit("the parent process has ended")
    try:
        os.execv(command[0], command)
    except OSError as error:
        sys.exit(f"{command[0]}: {error.strerror}")


if __name__ == "__main__":
    main()
