"""The robot's camera in Blender, and rendering of the picture or of a part of it."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector
from optics import EYE, FOCAL, HEIGHT, PITCH, WIDTH, projected, rays

__all__ = ["HEIGHT", "ORIGIN", "WIDTH", "Region", "mount", "pixel_ray", "projected", "render", "static_depth"]

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


def pixel_ray(u: float, v: float) -> Vector:
    """Direction through a pixel."""
    return Vector(rays(np.array(u), np.array(v))).normalized()


def static_depth(scene: bpy.types.Scene) -> np.ndarray:
    """Depth (m) of what stands in each pixel of the scene as it is now, far away where there is nothing."""
    graph = bpy.context.evaluated_depsgraph_get()
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    out = np.full(HEIGHT * WIDTH, 1e3, np.float32)
    for index, ray in enumerate(rays(u.ravel(), v.ravel())):
        hit, where, *_ = scene.ray_cast(graph, ORIGIN, Vector(ray))
        if hit:
            out[index] = math.cos(PITCH) * where.y - math.sin(PITCH) * (where.z - EYE)
    return out.reshape(HEIGHT, WIDTH)


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
