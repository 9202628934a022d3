"""Heads of ROS robots, in simulated time: what reaches the controller."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from socialbot.core.errors import NodeError, ParameterError
from socialbot.core.messages import JointTrajectory, RosMessage, ros_message
from socialbot.graph.calls import GoalHandle
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.services import ActionServer
from socialbot.robots import head
from socialbot.robots.head import TARGET, NaoqiHead, TrajectoryActionHead, TrajectoryHead
from socialbot.testing import GraphTester

SENT = "/head_controller/joint_trajectory"
LIMITS = {
    "pan_joint": "pan", "pan_lower_rad": -1.0, "pan_upper_rad": 1.5, "pan_speed_rad_s": 1.0,
    "tilt_joint": "tilt", "tilt_lower_rad": -0.5, "tilt_upper_rad": 0.3, "tilt_speed_rad_s": 0.5,
}  # fmt: skip


def target(graph: GraphTester, pan: float, tilt: float, duration_s: float = 0.1, **fields: Any) -> None:
    values = {"joint_names": ("pan", "tilt"), "positions": (pan, tilt), "velocities": (0.0, 0.0), **fields}
    graph.send(TARGET, JointTrajectory(stamp=graph.clock.now(), duration_s=duration_s, **values))


def end(graph: GraphTester) -> None:
    """Stop the node as a host does, while its messages are still delivered."""
    graph.node().stop()
    graph.run(0.0)


def joint_states(graph: GraphTester, pan: float, tilt: float) -> RosMessage:
    states = SimpleNamespace(name=["tilt", "pan"], position=[tilt, pan])
    return ros_message("sensor_msgs/msg/JointState")(stamp=graph.clock.now(), ros=states)


def test_positions_are_clamped_and_motions_stretched_to_the_speeds():
    with GraphTester(TrajectoryHead, parameters=LIMITS) as graph:
        graph.send("/joint_states", joint_states(graph, 0.0, 0.0))
        target(graph, 0.5, 0.3)
        graph.run(0.1)
        graph.send("/joint_states", joint_states(graph, 0.5, 0.3))
        target(graph, -4.0, 2.0, duration_s=5.0)
        graph.run(0.1)
        first, second = graph.messages(SENT)
    assert (first.joint_names, first.positions) == (("pan", "tilt"), (0.5, 0.3))
    assert first.duration_s == pytest.approx(0.6)  # .3 rad at .5 rad/s
    assert (second.positions, second.duration_s) == ((-1.0, 0.3), 5.0)


@pytest.mark.parametrize(("only", "other", "at"), [("pan", "tilt", 0.5), ("tilt", "pan", 0.2)])
def test_a_head_with_one_joint_gets_that_one_alone(only, other, at):
    with GraphTester(TrajectoryHead, parameters={**LIMITS, f"{other}_joint": ""}) as graph:
        target(graph, 0.5, 0.2, joint_names=tuple(f"no_{each}" if each == other else each for each in ("pan", "tilt")))
        graph.run(0.1)
        end(graph)
        moved, *_ = graph.messages(SENT)
    assert (moved.joint_names, moved.positions) == ((only,), (at,))


def test_a_head_that_does_not_follow_is_told_until_it_moves():
    def reason(seconds: float, pan) -> str:
        for tenth in range(round(10 * seconds)):
            graph.send("/joint_states", joint_states(graph, pan(tenth / 10), 0.0))
            graph.run(0.1)
        return graph.node().context.health_monitor.health().reason

    with GraphTester(TrajectoryHead, parameters=LIMITS) as graph:
        assert reason(5.0, lambda _: 0.0) == ""  # nothing asked
        target(graph, 0.8, 0.0)
        assert reason(2.0, lambda _: 0.0) == ""
        assert reason(2.0, lambda _: 0.0).startswith(
            "the head does not follow: pan stays at 0.00 rad, not 0.80; is its"
        )
        assert reason(0.5, lambda time: 0.1 * time) == ""
        assert reason(20.0, lambda time: 0.05 + 0.037 * time) == ""  # slow, but it comes
        assert reason(10.0, lambda _: 0.75) == ""  # near enough


def test_a_joint_that_is_not_0_at_the_straight_pose_turns_about_that_pose():
    servo = {"pan_lower_rad": 0.0, "pan_upper_rad": 3.14, "pan_straight_rad": 1.57, "pan_sign": -1}
    with GraphTester(TrajectoryHead, parameters={**LIMITS, **servo}) as graph:
        target(graph, 0.5, 0.2)
        graph.run(0.1)
        target(graph, -2.0, 0.2)
        graph.run(0.1)
        left, right = graph.messages(SENT)
    assert left.positions == pytest.approx((1.07, 0.2))
    assert right.positions == (3.14, 0.2)


def test_limits_that_leave_the_straight_pose_out_are_refused():
    with pytest.raises(ParameterError, match=r"pan_straight_rad 0 is not between 0\.5 and 1\.5"):
        GraphTester(TrajectoryHead, parameters={**LIMITS, "pan_lower_rad": 0.5})


def test_a_joint_that_is_positive_down_gets_the_other_sign():
    with GraphTester(TrajectoryHead, parameters={**LIMITS, "tilt_sign": -1}) as graph:
        target(graph, 0.0, 0.4)
        graph.run(0.1)
        target(graph, 0.0, -0.4)
        graph.run(0.1)
        up, down = graph.messages(SENT)
    assert (up.positions[1], down.positions[1]) == (-0.4, 0.3)


@pytest.mark.parametrize(
    ("fields", "what"),
    [
        ({"positions": (math.nan, 0.0)}, "position nan of joint 'pan'"),
        ({"positions": (0.0, -math.inf)}, "position -inf of joint 'tilt'"),
        ({"positions": (0.0, 0.0, 0.0)}, "3 positions for 2 joints"),
        ({"joint_names": ("pan", "arm")}, "unknown joint 'arm'"),
        ({"joint_names": (), "positions": ()}, "0 positions for 0 joints"),
        ({"duration_s": math.inf}, "duration inf s"),
    ],
)
def test_an_invalid_target_is_refused(fields, what):
    graph = GraphTester(TrajectoryHead, parameters=LIMITS)

    def refuse() -> None:
        with graph:
            target(graph, 0.1, 0.1, **fields)
            graph.run(1.0)

    with pytest.raises(NodeError, match=what):
        refuse()
    assert graph.messages(SENT) == []


def test_of_many_targets_the_newest_is_sent_at_the_rate():
    with GraphTester(TrajectoryHead, parameters={**LIMITS, "period_s": 0.1}) as graph:
        for step in range(1000):
            target(graph, step / 1000, 0.0)
            graph.run(0.001)
        sent = graph.messages(SENT)
    assert 9 <= len(sent) <= 11
    assert sent[-1].positions[0] >= 0.9


def test_the_head_stops_where_it_is_at_the_end():
    with GraphTester(TrajectoryHead, parameters=LIMITS) as graph:
        graph.send("/joint_states", joint_states(graph, 0.0, 0.0))
        target(graph, 1.0, 0.0)
        graph.run(0.1)
        graph.send("/joint_states", joint_states(graph, 0.35, 0.0))
        end(graph)
    last = graph.messages(SENT)[-1]
    assert last.positions == (0.35, 0.0)
    assert last.duration_s <= 0.1


def test_without_joint_states_the_head_stops_by_dead_reckoning():
    with GraphTester(TrajectoryHead, parameters=LIMITS) as graph:
        target(graph, 0.0, 0.0)
        graph.run(3.0)  # from an unknown pose it is slow; then the pose is known
        target(graph, 1.0, 0.0)
        graph.run(0.5)
        end(graph)
    last = graph.messages(SENT)[-1]
    assert last.positions[0] == pytest.approx(0.5, abs=0.01)


def test_old_joint_states_do_not_count():
    with GraphTester(TrajectoryHead, parameters=LIMITS) as graph:
        graph.send("/joint_states", joint_states(graph, 0.0, 0.0))
        target(graph, 1.0, 0.0)
        graph.run(2.0)
        end(graph)
    assert graph.messages(SENT)[-1].positions == (1.0, 0.0)


def test_a_slow_motion_of_naoqi_has_a_speed_that_moves_the_joint(monkeypatch):
    """The type of the message is not among the wheels, so its fields are looked at."""
    sent: list[dict[str, Any]] = []
    monkeypatch.setattr(head, "make_message", lambda _, fields: fields)
    monkeypatch.setattr(NaoqiHead, "angles", SimpleNamespace(publish=sent.append))
    with GraphTester(NaoqiHead, parameters=LIMITS) as graph:
        target(graph, 0.0, 0.0)
        graph.run(5.0)
        target(graph, 0.1, 0.0, duration_s=20.0)
        graph.run(0.1)
        assert sent[-1]["joint_angles"] == [0.1, 0.0]
        assert sent[-1]["speed"] == pytest.approx(0.01)


class Controller(Node):
    """A controller whose new goal aborts the one before it."""

    follow = ActionServer("control_msgs/action/FollowJointTrajectory", "/head_controller/follow_joint_trajectory")
    present: GoalHandle | None = None

    @follow
    def on_goal(self, goal: GoalHandle) -> None:
        if self.present is not None:
            self.present.abort({"error_string": "replaced"})
        self.present = goal


def test_a_goal_that_a_newer_target_replaces_is_no_fault(monkeypatch):
    reasons: list[str] = []
    monkeypatch.setattr(TrajectoryActionHead, "report_health", lambda _, state, reason="": reasons.append(reason))
    nodes = (NodeConfig("head", TrajectoryActionHead, LIMITS), NodeConfig("controller", Controller))
    with GraphTester(Graph("robot", nodes, inputs=frozenset({TARGET}))) as graph:
        target(graph, 0.5, 0.0, duration_s=1.0)
        graph.run(0.2)
        target(graph, -0.5, 0.0, duration_s=1.0)
        graph.run(0.2)
        assert not any(reasons)
        graph.node("controller").present.abort({"error_string": "blocked"})
        graph.run(0.2)
        assert reasons[-1] == "the head did not move: blocked"
        target(graph, 0.5, 0.0, duration_s=1.0)
        graph.run(0.2)
        graph.node("controller").present.succeed({"error_code": -5})  # as some drivers end a failed motion
        graph.run(0.2)
    assert reasons[-1] == "the head did not move: error -5 of the controller"


def test_a_head_that_did_not_move_sends_nothing_at_the_end():
    with GraphTester(TrajectoryHead, parameters=LIMITS) as graph:
        graph.run(1.0)
        end(graph)
    assert graph.messages(SENT) == []
