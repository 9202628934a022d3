"""Thread of a node: build, start, call and stop it, and measure its blocked time."""

from __future__ import annotations

import functools
import logging
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from socialbot.bridge._callback_queue import CallbackQueue, IdleState, InputQueue, InternalCall
from socialbot.bridge.diagnostics import Connection, NodeStatistics, restarts, unconnected
from socialbot.bridge.transport import is_power_of_ten
from socialbot.core.clock import SECOND, Clock
from socialbot.core.errors import NodeError, SocialbotError
from socialbot.core.messages import Health, Message
from socialbot.graph.calls import Channel
from socialbot.graph.health import BEAT_S, HealthMonitor
from socialbot.graph.node import (
    Node,
    NodeConfig,
    Timer,
    checked_callback,
    failure_text,
    make_node,
    outcome,
    start_failure,
)
from socialbot.graph.ports import Input, Output
from socialbot.graph.services import ClientPort

R = TypeVar("R")

CONNECT_TIMEOUT_S = 5.0  # connection timeout, after which a node starts anyway: others may be started by hand
RECONNECT_TIMEOUT_S = 1.0  # connection timeout of a restarted process
QUIET_WAIT_S = 2.0  # time after which a node reports missing connections
POLL_S = 0.02

SCHEDSTAT = "/proc/thread-self/schedstat"
_ROOM = os.path.dirname(__file__)


class _ThreadSchedstat(threading.local):
    """Linux scheduler statistics of the calling thread; an open file belongs to the thread that opened it."""

    def __init__(self) -> None:
        known = os.path.exists(SCHEDSTAT)
        self._file = open(SCHEDSTAT, "rb", buffering=0) if known else None  # noqa: SIM115 - closed with the thread

    def ns(self) -> int:
        """Time (ns) spent running or runnable; 0 without Linux."""
        if self._file is None:
            return 0
        running, runnable, _ = os.pread(self._file.fileno(), 80, 0).split()
        return int(running) + int(runnable)


_schedstat = _ThreadSchedstat()


class Stopwatch:
    """Stopwatch for the calling thread. Without scheduler statistics all of its time counts as blocked."""

    def __init__(self) -> None:
        self._scheduled = _schedstat.ns()
        self._begin = time.perf_counter_ns()

    def seconds(self) -> tuple[float, float]:
        """Elapsed time (s), and its blocked part."""
        elapsed = time.perf_counter_ns() - self._begin
        blocked = elapsed - (_schedstat.ns() - self._scheduled)
        return elapsed / 1e9, max(0, blocked) / 1e9


@dataclass
class _NodeContext:
    """`Context` of a node over ROS."""

    clock: Clock
    queue: CallbackQueue
    send: Callable[[Output[Any], Message], None]
    channel: Callable[[ClientPort], Channel]
    health_monitor: HealthMonitor
    statistics: NodeStatistics

    def publish(self, port: Output[Any], message: Message) -> None:
        watch = Stopwatch()
        self.send(port, message)
        self.statistics.count_publication(*watch.seconds())

    def call_soon(self, callback: Callable[[], None]) -> None:
        self.queue.call_soon(checked_callback(callback))

    def call_at(self, time: int, callback: Callable[[], None]) -> Timer:
        return self.queue.call_at(time, checked_callback(callback))

    def run_in_background(self, work: Callable[[], R], then: Callable[[R | Exception], None]) -> None:
        checked_callback(work)
        checked_callback(then)

        def run() -> None:
            self.queue.call_expected(functools.partial(then, outcome(work)))

        self.queue.expect()
        threading.Thread(target=run, name="background", daemon=True).start()


class NodeThread:
    """Thread of one node. The node starts once its ``connections`` are complete, or after a timeout.

    The thread calls ``on_alive`` when the node has started, and for each `check_alive`. ``failure`` is the error that
    kept the node from starting.
    """

    def __init__(
        self,
        config: NodeConfig,
        parameters: Mapping[str, object],
        *,
        clock: Clock,
        simulated: bool,
        on_idle: Callable[[IdleState], None] | None,
        publish: Callable[[Output[Any], Message], None],
        channel: Callable[[ClientPort], Channel],
        connections: Sequence[Connection],
        statistics: NodeStatistics,
        publish_health: Callable[[Health, bool], None],
        on_alive: Callable[[], None],
    ) -> None:
        self.name = config.name
        self.failure: SocialbotError | None = None
        self.queue = CallbackQueue(clock.now, simulated=simulated, on_idle=on_idle)
        self._health = HealthMonitor(config, clock, publish_health)
        context = _NodeContext(clock, self.queue, publish, channel, self._health, statistics)
        self.node: Node = make_node(config, context, parameters)
        self._clock = clock
        self._simulated = simulated
        self._connections = connections
        self._statistics = statistics
        self._on_alive = on_alive
        self._check_pending = False
        self._thread: threading.Thread | None = None

    @property
    def started(self) -> bool:
        return self._thread is not None

    @property
    def health(self) -> Health | None:
        """The health that the node published last; None before the first."""
        return self._health.shown

    def start(self) -> None:
        self._thread = threading.Thread(target=self._run, name=self.name, daemon=True)
        self._thread.start()

    def stop(self, timeout_s: float = 5.0) -> None:
        """Stop the node in its thread."""
        self.queue.close()
        if self._thread is not None:
            self._thread.join(timeout_s)

    def call(self, callback: Callable[[], None]) -> None:
        """Call ``callback`` in the thread of the node, or now before its start."""
        if self._thread is None:
            callback()
        else:
            self.queue.call_soon(callback)

    def note_server(self, port: ClientPort, topic: str, *, present: bool) -> None:
        """Notify the node, in its thread, that the server of a client is absent, or back."""
        self.queue.call_soon(InternalCall(self._health.note_server, port, topic, present=present))

    def note_mismatch(self, port: Input[Any], reason: str) -> None:
        """Report, in the thread of the node, why a publisher does not match an input; empty: messages arrive."""
        self.queue.call_soon(InternalCall(self._health.note_mismatch, port, reason))

    def check_alive(self) -> None:
        """Request a call of ``on_alive`` by the thread; a hanging node does not answer."""
        if not self._check_pending:
            self._check_pending = True
            self.queue.call_soon(InternalCall(self._report_alive))

    def _report_alive(self) -> None:
        self._check_pending = False
        self._on_alive()

    def _run(self) -> None:
        try:
            if self._simulated:
                self._await_time()
            self._await_connections()
            self.node.start()
            self._health.begin(self.node, lambda time, beat: self.queue.call_at(time, InternalCall(beat)))
            self.queue.monitor_inputs(self._health)
        except Exception as error:  # noqa: BLE001 - a node may raise anything when it starts
            self.failure = report_start_failure(self.name, error)
            return
        self._on_alive()
        while self.failure is None and (item := self.queue.take()) is not None:
            self._handle(item)
        self.node.stop()

    def _await_time(self) -> None:
        """Wait for the first message on /clock."""
        while self._clock.now() == 0 and not self.queue.closed:
            time.sleep(0.005)

    def _await_connections(self) -> None:
        begun = time.monotonic()
        report_at = begun + QUIET_WAIT_S
        while (missing := unconnected(self._connections)) and not self.queue.closed:
            now = time.monotonic()
            if now > begun + (RECONNECT_TIMEOUT_S if restarts() else CONNECT_TIMEOUT_S):
                logging.getLogger(f"socialbot.{self.name}").info("starts without %s", missing)
                return
            if now > report_at:
                self._health.wait(missing)
                report_at = now + BEAT_S
            time.sleep(POLL_S)

    def _handle(self, item: Callable[[], None] | tuple[InputQueue, Message]) -> None:
        begin = time.perf_counter()
        try:
            if callable(item):
                item()
            else:
                queue, message = item
                queue.port.deliver(self.node, message)
        except MemoryError as error:
            # Whatever the node keeps remains: only a new process has memory again.
            log_failure(self.name, "out of memory", error, 1)
            remedy = "raise memory_mb of its process, or use a machine with more memory"
            self.failure = NodeError("out of memory", where=self.name, remedy=remedy)
            return
        except Exception as error:  # noqa: BLE001 - a failing callback must not stop the graph
            self._statistics.failures += 1
            self._statistics.first_failure = self._statistics.first_failure or failure_text(error, _ROOM)
            log_failure(self.name, "failed", error, self._statistics.failures)
        if isinstance(item, InternalCall) or item == self._health.look:
            return
        seconds = time.perf_counter() - begin
        if not callable(item):
            queue, message = item
            queue.record_cost(seconds)
            self._statistics.ages.append((self._clock.now() - message.stamp) / SECOND)
        self._statistics.count_call(seconds)


def report_start_failure(node: str, error: Exception) -> SocialbotError:
    """Return the error of a node that cannot start; log unexpected exceptions with their traceback."""
    if not isinstance(error, SocialbotError):
        log_failure(node, "cannot start", error, 1)
    return start_failure(node, error, _ROOM)


def log_failure(node: str, what: str, error: Exception, count: int) -> None:
    """Log the first, tenth, hundredth, ... failure, which keeps the log short."""
    if is_power_of_ten(count):
        times = f" {count} times" if count > 1 else ""
        expected = isinstance(error, SocialbotError)
        logging.getLogger(f"socialbot.{node}").warning(
            "%s%s: %s", what, times, error, exc_info=None if expected else error
        )
