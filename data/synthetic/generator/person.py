"""A dressed walker in the Blender scene."""

from __future__ import annotations

import bpy
import numpy as np
from body import Body, Part
from camera import HEIGHT, ORIGIN, WIDTH, pixel_ray
from corridor import material
from gait import Walker
from hair import strands
from mathutils import Matrix
from story import Role
from wardrobe import OUTFITS, dressed

RAYS = (16, 40)
ROUGH = {"skin": 0.5, "eye": 0.12, "hair": 0.6, "cloth": 0.9, "leather": 0.4}


def surface(kind: str) -> bpy.types.Material:
    """Takes colour from the vertices; cloth and hair get a fine bump that sticks to the rest shape."""
    made = bpy.data.materials.new(kind)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = ROUGH[kind]
    paint = nodes.new("ShaderNodeAttribute")
    paint.attribute_name = "paint"
    links.new(paint.outputs["Color"], shader.inputs["Base Color"])
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


class Person:
    """A dressed walker in the scene."""

    def __init__(self, scene: bpy.types.Scene, arrays: dict[str, np.ndarray], name: str, role: Role, seed: int) -> None:
        """Dresses the body of that name; arrays: what anatomy.py wrote."""
        body = Body(arrays, name)
        self.name, self.walker = name, Walker(body.skeleton, role, seed)
        self.parts = dressed(body, OUTFITS[name], seed)
        self.materials = {kind: surface(kind) for kind in ROUGH}
        self.objects = [self.shape(part) for part in self.parts] + [self.hair(body, seed)]
        for thing in self.objects:
            scene.collection.objects.link(thing)
        self.skull = body.skeleton.index["head"]
        self.show(False)

    def shape(self, part: Part) -> bpy.types.Object:
        """The Blender object of a part."""
        data = bpy.data.meshes.new(f"{self.name} {part.name}")
        data.from_pydata(part.mesh.points.tolist(), [], part.mesh.faces.tolist())
        data.polygons.foreach_set("use_smooth", np.ones(len(part.mesh.faces), bool))
        paint = data.attributes.new("paint", "FLOAT_COLOR", "POINT")
        paint.data.foreach_set("color", np.c_[np.clip(part.colour, 0.003, 0.9), np.ones(len(part.colour))].ravel())
        data.attributes.new("rest", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", part.rest.ravel())
        data.materials.append(self.materials[part.material])
        return bpy.data.objects.new(data.name, data)

    def hair(self, body: Body, seed: int) -> bpy.types.Object:
        """Strands that ride on the skull."""
        outfit = OUTFITS[self.name]
        curves, radii = strands(body, outfit, 9000 if outfit.long_hair else 6000, seed)
        data = bpy.data.hair_curves.new(f"{self.name} strands")
        count, knots = curves.shape[:2]
        data.add_curves([knots] * count)
        data.points.foreach_set("position", curves.ravel())
        data.points.foreach_set("radius", np.tile(radii, count))
        data.materials.append(material(f"{self.name} hair", outfit.hair, 0.55))
        self.curves = curves.reshape(-1, 3)
        return bpy.data.objects.new(data.name, data)

    def show(self, visible: bool) -> None:
        """Puts the person in the picture or takes them out."""
        for thing in self.objects:
            thing.hide_render = thing.hide_viewport = not visible

    def pose(self, time: float) -> np.ndarray:
        """Moves the person and returns all vertices of skin, clothes and hair."""
        transforms = self.walker.pose(time)
        points = []
        for part, thing in zip(self.parts, self.objects, strict=False):
            points.append(part.posed(transforms))
            thing.data.vertices.foreach_set("co", points[-1].ravel())
            thing.data.update()
        skull = transforms[self.skull]
        self.objects[-1].matrix_world = Matrix(np.vstack([skull, [0, 0, 0, 1]]).tolist())
        points.append(self.curves @ skull[:, :3].T + skull[:, 3])
        return np.concatenate(points)

    def visible_share(self, scene: bpy.types.Scene, pixels: np.ndarray) -> float:
        """Share of the own outline that is inside the picture and not hidden; pixels: projected vertices."""
        graph = bpy.context.view_layer.depsgraph
        seen = own = 0
        low, high = pixels.min(0), pixels.max(0)
        for u in low[0] + (np.arange(RAYS[0]) + 0.5) / RAYS[0] * (high[0] - low[0]):
            for v in low[1] + (np.arange(RAYS[1]) + 0.5) / RAYS[1] * (high[1] - low[1]):
                ray = pixel_ray(u, v)
                if not any(thing.ray_cast(ORIGIN, ray)[0] for thing in self.objects[:-1]):
                    continue
                own += 1
                inside = 0 <= u < WIDTH and 0 <= v < HEIGHT
                seen += inside and scene.ray_cast(graph, ORIGIN, ray)[4] in self.objects
        return seen / max(own, 1)
