"""The robot's camera in numbers: a pinhole above the origin, looking along +y and a little down."""

from __future__ import annotations

import math

import numpy as np

WIDTH, HEIGHT, FOCAL = 640, 480, 525.0
EYE, PITCH = 1.62, math.radians(3)


def projected(points: np.ndarray) -> np.ndarray:
    """Pixel u, v and depth (m) of world points."""
    rise = points[:, 2] - EYE
    depth = points[:, 1] * math.cos(PITCH) - rise * math.sin(PITCH)
    down = -rise * math.cos(PITCH) - points[:, 1] * math.sin(PITCH)
    safe = np.maximum(depth, 1e-3)
    return np.stack([WIDTH / 2 + FOCAL * points[:, 0] / safe, HEIGHT / 2 + FOCAL * down / safe, depth], 1)


def rays(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Directions (n, 3) through pixels, with a depth of 1."""
    x, down = (u - WIDTH / 2) / FOCAL, (v - HEIGHT / 2) / FOCAL
    forward = math.cos(PITCH) - down * math.sin(PITCH)
    return np.stack([x, forward, -math.sin(PITCH) - down * math.cos(PITCH)], -1)
