"""Simulated pan-tilt head in MuJoCo (extra ``sim``): joints with inertia and limited torque follow trajectories."""

from __future__ import annotations

from dataclasses import dataclass

from socialbot.agents.base.mujoco import load_mujoco
from socialbot.core.clock import SECOND
from socialbot.core.messages import JointTrajectory

PAN, TILT = "head_pan_joint", "head_tilt_joint"
LIMITS_RAD = {PAN: 1.6, TILT: 0.8}
_STEP_S, _CONTROL_S = 0.002, 0.01
_PAN_KG_M2, _TILT_KG_M2 = 0.012, 0.010
_STIFFNESS, _TORQUE_NM = 900.0, 3.0  # Stiffness in relation to the inertia, 1/s^2.

_HEAD = f"""<mujoco><option timestep="{_STEP_S}" integrator="implicitfast" gravity="0 0 0"/>
<worldbody><body name="pan"><inertial pos="0 0 0" mass="1" diaginertia="{_PAN_KG_M2} {_PAN_KG_M2} {_PAN_KG_M2}"/>
<joint name="{PAN}" axis="0 0 1" frictionloss="0.01"/>
<body name="tilt"><inertial pos="0 0 0" mass="1.2" diaginertia="{_TILT_KG_M2} {_TILT_KG_M2} {_TILT_KG_M2}"/>
<joint name="{TILT}" axis="0 -1 0" frictionloss="0.01"/></body></body></worldbody>
<actuator>{{servos}}</actuator></mujoco>"""


def _servo(joint: str, inertia: float) -> str:
    kp, kv = _STIFFNESS * inertia, 2 * _STIFFNESS**0.5 * inertia
    return f'<position joint="{joint}" kp="{kp}" kv="{kv}" forcerange="-{_TORQUE_NM} {_TORQUE_NM}"/>'


@dataclass(frozen=True)
class _Spline:
    """Cubic from a position and speed to others, as of a trajectory controller; held before and after."""

    begin_s: float
    end_s: float
    start: float
    start_speed: float
    goal: float
    goal_speed: float

    def at(self, time_s: float) -> tuple[float, float]:
        """Position and speed at a time."""
        span = self.end_s - self.begin_s
        t = min(max((time_s - self.begin_s) / span, 0.0), 1.0) if span > 0 else 1.0
        if t >= 1.0:
            return self.goal, 0.0
        a, b, m, n = self.start, self.goal, self.start_speed * span, self.goal_speed * span
        place = (
            (2 * t**3 - 3 * t**2 + 1) * a + (t**3 - 2 * t**2 + t) * m + (3 * t**2 - 2 * t**3) * b + (t**3 - t**2) * n
        )
        slope = (6 * t**2 - 6 * t) * (a - b) + (3 * t**2 - 4 * t + 1) * m + (3 * t**2 - 2 * t) * n
        return place, slope / span


class SimulatedHead:
    """Head with two joints. Pan is positive to the left and tilt positive up, in rad.

    A command of one point is followed as by a joint_trajectory_controller: on a cubic from the present set point.
    """

    def __init__(self, start: int = 0) -> None:
        mujoco = self._mujoco = load_mujoco()
        servos = _servo(PAN, _PAN_KG_M2 + _TILT_KG_M2) + _servo(TILT, _TILT_KG_M2)
        self._model = mujoco.MjModel.from_xml_string(_HEAD.format(servos=servos))
        self._data = mujoco.MjData(self._model)
        self._begin = start
        self._ways = dict.fromkeys((PAN, TILT), _Spline(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))

    @property
    def pan_rad(self) -> float:
        return float(self._data.qpos[0])

    @property
    def tilt_rad(self) -> float:
        return float(self._data.qpos[1])

    @property
    def speeds_rad_s(self) -> tuple[float, float]:
        """Speeds of pan and tilt."""
        return float(self._data.qvel[0]), float(self._data.qvel[1])

    def command(self, trajectory: JointTrajectory, now: int) -> None:
        """Follow a trajectory from the time ``now`` (ns) on; other joints than those of the head are ignored."""
        begin = (now - self._begin) / SECOND
        speeds = trajectory.velocities or (0.0,) * len(trajectory.positions)
        for joint, position, speed in zip(trajectory.joint_names, trajectory.positions, speeds, strict=True):
            if joint not in self._ways:
                continue
            limit = LIMITS_RAD[joint]
            goal = min(max(position, -limit), limit)
            place, slope = self._ways[joint].at(begin)
            end = begin + max(trajectory.duration_s, _CONTROL_S)
            self._ways[joint] = _Spline(begin, end, place, slope, goal, speed if abs(goal) < limit else 0.0)

    def advance(self, now: int) -> None:
        """Move until the time ``now`` (ns)."""
        goal_s = (now - self._begin) / SECOND
        each = round(_CONTROL_S / _STEP_S)
        while self._data.time + _CONTROL_S / 2 < goal_s:
            for number, joint in enumerate((PAN, TILT)):
                self._data.ctrl[number] = self._ways[joint].at(self._data.time + _CONTROL_S)[0]
            self._mujoco.mj_step(self._model, self._data, each)
