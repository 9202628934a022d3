"""Plain surfaces and blocks, gathered into one mesh a material."""

from __future__ import annotations

from collections import defaultdict

import bpy
import numpy as np
from layout import HALF

Material = bpy.types.Material
Vector3 = tuple[float, float, float]
Span = tuple[float, float]

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
THIN = 1e-4


def material(name: str, colour: Vector3, rough: float = 0.8, speckle: float = 0.0, scale: float = 4.0) -> Material:
    """A plain surface, with some unevenness of so many spots a metre."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1)
    shader.inputs["Roughness"].default_value = rough
    if speckle:
        place, noise, mix = (nodes.new(f"ShaderNode{n}") for n in ("TexCoord", "TexNoise", "MixRGB"))
        links.new(place.outputs["Object"], noise.inputs["Vector"])
        noise.inputs["Scale"].default_value = scale
        noise.inputs["Detail"].default_value = 6
        mix.inputs[1].default_value = (*(c * (1 - speckle) for c in colour), 1)
        mix.inputs[2].default_value = (*(min(1, c * (1 + speckle)) for c in colour), 1)
        links.new(noise.outputs["Fac"], mix.inputs[0])
        links.new(mix.outputs[0], shader.inputs["Base Color"])
    return made


def shape(name: str, points: np.ndarray, faces: list, surface: Material, smooth: bool = False) -> bpy.types.Object:
    """A mesh object in the scene."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(np.asarray(points).tolist(), [], [list(map(int, face)) for face in faces])
    data.polygons.foreach_set("use_smooth", np.full(len(data.polygons), smooth))
    data.materials.append(surface)
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    return made


class Blocks:
    """Axis-aligned blocks by material."""

    def __init__(self, surfaces: dict[str, Material]) -> None:
        """Materials by name."""
        self.surfaces = surfaces
        self.spans: dict[str, list[np.ndarray]] = defaultdict(list)

    def box(self, low: Vector3, high: Vector3, surface: str) -> None:
        """A block; one without thickness is left out."""
        low, high = np.array(low, float), np.array(high, float)
        if (high - low > THIN).all():
            self.spans[surface].append(low + CORNERS * (high - low))

    def side(self, side: int, depth: Span, y: Span, z: Span, surface: str) -> None:
        """A block on the left (-1) or right (1) wall; depth grows into the corridor."""
        x = sorted(side * (HALF - d) for d in depth)
        self.box((x[0], y[0], z[0]), (x[1], y[1], z[1]), surface)

    def build(self, scene: bpy.types.Scene) -> None:
        """One mesh object a material."""
        for name, spans in self.spans.items():
            faces = np.concatenate([SIDES + 8 * k for k in range(len(spans))])
            shape(name, np.concatenate(spans), faces.tolist(), self.surfaces[name])
