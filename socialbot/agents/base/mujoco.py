"""Worlds with physics: scenes in the format of MuJoCo, the physics engine of the extra ``sim``, and their bodies."""

from __future__ import annotations

import importlib
import os
from typing import Any, Literal

import numpy as np

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import InstallationError
from socialbot.core.installation import extra_command

Simulation = Literal["kinematic", "physics"]
"""Kinds of worlds, the values of the parameter ``simulation``."""
STEP_S = 0.004
CONTROL_NS = nanoseconds(0.02)
"""Period of the targets of actuators."""

SURROUNDINGS = f"""
  <option timestep="{STEP_S}" integrator="implicitfast" cone="elliptic" impratio="5"/>
  <visual>
    <headlight ambient="0.35 0.35 0.38" diffuse="0.35 0.35 0.35"/><quality shadowsize="8192" offsamples="4"/>
    <global offwidth="1280" offheight="720"/><map znear="0.01"/>
  </visual>
  <asset>
    <texture type="skybox" builtin="gradient" rgb1="0.80 0.86 0.93" rgb2="0.97 0.98 1" width="64" height="384"/>
    <texture name="floor" type="2d" builtin="checker" rgb1="0.80 0.81 0.82" rgb2="0.76 0.77 0.78" width="256"
      height="256"/>
    <material name="floor" texture="floor" texrepeat="12 12"/>
  </asset>
"""
"""Solver, sky, light and the material of the floor: elements of a scene."""


def load_mujoco() -> Any:
    """Import MuJoCo, with EGL for drawing if no other OpenGL is chosen.

    Raises:
        InstallationError: It is not installed.
    """
    os.environ.setdefault("MUJOCO_GL", "egl")  # read by MuJoCo when it is imported; other windowing needs a screen
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise InstallationError(f"MuJoCo cannot be imported: {error}", remedy=extra_command("sim")) from error


def look_at(eye: tuple[float, float, float], target: tuple[float, float, float]) -> str:
    """Position and axes of a camera."""
    ahead = np.subtract(target, eye)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    numbers = (*right, *np.cross(right, ahead))
    return f'pos="{eye[0]} {eye[1]} {eye[2]}" xyaxes="{" ".join(f"{number:.4f}" for number in numbers)}"'


def servo(joint: str, stiffness: float, inertia: float, *, limit: float = 0.0) -> str:
    """A position servo with critical damping.

    Args:
        joint: Name of its joint, and of the servo.
        stiffness: N/m, or Nm/rad.
        inertia: What it moves: kg, or kg m² about the axis.
        limit: Largest force (N) or torque (Nm); 0 for no limit.
    """
    damping = 2 * (stiffness * inertia) ** 0.5
    limits = f' forcerange="-{limit} {limit}"' if limit else ""
    return f'<position name="{joint}" joint="{joint}" kp="{stiffness}" kv="{damping:.1f}"{limits}/>'


class Physics:
    """A scene whose time follows that of a world, from ``start`` (ns).

    Attributes:
        mujoco: The module.
        model: `mujoco.MjModel` of the scene.
        data: `mujoco.MjData`: its present state.

    Raises InstallationError without MuJoCo.
    """

    def __init__(self, scene: str, start: int) -> None:
        self.mujoco = load_mujoco()
        self.model = self.mujoco.MjModel.from_xml_string(scene)
        self.data = self.mujoco.MjData(self.model)
        self._begin = start
        self.mujoco.mj_forward(self.model, self.data)

    def advance(self, time: int) -> None:
        """Simulate until ``time`` (ns)."""
        goal_s = (time - self._begin) / SECOND
        while self.data.time + STEP_S / 2 < goal_s:
            self.mujoco.mj_step(self.model, self.data)

    def aim(self, servo: str, target: float) -> None:
        """Set the target of a servo."""
        self.data.actuator(servo).ctrl = target

    def position(self, body: str) -> tuple[float, float, float]:
        """Position of a body, m."""
        x, y, z = self.data.body(body).xpos
        return float(x), float(y), float(z)

    def put(self, joint: str, *place: float) -> None:
        """Put the body of a joint at a place, at rest; with a free joint at x, y and z (m)."""
        found = self.data.joint(joint)
        found.qpos[: len(place)] = place
        found.qvel[:] = 0.0
