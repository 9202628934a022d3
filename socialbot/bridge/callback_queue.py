"""What waits for a node: messages, calls and timers, handed out one at a time to the node's own thread."""

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
from socialbot.graph.node import Delivery, Input

BACKLOG = 16
"""How many frames of a stream may wait at all; older ones fall off."""

OVERTAKEN_S = 1.0
"""What is older than the newest frame of a stream by no more was overtaken by it; by more, time has begun anew."""

GRACE_S = 0.05
"""Before an input is taken to be silent it gets so much real time more: messages may be on their way, when a machine
was held up or simulated time runs ahead of them."""

CALLS_AVERAGED = 8
"""Over how many calls the cost of a message is averaged: one call that was held up makes no node slow."""


@dataclass(eq=False)
class InputQueue:
    """The messages that wait at one input, and what became of the others."""

    port: Input[Any]
    waiting: deque[Message] = field(default_factory=deque)
    cost_s: float = 0.0
    spacings_s: deque[float] = field(default_factory=lambda: deque(maxlen=CALLS_AVERAGED))
    received: int = 0
    skipped: int = 0
    handled: int = 0
    latest: int = 0

    def put(self, message: Message) -> None:
        """Adds a message at the end; of a stream none that was overtaken."""
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
            self._keep(BACKLOG)

    def take(self) -> Message:
        """Removes the message to handle next.

        Of a stream that comes faster than it can be handled this is the newest one. A node that was held
        up for once, but is fast enough, catches up and loses nothing.
        """
        if self._slow:
            self._keep(1)
        return self.waiting.popleft()

    def pause(self, now: int) -> float:
        """How long (s) to wait for a newer message; 0 when what is there is to be taken.

        When the newest message is nearly as old as the spacing, the next one is on its way already. A node
        that cannot handle all of them does better to handle that one. ``now`` is in ns.
        """
        age = (now - self.waiting[-1].stamp) / SECOND
        due = 0.9 * self.spacing_s < age < 2 * self.spacing_s
        return 2 * self.spacing_s - age if self._slow and due else 0.0

    def charge(self, seconds: float) -> None:
        """Learns what handling a message costs: the average of the last calls."""
        self.handled += 1
        self.cost_s += (seconds - self.cost_s) / min(self.handled, CALLS_AVERAGED)

    @property
    def spacing_s(self) -> float:
        """The usual time between two messages: a median, which a pause or a jump of the stamps leaves alone."""
        return median(self.spacings_s) if self.spacings_s else 0.0

    @property
    def _slow(self) -> bool:
        return self.port.delivery is Delivery.NEWEST and self.cost_s > self.spacing_s > 0.0

    def _keep(self, count: int) -> None:
        while len(self.waiting) > count:
            self.waiting.popleft()
            self.skipped += 1


class PendingTimer:
    """A timer that has not fired yet."""

    def __init__(self, callback: Callable[[], None]) -> None:
        self.callback: Callable[[], None] | None = callback

    def cancel(self) -> None:
        """Takes the call back."""
        self.callback = None


class CallbackQueue:
    """Everything that waits for one node. ``put`` from any thread, ``take`` from the node's own.

    ``now`` tells the node's time (ns). While it is simulated, whoever moves it calls ``time_moved``.
    """

    def __init__(self, now: Callable[[], int], *, simulated: bool) -> None:
        self._now = now
        self._simulated = simulated
        self._changed = threading.Condition()
        self._lines: dict[str, InputQueue] = {}
        self._order: deque[InputQueue] = deque()
        self._calls: deque[Callable[[], None]] = deque()
        self._expected = 0
        self._when_idle: Callable[[], None] | None = None
        self._alarms: list[tuple[int, int, PendingTimer]] = []
        self._sequence = itertools.count()
        self._closed = False
        self._vitals: HealthMonitor | None = None
        self._overdue: float | None = None  # since when (monotonic, s) an input has seemed to be silent

    def attend(self, vitals: HealthMonitor) -> None:
        """From now on also hands out, as calls, what there is to tell of inputs with a deadline."""
        with self._changed:
            self._vitals = vitals
            self._changed.notify()

    @property
    def lines(self) -> tuple[InputQueue, ...]:
        """The inputs that messages have come to."""
        return tuple(self._lines.values())

    @property
    def closed(self) -> bool:
        """Whether nothing will be handed out any more."""
        return self._closed

    def put(self, port: Input[Any], message: Message) -> None:
        """Adds a message for ``port``."""
        with self._changed:
            if self._vitals is not None:
                self._vitals.came(port, message)
            line = self._lines.setdefault(port.name, InputQueue(port))
            line.put(message)
            if line.waiting and line not in self._order:
                self._order.append(line)
            self._changed.notify()

    def call_soon(self, callback: Callable[[], None]) -> None:
        """Adds a call that goes before all messages."""
        with self._changed:
            self._calls.append(callback)
            self._changed.notify()

    def expect(self) -> None:
        """Counts one more call that will come by `call_expected`, from work that is done elsewhere."""
        with self._changed:
            self._expected += 1

    def call_expected(self, callback: Callable[[], None]) -> None:
        """Adds a call as `call_soon` does, which is one of those expected."""
        with self._changed:
            self._expected -= 1
            self._calls.append(callback)
            self._changed.notify()

    def call_when_idle(self, callback: Callable[[], None]) -> None:
        """Adds a call for when nothing else waits or is expected; it takes the place of an earlier such call."""
        with self._changed:
            self._when_idle = callback
            self._changed.notify()

    def call_at(self, time: int, callback: Callable[[], None]) -> PendingTimer:
        """Adds a call for when the node's time has reached ``time`` (ns)."""
        alarm = PendingTimer(callback)
        with self._changed:
            heapq.heappush(self._alarms, (time, next(self._sequence), alarm))
            self._changed.notify()
        return alarm

    def time_moved(self) -> None:
        """Looks again whether a timer is due."""
        with self._changed:
            self._changed.notify()

    def close(self) -> None:
        """Lets ``take`` return None from now on."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def take(self) -> Callable[[], None] | tuple[InputQueue, Message] | None:
        """Waits for, and removes, what is to be done next; None when the inbox is closed."""
        with self._changed:
            while not self._closed:
                if self._calls:
                    return self._calls.popleft()
                pause = self._until_alarm()
                if pause is not None and pause <= 0:
                    callback = heapq.heappop(self._alarms)[2].callback
                    if callback is not None:
                        return callback
                    continue
                silence = self._until_silence()
                if self._vitals is not None and silence is not None and silence <= 0:
                    return self._vitals.look
                if self._order:
                    wait = self._wait_for_newer()
                    if not wait:
                        return self._next_message()
                    self._changed.wait(_shortest(wait, pause, silence))
                elif self._when_idle is not None and not self._expected and self._overdue is None:
                    idle, self._when_idle = self._when_idle, None
                    return idle
                else:
                    self._changed.wait(_shortest(None if self._simulated else pause, silence))
            return None

    def _until_silence(self) -> float | None:
        """How long (s) until there may be something to tell of an input; None as long as nothing changes."""
        if self._vitals is None:
            return None
        if self._vitals.returned:
            return 0.0
        due = self._vitals.due()
        left = None if due is None else (due - self._now()) / SECOND
        if left is None or left > 0:
            self._overdue = None
            return None if self._simulated else left
        if self._overdue is None:
            self._overdue = time.monotonic()
        return self._overdue + GRACE_S - time.monotonic()

    def _until_alarm(self) -> float | None:
        return (self._alarms[0][0] - self._now()) / SECOND if self._alarms else None

    def _wait_for_newer(self) -> float:
        # Simulated time may stand still, and a second input has something to do meanwhile.
        return 0.0 if self._simulated or len(self._order) > 1 else self._order[0].pause(self._now())

    def _next_message(self) -> tuple[InputQueue, Message]:
        line = self._order.popleft()
        message = line.take()
        if line.waiting:
            self._order.append(line)
        return line, message


def _shortest(*waits: float | None) -> float | None:
    return min((wait for wait in waits if wait is not None), default=None)
