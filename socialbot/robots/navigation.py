"""Mobile bases: drive to people, out of their way and home by Nav2, as actions of an agent.

::

    class Usher(MobileAgent):
        detections = Input(PersonDetections, "/humans/bodies/detections")

        def build(self) -> Engine:
            engine = Engine("usher", self.clock, robot=self, sink=self.record, wake=self.wake)
            engine.add_rules(
                +visitor(Who) >> [meet(Who)],
                meet(Who) >> [approach(Who).within(30), greet(Who), return_home().within(60)],
                -meet(Who)[error(Why)] >> [return_home().within(60)],
            )
            return engine

        @detections
        def on_detections(self, message: PersonDetections) -> None:
            self.note_people(message)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from socialbot.agents.base.agent_node import AgentNode
from socialbot.agents.base.ros_action import RosAction
from socialbot.bdi import Failed, SingletonBelief
from socialbot.bdi.sensors import Sensed
from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError
from socialbot.core.messages import PersonDetections, Transforms
from socialbot.graph.node import Context
from socialbot.graph.ports import Delivery, Input, Parameter
from socialbot.graph.services import ActionClient
from socialbot.vision.transforms import TransformTree

INTIMATE_M = 0.45
"""Distance of the intimate space of a person (Hall, 1966); no pose is closer."""


class Pose2D(NamedTuple):
    """Position (m) and heading (rad) in the plane."""

    x: float
    y: float
    yaw: float


class PersonSpot(NamedTuple):
    """Where a person was: position (m) in the map, where they face (rad; None: not known), and when (ns)."""

    x: float
    y: float
    facing: float | None
    stamp: int


def pose_before(robot: Pose2D, person: PersonSpot, distance_m: float) -> Pose2D:
    """Return the pose at ``distance_m`` from a person and turned to them, in front of a person who faces somewhere.

    A person whose back is turned is approached in a curve: the pose is at most 60 degrees beside the way they face,
    on the side of the robot, so that they see it come.
    """
    direction = math.atan2(robot.y - person.y, robot.x - person.x)
    if person.facing is not None:
        off = _wrapped(direction - person.facing)
        direction = person.facing + max(-_SEEN_RAD, min(_SEEN_RAD, off))
    x, y = person.x + distance_m * math.cos(direction), person.y + distance_m * math.sin(direction)
    return Pose2D(x, y, _wrapped(direction + math.pi))


_SEEN_RAD = math.pi / 3  # largest angle from the way a person faces under which they are approached


def pose_aside(robot: Pose2D, person: PersonSpot, clearance_m: float) -> Pose2D:
    """Return the pose that leaves ``clearance_m`` beside the way of a person who walks or faces towards the robot.

    The robot steps to the side on which it is already, to the right of the person if it is right ahead, and looks at
    the way.
    """
    way = person.facing
    if way is None:
        way = math.atan2(robot.y - person.y, robot.x - person.x)
    ahead, left = math.cos(way), math.sin(way)
    across = -left * (robot.x - person.x) + ahead * (robot.y - person.y)
    side = 1.0 if across > _AHEAD_M else -1.0
    needed = max(0.0, clearance_m - abs(across)) if across * side > 0 or abs(across) <= _AHEAD_M else clearance_m
    x, y = robot.x - left * side * needed, robot.y + ahead * side * needed
    return Pose2D(x, y, _wrapped(way - side * math.pi / 2))


_AHEAD_M = 0.05  # a person so far from the middle of the way is right ahead


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)


class distance_left(SingletonBelief):
    """The base still has to drive this far (m)."""


class MobileAgent(AgentNode):
    """Agent whose robot drives by Nav2: it knows the pose of the robot and the places of people in the map.

    Subclasses call `note_people` with each message of people. Goals outside the ``area`` are refused before they reach
    the robot, as are goals that are no finite numbers.
    """

    navigate = ActionClient("nav2_msgs/action/NavigateToPose", "/navigate_to_pose")
    tf = Input(Transforms, "/tf", optional=True)
    tf_static = Input(Transforms, "/tf_static", Delivery.LATCHED, optional=True)

    frame = Parameter("map", "frame of the goals")
    robot_frame = Parameter("base_link", "frame of the robot, whose x axis points ahead")
    home = Parameter("0 0 0", "pose to return to: x y yaw in the frame of the goals, m and rad")
    area = Parameter("", "where the robot may drive: x_min y_min x_max y_max, m; empty: everywhere", fixed=True)
    social_m = Parameter(1.2, "distance at which a person is addressed, m", minimum=INTIMATE_M, maximum=5.0)
    clearance_m = Parameter(1.0, "distance from the way of a person, m", minimum=INTIMATE_M, maximum=5.0)
    recent_s = Parameter(
        2.0, "oldest sight of a person, and oldest pose of the robot, that counts, s", minimum=0.1, maximum=60.0
    )

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        self._frames = TransformTree()
        self._people: dict[str, PersonSpot] = {}
        self._moved_at: int | None = None
        """Stamp (ns) of the newest transforms that place the robot, by the clock of their sender."""
        self._moved_by = -(2**62)
        """Time (ns) of their arrival."""
        super().__init__(name, context, parameters)
        for parameter in ("home", "area"):
            self.on_parameter(parameter)

    def on_parameter(self, name: str) -> None:
        if name == "home":
            self.home_pose = Pose2D(*_numbers(self.home, 3, f"{self.name}.home"))
        elif name == "area" and self.area:
            low_x, low_y, high_x, high_y = _numbers(self.area, 4, f"{self.name}.area")
            if low_x >= high_x or low_y >= high_y:
                raise ParameterError("is empty", where=f"{self.name}.area", remedy="write x_min y_min x_max y_max")

    @tf
    def on_transforms(self, message: Transforms) -> None:
        self._frames.add(message.transforms, moving=True)
        moved_at = self._frames.moved_at(self.frame, self.robot_frame)
        if moved_at != self._moved_at:
            self._moved_at, self._moved_by = moved_at, self.clock.now()

    @tf_static
    def on_static_transforms(self, message: Transforms) -> None:
        self._frames.add(message.transforms)

    def note_people(self, message: PersonDetections) -> None:
        """Note where the people of a message are in the map."""
        robot, now = self.robot_pose(message.stamp), self.clock.now()
        if robot is None:
            return
        for person in message.known:
            if person.distance_m is None or person.bearing_rad is None:
                continue
            direction = robot.yaw + person.bearing_rad
            facing = None
            if person.facing_rad is not None and person.facing_rad <= _SURE_RAD:
                facing = _wrapped(direction + math.pi)
            elif person.facing_rad is not None and person.facing_rad >= math.pi - _SURE_RAD:
                facing = _wrapped(direction)
            x = robot.x + person.distance_m * math.cos(direction)
            y = robot.y + person.distance_m * math.sin(direction)
            self._people[person.track_id] = PersonSpot(x, y, facing, now)
        newest = now - round(self.recent_s * SECOND)
        self._people = {who: spot for who, spot in self._people.items() if spot.stamp >= newest}

    def robot_pose(self, stamp: int | None = None) -> Pose2D | None:
        """Return the pose of the robot in the map; None if its transforms are not known."""
        matrix = self._frames.lookup(self.frame, self.robot_frame, self.clock.now() if stamp is None else stamp)
        if matrix is None:
            return None
        return Pose2D(float(matrix[0, 3]), float(matrix[1, 3]), math.atan2(matrix[1, 0], matrix[0, 0]))

    def goal_at(self, pose: Pose2D) -> Mapping[str, Any]:
        """Return the fields of the goal at a pose. Raises Failed if it is not finite or outside of the area."""
        if not all(map(math.isfinite, pose)):
            raise Failed("no_pose", f"{pose} is not finite")
        if self.area:
            low_x, low_y, high_x, high_y = _numbers(self.area, 4, f"{self.name}.area")
            if not (low_x <= pose.x <= high_x and low_y <= pose.y <= high_y):
                raise Failed("outside", f"({pose.x:.2f}, {pose.y:.2f}) is outside of the area {self.area}")
        header = {"frame_id": self.frame, "stamp": {"sec": 0, "nanosec": 0}}  # none: the clock of the robot may differ
        turn = {"x": 0.0, "y": 0.0, "z": math.sin(pose.yaw / 2), "w": math.cos(pose.yaw / 2)}
        place = {"x": float(pose.x), "y": float(pose.y), "z": 0.0}
        return {"pose": {"header": header, "pose": {"position": place, "orientation": turn}}}

    def robot_and(self, person: str) -> tuple[Pose2D, PersonSpot]:
        """Return the pose of the robot, and the place of a person. Raises Failed if one of them is not seen."""
        pose, lack = self.robot_pose(self._moved_at), f"no transform from {self.frame} to {self.robot_frame}"
        if pose is None:
            raise Failed("no_pose", lack)
        now, spot = self.clock.now(), self._people.get(person)
        if spot is None or now - spot.stamp > self.recent_s * SECOND:
            raise Failed("not_seen", f"{person} was not seen in the last {self.recent_s:g} s")
        age_s = (now - self._moved_by) / SECOND
        if self._moved_at is not None and age_s > self.recent_s:
            raise Failed("no_pose", f"{lack} for {age_s:.1f} s")
        return pose, spot


_SURE_RAD = 1.0  # people who face the robot, or turn their back to it, up to this angle


def _numbers(text: str, count: int, where: str) -> tuple[float, ...]:
    try:
        values = tuple(float(word) for word in text.replace(",", " ").split())
        if len(values) != count or not all(map(math.isfinite, values)):
            raise ValueError
    except ValueError:
        raise ParameterError(
            f"{text!r} is not {count} numbers", where=where, remedy="write numbers in m and rad"
        ) from None
    return values


class _Drive(RosAction):
    """Action that Nav2 executes."""

    client = "navigate"

    def feedback(self, feedback: Any) -> Sensed:
        left_m = float(feedback.distance_remaining)
        return distance_left(round(left_m, 2)) if math.isfinite(left_m) else None


class approach(_Drive):
    """Drive to a person, to the social distance in front of them."""

    def goal(self, who: str) -> Any:
        robot: MobileAgent = self.engine.robot
        return robot.goal_at(pose_before(*robot.robot_and(who), robot.social_m))


class give_way(_Drive):
    """Drive out of the way of a person."""

    def goal(self, who: str) -> Any:
        robot: MobileAgent = self.engine.robot
        return robot.goal_at(pose_aside(*robot.robot_and(who), robot.clearance_m))


class return_home(_Drive):
    """Drive to the home pose."""

    def goal(self) -> Any:
        robot: MobileAgent = self.engine.robot
        return robot.goal_at(robot.home_pose)
