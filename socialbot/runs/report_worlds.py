"""What the page of a run tells of the world in which its agents act: a film, figures, what came of it."""

from __future__ import annotations

from typing import Any, Protocol

from socialbot.agents.hospital.result import MissionsTold, ward_in
from socialbot.agents.hospital.ward.drawing import WardFilm
from socialbot.agents.hospital.ward.ward import Ward
from socialbot.agents.warehouse.drawing import Film
from socialbot.agents.warehouse.gripper import GripperAgent
from socialbot.agents.warehouse.scenario import GRIPPER, Scenario
from socialbot.core.messages import Message
from socialbot.graph.node import Graph


class World(Protocol):
    """A world as its sensors told of it; its picture at the end is kept in a file of the name ``file``."""

    file: str

    def take(self, message: Message) -> None:
        """Takes a message; those of other kinds are left alone."""
        ...

    def forget(self, stamp: int) -> None:
        """Forgets what was to be seen before ``stamp`` (ns), but for how things were by then."""
        ...

    def __bool__(self) -> bool:
        """Whether anything was seen."""
        ...

    def picture(self, stamp: int, title: str) -> str:
        """The world at ``stamp`` (ns), as SVG."""
        ...

    def film(self, start: int) -> dict[str, Any]:
        """Return the moving world from ``start`` (ns): ``picture`` (SVG with named groups), ``crane`` and tracks."""
        ...

    def figures(self, start: int, end: int) -> list[tuple[str, str]]:
        """Return figures with their labels."""
        ...

    def results(self, start: int, end: int) -> dict[str, Any]:
        """Return the result as plain data."""
        ...


def world_of(graph: Graph) -> World | None:
    """What tells of the world of ``graph``, with all its nodes; None where nothing does. Raises ParameterError."""
    for placement in graph.placements:
        if issubclass(placement.type, GripperAgent):
            return FloorTold(placement.type.cast)
    ward = ward_in(graph)
    return None if ward is None else WardTold(ward)


class FloorTold:
    """The floor of the warehouse."""

    file = "floor.svg"

    def __init__(self, cast: Scenario) -> None:
        self._film = Film(cast)

    def take(self, message: Message) -> None:
        self._film.take(message)

    def forget(self, stamp: int) -> None:
        self._film.forget(stamp)

    def __bool__(self) -> bool:
        return bool(self._film)

    def picture(self, stamp: int, title: str) -> str:
        return self._film.picture(stamp, title)

    def film(self, start: int) -> dict[str, Any]:
        return {"picture": self._film.picture(start), "crane": GRIPPER, **self._film.tracks(start)}

    def figures(self, start: int, end: int) -> list[tuple[str, str]]:
        holders = self.results(start, end)["boxes"].values()
        stored = sum(holder.startswith("deposit") for holder in holders)
        return [(f"{stored} of {len(holders)}", "boxes in their deposits")]

    def results(self, start: int, end: int) -> dict[str, Any]:
        """``boxes`` says what bears each box at the end."""
        return {"boxes": {box.name: box.holder for box in self._film.boxes(end)}}


class WardTold:
    """The ward of a hospital, and its missions."""

    file = "ward.svg"

    def __init__(self, ward: Ward) -> None:
        self._film = WardFilm(ward)
        self._told = MissionsTold()

    def take(self, message: Message) -> None:
        self._film.take(message)
        self._told.take(message)

    def forget(self, stamp: int) -> None:
        self._film.forget(stamp)

    def __bool__(self) -> bool:
        return bool(self._film)

    def picture(self, stamp: int, title: str) -> str:
        return self._film.picture(stamp, title)

    def film(self, start: int) -> dict[str, Any]:
        return {"picture": self._film.stage(start, "The ward"), "crane": "", **self._film.tracks(start)}

    def figures(self, start: int, end: int) -> list[tuple[str, str]]:
        missions = list(self._told.missions.values())
        finished = [mission for mission in missions if mission.finished]
        met = [mission for mission in missions if mission.problems]
        recovered = sum(mission.finished for mission in met)
        seconds = sorted(mission.took_s for mission in finished if mission.took_s is not None)
        tiles = [
            (f"{len(finished)} of {len(missions)}", "missions done"),
            (str(sum(len(mission.problems) for mission in missions)), "problems that agents told of"),
            (f"{recovered} of {len(met)}" if met else "-", "missions with a problem that were done all the same"),
            (str(sum(mission.view.revisions for mission in missions)), "plans revised before they met a problem"),
        ]
        return [*tiles, (f"{seconds[len(seconds) // 2]:.2f} s", "a mission takes (median)")] if seconds else tiles

    def results(self, start: int, end: int) -> dict[str, Any]:
        """``missions`` says how each went, ``infected`` which rooms are still to be disinfected."""
        rooms = self._film.state(end).rooms if self._film else ()
        return {
            "missions": [mission.results() for _, mission in sorted(self._told.missions.items())],
            "infected": [room.name for room in rooms if room.infected],
        }
