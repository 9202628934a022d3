"""Ray-cast depth images of a room with people, with sensor errors, and bags of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from socialbot.core.messages import CompressedDepth, DepthImage, PointCloud, PointField
from socialbot.vision.camera import CameraModel, CameraPose

CAMERA = CameraModel.from_field_of_view(320, 240, 1.09, CameraPose(height_m=1.3, pitch_rad=0.08))


@dataclass(frozen=True)
class Blob:
    """A person of ellipsoids ``ahead`` and ``left`` of the camera (m): trunk, head, legs and arms."""

    ahead: float
    left: float = 0.0
    height: float = 1.7
    seated: bool = False

    @property
    def distance(self) -> float:
        return math.hypot(self.ahead, self.left)

    def ellipsoids(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Centres (ahead, left, up) and half axes."""
        scale = self.height / 1.7
        parts = [
            ((0, 0, 1.60), (0.10, 0.08, 0.12)), ((0, 0, 1.15), (0.12, 0.21, 0.34)),
            ((0, 0.10, 0.45), (0.08, 0.08, 0.46)), ((0, -0.10, 0.45), (0.08, 0.08, 0.46)),
            ((-0.1, 0.26, 1.1), (0.06, 0.05, 0.30)), ((-0.1, -0.26, 1.1), (0.06, 0.05, 0.30)),
        ]  # fmt: skip
        if self.seated:
            parts = [((0, 0, 1.20), (0.10, 0.08, 0.12)), ((0, 0, 0.78), (0.13, 0.21, 0.34)),
                     ((-0.25, 0.1, 0.45), (0.30, 0.08, 0.08)), ((-0.25, -0.1, 0.45), (0.30, 0.08, 0.08)),
                     ((-0.5, 0.1, 0.22), (0.07, 0.07, 0.24)), ((-0.5, -0.1, 0.22), (0.07, 0.07, 0.24))]  # fmt: skip
        angle = math.atan2(self.left, self.ahead)
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        place = np.array([self.ahead, self.left])
        return [
            (np.array([*(place + turn @ centre[:2]), centre[2]]) * [1, 1, scale], np.array(axes) * [1, 1, scale])
            for centre, axes in ((np.array(centre), axes) for centre, axes in parts)
        ]


@dataclass(frozen=True)
class Room:
    """People between a floor and a ``wall`` (m ahead), and a table: near and far end, and height."""

    people: Sequence[Blob]
    wall: float = 8.0
    table: tuple[float, float, float] | None = None

    def along(self, rays: np.ndarray, height: float) -> np.ndarray:
        """Multiple of each ray (n, 3: ahead, left, up) from ``height`` up to the nearest surface; inf without."""
        return np.min([self._background(rays, height), *(_hits(blob, rays, height) for blob in self.people)], axis=0)

    def _background(self, rays: np.ndarray, height: float) -> np.ndarray:
        ahead, _, up = rays.T
        with np.errstate(divide="ignore", invalid="ignore"):
            floor = np.where(up < 0, height / -up, np.inf)
            wall = np.where(ahead > 0, self.wall / ahead, np.inf)
            found = np.minimum(floor, wall)
            if self.table is not None:
                near, far, top = self.table
                front = near / ahead
                hit = (ahead > 0) & (height + front * up < top) & (height + front * up > 0)
                found = np.where(hit, np.minimum(found, front), found)
                plate = (height - top) / -up
                hit = (up < 0) & (plate > 0) & (plate * ahead > near) & (plate * ahead < far)
                found = np.where(hit, np.minimum(found, plate), found)
        return found


def _hits(blob: Blob, rays: np.ndarray, height: float) -> np.ndarray:
    nearest = np.full(len(rays), np.inf)
    for centre, axes in blob.ellipsoids():
        scaled, origin = rays / axes, (np.array([0, 0, height]) - centre) / axes
        a, b, c = (scaled**2).sum(axis=1), scaled @ origin, origin @ origin - 1
        root = b**2 - a * c
        hit = (root > 0) & (-b > 0)
        nearest[hit] = np.minimum(nearest[hit], ((-b - np.sqrt(np.maximum(root, 0))) / a)[hit])
    return nearest


def rays_of(camera: CameraModel) -> np.ndarray:
    """Rays (pixels, 3: ahead, left, up) of the pixels, of length 1 along the optical axis."""
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    right, down = (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy
    cos, sin = math.cos(camera.pose.pitch_rad), math.sin(camera.pose.pitch_rad)
    return np.stack([cos - down * sin, -right, -sin - down * cos], axis=-1).reshape(-1, 3)


def render(room: Room, camera: CameraModel = CAMERA) -> np.ndarray:
    """Depth along the optical axis, shape (height, width), m, without errors."""
    return room.along(rays_of(camera), camera.pose.height_m).reshape(camera.height, camera.width)


def box_of(room: Room, person: int, camera: CameraModel = CAMERA) -> tuple[float, float, float, float]:
    """Box of a person, also where another one hides them."""
    alone = replace(room, people=[room.people[person]], table=None)
    hit = np.isfinite(_hits(alone.people[0], rays_of(camera), camera.pose.height_m))
    rows, columns = np.nonzero(hit.reshape(camera.height, camera.width))
    return float(columns.min()), float(rows.min()), float(np.ptp(columns) + 1), float(np.ptp(rows) + 1)


def with_errors(
    depth: np.ndarray, seed: int = 0, *, holes: float = 0.1, farthest: float = 10.0, flying: float = 0.5
) -> np.ndarray:
    """Depth as a stereo camera measures it: noise, disparity steps, holes, shadows, mixed pixels at edges; 0: none."""
    random = np.random.default_rng(seed)
    height, width = depth.shape
    found = np.where(np.isfinite(depth), depth, 0.0)
    step = np.abs(np.diff(found, axis=1, prepend=found[:, :1])) > 0.2
    edge = step | np.roll(step, -1, axis=1) | np.roll(step, 1, axis=1)
    mixed = edge & (random.random(depth.shape) < flying)
    found = np.where(mixed, found + random.random(depth.shape) * (np.roll(found, 3, axis=1) - found), found)
    found += random.normal(0, 0.0015 * found**2 + 0.002)
    with np.errstate(divide="ignore"):
        found = np.where(found > 0.2, 32 / np.round(32 / np.maximum(found, 0.01) * 8) * 8, 0)
    patches = random.random((height // 8 + 1, width // 8 + 1)) < holes
    found[np.kron(patches, np.ones((8, 8), bool))[:height, :width]] = 0
    found[step & (random.random(depth.shape) < 0.5)] = 0
    found[found > farthest] = 0
    return found


def depth_image(
    depth: np.ndarray,
    *,
    encoding: str = "16UC1",
    big: bool = False,
    padding: int = 0,
    stamp: int = 0,
    frame: str = "eye",
) -> DepthImage:  # fmt: skip
    """Message of a depth in metres with 0 as invalid."""
    order = ">" if big else "<"
    if encoding == "32FC1":
        pixels = np.where(depth > 0, depth, np.nan).astype(f"{order}f4")
    else:
        pixels = np.round(depth * 1000).astype(f"{order}u2")
    rows = pixels.view(np.uint8).reshape(len(depth), -1)
    data = np.pad(rows, ((0, 0), (0, padding))).reshape(-1)
    return DepthImage(
        stamp=stamp, frame_id=frame, height=depth.shape[0], width=depth.shape[1], encoding=encoding,
        is_bigendian=big, step=rows.shape[1] + padding, data=data,
    )  # fmt: skip


def compressed(form: str, data: bytes, *, stamp: int = 0, frame: str = "eye") -> CompressedDepth:
    return CompressedDepth(stamp=stamp, frame_id=frame, format=form, data=np.frombuffer(data, np.uint8))


def cloud(
    points: np.ndarray, *, stamp: int = 0, frame: str = "lidar", big: bool = False, kind: str = "f4",
    fields: str = "xyz", offset: int = 4, step: int = 32,
) -> PointCloud:  # fmt: skip
    """Message of points (n, 3)."""
    size, code = np.dtype(kind).itemsize, {"f4": 7, "f8": 8}[kind]
    data = np.zeros((len(points), step), np.uint8)
    for number, name in enumerate(fields):
        values = points[:, "xyz".index(name)].astype(f"{'>' if big else '<'}{kind}")
        data[:, offset + number * size : offset + (number + 1) * size] = values.view(np.uint8).reshape(-1, size)
    parts = tuple(PointField(name, offset + number * size, code) for number, name in enumerate(fields))
    return PointCloud(
        stamp=stamp, frame_id=frame, height=1, width=len(points), fields=(PointField("ring", 0, 4), *parts),
        is_bigendian=big, point_step=step, row_step=len(points) * step, data=data.reshape(-1),
    )  # fmt: skip


LIDARS = {16: (-15.0, 15.0, 0.2), 32: (-30.0, 10.0, 0.2), 64: (-24.8, 2.0, 0.18)}
"""Beams of usual lidars: lowest and highest elevation, and step of the azimuth (degrees)."""


def scan(room: Room, height: float, *, rings: int = 16, seed: int = 0) -> np.ndarray:
    """Points of a lidar of `LIDARS` at ``height``: ahead, left, up of the lidar."""
    low, high, step = LIDARS[rings]
    azimuth, elevation = np.meshgrid(np.radians(np.arange(-36, 36, step)), np.radians(np.linspace(low, high, rings)))
    rays = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    ).reshape(-1, 3)
    along = room.along(rays, height)
    along = along + np.random.default_rng(seed).normal(0, 0.02, along.shape)
    return (rays * along[:, None])[np.isfinite(along) & (along < 80)]


def visible_share(room: Room, person: int, camera: CameraModel = CAMERA) -> float:
    """Share of a person that nothing else hides, of the part in the image."""
    rays = rays_of(camera)
    alone = _hits(room.people[person], rays, camera.pose.height_m)
    seen = np.isfinite(alone)
    in_front = room.along(rays[seen], camera.pose.height_m) < alone[seen] - 1e-6
    return 1.0 - float(in_front.mean()) if seen.any() else 0.0
