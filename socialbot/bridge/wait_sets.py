"""Fewer and smaller wait sets of rclpy nodes that one thread spins.

rclpy adds two event handlers of each publisher and subscription to each wait set: with 30 endpoints, three quarters of
the processor time for a message. Events are rare, for instance an incompatible QoS, and may be handled a second later.

An executor of rclpy wakes itself after each callback, for other threads that may wait. A single thread then makes a
second wait set for each message, in which nothing is ready.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import EventHandler
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

POLL_PERIOD_S = 1.0
"""Shortest time (s) between two polls of a node."""
POLL_S = 0.05
"""Duration (s) of a poll: of a wait set with the event handlers, and of the calls of those that are ready."""


class PollingGroup(CallbackGroup):
    """Callback group that leaves event handlers out of most wait sets, for an executor with a single thread.

    Args:
        clock: Steady clock (s).
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._polled = clock() - POLL_PERIOD_S

    def can_execute(self, entity: Any) -> bool:
        if not isinstance(entity, EventHandler):
            return True
        since = self._clock() - self._polled
        if since >= POLL_PERIOD_S:
            self._polled += since
            return True
        return since < POLL_S

    def beginning_execution(self, entity: Any) -> bool:
        return True

    def ending_execution(self, entity: Any) -> None:
        """Nothing waits for the end: the executor has a single thread."""


class PollsEvents:
    """Base of an rclpy node, before its rclpy class, whose QoS events are polled; its executor has a single thread."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._polling_group = PollingGroup()
        super().__init__(*arguments, **options)

    @property
    def default_callback_group(self) -> CallbackGroup:
        return self._polling_group


class PollingNode(PollsEvents, Node):
    """An rclpy node whose QoS events are polled."""


class OneThreadExecutor(SingleThreadedExecutor):
    """Executor that only other threads wake, not the one that spins it: that one waits for nothing meanwhile."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._spinning = 0
        guard: Any = self._guard
        trigger = guard.trigger

        def from_another_thread() -> None:
            if threading.get_ident() != self._spinning:
                trigger()

        guard.trigger = from_another_thread

    def spin_once(self, timeout_sec: float | None = None) -> None:
        self._spinning = threading.get_ident()
        super().spin_once(timeout_sec)
