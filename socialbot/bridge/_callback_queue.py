"""Callback queue of a node: messages, calls and timers for its thread."""

from __future__ import annotations

import heapq
import itertools
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from socialbot.core.clock import SECOND
from socialbot.core.messages import Message
from socialbot.graph.health import HealthMonitor
from socialbot.graph.node import Delivery, Input, Timer

MAX_WAITING = 16  # maximum number of waiting messages per stream; older ones are dropped
OVERTAKEN_S = 1.0
"""Maximum age difference of messages that arrived out of order. A larger one means that time was reset."""

GRACE_S = 0.05  # real time to wait after the deadline of an input, for messages in transit
CALLS_AVERAGED = 8  # number of calls in the average cost of a message


@dataclass(eq=False)
class InputQueue:
    """Waiting messages of one input, and message counts."""

    port: Input[Any]
    waiting: deque[Message] = field(default_factory=deque)
    cost_s: float = 0.0
    spacings_s: deque[float] = field(default_factory=lambda: deque(maxlen=CALLS_AVERAGED))
    received: int = 0
    skipped: int = 0
    handled: int = 0
    latest: int = 0

    def put(self, message: Message) -> None:
        """Append a message; skip stream messages that arrived out of order."""
        later_s = (message.stamp - self.latest) / SECOND if self.received else 0.0
        if self.received:
            self.spacings_s.append(later_s)
        self.received += 1
        if self.port.delivery is Delivery.NEWEST and -OVERTAKEN_S <= later_s < 0:
            self.skipped += 1
            return
        self.latest = message.stamp
        self.waiting.append(message)
        if self.port.delivery is Delivery.LATCHED:
            self._keep(1)
        elif self.port.delivery is Delivery.NEWEST:
            self._keep(MAX_WAITING)

    def take(self) -> Message:
        """Remove and return the next message; the newest one if the stream is faster than the node."""
        if self._slow:
            self._keep(1)
        return self.waiting.popleft()

    def pause(self, now: int) -> float:
        """Time (s) to wait at ``now`` (ns) for a newer message; 0 unless the node is slow and the next one is due."""
        age = (now - self.waiting[-1].stamp) / SECOND
        due = 0.9 * self.spacing_s < age < 2 * self.spacing_s
        return 2 * self.spacing_s - age if self._slow and due else 0.0

    def record_cost(self, seconds: float) -> None:
        self.handled += 1
        self.cost_s += (seconds - self.cost_s) / min(self.handled, CALLS_AVERAGED)

    @property
    def spacing_s(self) -> float:
        """Median time between two messages. A median ignores pauses and jumps of the stamps."""
        return median(self.spacings_s) if self.spacings_s else 0.0

    @property
    def _slow(self) -> bool:
        return self.port.delivery is Delivery.NEWEST and self.cost_s > self.spacing_s > 0.0

    def _keep(self, count: int) -> None:
        while len(self.waiting) > count:
            self.waiting.popleft()
            self.skipped += 1


class CallbackQueue:
    """Callbacks of one node. Any thread may add them; the thread of the node takes them.

    ``now`` returns the time of the node (ns). If it is ``simulated``, its owner calls `time_changed`.
    """

    def __init__(self, now: Callable[[], int], *, simulated: bool) -> None:
        self._now = now
        self._simulated = simulated
        self._changed = threading.Condition()
        self._inputs: dict[str, InputQueue] = {}
        self._order: deque[InputQueue] = deque()
        self._calls: deque[Callable[[], None]] = deque()
        self._expected = 0
        self._when_idle: Callable[[], None] | None = None
        self._timers: list[tuple[int, int, Timer]] = []
        self._sequence = itertools.count()
        self.closed = False
        self._health: HealthMonitor | None = None
        self._overdue: float | None = None  # when (monotonic, s) an input passed its deadline

    def monitor_inputs(self, health: HealthMonitor) -> None:
        """Let `take` also return ``health.look`` when an input passes its deadline or recovers."""
        with self._changed:
            self._health = health
            self._changed.notify()

    @property
    def inputs(self) -> tuple[InputQueue, ...]:
        """The inputs that have received messages."""
        return tuple(self._inputs.values())

    def put(self, port: Input[Any], message: Message) -> None:
        with self._changed:
            if self._health is not None:
                self._health.came(port, message)
            queue = self._inputs.setdefault(port.name, InputQueue(port))
            queue.put(message)
            if queue.waiting and queue not in self._order:
                self._order.append(queue)
            self._changed.notify()

    def call_soon(self, callback: Callable[[], None]) -> None:
        """Add a call with priority over messages."""
        with self._changed:
            self._calls.append(callback)
            self._changed.notify()

    def expect(self) -> None:
        """Announce a later `call_expected`, such as the end of work in the background."""
        with self._changed:
            self._expected += 1

    def call_expected(self, callback: Callable[[], None]) -> None:
        """Add an announced call."""
        with self._changed:
            self._expected -= 1
            self._calls.append(callback)
            self._changed.notify()

    def call_when_idle(self, callback: Callable[[], None]) -> None:
        """Set the call for an empty queue without expected calls. It replaces an earlier one."""
        with self._changed:
            self._when_idle = callback
            self._changed.notify()

    def call_at(self, time: int, callback: Callable[[], None]) -> Timer:
        """Add a call at the node time ``time`` (ns)."""
        timer = Timer(callback)
        with self._changed:
            heapq.heappush(self._timers, (time, next(self._sequence), timer))
            self._changed.notify()
        return timer

    def time_changed(self) -> None:
        """Check the timers after a change of the simulated time."""
        with self._changed:
            self._changed.notify()

    def close(self) -> None:
        """Make `take` return None from now on."""
        with self._changed:
            self.closed = True
            self._changed.notify()

    def take(self) -> Callable[[], None] | tuple[InputQueue, Message] | None:
        """Wait for the next callback or message, and remove it. Return None when the queue is closed."""
        with self._changed:
            while not self.closed:
                if self._calls:
                    return self._calls.popleft()
                timer_s = (self._timers[0][0] - self._now()) / SECOND if self._timers else None
                if timer_s is not None and timer_s <= 0:
                    callback = heapq.heappop(self._timers)[2].callback
                    if callback is not None:
                        return callback
                    continue
                deadline_s = self._until_deadline()
                if self._health is not None and deadline_s is not None and deadline_s <= 0:
                    return self._health.look
                if self._order:
                    # Simulated time may stand still, and other inputs should not wait.
                    alone = not self._simulated and len(self._order) == 1
                    pause = self._order[0].pause(self._now()) if alone else 0.0
                    if not pause:
                        return self._next_message()
                    waits = (pause, timer_s, deadline_s)
                elif self._when_idle is not None and not self._expected and self._overdue is None:
                    idle, self._when_idle = self._when_idle, None
                    return idle
                else:
                    waits = (None if self._simulated else timer_s, deadline_s)
                self._changed.wait(min((wait for wait in waits if wait is not None), default=None))
            return None

    def _until_deadline(self) -> float | None:
        """Time (s) until an input passes its deadline or recovers; None without such a time."""
        if self._health is None:
            return None
        if self._health.returned:
            return 0.0
        due = self._health.due()
        left = None if due is None else (due - self._now()) / SECOND
        if left is None or left > 0:
            self._overdue = None
            return None if self._simulated else left
        if self._overdue is None:
            self._overdue = time.monotonic()
        return self._overdue + GRACE_S - time.monotonic()

    def _next_message(self) -> tuple[InputQueue, Message]:
        queue = self._order.popleft()
        message = queue.take()
        if queue.waiting:
            self._order.append(queue)
        return queue, message
