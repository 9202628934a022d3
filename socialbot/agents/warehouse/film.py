"""What sensors told of the floor during a run, as a film: where everything was at any moment."""

from __future__ import annotations

from typing import Any

from socialbot.agents.warehouse.cast import GRIPPER, Cast
from socialbot.agents.warehouse.floor import Floor
from socialbot.agents.warehouse.messages import BoxPosition, BoxPositions, MoveStatus, Point
from socialbot.clock import SECOND
from socialbot.messages import Message
from socialbot.report.tracks import Moment, add, forget, latest, thinned


class Film:
    """Takes the messages of sensors as they come; `at` and `tracks` tell of them."""

    def __init__(self, cast: Cast) -> None:
        self.cast = cast
        self._floor = Floor(cast, head=0.0)
        self._robots: dict[str, list[tuple[int, Point]]] = {}
        self._boxes: list[tuple[int, tuple[BoxPosition, ...]]] = []

    def take(self, message: Message) -> None:
        """Takes a message; those of other kinds are left alone."""
        if isinstance(message, MoveStatus):
            add(self._robots.setdefault(message.robot, []), message.stamp, message.current_pos)
        elif isinstance(message, BoxPositions):
            add(self._boxes, message.stamp, message.boxes)

    def forget(self, stamp: int) -> None:
        """Forgets what was before ``stamp`` (ns), but for where everything was by then."""
        for track in self._robots.values():
            forget(track, stamp)
        forget(self._boxes, stamp)

    def __bool__(self) -> bool:
        """Whether anything was seen."""
        return bool(self._boxes and self._robots)

    def boxes(self, stamp: int) -> tuple[BoxPosition, ...]:
        """Where the boxes were at ``stamp`` (ns)."""
        return latest(self._boxes, stamp)

    def picture(self, stamp: int, title: str = "") -> str:
        """The floor at ``stamp`` (ns), as SVG; without a title it is that of `tracks`."""
        robots = {name: latest(track, stamp) for name, track in self._robots.items()}
        floor = Floor(self.cast) if title else self._floor
        return floor.draw(robots, self.boxes(stamp), title)

    def tracks(self, start: int) -> dict[str, Any]:
        """How everything moves in the picture, for a page: by name, moments of s from ``start``, x and y (pixels).

        Those of boxes also have the height (m), to tell which covers which. ``holding`` says when the gripper has one.
        """
        moves: dict[str, list[Moment]] = {}
        for name, track in self._robots.items():
            moves[name] = thinned([((stamp - start) / SECOND, *self._floor.at(point)) for stamp, point in track])
        held: list[Moment] = []
        boxes: dict[str, list[Moment]] = {}
        for stamp, found in self._boxes:
            second = (stamp - start) / SECOND
            for box in found:
                boxes.setdefault(box.name, []).append((second, *self._floor.box_at(box), box.position.z))
            holding = float(any(box.holder == GRIPPER for box in found))
            if not held or held[-1][1] != holding:
                held.append((round(second, 2), holding))
        return {"robots": moves, "boxes": {name: thinned(track) for name, track in boxes.items()}, "holding": held}
