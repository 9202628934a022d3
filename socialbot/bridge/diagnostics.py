"""Publish what a node costs and how it fares on /diagnostics, once a second."""

from __future__ import annotations

import itertools
import logging
import os
import resource
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from socket import gethostname
from typing import Any

import msgspec
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node as RosNode

from socialbot.bridge.callback_queue import InputQueue
from socialbot.bridge.transport import reason_of, wire
from socialbot.core.errors import MessageError
from socialbot.graph.node import Graph

DIAGNOSTICS_TOPIC = "/diagnostics"
SEAL = "seal"
"""The key of the value that holds name and values under a seal."""

Take = Callable[[str, dict[str, str]], None]
"""Takes the name of a node and what it tells of itself."""

log = logging.getLogger("socialbot.diagnostics")
_DECODER = msgspec.json.Decoder(tuple[str, dict[str, str]])


class DiagnosticsPublisher:
    """Tells through the rclpy node ``ros`` how nodes fare."""

    def __init__(self, ros: Any) -> None:
        self._ros = ros
        self._stream = wire().stream(DIAGNOSTICS_TOPIC)
        self._publisher = ros.create_publisher(DiagnosticArray, DIAGNOSTICS_TOPIC, 10)

    def publish(self, statuses: list[DiagnosticStatus]) -> None:
        """Sends what there is to tell."""
        for status in statuses:
            self._seal(status)
        array = DiagnosticArray(status=statuses)
        array.header.stamp = self._ros.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _seal(self, status: DiagnosticStatus) -> None:
        if self._stream is not None:
            text = msgspec.json.encode((status.name, values_of(status))).decode()
            status.values = [*status.values, KeyValue(key=SEAL, value=self._stream.seal(text))]


class DiagnosticsSubscriber:
    """Hears through the rclpy node ``ros`` how nodes fare, and calls ``take`` in its thread.

    What is not to be believed is counted in ``refused`` and logged; others than nodes of socialbot may speak there too,
    and are heard only where there are no keys.
    """

    def __init__(self, ros: Any, take: Take) -> None:
        self.refused = 0
        self._take = take
        self._opener = wire().opener(DIAGNOSTICS_TOPIC)
        self.subscription = ros.create_subscription(DiagnosticArray, DIAGNOSTICS_TOPIC, self._receive, 100)

    def _receive(self, array: Any) -> None:
        for status in array.status:
            try:
                told = self._believed(status)
            except MessageError as error:
                self._refuse(error)
            else:
                if told is not None:
                    self._take(*told)

    def _believed(self, status: Any) -> tuple[str, dict[str, str]] | None:
        """Name and values of ``status``; None of a driver without a seal. Raises MessageError for what is forged."""
        values = values_of(status)
        seal = values.pop(SEAL, "")
        if self._opener is None:
            return status.name, values
        if not seal and not is_ours(values):
            return None
        text = self._opener.open(seal)
        try:
            return None if text is None else _DECODER.decode(text)
        except msgspec.MsgspecError as error:
            raise MessageError(f"no diagnostics: {error}") from error

    def _refuse(self, error: MessageError) -> None:
        self.refused += 1
        if str(self.refused).strip("0") == "1":
            log.warning("%s, refused %d (%s): %s", DIAGNOSTICS_TOPIC, self.refused, reason_of(error), error)


def is_ours(values: Mapping[str, str]) -> bool:
    """Whether a node of socialbot tells ``values``, or somebody who pretends to be one; drivers tell others."""
    return "state" in values and "machine" in values


def values_of(status: Any) -> dict[str, str]:
    """The values of a status by their keys."""
    return {pair.key: pair.value for pair in status.values}


UNCONNECTED = "unconnected"
"""The key on /diagnostics: what a node still misses, empty when it is connected."""


@dataclass(frozen=True)
class Connection:
    """One end of a connection: how many peers it should have, and a way to count them."""

    topic: str
    wanted: int
    count: Callable[[], int]
    end: Any
    """The rclpy publisher or subscription."""


def publisher_connection(graph: Graph, topic: str, publisher: Any) -> Connection:
    """The connection of an rclpy publisher to the listeners in ``graph``."""
    listeners = sum(topic == listened for placement in graph.placements for listened, _ in placement.subscriptions)
    return Connection(topic, listeners, publisher.get_subscription_count, publisher)


def subscription_connection(graph: Graph, topic: str, subscription: Any) -> Connection:
    """The connection of an rclpy subscription to the publishers in ``graph``."""
    publishers = sum(topic == published for placement in graph.placements for published, _ in placement.publications)
    return Connection(topic, publishers, subscription.get_publisher_count, subscription)


def unconnected(connections: Iterable[Connection]) -> str:
    """The topics that lack a peer, separated by commas."""
    return ", ".join(one.topic for one in connections if one.count() < one.wanted)


MACHINE_VARIABLE = "SOCIALBOT_MACHINE"
"""The name of this machine in a deployment; without it, its host name."""

RESTARTS_VARIABLE = "SOCIALBOT_RESTARTS"
"""By it a supervisor tells a process how often it was started again."""

LAST_ERROR_VARIABLE = "SOCIALBOT_LAST_ERROR"
"""By it a supervisor tells a process why the one before it died."""

TICK_S = 0.1
TICKS_A_REPORT = 10

WINDOW = 600
"""Over how many of the last calls percentiles are taken."""


PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20


@dataclass
class NodeStatistics:
    """Counts of one node since its start, the durations (s) of its last calls, and the ages (s) of what it handled.

    The age of a message is the time from its stamp, by the node's clock, until it had been handled.
    """

    calls: int = 0
    published: int = 0
    failures: int = 0
    refusals: Counter[str] = field(default_factory=Counter)
    """Messages that were refused, by reason."""
    first_failure: str = ""
    durations: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW))
    longest_publication: float = 0.0
    """How long (s) publishing a message has taken at most, since this was asked for last."""
    longest_block: float = 0.0
    """How long (s) at most it has waited meanwhile for anything but a processor, since this was asked for last."""
    ages: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW))

    @property
    def refused(self) -> int:
        """Messages that were refused."""
        return self.refusals.total()

    def note(self, seconds: float) -> None:
        """Counts one call."""
        self.calls += 1
        self.durations.append(seconds)

    def note_publication(self, seconds: float, blocked: float) -> None:
        """Counts one message published, which has kept the node for so long (s), and blocked it."""
        self.published += 1
        self.longest_publication = max(self.longest_publication, seconds)
        self.longest_block = max(self.longest_block, blocked)

    def take_longest_publication(self) -> tuple[float, float]:
        """The longest publication and the longest block (s) since this was called last."""
        longest = self.longest_publication, self.longest_block
        self.longest_publication = self.longest_block = 0.0
        return longest


@dataclass(frozen=True)
class DurationStats:
    """Mean and percentiles of durations (s); 0 where there are none."""

    mean: float = 0.0
    p50: float = 0.0
    p99: float = 0.0

    @staticmethod
    def of(durations: Collection[float]) -> DurationStats:
        """The spread of ``durations``."""
        ordered = sorted(durations)
        if not ordered:
            return DurationStats()
        p50, p99 = (ordered[min(len(ordered) - 1, int(share * len(ordered)))] for share in (0.5, 0.99))
        return DurationStats(sum(ordered) / len(ordered), p50, p99)


@dataclass(frozen=True)
class ResourceUsage:
    """What was counted up to a time (s): calls, messages published, processor seconds."""

    time: float = 0.0
    calls: int = 0
    published: int = 0
    cpu_s: float = 0.0

    def rates_since(self, before: ResourceUsage) -> dict[str, float]:
        """How often and how much since ``before``: calls and messages a second, percent of one core."""
        seconds = self.time - before.time
        return {
            "call_hz": round((self.calls - before.calls) / seconds, 1),
            "publish_hz": round((self.published - before.published) / seconds, 1),
            "cpu_percent": round(100 * (self.cpu_s - before.cpu_s) / seconds, 1),
        }


class DiagnosticsReporter:
    """Publishes the ``statistics`` of a node on /diagnostics: once a second, more often until it is connected."""

    def __init__(
        self,
        ros: RosNode,
        statistics: NodeStatistics,
        connections: Sequence[Connection],
        lines: Callable[[], Sequence[InputQueue]],
        state: Callable[[], str],
    ) -> None:
        self._ros = ros
        self._statistics = statistics
        self._connections = connections
        self._lines = lines
        self._state = state
        self._ticks = itertools.count()
        self._lacking = ""
        self._usage = ResourceUsage(time.monotonic(), cpu_s=_cpu_s())
        self._rates: dict[str, float] = {}
        self._outlet = DiagnosticsPublisher(ros)
        self._timer = ros.create_timer(TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _tick(self) -> None:
        state = self._state()
        lacking = unconnected(self._connections) if state == "active" else state
        on_time = next(self._ticks) % TICKS_A_REPORT == 0
        if on_time:
            self._measure()
        if on_time or lacking != self._lacking:
            self._lacking = lacking
            self._outlet.publish([self._status(state, lacking)])

    def _measure(self) -> None:
        before, statistics = self._usage, self._statistics
        self._usage = ResourceUsage(time.monotonic(), statistics.calls, statistics.published, _cpu_s())
        self._rates = self._usage.rates_since(before)

    def _status(self, state: str, lacking: str) -> DiagnosticStatus:
        statistics, lines = self._statistics, self._lines()
        calls, ages = DurationStats.of(statistics.durations), DurationStats.of(statistics.ages)
        publication, block = statistics.take_longest_publication()
        values: dict[str, Any] = {
            "machine": machine(),
            "state": state,
            "restarts": restarts(),
            "last_error": os.environ.get(LAST_ERROR_VARIABLE, ""),
            "calls": statistics.calls,
            "failures": statistics.failures,
            "refused": statistics.refused,
            "refusals": ", ".join(f"{count} {reason}" for reason, count in sorted(statistics.refusals.items())),
            "first_failure": statistics.first_failure,
            "received": sum(line.received for line in lines),
            "skipped": sum(line.skipped for line in lines),
            "call_mean_ms": round(1000 * calls.mean, 3),
            "call_p50_ms": round(1000 * calls.p50, 3),
            "call_p99_ms": round(1000 * calls.p99, 3),
            "age_mean_ms": round(1000 * ages.mean, 1),
            "age_p99_ms": round(1000 * ages.p99, 1),
            "publish_max_ms": round(1000 * publication, 3),
            "publish_blocked_max_ms": round(1000 * block, 3),
            "pid": os.getpid(),
            **self._rates,
            **process_costs(),
            UNCONNECTED: lacking,
        }
        failing = statistics.failures or statistics.refused
        how = "refused messages" if failing else "running" if state == "active" else state
        return DiagnosticStatus(
            level=DiagnosticStatus.WARN if failing or lacking else DiagnosticStatus.OK,
            name=self._ros.get_name(),
            message=statistics.first_failure or how,
            hardware_id=machine(),
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def restarts() -> int:
    """How often a supervisor has started this process again."""
    return int(os.environ.get(RESTARTS_VARIABLE) or 0)


def machine() -> str:
    """The name of this machine."""
    return os.environ.get(MACHINE_VARIABLE) or gethostname()


def _cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def process_costs() -> dict[str, float]:
    """Processor seconds and memory (MB) of this process, now and at most."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    with open("/proc/self/statm", encoding="ascii") as statm:
        rss = int(statm.read().split()[1]) * PAGE_MB
    return {"cpu_s": round(_cpu_s(), 3), "rss_mb": round(rss, 1), "peak_rss_mb": round(peak, 1)}
