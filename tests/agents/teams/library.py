"""The library of the examples, run inline."""

from __future__ import annotations

from socialbot.agents.teams import MissionView
from socialbot.agents.teams.messages import MISSIONS, AclMessage, Missions
from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Message
from socialbot.graph.inline import InlineRunner
from tests.example_modules import load_example

EXAMPLE = load_example("library")


class LibraryRun:
    """A run of the library; ``late`` are agents that are not there at the start."""

    def __init__(self, planner: str = "htn", faults: str = "", late: tuple[str, ...] = ()) -> None:
        graph = EXAMPLE.library(planner, faults)
        self.runner = InlineRunner(graph)
        self.heard: list[tuple[str, AclMessage]] = []
        self.views: dict[str, MissionView] = {}
        self.problems: set[str] = set()
        for topic in (topic for topic, kind in graph.topics().items() if kind is AclMessage):
            self.runner.tap(topic, self._hear)
        self.runner.tap(MISSIONS, self._view)
        for name in late:
            self.runner.kill(name)
        self.runner.start()

    def _hear(self, topic: str, message: Message) -> None:
        assert isinstance(message, AclMessage)
        self.heard.append((topic, message))

    def _view(self, topic: str, message: Message) -> None:
        assert isinstance(message, Missions)
        self.views.update((view.target, view) for view in message.missions)
        self.problems.update(view.problem for view in message.missions if view.problem)

    @property
    def said(self) -> list[AclMessage]:
        return [message for _, message in self.heard]

    def until(self, second: float) -> LibraryRun:
        self.runner.advance(nanoseconds(second))
        assert not {name: faults.first for name, faults in self.runner.faults.items() if faults.failures}
        return self

    def delivered(self) -> set[str]:
        """Books that lie on the desk, by the world itself."""
        loc = self.runner.nodes["world"].variables.loc  # type: ignore[attr-defined]
        return {book for book in EXAMPLE.BOOKS if loc.get(book) == EXAMPLE.DESK}
