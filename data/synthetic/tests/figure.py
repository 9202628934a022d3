"""A small skeleton of an adult, so that walking can be tested without the shapes that Blender poses."""

from __future__ import annotations

from itertools import pairwise

import gait
import numpy as np
import posture
import visits

STATURE = 1.8

# Rest joints in metres, the left one of each pair: label, parent, x, y, z; soles on z = 0, facing -y.
MIDDLE = (
    ("root", None, 0.0, 0.06, 0.93),
    ("spine05", "root", 0.0, -0.01, 0.95),
    ("spine03", "spine05", 0.0, 0.01, 1.12),
    ("neck01", "spine03", 0.0, -0.02, 1.52),
    ("head", "neck01", 0.0, -0.05, 1.62),
)
LEFT = (
    ("eye", "head", 0.03, -0.14, 1.66),
    ("upperleg01", "root", 0.12, 0.0, 0.945),
    ("upperleg02", "upperleg01", 0.122, -0.026, 0.853),
    ("lowerleg01", "upperleg02", 0.15, -0.037, 0.53),
    ("foot", "lowerleg01", 0.2, -0.013, 0.1),
    ("toe2-1", "foot", 0.2, -0.167, 0.05),
    ("clavicle", "spine03", 0.023, -0.031, 1.45),
    ("upperarm01", "clavicle", 0.176, -0.025, 1.42),
    ("lowerarm01", "upperarm01", 0.357, -0.028, 1.215),
    ("lowerarm02", "lowerarm01", 0.423, -0.123, 1.155),
    ("wrist", "lowerarm02", 0.491, -0.216, 1.085),
    ("metacarpal2", "wrist", 0.503, -0.246, 1.069),
    ("finger3-1", "metacarpal2", 0.538, -0.302, 1.032),
    ("finger1-1", "wrist", 0.492, -0.265, 1.079),
)
SINGLE = {label for label, *_ in MIDDLE}


def skeleton(stature: float = STATURE):
    """The joints of somebody that tall (m)."""
    rows = list(MIDDLE)
    for label, parent, x, y, z in LEFT:
        for side, sign in gait.SIDES.items():
            rows.append((f"{label}.{side}", parent if parent in SINGLE else f"{parent}.{side}", sign * x, y, z))
    labels = [label for label, *_ in rows]
    parents = np.array([-1 if parent is None else labels.index(parent) for _, parent, *_ in rows])
    return gait.Skeleton(labels, parents, np.array([row[2:] for row in rows], float) * stature / STATURE)


def build(bones):
    """Landmarks of a trunk in thin clothes."""
    size = bones.head("head")[2] / 1.62
    reach = sum(
        float(np.linalg.norm(bones.head(f"{b}.L") - bones.head(f"{a}.L")))
        for a, b in pairwise(("upperarm01", "lowerarm01", "wrist"))
    )
    eye = bones.head("eye.L") * [0, 1, 1]
    hip = float(bones.head("upperleg01.L")[2])
    return posture.Build(bones.head("upperarm01.L"), eye, hip, reach, -0.15 * size, -0.16 * size, 0.18 * size)


def walker(role, stature: float = STATURE, seed: int = 1):
    """Somebody that tall who plays a role."""
    bones = skeleton(stature)
    return gait.Walker(bones, role, seed, build(bones))


class Stepper(gait.Walker):
    """Footsteps alone, which are planned at once; not to be posed."""

    def __init__(self, role) -> None:
        bones = skeleton()
        super().__init__(bones, role, 1, build(bones))

    def body_tracks(self, seed: int) -> dict[str, np.ndarray]:
        return {}


def walk(speed: float = 1.25, metres: float = 6.0, step: float = 0.53):
    """A straight walk towards the camera and a stand at its end."""
    return visits.visit("X", 0.0, (0.0, 2.0 + metres), visits.Go(0, 2, speed), visits.Stay(3.0), step=step).role


def joint(someone, transforms: np.ndarray, label: str) -> np.ndarray:
    """Where a joint is in the world."""
    return moved(someone, transforms, label, someone.skeleton.head(label))


def moved(someone, transforms: np.ndarray, label: str, point: np.ndarray) -> np.ndarray:
    """Where a point at rest is taken by a bone."""
    bone = transforms[someone.skeleton.index[label]]
    return bone[:, :3] @ point + bone[:, 3]
