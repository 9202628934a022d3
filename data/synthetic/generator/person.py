"""A dressed walker in the Blender scene."""

from __future__ import annotations

import os
import pickle
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from body import Body, Part
from carried import Load, loads_of
from gait import Walker
from hair import Strands, beard, strands
from mathutils import Matrix
from posture import Build
from story import Role
from wardrobe import OUTFITS, build_of, dressed

ROUGH = {"skin": 0.5, "eye": 0.12, "hair": 0.6, "cloth": 0.9, "leather": 0.4}


def surface(kind: str, picture: np.ndarray | None = None) -> bpy.types.Material:
    """Takes colour from the vertices, under a fabric; cloth and hair get a fine bump that sticks to the rest shape."""
    made = bpy.data.materials.new(kind)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = ROUGH[kind]
    shader.inputs["Specular IOR Level"].default_value = 0.2 if kind in ("hair", "cloth") else 0.5
    paint = nodes.new("ShaderNodeAttribute")
    paint.attribute_name = "paint"
    colour = paint.outputs["Color"]
    if picture is not None:
        image, mix = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeMixRGB")
        image.image = canvas(picture)
        links.new(image.outputs["Alpha"], mix.inputs[0])
        links.new(colour, mix.inputs[1])
        links.new(image.outputs["Color"], mix.inputs[2])
        colour = mix.outputs[0]
    links.new(colour, shader.inputs["Base Color"])
    if kind in ("cloth", "hair"):
        rest, noise, bump = (nodes.new(f"ShaderNode{n}") for n in ("Attribute", "TexNoise", "Bump"))
        rest.attribute_name = "rest"
        noise.inputs["Scale"].default_value = 45 if kind == "cloth" else 160
        noise.inputs["Detail"].default_value = 3
        bump.inputs["Strength"].default_value = 0.5
        bump.inputs["Distance"].default_value = 0.006
        links.new(rest.outputs["Vector"], noise.inputs["Vector"])
        links.new(noise.outputs["Fac"], bump.inputs["Height"])
        links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    return made


def canvas(picture: np.ndarray) -> bpy.types.Image:
    """A fabric (h, w, 4), linear, bottom row first, as an image."""
    image = bpy.data.images.new("fabric", picture.shape[1], picture.shape[0], alpha=True)
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    image.pixels.foreach_set(np.ascontiguousarray(picture, np.float32).ravel())
    image.pack()
    return image


def hairs(colour: tuple[float, float, float]) -> bpy.types.Material:
    """Strands that differ a little in colour."""
    made = bpy.data.materials.new("strands")
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    shader, info, mix = nodes["Principled BSDF"], nodes.new("ShaderNodeHairInfo"), nodes.new("ShaderNodeMixRGB")
    shader.inputs["Roughness"].default_value = 0.55
    shader.inputs["Specular IOR Level"].default_value = 0.3
    mix.inputs[1].default_value = (*(0.7 * c for c in colour), 1)
    mix.inputs[2].default_value = (*(1.35 * c for c in colour), 1)
    links.new(info.outputs["Random"], mix.inputs[0])
    links.new(mix.outputs[0], shader.inputs["Base Color"])
    return made


def mesh_object(name: str, points: np.ndarray, faces: np.ndarray, colour: np.ndarray) -> bpy.types.Object:
    """A smooth mesh with a colour for every vertex."""
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(points))
    data.vertices.foreach_set("co", np.asarray(points, np.float32).ravel())
    data.loops.add(faces.size)
    data.loops.foreach_set("vertex_index", faces.astype(np.int32).ravel())
    data.polygons.add(len(faces))
    data.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    data.update(calc_edges=True)
    data.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
    paint = data.attributes.new("paint", "FLOAT_COLOR", "POINT")
    shade = np.c_[np.clip(colour, 0.003, 0.9), np.ones(len(colour))]
    paint.data.foreach_set("color", shade.astype(np.float32).ravel())
    return bpy.data.objects.new(name, data)


@dataclass(frozen=True)
class Figure:
    """A dressed body without Blender: parts ready to pose, hair curves, where arms find the trunk."""

    body: Body
    parts: list[Part]
    grown: list[Strands]
    build: Build


FIGURES: dict[tuple[str, int], Figure] = {}
SEWN = Path(os.environ.get("SEWN", "sewn"))


def tailored(arrays: dict[str, np.ndarray], name: str, seed: int) -> Figure:
    """Dresses a body, once for all visits of that person; kept in files, for other clips.

    Delete the folder when bodies or clothes have changed.
    """
    kept = SEWN / f"{name}{seed}.pickle"
    if (name, seed) not in FIGURES and kept.exists():
        FIGURES[name, seed] = pickle.loads(kept.read_bytes())
    if (name, seed) not in FIGURES:
        body, look = Body(arrays, name), OUTFITS[name].look
        parts = dressed(body, OUTFITS[name], seed)
        for part in parts:
            part.rig(body.skeleton.carriers())
        grown = [found for found in (strands(body, look, seed), beard(body, look, seed)) if found and len(found[0])]
        FIGURES[name, seed] = Figure(body, parts, grown, build_of(body, parts))
        SEWN.mkdir(parents=True, exist_ok=True)
        part_file = kept.with_suffix(f".{os.getpid()}")
        part_file.write_bytes(pickle.dumps(FIGURES[name, seed], protocol=5))
        part_file.rename(kept)
    return FIGURES[name, seed]


class Person:
    """A dressed walker in the scene.

    objects: the person with clothes and worn things, the outline that counts. things: what is carried or pushed at
    the time of the last pose.
    """

    def __init__(self, scene: bpy.types.Scene, arrays: dict[str, np.ndarray], name: str, role: Role, seed: int) -> None:
        """Dresses the body of that name; arrays: what anatomy.py wrote."""
        figure = tailored(arrays, name, seed)
        self.name, self.parts, self.build = name, figure.parts, figure.build
        self.walker = Walker(figure.body.skeleton, role, seed, figure.build)
        self.materials = {kind: surface(kind) for kind in ROUGH}
        self.shapes = [self.shape(part) for part in self.parts]
        self.locks = [self.lock(grown, OUTFITS[name].look.hair) for grown in figure.grown]
        self.curves = np.concatenate([grown[0].reshape(-1, 3) for grown in figure.grown] or [np.empty((0, 3))])
        self.objects = self.shapes + self.locks
        self.loads = loads_of(figure.body, figure.build, role.carries, {posture for _, _, posture in role.arms})
        self.hands = [self.thing(load) for load in self.loads]
        self.things: list[bpy.types.Object] = []
        for thing in self.objects + self.hands:
            scene.collection.objects.link(thing)
        self.skull = figure.body.skeleton.index["head"]
        self.show(False)

    def shape(self, part: Part) -> bpy.types.Object:
        """The Blender object of a part."""
        made = mesh_object(f"{self.name} {part.name}", part.mesh.points, part.mesh.faces, part.colour)
        made.data.attributes.new("rest", "FLOAT_VECTOR", "POINT").data.foreach_set(
            "vector", part.rest.astype(np.float32).ravel()
        )
        if part.chart is not None:
            made.data.uv_layers.new(name="chart").data.foreach_set("uv", part.chart.astype(np.float32).ravel())
        own = surface(part.material, part.picture) if part.picture is not None else self.materials[part.material]
        made.data.materials.append(own)
        return made

    def thing(self, load: Load) -> bpy.types.Object:
        """The Blender object of a carried thing."""
        made = mesh_object(f"{self.name} {load.name}", load.points, load.faces, load.colour)
        made.data.polygons.foreach_set("use_smooth", np.zeros(len(load.faces), bool))
        made.data.materials.append(self.materials["leather"])
        return made

    def lock(self, grown: Strands, colour: tuple[float, float, float]) -> bpy.types.Object:
        """Strands that ride on the skull."""
        curves, radii = grown
        data = bpy.data.hair_curves.new(f"{self.name} strands")
        count, knots = curves.shape[:2]
        data.add_curves([knots] * count)
        data.points.foreach_set("position", curves.astype(np.float32).ravel())
        data.points.foreach_set("radius", np.tile(radii, count).astype(np.float32))
        data.materials.append(hairs(colour))
        return bpy.data.objects.new(data.name, data)

    def show(self, visible: bool) -> None:
        """Puts the person, and what is in the hands, in the picture or takes them out."""
        for thing in self.objects + self.hands:
            hidden = not visible or (thing in self.hands and thing not in self.things)
            thing.hide_render = thing.hide_viewport = hidden

    def pose(self, time: float) -> np.ndarray:
        """Moves a shown person and what they carry; all vertices of skin, clothes and hair."""
        transforms = self.walker.pose(time)
        points = []
        for part, shape in zip(self.parts, self.shapes, strict=True):
            points.append(part.posed(transforms))
            shape.data.vertices.foreach_set("co", points[-1].ravel())
            shape.data.update()
        skull = transforms[self.skull]
        for lock in self.locks:
            lock.matrix_world = Matrix(np.vstack([skull, [0, 0, 0, 1]]).tolist())
        points.append(self.curves @ skull[:, :3].T + skull[:, 3])
        self.place_things(transforms, time)
        return np.concatenate(points)

    def place_things(self, transforms: np.ndarray, time: float) -> None:
        """Moves what is in the hands now."""
        held = [load.shown(self.walker, time) for load in self.loads]
        self.things = [thing for thing, there in zip(self.hands, held, strict=True) if there]
        for load, thing, there in zip(self.loads, self.hands, held, strict=True):
            matrix = load.matrix(self.walker, transforms, time)
            thing.matrix_world = Matrix(np.vstack([matrix, [0, 0, 0, 1]]).tolist())
            thing.hide_render = thing.hide_viewport = not there or self.objects[0].hide_render
