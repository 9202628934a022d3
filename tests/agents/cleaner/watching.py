"""A graph of cleaners that runs inline, and what its agents put on their traces."""

from __future__ import annotations

from socialbot.agents.base.deliberating import Deliberating
from socialbot.core.messages import TraceRecord
from socialbot.graph.files import load_graph
from tests.inline import InlineRun


class Watched(InlineRun):
    """Runs a graph of the registry, with other parameters by the names of nodes."""

    def __init__(self, graph: str, **parameters: dict[str, object]) -> None:
        super().__init__(load_graph(graph), parameters=parameters)

    @property
    def records(self) -> list[TraceRecord]:
        return self.of(TraceRecord)

    def agent(self, name: str) -> Deliberating:
        """The agent of that name."""
        return self.node(name)

    def facts(self, name: str) -> list[str]:
        """Return the beliefs of an agent as text."""
        return [str(fact) for fact in self.agent(name).deliberator.facts.facts()]

    def told(self, kind: str, source: str = "cleaner") -> list[tuple[float, str]]:
        """Return the time (s) and the subject of each record of a kind."""
        return [
            (record.stamp / 1e9, record.what)
            for record in self.records
            if record.kind == kind and record.source == source
        ]

    def names(self, kind: str, source: str = "cleaner") -> list[str]:
        """Return the subjects of the records of a kind."""
        return [what for _, what in self.told(kind, source)]
