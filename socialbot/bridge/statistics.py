"""What a node costs and how it fares, published once a second on /diagnostics."""

from __future__ import annotations

import os
import resource
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node as RosNode

from socialbot.bridge.inbox import Inbox

WINDOW = 600
"""Over how many of the last calls percentiles are taken."""


@dataclass
class Statistics:
    """Counts of one node since its start, and the durations (s) of its last calls."""

    calls: int = 0
    failures: int = 0
    refused: int = 0
    first_failure: str = ""
    durations: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW))

    def note(self, seconds: float) -> None:
        """Counts one call."""
        self.calls += 1
        self.durations.append(seconds)

    def percentile(self, share: float) -> float:
        """The duration (s) that ``share`` of the last calls did not exceed; 0 before the first."""
        ordered = sorted(self.durations)
        return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else 0.0


def publish_statistics(ros: RosNode, statistics: Statistics, inbox: Inbox, period_s: float) -> None:
    """Publishes ``statistics`` on /diagnostics every ``period_s`` seconds of real time."""
    publisher = ros.create_publisher(DiagnosticArray, "/diagnostics", 10)
    steady = Clock(clock_type=ClockType.STEADY_TIME)

    def publish() -> None:
        array = DiagnosticArray(status=[_status(ros.get_name(), statistics, inbox)])
        array.header.stamp = ros.get_clock().now().to_msg()
        publisher.publish(array)

    ros.create_timer(period_s, publish, clock=steady)


def _status(name: str, statistics: Statistics, inbox: Inbox) -> DiagnosticStatus:
    values: dict[str, Any] = {
        "calls": statistics.calls,
        "failures": statistics.failures,
        "refused": statistics.refused,
        "first_failure": statistics.first_failure,
        "received": sum(line.received for line in inbox.lines),
        "skipped": sum(line.skipped for line in inbox.lines),
        "call_p50_ms": round(1000 * statistics.percentile(0.5), 3),
        "call_p99_ms": round(1000 * statistics.percentile(0.99), 3),
        "pid": os.getpid(),
        **_process(),
    }
    failing = statistics.failures or statistics.refused
    return DiagnosticStatus(
        level=DiagnosticStatus.WARN if failing else DiagnosticStatus.OK,
        name=name,
        message=statistics.first_failure or ("refused messages" if failing else "running"),
        hardware_id="",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )


def _process() -> dict[str, float]:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return {"cpu_s": round(usage.ru_utime + usage.ru_stime, 3), "peak_rss_mb": round(usage.ru_maxrss / 1024, 1)}
