"""What arms do: goals for the wrists, and how they are taken and left."""

from __future__ import annotations

import ast
import inspect

import figure
import gait
import numpy as np
import posture
import pytest
import rooms
import story
from hypothesis import given
from hypothesis import strategies as st

NAMES = ("wave", "phone", "reading", "crossed", "pockets", "hips", "carry", "push", "case", "plank", "lap", "rims")
ANGLES = st.floats(-np.pi, np.pi)
TURNS = st.builds(
    lambda x, y, z: gait.turn("x", x) @ gait.turn("y", y) @ gait.turn("z", z), ANGLES, ANGLES, ANGLES
)  # fmt: skip


def postures(*arms: tuple[float, float, str], carries: str | None = None):
    """The postures of a role that only stands."""
    role = story.Role(((0.0, 0.0, 3.0, 0.0), (20.0, 0.0, 3.0, 0.0)), (), 0.5, None, arms, carries)
    return posture.Postures(role, figure.build(figure.skeleton()))


# Goals


def test_all_postures_are_tried_here():
    compared = {
        node.comparators[0].value
        for node in ast.walk(ast.parse(inspect.getsource(posture.reaches)))
        if isinstance(node, ast.Compare) and isinstance(node.comparators[0], ast.Constant)
    }
    assert compared == set(NAMES)
    assert set(posture.LOADS.values()) <= set(NAMES)


def test_clips_ask_for_known_postures_and_loads_only():
    roles = [visit.role for clip in rooms.CLIPS.values() for visit in clip.visits]
    assert {name for role in roles for _, _, name in role.arms} <= set(NAMES)
    assert {role.carries for role in roles} <= {None, *posture.LOADS}


def test_an_unknown_posture_is_named():
    with pytest.raises(ValueError, match="'juggling'"):
        posture.reaches("juggling", figure.build(figure.skeleton()))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("stature", [1.5, 1.75, 1.95])
def test_hands_go_where_the_arm_reaches_and_not_into_the_trunk(name, stature):
    build = figure.build(figure.skeleton(stature))
    for goal in posture.reaches(name, build).values():
        out, ahead, up = goal.wrist
        # Whoever is small cannot quite take the handle of a trolley, nor hold a large box from below.
        assert np.linalg.norm(goal.wrist - build.shoulder) < build.reach + (0.12 if name in ("push", "carry") else 0)
        assert ahead < build.chest or out > build.side or (out > 0.1 and up > build.shoulder[2])


@pytest.mark.parametrize("name", NAMES)
def test_directions_of_a_goal_leave_no_doubt(name):
    """Elbow and thumb are made square to other directions, which they must not point along."""
    build = figure.build(figure.skeleton())
    for goal in posture.reaches(name, build).values():
        for direction, other in ((goal.elbow, goal.wrist - build.shoulder), (goal.thumb, goal.hand)):
            cosine = np.dot(direction, other) / np.linalg.norm(direction) / np.linalg.norm(other)
            assert abs(cosine) < 0.95


def test_one_hand_waves_telephones_and_reads_and_two_carry_and_push():
    build = figure.build(figure.skeleton())
    sides = {name: set(posture.reaches(name, build)) for name in NAMES}
    one = {"wave", "phone", "reading", "case", "plank"}
    assert {name for name, taking in sides.items() if taking == {"R"}} == one
    assert {name for name, taking in sides.items() if taking == {"L", "R"}} == set(NAMES) - one


# Over time


@given(st.floats(-3, 15), st.floats(0, 1))
def test_a_posture_is_taken_and_left_smoothly_and_only_in_its_span(time, later):
    made = postures((2.0, 8.0, "hips"))
    share = made.share(time, "hips")
    assert 0 <= share <= 1
    assert (share == 0) if not 2 < time < 8 else (share > 0)
    if 2 + posture.EASE <= time <= 8 - posture.EASE:
        assert share == 1
    assert abs(made.share(time + 0.02 * later, "hips") - share) <= 0.02 * 1.5 / posture.EASE + 1e-9
    assert share == pytest.approx(made.share(10 - time, "hips"))
    assert made.share(time, "wave") == 0


def test_a_load_is_held_during_hand_motions():
    made = postures((2.0, 8.0, "wave"), carries="box")
    for time in (-5.0, 0.0, 5.0, 100.0):
        assert made.share(time, "carry") == 1
    right, left = made.goals(5.0, "R"), made.goals(5.0, "L")
    build = figure.build(figure.skeleton())
    assert [goal.waving for _, goal in right] == [0, posture.reaches("wave", build)["R"].waving]
    assert len(left) == 1
    assert [share for share, _ in right] == [1, 1]


def test_the_other_arm_and_other_times_have_no_goal():
    made = postures((2.0, 8.0, "phone"))
    assert made.goals(5.0, "L") == made.goals(1.9, "R") == made.goals(8.1, "R") == []
    assert len(made.goals(5.0, "R")) == 1


@given(st.floats(-1, 2), st.floats(-1, 2))
def test_a_smooth_step_rises_from_0_to_1(a, b):
    low, high = (posture.smooth_step(value) for value in sorted((a, b)))
    assert 0 <= low <= high <= 1
    assert (posture.smooth_step(0), posture.smooth_step(0.5), posture.smooth_step(1)) == (0, 0.5, 1)


# Rotations between


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """How far two rotations lie apart, radians."""
    return float(2 * np.arcsin(np.clip(np.linalg.norm(a - b) / np.sqrt(8), 0, 1)))


@given(TURNS, TURNS, st.floats(0, 1))
def test_a_rotation_between_lies_on_the_shortest_way_at_its_share(start, end, share):
    between = posture.slerp(start, end, share)
    assert between @ between.T == pytest.approx(np.eye(3), abs=1e-6)
    assert np.linalg.det(between) == pytest.approx(1)
    assert angle(start, between) == pytest.approx(share * angle(start, end), abs=1e-4)
    assert angle(between, end) == pytest.approx((1 - share) * angle(start, end), abs=1e-4)


@given(TURNS, st.sampled_from("xyz"), st.sampled_from([1, -1]), st.floats(0, 1e-9))
def test_a_half_turn_has_a_way_too(start, axis, sign, nearly):
    end = start @ gait.turn(axis, sign * (np.pi - nearly))
    assert posture.slerp(start, end, 1.0) == pytest.approx(end, abs=1e-6)
    assert angle(start, posture.slerp(start, end, 0.5)) == pytest.approx(np.pi / 2, abs=1e-6)
