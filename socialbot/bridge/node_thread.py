"""Run a node in its own thread: build, start, call, stop; and measure how long it was blocked."""

from __future__ import annotations

import functools
import logging
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from socialbot.bridge.callback_queue import CallbackQueue, InputQueue, PendingTimer
from socialbot.bridge.diagnostics import Connection, NodeStatistics, restarts, unconnected

from socialbot.bridge.transport import Sender
from socialbot.core.clock import SECOND, Clock
from socialbot.core.errors import NodeError, SocialbotError
from socialbot.core.messages import Health, Message
from socialbot.graph.health import BEAT_S, HealthMonitor
from socialbot.graph.node import Node, NodeConfig, Output, outcome

SCHEDSTAT = "/proc/thread-self/schedstat"
LONGEST = 80
"""Bytes of its three numbers at most."""


class _Scheduled(threading.local):
    """What Linux counts of each thread. A file is bound to the thread that opens it."""

    def __init__(self) -> None:
        known = os.path.exists(SCHEDSTAT)
        self._file = open(SCHEDSTAT, "rb", buffering=0) if known else None  # noqa: SIM115 - as long as the thread

    def ns(self) -> int:
        """At work and ready for it, together (ns); 0 where nobody counts."""
        if self._file is None:
            return 0
        at_work, ready, _ = os.pread(self._file.fileno(), LONGEST, 0).split()
        return int(at_work) + int(ready)


_scheduled = _Scheduled()


class Stopwatch:
    """Measures the calling thread from when it is made. Where Linux does not tell, all of it counts as blocked."""

    def __init__(self) -> None:
        self._scheduled = _scheduled.ns()
        self._begin = time.perf_counter_ns()

    def seconds(self) -> tuple[float, float]:
        """How long (s) it has been since then, and for how much of it the thread was blocked."""
        whole = time.perf_counter_ns() - self._begin
        blocked = whole - (_scheduled.ns() - self._scheduled)
        return whole / 1e9, max(0, blocked) / 1e9


R = TypeVar("R")


CONNECTED_S = 5.0
"""So long a node waits for its connections before it starts without them: others may have been started by hand."""

RECONNECTED_S = 1.0
"""The same in a process that was started again: it is missed by those who are there."""

WAITS_QUIETLY_S = 2.0
"""After so long it says that it waits, and for what."""


@dataclass(frozen=True)
class _Own:
    """A call of the runner's own, which is none of the node's statistics."""

    callback: Callable[[], None]

    def __call__(self) -> None:
        self.callback()


class _NodeContext:
    """rclpy as one node sees it."""

    def __init__(
        self,
        clock: Clock,
        inbox: CallbackQueue,
        senders: Mapping[str, Sender],
        vitals: HealthMonitor,
        statistics: NodeStatistics,
    ) -> None:
        self.clock = clock
        self.vitals = vitals
        self._inbox = inbox
        self._senders = senders
        self._statistics = statistics

    def publish(self, port: Output[Any], message: Message) -> None:
        watch = Stopwatch()
        self._senders[port.name].publish(message)
        self._statistics.note_publication(*watch.seconds())

    def call_at(self, time: int, callback: Callable[[], None]) -> PendingTimer:
        return self._inbox.call_at(time, callback)

    def call_soon(self, callback: Callable[[], None]) -> None:
        self._inbox.call_soon(callback)

    def run_in_background(self, work: Callable[[], R], then: Callable[[R | Exception], None]) -> None:
        def run() -> None:
            self._inbox.call_expected(functools.partial(then, outcome(work)))

        self._inbox.expect()
        threading.Thread(target=run, name="aside", daemon=True).start()


class NodeThread:
    """Builds the node of ``placement``; what it publishes goes to the ``outlets`` by the names of its ports.

    It starts when its ``connections`` stand. ``well`` is called by its own thread, once when it has started and each
    time that `ask` asks how it is. ``failure`` is the error that kept it from starting, if any.
    """

    def __init__(
        self,
        placement: NodeConfig,
        parameters: Mapping[str, object],
        *,
        clock: Clock,
        simulated: bool,
        senders: Mapping[str, Sender],
        connections: Sequence[Connection],
        statistics: NodeStatistics,
        say_health: Callable[[Health], None],
        well: Callable[[], None],
    ) -> None:
        self.name = placement.name
        self.failure: SocialbotError | None = None
        self.inbox = CallbackQueue(clock.now, simulated=simulated)
        self._vitals = HealthMonitor(placement, clock, say_health)
        context = _NodeContext(clock, self.inbox, senders, self._vitals, statistics)
        self.node: Node = placement.type(placement.name, context, parameters)
        self._clock = clock
        self._simulated = simulated
        self._connections = connections
        self._statistics = statistics
        self._well = well
        self._asked = False
        self._thread: threading.Thread | None = None

    @property
    def started(self) -> bool:
        """Whether it has a thread."""
        return self._thread is not None

    def start(self) -> None:
        """Starts the thread, and in it the node."""
        self._thread = threading.Thread(target=self._live, name=self.name, daemon=True)
        self._thread.start()

    def stop(self, timeout_s: float = 5.0) -> None:
        """Stops the node, in its own thread."""
        self.inbox.close()
        if self._thread is not None:
            self._thread.join(timeout_s)

    def call(self, callback: Callable[[], None]) -> None:
        """Has something done in the node's own thread: now, while there is none yet."""
        if self._thread is None:
            callback()
        else:
            self.inbox.call_soon(callback)

    def ask(self) -> None:
        """Asks the node how it is. One that hangs does not answer."""
        if not self._asked:
            self._asked = True
            self.inbox.call_soon(_Own(self._answer))

    def _answer(self) -> None:
        self._asked = False
        self._well()

    def _live(self) -> None:
        try:
            if self._simulated:
                self._await_time()
            self._await_connections()
            self.node.start()
            self._vitals.begin(self.node, lambda time, beat: self.inbox.call_at(time, _Own(beat)))
            self.inbox.attend(self._vitals)
        except SocialbotError as error:
            self.failure = error
            return
        except Exception as error:  # noqa: BLE001 - whatever a node raises at its start is told in one message
            report(self.name, "cannot start", error, 1)
            self.failure = NodeError(f"cannot start: {type(error).__name__}: {error}", where=self.name)
            return
        self._well()
        while (item := self.inbox.take()) is not None:
            self._do(item)
        self.node.stop()

    def _await_time(self) -> None:
        """Simulated time begins with the first message on /clock."""
        begun = threading.Event()
        while self._clock.now() == 0 and not begun.wait(0.005):
            if self.inbox.closed:
                return

    def _await_connections(self) -> None:
        """What is said before the listeners are there is lost."""
        begun = time.monotonic()
        says_at = begun + WAITS_QUIETLY_S
        while (lacking := unconnected(self._connections)) and not self.inbox.closed:
            now = time.monotonic()
            if now > begun + (RECONNECTED_S if restarts() else CONNECTED_S):
                logging.getLogger(f"socialbot.{self.name}").info("starts without %s", lacking)
                return
            if now > says_at:
                self._vitals.wait(lacking)
                says_at = now + BEAT_S
            time.sleep(POLL_S)

    def _do(self, item: Callable[[], None] | tuple[InputQueue, Message]) -> None:
        begin = time.perf_counter()
        try:
            if callable(item):
                item()
            else:
                line, message = item
                line.port.deliver(self.node, message)
        except Exception as error:  # noqa: BLE001 - whatever a node raises, the graph goes on
            self._statistics.failures += 1
            self._statistics.first_failure = self._statistics.first_failure or f"{type(error).__name__}: {error}"
            report(self.name, "failed", error, self._statistics.failures)
        if isinstance(item, _Own) or item == self._vitals.look:
            return
        seconds = time.perf_counter() - begin
        if not callable(item):
            line, message = item
            line.charge(seconds)
            self._statistics.ages.append((self._clock.now() - message.stamp) / SECOND)
        self._statistics.note(seconds)


def report(node: str, what: str, error: Exception, count: int) -> None:
    """Logs the first failure, the tenth, the hundredth, ...: a bad stream must not flood the log."""
    if str(count).strip("0") == "1":
        times = f" {count} times" if count > 1 else ""
        expected = isinstance(error, SocialbotError)
        logging.getLogger(f"socialbot.{node}").warning("%s%s: %s", what, times, error, exc_info=not expected)
