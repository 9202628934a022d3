"""Simulated time in step with the nodes: /clock advances when all of them have finished the work that is due.

A graph over DDS then runs as fast as the machine allows; a slow machine only makes the run longer. Background work,
such as planning, takes no simulated time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import NodeError

KEPT_TOPIC = "/clock_kept"
"""Topic for the time up to which a node has finished its work (std_msgs/Header: name and time)."""

STEP_S = 0.1
STEP_TIMEOUT_S = 30.0
"""Real time (s) that a node has for the work of one step."""

REPEAT_S = 0.25
"""Real time (s) after which the time is published again, for a new node."""

NUDGE_NS = 1000


class SimClock:
    """Clock of a graph, published through the rclpy node ``ros``, which another thread spins.

    Attributes:
        now: The time (ns). It changes only in `advance` and `until`.
        awaited: The names of the nodes to wait for. Remove a node that leaves, add one that joins.
    """

    def __init__(self, ros: Any, nodes: Iterable[str], *, start: int = SECOND, step_s: float = STEP_S) -> None:
        from rosgraph_msgs.msg import Clock
        from std_msgs.msg import Header

        from socialbot.bridge.transport import publisher_qos, subscription_qos
        from socialbot.graph.node import Delivery

        self.now = start
        self.awaited = set(nodes)
        self._step = nanoseconds(step_s)
        self._kept: dict[str, int] = {}
        self._changed = threading.Condition()
        self._clock_type = Clock
        self._clock = ros.create_publisher(Clock, "/clock", publisher_qos(Delivery.EVERY))
        self._subscription = ros.create_subscription(
            Header, KEPT_TOPIC, self._note, subscription_qos(Delivery.EVERY, outside=False)
        )

    def advance(self, seconds: float) -> None:
        """Advance the time. Raises NodeError when a node does not finish its work."""
        end = self.now + nanoseconds(seconds)
        self._step_nodes()
        while self.now < end:
            self.now = min(self.now + self._step, end)
            self._step_nodes()

    def until(self, holds: Callable[[], bool], *, limit_s: float) -> bool:
        """Advance the time until ``holds`` returns true, or by ``limit_s``; return whether it did."""
        end = self.now + nanoseconds(limit_s)
        while not holds():
            if self.now >= end:
                return False
            self.advance(min(self._step, end - self.now) / SECOND)
        return True

    def _note(self, header: Any) -> None:
        with self._changed:
            self._kept[header.frame_id] = header.stamp.sec * SECOND + header.stamp.nanosec
            self._changed.notify()

    def _step_nodes(self) -> None:
        deadline = time.monotonic() + STEP_TIMEOUT_S
        self._publish()
        while not self._wait():
            if time.monotonic() > deadline:
                raise NodeError(
                    f"the work due at {self.now / SECOND:.3f} s is not done after {STEP_TIMEOUT_S:.0f} s",
                    where=", ".join(sorted(self._late())),
                    remedy="see the log of the node",
                )
            # Nodes only react to a time that has changed.
            self.now += NUDGE_NS
            self._publish()

    def _publish(self) -> None:
        message = self._clock_type()
        message.clock.sec, message.clock.nanosec = divmod(self.now, SECOND)
        self._clock.publish(message)

    def _wait(self) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: not self._late(), REPEAT_S)

    def _late(self) -> list[str]:
        return [name for name in self.awaited if self._kept.get(name, -1) < self.now]
