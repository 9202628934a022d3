"""Publish the state of expectations on /diagnostics."""

from __future__ import annotations

from typing import Any

from socialbot.bridge.diagnostics import DiagnosticsPublisher, status_of
from socialbot.runs.expectations.monitor import BehaviourMonitor
from socialbot.runs.expectations.reporting import headline

PREFIX = "behaviour: "


class BehaviourDiagnostics:
    """Publishes one status for each expectation through the rclpy node ``ros``.

    The level is ERROR for a minute after a violation, else OK.
    """

    def __init__(self, ros: Any, monitor: BehaviourMonitor) -> None:
        self._publisher = DiagnosticsPublisher(ros)
        self._monitor = monitor

    def publish(self, now: int) -> None:
        """Publish all statuses at ``now`` (ns)."""
        statuses = []
        for name, state in self._monitor.states.items():
            violated = self._monitor.is_violated(name, now)
            text = "no violation" if not state.violations else "no violation in the last minute"
            if violated and state.verdict is not None and state.last is not None:
                text = headline(state.verdict, state.last)
            values = {
                "violations": state.violations,
                "last_violation_s": "" if state.last is None else f"{state.last.at_s:.3f}",
                "instance": "" if state.last is None else state.last.text,
                "verdict": "" if state.verdict is None else state.verdict.outcome,
            }
            statuses.append(status_of(f"{PREFIX}{name}", "ERROR" if violated else "OK", text, values))
        self._publisher.publish(statuses)
