"""A full-length studio picture of a person, for a poster on the wall."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import corridor
import light
import numpy as np
from person import Person
from story import Role
from surfaces import material, shape

WIDE, HIGH = 300, 720
STANDING = Role(
    waypoints=((0.0, 0.0, 0.0, 12.0), (6.0, 0.0, 0.0, 12.0)), stepping=(), step=0.5, arms=((0.0, 6.0, "hips"),)
)
BACK, LAMP = (0.30, 0.42, 0.52), 160.0


def studio(scene: bpy.types.Scene) -> None:
    """A coloured backdrop and two lamps."""
    paint = material("backdrop", BACK)
    floor = np.array([[-3, -3, 0], [3, -3, 0], [3, 1.2, 0], [-3, 1.2, 0]])
    shape("floor", floor, [[0, 1, 2, 3]], paint)
    shape("back", floor[:, [0, 2, 1]] + [0, 1.2, 3], [[0, 1, 2, 3]], paint)
    for x in (-1.3, 1.3):
        lamp = light.area((x, -1.5, 2.6), (1.0, 1.0), LAMP)
        lamp.rotation_euler = (math.radians(-35), 0, 0)


def portrait(arrays: dict[str, np.ndarray], name: str, path: Path, samples: int = 8) -> None:
    """Renders the person as a picture of 0.8 m by 1.92 m."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    corridor.settings(scene, 1)
    scene.view_settings.exposure = 0
    scene.render.image_settings.color_depth = "8"
    scene.render.resolution_x, scene.render.resolution_y = WIDE, HIGH
    scene.world = bpy.data.worlds.new("world")
    scene.world.color = (0.25, 0.25, 0.25)
    corridor.quick(scene, True)
    studio(scene)
    data = bpy.data.cameras.new("camera")
    data.type, data.ortho_scale = "ORTHO", 1.96
    holder = bpy.data.objects.new("camera", data)
    holder.location, holder.rotation_euler = (0, -4, 0.93), (math.pi / 2, 0, 0)
    scene.collection.objects.link(holder)
    scene.camera = holder
    person = Person(scene, arrays, name, STANDING, 1)
    person.show(True)
    person.pose(2.0)
    scene.cycles.samples = samples
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
