"""End of the processes of plain rclpy nodes that tests start by `foreign_process`."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from threading import Thread

from rclpy.executors import Executor, ExternalShutdownException
from rclpy.utilities import try_shutdown


def spin_to_the_end(executor: Executor, on_line: Callable[[str], None] = lambda line: None) -> None:
    """Print "ready", spin until the standard input ends, and exit without waiting for threads that still work.

    Each line of the standard input goes to ``on_line`` before that.
    """

    def read() -> None:
        for line in sys.stdin:
            on_line(line.rstrip("\n"))
        try_shutdown()

    Thread(target=read, daemon=True).start()
    print("ready", flush=True)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()
    for node in executor.get_nodes():
        node.destroy_node()
    sys.stdout.flush()
    os._exit(0)
