"""A room in Blender: four walls, doorways to a passage behind the far one, furniture, panes of glass."""

from __future__ import annotations

import bpy
import corridor
import furniture
import light
from camera import mount
from layout import DOOR, WALL, Room
from optics import View
from surfaces import Blocks, material, shape

SKIRTING, PANE = 0.09, 2.3
REFLECTED = 0.2


def openings(blocks: Blocks, room: Room) -> None:
    """The far wall with its doorways and their frames."""
    start, y = -room.half, (room.depth, room.depth + WALL)
    for low, high in [*sorted(room.doorways), (room.half, room.half)]:
        blocks.box((start, y[0], 0), (low, y[1], room.ceiling), "wall")
        blocks.box((start, y[0] - 0.015, 0), (low, y[0], SKIRTING), "skirting")
        blocks.box((low, y[0], DOOR), (high, y[1], room.ceiling), "wall")
        for edge in (low - 0.07, high) if high > low else ():
            blocks.box((edge, y[0] - 0.02, 0), (edge + 0.07, y[1] + 0.02, DOOR + 0.07), "frame")
        blocks.box((low, y[0] - 0.02, DOOR), (high, y[1] + 0.02, DOOR + 0.07), "frame")
        start = high


def walls(blocks: Blocks, room: Room) -> None:
    """Everything else that is flat; the passage is as wide as the room."""
    end = room.depth + (room.passage if room.doorways else 0) + WALL
    half, top = room.half, room.ceiling
    blocks.box((-half, room.back, -0.1), (half, end, 0), "floor")
    blocks.box((-half, room.back, top), (half, end, top + 0.1), "ceiling")
    for side in (-1, 1):
        low, high = sorted((side * half, side * (half + WALL)))
        blocks.box((low, room.back, 0), (high, end, top), "wall")
        low, high = sorted((side * half, side * (half - 0.015)))
        blocks.box((low, room.back, 0), (high, room.depth, SKIRTING), "skirting")
    blocks.box((-half, room.back - WALL, 0), (half, room.back, top), "wall")
    blocks.box((-half, end, 0), (half, end + WALL, top), "accent")
    if room.doorways:
        openings(blocks, room)


def glass() -> bpy.types.Material:
    """A pane that lets light through and mirrors a part of the room."""
    made = bpy.data.materials.new("glass")
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    clear, mirror, mix = (nodes.new(f"ShaderNode{n}") for n in ("BsdfTransparent", "BsdfGlossy", "MixShader"))
    clear.inputs[0].default_value, mirror.inputs["Roughness"].default_value = (0.86, 0.92, 0.9, 1), 0.02
    mix.inputs[0].default_value = REFLECTED
    links.new(clear.outputs[0], mix.inputs[1])
    links.new(mirror.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], nodes["Material Output"].inputs["Surface"])
    return made


def panes(blocks: Blocks, room: Room) -> None:
    """Glass walls: panes in frames, which rays that measure depth do not meet."""
    surface = glass() if room.glass else None
    for y, low, high in room.glass:
        corners = [[low, y, 0.05], [high, y, 0.05], [high, y, PANE], [low, y, PANE]]
        made = shape("pane", corners, [[0, 1, 2, 3]], surface)
        made.hide_viewport = True
        made.visible_shadow = False
        for edge in (low, (low + high) / 2, high):
            blocks.box((edge - 0.02, y - 0.025, 0), (edge + 0.02, y + 0.025, PANE), "bar")
        for z in (0.0, PANE - 0.02):
            blocks.box((low, y - 0.025, z), (high, y + 0.025, z + 0.06), "bar")


def build(room: Room, view: View, threads: int, picture: str | None = None) -> tuple[bpy.types.Scene, light.Rig, list]:
    """The empty room with camera and light, its rig, and the things in it that could be taken for people."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    corridor.settings(scene, threads)
    scene.world = bpy.data.worlds.new("world")
    own = {
        "wall": material("wall", room.wall, speckle=0.04, scale=0.9),
        "floor": material("floor", room.floor, 0.4, 0.15, 2.5),
        "accent": material("accent", room.accent, 0.8, 0.05, 1.0),
    }
    blocks = Blocks(corridor.surfaces() | own)
    walls(blocks, room)
    rig = light.grid_lamps(blocks, room)
    panes(blocks, room)
    placed = furniture.place(blocks, room.things, picture)
    blocks.build(scene)
    mount(scene, view)
    return scene, rig, placed
