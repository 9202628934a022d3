"""The robot's camera in Blender, and rendering of the picture or of a part of it."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector
from optics import View

__all__ = ["Region", "aim", "mount", "render", "static_depth"]

INSIDE = 0.25  # of a pixel: Blender rounds borders down

Region = tuple[int, int, int, int]


def mount(scene: bpy.types.Scene, view: View) -> None:
    """Puts a camera without a lens in its place, and sets the size of its pictures."""
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
    data.lens, data.clip_start = 36.0 * view.focal / view.size[0], 0.02
    scene.camera = bpy.data.objects.new("camera", data)
    scene.collection.objects.link(scene.camera)
    scene.render.resolution_x, scene.render.resolution_y = view.size
    aim(scene, view)


def aim(scene: bpy.types.Scene, view: View) -> None:
    """Turns the camera."""
    scene.camera.location, scene.camera.rotation_euler = view.eye, (math.pi / 2 - view.pitch, 0, view.yaw)


def static_depth(scene: bpy.types.Scene, view: View, step: int = 1) -> np.ndarray:
    """Depth (m) of the surface in each pixel of the current scene; pixels without a surface have a large depth.

    step: pixels from one measured point to the next; those between get the depth of the nearest one.
    """
    graph = bpy.context.evaluated_depsgraph_get()
    eye, (rows, columns) = Vector(view.eye), (view.shape[0] // step, view.shape[1] // step)
    v, u = (np.mgrid[0:rows, 0:columns] + 0.5) * step
    out = np.full(rows * columns, 1e3, np.float32)
    for index, ray in enumerate(view.rays(u.ravel(), v.ravel())):
        hit, where, *_ = scene.ray_cast(graph, eye, Vector(ray))
        if hit:
            out[index] = (where - eye).dot(Vector(view.axes[2]))
    return out.reshape(rows, columns).repeat(step, 0).repeat(step, 1)


def render(scene: bpy.types.Scene, samples: int, path: Path, region: Region | None = None) -> None:
    """Renders the picture, or only a region (left, top, right, bottom in pixels), to a PNG of that size."""
    scene.cycles.samples = samples
    scene.render.use_border = scene.render.use_crop_to_border = region is not None
    if region:
        left, top, right, bottom = region
        border, wide, high = scene.render, scene.render.resolution_x, scene.render.resolution_y
        border.border_min_x, border.border_max_x = (left + INSIDE) / wide, (right + INSIDE) / wide
        border.border_min_y, border.border_max_y = 1 - (bottom - INSIDE) / high, 1 - (top - INSIDE) / high
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
