"""A simulated place in MuJoCo (extra ``sim``): room, people and the robot's head, and the pictures of its camera."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from socialbot.agents.base.mujoco import load_mujoco
from socialbot.core.errors import InstallationError
from socialbot.robots.simulation.figure import Colour, Figure, Part
from socialbot.robots.simulation.place import Place, placed
from socialbot.robots.simulation.posture import Frame
from socialbot.robots.simulation.truth import CAMERA_HEIGHT_M, LENS_AHEAD_M

_WALL_M = 0.06


class Scene:
    """Drawing of a place with people.

    Args:
        place: Room and furniture.
        figures: People by id. They are below the floor until `put` places them.
        size: Width and height of the pictures, px.
        hfov_rad: Horizontal field of view of the camera.
        shadows: Whether a lamp casts shadows, at half the speed.
    """

    def __init__(
        self,
        place: Place,
        figures: Mapping[str, Figure],
        *,
        size: tuple[int, int] = (640, 480),
        hfov_rad: float = 1.09,
        shadows: bool = False,
    ) -> None:
        mujoco = self._mujoco = load_mujoco()
        self.size, self.hfov_rad = size, hfov_rad
        spec = mujoco.MjSpec()
        spec.visual.global_.offwidth, spec.visual.global_.offheight = max(size[0], 960), max(size[1], 720)
        spec.visual.map.znear, spec.visual.map.zfar = 0.002, 3.0
        spec.visual.quality.shadowsize, spec.visual.quality.offsamples = 1024, 2
        spec.stat.extent, spec.stat.center = 10.0, (4.0, 0.0, 1.0)
        ambient, diffuse = (0.50, 0.50, 0.51), (0.28, 0.28, 0.28)
        spec.visual.headlight.ambient, spec.visual.headlight.diffuse = ambient, diffuse
        spec.visual.headlight.specular = (0.0, 0.0, 0.0)
        self._textures(spec)
        self._room(spec, place, shadows)
        for name, body in figures.items():
            self._person(spec, name, body)
        self._robot(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._mocap = {
            (name, segment): int(self.model.body(f"{name} {segment}").mocapid[0])
            for name, body in figures.items()
            for segment in (*body.joints, "spot")
        }
        for number in self._mocap.values():
            self.data.mocap_pos[number] = (0.0, 0.0, -10.0)
        self._renderers: dict[tuple[int, int], Any] = {}
        self._option = mujoco.MjvOption()

    def _textures(self, spec: Any) -> None:
        mujoco = self._mujoco
        kinds, marks, builtin = mujoco.mjtTexture, mujoco.mjtMark, mujoco.mjtBuiltin
        spec.add_texture(
            name="cloth", type=kinds.mjTEXTURE_CUBE, builtin=builtin.mjBUILTIN_FLAT, mark=marks.mjMARK_RANDOM,
            rgb1=(1.0,) * 3, rgb2=(1.0,) * 3, markrgb=(0.86,) * 3, random=0.35, width=128, height=128 * 6,
        )  # fmt: skip
        spec.add_texture(
            name="floor", type=kinds.mjTEXTURE_2D, builtin=builtin.mjBUILTIN_CHECKER, mark=marks.mjMARK_EDGE,
            rgb1=(1, 1, 1), rgb2=(0.94, 0.94, 0.94), markrgb=(0.75, 0.75, 0.75), width=256, height=256,
        )  # fmt: skip
        cloth = spec.add_material(name="cloth", specular=0.05, shininess=0.05)
        floor = spec.add_material(name="floor", specular=0.2, shininess=0.3, texrepeat=(1.2, 1.2), texuniform=True)
        for material in (cloth, floor):
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = material.name

    def _geom(self, body: Any, shape: str, colour: Colour, material: str = "", alpha: float = 1.0, **rest: Any) -> None:
        kind = getattr(self._mujoco.mjtGeom, f"mjGEOM_{shape.upper()}")
        body.add_geom(type=kind, rgba=(*colour, alpha), material=material, contype=0, conaffinity=0, **rest)

    def _room(self, spec: Any, place: Place, shadows: bool) -> None:
        world = spec.worldbody
        x0, x1, y0, y1 = place.size
        middle, high = ((x0 + x1) / 2, (y0 + y1) / 2), place.height
        self._geom(world, "plane", place.floor, "floor", pos=(*middle, 0.0), size=((x1 - x0) / 2, (y1 - y0) / 2, 0.1))
        ceiling = (0.93, 0.93, 0.92)
        self._geom(world, "box", ceiling, pos=(*middle, high + 0.05), size=((x1 - x0) / 2, (y1 - y0) / 2, 0.05))
        for x, y, half_x, half_y in (
            (x0 - _WALL_M, middle[1], _WALL_M, (y1 - y0) / 2),
            (x1 + _WALL_M, middle[1], _WALL_M, (y1 - y0) / 2),
            (middle[0], y0 - _WALL_M, (x1 - x0) / 2, _WALL_M),
            (middle[0], y1 + _WALL_M, (x1 - x0) / 2, _WALL_M),
        ):
            self._geom(world, "box", place.walls, pos=(x, y, high / 2), size=(half_x, half_y, high / 2))
            skirting = (0.35, 0.33, 0.31)
            self._geom(world, "box", skirting, pos=(x, y, 0.05), size=(half_x + 0.012, half_y + 0.012, 0.05))
        for door in place.doors.values():
            # The door leaf lies on the wall between the two points.
            x, y = (max(low, min(value, up)) for value, low, up in zip(door.outside, (x0, y0), (x1, y1), strict=True))
            across = abs(door.outside[1] - door.inside[1]) > abs(door.outside[0] - door.inside[0])
            for grow, colour in ((0.06, (0.55, 0.50, 0.45)), (0.0, (0.33, 0.36, 0.38))):
                wide, deep, tall = 0.48 + grow, 0.02 - grow / 6, 1.03 + grow / 2
                half = (wide, deep, tall) if across else (deep, wide, tall)
                self._geom(world, "box", colour, pos=(x, y, tall), size=half)
        for piece in place.furniture:
            for block, at, colour in placed(piece):
                turn = (math.cos(piece.heading / 2), 0, 0, math.sin(piece.heading / 2))
                self._geom(world, block.shape, colour, pos=at, size=block.size, quat=turn)
        for picture in place.pictures:
            wide, tall = picture.size
            turn = (math.cos(picture.heading / 2), 0, 0, math.sin(picture.heading / 2))
            frame = (0.25, 0.22, 0.20)
            self._geom(world, "box", frame, pos=picture.at, size=(0.015, wide / 2 + 0.04, tall / 2 + 0.04), quat=turn)
            self._geom(world, "box", picture.colour, pos=picture.at, size=(0.02, wide / 2, tall / 2), quat=turn)
        for number, x in enumerate((x0 + 0.3 * (x1 - x0), x0 + 0.75 * (x1 - x0))):
            lamp = world.add_light(
                pos=(x, middle[1] + 0.4, high - 0.1), dir=(0.0, -0.05, -1.0), cutoff=88.0, exponent=1.0,
                diffuse=(0.42, 0.41, 0.39), specular=(0.1, 0.1, 0.1), attenuation=(0.7, 0.03, 0.008),
                castshadow=shadows and number == 0,
            )  # fmt: skip
            lamp.name = f"lamp {number}"
            self._geom(world, "box", (1.0, 1.0, 0.98), pos=(x, middle[1], high - 0.01), size=(0.6, 0.15, 0.01))

    def _person(self, spec: Any, name: str, body: Figure) -> None:
        parts: dict[str, list[tuple[int, Part]]] = {}
        for number, part in enumerate(body.parts):
            parts.setdefault(part.segment, []).append((number, part))
        # A soft spot on the floor below each person; shadows of lamps cost more than all the rest.
        spot = spec.worldbody.add_body(name=f"{name} spot", mocap=True)
        for size, shade in ((0.36, 0.07), (0.31, 0.07), (0.26, 0.08), (0.21, 0.09), (0.16, 0.10)):
            at, half = (0, 0, 0.004 - 0.002 * size), (size, size, 0.002)
            self._geom(spot, "ellipsoid", (0, 0, 0), alpha=shade, pos=at, size=half)
        for segment in body.joints:
            link = spec.worldbody.add_body(name=f"{name} {segment}", mocap=True)
            for number, part in parts.get(segment, ()):
                if not len(part.vertices):
                    self._geom(link, "ellipsoid", part.colour, pos=part.at, size=part.size)
                    continue
                mesh = spec.add_mesh(name=f"{name} {number}", inertia=self._mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
                mesh.uservert, mesh.userface = part.vertices.ravel(), part.faces.ravel()
                self._geom(link, "mesh", part.colour, "cloth" if part.cloth else "", meshname=mesh.name)

    def _robot(self, spec: Any) -> None:
        mujoco = self._mujoco
        base = spec.worldbody.add_body(name="robot")
        white, dark, blue = (0.93, 0.93, 0.94), (0.10, 0.11, 0.13), (0.20, 0.50, 0.75)
        self._geom(base, "cylinder", dark, pos=(0, 0, 0.06), size=(0.24, 0.06, 0))
        self._geom(base, "ellipsoid", white, pos=(0, 0, 0.52), size=(0.20, 0.22, 0.46))
        self._geom(base, "cylinder", dark, pos=(0, 0, 1.03), size=(0.05, 0.10, 0))
        self._geom(base, "box", blue, pos=(0.175, 0, 0.62), size=(0.03, 0.09, 0.06))
        hinge = mujoco.mjtJoint.mjJNT_HINGE
        pan = base.add_body(name="head_pan_link", pos=(0, 0, CAMERA_HEIGHT_M))
        pan.add_joint(name="head_pan_joint", type=hinge, axis=(0, 0, 1))
        tilt = pan.add_body(name="head_tilt_link")
        tilt.add_joint(name="head_tilt_joint", type=hinge, axis=(0, -1, 0))
        pan.explicitinertial = tilt.explicitinertial = True
        pan.mass = tilt.mass = 1.0
        pan.inertia = tilt.inertia = (0.01, 0.01, 0.01)
        # The camera is inside of the head, which it does not see.
        for side in (1, -1):
            self._geom(
                tilt, "ellipsoid", (0.15, 0.65, 0.85), pos=(0.13, side * 0.06, 0.02), size=(0.02, 0.03, 0.03), group=3
            )
        self._geom(tilt, "ellipsoid", white, pos=(0.0, 0, 0), size=(0.14, 0.16, 0.13), group=3)
        self._geom(tilt, "ellipsoid", dark, pos=(0.05, 0, 0), size=(0.10, 0.13, 0.09), group=3)
        wide, tall = self.size
        fovy = 2 * math.atan(math.tan(self.hfov_rad / 2) * tall / wide)
        ahead = (0.5, 0.5, -0.5, -0.5)  # cameras of MuJoCo look along -z
        tilt.add_camera(name="head", pos=(LENS_AHEAD_M, 0, 0), quat=ahead, fovy=math.degrees(fovy))

    def put(self, person: str, frames: Mapping[str, Frame] | None) -> None:
        """Place the segments of a person; None takes them away."""
        for (name, segment), number in self._mocap.items():
            if name != person:
                continue
            if frames is None:
                self.data.mocap_pos[number] = (0.0, 0.0, -10.0)
            elif segment == "spot":
                self.data.mocap_pos[number] = frames["pelvis"][1] * (1.0, 1.0, 0.0)
            else:
                turned, self.data.mocap_pos[number] = frames[segment]
                self._mujoco.mju_mat2Quat(self.data.mocap_quat[number], turned.ravel())

    def turn(self, pan_rad: float, tilt_rad: float) -> None:
        """Set the head; tilt is positive up."""
        self.data.joint("head_pan_joint").qpos[0] = pan_rad
        self.data.joint("head_tilt_joint").qpos[0] = tilt_rad

    def picture(self, camera: Any = "head", size: tuple[int, int] | None = None) -> np.ndarray:
        """Draw what a camera sees, shape (height, width, 3), uint8, RGB."""
        mujoco, size = self._mujoco, size or self.size
        if size not in self._renderers:
            try:
                self._renderers[size] = mujoco.Renderer(self.model, size[1], size[0], max_geom=4000)
            except Exception as error:  # of the chosen OpenGL, each with its own types
                raise InstallationError(
                    f"there is no off-screen OpenGL: {error}",
                    where="simulated place",
                    remedy="install libegl1 and libgl1-mesa-dri; or libosmesa6, and set MUJOCO_GL=osmesa",
                ) from error
        renderer = self._renderers[size]
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        self._option.geomgroup[3] = camera != "head"
        renderer.update_scene(self.data, camera, self._option)
        return renderer.render()

    def close(self) -> None:
        """Release the OpenGL contexts."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()
