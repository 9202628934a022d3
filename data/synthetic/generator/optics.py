"""Cameras in numbers: a pinhole with an optional lens, above a point of the floor, panned and tilted."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

MARGIN = 16  # pixels around the ideal picture of a lens
ROUNDS = 30  # of the inversion of a lens


@dataclass(frozen=True)
class View:
    """A camera in its place. World: x right, y ahead, z up; the corridor's camera looks along +y.

    size: width and height (px). focal: fx = fy (px). eye: place (m). pitch: downwards (rad); yaw: to the left (rad).
    lens: plumb_bob coefficients k1, k2, p1, p2, k3; empty for none.
    """

    size: tuple[int, int] = (640, 480)
    focal: float = 525.0
    eye: tuple[float, float, float] = (0.0, 0.0, 1.62)
    pitch: float = math.radians(3)
    yaw: float = 0.0
    lens: tuple[float, ...] = ()

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the picture."""
        return self.size[1], self.size[0]

    @property
    def centre(self) -> np.ndarray:
        """The principal point (px)."""
        return np.array(self.size) / 2

    @cached_property
    def axes(self) -> np.ndarray:
        """Directions right, down and ahead in the world, as rows."""
        right = np.array([math.cos(self.yaw), math.sin(self.yaw), 0.0])
        level = np.array([-math.sin(self.yaw), math.cos(self.yaw), 0.0])
        ahead = level * math.cos(self.pitch) - np.array([0, 0, math.sin(self.pitch)])
        return np.stack([right, np.cross(ahead, right), ahead])

    def projected(self, points: np.ndarray) -> np.ndarray:
        """Pixel u, v and depth (m) of world points (n, 3)."""
        seen = (points - np.array(self.eye)) @ self.axes.T
        flat = seen[:, :2] / np.maximum(seen[:, 2:], 1e-3)
        return np.c_[self.centre + self.focal * self.bent(flat), seen[:, 2]]

    def rays(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Directions (..., 3) through pixels, with a depth of 1."""
        flat = (np.stack([u, v], -1) - self.centre) / self.focal
        return np.concatenate([self.straight(flat), np.ones((*flat.shape[:-1], 1))], -1) @ self.axes

    def bent(self, flat: np.ndarray) -> np.ndarray:
        """Where the lens takes points (..., 2) of the plane at depth 1; beyond its turning point it goes on evenly."""
        if not self.lens:
            return flat
        k1, k2, p1, p2, k3 = self.lens
        square = (flat**2).sum(-1, keepdims=True)
        inner = np.minimum(square, self.turning)
        x, y = np.moveaxis(flat * np.sqrt(inner / np.maximum(square, 1e-12)), -1, 0)
        r = inner[..., 0]
        side = np.stack([2 * p1 * x * y + p2 * (r + 2 * x * x), p1 * (r + 2 * y * y) + 2 * p2 * x * y], -1)
        return flat * (1 + inner * (k1 + inner * (k2 + inner * k3))) + side

    @cached_property
    def turning(self) -> float:
        """Square of the radius up to which the lens takes larger radii to larger ones, less a little."""
        radii = np.linspace(0.01, 4, 400)
        k1, k2, _, _, k3 = self.lens
        grown = radii * (1 + radii**2 * (k1 + radii**2 * (k2 + radii**2 * k3)))
        falls = np.flatnonzero(np.diff(grown) <= 0)
        return float((radii[falls[0]] * 0.95) ** 2 if len(falls) else radii[-1] ** 2)

    def straight(self, bent: np.ndarray) -> np.ndarray:
        """The lens backwards."""
        if not self.lens:
            return bent
        flat = bent.copy()
        for _ in range(ROUNDS):
            flat = flat + bent - self.bent(flat)
        return flat

    def ideal(self) -> View:
        """The picture of the same camera without its lens that holds all of this one; rendered, then bent."""
        if not self.lens:
            return self
        wide, high = self.size
        u, v = np.meshgrid(np.linspace(0, wide, 33), np.linspace(0, high, 25))
        reach = np.abs(self.straight((np.stack([u, v], -1) - self.centre) / self.focal)).reshape(-1, 2).max(0)
        size = tuple(int(-(-(2 * r * self.focal + MARGIN) // 8) * 8) for r in reach)
        return replace(self, size=size, lens=())

    def lookup(self) -> np.ndarray:
        """Where each pixel (h, w, 2: u, v) lies in the ideal picture, for cv2.remap."""
        ideal, (v, u) = self.ideal(), np.mgrid[0 : self.size[1], 0 : self.size[0]] + 0.5
        flat = self.straight((np.stack([u, v], -1) - self.centre) / self.focal)
        return (ideal.centre + ideal.focal * flat - 0.5).astype(np.float32)


CORRIDOR = View()
