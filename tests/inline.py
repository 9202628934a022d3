"""Graphs that run in one thread and simulated time, for tests that look at their messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from socialbot.core.clock import SECOND
from socialbot.core.messages import Message
from socialbot.graph.node import Graph
from socialbot.testing import GraphTester

M = TypeVar("M", bound=Message)
R = TypeVar("R", bound="InlineRun")


class InlineRun(GraphTester):
    """A graph that runs from the start, without some of its nodes at first."""

    def __init__(
        self, graph: Graph, *, parameters: Mapping[str, Any] | None = None, start: int = 0, without: Iterable[str] = ()
    ) -> None:
        super().__init__(graph, parameters=parameters, start=start)
        self.begin = start
        self._published = {topic for config in self.graph.nodes for topic, _ in config.publications}
        for name in without:
            self.runner.kill(name)
        self.runner.start()

    def until(self: R, second: float) -> R:
        """Advance the time to this second of the run; fail if a node has failed."""
        self.runner.advance(self.begin + round(second * SECOND))
        assert not {name: faults.first for name, faults in self.runner.faults.items() if faults.failures}
        return self

    @property
    def said(self) -> list[tuple[str, Message]]:
        """Topic and message of all that nodes have published."""
        return [(topic, message) for topic, _, message in self._seen if topic in self._published]

    def of(self, kind: type[M], topic: str = "") -> list[M]:
        """Published messages of a type, on one topic or on all."""
        return [message for name, message in self.said if isinstance(message, kind) and topic in ("", name)]
