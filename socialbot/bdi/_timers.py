"""Timers of an agent, and the wake-up of its thread."""

from __future__ import annotations

import heapq
import os
import select
from collections import deque
from collections.abc import Callable
from itertools import count
from typing import Any

from socialbot.bdi.trace import TraceWriter
from socialbot.core.clock import Clock, nanoseconds

FEW_TIMERS = 64
"""Heap size below which expired timers are not removed."""


class Timers:
    """Callbacks by due time, for the engine's thread. A callback has no effect once its function ``over`` returns True.

    Actions driven by these timers behave the same in every simulated run.

    Attributes:
        posted: Items posted to the agent. They are not empty while more callbacks are due, so that a plan that the
            current one starts takes turns with theirs.
    """

    __slots__ = ("_most", "_sequence", "_trace", "heap", "now", "posted")

    def __init__(self, clock: Clock, trace: TraceWriter) -> None:
        self.now = clock.now
        self.heap: list[tuple[int, int, Callable[[], object], Callable[[], bool] | None]] = []
        self.posted: deque[Any] = deque()
        self._trace = trace
        self._most = FEW_TIMERS
        self._sequence = count()

    def number(self) -> int:
        """Number of the next timer; of several due at the same time, that with the lowest number is first."""
        return next(self._sequence)

    def at(
        self,
        time: int,
        callback: Callable[[], object],
        over: Callable[[], bool] | None = None,
        *,
        number: int | None = None,
    ) -> None:
        """Call ``callback`` at ``time`` (ns); ``number`` is that of the timer, by default a new one."""
        heapq.heappush(self.heap, (time, next(self._sequence) if number is None else number, callback, over))
        if len(self.heap) > self._most:
            self.remove(lambda _: False)
            self._most = max(FEW_TIMERS, 2 * len(self.heap))

    def after(self, seconds: float, callback: Callable[[], object], over: Callable[[], bool] | None = None) -> None:
        self.at(self.now() + nanoseconds(seconds), callback, over)

    def remove(self, unwanted: Callable[[Callable[[], object]], bool]) -> None:
        """Remove the timers of the unwanted callbacks, and those that have no effect."""
        # The interpreter keeps a reference to this list.
        self.heap[:] = [timer for timer in self.heap if not (unwanted(timer[2]) or (timer[3] and timer[3]()))]
        heapq.heapify(self.heap)

    def run_due(self) -> None:
        """Call the due callbacks; their exceptions are written to the trace."""
        heap, posted, now = self.heap, self.posted, self.now()
        while heap and heap[0][0] <= now:
            _, _, callback, over = heapq.heappop(heap)
            if heap and heap[0][0] <= now:
                posted.appendleft(_nothing)
            try:
                if over is None or not over():
                    callback()
            except Exception as problem:  # noqa: BLE001 - a sensor or a step behind a timer is user code
                self._trace.record_failure("timer", "", problem)
            if posted and posted[0] is _nothing:
                posted.popleft()


def _nothing() -> None:
    """Posted item without effect."""


class Wakeup:
    """Event that wakes one waiting thread, twice as fast as a lock.

    Repeated calls of `ring` without a waiting thread count as one.
    """

    def __init__(self) -> None:
        if hasattr(os, "eventfd"):
            self._reader = self._writer = os.eventfd(0)
        else:
            self._reader, self._writer = os.pipe()
            os.set_blocking(self._writer, False)
        self._poll = select.poll()
        self._poll.register(self._reader, select.POLLIN)

    def ring(self) -> None:
        """Wake the current or next waiting thread; callable from any thread."""
        # Only the system call: the caller still holds the interpreter lock that the woken thread needs.
        try:  # noqa: SIM105
            os.write(self._writer, b"\1\0\0\0\0\0\0\0")
        except BlockingIOError:
            pass  # The pipe is full, so a wake-up is pending already.

    def wait(self, seconds: float | None = None) -> None:
        """Wait for `ring`, at most ``seconds``."""
        if seconds is None or self._poll.poll(max(0.0, seconds * 1000)):
            os.read(self._reader, 65536)

    def __del__(self) -> None:
        # Not earlier: while another thread may still ring, the descriptor must not be reused for another file.
        for number in {self._reader, self._writer}:
            os.close(number)
