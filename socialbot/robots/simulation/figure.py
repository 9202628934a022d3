"""Simulated people: their appearance, and an articulated body of 13 segments with clothes, hair and a face.

Axes of every segment: x ahead, y left, z up, in m. The origin of a segment is its joint.
"""

from __future__ import annotations

import colorsys
import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Looks:
    """Appearance of a person.

    Attributes:
        height_m: Height.
        build: Width in relation to the usual one.
        shape: Proportions of shoulders and hips.
    """

    height_m: float = 1.73
    build: float = 1.0
    shape: Literal["narrow", "wide"] = "wide"
    skin: Colour = (0.80, 0.60, 0.48)
    hair: Colour = (0.16, 0.10, 0.07)
    hair_style: Literal["short", "long", "bun", "bald"] = "short"
    top: Colour = (0.25, 0.35, 0.55)
    sleeves: Literal["long", "short"] = "long"
    jacket: Colour | None = None
    legs: Colour = (0.15, 0.17, 0.25)
    lower: Literal["trousers", "skirt", "shorts"] = "trousers"
    shoes: Colour = (0.08, 0.07, 0.06)
    bag: Colour | None = None
    beard: bool = False


_SKINS = (
    (0.93, 0.74, 0.63), (0.87, 0.67, 0.54), (0.78, 0.58, 0.45),
    (0.62, 0.44, 0.33), (0.45, 0.30, 0.22), (0.33, 0.22, 0.16),
)  # fmt: skip
_HAIRS = ((0.10, 0.08, 0.07), (0.20, 0.13, 0.08), (0.36, 0.22, 0.12), (0.62, 0.47, 0.26), (0.55, 0.54, 0.52))
_TROUSERS = ((0.13, 0.16, 0.26), (0.08, 0.08, 0.09), (0.30, 0.28, 0.25), (0.42, 0.36, 0.27), (0.20, 0.25, 0.35))
_SHOES = ((0.07, 0.06, 0.06), (0.28, 0.17, 0.10), (0.75, 0.74, 0.72))


def random_looks(rng: random.Random) -> Looks:
    """Draw the appearance of a person."""
    shape: Literal["narrow", "wide"] = rng.choice(("narrow", "wide"))
    skin = rng.choice(_SKINS)
    light = sum(skin) > 1.5
    style = rng.choice(("short", "short", "short", "bald") if shape == "wide" else ("long", "bun", "short"))
    jacket = _cloth(rng, 0.12, 0.5) if rng.random() < 0.4 else None
    lower = rng.choice(("trousers",) * 5 + (("skirt",) * 2 if shape == "narrow" else ("shorts",)))
    return Looks(
        height_m=round(rng.gauss(1.77 if shape == "wide" else 1.66, 0.06), 3),
        build=round(min(max(rng.gauss(1.0, 0.09), 0.86), 1.25), 3),
        shape=shape,
        skin=skin,
        hair=rng.choice(_HAIRS if light else _HAIRS[:2]),
        hair_style=style,  # type: ignore[arg-type]
        top=_cloth(rng, 0.25, 0.95),
        sleeves="long" if jacket or rng.random() < 0.6 else "short",
        jacket=jacket,
        legs=rng.choice(_TROUSERS),
        lower=lower,  # type: ignore[arg-type]
        shoes=rng.choice(_SHOES),
        bag=_cloth(rng, 0.15, 0.5) if rng.random() < 0.25 else None,
        beard=shape == "wide" and rng.random() < 0.3,
    )


def _cloth(rng: random.Random, dark: float, bright: float) -> Colour:
    return colorsys.hsv_to_rgb(rng.random(), rng.choice((0.08, 0.35, 0.6, 0.75)), rng.uniform(dark, bright))


SEGMENTS = (
    "pelvis", "chest", "head", "upper_arm_l", "upper_arm_r", "forearm_l", "forearm_r",
    "thigh_l", "thigh_r", "shin_l", "shin_r", "foot_l", "foot_r",
)  # fmt: skip
"""Names of the segments of a body."""

_AROUND = 16  # Points around a segment.
_REFERENCE_M = 1.73  # Height of the body with the sizes below.

HIP_Z, KNEE_Z, ANKLE_Z = 0.92, 0.49, 0.085
WAIST_Z, SHOULDER_Z, NECK_Z = 1.02, 1.415, 1.475
HIP_Y, SHOULDER_Y = 0.088, 0.178
UPPER_ARM_M = 0.285

Ring = tuple[float, float, float, float]
"""Height, half depth, half width, and how far its middle lies ahead."""


class Part(NamedTuple):
    """A mesh or an ellipsoid that is fixed to a segment.

    Attributes:
        vertices: Shape (n, 3), m; of an ellipsoid none.
        faces: Shape (m, 3).
        size: Half axes of an ellipsoid, m; `at` is its middle.
    """

    segment: str
    colour: Colour
    vertices: np.ndarray
    faces: np.ndarray
    cloth: bool = False
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Figure:
    """The body of a person: its parts, and the joints that they hang on.

    Attributes:
        joints: Origin of each segment in the frame of its parent, m.
        outline: Points on the surface of each segment by which its silhouette is drawn, shape (n, 3).
    """

    looks: Looks
    parts: tuple[Part, ...]
    joints: dict[str, tuple[float, float, float]]
    outline: dict[str, np.ndarray] = field(repr=False)

    @property
    def scale(self) -> float:
        """Height in relation to that of the reference body."""
        return self.looks.height_m / _REFERENCE_M


PARENTS = {
    "chest": "pelvis", "head": "chest", "upper_arm_l": "chest", "upper_arm_r": "chest",
    "forearm_l": "upper_arm_l", "forearm_r": "upper_arm_r", "thigh_l": "pelvis", "thigh_r": "pelvis",
    "shin_l": "thigh_l", "shin_r": "thigh_r", "foot_l": "shin_l", "foot_r": "shin_r",
}  # fmt: skip


def loft(rings: Sequence[Ring], square: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and triangles of a closed surface through ``rings``, from the lowest to the highest.

    Args:
        rings: Rings of the surface.
        square: Exponent of their outline: 2 is an ellipse, more is squarer.
    """
    table = np.array(rings, dtype=float)
    at = np.arange(len(table))
    fine = np.linspace(0, len(table) - 1, 2 * len(table) - 1)
    z, depth, width, ahead = (_smooth(fine, at, table[:, column]) for column in range(4))
    angle = np.arange(_AROUND) * math.tau / _AROUND
    cos, sin = np.cos(angle), np.sin(angle)
    radius = (np.abs(cos) ** square + np.abs(sin) ** square) ** (-1 / square)
    x = ahead[:, None] + np.maximum(depth, 1e-3)[:, None] * (radius * cos)[None]
    y = np.maximum(width, 1e-3)[:, None] * (radius * sin)[None]
    sides = np.stack([x, y, np.repeat(z[:, None], _AROUND, 1)], axis=2).reshape(-1, 3)
    ends = np.array([[ahead[0], 0, z[0]], [ahead[-1], 0, z[-1]]])
    return np.vstack([sides, ends]), _ring_faces(len(fine), _AROUND)


def _ring_faces(rows: int, around: int) -> np.ndarray:
    faces = []
    for row in range(rows - 1):
        for one in range(around):
            two = (one + 1) % around
            a, b, c, d = (row * around + one, row * around + two, (row + 1) * around + one, (row + 1) * around + two)
            faces += [(a, b, d), (a, d, c)]
    bottom, top, last = rows * around, rows * around + 1, (rows - 1) * around
    for one in range(around):
        two = (one + 1) % around
        faces += [(bottom, two, one), (top, last + one, last + two)]
    return np.array(faces, dtype=np.int32)


def _smooth(fine: np.ndarray, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate by a cubic with limited slopes, which does not overshoot."""
    steps = np.diff(values)
    slopes = np.zeros(len(values))
    if len(values) > 2:
        same = steps[:-1] * steps[1:] > 0
        slopes[1:-1][same] = 2 * steps[:-1][same] * steps[1:][same] / (steps[:-1][same] + steps[1:][same])
    slopes[0], slopes[-1] = steps[0], steps[-1]
    low = np.minimum(fine.astype(int), len(at) - 2)
    t = fine - low
    a, b, m, n = values[low], values[low + 1], slopes[low], slopes[low + 1]
    return (2 * t**3 - 3 * t**2 + 1) * a + (t**3 - 2 * t**2 + t) * m + (3 * t**2 - 2 * t**3) * b + (t**3 - t**2) * n


# Rings of the reference body: z from the origin of the segment, half depth, half width, ahead.
_CHEST = {
    "wide": (
        (-0.15, 0.118, 0.165, 0.0), (-0.05, 0.112, 0.152, 0.005), (0.05, 0.112, 0.148, 0.01),
        (0.17, 0.122, 0.168, 0.012), (0.27, 0.125, 0.190, 0.008), (0.35, 0.112, 0.198, 0.0),
        (0.405, 0.085, 0.165, -0.008), (0.435, 0.066, 0.105, -0.012), (0.46, 0.055, 0.062, -0.012),
    ),
    "narrow": (
        (-0.15, 0.120, 0.172, 0.0), (-0.05, 0.104, 0.142, 0.005), (0.04, 0.098, 0.128, 0.01),
        (0.14, 0.112, 0.146, 0.02), (0.23, 0.128, 0.158, 0.024), (0.32, 0.104, 0.168, 0.006),
        (0.385, 0.078, 0.142, -0.006), (0.425, 0.060, 0.092, -0.012), (0.455, 0.050, 0.055, -0.012),
    ),
}  # fmt: skip
_PELVIS = {
    "wide": ((-0.13, 0.095, 0.135, 0), (-0.06, 0.118, 0.165, -0.01), (0.03, 0.118, 0.163, 0), (0.1, 0.11, 0.15, 0)),
    "narrow": ((-0.13, 0.1, 0.15, 0.0), (-0.05, 0.128, 0.18, -0.012), (0.03, 0.12, 0.168, 0.0), (0.1, 0.1, 0.14, 0.0)),
}  # fmt: skip
_HEAD = (
    (-0.035, 0.045, 0.038, 0.022), (-0.015, 0.066, 0.054, 0.022), (0.03, 0.084, 0.066, 0.014),
    (0.08, 0.092, 0.073, 0.008), (0.13, 0.098, 0.077, 0.002), (0.175, 0.094, 0.074, -0.003),
    (0.21, 0.074, 0.058, -0.006), (0.232, 0.036, 0.029, -0.008), (0.238, 0.002, 0.002, -0.008),
)  # fmt: skip
_HEAD_Z = 0.02  # Chin above the neck joint.

_HEM = (-0.27, 0.15, 0.205, 0.0), (-0.16, 0.142, 0.198, 0.0), (-0.06, 0.128, 0.175, 0.004)
_SKIRT = (-0.47, 0.17, 0.19, 0.0), (-0.25, 0.155, 0.188, 0.0), (-0.05, 0.135, 0.182, -0.008), (0.08, 0.11, 0.15, 0.0)
_BAG = (0.0, 0.06, 0.12, -0.17), (0.08, 0.085, 0.145, -0.18), (0.25, 0.08, 0.145, -0.175), (0.36, 0.05, 0.11, -0.15)
_NECK = (0.37, 0.062, 0.066, -0.012), (0.45, 0.054, 0.056, -0.008), (0.53, 0.05, 0.05, 0.006)
_LONG_HAIR = (
    (-0.13, 0.03, 0.085, -0.085), (-0.03, 0.045, 0.1, -0.07), (0.09, 0.055, 0.094, -0.045), (0.2, 0.06, 0.08, -0.025),
)  # fmt: skip
_UPPER_ARM = (
    (-0.3, 0.043, 0.041, 0.0), (-0.2, 0.05, 0.047, 0.0), (-0.08, 0.055, 0.052, 0.0),
    (-0.01, 0.062, 0.055, 0.0), (0.035, 0.045, 0.04, 0.0), (0.052, 0.01, 0.01, 0.0),
)  # fmt: skip
_FOREARM = (-0.25, 0.028, 0.024, 0.0), (-0.14, 0.037, 0.034, 0.0), (-0.05, 0.044, 0.04, 0.0), (0.02, 0.042, 0.04, 0.0)
_HAND = (
    (-0.42, 0.012, 0.008, 0.012), (-0.38, 0.036, 0.014, 0.008), (-0.32, 0.044, 0.018, 0.004),
    (-0.27, 0.034, 0.02, 0.0), (-0.24, 0.027, 0.022, 0.0),
)  # fmt: skip
_THIGH = (
    (-0.46, 0.062, 0.058, 0.005), (-0.4, 0.064, 0.06, 0.004), (-0.25, 0.078, 0.074, 0.004),
    (-0.08, 0.094, 0.086, 0.0), (0.02, 0.092, 0.08, -0.005), (0.07, 0.06, 0.05, -0.005),
)  # fmt: skip
_TROUSER_LEG = (
    (-0.4, 0.052, 0.05, 0.0), (-0.3, 0.054, 0.052, -0.006), (-0.13, 0.064, 0.06, -0.012),
    (-0.02, 0.06, 0.057, 0.0), (0.04, 0.056, 0.052, 0.004),
)  # fmt: skip
_SHIN = (
    (-0.42, 0.034, 0.03, 0.0), (-0.32, 0.04, 0.036, -0.004), (-0.13, 0.056, 0.05, -0.012),
    (-0.02, 0.05, 0.047, 0.0), (0.04, 0.048, 0.046, 0.004),
)  # fmt: skip
_SHOE = (
    (-0.075, 0.022, 0.026, 0.018), (-0.06, 0.048, 0.034, 0.0), (0.0, 0.052, 0.037, 0.0), (0.08, 0.034, 0.043, -0.02),
    (0.14, 0.026, 0.044, -0.03), (0.185, 0.02, 0.032, -0.036), (0.2, 0.008, 0.012, -0.042),
)  # fmt: skip


def figure(looks: Looks) -> Figure:
    """Make the body of a person."""
    body = _Body(looks)
    parts = tuple(body.parts())
    outline: dict[str, list[np.ndarray]] = {name: [] for name in SEGMENTS}
    for part in parts:
        if len(part.vertices):
            outline[part.segment].append(part.vertices)
    shapes = {name: _extremes(np.vstack(points)) for name, points in outline.items()}
    return Figure(looks, parts, body.joints(), shapes)


def _extremes(points: np.ndarray) -> np.ndarray:
    """The points that lie farthest out, in each of 50 directions."""
    steps = np.arange(50) + 0.5
    high, around = 1 - 2 * steps / 50, steps * math.pi * (1 + math.sqrt(5))
    wide = np.sqrt(1 - high**2)
    directions = np.stack([wide * np.cos(around), wide * np.sin(around), high])
    return points[np.unique(np.argmax(points @ directions, axis=0))]


class _Body:
    def __init__(self, looks: Looks) -> None:
        self.looks = looks
        self.scale = looks.height_m / _REFERENCE_M
        self.wide = looks.shape == "wide"

    def joints(self) -> dict[str, tuple[float, float, float]]:
        shoulder = SHOULDER_Y * (1.06 if self.wide else 0.93) * (0.5 + 0.5 * self.looks.build)
        places: dict[str, tuple[float, float, float]] = {
            "pelvis": (0, 0, HIP_Z),
            "chest": (0, 0, WAIST_Z - HIP_Z),
            "head": (-0.012, 0, NECK_Z - WAIST_Z),
        }
        for side, sign in (("l", 1), ("r", -1)):
            places |= {
                f"upper_arm_{side}": (-0.005, sign * shoulder, SHOULDER_Z - WAIST_Z - 0.02),
                f"forearm_{side}": (0, 0, -UPPER_ARM_M),
                f"thigh_{side}": (0, sign * HIP_Y, 0),
                f"shin_{side}": (0, 0, KNEE_Z - HIP_Z),
                f"foot_{side}": (0, 0, ANKLE_Z - KNEE_Z),
            }
        return {name: (x * self.scale, y * self.scale, z * self.scale) for name, (x, y, z) in places.items()}

    def parts(self) -> list[Part]:
        return [*self._trunk(), *self._head(), *self._arms(), *self._legs()]

    def _lofted(
        self, segment: str, colour: Colour, rings: Sequence[Ring], *, cloth: bool = False, square: float = 2.0,
        widen: float = 0.0, build: bool = True, shaped: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> Part:  # fmt: skip
        thick = self.looks.build if build else 1.0
        rings = [(z, depth * thick + widen, width * thick + widen, ahead) for z, depth, width, ahead in rings]
        vertices, faces = loft(rings, square)
        if shaped is not None:
            vertices = shaped(vertices)
        return Part(segment, colour, vertices * self.scale, faces, cloth)

    def _ball(
        self, segment: str, colour: Colour, at: tuple[float, float, float], size: tuple[float, float, float]
    ) -> Part:
        none = np.zeros((0, 3))
        x, y, z = (self.scale * value for value in at)
        a, b, c = (self.scale * value for value in size)
        return Part(segment, colour, none, none.astype(np.int32), False, (a, b, c), (x, y, z))

    def _trunk(self) -> list[Part]:
        looks = self.looks
        chest, pelvis = _CHEST[looks.shape], _PELVIS[looks.shape]
        parts = [
            self._lofted("chest", looks.top, chest, cloth=True, square=2.3),
            self._lofted("pelvis", looks.legs, pelvis, cloth=True, square=2.2),
        ]
        if looks.lower == "skirt":
            parts.append(self._lofted("pelvis", looks.legs, _SKIRT, cloth=True))
        if looks.jacket is not None:
            coat = (*_HEM, *chest[2:-1])
            parts.append(
                self._lofted("chest", looks.jacket, coat, cloth=True, square=2.3, widen=0.014, shaped=_open_front)
            )
        if looks.bag is not None:
            parts.append(self._lofted("chest", looks.bag, _BAG, cloth=True, square=3.0, build=False))
        return [*parts, self._lofted("chest", looks.skin, _NECK, build=False)]

    def _head(self) -> list[Part]:
        looks, up = self.looks, _HEAD_Z + 0.035
        lifted = [(z + up, depth, width, ahead) for z, depth, width, ahead in _HEAD]
        eye = up + 0.098
        dark = _shaded(looks.hair, 0.35, 0.35, 0.35) if looks.hair_style == "bald" else looks.hair
        lips, shade = _shaded(looks.skin, 0.75, 0.45, 0.45), _shaded(looks.skin, 0.86, 0.80, 0.78)
        parts = [self._lofted("head", looks.skin, lifted, build=False, square=2.15)]
        for side in (1, -1):
            parts += [
                self._ball("head", (0.93, 0.92, 0.9), (0.086, side * 0.031, eye), (0.010, 0.014, 0.008)),
                self._ball("head", (0.12, 0.08, 0.06), (0.0925, side * 0.031, eye), (0.006, 0.0065, 0.007)),
                self._ball("head", dark, (0.092, side * 0.032, eye + 0.021), (0.006, 0.019, 0.0045)),
                self._ball("head", shade, (0.0, side * 0.077, eye - 0.012), (0.018, 0.010, 0.031)),
            ]
        parts += [
            self._ball("head", looks.skin, (0.099, 0, eye - 0.030), (0.017, 0.012, 0.020)),
            self._ball("head", shade, (0.094, 0, eye - 0.042), (0.014, 0.017, 0.006)),
            self._ball("head", lips, (0.0875, 0, eye - 0.067), (0.008, 0.024, 0.0075)),
        ]
        if looks.beard:
            beard = [(z - 0.006, depth * 1.05, width * 1.06, ahead + 0.002) for z, depth, width, ahead in lifted[:4]]
            parts.append(self._lofted("head", looks.hair, beard, build=False, shaped=_below_mouth(eye - 0.058)))
        if looks.hair_style != "bald":
            cap = [(z, 1.1 * deep + 0.004, 1.12 * wide + 0.004, ahead - 0.006) for z, deep, wide, ahead in lifted[2:]]
            cap[-1] = (cap[-1][0] + 0.014, *cap[-1][1:])
            parts.append(self._lofted("head", looks.hair, cap, build=False, shaped=_hairline(eye)))
        if looks.hair_style == "long":
            parts.append(self._lofted("head", looks.hair, _LONG_HAIR, build=False))
        if looks.hair_style == "bun":
            parts.append(self._ball("head", looks.hair, (-0.105, 0, eye + 0.06), (0.045, 0.045, 0.045)))
        return parts

    def _arms(self) -> list[Part]:
        looks, parts = self.looks, []
        outer, widen, sleeve = looks.jacket or looks.top, 0.010 if looks.jacket else 0.004, looks.sleeves == "long"
        for side in ("l", "r"):
            upper, lower = f"upper_arm_{side}", f"forearm_{side}"
            if sleeve:
                parts.append(self._lofted(upper, outer, _UPPER_ARM, cloth=True, widen=widen))
                parts.append(self._lofted(lower, outer, _FOREARM, cloth=True, widen=widen))
            else:
                parts.append(self._lofted(upper, looks.skin, _UPPER_ARM))
                parts.append(self._lofted(upper, outer, _cut(_UPPER_ARM, -0.19), cloth=True, widen=0.009))
                parts.append(self._lofted(lower, looks.skin, _FOREARM))
            parts.append(self._lofted(lower, looks.skin, _HAND, build=False))
            parts.append(self._ball(lower, looks.skin, (0.045, 0.0, -0.315), (0.013, 0.011, 0.035)))
        return parts

    def _legs(self) -> list[Part]:
        looks, parts = self.looks, []
        bare = looks.lower == "skirt"
        for side in ("l", "r"):
            parts.append(self._lofted(f"thigh_{side}", looks.skin if bare else looks.legs, _THIGH, cloth=not bare))
            if looks.lower == "trousers":
                parts.append(self._lofted(f"shin_{side}", looks.legs, _TROUSER_LEG, cloth=True))
            else:
                parts.append(self._lofted(f"shin_{side}", looks.skin, _SHIN))
            parts.append(Part(f"foot_{side}", looks.shoes, *_shoe(self.scale)))
        return parts


def _shaded(colour: Colour, red: float, green: float, blue: float) -> Colour:
    return red * colour[0], green * colour[1], blue * colour[2]


def _shoe(scale: float) -> tuple[np.ndarray, np.ndarray]:
    """A shoe, its toes ahead and its sole `ANKLE_Z` below the joint."""
    vertices, faces = loft(_SHOE, 2.4)
    x, y, z = vertices[:, 2], vertices[:, 1], vertices[:, 0] - 0.035
    shoe = np.stack([x, -y, np.maximum(z, -ANKLE_Z)], axis=1)
    return shoe * scale, faces


def _cut(rings: Sequence[Ring], low: float) -> list[Ring]:
    """The part of ``rings`` above a height, which begins with a ring at it."""
    kept = [ring for ring in rings if ring[0] > low]
    below = [ring for ring in rings if ring[0] <= low][-1]
    share = (low - below[0]) / (kept[0][0] - below[0])
    first = tuple(a + share * (b - a) for a, b in zip(below, kept[0], strict=True))
    return [first, *kept]  # type: ignore[list-item]


def _open_front(vertices: np.ndarray) -> np.ndarray:
    """Open a jacket: its front edge lies within the shirt."""
    angle = np.arctan2(vertices[:, 1] * 0.7, vertices[:, 0])
    inside = np.clip(1 - np.abs(angle) / 0.32, 0, 1)
    changed = vertices.copy()
    changed[:, 0] -= 0.05 * inside
    return changed


def _hairline(eye: float) -> Callable[[np.ndarray], np.ndarray]:
    """Pull the hair into the head where the face is."""

    def shaped(vertices: np.ndarray) -> np.ndarray:
        angle = np.abs(np.arctan2(vertices[:, 1], vertices[:, 0]))
        line = eye + 0.062 - 0.105 * np.clip((angle - 0.75) / 0.9, 0, 1)
        hidden = np.clip((line - vertices[:, 2]) / 0.015, 0, 1)
        changed = vertices.copy()
        changed[:, :2] *= 1 - 0.3 * hidden[:, None]
        return changed

    return shaped


def _below_mouth(mouth: float) -> Callable[[np.ndarray], np.ndarray]:
    """Pull a beard into the head above the mouth, but at the cheeks."""

    def shaped(vertices: np.ndarray) -> np.ndarray:
        angle = np.abs(np.arctan2(vertices[:, 1], vertices[:, 0]))
        hidden = np.clip((vertices[:, 2] - mouth - 0.04 * np.clip((angle - 0.4) / 0.6, 0, 1)) / 0.008, 0, 1)
        changed = vertices.copy()
        changed[:, :2] *= 1 - 0.25 * hidden[:, None]
        return changed

    return shaped
