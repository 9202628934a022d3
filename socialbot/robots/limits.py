"""Limits of joints: clamp positions, and stretch motions to the highest speed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from socialbot.core.clock import SECOND
from socialbot.core.errors import MessageError

FRESH_S = 0.5
"""Age (s) from which joint states do not count."""

WIDEST_RAD = 6.3
"""Largest position (rad) of a head joint: a full turn to either side, rounded up as in URDFs."""


@dataclass(frozen=True)
class JointLimits:
    """Limits of a joint: positions in rad, speed in rad/s."""

    lower: float
    upper: float
    speed: float

    def clamp(self, position: float) -> float:
        """Return the nearest position within the limits."""
        return min(max(position, self.lower), self.upper)


@dataclass(frozen=True)
class JointMotion:
    """Motion of joints at constant speed from ``start`` to ``target``, begun at ``begin`` (ns)."""

    start: Mapping[str, float]
    target: Mapping[str, float]
    begin: int
    duration_s: float

    def at(self, time: int) -> dict[str, float]:
        """The positions at ``time`` (ns)."""
        share = min(max((time - self.begin) / SECOND / self.duration_s, 0.0), 1.0)
        return {joint: start + share * (self.target[joint] - start) for joint, start in self.start.items()}


def checked_target(
    joints: Sequence[str], positions: Sequence[float], limits: Mapping[str, JointLimits], *, where: str
) -> dict[str, float]:
    """Return the position of each joint, clamped to its limits.

    Raises:
        MessageError: A joint is unknown, there are more or fewer positions than joints, or a position is not finite.
    """
    if len(joints) != len(positions) or not joints:
        raise MessageError(
            f"{len(positions)} positions for {len(joints)} joints", where=where, remedy="send one position per joint"
        )
    for joint, position in zip(joints, positions, strict=True):
        if joint not in limits:
            raise MessageError(f"unknown joint {joint!r}", where=where, remedy=f"use {', '.join(limits)}")
        if not math.isfinite(position):
            raise MessageError(f"position {position} of joint {joint!r}", where=where, remedy="send finite numbers")
    return {joint: limits[joint].clamp(position) for joint, position in zip(joints, positions, strict=True)}


def least_duration_s(
    start: Mapping[str, float] | None, target: Mapping[str, float], limits: Mapping[str, JointLimits]
) -> float:
    """Return the shortest duration within the speeds. From an unknown start it is that of the longest way."""
    return max(
        (abs(position - start[joint]) if start else _longest_way(position, limits[joint])) / limits[joint].speed
        for joint, position in target.items()
    )


def _longest_way(position: float, limits: JointLimits) -> float:
    return max(limits.upper - position, position - limits.lower)
