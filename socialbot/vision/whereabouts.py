"""Where people were last seen on the floor, and where they may be while a camera looks elsewhere."""

from __future__ import annotations

import math
from dataclasses import dataclass

from socialbot.core.clock import SECOND
from socialbot.vision.distance import Estimate

_KNOWN_S = 30.0  # Where a person was seen tells something for this long.
_AHEAD_S = 6.0  # People who walk go on for at most this long, and may stop at any time.
_NEAR_M, _WANDER_MPS, _RADIUS_M = 0.4, 0.4, 2.5  # Radius of the search at first, its growth, and its limit.
_ERRORS = 2.0  # Standard errors of a distance that the search covers.
_FASTEST_MPS, _LEEWAY_M, _FAR_ERRORS = 2.5, 0.6, 3.0  # Nobody is farther from where they were.


@dataclass(frozen=True)
class FloorPoint:
    """Point on the floor in the base of the robot (m, forward and to the left), and its standard error."""

    x: float
    y: float
    std_m: float

    @classmethod
    def at(cls, distance: Estimate, bearing_rad: float) -> FloorPoint:
        """The point at a ``distance`` in a direction of the base."""
        return cls(distance.value * math.cos(bearing_rad), distance.value * math.sin(bearing_rad), distance.std)


@dataclass(frozen=True)
class LastSeen:
    """Point and velocity (m/s, forward and to the left) of a person at ``stamp`` (ns)."""

    stamp: int
    point: FloorPoint
    velocity: tuple[float, float] = (0.0, 0.0)

    def misfit(self, stamp: int, point: FloorPoint) -> float | None:
        """How far a ``point`` is from where the person may be at ``stamp`` (ns).

        People stay, or walk on and stop; the longer they are out of view, the farther from that they may be.

        Returns:
            0 at the expected place, 1 at the border of the search, infinity where nobody gets; None if unknown.
        """
        seconds = max(0.0, (stamp - self.stamp) / SECOND)
        if seconds > _KNOWN_S:
            return None
        across, along = point.x - self.point.x, point.y - self.point.y
        error = math.hypot(self.point.std_m, point.std_m)
        if math.hypot(across, along) > _FASTEST_MPS * seconds + _LEEWAY_M + _FAR_ERRORS * error:
            return math.inf
        ahead = min(seconds, _AHEAD_S)
        path = self.velocity[0] * ahead, self.velocity[1] * ahead
        length = path[0] ** 2 + path[1] ** 2
        share = min(max((across * path[0] + along * path[1]) / length, 0.0), 1.0) if length > 0 else 0.0
        away = math.hypot(across - share * path[0], along - share * path[1])
        return away / (min(_NEAR_M + _WANDER_MPS * seconds, _RADIUS_M) + _ERRORS * error)
