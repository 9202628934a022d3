"""What comes of a run of the hospital: whether all is done, and how each mission went."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from socialbot.agents.hospital.messages import Missions, MissionView
from socialbot.agents.hospital.ward.messages import WardState
from socialbot.agents.hospital.ward.ward import Ward
from socialbot.agents.hospital.ward.world_node import HospitalWorld, ward_of
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Message
from socialbot.graph.node import Graph, check_parameters

QUIET_S = 0.5
"""A run is over when so long there was nothing to do."""


def ward_in(graph: Graph) -> Ward | None:
    """The ward of the hospital that ``graph`` runs; None where it has none. Raises ParameterError."""
    for placement in graph.placements:
        if issubclass(placement.type, HospitalWorld):
            return ward_of(check_parameters(placement.type, placement.parameters, where=placement.name))
    return None


@dataclass
class Infections:
    """Knows whether anything is left to do: infections to come, rooms to be disinfected, missions that are not over.

    Rooms of missions that were given up are left as they are.
    """

    ward: Ward
    _start: int | None = None
    _state: WardState | None = None
    _missions: dict[int, MissionView] = field(default_factory=dict)
    _quiet_since: int | None = None

    def observe(self, message: Message) -> None:
        """Takes a message of the run."""
        if isinstance(message, WardState):
            self._start = message.stamp if self._start is None else self._start
            self._state = message
        elif isinstance(message, Missions):
            self._missions.update((view.id, view) for view in message.missions)
        else:
            return
        if not self._is_quiet(message.stamp):
            self._quiet_since = None
        elif self._quiet_since is None:
            self._quiet_since = message.stamp

    def are_over(self, now: int) -> bool:
        """Whether there was nothing to do for `QUIET_S`."""
        return self._quiet_since is not None and now - self._quiet_since >= nanoseconds(QUIET_S)

    def _is_quiet(self, now: int) -> bool:
        if self._start is None or self._state is None:
            return False
        last_s = max((time_s for time_s, _ in self.ward.infections), default=0.0)
        if now <= self._start + nanoseconds(last_s):
            return False
        given_up = {view.room for view in self._missions.values() if view.status == "failed"}
        left = {room.name for room in self._state.rooms if room.infected}
        return left <= given_up and all(view.status in ("finished", "failed") for view in self._missions.values())


@dataclass
class MissionTold:
    """How a mission went: actions of its first plan, times (ns), and the mission as it was told of last."""

    view: MissionView
    planned: int = 0
    began: int | None = None
    ended: int | None = None
    problems: list[str] = field(default_factory=list)

    def take(self, stamp: int, view: MissionView) -> None:
        """Takes what is told of it at ``stamp`` (ns)."""
        if self.began is None and view.status == "running":
            self.began, self.planned = stamp, len(view.actions)
        is_given_up = self.ended is None and view.status == "failed"
        if self.ended is None and view.status in ("finished", "failed"):
            self.ended = stamp
        if view.problem and (is_given_up or view.recoveries > self.view.recoveries):
            self.problems.append(view.problem)
        self.view = view

    @property
    def finished(self) -> bool:
        """Whether it was done."""
        return self.view.status == "finished"

    @property
    def took_s(self) -> float | None:
        """From its first plan to its end."""
        return None if self.began is None or self.ended is None else (self.ended - self.began) / SECOND

    def done(self, status: str = "done") -> int:
        """How many of its actions were done; or failed."""
        return sum(each.status == status for each in self.view.actions)

    def results(self) -> dict[str, Any]:
        """As plain data."""
        view = self.view
        return {
            "id": view.id,
            "kind": view.kind,
            "room": view.room,
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
class MissionsTold:
    """All missions of a run, by number."""

    missions: dict[int, MissionTold] = field(default_factory=dict)

    def take(self, message: Message) -> None:
        """Takes a message; those of other kinds are left alone."""
        if isinstance(message, Missions):
            for view in message.missions:
                self.missions.setdefault(view.id, MissionTold(_unmet(view))).take(message.stamp, view)


def _unmet(view: MissionView) -> MissionView:
    """A mission before it met anything."""
    return MissionView(id=view.id, kind=view.kind, room=view.room, priority=view.priority, status="waiting")
