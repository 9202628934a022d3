"""A graph of cleaners that runs inline, and what its agents put on their traces."""

from __future__ import annotations

from socialbot.agents.base.deliberating import Deliberating
from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Message, TraceRecord
from socialbot.graph.files import load_graph
from socialbot.graph.inline import InlineRunner


class Watched:
    """Runs a graph of the registry, with other parameters by the names of nodes."""

    def __init__(self, graph: str, **parameters: dict[str, object]) -> None:
        self.runner = InlineRunner(load_graph(graph).with_parameters(parameters))
        self.records: list[TraceRecord] = []
        for name in self.runner.nodes:
            self.runner.tap(f"/{name}/trace", self._note)
        self.runner.start()

    def _note(self, topic: str, message: Message) -> None:
        assert isinstance(message, TraceRecord)
        self.records.append(message)

    def run(self, until_s: float) -> None:
        """Advance the time; fail if a node has failed."""
        self.runner.advance(nanoseconds(until_s))
        assert all(not faults.failures for faults in self.runner.faults.values()), self.runner.faults

    def agent(self, name: str) -> Deliberating:
        """The agent of that name."""
        node = self.runner.nodes[name]
        assert isinstance(node, Deliberating)
        return node

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
