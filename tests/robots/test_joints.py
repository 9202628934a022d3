"""Motions of joints as actions of an agent, in simulated time."""

# ruff: noqa: N801 - beliefs and goals are written like literals

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot import ActionServer, Engine, Goal, GoalHandle, Graph, Node, NodeConfig, SingletonBelief, variables
from socialbot.bdi import Belief, error
from socialbot.core.errors import ParameterError
from socialbot.core.messages import ros_message
from socialbot.robots.joints import JointsAgent, move_joints
from socialbot.testing import GraphTester

LIMITS = "shoulder -0.2 1.5 0.5, elbow 0 1.2 1.0"
A, B, X, Y, Why = variables("A B X Y Why")


class pose(Goal): ...


class done(Belief): ...


class failed(SingletonBelief): ...


class Waver(JointsAgent):
    """Moves two joints."""

    keeps_mind = False

    def build(self) -> Engine:
        engine = Engine("waver", self.clock, robot=self, sink=self.record, wake=self.wake)
        engine.add_rules(
            pose(A, X, B, Y) >> [move_joints(A, X, B, Y).within(8), +done(A)],
            -pose(A, X, B, Y)[error(Why)] >> [+failed(Why)],
        )
        return engine


class Controller(Node):
    """Stands in for a joint trajectory controller that needs the time of its trajectory."""

    follow = ActionServer(
        "control_msgs/action/FollowJointTrajectory", "/joint_trajectory_controller/follow_joint_trajectory"
    )
    goals: tuple[tuple[dict[str, float], float], ...] = ()
    stuck = False
    cancelled = False

    @follow
    def on_goal(self, goal: GoalHandle) -> None:
        trajectory = goal.request.trajectory
        (point,) = trajectory.points
        seconds = point.time_from_start.sec + point.time_from_start.nanosec / 1e9
        self.goals += ((dict(zip(trajectory.joint_names, point.positions, strict=True)), seconds),)
        goal.feedback({"error": {"positions": [0.1, -0.4]}})
        goal.feedback({"error": {"positions": [0.1, math.nan]}})
        if not self.stuck:
            self.call_after(seconds, lambda: goal.succeed({"error_code": 0, "error_string": ""}))

    @follow.on_cancel
    def on_cancel(self, goal: GoalHandle) -> None:
        self.cancelled = True
        goal.cancelled()


@contextmanager
def waver(limits: str = LIMITS) -> Iterator[GraphTester]:
    nodes = (NodeConfig("waver", Waver, {"limits": limits}), NodeConfig("controller", Controller))
    with GraphTester(Graph("waver", nodes, inputs=frozenset({"/joint_states"}))) as graph:
        yield graph


def told(graph: GraphTester, *arguments: Any, seconds: float = 20.0) -> list[str]:
    graph.node("waver").engine.achieve(pose(*arguments))
    graph.run(seconds)
    return sorted(str(held.belief) for held in graph.node("waver").engine.beliefs)


def test_a_motion_is_clamped_and_as_slow_as_the_speeds_ask():
    with waver() as graph:
        states = SimpleNamespace(name=["elbow", "shoulder", "wheel"], position=[0.2, 0.5, 9.0])
        graph.send("/joint_states", ros_message("sensor_msgs/msg/JointState")(stamp=0, ros=states))
        assert told(graph, "shoulder", 9.0, "elbow", 0.4) == ['done("shoulder")', "off_target(0.4)"]
        ((positions, seconds),) = graph.node("controller").goals
    assert positions == {"shoulder": 1.5, "elbow": 0.4}
    assert seconds == pytest.approx(2.0)  # 1 rad at .5 rad/s


def test_positions_of_joint_states_that_have_stopped_do_not_count():
    with waver() as graph:
        states = SimpleNamespace(name=["elbow", "shoulder"], position=[0.0, 0.0])
        graph.send("/joint_states", ros_message("sensor_msgs/msg/JointState")(stamp=0, ros=states))
        graph.run(5.0)
        told(graph, "shoulder", 0.0, "elbow", 0.0)
        ((_, seconds),) = graph.node("controller").goals
    assert seconds == pytest.approx(3.0)  # the arm may be anywhere: 1.5 rad at .5 rad/s


def test_from_unknown_positions_a_motion_takes_as_long_as_the_longest_way():
    with waver() as graph:
        told(graph, "shoulder", 0.0, "elbow", 0.0)
        ((_, seconds),) = graph.node("controller").goals
    assert seconds == pytest.approx(3.0)  # 1.5 rad at .5 rad/s


@pytest.mark.parametrize(
    "arguments", [("wrist", 0.1, "elbow", 0.1), ("shoulder", math.nan, "elbow", 0.1), ("shoulder", "up", "elbow", 0.1)]
)
def test_an_invalid_motion_is_refused_and_not_sent(arguments):
    with waver() as graph:
        assert told(graph, *arguments) == ['failed("refused")']
        assert graph.node("controller").goals == ()


def test_the_time_limit_cancels_the_motion():
    with waver() as graph:
        graph.node("controller").stuck = True
        assert 'failed("timeout")' in told(graph, "shoulder", 0.0, "elbow", 0.0)
        assert graph.node("controller").cancelled


@pytest.mark.parametrize("limits", ["shoulder", "shoulder 1 0 1", "shoulder 0 1 0", "a 0 1 1, a 0 1 1", "a nan 1 1"])
def test_wrong_limits_are_refused(limits):
    with pytest.raises(ParameterError, match="cannot read"), waver(limits):
        pass
