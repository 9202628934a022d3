"""Where the joints of a head are, by what they were told; for viewers, where no driver says it."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from socialbot.bridge.mounting import AHEAD, HeadPose, parameters_of
from socialbot.clock import SECOND
from socialbot.graph import Graph
from socialbot.messages import JointTrajectory

if TYPE_CHECKING:
    from socialbot.inspect.streams import Pose

HEAD_HZ = 20.0
"""How often others are told where a head is."""

_KEPT = 32
"""So many turns of each joint are remembered: of at least three seconds, as a head is told ten times a second."""


@dataclass(frozen=True)
class Neck:
    """The joints by which the head of a graph pans and tilts."""

    pan: str
    tilt: str


def neck_of(graph: Graph) -> Neck | None:
    """The neck of the first node of ``graph`` that turns a head; None when there is no such node."""
    values = parameters_of(graph, "pan_joint", "tilt_joint")
    return Neck(values["pan_joint"], values["tilt_joint"]) if values else None


@dataclass(frozen=True)
class Turn:
    """A joint on its way (rad) from ``start`` to ``target`` since ``begin`` (ns)."""

    start: float
    target: float
    begin: int
    duration_s: float

    def at(self, stamp: int) -> float:
        """Where it is at ``stamp`` (ns)."""
        if self.duration_s <= 0:
            return self.target
        share = min(max((stamp - self.begin) / SECOND / self.duration_s, 0.0), 1.0)
        return self.start + share * (self.target - self.start)


class Joints:
    """The joints called ``names``: at 0 until they are told to go elsewhere."""

    def __init__(self, names: Iterable[str]) -> None:
        self._turns = {name: deque([Turn(0.0, 0.0, 0, 0.0)], maxlen=_KEPT) for name in names}

    @property
    def names(self) -> tuple[str, ...]:
        """What they are called."""
        return tuple(self._turns)

    def tell(self, told: JointTrajectory) -> None:
        """They are ``told`` to go elsewhere; joints that are none of these do not count."""
        for name, target in zip(told.joint_names, told.positions, strict=False):
            if name in self._turns and math.isfinite(target):
                start = self.at(name, told.stamp)
                self._turns[name].append(Turn(start, target, told.stamp, told.duration_s))

    def at(self, name: str, stamp: int) -> float:
        """Where (rad) the joint ``name`` is, or was, at ``stamp`` (ns)."""
        turns = self._turns[name]
        return next((turn for turn in reversed(turns) if turn.begin <= stamp), turns[0]).at(stamp)


class HeadCourse:
    """Where a head was at any time of a run, by the poses that it was told to take, which are in order."""

    def __init__(self, poses: Iterable[Pose]) -> None:
        self._begins: list[int] = []
        self._turns: list[tuple[Turn, Turn]] = []
        for stamp, pan, tilt, duration_s in poses:
            start = self.at(stamp)
            self._begins.append(stamp)
            self._turns.append(
                (Turn(start.pan, pan, stamp, duration_s), Turn(start.tilt, tilt, stamp, duration_s)),
            )

    def at(self, stamp: int) -> HeadPose:
        """Where it pointed at ``stamp`` (ns)."""
        begun = bisect_right(self._begins, stamp)
        if not begun:
            return AHEAD
        pan, tilt = self._turns[begun - 1]
        return HeadPose(pan.at(stamp), tilt.at(stamp))
