"""Managed nodes of plain rclpy, in a process of their own: ``python -m tests.bridge.foreign_lifecycle [NODE]...``.

Without a name the node is /lidar_driver. A node whose name begins with "broken" cannot be configured; one whose name
begins with "plain" has no lifecycle.
"""

import sys

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node

from tests.bridge.foreign_spin import spin_to_the_end


class Driver(LifecycleNode):
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        broken = self.get_name().startswith("broken")
        return TransitionCallbackReturn.FAILURE if broken else TransitionCallbackReturn.SUCCESS


def main() -> None:
    rclpy.init()
    executor = SingleThreadedExecutor()
    for name in sys.argv[1:] or ["lidar_driver"]:
        executor.add_node(Node(name) if name.startswith("plain") else Driver(name))
    spin_to_the_end(executor)


if __name__ == "__main__":
    main()
