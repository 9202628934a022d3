"""Who covers which pixels: triangles drawn into depth maps, and shadows cast onto the corridor's surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

NEAR = 0.05
FINE = 0.7  # pixels between samples of a triangle
STEPS = np.array([1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 32, 40, 60, 100, 200])  # samples on a side
TALL = {1: 300, 2: 900, 4: 1800}  # pixels that a thing may be high for cells of so many pixels
COARSE = 8
REACH = 900  # pixels outside the picture that still count as the whole person
SLACK = 0.03


@dataclass(frozen=True)
class DepthMap:
    """Depths (m, infinite where nothing is) of a rectangle of cells, each so many pixels wide; may reach outside.

    left, top: of the first cell, in cells from the picture's corner. shape: rows and columns of the picture.
    """

    left: int
    top: int
    depth: np.ndarray
    cell: int
    shape: tuple[int, int]

    def filled(self) -> np.ndarray:
        """Which pixels are covered."""
        return np.isfinite(self.depth)

    @cached_property
    def in_picture(self) -> np.ndarray:
        """The depths cut or padded to the picture."""
        rows, columns = self.shape[0] // self.cell, self.shape[1] // self.cell
        out = np.full((rows, columns), np.inf, np.float32)
        high, wide = self.depth.shape
        low_v, high_v = max(self.top, 0), min(self.top + high, rows)
        low_u, high_u = max(self.left, 0), min(self.left + wide, columns)
        if low_v < high_v and low_u < high_u:
            part = self.depth[low_v - self.top : high_v - self.top, low_u - self.left : high_u - self.left]
            out[low_v:high_v, low_u:high_u] = part
        return out if self.cell == 1 else out.repeat(self.cell, 0).repeat(self.cell, 1)

    @cached_property
    def shown(self) -> bool:
        """Whether any of it is inside the picture."""
        return bool(np.isfinite(self.in_picture).any())


def grid(count: int) -> np.ndarray:
    """Barycentric coordinates (n, 3) of evenly spread samples of a triangle with count on a side."""
    a, b = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    a, b = a[a + b < count], b[a + b < count]
    first, second = (a + 1 / 3) / count, (b + 1 / 3) / count
    return np.stack([first, second, 1 - first - second], 1)


def samples(corners: np.ndarray) -> np.ndarray:
    """Points (n, 3: u, v, depth) that cover triangles (m, 3, 3) of the picture without holes."""
    sides = corners[:, [1, 2, 0], :2] - corners[:, :, :2]
    longest = np.sqrt((sides**2).sum(2)).max(1)
    counts = np.clip(np.ceil(longest / FINE), 1, STEPS[-1])
    counts = STEPS[np.searchsorted(STEPS, counts)]
    parts = [np.empty((0, 3), corners.dtype)]
    for count in np.unique(counts):
        chosen = corners[counts == count]
        weights = grid(count).astype(corners.dtype)
        parts.append((weights @ chosen.transpose(1, 0, 2).reshape(3, -1)).reshape(-1, 3))
    return np.concatenate(parts)


def drawn(pixels: np.ndarray, faces: np.ndarray, shape: tuple[int, int]) -> DepthMap | None:
    """The depth map of a mesh: projected vertices (n, 3: u, v, depth), triangles (m, 3). None when out of reach.

    shape: rows and columns of the picture. Outlines that are tall in the picture are drawn with larger cells.
    """
    near = pixels[:, 2] > NEAR
    faces = faces[near[faces].all(1)]
    if not len(faces):
        return None
    tall = float(np.ptp(pixels[near, 1]))
    cell = next((cell for cell, most in TALL.items() if tall <= most), COARSE)
    low, high = np.array([-REACH, -REACH]) / cell, np.array([shape[1] + REACH, shape[0] + REACH]) / cell
    corners = (pixels / [cell, cell, 1]).astype(np.float32)[faces]
    within = (corners[:, :, :2].max(1) >= low) & (corners[:, :, :2].min(1) < high)
    points = samples(corners[within.all(1)])
    points = points[((points[:, :2] >= low) & (points[:, :2] < high)).all(1)]
    if not len(points):
        return None
    cells = np.floor(points[:, :2]).astype(int)
    left, top = cells.min(0)
    wide, high = cells.max(0) - (left, top) + 1
    depth = np.full(wide * high, np.inf, np.float32)
    np.minimum.at(depth, (cells[:, 1] - top) * wide + cells[:, 0] - left, points[:, 2])
    return DepthMap(int(left), int(top), depth.reshape(high, wide), cell, shape)


def visible_mask(own: DepthMap, others: np.ndarray) -> np.ndarray:
    """Pixels of the picture where a thing is seen; others: depths of everything else in the picture."""
    depth = own.in_picture
    return np.isfinite(depth) & (depth <= others + SLACK)


def visible_share(own: DepthMap, others: np.ndarray) -> float:
    """Share of the whole outline, outside the picture too, that is inside the picture and not hidden."""
    return float(visible_mask(own, others).sum() / max(own.filled().sum() * own.cell**2, 1))


def box_of(pixels: np.ndarray, shape: tuple[int, int]) -> tuple[float, float, float, float]:
    """x, y, w, h of projected points, clipped to the picture of a shape; width or height 0 when outside."""
    left, top = np.clip(pixels[:, :2].min(0), 0, shape[::-1])
    right, bottom = np.clip(pixels[:, :2].max(0), 0, shape[::-1])
    return tuple(round(float(value), 1) for value in (left, top, right - left, bottom - top))


def ground_shadow(points: np.ndarray, lamp: np.ndarray, half: float) -> np.ndarray:
    """Where the shadows of points fall under a lamp: on the floor, or on the walls at x = -half and half.

    lamp: x, y, z of a point, or, with a fourth value of 0, the direction in which the sun's light goes.
    """
    way = points - lamp[:3] if len(lamp) == 3 else np.broadcast_to(lamp[:3], points.shape)
    down, side = np.minimum(way[:, 2], -1e-6), way[:, 0]
    to_floor = np.where(way[:, 2] < 0, -points[:, 2] / down, np.inf)
    wall = np.where(side > 0, half, -half)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        to_wall = np.where(np.abs(side) > 1e-6, (wall - points[:, 0]) / side, np.inf)
    reach = np.minimum(to_floor, np.where(to_wall > 0, to_wall, np.inf))
    good = np.isfinite(reach)
    return points[good] + way[good] * reach[good, None]


def sunlit(points: np.ndarray, sun: np.ndarray, panes: np.ndarray, half: float) -> np.ndarray:
    """Which points the sun reaches through panes (n, 4: y from, y to, z from, z to) in the wall at x = half."""
    steps = (half - points[:, 0]) / -sun[0]
    through = points - steps[:, None] * sun
    y, z = through[:, 1, None], through[:, 2, None]
    inside = (y > panes[:, 0]) & (y < panes[:, 1]) & (z > panes[:, 2]) & (z < panes[:, 3])
    return (steps > 0) & inside.any(1)
