"""What arms do beside hanging and swinging: targets for the wrists, reached by bending the elbow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from story import Role

EASE = 0.6
LOADS = {"box": "carry", "trolley": "push", "case": "case", "plank": "plank", "wheelchair": "rims"}


@dataclass(frozen=True)
class Reach:
    """One arm's goal at rest coordinates of the trunk, mirrored for the right arm (x grows outwards).

    wrist: place. elbow: direction in which the elbow points. thumb: direction of the thumb's side of the forearm.
    hand: direction of the fingers, None along the forearm. curl: how much fingers bend, 1 the usual. waving: metres
    the wrist swings.
    """

    wrist: np.ndarray
    elbow: tuple[float, float, float]
    thumb: tuple[float, float, float]
    hand: tuple[float, float, float] | None = None
    curl: float = 1.0
    waving: float = 0.0


@dataclass(frozen=True)
class Build:
    """Landmarks of a dressed trunk at rest: joints, front of the chest and of the belly, half width at the hips."""

    shoulder: np.ndarray
    eye: np.ndarray
    hip: float
    reach: float
    chest: float
    belly: float
    side: float


def reaches(posture: str, build: Build) -> dict[str, Reach]:
    """Goals of the arms that take part."""
    x, y, z = build.shoulder
    if posture == "wave":
        wrist = np.array([x + 0.19, y - 0.24, z + 0.13])
        return {"R": Reach(wrist, (0.6, 0.1, -1), (-1, 0, 0.2), (0.05, 0, 1), 0.3, 0.09)}
    if posture == "phone":
        wrist = build.eye * [0, 1, 1] + [0.125, 0.055, -0.125]
        return {"R": Reach(wrist, (0.5, -0.5, -1), (0, 1, 0.3), (-0.25, 0.25, 1), 1.6)}
    if posture == "reading":
        wrist = np.array([0.09, build.chest - 0.21, z - 0.19])
        return {"R": Reach(wrist, (0.5, 0.3, -1), (0.2, -0.3, 1), (-0.65, -0.45, 0.5), 1.6)}
    if posture == "crossed":
        elbow, thumb = (0.45, 0.3, -1), (0, -0.3, 1)
        left = Reach(np.array([-0.1, build.chest - 0.07, z - 0.25]), elbow, thumb, (-0.8, 0.7, -0.1), 0.9)
        right = Reach(np.array([-0.09, build.chest - 0.13, z - 0.23]), elbow, thumb, (-0.75, 0.8, -0.05), 0.9)
        return {"L": left, "R": right}
    if posture == "pockets":
        wrist = np.array([build.side + 0.035, y - 0.07, build.hip + 0.05])
        return dict.fromkeys("LR", Reach(wrist, (0.6, 1, 0), (0, -1, 0.1), (-0.15, -0.3, -1), 0.6))
    if posture == "hips":
        wrist = np.array([build.side + 0.05, y + 0.0, build.hip + 0.16])
        return dict.fromkeys("LR", Reach(wrist, (1, 0.5, 0), (0, 0.9, 0.5), (-0.5, -0.8, -0.35), 0.8))
    if posture == "carry":
        wrist = np.array([0.215, build.belly - 0.2, z - 0.36])
        return dict.fromkeys("LR", Reach(wrist, (0.7, 0.6, -1), (0, 0, 1), (-0.1, -1, 0.05), 0.4))
    if posture == "push":
        wrist = np.array([0.22, y - 0.43, min(1.0, z - 0.35)])
        return dict.fromkeys("LR", Reach(wrist, (0.5, 0.4, -1), (-1, 0, 0.1), (0, -1, 0), 2.6))
    if posture == "case":
        wrist = np.array([x + 0.07, y - 0.02, z - 0.98 * build.reach])
        return {"R": Reach(wrist, (0.3, 1, 0), (0, -1, 0), (0, 0, -1), 3.2)}
    if posture == "plank":
        wrist = np.array([x + 0.09, y - 0.12, z - 0.86 * build.reach])
        return {"R": Reach(wrist, (0.4, 1, 0), (0, -1, 0), (0.05, -0.25, -1), 2.4)}
    if posture == "lap":
        wrist = np.array([0.115, y - 0.3, build.hip + 0.155])
        return dict.fromkeys("LR", Reach(wrist, (0.6, 0.6, -0.6), (-0.8, 0, 0.5), (-0.25, -0.9, -0.25), 1.2))
    if posture == "rims":
        wrist = np.array([max(build.side + 0.06, 0.29), y - 0.1, build.hip + 0.13])
        return dict.fromkeys("LR", Reach(wrist, (0.4, 1, 0), (0, -1, 0.2), (0, -0.45, -1), 2.2))
    raise ValueError(f"unknown posture {posture!r}")


def smooth_step(value: float) -> float:
    """0 to 1 without corners."""
    value = min(max(value, 0.0), 1.0)
    return value * value * (3 - 2 * value)


class Postures:
    """The postures of one role over time."""

    def __init__(self, role: Role, build: Build) -> None:
        """A load is carried all the time; spans of the role go before it."""
        spans = [(-np.inf, np.inf, LOADS[role.carries])] if role.carries in LOADS else []
        self.spans = [(start, end, posture, reaches(posture, build)) for start, end, posture in [*spans, *role.arms]]

    def share(self, time: float, posture: str) -> float:
        """How far a posture is taken, 0..1."""
        return max((self.fade(time, start, end) for start, end, name, _ in self.spans if name == posture), default=0.0)

    def fade(self, time: float, start: float, end: float) -> float:
        """1 inside a span, easing at its ends."""
        return smooth_step((time - start) / EASE) * smooth_step((end - time) / EASE)

    def goals(self, time: float, side: str) -> list[tuple[float, Reach]]:
        """Shares and goals of one arm, in the order in which they are laid over each other."""
        found = [(self.fade(time, start, end), goals.get(side)) for start, end, _, goals in self.spans]
        return [(share, goal) for share, goal in found if goal is not None and share > 0]


def slerp(start: np.ndarray, end: np.ndarray, share: float) -> np.ndarray:
    """A rotation between two."""
    turn = start.T @ end
    angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
    if angle < 1e-6:
        return start
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    if np.linalg.norm(axis) < 1e-6:
        half = turn + np.eye(3)
        axis = half[:, np.argmax(np.diag(half))]
    axis = axis / np.linalg.norm(axis)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    part = angle * share
    return start @ (np.eye(3) + np.sin(part) * cross + (1 - np.cos(part)) * cross @ cross)
