"""What sensors told of the floor during a run, as a film: where everything was at any moment."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, TypeVar

from socialbot.agents.warehouse.cast import GRIPPER, Cast
from socialbot.agents.warehouse.floor import Floor
from socialbot.agents.warehouse.messages import BoxPosition, BoxPositions, MoveStatus, Point
from socialbot.clock import SECOND
from socialbot.messages import Message

NEAR = (0.8, 0.8, 0.05)
"""A place that lies this near (pixels, pixels, m) to the straight way between two others is left out of a track."""

T = TypeVar("T")

Moment = tuple[float, ...]
"""s from the start, then what was so from then on."""


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
            _add(self._robots.setdefault(message.robot, []), message.stamp, message.current_pos)
        elif isinstance(message, BoxPositions):
            _add(self._boxes, message.stamp, message.boxes)

    def __bool__(self) -> bool:
        """Whether anything was seen."""
        return bool(self._boxes and self._robots)

    def boxes(self, stamp: int) -> tuple[BoxPosition, ...]:
        """Where the boxes were at ``stamp`` (ns)."""
        return _latest(self._boxes, stamp)

    def picture(self, stamp: int, title: str = "") -> str:
        """The floor at ``stamp`` (ns), as SVG; without a title it is that of `tracks`."""
        robots = {name: _latest(track, stamp) for name, track in self._robots.items()}
        floor = Floor(self.cast) if title else self._floor
        return floor.draw(robots, self.boxes(stamp), title)

    def tracks(self, start: int) -> dict[str, Any]:
        """How everything moves in the picture, for a page: by name, moments of s from ``start``, x and y (pixels).

        Those of boxes also have the height (m), to tell which covers which. ``holding`` says when the gripper has one.
        """
        moves: dict[str, list[Moment]] = {}
        for name, track in self._robots.items():
            moves[name] = _thinned([((stamp - start) / SECOND, *self._floor.at(point)) for stamp, point in track])
        held: list[Moment] = []
        boxes: dict[str, list[Moment]] = {}
        for stamp, found in self._boxes:
            second = (stamp - start) / SECOND
            for box in found:
                boxes.setdefault(box.name, []).append((second, *self._floor.box_at(box), box.position.z))
            holding = float(any(box.holder == GRIPPER for box in found))
            if not held or held[-1][1] != holding:
                held.append((round(second, 2), holding))
        return {"robots": moves, "boxes": {name: _thinned(track) for name, track in boxes.items()}, "holding": held}


def _add(track: list[tuple[int, T]], stamp: int, what: T) -> None:
    """Adds a moment, unless it lies in the past."""
    if not track or stamp > track[-1][0]:
        track.append((stamp, what))


def _latest(track: Sequence[tuple[int, Any]], stamp: int) -> Any:
    number = bisect_right(track, stamp, key=lambda moment: moment[0])
    return track[max(number - 1, 0)][1]


def _thinned(track: Sequence[Moment]) -> list[Moment]:
    """A track without the moments that lie near to the straight way between those that are kept."""
    kept: list[Moment] = []
    slopes: list[tuple[float, float]] = []
    for last, moment in pairwise(track):
        if not kept or not _lies_within(slopes, kept[-1], moment):
            kept.append(last)
            slopes = [(-math.inf, math.inf)] * (len(last) - 1)
        slopes = _narrowed(slopes, kept[-1], moment)
    return [tuple(round(value, 2) for value in moment) for moment in (*kept, *track[-1:])]


def _lies_within(slopes: Sequence[tuple[float, float]], first: Moment, moment: Moment) -> bool:
    """Whether the way from ``first`` to ``moment`` is no steeper than what lies between allows."""
    duration = moment[0] - first[0]
    changes = zip(slopes, first[1:], moment[1:], strict=True)
    return all(low <= (there - here) / duration <= high for (low, high), here, there in changes)


def _narrowed(slopes: Sequence[tuple[float, float]], first: Moment, moment: Moment) -> list[tuple[float, float]]:
    """How steep ways from ``first`` may be that also pass near to ``moment``."""
    duration = moment[0] - first[0]
    return [
        (max(low, (there - near - here) / duration), min(high, (there + near - here) / duration))
        for (low, high), here, there, near in zip(slopes, first[1:], moment[1:], NEAR, strict=False)
    ]
