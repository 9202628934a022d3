"""A script that binds a program to the process that has started it.

``python -I -S bound.py PARENT COMMAND...`` asks the kernel to be killed when the process PARENT dies (on Linux), and
becomes COMMAND. A script of its own, because a process with threads cannot safely do anything between fork and exec.
"""

from __future__ import annotations

import os
import sys

# From Linux' headers.
PR_SET_PDEATHSIG = 1
SIGKILL = 9


def main() -> None:
    """Does what the module says; never returns."""
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
