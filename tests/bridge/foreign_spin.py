"""End of the processes of plain rclpy nodes that tests start by `foreign_process`."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from threading import Thread

from rclpy.executors import Executor, ExternalShutdownException
from rclpy.utilities import try_shutdown


def spin_to_the_end(executor: Executor) -> None:
    """Print "ready", spin until the standard input ends, and exit without waiting for threads that still work."""
    Thread(target=lambda: (sys.stdin.read(), try_shutdown()), daemon=True).start()
    print("ready", flush=True)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()
    for node in executor.get_nodes():
        node.destroy_node()
    sys.stdout.flush()
    os._exit(0)
