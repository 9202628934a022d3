"""Who walks where and when: the corridor seen from a camera above the origin, which looks along +y."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RATE = 10
SECONDS = 42
GRID = 100
SMOOTH = 0.22


@dataclass(frozen=True)
class Role:
    """Waypoints (s, x m, y m, heading degrees; 0 faces the camera, 90 faces +x) and spans of stepping (s).

    arms: spans with a posture of the arms (start s, end s, posture); carries: what is in the hands or pushed.
    seated: spans on a seat (start s, end s, height of the seat m); the feet stay at the waypoint, the seat is behind
    it. rides: in a wheelchair, whose seat is at the waypoint.
    """

    waypoints: tuple[tuple[float, float, float, float], ...]
    stepping: tuple[tuple[float, float], ...]
    step: float
    gesture: tuple[float, float] | None = None
    arms: tuple[tuple[float, float, str], ...] = ()
    carries: str | None = None
    seated: tuple[tuple[float, float, float], ...] = ()
    rides: bool = False


ROLES = {
    "A": Role(
        waypoints=(
            (3.0, -2.9, 11.95, 90),
            (4.1, -1.45, 11.95, 90),
            (5.0, -0.35, 11.2, 20),
            (11.0, 0.1, 3.0, -4),
            (22.0, 0.1, 3.0, -4),
            (22.25, 0.1, 3.02, -30),
            (23.1, 0.25, 3.35, -170),
            (28.0, 0.55, 10.5, -170),
            (28.75, 1.35, 11.25, -100),
            (29.6, 2.7, 11.3, -90),
        ),
        stepping=((3.0, 11.25), (22.0, 29.6)),
        step=0.52,
        gesture=(15.2, 18.0),
    ),
    "B": Role(
        waypoints=(
            (30.6, -2.9, 11.95, 90),
            (31.7, -1.45, 11.95, 80),
            (32.4, -0.75, 11.2, 10),
            (37.9, -0.62, 3.6, 0),
            (40.5, -0.60, 0.85, 0),
            (42.0, -0.62, -0.9, 0),
        ),
        stepping=((30.6, 42.0),),
        step=0.5,
    ),
    "C": Role(
        waypoints=(
            (32.0, 2.6, 8.1, -90),
            (33.1, 1.3, 8.1, -90),
            (33.8, 0.75, 8.6, -165),
            (36.5, 0.45, 11.2, -150),
            (37.2, -0.3, 11.85, -100),
            (38.9, -2.7, 11.95, -90),
        ),
        stepping=((32.0, 38.9),),
        step=0.57,
    ),
}


class Track:
    """A role's smooth position and heading over time."""

    def __init__(self, role: Role) -> None:
        """Filters the waypoints in time, which rounds corners and softens starts and stops."""
        times, *values = np.array(role.waypoints).T
        self.grid = np.arange(times[0] - 1, times[-1] + 1, 1 / GRID)
        spread = np.arange(-4 * SMOOTH, 4 * SMOOTH, 1 / GRID)
        kernel = np.exp(-0.5 * (spread / SMOOTH) ** 2)
        pad = len(kernel) // 2
        self.rows = []
        for value in values:
            wide = np.pad(np.interp(self.grid, times, value), (pad, len(kernel) - 1 - pad), mode="edge")
            self.rows.append(np.convolve(wide, kernel / kernel.sum(), mode="valid"))

    def __call__(self, time: np.ndarray | float) -> np.ndarray:
        """x, y (m) and heading (rad) at a time or at many."""
        x, y, heading = (np.interp(time, self.grid, row) for row in self.rows)
        return np.stack([x, y, np.radians(heading)], -1)


def present(role: Role, time: float) -> bool:
    """Whether the person is anywhere near the corridor."""
    return role.waypoints[0][0] <= time <= role.waypoints[-1][0]
