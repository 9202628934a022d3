"""Results of missions: their courses, times and problems."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from socialbot.agents.teams.messages import Missions, MissionView
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message


@dataclass
class MissionResult:
    """Course of a mission: its latest state, number of actions in the first plan, times (ns) and problems."""

    view: MissionView
    planned: int = 0
    began: int | None = None
    ended: int | None = None
    problems: list[str] = field(default_factory=list)

    def take(self, stamp: int, view: MissionView) -> None:
        """Update the result from the state of the mission at ``stamp`` (ns)."""
        if self.began is None and view.status == "running":
            self.began, self.planned = stamp, len(view.actions)
        has_failed = self.ended is None and view.status == "failed"
        if self.ended is None and view.status in ("finished", "failed"):
            self.ended = stamp
        if view.problem and (has_failed or view.recoveries > self.view.recoveries):
            self.problems.append(view.problem)
        self.view = view

    @property
    def finished(self) -> bool:
        return self.view.status == "finished"

    @property
    def took_s(self) -> float | None:
        """Time from the first plan to the end."""
        return None if self.began is None or self.ended is None else (self.ended - self.began) / SECOND

    def done(self, status: str = "done") -> int:
        """Number of actions with this status."""
        return sum(each.status == status for each in self.view.actions)

    def results(self) -> dict[str, Any]:
        """The result as plain data."""
        view = self.view
        return {
            "id": view.id,
            "kind": view.kind,
            "room": view.target,
            "status": view.status,
            "planned": self.planned,
            "done": self.done(),
            "failed": self.done("failed"),
            "problems": list(self.problems),
            "recoveries": view.recoveries,
            "revisions": view.revisions,
            "took_s": None if self.took_s is None else round(self.took_s, 3),
        }


@dataclass
class MissionResults:
    """Results of all missions of a run, by number."""

    missions: dict[int, MissionResult] = field(default_factory=dict)

    def take(self, message: Message) -> None:
        """Update the results from a message; ignore messages of other types."""
        if isinstance(message, Missions):
            for view in message.missions:
                self.missions.setdefault(view.id, MissionResult(view.untouched())).take(message.stamp, view)

    def sorted(self) -> list[MissionResult]:
        """The results by number."""
        return [result for _, result in sorted(self.missions.items())]
