"""Callback queue of a node: messages, calls and timers for its thread."""

from __future__ import annotations

import functools
import heapq
import itertools
import operator
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from logging import getLogger
from statistics import median
from typing import Any, NamedTuple

from socialbot.bridge._endpoints import is_power_of_ten
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message
from socialbot.graph.health import HealthMonitor
from socialbot.graph.node import Timer
from socialbot.graph.ports import Delivery, Input

log = getLogger("socialbot.transport")

MAX_WAITING = 16  # maximum number of waiting messages per stream; older ones are dropped
MAX_COMMANDS = 10_000
"""Maximum number of waiting messages of an input that takes every message. A node this far behind loses the oldest."""
MAX_DATA_BYTES = 64 * 2**20
"""Maximum size of the data of these messages, such as images. The newest message is kept in any case."""
OVERTAKEN_S = 1.0
"""Maximum age difference of messages that arrived out of order. A larger one means that time was reset."""

LATE_S = 2.0
"""Age (s) of an observation beyond the usual one from which it is out of date: a lost link or a pause held it back."""
LATE_FOR_S = 1.0
"""Real time (s) after which late observations count again: a clock was set, or they will be late from now on."""
USUAL_COUNT = 50
"""Number of observations whose least age is the usual one."""

GRACE_S = 0.05  # real time to wait after the deadline of an input, for messages in transit
CALLS_AVERAGED = 8  # number of calls in the average cost of a message


class InternalCall(functools.partial[None]):
    """Internal callback, excluded from the statistics of the node."""


@dataclass(eq=False)
class InputQueue:
    """Waiting messages of one input, and message counts."""

    port: Input[Any]
    waiting: deque[Message] = field(default_factory=deque)
    cost_s: float = 0.0
    spacing_s: float = 0.0
    """Median time between two messages. A median ignores pauses and jumps of the stamps."""
    spacings_s: deque[float] = field(default_factory=lambda: deque(maxlen=CALLS_AVERAGED))
    arrived: int = 0
    received: int = 0
    skipped: int = 0
    dropped: int = 0
    """Messages that had to be handled, and are lost because the node is too slow."""
    handled: int = 0
    latest: int = 0
    _bytes: int = 0
    _ages_s: deque[float] = field(default_factory=lambda: deque(maxlen=USUAL_COUNT))
    _taken: int = 0
    _taken_s: float = 0.0
    _late_since_s: float | None = None

    def put(self, message: Message) -> None:
        """Append a message; skip stream messages that arrived out of order."""
        later_s = (message.stamp - self.latest) / SECOND if self.received else 0.0
        if self.received:
            self.spacings_s.append(later_s)
            self.spacing_s = median(self.spacings_s)
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
        else:
            self._bytes += _data_bytes(message)
            self._drop_oldest()

    def take(self) -> Message:
        """Remove and return the next message; the newest one if the stream is faster than the node."""
        if self._slow:
            self._keep(1)
        message = self.waiting.popleft()
        if self.port.delivery is Delivery.EVERY:
            self._bytes -= _data_bytes(message)
        return message

    def is_late(self, message: Message, now: int, steady_s: float) -> bool:
        """Return whether a message of an input with a deadline is out of date at ``now`` (ns), and count it as skipped.

        A lost link, or a pause of this process, holds messages back; then all of them arrive at once. Nobody should act
        on such old observations. A message is late if two things are true: nothing was taken for `LATE_S` of real time,
        and the message is `LATE_S` older than the youngest of the last messages was. Ages are compared only with each
        other, because clocks of machines differ. Without a gap, a clock was set, or a bag is played slowly. Stamps that
        stand still tell no age, and stamps that go back are a reset of time.
        """
        if not self.port.deadline_s:
            return False
        age_s, gap_s = (now - message.stamp) / SECOND, steady_s - self._taken_s
        if message.stamp <= self._taken:
            self._ages_s.clear()
        self._taken, self._taken_s = message.stamp, steady_s
        if age_s > min(self._ages_s, default=age_s) + LATE_S:
            if self._late_since_s is None and gap_s > LATE_S:
                self._late_since_s = steady_s
            if self._late_since_s is not None and steady_s - self._late_since_s <= LATE_FOR_S:
                self.skipped += 1
                return True
            self._ages_s.clear()
        self._late_since_s = None
        self._ages_s.append(age_s)
        return False

    def pause(self, now: int) -> float:
        """Time (s) to wait at ``now`` (ns) for a newer message; 0 unless the node is slow and the next one is due."""
        age = (now - self.waiting[-1].stamp) / SECOND
        due = 0.9 * self.spacing_s < age < 2 * self.spacing_s
        return 2 * self.spacing_s - age if self._slow and due else 0.0

    def record_cost(self, seconds: float) -> None:
        self.handled += 1
        self.cost_s += (seconds - self.cost_s) / min(self.handled, CALLS_AVERAGED)

    @property
    def _slow(self) -> bool:
        return self.port.delivery is Delivery.NEWEST and self.cost_s > self.spacing_s > 0.0

    def _keep(self, count: int) -> None:
        while len(self.waiting) > count:
            self.waiting.popleft()
            self.skipped += 1

    def _drop_oldest(self) -> None:
        """Bound the memory of a node that is slower than its messages; the newest command counts most."""
        while len(self.waiting) > MAX_COMMANDS or (self._bytes > MAX_DATA_BYTES and len(self.waiting) > 1):
            self._bytes -= _data_bytes(self.waiting.popleft())
            self.dropped += 1
            if is_power_of_ten(self.dropped):
                text = "input %s: dropped %d messages, since they arrive faster than the node handles them"
                log.warning(text, self.port.name, self.dropped)


def _data_bytes(message: Message) -> int:
    """Return the size of the field ``data`` of a message, such as the pixels of an image; 0 without such a field."""
    data = getattr(message, "data", None)
    if isinstance(data, str):
        return len(data)
    try:
        return memoryview(data).nbytes  # type: ignore[arg-type]
    except TypeError:
        return 0


class IdleState(NamedTuple):
    """State of a queue whose callbacks have all been handled.

    Attributes:
        time: The time (ns) up to which timers were called.
        arrived: Number of messages by input.
        held: Number of messages that wait for a release.
        round: The last release.
        repeat: The last request for a repeated call.
    """

    time: int
    arrived: Mapping[Input[Any], int]
    held: int
    round: int
    repeat: int

    @property
    def total(self) -> int:
        """Number of all messages that have arrived."""
        return sum(self.arrived.values())


class CallbackQueue:
    """Callbacks of one node. Any thread may add them; the thread of the node takes them.

    ``now`` returns the time of the node (ns). If it is ``simulated``, its owner calls `recheck` after each change.

    `take` returns a call of ``on_idle`` when all that waited is handled and nothing is expected, once after each
    change.

    A message that is put with an order is held until `release`. Messages of one release have the order of these values,
    or of their content if several have the same, whenever they arrived.
    """

    def __init__(
        self, now: Callable[[], int], *, simulated: bool, on_idle: Callable[[IdleState], None] | None = None
    ) -> None:
        self._now = now
        self._simulated = simulated
        self._on_idle = on_idle
        self._has_changed = True
        self._held: list[tuple[tuple[int, int], Input[Any], Message, int]] = []
        self._arrived = 0
        self._round = self._repeat = 0
        self._changed = threading.Condition()
        self._inputs: dict[str, InputQueue] = {}
        self._order: deque[InputQueue] = deque()
        self._calls: deque[Callable[[], None]] = deque()
        self._expected = 0
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

    def put(self, port: Input[Any], message: Message, order: tuple[int, int] | None = None) -> None:
        """Add a message. With an ``order``, it is held until `release`."""
        with self._changed:
            queue = self._inputs.setdefault(port.name, InputQueue(port))
            queue.arrived += 1
            self._arrived += 1
            if order is None:
                self._release()
                self._append(queue, message)
            else:
                self._held.append((order, port, message, self._arrived))
            self._notify()

    def release(self, round: int, repeat: int = 0, *, arrived: int | None = None) -> None:
        """Release held messages if ``round`` is a later one: of the first ``arrived`` messages, or all.

        Call ``on_idle`` again in any case.
        """
        with self._changed:
            if round > self._round:
                self._round = round
                self._release(arrived)
            self._repeat = max(self._repeat, repeat)
            self._notify()

    def _release(self, arrived: int | None = None) -> None:
        first = operator.itemgetter(0)
        released = [held for held in self._held if arrived is None or held[3] <= arrived]
        self._held = self._held[len(released) :]
        for _, same in itertools.groupby(sorted(released, key=first), key=first):
            for _, port, message, _ in sorted(same, key=lambda item: repr(item[2])):
                self._append(self._inputs[port.name], message)

    def _append(self, queue: InputQueue, message: Message) -> None:
        if self._health is not None:
            self._health.came(queue.port, message)
        queue.put(message)
        if queue.waiting and queue not in self._order:
            self._order.append(queue)

    def call_soon(self, callback: Callable[[], None]) -> None:
        """Add a call with priority over messages."""
        with self._changed:
            self._calls.append(callback)
            self._notify()

    def expect(self) -> None:
        """Announce a later `call_expected`, such as the end of work in the background."""
        with self._changed:
            self._expected += 1

    def call_expected(self, callback: Callable[[], None]) -> None:
        """Add an announced call."""
        with self._changed:
            self._expected -= 1
            self._calls.append(callback)
            self._notify()

    def call_at(self, time: int, callback: Callable[[], None]) -> Timer:
        """Add a call at the node time ``time`` (ns)."""
        timer = Timer(callback)
        with self._changed:
            heapq.heappush(self._timers, (time, next(self._sequence), timer))
            self._changed.notify()
        return timer

    def recheck(self) -> None:
        """Check the timers, and call ``on_idle`` again: the simulated time has changed, or a message was refused."""
        with self._changed:
            self._notify()

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
                now = self._now()
                timer_s = (self._timers[0][0] - now) / SECOND if self._timers else None
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
                        queue, message = self._next_message()
                        if self._simulated or not queue.is_late(message, self._now(), time.monotonic()):
                            return queue, message
                        continue
                    waits = (pause, timer_s, deadline_s)
                elif self._on_idle and self._has_changed and not self._expected and self._overdue is None:
                    self._has_changed = False
                    return InternalCall(self._on_idle, self._idle_state(now))
                else:
                    waits = (None if self._simulated else timer_s, deadline_s)
                self._changed.wait(min((wait for wait in waits if wait is not None), default=None))
            return None

    def _idle_state(self, now: int) -> IdleState:
        arrived = {queue.port: queue.arrived for queue in self._inputs.values()}
        return IdleState(now, arrived, len(self._held), self._round, self._repeat)

    def _notify(self) -> None:
        self._has_changed = True
        self._changed.notify()

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
