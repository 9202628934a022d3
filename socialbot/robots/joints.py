"""Joints of ros2_control robots, such as arms: motions as actions of an agent, within limits.

::

    class Waver(JointsAgent):
        def build(self) -> Engine:
            engine = Engine("waver", self.clock, robot=self, sink=self.record, wake=self.wake)
            engine.add_rules(
                wave() >> [move_joints("shoulder", 1.2, "elbow", 0.5).within(10), move_joints("shoulder", 0.0)],
                -wave()[error(Why)] >> [apologize(Why)],
            )
            return engine

    # in the graph: parameters: {limits: "shoulder -0.2 1.5 0.8, elbow 0 1.2 1.0"}
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from socialbot.agents.base.agent_node import AgentNode
from socialbot.agents.base.ros_action import RosAction
from socialbot.bdi import Failed, SingletonBelief
from socialbot.bdi.sensors import Sensed
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import MessageError, ParameterError
from socialbot.core.messages import RosMessage
from socialbot.graph.node import Context
from socialbot.graph.ports import Delivery, Input, Parameter
from socialbot.graph.services import ActionClient
from socialbot.robots.limits import FRESH_S, JointLimits, checked_target, least_duration_s

LEAST_S = 0.1
"""Shortest duration of a motion."""


class off_target(SingletonBelief):
    """The joint that is farthest from where it should be is this far away (rad)."""


class JointsAgent(AgentNode):
    """Agent that moves joints by the FollowJointTrajectory action of a ros2_control controller.

    Only joints with ``limits`` move. Positions are clamped, and a motion takes as long as the speeds ask from the
    present positions of /joint_states; from unknown ones, as long as the longest way.
    """

    follow = ActionClient(
        "control_msgs/action/FollowJointTrajectory", "/joint_trajectory_controller/follow_joint_trajectory"
    )
    joint_states = Input("sensor_msgs/msg/JointState", "/joint_states", Delivery.NEWEST, optional=True)

    limits = Parameter(
        "", "joints that may move: NAME LOWER UPPER SPEED, separated by commas; rad and rad/s", fixed=True
    )

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        self._states: dict[str, float] = {}
        self._states_at = -(2**62)
        super().__init__(name, context, parameters)
        self._limits = parse_limits(self.limits, where=f"{name}.limits")

    @joint_states
    def on_joint_states(self, message: RosMessage) -> None:
        for joint, position in zip(message.name, message.position, strict=False):
            if joint in self._limits and math.isfinite(position):
                self._states[joint] = float(position)
                self._states_at = self.clock.now()

    def trajectory(self, targets: Mapping[str, float]) -> Mapping[str, Any]:
        """Return the fields of a trajectory to positions (rad), within the limits. Raises MessageError."""
        wanted = checked_target(tuple(targets), tuple(targets.values()), self._limits, where=self.name)
        is_known = self.clock.now() - self._states_at <= nanoseconds(FRESH_S) and self._states.keys() >= wanted.keys()
        start = self._states if is_known else None
        duration_s = max(least_duration_s(start, wanted, self._limits), LEAST_S)
        seconds = int(duration_s)
        point = {
            "positions": list(wanted.values()),
            "velocities": [0.0] * len(wanted),
            "time_from_start": {"sec": seconds, "nanosec": int((duration_s - seconds) * SECOND)},
        }
        return {"joint_names": list(wanted), "points": [point]}


class move_joints(RosAction):
    """Move joints: names and positions (rad) in turn, as in ``move_joints("shoulder", 1.2, "elbow", 0.5)``.

    It fails with ``error("refused")`` for a joint without limits or a position that is not finite, and with the outcome
    of the goal.
    """

    client = "follow"

    def goal(self, *joints_and_positions: Any) -> Any:
        names, positions = joints_and_positions[::2], joints_and_positions[1::2]
        if len(names) != len(positions) or not all(isinstance(each, (int, float)) for each in positions):
            raise Failed("refused", "names and positions do not alternate")
        try:
            return {"trajectory": self.engine.robot.trajectory(dict(zip(map(str, names), positions, strict=True)))}
        except MessageError as error:
            raise Failed("refused", f"{error.what}; {error.remedy}") from error

    def feedback(self, feedback: Any) -> Sensed:
        distances = [abs(float(each)) for each in feedback.error.positions]
        return off_target(round(max(distances), 3)) if distances and all(map(math.isfinite, distances)) else None

    def result(self, result: Any) -> Sensed:
        if getattr(result, "error_code", 0):
            raise Failed("refused", result.error_string or f"error {result.error_code} of the controller")
        return None


def parse_limits(text: str, *, where: str) -> dict[str, JointLimits]:
    """Parse limits of joints. Raises ParameterError."""
    found = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, *words = part.split()
        try:
            lower, upper, speed = map(float, words)
        except ValueError:
            lower = upper = speed = math.nan
        if not (-math.inf < lower <= upper < math.inf and 0.0 < speed < math.inf) or name in found:
            remedy = "write each joint once: NAME LOWER UPPER SPEED, in rad and rad/s"
            raise ParameterError(f"cannot read {part!r}", where=where, remedy=remedy)
        found[name] = JointLimits(lower, upper, speed)
    return found
