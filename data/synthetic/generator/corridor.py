"""The corridor in Blender: walls with doors and windows, floor, ceiling."""

from __future__ import annotations

import bpy
import furniture
import light
import numpy as np
from camera import mount
from layout import CEILING, DOOR, HALF, LINTEL, SILL, WALL, Layout, Opening
from optics import View
from surfaces import Blocks, Span, material

__all__ = ["build", "material", "settings"]

FRONT = 0.02
AROUND = 2.0  # m within which things keep ambient light away


def wall(blocks: Blocks, layout: Layout, side: int) -> None:
    """A side wall with its doorways and windows, and a skirting."""
    holes = [(low, high, 0.0, DOOR) for where, low, high in layout.doorways if where == side]
    holes += [(low, high, SILL, LINTEL) for where, low, high in layout.windows if where == side]
    start = layout.back
    for low, high, bottom, top in [*sorted(holes), (layout.length, layout.length, 0.0, 0.0)]:
        blocks.side(side, (-WALL, 0), (start, low), (0, CEILING), "wall")
        blocks.side(side, (-WALL, 0), (low, high), (top, CEILING), "wall")
        blocks.side(side, (-WALL, 0), (low, high), (0, bottom), "wall")
        if bottom > 0:
            blocks.side(side, (0, 0.015), (low, high), (0, 0.09), "skirting")
        blocks.side(side, (0, 0.015), (start + (0 if bottom else 0.08), low - 0.08), (0, 0.09), "skirting")
        start = high


def room(blocks: Blocks, opening: Opening, layout: Layout) -> None:
    """What one sees through a doorway: a small lit room."""
    side, low, high = opening
    far = -2.6
    y: Span = (low - 1, high + 1)
    blocks.side(side, (far - 0.1, far), y, (0, CEILING), "wall")
    for edge in y:
        blocks.side(side, (far, -WALL), (edge - 0.05, edge + 0.05), (0, CEILING), "wall")
    blocks.side(side, (far, -WALL), y, (CEILING, CEILING + 0.05), "wall")
    blocks.side(side, (far, -WALL), y, (-0.1, 0.0), "floor")
    light.area((side * (HALF + 1.3), (low + high) / 2, CEILING - 0.05), (0.8, 0.8), 40)
    if layout.walled and layout.windows:
        blocks.side(side, (far - 0.02, far), y, (CEILING, CEILING + 0.4), "wall")


def doors(blocks: Blocks, layout: Layout) -> None:
    """Frames of all doors, leaves of the closed ones, and a door at the end."""
    for side, low, high in layout.doorways + layout.closed:
        for y in ((low - 0.07, low), (high, high + 0.07)):
            blocks.side(side, (-0.01, FRONT), y, (0, 2.17), "frame")
        blocks.side(side, (-0.01, FRONT), (low, high), (DOOR, 2.17), "frame")
    for side, low, high in layout.closed:
        blocks.side(side, (0, 0.008), (low, high), (0.005, DOOR), "leaf")
        blocks.side(side, (0.008, 0.06), (high - 0.14, high - 0.04), (1.02, 1.05), "steel")
    blocks.box((-0.5, layout.length - 0.02, 0), (0.5, layout.length, DOOR), "leaf")
    blocks.box((-0.2, layout.length - 0.06, 2.22), (0.2, layout.length, 2.4), "exit")


def panes(layout: Layout) -> np.ndarray:
    """The glass of the windows (n, 4): y from, y to, z from, z to; two a window."""
    out = [
        (low + (high - low) * part, low + (high - low) * (part + 0.5), SILL, LINTEL)
        for _, low, high in layout.windows
        for part in (0, 0.5)
    ]
    return np.array(out).reshape(-1, 4)


def windows(blocks: Blocks, layout: Layout) -> None:
    """Frames and crossbars, a sill, and the brightness outside."""
    for side, low, high in layout.windows:
        middle, bar = (low + high) / 2, 0.03
        for y in ((low, low + bar), (middle - bar, middle + bar), (high - bar, high)):
            blocks.side(side, (-0.07, -0.02), y, (SILL, LINTEL), "bar")
        for z in ((SILL, SILL + bar), (LINTEL - bar, LINTEL), (1.85, 1.85 + bar)):
            blocks.side(side, (-0.07, -0.02), (low, high), z, "bar")
        blocks.side(side, (-WALL, 0.12), (low - 0.05, high + 0.05), (SILL - 0.03, SILL), "bar")


def settings(scene: bpy.types.Scene, threads: int) -> None:
    """Path tracing on the CPU, denoised with the help of albedo and normals, few bounces, much headroom for light."""
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.threads_mode, render.threads = "FIXED", threads
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode, render.image_settings.color_depth = "RGB", "16"
    render.image_settings.compression = 5
    render.use_persistent_data = True
    render.use_compositing = render.use_sequencer = False
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.exposure = -light.HEADROOM
    cycles.device, cycles.seed = "CPU", 0
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "FAST"
    cycles.use_adaptive_sampling = False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 3, 2, 1
    cycles.transmission_bounces, cycles.transparent_max_bounces = 1, 4
    cycles.sample_clamp_indirect = 4.0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    scene.cycles_curves.shape = "RIBBONS"


def quick(scene: bpy.types.Scene, on: bool) -> None:
    """Whether light that surfaces throw back is only estimated from the ambient light, at a quarter of the cost."""
    cycles = scene.cycles
    cycles.use_fast_gi, cycles.fast_gi_method, cycles.ao_bounces_render = on, "REPLACE", 1
    scene.world.light_settings.distance = AROUND


def surfaces() -> dict[str, bpy.types.Material]:
    """The building's materials by name."""
    return {
        "wall": material("wall", (0.66, 0.64, 0.58), speckle=0.04, scale=0.9),
        "skirting": material("skirting", (0.2, 0.19, 0.18), 0.5),
        "floor": material("floor", (0.30, 0.29, 0.27), 0.32, 0.12, 1.2),
        "ceiling": material("ceiling", (0.8, 0.8, 0.78)),
        "leaf": material("leaf", (0.27, 0.15, 0.075), 0.45, 0.2, 6),
        "frame": material("frame", (0.13, 0.13, 0.14), 0.5),
        "steel": material("steel", (0.5, 0.5, 0.5), 0.25),
        "exit": material("exit", (0.02, 0.3, 0.09), 0.4),
        "bar": material("bar", (0.62, 0.62, 0.6), 0.5),
        **furniture.surfaces(),
    }


def build(
    layout: Layout, view: View, threads: int, picture: str | None = None
) -> tuple[bpy.types.Scene, light.Rig, list]:
    """The empty corridor with camera and light, its rig, and the things in it; picture: of a person, for posters."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    settings(scene, threads)
    scene.world = bpy.data.worlds.new("world")
    blocks = Blocks(surfaces())
    blocks.box((-HALF, layout.back, -0.1), (HALF, layout.length, 0), "floor")
    blocks.box((-HALF, layout.back, CEILING), (HALF, layout.length, CEILING + 0.1), "ceiling")
    for side in (-1, 1):
        wall(blocks, layout, side)
    blocks.box((-HALF, layout.length, 0), (HALF, layout.length + 0.1, CEILING), "wall")
    if layout.walled:
        blocks.box((-HALF, layout.back - 0.1, 0), (HALF, layout.back, CEILING), "wall")
    for opening in layout.doorways:
        room(blocks, opening, layout)
    doors(blocks, layout)
    windows(blocks, layout)
    rig = light.build(blocks, layout)
    objects = furniture.place(blocks, layout.things, picture)
    blocks.build(scene)
    mount(scene, view)
    return scene, rig, objects
