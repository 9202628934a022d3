"""What a node costs and how it fares, published once a second on /diagnostics."""

from __future__ import annotations

import itertools
import os
import resource
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from socket import gethostname
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node as RosNode

from socialbot.bridge.inbox import Line
from socialbot.bridge.readiness import UNCONNECTED, Connection, unconnected

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


@dataclass
class Statistics:
    """Counts of one node since its start, and the durations (s) of its last calls."""

    calls: int = 0
    failures: int = 0
    refusals: Counter[str] = field(default_factory=Counter)
    """Messages that were refused, by reason."""
    first_failure: str = ""
    durations: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW))

    @property
    def refused(self) -> int:
        """Messages that were refused."""
        return self.refusals.total()

    def note(self, seconds: float) -> None:
        """Counts one call."""
        self.calls += 1
        self.durations.append(seconds)

    def percentile(self, share: float) -> float:
        """The duration (s) that ``share`` of the last calls did not exceed; 0 before the first."""
        ordered = sorted(self.durations)
        return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else 0.0


class Reporter:
    """Publishes the ``statistics`` of a node on /diagnostics: once a second, more often until it is connected."""

    def __init__(
        self,
        ros: RosNode,
        statistics: Statistics,
        connections: Sequence[Connection],
        lines: Callable[[], Sequence[Line]],
        state: Callable[[], str],
    ) -> None:
        self._ros = ros
        self._statistics = statistics
        self._connections = connections
        self._lines = lines
        self._state = state
        self._ticks = itertools.count()
        self._lacking = ""
        self._publisher = ros.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._timer = ros.create_timer(TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _tick(self) -> None:
        state = self._state()
        lacking = unconnected(self._connections) if state == "active" else state
        if next(self._ticks) % TICKS_A_REPORT == 0 or lacking != self._lacking:
            self._lacking = lacking
            array = DiagnosticArray(status=[self._status(state, lacking)])
            array.header.stamp = self._ros.get_clock().now().to_msg()
            self._publisher.publish(array)

    def _status(self, state: str, lacking: str) -> DiagnosticStatus:
        statistics, lines = self._statistics, self._lines()
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
            "call_p50_ms": round(1000 * statistics.percentile(0.5), 3),
            "call_p99_ms": round(1000 * statistics.percentile(0.99), 3),
            "pid": os.getpid(),
            **_process(),
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


def _process() -> dict[str, float]:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return {"cpu_s": round(usage.ru_utime + usage.ru_stime, 3), "peak_rss_mb": round(usage.ru_maxrss / 1024, 1)}
