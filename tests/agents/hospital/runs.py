"""Runs of the hospital that tests look at: what was told in them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from socialbot.agents.hospital.demo import hospital
from socialbot.core.messages import Message, TraceRecord
from socialbot.graph.node import Graph
from socialbot.runs.report import RunReport
from socialbot.runtime.simulate import Run, RunResult, run


@dataclass
class Told:
    """A run, the messages and records that it was told by, and what its page is made of."""

    what: Run
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


def carried_out(graph: Graph, *, bag: Path | None = None) -> Told:
    """What a run of ``graph`` tells."""
    told = Told(Run(graph), RunReport(graph))

    def observe(topic: str, message: Message) -> None:
        told.report.observe(topic, message)
        told.messages.append(message)

    told.ran = run(told.what, Path(), observe, bag=bag)
    return told


@cache
def paper_run(rate: float, policy: str = "repair") -> Told:
    """The paper's mission, under a coordinator that does not look ahead."""
    return carried_out(hospital(rate=rate, coordinator={"proactive": False, "policy": policy}))
