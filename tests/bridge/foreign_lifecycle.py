"""Managed nodes of plain rclpy, in a process of their own: ``python foreign_lifecycle.py [NODE]...``.

Without a name the node is /lidar_driver. A node whose name begins with "broken" cannot be configured; one whose name
begins with "plain" has no lifecycle.
"""

import sys
from contextlib import suppress
from threading import Thread

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.utilities import try_shutdown


class Driver(LifecycleNode):
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        broken = self.get_name().startswith("broken")
        return TransitionCallbackReturn.FAILURE if broken else TransitionCallbackReturn.SUCCESS


def main() -> None:
    rclpy.init()
    executor = SingleThreadedExecutor()
    for name in sys.argv[1:] or ["lidar_driver"]:
        executor.add_node(Node(name) if name.startswith("plain") else Driver(name))
    Thread(target=lambda: (sys.stdin.read(), try_shutdown()), daemon=True).start()
    print("ready", flush=True)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
