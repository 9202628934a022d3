from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.errors import ParameterError
from socialbot.vision.camera import ASSUMED, UNKNOWN_HEIGHT, UNKNOWN_PITCH, CameraModel, CameraPose
from socialbot.vision.camera_pose import PoseEstimator, floor_plane, load_pose, pose_beside, save_pose
from tests.vision.test_distance import box_of

DATA = Path(__file__).parents[2] / "data/synthetic"


def crowd(model: CameraModel, seed: int, people: int = 10) -> PoseEstimator:
    """An estimator that has seen people, adults and some children, who walk through the view."""
    random, estimator = np.random.default_rng(seed), PoseEstimator()
    for person in range(people):
        tall = random.normal(1.73, 0.09) if random.random() > 0.15 else random.uniform(0.95, 1.5)
        begin, end = random.uniform(1.5, 10, 2)
        for step in range(10):
            box = box_of(model, begin + (end - begin) * step / 10, random.uniform(-0.3, 0.3), tall=tall)
            x, y, w, h = box
            if x <= 1 or y <= 1 or x + w >= model.width - 1 or y + h >= model.height - 1:
                continue
            y, bottom = y + random.normal(0, 0.02 * h), y + h + random.normal(0, 0.02 * h)
            estimator.see(model, (x, y, w, bottom - y), str(person), person * 20 + step)
    return estimator


@settings(max_examples=8, deadline=None)
@given(st.floats(0.3, 2.5), st.floats(-0.15, 0.25), st.integers(0, 1000))
def test_pose_is_found_from_people_within_its_error(height, pitch, seed):
    pitch += 0.1 * (height - 1.2)
    model = CameraModel.from_field_of_view(640, 480, 1.3, mount_height_m=height, pitch_rad=pitch)
    pose = crowd(model, seed).pose
    assert pose.source in ("people", "assumed")
    assert abs(pose.height_m - height) < 3.5 * pose.height_std_m
    assert abs(pose.pitch_rad - pitch) < 3.5 * pose.pitch_std_rad


def test_many_people_make_the_pose_precise():
    model = CameraModel.from_field_of_view(640, 480, 1.3, mount_height_m=1.1, pitch_rad=0.1)
    pose = crowd(model, 3, people=20).pose
    assert pose.people == 20
    assert pose.height_std_m < 0.1
    assert pose.pitch_std_rad < 0.02
    assert pose.height_m == pytest.approx(1.1, rel=0.1)
    assert pose.pitch_rad == pytest.approx(0.1, abs=0.02)


def test_person_who_stands_still_is_counted_once():
    model = CameraModel.from_field_of_view(640, 480, 1.3, mount_height_m=1.1, pitch_rad=0.0)
    estimator, box = PoseEstimator(), box_of(model, 4.0, 0.0)
    assert estimator.see(model, box, "a", 0.0)
    assert not any(estimator.see(model, box, "a", second) for second in range(1, 50))


def test_known_height_stays_and_the_pitch_is_found():
    model = CameraModel.from_field_of_view(640, 480, 1.3, mount_height_m=1.1, pitch_rad=0.1)
    estimator = PoseEstimator(CameraPose.stated(1.1, UNKNOWN_PITCH))
    for number, distance in enumerate((3.0, 4.0, 5.0, 6.5, 8.0)):
        estimator.see(model, box_of(model, distance, 0.0), str(number), number)
    assert (estimator.pose.height_m, estimator.pose.height_std_m) == (pytest.approx(1.1), 0.0)
    assert estimator.pose.pitch_rad == pytest.approx(0.1, abs=0.03)


def test_parameters_state_a_pose_or_leave_it_unknown():
    assert CameraPose.stated(UNKNOWN_HEIGHT, UNKNOWN_PITCH) == ASSUMED
    given_pose = CameraPose.stated(1.2, 0.1)
    assert (given_pose.source, given_pose.height_std_m, given_pose.pitch_std_rad) == ("given", 0.0, 0.0)
    assert CameraPose.stated(1.2, UNKNOWN_PITCH).source == "assumed"


@settings(max_examples=15, deadline=None)
@given(st.floats(0.3, 2.5), st.floats(-0.3, 0.6), st.floats(-0.2, 0.2))
def test_floor_gives_height_pitch_and_roll(height, pitch, roll):
    random = np.random.default_rng(1)
    up = np.array([math.sin(roll) * math.cos(pitch), -math.cos(roll) * math.cos(pitch), -math.sin(pitch)])
    floor = random.uniform(-4, 4, (600, 3))
    floor -= np.outer(floor @ up + height, up)
    things = random.uniform(-2, 2, (200, 3)) - np.outer(np.ones(200), height * up * -0.2)
    found = floor_plane(np.concatenate([floor + random.normal(0, 0.005, floor.shape), things]))
    assert found == pytest.approx((height, pitch, roll), abs=0.03)


def test_walls_are_no_floor():
    random = np.random.default_rng(1)
    wall = np.column_stack([random.uniform(-2, 2, 400), random.uniform(-2, 2, 400), np.full(400, 3.0)])
    assert floor_plane(wall) is None
    assert floor_plane(wall[:10]) is None


def test_pose_file_is_written_and_read(tmp_path):
    pose = CameraPose(height_m=1.2, pitch_rad=0.1, height_std_m=0.1, pitch_std_rad=0.01, source="people", people=4)
    save_pose(pose, tmp_path / "camera.json")
    loaded = load_pose(tmp_path / "camera.json")
    assert loaded is not None
    assert (loaded.height_m, loaded.source, loaded.people) == (1.2, "file", 4)
    assert load_pose(tmp_path / "none.json") is None
    (tmp_path / "bad.json").write_text('{"height_m": -1, "pitch_rad": 0}')
    with pytest.raises(ParameterError, match="height_m"):
        load_pose(tmp_path / "bad.json")


def test_rendered_bags_state_their_pose():
    pose = load_pose(pose_beside(DATA / "corridor"))
    assert pose == CameraPose(height_m=1.62, pitch_rad=0.052)
