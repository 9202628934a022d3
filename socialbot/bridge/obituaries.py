"""Tells on /diagnostics of nodes that cannot do so themselves, as they are dead."""

from __future__ import annotations

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from socialbot.bridge.diagnostics import DiagnosticsOutlet
from socialbot.bridge.statistics import machine
from socialbot.bridge.supervisor import Member, Supervisor

EVERY_S = 1.0


class Obituaries:
    """Publishes through the rclpy node ``ros`` how the nodes of dead processes are: at each change, each second."""

    def __init__(self, ros: Any, supervisor: Supervisor) -> None:
        self._supervisor = supervisor
        self._outlet = DiagnosticsOutlet(ros)
        self._told: dict[str, str] = {}
        self._told_at = 0.0

    def tell(self) -> None:
        """Publishes what there is to tell, if it is time."""
        dead = [one for one in self._supervisor.members.values() if one.process is None]
        states = {one.name: f"{one.state}: {one.last_error}" for one in dead}
        now = time.monotonic()
        if not dead or (states == self._told and now < self._told_at + EVERY_S):
            self._told = states
            return
        self._told, self._told_at = states, now
        self._outlet.publish([_status(one, node) for one in dead for node in one.nodes])


def _status(member: Member, node: str) -> DiagnosticStatus:
    state = member.state
    values = {"machine": machine(), "state": state, "restarts": member.restarts, "last_error": member.last_error}
    return DiagnosticStatus(
        level=DiagnosticStatus.STALE if state == "ended" else DiagnosticStatus.ERROR,
        name=node,
        message=f"{state}: the process {member.last_error}" if member.last_error else state,
        hardware_id=machine(),
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
