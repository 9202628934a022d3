"""Runs of the hospital that tests look at: what was told in them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from socialbot.agents.hospital.graphs import hospital
from socialbot.demo import Ran, Run, run
from socialbot.graph import Graph
from socialbot.messages import Message, TraceRecord
from socialbot.run_report import RunReport


@dataclass
class Told:
    """A run, the messages and records that it was told by, and what its page is made of."""

    what: Run
    report: RunReport
    ran: Ran = field(default_factory=Ran)
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
