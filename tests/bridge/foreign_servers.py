"""Servers of plain rclpy, in a process of their own: ``python -m tests.bridge.foreign_servers [MODE]``.

/light is a std_srvs/SetBool that is refused when it is lit already; /deaf answers nothing within a minute. /count is a
test_msgs/Fibonacci: it counts down from ``order`` with feedback every 50 ms, rejects orders above 100, and aborts
negative ones. With the mode "stubborn" it refuses to cancel; with "hasty" feedback comes every millisecond.

A line of the standard input is another mode: the servers end what they do, and print "ready" when all is as at first.
"""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Condition, Event
from typing import Any

import rclpy
from rclpy.action.server import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool

from tests.bridge.foreign_spin import spin_to_the_end

try:
    from test_msgs.action import Fibonacci
except ImportError:
    Fibonacci = None


class Servers(Node):
    def __init__(self, mode: str) -> None:
        super().__init__("servers")
        self.declare_parameter("gains", [1.0, 2.0])
        self.declare_parameter("mode", True)
        group = ReentrantCallbackGroup()
        self.lit = False
        self.mode = mode
        self.over = Event()
        self.working = 0
        self.idle = Condition()
        self.create_service(SetBool, "/light", self.on_light, callback_group=group)
        self.create_service(SetBool, "/deaf", self.on_deaf, callback_group=group)
        if Fibonacci is not None:
            self.server = ActionServer(
                self,
                Fibonacci,
                "/count",
                self.count,
                callback_group=group,
                goal_callback=self.on_goal,
                cancel_callback=lambda _: CancelResponse.REJECT if self.mode == "stubborn" else CancelResponse.ACCEPT,
            )

    def begin_again(self, mode: str) -> None:
        """End all goals and calls that are in progress, and tell when none is."""
        self.over.set()
        with self.idle:
            self.idle.wait_for(lambda: not self.working)
        self.over, self.lit, self.mode = Event(), False, mode
        print("ready", flush=True)

    @contextmanager
    def work(self) -> Iterator[None]:
        with self.idle:
            self.working += 1
        try:
            yield
        finally:
            with self.idle:
                self.working -= 1
                self.idle.notify()

    def on_goal(self, goal: Any) -> GoalResponse:
        """Answer when the client is discovered: ROS loses what is told before."""
        deadline = time.monotonic() + 10.0
        while time.monotonic() < deadline and not (
            self.count_subscribers("/count/_action/feedback")
            and self.get_subscriptions_info_by_topic("rr/count/_action/send_goalReply", no_mangle=True)
        ):
            time.sleep(0.01)
        return GoalResponse.REJECT if goal.order > 100 and self.mode != "hasty" else GoalResponse.ACCEPT

    def on_light(self, request: Any, response: Any) -> Any:
        response.success = request.data != self.lit
        response.message = "" if response.success else "it is so already"
        self.lit = request.data
        return response

    def on_deaf(self, request: Any, response: Any) -> Any:
        with self.work():
            self.over.wait(60.0)
        return response

    def count(self, goal: Any) -> Any:
        with self.work():
            return self.counted(goal)

    def counted(self, goal: Any) -> Any:
        assert Fibonacci is not None
        result = Fibonacci.Result()
        over = self.over
        if goal.request.order < 0:
            goal.abort()
            return result
        done = []
        for left in range(goal.request.order, 0, -1):
            if goal.is_cancel_requested:
                print("cancelled", flush=True)
                goal.canceled()
                result.sequence = done
                return result
            done.append(left)
            goal.publish_feedback(Fibonacci.Feedback(sequence=done))
            if over.wait(0.001 if self.mode == "hasty" else 0.05):
                goal.abort()
                return result
        goal.succeed()
        result.sequence = done
        return result


def main() -> None:
    rclpy.init()
    node = Servers(sys.argv[1] if len(sys.argv) > 1 else "")
    executor = MultiThreadedExecutor(4)
    executor.add_node(node)
    spin_to_the_end(executor, node.begin_again)


if __name__ == "__main__":
    main()
