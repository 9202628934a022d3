"""Timers of an agent, and the wake-up of the thread that runs it."""

from __future__ import annotations

import heapq
import itertools
import os
import select
from collections.abc import Callable

from socialbot.bdi.trace import TraceWriter
from socialbot.core.clock import Clock, nanoseconds

FEW_TIMERS = 64
"""Heap size below which expired timers are not removed."""

_ONE = (1).to_bytes(8, "little")


class Timers:
    """Callbacks by due time. A callback is removed early once its optional method ``over`` returns True.

    Only the engine's thread may call the methods. Actions driven by these timers behave the same in every simulated
    run.
    """

    __slots__ = ("_most", "_sequence", "_trace", "heap", "now")

    def __init__(self, clock: Clock, trace: TraceWriter) -> None:
        self.now = clock.now
        self.heap: list[tuple[int, int, Callable[[], object]]] = []
        self._trace = trace
        self._most = FEW_TIMERS
        self._sequence = itertools.count()

    def at(self, time: int, callback: Callable[[], object]) -> None:
        """Call ``callback`` at ``time`` (ns)."""
        heapq.heappush(self.heap, (time, next(self._sequence), callback))
        if len(self.heap) > self._most:
            self.remove(lambda found: (over := getattr(found, "over", None)) is not None and over())
            self._most = max(FEW_TIMERS, 2 * len(self.heap))

    def after(self, seconds: float, callback: Callable[[], object]) -> None:
        """Call ``callback`` in ``seconds``."""
        self.at(self.now() + nanoseconds(seconds), callback)

    def cancel(self, callback: Callable[[], object]) -> None:
        """Remove the timers of a callback."""
        self.remove(lambda found: found is callback)

    def remove(self, unwanted: Callable[[Callable[[], object]], bool]) -> None:
        # The interpreter keeps a reference to this list.
        self.heap[:] = [timer for timer in self.heap if not unwanted(timer[2])]
        heapq.heapify(self.heap)

    def run_due(self) -> None:
        """Call the due callbacks; their exceptions are written to the trace."""
        heap, now = self.heap, self.now()
        while heap and heap[0][0] <= now:
            callback = heapq.heappop(heap)[2]
            try:
                callback()
            except Exception as problem:  # noqa: BLE001 - a sensor or a step behind a timer is user code
                self._trace.record_failure("timer", "", problem)


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
            os.write(self._writer, _ONE)
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
