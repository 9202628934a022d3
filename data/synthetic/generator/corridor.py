"""The corridor and its light in Blender."""

from __future__ import annotations

import bpy
import numpy as np
from camera import HEIGHT, WIDTH, mount

Material = bpy.types.Material
Vector3 = tuple[float, float, float]
Span = tuple[float, float]

HALF, LENGTH, CEILING, WALL = 1.5, 17.0, 2.75, 0.1
DOORWAYS = ((-1, 11.45, 12.45), (1, 10.75, 11.75), (1, 7.6, 8.6))
CLOSED = ((-1, 3.6, 4.5), (1, 4.4, 5.3), (-1, 8.3, 9.2), (1, 13.6, 14.5), (-1, 14.8, 15.7))


def material(name: str, colour: Vector3, rough: float = 0.8, speckle: float = 0.0, scale: float = 4.0) -> Material:
    """A plain surface, with some large-scale unevenness."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1)
    shader.inputs["Roughness"].default_value = rough
    if speckle:
        noise, mix = nodes.new("ShaderNodeTexNoise"), nodes.new("ShaderNodeMixRGB")
        noise.inputs["Scale"].default_value = scale
        noise.inputs["Detail"].default_value = 6
        mix.inputs[1].default_value = (*(c * (1 - speckle) for c in colour), 1)
        mix.inputs[2].default_value = (*(min(1, c * (1 + speckle)) for c in colour), 1)
        links.new(noise.outputs["Fac"], mix.inputs[0])
        links.new(mix.outputs[0], shader.inputs["Base Color"])
    return made


def box(low: Vector3, high: Vector3, surface: Material) -> None:
    """An axis-aligned block."""
    bpy.ops.mesh.primitive_cube_add(size=1, location=[(a + b) / 2 for a, b in zip(low, high, strict=True)])
    block = bpy.context.object
    block.scale = [b - a for a, b in zip(low, high, strict=True)]
    block.data.materials.append(surface)


def side_box(side: int, depth: Span, y: Span, z: Span, surface: Material) -> None:
    """A block on the left (-1) or right (1) wall; depth grows into the corridor."""
    x = sorted(side * (HALF - d) for d in depth)
    box((x[0], y[0], z[0]), (x[1], y[1], z[1]), surface)


def walls() -> None:
    """Side walls with doorways, and a small lit room behind each."""
    paint = material("wall", (0.66, 0.64, 0.58), speckle=0.04, scale=1.5)
    skirt = material("skirting", (0.2, 0.19, 0.18), 0.5)
    for side in (-1, 1):
        start = -1.5
        for _, low, high in sorted(d for d in DOORWAYS if d[0] == side):
            side_box(side, (-WALL, 0), (start, low), (0, CEILING), paint)
            side_box(side, (0, 0.015), (start, low - 0.08), (0, 0.09), skirt)
            side_box(side, (-WALL, 0), (low, high), (2.1, CEILING), paint)
            room(side, low, high, paint)
            start = high
        side_box(side, (-WALL, 0), (start, LENGTH), (0, CEILING), paint)
        side_box(side, (0, 0.015), (start + 0.08, LENGTH), (0, 0.09), skirt)
    box((-HALF, LENGTH, 0), (HALF, LENGTH + 0.1, CEILING), paint)


def room(side: int, low: float, high: float, paint: Material) -> None:
    """What one sees through a doorway."""
    far = -2.6
    side_box(side, (far - 0.1, far), (low - 1, high + 1), (0, CEILING), paint)
    for y in (low - 1, high + 1):
        side_box(side, (far, -WALL), (y - 0.05, y + 0.05), (0, CEILING), paint)
    side_box(side, (far, -WALL), (low - 1, high + 1), (CEILING, CEILING + 0.05), paint)
    side_box(side, (far, -WALL), (low - 1, high + 1), (-0.1, 0.0), bpy.data.materials["floor"])
    lamp((side * (HALF + 1.3), (low + high) / 2, CEILING - 0.05), 40, 0.8)


def doors() -> None:
    """Frames of all doors, leaves of the closed ones."""
    leaf = material("leaf", (0.27, 0.15, 0.075), 0.45, 0.2, 9)
    frame = material("frame", (0.13, 0.13, 0.14), 0.5)
    steel = material("steel", (0.5, 0.5, 0.5), 0.25)
    for side, low, high in DOORWAYS + CLOSED:
        for y in ((low - 0.07, low), (high, high + 0.07)):
            side_box(side, (-0.01, 0.02), y, (0, 2.17), frame)
        side_box(side, (-0.01, 0.02), (low, high), (2.1, 2.17), frame)
    for side, low, high in CLOSED:
        side_box(side, (0, 0.008), (low, high), (0.005, 2.1), leaf)
        side_box(side, (0.008, 0.06), (high - 0.14, high - 0.04), (1.02, 1.05), steel)
    box((-0.5, LENGTH - 0.02, 0), (0.5, LENGTH, 2.1), leaf)


def furniture() -> None:
    """Small things that make it a used corridor: notice board, sign, radiator, extinguisher."""
    cork, sheet = material("cork", (0.3, 0.19, 0.1), 0.9, 0.2, 40), material("paper", (0.75, 0.75, 0.72))
    side_box(1, (0, 0.02), (5.9, 7.0), (1.1, 1.85), cork)
    for k, (y, z) in enumerate(((6.0, 1.5), (6.3, 1.45), (6.6, 1.52), (6.05, 1.15), (6.45, 1.13))):
        side_box(1, (0.02, 0.023), (y, y + 0.21), (z, z + 0.29 - 0.02 * k), sheet)
    side_box(-1, (0.02, 0.09), (6.0, 7.4), (0.12, 0.72), material("radiator", (0.6, 0.6, 0.58), 0.4))
    side_box(-1, (0.0, 0.14), (10.3, 10.45), (0.7, 1.15), material("red", (0.45, 0.02, 0.02), 0.3))
    box((-0.2, LENGTH - 0.06, 2.22), (0.2, LENGTH, 2.4), material("exit", (0.02, 0.3, 0.09), 0.4))


def lamp(where: Vector3, watts: float, size: float) -> None:
    """A square ceiling light."""
    bpy.ops.object.light_add(type="AREA", location=where)
    light = bpy.context.object.data
    light.energy, light.size, light.color = watts, size, (1.0, 0.96, 0.9)


def panel(y: float) -> None:
    """A ceiling light that one sees: a lamp under a glowing sheet that itself lights nothing."""
    glow = material("glow", (0.9, 0.9, 0.9))
    glow.node_tree.nodes["Principled BSDF"].inputs["Emission Color"].default_value = (1, 0.97, 0.92, 1)
    glow.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 2.5
    glow.cycles.emission_sampling = "NONE"
    box((-0.32, y - 0.32, CEILING - 0.03), (0.32, y + 0.32, CEILING), glow)
    lamp((0, y, CEILING - 0.035), 30, 0.6)


def settings(scene: bpy.types.Scene, threads: int) -> None:
    """Path tracing on the CPU, denoised, with few bounces."""
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.threads_mode, render.threads = "FIXED", threads
    render.resolution_x, render.resolution_y = WIDTH, HEIGHT
    render.image_settings.file_format = "PNG"
    render.use_persistent_data = True
    scene.view_settings.view_transform = "Standard"
    cycles.device, cycles.use_denoising, cycles.seed = "CPU", True, 0
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 4, 3, 2
    cycles.caustics_reflective = cycles.caustics_refractive = False


def build(threads: int) -> bpy.types.Scene:
    """The empty corridor with camera and light, ready to render."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    settings(scene, threads)
    scene.world = bpy.data.worlds.new("world")
    floor = material("floor", (0.30, 0.29, 0.27), 0.28, 0.12, 6)
    box((-HALF, -1.5, -0.1), (HALF, LENGTH, 0), floor)
    box((-HALF, -1.5, CEILING), (HALF, LENGTH, CEILING + 0.1), material("ceiling", (0.8, 0.8, 0.78)))
    walls()
    doors()
    furniture()
    for y in np.arange(0.2, LENGTH, 2.4):
        panel(float(y))
    mount(scene)
    return scene
