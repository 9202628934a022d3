"""A robot of plain rclpy, in a process of its own: ``python -m tests.robots.robot_servers [MODE]``.

It offers FollowJointTrajectory, NavigateToPose, TTS, Say and Ask under their usual names, subscribes to the topics of
heads and speech, and prints each thing that it gets as a line of JSON.

Modes: ``good`` succeeds; ``reject`` refuses goals; ``abort`` aborts them; ``error`` succeeds with an error in the
result; ``slow`` works until it is cancelled; ``silent`` succeeds, and publishes no joint states. Else
they say that the head is at .5 and -.25 rad.
"""

import json
import math
import sys
import time
from importlib import import_module
from typing import Any

import rclpy
from rclpy.action.server import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from tests.bridge.foreign_spin import spin_to_the_end

# Packages that type checkers need not find.
Say: Any = import_module("communication_skills.action").Say
Ask: Any = import_module("communication_skills.action").Ask
FollowJointTrajectory: Any = import_module("control_msgs.action").FollowJointTrajectory
JointAnglesWithSpeed: Any = import_module("naoqi_bridge_msgs.msg").JointAnglesWithSpeed
NavigateToPose: Any = import_module("nav2_msgs.action").NavigateToPose
TTS: Any = import_module("tts_msgs.action").TTS


def say(**what: Any) -> None:
    print(json.dumps(what), flush=True)


class Robot(Node):
    def __init__(self, mode: str) -> None:
        super().__init__("robot")
        self.mode = mode
        group = ReentrantCallbackGroup()
        offered = (
            (FollowJointTrajectory, "/head_controller/follow_joint_trajectory", self.follow),
            (NavigateToPose, "/navigate_to_pose", self.navigate),
            (TTS, "/tts_engine/tts", self.speak),
            (Say, "/skill/say", self.say_skill),
            (Ask, "/skill/ask", self.ask),
        )
        self.offered = [
            ActionServer(
                self,
                kind,
                name,
                work,
                callback_group=group,
                goal_callback=lambda _: GoalResponse.REJECT if mode == "reject" else GoalResponse.ACCEPT,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )
            for kind, name, work in offered
        ]
        self.create_subscription(
            JointTrajectory, "/head_controller/joint_trajectory", lambda message: self.show("topic", message), 10
        )
        self.create_subscription(
            JointAnglesWithSpeed,
            "/joint_angles",
            self.show_angles,
            10,
        )
        self.joints = self.create_publisher(JointState, "/joint_states", 10)
        if mode != "silent":
            self.create_timer(0.02, self.publish_joints)
        self.create_subscription(String, "/speech", self.show_text, 10)

    def publish_joints(self) -> None:
        self.joints.publish(JointState(name=["wheel", "head_1_joint", "head_2_joint"], position=[9.0, 0.5, -0.25]))

    def show(self, way: str, trajectory: Any) -> None:
        (point,) = trajectory.points
        seconds = point.time_from_start.sec + point.time_from_start.nanosec / 1e9
        say(way=way, joints=list(trajectory.joint_names), positions=list(point.positions), seconds=seconds)

    def show_angles(self, message: Any) -> None:
        angles = list(message.joint_angles)
        say(joints=list(message.joint_names), angles=angles, speed=message.speed, relative=message.relative)

    def show_text(self, message: Any) -> None:
        say(speech=message.data)

    def follow(self, goal: Any) -> Any:
        self.show("action", goal.request.trajectory)
        feedback = FollowJointTrajectory.Feedback()
        feedback.joint_names = goal.request.trajectory.joint_names
        feedback.error.positions = [0.25] * len(feedback.joint_names)
        result = FollowJointTrajectory.Result()
        if self.mode in ("abort", "error"):
            result.error_code = FollowJointTrajectory.Result.PATH_TOLERANCE_VIOLATED
            result.error_string = "the head is blocked"
        return self.work(goal, feedback, result)

    def navigate(self, goal: Any) -> Any:
        pose = goal.request.pose.pose
        yaw = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        say(navigate=[pose.position.x, pose.position.y, yaw], frame=goal.request.pose.header.frame_id)
        return self.work(goal, NavigateToPose.Feedback(distance_remaining=1.5), NavigateToPose.Result())

    def speak(self, goal: Any) -> Any:
        say(tts=goal.request.input, locale=goal.request.locale)
        result = TTS.Result(error_msg="no voice" if self.mode in ("error", "abort") else "")
        return self.work(goal, TTS.Feedback(word="Hello"), result)

    def say_skill(self, goal: Any) -> Any:
        say(say=goal.request.input, caller=goal.request.meta.caller)
        result = Say.Result()
        if self.mode == "error":
            result.result.error_code, result.result.error_msg = 5, "the loudspeaker is off"
        return self.work(goal, Say.Feedback(), result)

    def ask(self, goal: Any) -> Any:
        say(ask=goal.request.question, schema=goal.request.answers_schema)
        return self.work(goal, Ask.Feedback(), Ask.Result(answers='{"drink": "tea"}'))

    def work(self, goal: Any, feedback: Any, result: Any) -> Any:
        if self.mode == "abort":
            goal.abort()
            return result
        goal.publish_feedback(feedback)
        while self.mode == "slow":
            if goal.is_cancel_requested:
                say(cancelled=type(result).__name__)
                goal.canceled()
                return result
            time.sleep(0.02)
        goal.succeed()
        return result


def main() -> None:
    rclpy.init()
    node = Robot(sys.argv[1] if len(sys.argv) > 1 else "good")
    executor = MultiThreadedExecutor(6)
    executor.add_node(node)
    spin_to_the_end(executor)


if __name__ == "__main__":
    main()
