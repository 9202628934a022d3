"""Joint positions of a head from its commands."""

from __future__ import annotations

import math

import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import JointTrajectory
from socialbot.graph.files import load_graph
from socialbot.runs._streams import HeadTarget
from socialbot.runs.standard_messages import HeadCourse, Joints, Neck, neck_of

PAN, TILT = "head_pan_joint", "head_tilt_joint"
BOTH = (PAN, TILT)


def told(
    stamp: int, pan: float, tilt: float, duration_s: float, names: tuple[str, ...] = (PAN, TILT)
) -> JointTrajectory:
    return JointTrajectory(
        stamp=stamp, joint_names=names, positions=(pan, tilt), velocities=(0.0, 0.0), duration_s=duration_s
    )


def joints(*turns: JointTrajectory) -> Joints:
    made = Joints(BOTH)
    for turn in turns:
        made.take(turn)
    return made


def test_turn_begins_at_the_current_position() -> None:
    first = joints(told(SECOND, 1.0, 0.2, 2.0))
    assert [first.at(name, 2 * SECOND) for name in first.names] == pytest.approx([0.5, 0.1])
    assert [first.at(name, 9 * SECOND) for name in first.names] == [1.0, 0.2]
    first.take(told(2 * SECOND, 0.0, 0.0, 1.0))
    assert first.at(PAN, 2 * SECOND + SECOND // 2) == pytest.approx(0.25)


def test_earlier_joint_positions() -> None:
    head = joints(told(SECOND, 1.0, 0.0, 1.0), told(3 * SECOND, 0.0, 0.0, 1.0))
    assert head.at(PAN, SECOND // 2) == 0.0
    assert head.at(PAN, SECOND + SECOND // 2) == pytest.approx(0.5)
    assert head.at(PAN, 2 * SECOND) == 1.0


def test_unknown_joints_are_ignored() -> None:
    head = joints(told(SECOND, 0.1, 0.7, 0.0, (TILT, PAN)), told(SECOND, 0.9, 0.9, 0.0, ("elbow", "wrist")))
    assert (head.at(PAN, 2 * SECOND), head.at(TILT, 2 * SECOND)) == (0.7, 0.1)


def test_invalid_targets_are_ignored() -> None:
    head = joints(told(SECOND, math.nan, 0.2, 0.0))
    head.take(JointTrajectory(stamp=SECOND, joint_names=(PAN, TILT), positions=(), velocities=(), duration_s=1.0))
    assert (head.at(PAN, 2 * SECOND), head.at(TILT, 2 * SECOND)) == (0.0, 0.2)


def test_neck_of_a_graph() -> None:
    waldo = load_graph("waldo")
    assert neck_of(waldo) == Neck(PAN, TILT)
    assert neck_of(waldo.with_parameters({"head": {"pan_joint": "neck_1"}})) == Neck("neck_1", TILT)
    assert neck_of(load_graph("warehouse")) is None


def test_head_pose_at_any_time() -> None:
    course = HeadCourse(
        [
            HeadTarget(SECOND, 1.0, 0.2, 2.0),
            HeadTarget(2 * SECOND, 0.0, 0.0, 1.0),
            HeadTarget(9 * SECOND, 0.3, 0.3, 0.0),
        ]
    )
    assert course.at(SECOND // 2) == (0.0, 0.0)
    assert course.at(2 * SECOND) == pytest.approx((0.5, 0.1)), "it was told anew half way"
    assert course.at(2 * SECOND + SECOND // 2) == pytest.approx((0.25, 0.05))
    assert course.at(8 * SECOND) == (0.0, 0.0), "and does not begin to turn before it is told"
    assert course.at(9 * SECOND) == (0.3, 0.3)
