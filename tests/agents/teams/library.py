"""The library of the examples, run inline."""

from __future__ import annotations

from socialbot.agents.teams import MissionView
from socialbot.agents.teams.messages import MISSIONS, AclMessage
from tests.example_modules import load_example
from tests.inline import InlineRun

EXAMPLE = load_example("library")


class LibraryRun(InlineRun):
    """A run of the library; ``late`` are agents that are not there at the start."""

    def __init__(self, planner: str = "htn", faults: str = "", late: tuple[str, ...] = ()) -> None:
        super().__init__(EXAMPLE.library(planner, faults), without=late)

    @property
    def heard(self) -> list[AclMessage]:
        return self.of(AclMessage)

    @property
    def views(self) -> dict[str, MissionView]:
        """The latest view of each mission, by target."""
        return {view.target: view for message in self.messages(MISSIONS) for view in message.missions}

    @property
    def problems(self) -> set[str]:
        return {view.problem for message in self.messages(MISSIONS) for view in message.missions if view.problem}

    def delivered(self) -> set[str]:
        """Books that lie on the desk, by the world itself."""
        loc = self.node("world").variables.loc
        return {book for book in EXAMPLE.BOOKS if loc.get(book) == EXAMPLE.DESK}
