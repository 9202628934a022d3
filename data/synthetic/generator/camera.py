"""The robot's camera: projection, rays, and rendering of the picture or of a part of it."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

WIDTH, HEIGHT, FOCAL = 640, 480, 525.0
EYE, PITCH = 1.62, math.radians(3)
INSIDE = 0.25  # of a pixel: Blender rounds borders down
ORIGIN = Vector((0, 0, EYE))

Region = tuple[int, int, int, int]


def mount(scene: bpy.types.Scene) -> None:
    """Puts the camera in its place."""
    data = bpy.data.cameras.new("camera")
    data.sensor_width, data.lens, data.clip_start = 36.0, 36.0 * FOCAL / WIDTH, 0.02
    holder = bpy.data.objects.new("camera", data)
    holder.location, holder.rotation_euler = (0, 0, EYE), (math.pi / 2 - PITCH, 0, 0)
    scene.collection.objects.link(holder)
    scene.camera = holder


def projected(points: np.ndarray) -> np.ndarray:
    """Pixel u, v and depth (m) of world points."""
    rise = points[:, 2] - EYE
    depth = points[:, 1] * math.cos(PITCH) - rise * math.sin(PITCH)
    down = -rise * math.cos(PITCH) - points[:, 1] * math.sin(PITCH)
    safe = np.maximum(depth, 1e-3)
    return np.stack([WIDTH / 2 + FOCAL * points[:, 0] / safe, HEIGHT / 2 + FOCAL * down / safe, depth], 1)


def pixel_ray(u: float, v: float) -> Vector:
    """Direction through a pixel."""
    x, down = (u - WIDTH / 2) / FOCAL, (v - HEIGHT / 2) / FOCAL
    forward = math.cos(PITCH) - down * math.sin(PITCH)
    return Vector((x, forward, -math.sin(PITCH) - down * math.cos(PITCH))).normalized()


def render(scene: bpy.types.Scene, samples: int, path: Path, region: Region | None = None) -> None:
    """Renders the picture, or only a region (left, top, right, bottom in pixels), to a PNG of that size."""
    scene.cycles.samples = samples
    scene.render.use_border = scene.render.use_crop_to_border = region is not None
    if region:
        left, top, right, bottom = region
        border = scene.render
        border.border_min_x, border.border_max_x = (left + INSIDE) / WIDTH, (right + INSIDE) / WIDTH
        border.border_min_y, border.border_max_y = 1 - (bottom - INSIDE) / HEIGHT, 1 - (top - INSIDE) / HEIGHT
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
