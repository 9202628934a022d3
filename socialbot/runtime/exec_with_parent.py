"""Run a program that ends with its parent process.

``python -I -S exec_with_parent.py PARENT COMMAND...`` asks the Linux kernel to kill it when the process PARENT ends,
and executes COMMAND. It is a separate script, because a process with threads cannot safely run code between fork and
exec.
"""

from __future__ import annotations

import os
import sys

# From the headers of Linux.
PR_SET_PDEATHSIG = 1
SIGKILL = 9


def main() -> None:
    """Execute the command; never returns."""
    parent, command = int(sys.argv[1]), sys.argv[2:]
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        sys.exit("the process that wanted it has ended")
    try:
        os.execv(command[0], command)
    except OSError as error:
        sys.exit(f"{command[0]}: {error.strerror}")


if __name__ == "__main__":
    main()
