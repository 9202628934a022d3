"""Lamps, sun and sky of the corridor, switched by the state of the light."""

from __future__ import annotations

from dataclasses import dataclass, field

import bpy
import numpy as np
from layout import CEILING, HALF, LINTEL, SILL, WALL, Layout, Light, Room
from mathutils import Vector
from surfaces import Blocks, material, shape

HEADROOM = 2.0  # stops that the stored pictures keep above white
WARM, BLUE, SUNNY = (1.0, 0.96, 0.9), (0.78, 0.88, 1.0), (1.0, 0.94, 0.84)
PANEL, STRIP, SPOT, SKY, SUN, GRID = 30.0, 290.0, 34.0, 30.0, 16.0, 30.0
OUTSIDE = 1.6
NEARBY = 3.4
ALONG = (-2.0, -1.0, 0.0, 1.0, 2.0)


def area(where: tuple[float, float, float], size: tuple[float, float], watts: float) -> bpy.types.Object:
    """A rectangular lamp that shines down."""
    data = bpy.data.lights.new("lamp", "AREA")
    data.shape, data.size, data.size_y = "RECTANGLE", size[0], size[1]
    data.energy, data.color = watts, WARM
    made = bpy.data.objects.new("lamp", data)
    made.location = where
    made.visible_camera = False
    bpy.context.scene.collection.objects.link(made)
    return made


def glowing(name: str) -> bpy.types.Material:
    """A sheet that looks bright and lights nothing."""
    made = material(name, (0.9, 0.9, 0.9))
    made.cycles.emission_sampling = "NONE"
    made.node_tree.nodes["Principled BSDF"].inputs["Emission Color"].default_value = (1, 0.97, 0.92, 1)
    return made


def strength(surface: bpy.types.Material, value: float) -> None:
    """How bright a glowing sheet is."""
    surface.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = value


@dataclass
class Lamp:
    """A lamp, its full power, and the sheet that one sees."""

    thing: bpy.types.Object
    watts: float
    sheet: bpy.types.Material


@dataclass
class Rig:
    """All lights of a corridor."""

    kind: str
    way: np.ndarray
    lamps: list[Lamp] = field(default_factory=list)
    sky: list[bpy.types.Object] = field(default_factory=list)
    sun: bpy.types.Object | None = None
    outside: bpy.types.Material | None = None

    def lit(self, light: Light) -> list[Lamp]:
        """The lamps that are on."""
        return [lamp for number, lamp in enumerate(self.lamps, 1) if light.lamps and number % light.every == 0]

    def switch(self, light: Light) -> None:
        """Sets everything to a state."""
        bpy.context.scene.world.color = light.ambient
        lit = self.lit(light)
        for lamp in self.lamps:
            on = any(lamp is other for other in lit)
            lamp.thing.hide_render = not on
            lamp.thing.data.energy = lamp.watts * light.lamps
            strength(lamp.sheet, 2.5 * light.lamps if on else 0.0)
        for window in self.sky:
            window.hide_render = not light.sky
            window.data.energy = SKY * light.sky
        if self.sun and self.outside:
            self.sun.hide_render = not light.sun
            self.sun.data.energy = SUN * light.sun
            strength(self.outside, 4.0 * light.sky)

    def casters(self, light: Light, y: float) -> list[np.ndarray]:
        """Points that light a person at y from above, whose shadows can be seen."""
        if self.kind == "strip":
            return [np.array([0.0, y + step, CEILING]) for step in ALONG]
        places = [np.array(lamp.thing.location) for lamp in self.lit(light)]
        return [place for place in places if abs(place[1] - y) < (1.5 if self.kind == "grid" else NEARBY)]


def ceiling_lamps(blocks: Blocks, layout: Layout, rig: Rig) -> None:
    """Square panels, one long strip, or small round-the-clock spots."""
    if layout.lamps == "strip":
        middle, length = (layout.back + layout.length) / 2, layout.length - layout.back - 0.4
        spans = [(middle, (0.16, length), STRIP)]
    elif layout.lamps == "spots":
        spans = [(float(y), (0.18, 0.18), SPOT) for y in np.arange(1.6, layout.length, 2.6)]
    else:
        spans = [(float(y), (0.64, 0.64), PANEL) for y in np.arange(0.2, layout.length, 2.4)]
    for number, (y, (wide, long), watts) in enumerate(spans):
        name = f"glow {number}"
        sheet = blocks.surfaces[name] = glowing(name)
        low, high = CEILING - (0.012 if layout.lamps == "strip" else 0.03), CEILING
        blocks.box((-wide / 2, y - long / 2, low), (wide / 2, y + long / 2, high), name)
        size = (wide * 0.94, long * 0.94 if layout.lamps != "strip" else long)
        rig.lamps.append(Lamp(area((0, y, low - 0.005), size, watts), watts, sheet))


def daylight(layout: Layout, rig: Rig) -> None:
    """A sun, a patch of sky in every window, and a bright outside that only the camera and reflections see."""
    data = bpy.data.lights.new("sun", "SUN")
    data.angle, data.color = np.radians(0.6), SUNNY
    rig.sun = bpy.data.objects.new("sun", data)
    rig.sun.rotation_euler = Vector(layout.sun).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(rig.sun)
    for side, low, high in layout.windows:
        pane = area(
            (side * (HALF + WALL + 0.02), (low + high) / 2, (SILL + LINTEL) / 2), (LINTEL - SILL, high - low), SKY
        )
        pane.rotation_euler = (0, side * np.pi / 2, 0)
        pane.data.color = BLUE
        rig.sky.append(pane)
    x = HALF + OUTSIDE
    rig.outside = glowing("outside")
    corners = np.array(
        [[x, layout.back, -3], [x, layout.length + 3, -3], [x, layout.length + 3, 6], [x, layout.back, 6]]
    )
    sheet = shape("outside", corners, [[0, 1, 2, 3]], rig.outside)
    sheet.visible_diffuse = sheet.visible_shadow = sheet.visible_transmission = False


def grid_lamps(blocks: Blocks, room: Room) -> Rig:
    """Square panels all over the ceiling of a room, and in the passage behind it."""
    rig = Rig("grid", np.array([0.0, 0.0, -1.0]))
    columns = np.linspace(-room.half, room.half, round(2 * room.half / 2.2) + 1)
    rows = np.linspace(room.back, room.depth, round((room.depth - room.back) / 2.4) + 1)
    places = [(x, y) for y in (rows[1:] + rows[:-1]) / 2 for x in (columns[1:] + columns[:-1]) / 2]
    places += [(x, room.depth + room.passage / 2) for x in (-1.5, 1.5)] if room.doorways else []
    for number, (x, y) in enumerate(places):
        name = f"glow {number}"
        sheet = blocks.surfaces[name] = glowing(name)
        blocks.box((x - 0.3, y - 0.3, room.ceiling - 0.03), (x + 0.3, y + 0.3, room.ceiling), name)
        rig.lamps.append(Lamp(area((x, y, room.ceiling - 0.035), (0.56, 0.56), GRID), GRID, sheet))
    return rig


def build(blocks: Blocks, layout: Layout) -> Rig:
    """All lights, and their sheets among the blocks."""
    sun = np.array(layout.sun, float)
    rig = Rig(layout.lamps, sun / np.linalg.norm(sun))
    ceiling_lamps(blocks, layout, rig)
    if layout.windows:
        daylight(layout, rig)
    return rig
