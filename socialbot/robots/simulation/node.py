"""Node of a simulated place: camera, joint states, transforms and ground truth out, commands of the head in."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from statistics import NormalDist
from typing import Any

import cv2
import numpy as np

from socialbot.agents.base.mujoco import load_mujoco
from socialbot.bags.types import RosbagsTypes
from socialbot.core import paths
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.core.messages import CameraInfo, CompressedImage, JointTrajectory, Transform, Transforms
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Delivery, Input, Output, Parameter
from socialbot.robots.simulation.figure import figure
from socialbot.robots.simulation.people import Crowd, Schedule, Script, read_script
from socialbot.robots.simulation.place import load_place, place_names
from socialbot.robots.simulation.posture import pose
from socialbot.robots.simulation.scene import Scene
from socialbot.robots.simulation.truth import CAMERA_HEIGHT_M, LENS_AHEAD_M, HeadCamera, Watcher, truth_frame

_READ_E = 3.0  # Read noise in electrons, as of a small CMOS sensor.
_MID_GREY = 128


class ImageSensor:
    """Adds what a real camera adds to drawn pictures.

    The noise of each channel of each pixel is independent and normal. Shot noise grows with the square root of the
    light; read noise does not depend on it. The transfer curve of sRGB follows.

    Args:
        noise: Standard deviation of the noise of mid-grey pixels, grey levels; 0: none.
        blur_px: Standard deviation of the blur, px; 0: none.
        seed: Random seed.
    """

    def __init__(self, *, noise: float, blur_px: float, seed: int = 0) -> None:
        self._blur_px, self._seed = blur_px, seed
        self._deviations = deviations_of(noise).astype(np.float32) if noise > 0 else None
        # Random bytes become normal by the quantiles of the normal distribution.
        normal = np.array([NormalDist().inv_cdf((byte + 0.5) / 256) for byte in range(256)])
        self._normal = (normal / normal.std()).astype(np.float32)

    def expose(self, picture: np.ndarray, time_ns: int) -> np.ndarray:
        """Return the picture, shape (height, width, 3), uint8, with the blur and with the noise of this time."""
        if self._blur_px > 0:
            picture = cv2.GaussianBlur(picture, (0, 0), self._blur_px)
        if self._deviations is None:
            return picture
        levels = random.Random(f"{self._seed} {time_ns}").randbytes(picture.size)
        noise = cv2.LUT(np.frombuffer(levels, np.uint8).reshape(picture.shape), self._normal)
        return cv2.add(picture, noise * cv2.LUT(picture, self._deviations), dtype=cv2.CV_8U)


def deviations_of(noise: float) -> np.ndarray:
    """Standard deviations of the 256 grey levels, shape (256,), of a sensor with this ``noise`` at mid-grey."""
    grey = np.arange(256) / 255
    light = np.where(grey <= 0.04045, grey / 12.92, ((grey + 0.055) / 1.055) ** 2.4)
    slope = np.gradient(light)
    # The electrons of a white pixel solve: noise^2 = (light * white_e + read_e^2) / (white_e * slope)^2.
    square = (noise * slope[_MID_GREY]) ** 2
    white_e = (light[_MID_GREY] + np.sqrt(light[_MID_GREY] ** 2 + 4 * square * _READ_E**2)) / (2 * square)
    return np.sqrt(light * white_e + _READ_E**2) / white_e / slope


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


IMAGE_TOPIC = "/camera/image_raw/compressed"
FRAME_ID = "camera_optical_frame"
_BASE, _PAN_LINK, _TILT_LINK = "base_footprint", "head_pan_link", "head_tilt_link"
_INFO_NS = SECOND
_SWEEP_S, _SWEEP_RAD = 9.0, 0.55  # Period and extent of a head that sweeps.

URDF = f"""<robot name="simulated"><link name="{_BASE}"/><link name="{_PAN_LINK}"/><link name="{_TILT_LINK}"/>
<link name="{FRAME_ID}"/>
<joint name="{PAN}" type="revolute"><parent link="{_BASE}"/><child link="{_PAN_LINK}"/>
<origin xyz="0 0 {CAMERA_HEIGHT_M}"/><axis xyz="0 0 1"/>
<limit lower="-1.6" upper="1.6" effort="3" velocity="3"/></joint>
<joint name="{TILT}" type="revolute"><parent link="{_PAN_LINK}"/><child link="{_TILT_LINK}"/>
<axis xyz="0 -1 0"/><limit lower="-0.8" upper="0.8" effort="3" velocity="3"/></joint>
<joint name="camera_joint" type="fixed"><parent link="{_TILT_LINK}"/><child link="{FRAME_ID}"/>
<origin xyz="{LENS_AHEAD_M} 0 0" rpy="-1.5707963 0 -1.5707963"/></joint></robot>
"""


class SimulatedPlace(Node):
    """Simulator of a place with people and a robot that stands there and turns its head.

    The schedule of the people follows from ``script``, or is drawn from ``seed``. The same parameters and commands give
    the same messages, byte for byte. The node ends after ``duration_s``.
    """

    is_simulator = True

    trajectory = Input(JointTrajectory, "/head_controller/joint_trajectory", optional=True)
    image = Output(CompressedImage, IMAGE_TOPIC)
    camera_info = Output(CameraInfo, "/camera/camera_info", Delivery.LATCHED)
    joint_states = Output("sensor_msgs/msg/JointState", "/joint_states")
    tf = Output(Transforms, "/tf")
    tf_static = Output(Transforms, "/tf_static", Delivery.LATCHED)
    description = Output("std_msgs/msg/String", "/robot_description", Delivery.LATCHED)
    truth = Output("std_msgs/msg/String", "/ground_truth/persons")

    place = Parameter("foyer", "place", choices=tuple(place_names()), fixed=True)
    script = Parameter(
        "", "file of what people do (YAML), relative to the working directory; empty: random", fixed=True
    )
    people = Parameter(8, "number of people of a random schedule", minimum=0, maximum=26, fixed=True)
    seed = Parameter(0, "random seed of the schedule and of the looks of people", fixed=True)
    duration_s = Parameter(60.0, "duration, s; 0: until all people have left", minimum=0.0, maximum=86400.0, fixed=True)
    width = Parameter(640, "width of the images, px", minimum=64, maximum=4096, fixed=True)
    height = Parameter(480, "height of the images, px", minimum=48, maximum=4096, fixed=True)
    hfov_rad = Parameter(1.09, "horizontal field of view, rad", minimum=0.3, maximum=2.4, fixed=True)
    rate_hz = Parameter(10.0, "images per second", minimum=0.5, maximum=60.0, fixed=True)
    joints_hz = Parameter(20.0, "joint states and transforms per second", minimum=1.0, maximum=200.0, fixed=True)
    pictures = Parameter(True, "whether images are drawn; without them, only the truth is published", fixed=True)
    shadows = Parameter(False, "whether a lamp casts shadows, at half the speed", fixed=True)
    quality = Parameter(85, "JPEG quality", minimum=10, maximum=100, fixed=True)
    noise = Parameter(2.0, "noise of the camera at mid-grey, grey levels", minimum=0.0, maximum=50.0, fixed=True)
    blur_px = Parameter(0.5, "blur of the lens, standard deviation, px", minimum=0.0, maximum=20.0, fixed=True)
    head = Parameter(
        "commanded",
        "what moves the head: commands, nothing, or a sweep",
        choices=("commanded", "still", "sweep"),
        fixed=True,
    )

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        """Raises InstallationError without MuJoCo, and ParameterError for an unusable script."""
        super().__init__(name, context, parameters)
        script = self._script()
        self.crowd = Crowd(script, load_place(script.place), seed=self.seed)
        self._figures = {each: figure(looks) for each, looks in self.crowd.looks.items()}
        self._watcher = Watcher(self.crowd.place, self._figures)
        self._sensor = ImageSensor(noise=self.noise, blur_px=self.blur_px, seed=self.seed)
        self._duration = self.duration_s or self.crowd.duration
        self._types = RosbagsTypes()
        self._begin_at(self.clock.now())

    @classmethod
    def longest_step_s(cls, parameters: Mapping[str, Any]) -> float:
        return 1 / parameters["rate_hz"]

    def _begin_at(self, time: int) -> None:
        self._begin = self._next_image = self._next_joints = self._next_info = time
        self.servo = SimulatedHead(time)

    def _script(self) -> Script:
        if not self.script:
            place = load_place(self.place)
            duration = self.duration_s or 60.0
            return Schedule(self.place, place, people=self.people, duration_s=duration, seed=self.seed).script()
        path = paths.in_workspace(Path(self.script).expanduser(), where=f"{self.name}.script")
        return read_script(paths.read_text(path, ParameterError), where=str(path))

    @cached_property
    def scene(self) -> Scene:
        size = self.width, self.height
        return Scene(self.crowd.place, self._figures, size=size, hfov_rad=self.hfov_rad, shadows=self.shadows)

    def start(self) -> None:
        self._begin_at(self.clock.now())  # on a simulated clock, the time is not known before
        self.description.publish(self._types.make("std_msgs/msg/String", data=URDF))
        lens = Transform(
            stamp=self._begin,
            parent=_TILT_LINK,
            child=FRAME_ID,
            translation=(LENS_AHEAD_M, 0.0, 0.0),
            rotation=(-0.5, 0.5, -0.5, 0.5),
        )
        self.tf_static.publish(Transforms(stamp=self._begin, transforms=(lens,)))
        self.context.call_at(self._begin, self._step)

    def stop(self) -> None:
        if "scene" in vars(self):
            self.scene.close()

    @trajectory
    def on_trajectory(self, message: JointTrajectory) -> None:
        if self.head == "commanded":
            self.servo.advance(self.clock.now())
            self.servo.command(message, self.clock.now())

    def _step(self) -> None:
        """Publish the messages of the earliest time that is due, and schedule the next step."""
        now = min(self._next_joints, self._next_image)  # a clock with long steps is later
        if (now - self._begin) / SECOND > self._duration:
            self.report_health("ended", "the schedule of the people is over")
            return
        if self.head == "sweep":
            self._sweep(now)
        self.servo.advance(now)
        if now >= self._next_joints:
            self._next_joints += nanoseconds(1 / self.joints_hz)
            self._publish_joints(now)
        if now >= self._next_info:
            self._next_info += _INFO_NS
            self._publish_info(now)
        if now >= self._next_image:
            self._next_image += nanoseconds(1 / self.rate_hz)
            self._publish_image(now)
        self.context.call_at(min(self._next_joints, self._next_image), self._step)

    def _sweep(self, now: int) -> None:
        period = nanoseconds(1 / self.joints_hz) / SECOND
        angle = math.tau * ((now - self._begin) / SECOND + period) / _SWEEP_S
        goal = (_SWEEP_RAD * math.sin(angle), 0.0)
        speed = (_SWEEP_RAD * math.cos(angle) * math.tau / _SWEEP_S, 0.0)
        command = JointTrajectory(
            stamp=now, joint_names=(PAN, TILT), positions=goal, velocities=speed, duration_s=period
        )
        self.servo.command(command, now)

    def _publish_joints(self, now: int) -> None:
        make, pan, tilt = self._types.make, self.servo.pan_rad, self.servo.tilt_rad
        stamp = make("builtin_interfaces/msg/Time", sec=now // SECOND, nanosec=now % SECOND)
        state = make(
            "sensor_msgs/msg/JointState",
            header=make("std_msgs/msg/Header", stamp=stamp, frame_id=""),
            name=[PAN, TILT],
            position=np.array([pan, tilt]),
            velocity=np.array(self.servo.speeds_rad_s),
            effort=np.empty(0),
        )
        self.joint_states.publish(state)
        links = (
            Transform(
                stamp=now, parent=_BASE, child=_PAN_LINK, translation=(0.0, 0.0, CAMERA_HEIGHT_M),
                rotation=(0.0, 0.0, math.sin(pan / 2), math.cos(pan / 2)),
            ),
            Transform(
                stamp=now, parent=_PAN_LINK, child=_TILT_LINK, translation=(0.0, 0.0, 0.0),
                rotation=(0.0, -math.sin(tilt / 2), 0.0, math.cos(tilt / 2)),
            ),
        )  # fmt: skip
        self.tf.publish(Transforms(stamp=now, transforms=links))

    def _publish_info(self, now: int) -> None:
        focal = HeadCamera(self.width, self.height, self.hfov_rad).focal_px
        k = (focal, 0.0, self.width / 2, 0.0, focal, self.height / 2, 0.0, 0.0, 1.0)
        info = CameraInfo(stamp=now, frame_id=FRAME_ID, width=self.width, height=self.height, k=k, d=(0.0,) * 5)
        self.camera_info.publish(info)

    def _publish_image(self, now: int) -> None:
        time_s = (now - self._begin) / SECOND
        stances = self.crowd.at(time_s)
        numbers = {name: number for number, name in enumerate(self.crowd.motions)}
        pan, tilt = self.servo.pan_rad, self.servo.tilt_rad
        camera = HeadCamera(self.width, self.height, self.hfov_rad, pan, tilt)
        frames = {
            name: pose(self._figures[name], stance, numbers[name])
            for name, stance in stances.items()
            if self.pictures or self._watcher.may_show(camera, stance)
        }
        seen = self._watcher.sights(camera, stances, frames)
        frame = truth_frame(now, self.crowd, time_s, camera, seen, stances, image_topic=IMAGE_TOPIC, frame_id=FRAME_ID)
        self.truth.publish(self._types.make("std_msgs/msg/String", data=json.dumps(frame)))
        if not self.pictures:
            return
        for name in self.crowd.motions:
            self.scene.put(name, frames.get(name))
        self.scene.turn(pan, tilt)
        drawn = cv2.cvtColor(self.scene.picture(), cv2.COLOR_RGB2BGR)
        picture = self._sensor.expose(drawn, now - self._begin)
        data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, self.quality])[1].reshape(-1)
        self.image.publish(CompressedImage(stamp=now, frame_id=FRAME_ID, format="jpeg", data=data))
