"""Runs of the hospital with their messages."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from socialbot.agents.hospital.demo import hospital
from socialbot.core.messages import Message, TraceRecord
from socialbot.graph.node import Graph
from socialbot.runs.record import RunRecord
from socialbot.runs.report import RunReport
from socialbot.runtime.run import RunResult, run
from socialbot.runtime.simulated_source import SimulatedSource


@dataclass
class HospitalRun:
    """A run of ``graph`` recorded in ``folder``, with its messages."""

    graph: Graph
    folder: Path
    report: RunReport
    ran: RunResult = field(default_factory=RunResult)
    messages: list[Message] = field(default_factory=list)

    @property
    def records(self) -> list[TraceRecord]:
        """The records among them."""
        return [message for message in self.messages if isinstance(message, TraceRecord)]

    def of_kind(self, kind: str) -> list[TraceRecord]:
        """The records of a kind."""
        return [record for record in self.records if record.kind == kind]


def carried_out(graph: Graph, *, bag: Path | None = None) -> HospitalRun:
    """Runs ``graph`` inline."""
    recorded = HospitalRun(graph, Path(mkdtemp()), RunReport(graph))

    def observe(topic: str, message: Message) -> None:
        recorded.report.observe(topic, message)
        recorded.messages.append(message)

    with RunRecord(recorded.folder) as record:
        recorded.ran = run(
            graph, SimulatedSource(bag=bag), record, observe, summarize=lambda: recorded.report.story().results()
        )
    return recorded


@cache
def paper_run(rate: float, policy: str = "repair") -> HospitalRun:
    """The paper's mission, under a coordinator that does not look ahead."""
    return carried_out(hospital(rate=rate, coordinator={"proactive": False, "policy": policy}))
