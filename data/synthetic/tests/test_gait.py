"""Walking and standing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

import gait
import numpy as np
import posture
import pytest
import story
import visits
from figure import STATURE, Stepper, build, joint, moved, skeleton, walk, walker
from hypothesis import given, settings
from hypothesis import strategies as st

SLOW_MOTION = 0.04
SPEEDS = st.floats(0.8, 1.45)
STEPS = st.floats(0.5, 0.6)
# Somebody small and quick, somebody usual, somebody tall and slow: stature (m) and speed (m/s).
pytestmark = pytest.mark.slow

WALKS = pytest.mark.parametrize(("stature", "speed"), [(1.55, 1.4), (1.75, 1.25), (1.95, 0.9)])


def standing(*arms: tuple[float, float, str], carries: str | None = None, gesture: tuple[float, float] | None = None):
    """Six seconds on one spot, facing the camera."""
    return story.Role(((0.0, 0.4, 3.0, 0.0), (6.0, 0.4, 3.0, 0.0)), (), 0.5, gesture, arms, carries)


@dataclass(frozen=True)
class Film:
    """Somebody's ``poses``, `SLOW_MOTION` (s) apart."""

    someone: Any
    poses: list[np.ndarray]

    def path(self, label: str) -> np.ndarray:
        """Where a joint is (n, 3)."""
        return np.array([joint(self.someone, pose, label) for pose in self.poses])

    def bending(self, first: str, middle: str, last: str) -> np.ndarray:
        """Degrees by which a limb is bent (n,), 0 straight."""
        a, b, c = map(self.path, (first, middle, last))
        cosine = ((b - a) * (c - b)).sum(1) / np.linalg.norm(b - a, axis=1) / np.linalg.norm(c - b, axis=1)
        return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.fixture(scope="module")
def film() -> Film:
    """Out of a door, up to the camera, turns on the spot, a step aside, and away."""
    legs = (
        visits.Go(-1.1, 6.0), visits.Go(0.3, 4.8, 1.4), visits.Go(0.2, 2.5, 1.3), visits.Stay(2.0, 70),
        visits.Stay(2.0, -20), visits.Go(0.6, 2.4, 0.6, 0), visits.Stay(1.5, 10), visits.Go(-0.3, 4.5, 1.1),
    )  # fmt: skip
    someone = walker(visits.visit("X", 0.0, (-2.9, 6.0), *legs).role)
    times = np.arange(0.0, someone.role.waypoints[-1][0], SLOW_MOTION)
    return Film(someone, [someone.pose(time) for time in times])


@pytest.fixture(scope="module")
def still():
    """Somebody who only stands."""
    return walker(standing())


@cache
def walking(stature: float, speed: float):
    """Somebody who walks six metres and stands."""
    return walker(walk(speed), stature)


def strides(someone, side: str) -> list:
    """Footholds of the steady part of a walk."""
    return [plant for plant in someone.plants[side] if plant.land > 1 and plant.lift < someone.role.stepping[0][1] - 1]


# Rotations and filters


@given(st.sampled_from("xyz"), st.floats(-7, 7))
def test_a_turn_is_right_handed(axis, angle):
    first = "xyz".index(axis)
    second, third = (first + 1) % 3, (first + 2) % 3
    turned = gait.turn(axis, angle) @ np.eye(3)
    assert turned[:, first] == pytest.approx(np.eye(3)[first])
    assert turned[[second, third], second] == pytest.approx([np.cos(angle), np.sin(angle)])
    assert np.linalg.det(turned) == pytest.approx(1)


@given(*[st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)] * 2)
def test_a_frame_is_square_and_lies_along_its_direction(along, hint):
    if np.linalg.norm(np.cross(along, hint)) < 0.01:
        return
    made = gait.frame(along, hint)
    assert made.T @ made == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(made) == pytest.approx(1)
    assert made[:, 0] @ along == pytest.approx(np.linalg.norm(along))
    assert made[:, 1] @ hint > 0


@given(st.floats(0.03, 0.3), st.integers(50, 300))
def test_smoothing_keeps_level_length_and_slope_and_shifts_nothing(seconds, count):
    level, slope = np.full(count, 1.7), np.arange(count) / gait.GRID
    assert gait.smooth(level, seconds) == pytest.approx(level)
    margin = int(4 * seconds * gait.GRID)
    inner = slice(margin, max(count - margin, margin))
    assert gait.smooth(slope, seconds)[inner] == pytest.approx(slope[inner])
    step = (slope > slope[count // 2]) * 1.0
    assert gait.smooth(step, seconds)[::-1] == pytest.approx(gait.smooth(step[::-1], seconds))


@given(st.integers(0, 10000), st.floats(2, 9))
def test_wandering_is_seeded_slow_and_of_about_unit_size(seed, period):
    time = np.arange(0, 60, 0.1)
    there = gait.wander(time, period, seed)
    assert (there == gait.wander(time, period, seed)).all()
    assert (there != gait.wander(time, period, seed + 1)).any()
    assert 0.5 < np.abs(there).max() < 1.7
    assert np.abs(np.diff(there)).max() / 0.1 < 2 * np.pi / period * 2


# The skeleton


def test_bones_keep_their_lengths_and_stay_joined(film):
    bones = film.someone.skeleton
    for label, parent in zip(bones.labels, bones.parents, strict=True):
        if parent >= 0:
            own = film.path(label)
            carried = np.array(
                [moved(film.someone, pose, bones.labels[parent], bones.head(label)) for pose in film.poses]
            )
            assert own == pytest.approx(carried)


def test_every_bone_is_turned_and_never_stretched_or_mirrored(film):
    turned = np.stack(film.poses[::10])[:, :, :, :3]
    assert turned @ np.swapaxes(turned, 2, 3) == pytest.approx(np.broadcast_to(np.eye(3), turned.shape), abs=1e-9)
    assert np.linalg.det(turned) == pytest.approx(1)


def test_a_bone_always_moves_with_its_carrier(film):
    bones = film.someone.skeleton
    carriers = bones.carriers()
    follows = {bones.labels[i]: bones.labels[carrier] for i, carrier in enumerate(carriers) if i != carrier}
    assert {"upperleg02.L": "upperleg01.L", "metacarpal2.R": "wrist.R", "eye.L": "head"}.items() <= follows.items()
    reading = gesturing("reading")
    for pose in (*film.poses[::40], reading.pose(1.8), reading.pose(3.0)):
        assert pose == pytest.approx(pose[carriers])


def test_without_turns_everybody_stands_as_at_rest_but_for_the_fingers():
    bones = skeleton()
    still = bones.transforms(bones.head("root"), {})
    hands = [i for i, label in enumerate(bones.labels) if "finger" in label]
    rest = np.delete(still, hands, axis=0)
    assert rest == pytest.approx(np.broadcast_to(np.eye(3, 4), rest.shape))


@given(st.floats(0, 4))
def test_fingers_bend_as_much_as_the_grip_says_and_mirrored(grip):
    for name, degrees in (("finger3-1", 15 * grip), ("finger1-1", 4)):
        left, right = (gait.curl(f"{name}.{side}", grip) for side in "LR")
        assert np.trace(left) == pytest.approx(1 + 2 * np.cos(np.radians(degrees)))
        assert left == pytest.approx(right.T)


# Footsteps


@settings(max_examples=25)
@given(SPEEDS, STEPS)
def test_steps_are_as_long_as_the_speed_asks_and_both_feet_take_turns(speed, step):
    someone = Stepper(walk(speed, 10.0, step))
    start, end = someone.role.stepping[0]
    beat = (end - start) / round((end - start) / step)
    for side in "LR":
        places = [plant.place for plant in strides(someone, side)]
        assert len(places) >= 3
        assert np.diff([place[1] for place in places]) == pytest.approx(-2 * beat * speed, abs=0.01)
    lands = sorted((plant.land, side) for side in "LR" for plant in strides(someone, side))
    assert {side + other for (_, side), (_, other) in pairwise(lands)} == {"LR", "RL"}
    assert np.diff([land for land, _ in lands]) == pytest.approx(beat)


@settings(max_examples=25)
@given(st.floats(-180, 180), SPEEDS)
def test_footprints_lie_left_and_right_of_the_way_with_toes_a_little_out(heading, speed):
    ahead = np.array([np.sin(np.radians(heading)), -np.cos(np.radians(heading))])
    left = np.array([-ahead[1], ahead[0]])
    someone = Stepper(visits.visit("X", 0.0, (0.0, 9.0), visits.Go(*(ahead * 6 + [0, 9]), speed)).role)
    for side, sign in gait.SIDES.items():
        for plant in strides(someone, side):
            assert (plant.place[:2] - [0, 9]) @ left == pytest.approx(sign * 0.085, abs=0.005)
            out = plant.place[2] - np.radians(heading)
            assert 0 < sign * np.arctan2(np.sin(out), np.cos(out)) < np.radians(15)


ERRANDS = st.builds(
    lambda x, away, speed, seconds, heading: [
        visits.Go(x, 8.0 + away, speed), visits.Stay(seconds, heading), visits.Go(x, 8.0, speed),
    ],
    st.floats(-1, 1), st.floats(2, 8), SPEEDS, st.floats(2, 4), st.one_of(st.none(), st.floats(-180, 180)),
)  # fmt: skip


@settings(max_examples=50)
@given(st.lists(ERRANDS, max_size=2), STEPS)
def test_a_foot_lands_before_it_lifts_and_at_least_one_foot_stands(errands, step):
    legs = [leg for errand in errands for leg in errand]
    someone = Stepper(visits.visit("X", 0.0, (0.0, 4.0), visits.Go(0.0, 8.0), *legs, step=step).role)
    swings = []
    for plants in someone.plants.values():
        assert plants[0].land == -np.inf
        assert plants[-1].lift == np.inf
        assert all(plant.land < plant.lift for plant in plants)
        swings += [(plant.lift, after.land) for plant, after in pairwise(plants)]
    assert all(lift < land for lift, land in swings)
    assert all(land <= lift for (_, land), (lift, _) in pairwise(sorted(swings)))


def test_at_the_end_both_feet_stand_side_by_side_under_the_body():
    someone = walker(walk())
    end = someone.role.waypoints[-1][0]
    left, right = (someone.foot(side, end) for side in "LR")
    assert left[3]
    assert right[3]
    assert left[0] - right[0] == pytest.approx(np.array([0.21, 0, 0]), abs=0.02)
    assert (left[0] + right[0])[:2] / 2 == pytest.approx(someone.track(end)[:2], abs=0.03)
    assert joint(someone, someone.pose(end), "root")[:2] == pytest.approx(someone.track(end)[:2], abs=0.08)


@WALKS
def test_a_standing_foot_keeps_its_heel_or_ball_on_one_spot_of_the_floor(stature, speed):
    someone = walking(stature, speed)
    for side in "LR":
        for plant in strides(someone, side):
            contacts: dict[str, list[np.ndarray]] = {"heel": [], "ball": []}
            for time in np.arange(plant.land, plant.lift, 0.03):
                ankle, pitch = someone.on_floor(side, plant, time)
                foot = gait.turn("z", plant.place[2]) @ gait.turn("x", pitch)
                for name, spots in contacts.items():
                    if pitch == 0 or (name == "ball") == (pitch > 0):
                        spots.append(ankle + foot @ (getattr(someone, name)[side] - someone.sole[side]))
            for spots in contacts.values():
                assert np.array(spots)[:, 2] == pytest.approx(0, abs=1e-9)
                assert np.ptp(spots, axis=0) == pytest.approx(np.zeros(3), abs=1e-9)


# Poses


def test_neither_heel_nor_ball_is_ever_below_the_floor(film):
    for side in "LR":
        for spots in (film.someone.heel, film.someone.ball):
            height = [moved(film.someone, pose, f"foot.{side}", spots[side])[2] for pose in film.poses]
            assert min(height) > -0.001
            assert max(height) > 0.05


@WALKS
def test_legs_reach_flat_feet_so_that_these_do_not_slide(stature, speed):
    someone = walking(stature, speed)
    for time in np.arange(1, someone.role.waypoints[-1][0], 0.1):
        pose = someone.pose(time)
        for side in "LR":
            ankle, pitch, _, stands = someone.foot(side, time)
            if stands and pitch < 0.25:
                assert np.linalg.norm(joint(someone, pose, f"foot.{side}") - ankle) < 0.015


def test_knees_and_elbows_bend_forwards_only_and_no_farther_than_in_life(film):
    for side in "LR":
        knee = film.bending(f"upperleg01.{side}", f"lowerleg01.{side}", f"foot.{side}")
        assert 0 < knee.min() < 15
        assert 50 < knee.max() < 120
        elbow = film.bending(f"upperarm01.{side}", f"lowerarm01.{side}", f"wrist.{side}")
        assert elbow.min() > 5
        assert elbow.max() < 60
        chords = (
            (f"upperleg01.{side}", f"lowerleg01.{side}", f"foot.{side}", 1),
            (f"upperarm01.{side}", f"lowerarm01.{side}", f"wrist.{side}", -1),
        )
        ahead = np.array([pose[film.someone.skeleton.index["spine05"], :, :3] @ [0, -1, 0] for pose in film.poses])
        for first, middle, last, sign in chords:
            off_line = film.path(middle) - (film.path(first) + film.path(last)) / 2
            assert (sign * (off_line * ahead).sum(1)).min() > -0.02


def test_nothing_jumps(film):
    for label, fastest in (("root", 4), ("head", 4), ("wrist.L", 6), ("wrist.R", 6), ("foot.L", 7), ("foot.R", 7)):
        assert np.linalg.norm(np.diff(film.path(label), axis=0), axis=1).max() / SLOW_MOTION < fastest
    turned = np.stack(film.poses)[:, :, :, :3]
    # Degrees that a bone turns in one time step.
    change = np.degrees(2 * np.arcsin(np.linalg.norm(np.diff(turned, axis=0), axis=(2, 3)) / np.sqrt(8)))
    assert change.max() / SLOW_MOTION < 900


@WALKS
def test_legs_repeat_after_two_steps_and_mirror_each_other_after_one(stature, speed):
    someone = walking(stature, speed)
    start, end = someone.role.stepping[0]
    beat = (end - start) / round((end - start) / someone.role.step)
    for time in np.linspace(1.6, 1.6 + beat, 4):
        here, next_step, again = (around(someone, time + k * beat) for k in range(3))
        for label in ("root", "upperleg01", "lowerleg01", "foot"):
            for side in ("",) if label == "root" else (".L", ".R"):
                other = side.translate(str.maketrans("LR", "RL"))
                assert again[label + side] == pytest.approx(here[label + side], abs=0.01)
                assert next_step[label + side] == pytest.approx(here[label + other] * [-1, 1, 1], abs=0.01)


def around(someone, time: float) -> dict[str, np.ndarray]:
    """Joints from the place on the track."""
    pose, place = someone.pose(time), np.array([*someone.track(time)[:2], 0])
    return {label: joint(someone, pose, label) - place for label in someone.skeleton.labels}


def test_arms_swing_against_the_legs():
    someone = walking(1.75, 1.25)
    joints = [around(someone, time) for time in np.arange(1.2, 4, 0.07)]
    for side in "LR":
        arm, leg = ([where[f"{name}.{side}"][1] for where in joints] for name in ("wrist", "foot"))
        assert np.ptp(arm) > 0.2
        assert np.corrcoef(arm, leg)[0, 1] < -0.8


@WALKS
def test_people_walk_upright_with_the_head_at_its_height(stature, speed):
    someone = walking(stature, speed)
    rest = someone.skeleton.head("head")[2]
    for time in np.arange(1, someone.role.waypoints[-1][0], 0.2):
        pose = someone.pose(time)
        head, root = (joint(someone, pose, label) for label in ("head", "root"))
        assert rest - 0.07 < head[2] < rest + 0.005
        assert np.linalg.norm((head - root)[:2] - [0, -0.11 * stature / STATURE]) < 0.12


@given(st.floats(0, 6))
def test_standing_person_keeps_the_feet_and_hardly_moves(still, time):
    pose = still.pose(time)
    for side in "LR":
        assert joint(still, pose, f"foot.{side}") == pytest.approx(still.foot(side, 0.0)[0], abs=0.01)
    assert np.linalg.norm(joint(still, pose, "head")[:2] - [0.4, 2.9]) < 0.12
    assert np.abs(still.pose(time + SLOW_MOTION)[:, :, :3] - pose[:, :, :3]).max() < 0.02


def test_the_seed_shapes_idle_motion_and_nothing_else(still):
    same, other = walker(still.role, seed=1), walker(still.role, seed=2)
    for time in (1.0, 3.0, 5.0):
        assert (same.pose(time) == still.pose(time)).all()
        assert 0.01 < np.abs(other.pose(time) - still.pose(time)).max() < 0.5
        for side in "LR":
            assert (other.foot(side, time)[0] == still.foot(side, time)[0]).all()


# Arms


@cache
def gesturing(name: str):
    """Somebody who takes a posture from 1.5 to 4.5 s."""
    return walker(standing((1.5, 4.5, name)))


POSTURES = pytest.mark.parametrize("name", ["wave", "phone", "reading", "crossed", "pockets", "hips"])


@POSTURES
def test_a_posture_brings_the_wrists_where_it_says_and_lets_go_again(still, name):
    someone = gesturing(name)
    goals = posture.reaches(name, build(someone.skeleton))
    chest = someone.skeleton.index["spine03"]
    for side in "LR":
        wrist = f"wrist.{side}"
        for time in (2.2, 3.0, 3.8):
            pose = someone.pose(time)
            calm = joint(still, still.pose(time), wrist)
            if side not in goals:
                assert joint(someone, pose, wrist) == pytest.approx(calm, abs=1e-6)
                continue
            wanted = goals[side].wrist * [gait.SIDES[side], 1, 1]
            reached = pose[chest, :, :3].T @ (joint(someone, pose, wrist) - pose[chest, :, 3])
            assert np.linalg.norm(reached - wanted) < 0.03 + goals[side].waving
            assert np.linalg.norm(joint(someone, pose, wrist) - calm) > 0.1
        for time in (1.4, 4.6):
            calm = joint(still, still.pose(time), wrist)
            assert joint(someone, someone.pose(time), wrist) == pytest.approx(calm, abs=1e-6)


@POSTURES
def test_arms_go_into_a_posture_and_out_of_it_without_a_jerk(name):
    someone = gesturing(name)
    for side in "LR":
        way = [joint(someone, someone.pose(t), f"wrist.{side}") for t in np.arange(1.4, 2.3, SLOW_MOTION)]
        assert np.linalg.norm(np.diff(way, axis=0), axis=1).max() / SLOW_MOTION < 4


def test_hands_on_a_box_stay_before_the_trunk_all_the_way():
    someone = walker(replace(walk(), carries="box"))
    chest = someone.skeleton.index["spine03"]
    for time in np.arange(0, someone.role.waypoints[-1][0], 0.2):
        pose = someone.pose(time)
        left, right = (
            pose[chest, :, :3].T @ (joint(someone, pose, f"wrist.{side}") - pose[chest, :, 3]) for side in "LR"
        )
        assert left == pytest.approx(right * [-1, 1, 1], abs=1e-6)
        assert left[1] < -0.25
        assert left[0] == pytest.approx(0.215, abs=0.02)


def test_a_gesture_lifts_the_right_hand_only_and_only_for_its_time(still):
    someone = walker(standing(gesture=(1.5, 4.5)))
    low, high = ({side: joint(someone, someone.pose(time), f"wrist.{side}")[2] for side in "LR"} for time in (1.4, 3.0))
    assert high["R"] - low["R"] > 0.3
    assert high["L"] == pytest.approx(low["L"], abs=0.05)
    assert someone.gesture(1.4) == someone.gesture(4.6) == still.gesture(3.0) == 0
    assert someone.gesture(3.0) == 1


# Seated people


@pytest.mark.parametrize("stature", [1.2, 1.55, 1.75, 1.95])
def test_a_seated_person_has_the_hips_over_the_seat_and_the_feet_on_the_floor_or_above_it(stature):
    role = visits.visit("X", 0.0, (0.0, 3.0), visits.Stay(2.0), visits.Sit(8.0), visits.Stay(2.0), heading=0.0).role
    someone = walker(role, stature)
    transforms = someone.pose(6.0)
    hip, knee, ankle = (joint(someone, transforms, f"{label}.L") for label in ("upperleg01", "lowerleg01", "foot"))
    assert hip[2] == pytest.approx(0.45 + gait.HIP_OVER_SEAT, abs=0.03)
    assert hip[1] - ankle[1] == pytest.approx(someone.thigh(), abs=0.08)
    assert knee[1] < hip[1] - 0.6 * someone.thigh()
    assert ankle[2] >= someone.sole["L"][2] - 1e-6
    shin = np.linalg.norm(knee - ankle)
    assert shin == pytest.approx(np.linalg.norm(someone.sole["L"] - someone.skeleton.head("lowerleg01.L")), abs=1e-3)
    standing_ = someone.pose(0.5)
    assert joint(someone, standing_, "upperleg01.L")[2] > 0.45 * stature


def test_sitting_down_moves_the_pelvis_without_a_jerk():
    role = visits.visit("X", 0.0, (0.0, 3.0), visits.Stay(1.0), visits.Sit(6.0), visits.Stay(1.0), heading=0.0).role
    someone = walker(role)
    heights = [joint(someone, someone.pose(time), "root")[2] for time in np.arange(0.0, 8.0, SLOW_MOTION)]
    assert np.abs(np.diff(heights)).max() < 0.05
    assert min(heights) < 0.62 < 0.85 < max(heights)


def test_a_wheelchair_user_keeps_the_feet_on_the_rests_and_takes_no_steps():
    role = visits.visit("X", 0.0, (0.0, 5.0), visits.Go(0.0, 2.0, 0.8), visits.Stay(2.0, 30), carries="wheelchair").role
    someone = walker(role)
    assert role.stepping == ()
    away = []
    for time in np.arange(0.0, 5.5, 0.25):
        transforms = someone.pose(time)
        ankle, root = joint(someone, transforms, "foot.L"), joint(someone, transforms, "root")
        assert ankle[2] == pytest.approx(gait.FOOTREST + someone.sole["L"][2], abs=0.02)
        away.append(np.linalg.norm((ankle - root)[:2]))
    assert np.ptp(away) < 0.05
