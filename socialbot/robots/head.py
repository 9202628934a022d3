"""Heads of ROS robots: nodes that send head targets to a robot's controller, within its limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import MessageError, ParameterError
from socialbot.core.messages import JointTrajectory, RosMessage
from socialbot.graph.calls import CallResult, PendingCall, make_message
from socialbot.graph.node import Context, Node, Timer
from socialbot.graph.ports import Delivery, Input, Output, Parameter
from socialbot.graph.services import ActionClient, ClientPort
from socialbot.robots.limits import FRESH_S, WIDEST_RAD, JointLimits, JointMotion, checked_target, least_duration_s

TARGET = "/robot/head_target"
"""Topic between the node that decides where to look and the node of the robot's head."""

NO_PAN, NO_TILT = "no_pan", "no_tilt"
"""Names in head targets of the axis about which a robot does not turn its head."""

_LONGEST_S = 60.0  # longest motion that a target may ask for
_STUCK_S = 3.0  # a head away from its target that has not moved for this long does not follow
_STUCK_RAD, _MOVED_RAD = 0.1, 0.02  # least distance from the target, and least way of a head that moves
_LEAST_SHARE = 0.01  # least share of the full speed that moves a joint of NAOqi

ANGLES = "naoqi_bridge_msgs/msg/JointAnglesWithSpeed"


def _position(default: float, doc: str) -> Parameter[float]:
    return Parameter(default, doc, minimum=-WIDEST_RAD, maximum=WIDEST_RAD, fixed=True)


class RobotHead(Node):
    """Head of a robot: checks each target and sends it to the robot within the limits of its joints.

    A target has the joint names of the parameters, positive to the left and up (REP-103). A head with one joint leaves
    the name of the other one empty, and ignores `NO_PAN` or `NO_TILT` in targets. Positions beyond a limit are
    clamped, and motions that are too fast take longer. Unknown joints and positions that are not finite are refused.
    Of targets that arrive within ``period_s``, the robot gets the newest. When the node stops, the head stops.

    The present pose comes from the robot's joint states; without them, from the motions that were sent. The first
    motion from an unknown pose is as slow as the longest way, and cannot be stopped before its end.

    The node is degraded while the joint states show a head that does not follow.
    """

    target = Input(JointTrajectory, TARGET)
    joint_states = Input("sensor_msgs/msg/JointState", "/joint_states", Delivery.NEWEST, optional=True)

    pan_joint = Parameter("head_pan_joint", "joint that turns the head; empty: none", fixed=True)
    pan_lower_rad = _position(-1.2, "least position of the pan joint, rad")
    pan_upper_rad = _position(1.2, "greatest position of the pan joint, rad")
    pan_straight_rad = _position(0.0, "position of the pan joint at which the head looks straight on, rad")
    pan_speed_rad_s = Parameter(1.0, "highest speed of the pan joint, rad/s", minimum=0.01, maximum=10.0, fixed=True)
    pan_sign = Parameter(1, "1: the pan joint is positive to the left; -1: to the right", minimum=-1, maximum=1)
    tilt_joint = Parameter("head_tilt_joint", "joint that nods the head; empty: none", fixed=True)
    tilt_lower_rad = _position(-0.5, "least position of the tilt joint, rad")
    tilt_upper_rad = _position(0.5, "greatest position of the tilt joint, rad")
    tilt_straight_rad = _position(0.0, "position of the tilt joint at which the head looks straight on, rad")
    tilt_speed_rad_s = Parameter(1.0, "highest speed of the tilt joint, rad/s", minimum=0.01, maximum=10.0, fixed=True)
    tilt_sign = Parameter(1, "1: the tilt joint is positive up; -1: down", minimum=-1, maximum=1)
    period_s = Parameter(0.05, "shortest time between two commands, s", minimum=0.01, maximum=10.0)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        limits = {
            self.pan_joint: JointLimits(self.pan_lower_rad, self.pan_upper_rad, self.pan_speed_rad_s),
            self.tilt_joint: JointLimits(self.tilt_lower_rad, self.tilt_upper_rad, self.tilt_speed_rad_s),
        }
        self._limits = {joint: each for joint, each in limits.items() if joint}
        for axis in ("pan", "tilt"):
            lower, straight, upper = (getattr(self, f"{axis}_{key}_rad") for key in ("lower", "straight", "upper"))
            if not lower <= straight <= upper:
                what = f"{axis}_straight_rad {straight:g} is not between {lower:g} and {upper:g}"
                raise ParameterError(what, where=name, remedy="give limits around the straight pose")
        self._absent = {name for name, joint in ((NO_PAN, self.pan_joint), (NO_TILT, self.tilt_joint)) if not joint}
        self._straight = {self.pan_joint: self.pan_straight_rad, self.tilt_joint: self.tilt_straight_rad}
        self._signs = {self.pan_joint: self.pan_sign or 1, self.tilt_joint: self.tilt_sign or 1}
        self._motion: JointMotion | None = None
        self._from_known_pose = False
        """Whether the start of the motion was known."""
        self._states: dict[str, float] = {}
        self._states_at = -(2**62)
        self._next: tuple[dict[str, float], float] | None = None
        self._earliest = self.clock.now()
        self._timer: Timer | None = None
        self._stopped = False
        self._reference: dict[str, float] = {}
        """Pose from which a movement is measured."""
        self._followed_at = self._earliest
        self._is_stuck = False

    def send(self, positions: Mapping[str, float], duration_s: float) -> None:
        """Send checked ``positions`` (rad, in the direction of each joint) to the robot; subclasses do."""
        raise NotImplementedError

    def halt(self) -> None:
        """Stop the head where it is. Called once, at the end, if the head was moved."""
        pose = self.pose()
        if pose is not None:
            self.send(pose, self.period_s)
        else:
            self.log.warning("the pose of the head is not known: it ends its motion; are there joint states?")

    def pose(self) -> dict[str, float] | None:
        """Return the present positions (rad) by joint; None if they are not known."""
        now = self.clock.now()
        if now - self._states_at <= nanoseconds(FRESH_S) and self._states.keys() >= self._limits.keys():
            return {joint: self._states[joint] for joint in self._limits}
        motion = self._motion
        if motion is None or not (self._from_known_pose or now >= motion.begin + nanoseconds(motion.duration_s)):
            return None
        return motion.at(now)

    @joint_states
    def on_joint_states(self, message: RosMessage) -> None:
        for joint, position in zip(message.name, message.position, strict=False):
            if joint in self._limits and math.isfinite(position):
                self._states[joint] = float(position)
                self._states_at = self.clock.now()
        self._check_following()

    def _check_following(self) -> None:
        """Report a head that does not move although it is away from its target."""
        now, target = self.clock.now(), self._motion.target if self._motion is not None else {}
        away = {
            joint: position
            for joint, position in target.items()
            if abs(self._states.get(joint, position) - position) > _STUCK_RAD
        }
        moved = any(
            abs(state - self._reference.get(joint, math.inf)) > _MOVED_RAD for joint, state in self._states.items()
        )
        if moved or not away:
            self._reference, self._followed_at = dict(self._states), now
            if self._is_stuck:
                self._is_stuck = False
                self.report_health("ok")
        elif not self._is_stuck and now - self._followed_at >= nanoseconds(_STUCK_S):
            self._is_stuck = True
            joint, position = next(iter(away.items()))
            self.report_health(
                "degraded",
                f"the head does not follow: {joint} stays at {self._states[joint]:.2f} rad, not {position:.2f}; "
                "is its controller active, and are the motors on?",
            )

    @target
    def on_target(self, target: JointTrajectory) -> None:
        """Take a target. Raises MessageError if it is invalid."""
        turned = [
            position * self._signs.get(joint, 1) + self._straight.get(joint, 0.0)
            for joint, position in zip(target.joint_names, target.positions, strict=False)
        ]
        turned += target.positions[len(turned) :]
        known = {**self._limits, **dict.fromkeys(self._absent, JointLimits(0.0, 0.0, 1.0))}
        checked = checked_target(target.joint_names, turned, known, where=self.name)
        wanted = {joint: position for joint, position in checked.items() if joint in self._limits}
        if not math.isfinite(target.duration_s) or target.duration_s < 0.0:
            raise MessageError(f"duration {target.duration_s} s", where=self.name, remedy="send 0 or more seconds")
        self._next = wanted, min(target.duration_s, _LONGEST_S)
        if self._timer is None:
            self._timer = self.context.call_at(max(self._earliest, self.clock.now()), self._move)

    def stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._motion is not None and not self._stopped:
            self.halt()
        self._stopped = True

    def _move(self) -> None:
        self._timer = None
        if self._next is None or self._stopped:
            return
        (wanted, asked_s), self._next = self._next, None
        now, start = self.clock.now(), self.pose()
        whole = {**(start or {}), **wanted}
        if whole.keys() < self._limits.keys():  # one joint of an unknown pose: controllers want all
            whole = {**{joint: self._straight[joint] for joint in self._limits}, **whole}
        duration_s = max(asked_s, least_duration_s(start, whole, self._limits), self.period_s)
        self._motion, self._from_known_pose = JointMotion(start or whole, whole, now, duration_s), bool(start)
        self._earliest = now + nanoseconds(self.period_s)
        self.send(whole, duration_s)


class TrajectoryHead(RobotHead):
    """Head of a ros2_control robot, by the topic of its joint trajectory controller."""

    trajectory = Output(JointTrajectory, "/head_controller/joint_trajectory")

    def send(self, positions: Mapping[str, float], duration_s: float) -> None:
        self.trajectory.publish(
            JointTrajectory(
                stamp=self.clock.now(),
                joint_names=tuple(positions),
                positions=tuple(positions.values()),
                velocities=(0.0,) * len(positions),
                duration_s=duration_s,
            )
        )


class TrajectoryActionHead(RobotHead):
    """Head of a ros2_control robot, by the FollowJointTrajectory action of its controller.

    A new target replaces the goal before it. A goal that the controller rejects or aborts, and a missing server, are
    reported as the health of the node; the next target is sent as usual.
    """

    follow = ActionClient("control_msgs/action/FollowJointTrajectory", "/head_controller/follow_joint_trajectory")

    late_s = Parameter(2.0, "time beyond the duration of a motion until it is cancelled, s", minimum=0.1, maximum=60.0)

    error: Mapping[str, float] = {}
    """Distance (rad) of each joint from its desired position, as the controller last reported it."""

    _goal: PendingCall | None = None
    _number = 0

    def send(self, positions: Mapping[str, float], duration_s: float) -> None:
        seconds = int(duration_s)
        point = {
            "positions": list(positions.values()),
            "velocities": [0.0] * len(positions),
            "time_from_start": {"sec": seconds, "nanosec": int((duration_s - seconds) * SECOND)},
        }
        self._number += 1
        self._goal = self.follow.send_goal(
            {"trajectory": {"joint_names": list(positions), "points": [point]}},
            partial(self._on_end, self._number),
            feedback=self._on_feedback,
            deadline_s=duration_s + self.late_s,
        )

    def halt(self) -> None:
        if self._goal is not None:
            self._goal.cancel()

    def on_server(self, port: ClientPort, *, present: bool) -> None:
        if present:
            self.report_health("ok")
        else:
            self.report_health("degraded", f"no action server {port.topic}: is the controller active?")

    def _on_feedback(self, feedback: Any) -> None:
        self.error = dict(zip(feedback.joint_names, feedback.error.positions, strict=False))

    def _on_end(self, number: int, result: CallResult) -> None:
        if number != self._number:
            return  # a newer target has replaced the goal
        code = getattr(result.message, "error_code", 0)
        if result.ok and not code:
            if not self._is_stuck:  # some controllers succeed although the motors are off
                self.report_health("ok")
        elif result.outcome != "cancelled":
            text = getattr(result.message, "error_string", "") or result.reason or f"error {code} of the controller"
            self.report_health("degraded", f"the head did not move: {text}")


class NaoqiHead(RobotHead):
    """Head of a NAO or Pepper, by the joint angles topic of naoqi_driver."""

    angles = Output(ANGLES, "/joint_angles")

    full_speed_rad_s = Parameter(7.3, "speed of the slower joint at full speed, rad/s", minimum=0.1, maximum=20.0)

    def send(self, positions: Mapping[str, float], duration_s: float) -> None:
        start = self._motion.start if self._motion else positions
        way = max(abs(position - start[joint]) for joint, position in positions.items())
        share = min(way / duration_s / self.full_speed_rad_s, 1.0)
        fields = {
            "joint_names": list(positions),
            "joint_angles": list(positions.values()),
            "speed": max(share, _LEAST_SHARE),
            "relative": 0,
        }
        self.angles.publish(make_message(ANGLES, fields))
