"""Result of a hospital run: its missions, its end, its event log and its world view."""

from __future__ import annotations

from typing import Any

from socialbot.agents.hospital.ward._drawing import WardAnimation
from socialbot.agents.hospital.ward.messages import WardState
from socialbot.agents.hospital.ward.ward import Ward
from socialbot.agents.hospital.ward.world_node import HospitalWorld, ward_of
from socialbot.agents.teams.event_log import TeamEventLog
from socialbot.agents.teams.messages import Missions, MissionView
from socialbot.agents.teams.results import MissionResults
from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Message
from socialbot.graph.node import Graph, check_parameters

QUIET_S = 0.5
"""A run is complete after this time without infected rooms and open missions."""


def ward_in(graph: Graph) -> Ward | None:
    """The ward of the hospital in ``graph``; None for a graph without one. Raises ParameterError."""
    for node in graph.nodes:
        if issubclass(node.type, HospitalWorld):
            return ward_of(check_parameters(node.type, node.parameters, where=node.name))
    return None


class MissionMonitor:
    """Completion check of a run: no infection to come, no infected room, no open mission.

    Rooms of failed missions may stay infected.
    """

    def __init__(self, ward: Ward) -> None:
        self._last_s = max((time_s for time_s, _ in ward.infections), default=0.0)
        self._last: int | None = None
        """Time of the last infection (ns)."""
        self._infected: set[str] = set()
        self._missions: dict[int, MissionView] = {}
        self._quiet_since: int | None = None

    def observe(self, message: Message) -> None:
        """Take a message of the run."""
        if isinstance(message, WardState):
            if self._last is None:
                self._last = message.stamp + nanoseconds(self._last_s)
            self._infected = {room.name for room in message.rooms if room.infected}
        elif isinstance(message, Missions):
            self._missions.update((view.id, view) for view in message.missions)
        else:
            return
        if not self._is_quiet(message.stamp):
            self._quiet_since = None
        elif self._quiet_since is None:
            self._quiet_since = message.stamp

    def are_over(self, now: int) -> bool:
        """Whether the run is complete at ``now`` (ns)."""
        return self._quiet_since is not None and now - self._quiet_since >= nanoseconds(QUIET_S)

    def _is_quiet(self, now: int) -> bool:
        if self._last is None or now <= self._last:
            return False
        given_up = {view.target for view in self._missions.values() if view.status == "failed"}
        is_open = any(view.status not in ("finished", "failed") for view in self._missions.values())
        return self._infected <= given_up and not is_open


class HospitalView(WardAnimation):
    """World view of a hospital run: its ward and its missions."""

    file = "ward.svg"
    kinds = (WardState, Missions)

    def __init__(self, ward: Ward) -> None:
        super().__init__(ward)
        self._results = MissionResults()

    def take(self, message: Message) -> None:
        super().take(message)
        self._results.take(message)

    def figures(self, start: int, end: int) -> list[tuple[str, str]]:
        """Numbers of missions, problems and new plans, and the median duration of a mission."""
        missions = self._results.sorted()
        finished = [mission for mission in missions if mission.finished]
        troubled = [mission for mission in missions if mission.problems]
        recovered = sum(mission.finished for mission in troubled)
        seconds = sorted(mission.took_s for mission in finished if mission.took_s is not None)
        figures = [
            (f"{len(finished)} of {len(missions)}", "missions done"),
            (str(sum(len(mission.problems) for mission in missions)), "problems reported by agents"),
            (f"{recovered} of {len(troubled)}" if troubled else "-", "missions done in spite of a problem"),
            (str(sum(mission.view.revisions for mission in missions)), "plans revised before a problem"),
        ]
        return [*figures, (f"{seconds[len(seconds) // 2]:.2f} s", "median time of a mission")] if seconds else figures

    def results(self, start: int, end: int) -> dict[str, Any]:
        """``missions``: their results. ``infected``: the rooms that still need disinfection."""
        rooms = self.state(end).rooms if self else ()
        return {
            "missions": [mission.results() for mission in self._results.sorted()],
            "infected": [room.name for room in rooms if room.infected],
        }

    def summary(self, start: int, end: int) -> list[str]:
        """Nothing: the terminal view prints the missions."""
        return []


def world_view(graph: Graph) -> HospitalView | None:
    """The world view of the hospital in ``graph``; None for a graph without one. Raises ParameterError."""
    ward = ward_in(graph)
    return None if ward is None else HospitalView(ward)


def completion(graph: Graph) -> MissionMonitor | None:
    """The completion check of the hospital in ``graph``; None for a graph without one. Raises ParameterError."""
    ward = ward_in(graph)
    return None if ward is None else MissionMonitor(ward)


def event_log(graph: Graph) -> TeamEventLog | None:
    """The event log of the hospital in ``graph``; None for a graph without a coordinator."""
    is_team = Missions in graph.topics().values()
    return TeamEventLog("{0} is infected", "the ward has changed") if is_team else None
