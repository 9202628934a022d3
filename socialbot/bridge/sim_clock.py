"""Simulated time in step with the nodes: /clock goes on as soon as all of them have done what was due.

So a graph over DDS runs as fast as the machine can, and a slow or busy machine makes the run longer but not different:
work that a node has done aside, such as planning, takes no simulated time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import NodeError

KEPT_TOPIC = "/clock_kept"
"""Here nodes tell up to which time they have kept up (std_msgs/Header: their name and that time)."""

STEP_S = 0.1
PATIENCE_S = 30.0
"""How long (s of real time) a node may take for what is due at one time."""

REMIND_S = 0.25
"""A node that has just joined has not heard of the time; it is told again after so long (s of real time)."""

NUDGE_NS = 1000


class SimClock:
    """Moves the time of a graph through the rclpy node ``ros``, which another thread spins.

    ``awaited`` are the names of the nodes that have to keep up; take out one that goes away, add one that joins.
    ``now`` is the time in ns. It moves only in `advance` and `until`.
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
        """Lets so much time pass. Raises NodeError when a node does not keep up."""
        end = self.now + nanoseconds(seconds)
        self._tell()
        while self.now < end:
            self.now = min(self.now + self._step, end)
            self._tell()

    def until(self, holds: Callable[[], bool], *, limit_s: float) -> bool:
        """Lets time pass until something holds, for ``limit_s`` at most; says whether it does."""
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

    def _tell(self) -> None:
        """Tells the time, and waits for the nodes."""
        deadline = time.monotonic() + PATIENCE_S
        self._publish()
        while not self._wait():
            if time.monotonic() > deadline:
                raise NodeError(
                    f"not done after {PATIENCE_S:.0f} s with what is due at {self.now / SECOND:.3f} s",
                    where=", ".join(sorted(self._late())),
                    remedy="look into its log",
                )
            # Nodes notice only a time that has changed.
            self.now += NUDGE_NS
            self._publish()

    def _publish(self) -> None:
        message = self._clock_type()
        message.clock.sec, message.clock.nanosec = divmod(self.now, SECOND)
        self._clock.publish(message)

    def _wait(self) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: not self._late(), REMIND_S)

    def _late(self) -> list[str]:
        return [name for name in self.awaited if self._kept.get(name, -1) < self.now]
