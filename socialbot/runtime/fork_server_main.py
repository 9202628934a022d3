"""A process that has imported what others need, and forks: its forks start in no time.

``python -m socialbot.runtime.fork_server_main FILE MODULE...`` imports these modules and serves orders from file
descriptor FILE.
It ends when that breaks. Each fork does what ``python -m socialbot`` does, as a child of the process that ordered it.

The zygote knows no ROS, and has no threads: what is beneath rclpy starts some when it is loaded, and forks lose them.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import os
import socket
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import msgspec

from socialbot.runtime.supervisor_channel import CHANNEL_VARIABLE

LONGEST = 2**17
PR_SET_NAME = 15
"""From Linux' headers."""


@dataclass(frozen=True)
class Order:
    """What a fork is to be called and to do: ``socialbot *arguments``, with more ``variables`` in its environment.

    With it come the files of its log and, where it has one, of its lifeline.
    """

    name: str
    arguments: list[str]
    variables: dict[str, str] = field(default_factory=dict)


def main() -> None:
    """Does what the module says."""
    line = socket.socket(fileno=int(sys.argv[1]))
    for module in sys.argv[2:]:
        importlib.import_module(module)
    from socialbot.__main__ import prepare, run

    prepare("node")
    if threading.active_count() > 1 or "rclpy" in sys.modules:
        sys.exit("there are threads, which forks would lose")
    gc.collect()
    gc.freeze()
    if serve(line):
        run()


def serve(line: socket.socket) -> bool:
    """Forks for each order. Returns True in a fork that has become what was ordered, and False when the line breaks."""
    while True:
        said, files, _, _ = socket.recv_fds(line, LONGEST, 2)
        if not said:
            return False
        order = msgspec.json.decode(said, type=Order)
        pid = fork_orphan()
        if pid == 0:
            line.close()
            become(order, files)
            return True
        for file in files:
            os.close(file)
        line.send(str(pid).encode())


def fork_orphan() -> int:
    """Forks a process that is a child of whoever adopts orphans. Returns its id; in it, 0."""
    told, with_event_log = os.pipe()
    between = os.fork()
    if between == 0:
        parent = os.getpid()
        try:
            pid = os.fork()
        except OSError:
            os._exit(1)
        if pid:
            os.write(with_event_log, str(pid).encode())
            os._exit(0)
        os.close(told)
        os.close(with_event_log)
        while os.getppid() == parent:
            time.sleep(0.001)
        return 0
    os.close(with_event_log)
    os.waitpid(between, 0)
    with open(told, "rb") as pipe:
        pid = pipe.read()
    if not pid:
        sys.exit("no more processes can be made")
    return int(pid)


def become(order: Order, files: Sequence[int]) -> None:
    """Makes this process what was ordered, up to running it."""
    os.setsid()
    log, *lifeline = files
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.close(log)
    os.environ.update(order.variables)
    for file in lifeline:
        os.environ[CHANNEL_VARIABLE] = str(file)
    sys.argv = ["socialbot", *order.arguments]
    ctypes.CDLL(None).prctl(PR_SET_NAME, order.name.encode(), 0, 0, 0)


if __name__ == "__main__":
    main()
