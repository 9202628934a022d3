from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError
from socialbot.core.messages import Transform, Transforms
from socialbot.vision.camera import ASSUMED, UNKNOWN_HEIGHT, UNKNOWN_PITCH, CameraModel, CameraPose
from socialbot.vision.camera_pose import (
    PoseEstimator,
    floor_plane,
    load_pose,
    pose_beside,
    pose_from_transforms,
    save_pose,
)
from socialbot.vision.depth import RegisteredDepth
from socialbot.vision.depth_sensors import DepthSensors
from socialbot.vision.transforms import AXES, TransformTree, matrix_of
from tests.vision.depth_scenes import CAMERA, Room, render, with_errors
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
    model = CameraModel.from_field_of_view(640, 480, 1.3, CameraPose(height_m=height, pitch_rad=pitch))
    pose = crowd(model, seed).pose
    assert pose.source in ("people", "assumed")
    assert abs(pose.height_m - height) < 3.5 * pose.height_std_m
    assert abs(pose.pitch_rad - pitch) < 3.5 * pose.pitch_std_rad


def test_many_people_make_the_pose_precise():
    model = CameraModel.from_field_of_view(640, 480, 1.3, CameraPose(height_m=1.1, pitch_rad=0.1))
    pose = crowd(model, 3, people=20).pose
    assert pose.people == 20
    assert pose.height_std_m < 0.1
    assert pose.pitch_std_rad < 0.02
    assert pose.height_m == pytest.approx(1.1, rel=0.1)
    assert pose.pitch_rad == pytest.approx(0.1, abs=0.02)


def test_errors_of_height_and_pitch_are_consistent_where_people_move_the_estimate_far():
    model, estimator = CameraModel.from_field_of_view(854, 480, 1.09), PoseEstimator()
    boxes = [(334, 202, 31, 73), (116, 195, 31, 77), (651, 209, 35, 76), (301, 280, 32, 83), (798, 67, 27, 58)]
    for number, box in enumerate([*boxes, (95, 17, 21, 50)]):
        estimator.see(model, box, str(number), 0.0)
        assert abs(estimator.pose.correlation) <= 1


def test_person_who_stands_still_is_counted_once():
    model = CameraModel.from_field_of_view(640, 480, 1.3, CameraPose(height_m=1.1, pitch_rad=0.0))
    estimator, box = PoseEstimator(), box_of(model, 4.0, 0.0)
    assert estimator.see(model, box, "a", 0.0)
    assert not any(estimator.see(model, box, "a", second) for second in range(1, 50))


def test_known_height_stays_and_the_pitch_is_found():
    model = CameraModel.from_field_of_view(640, 480, 1.3, CameraPose(height_m=1.1, pitch_rad=0.1))
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


def _room_points(table: tuple[float, float, float] | None = None) -> np.ndarray:
    """Points of an empty room in the optical frame of `CAMERA`, as a depth camera measures them."""
    return RegisteredDepth(with_errors(render(Room([], wall=6.0, table=table)), seed=1)).cloud(CAMERA)


def test_floor_gives_the_pose_before_anybody_comes():
    estimator = PoseEstimator()
    assert estimator.see_floor(_room_points())
    pose = estimator.pose
    assert (pose.source, pose.people) == ("floor", 0)
    assert abs(pose.height_m - CAMERA.pose.height_m) < 2 * pose.height_std_m < 0.4
    assert abs(pose.pitch_rad - CAMERA.pose.pitch_rad) < 2 * pose.pitch_std_rad < 0.1


def test_floor_makes_the_pose_from_people_more_precise():
    alone = crowd(CAMERA, 3, people=4)
    before = alone.pose
    assert alone.see_floor(_room_points())
    pose = alone.pose
    assert (pose.source, pose.people) == ("people", before.people)
    assert pose.height_std_m < before.height_std_m
    assert pose.pitch_std_rad < before.pitch_std_rad
    assert abs(pose.height_m - CAMERA.pose.height_m) < 2 * pose.height_std_m
    assert alone.floors == 1


def test_table_that_people_contradict_is_no_floor():
    estimator = crowd(CAMERA, 3, people=20)
    before = estimator.pose
    random = np.random.default_rng(1)
    table = np.column_stack([random.uniform(-1, 1, 500), np.full(500, 0.35), random.uniform(0.5, 3, 500)])
    assert estimator.see_floor(table)
    assert estimator.pose == before
    assert estimator.floors == 0


def test_floor_leaves_known_values():
    estimator = PoseEstimator(CameraPose.stated(1.7, UNKNOWN_PITCH))
    assert estimator.see_floor(_room_points())
    assert (estimator.pose.height_m, estimator.pose.height_std_m) == (pytest.approx(1.7), 0.0)


def test_wall_says_nothing_of_the_pose():
    estimator = PoseEstimator()
    random = np.random.default_rng(1)
    wall = np.column_stack([random.uniform(-2, 2, 400), random.uniform(-2, 2, 400), np.full(400, 3.0)])
    assert not estimator.see_floor(wall)
    assert estimator.pose == ASSUMED


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
    (tmp_path / "deep.json").write_text('{"height_m": 1, "pitch_rad": 0, "more": ' + "[" * 100_000)
    with pytest.raises(ParameterError, match="is no pose of a camera"):
        load_pose(tmp_path / "deep.json")


def test_rendered_bags_state_their_pose():
    pose = load_pose(pose_beside(DATA / "corridor"))
    assert pose == CameraPose(height_m=1.62, pitch_rad=0.052)


Quaternion = tuple[float, float, float, float]
LEVEL: Quaternion = (0.0, 0.0, 0.0, 1.0)
TO_OPTICAL: Quaternion = (-0.5, 0.5, -0.5, 0.5)
"""Turn from body axes to optical axes, REP-103."""


def turn(axis: int, angle: float) -> Quaternion:
    values = [0.0, 0.0, 0.0, math.cos(angle / 2)]
    values[axis] = math.sin(angle / 2)
    return values[0], values[1], values[2], values[3]


def link(parent: str, child: str, height: float = 0.0, rotation: Quaternion = LEVEL, stamp: int = 0) -> Transform:
    return Transform(stamp=stamp, parent=parent, child=child, translation=(0.1, 0.0, height), rotation=rotation)


def head(base: str, height: float, pitch: float, roll: float, *, stamp: int = 0) -> list[Transform]:
    """A head with a camera: tilted down by ``pitch`` and then turned clockwise by ``roll``."""
    return [
        link(base, "tilt", height, turn(1, pitch), stamp),
        link("tilt", "camera_link", 0.0, turn(0, roll), stamp),
        link("camera_link", "camera_optical_frame", 0.0, TO_OPTICAL, stamp),
    ]


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.3, 2.5), st.floats(-0.4, 0.8), st.floats(-0.3, 0.3), st.floats(1, 8), st.floats(-1, 1), st.floats(0, 2)
)
def test_transforms_give_the_directions_of_points(height, pitch, roll, forward, left, up):
    tree = TransformTree()
    tree.add(head("base_footprint", height, pitch, roll))
    pose = pose_from_transforms(tree, "camera_optical_frame", 0)
    assert pose is not None
    assert (pose.source, pose.height_std_m, pose.pitch_std_rad) == ("tf", 0.0, 0.0)
    to_base = tree.lookup("base_footprint", "camera_optical_frame", 0)
    assert to_base is not None
    x, y, z, _ = np.linalg.inv(to_base) @ (forward + to_base[0, 3], left, up, 1.0)
    if z < 0.1:
        return
    model = CameraModel.from_field_of_view(640, 480, 1.3).at(pose)
    bearing, elevation = model.direction(model.cx + model.fx * x / z, model.cy + model.fy * y / z)
    assert elevation == pytest.approx(math.atan2(up - pose.height_m, math.hypot(forward, left)), abs=1e-6)
    if abs(roll) < 1e-9:
        assert bearing == pytest.approx(math.atan2(left, forward), abs=1e-6)


def test_body_frame_of_a_camera_has_the_pose_of_its_optical_frame():
    tree = TransformTree()
    tree.add(head("robot/base_footprint", 1.2, 0.2, 0.1))
    poses = [pose_from_transforms(tree, frame, 0) for frame in ("camera_link", "camera_optical_frame")]
    assert [each and (each.pitch_rad, each.roll_rad) for each in poses] == [pytest.approx((0.2, 0.1))] * 2
    assert np.allclose(matrix_of((0, 0, 0), TO_OPTICAL), AXES[:4, :4].T)


def test_pose_follows_a_head_that_tilts():
    tree = TransformTree()
    for stamp, pitch in ((0, 0.0), (100, 0.3)):
        tree.add(head("base_footprint", 1.2, pitch, 0.0, stamp=stamp))
    poses = [pose_from_transforms(tree, "camera_optical_frame", stamp) for stamp in (10, 90)]
    assert [each and each.pitch_rad for each in poses] == pytest.approx([0.0, 0.3])


def test_base_link_may_be_above_the_floor():
    tree = TransformTree()
    tree.add(head("base_link", 1.0, 0.0, 0.0))
    rough = pose_from_transforms(tree, "camera_optical_frame", 0)
    assert rough is not None
    assert rough.height_std_m > 0.1
    tree.add([link("base_link", "base_footprint", -0.2)])
    exact = pose_from_transforms(tree, "camera_optical_frame", 0)
    assert exact is not None
    assert (exact.height_m, exact.height_std_m) == (pytest.approx(1.2), 0.0)


def test_camera_that_is_not_connected_to_a_base_is_told_once(caplog):
    sensors = DepthSensors()
    assert sensors.camera_pose("eye", 0) is None
    sensors.take(Transforms(stamp=0, transforms=tuple(head("base_link", 1.0, 0.0, 0.0))))
    for second in range(5):
        assert sensors.camera_pose("eye", second * 10**9) is None
    assert [record.getMessage() for record in caplog.records if "base_link" in record.getMessage()] == [
        "the transforms do not place the camera 'eye' above the floor of base_link: its pose is estimated from people; "
        "check frame_id of the images, and /tf_static"
    ]


@pytest.mark.parametrize(
    ("height", "pitch", "roll", "told"),
    [
        (2.8, 1.5, 0.0, "above base_footprint, pitch 86°, roll 0°, which no person detector can use"),
        (1.2, 0.1, math.pi, "pitch 6°, roll 180°, which no person detector can use"),
        (1.2, 0.0, 1.6, "pitch 0°, roll 92°, which no person detector can use"),
        (-0.3, 0.0, 0.0, "-0.30 m above base_footprint, pitch 0°, roll 0°, which no person detector can use"),
    ],
)
def test_a_pose_that_cannot_be_used_is_told_once(height, pitch, roll, told, caplog):
    sensors = DepthSensors()
    sensors.take(Transforms(stamp=0, transforms=tuple(head("base_footprint", height, pitch, roll))))
    for second in range(5):
        assert sensors.camera_pose("camera_optical_frame", second * 10**9) is None
    [text] = [record.getMessage() for record in caplog.records]
    assert told in text.replace("roll -180", "roll 180")


def test_pose_of_a_camera_close_to_the_floor():
    tree = TransformTree()
    tree.add(head("base_footprint", 0.0, -0.4, 0.0))
    pose = pose_from_transforms(tree, "camera_optical_frame", 0)
    assert pose is not None
    assert pose.height_m == pytest.approx(0.2 * math.sin(0.4))
    assert (pose.pitch_rad, pose.height_std_m) == (pytest.approx(-0.4), 0.0)


@pytest.mark.parametrize("clock_s", [0.0, -100.0])
def test_the_direction_of_a_camera_is_not_known_once_its_transforms_have_stopped(clock_s, caplog):
    optical = (-0.5, 0.5, -0.5, 0.5)
    still = (0.0, 0.0, 0.0, 1.0)

    def link(parent: str, child: str, stamp_s: float, rotation: tuple[float, float, float, float]) -> Transforms:
        stamp = round(stamp_s * SECOND)
        each = Transform(stamp=stamp, parent=parent, child=child, translation=(0.0, 0.0, 0.5), rotation=rotation)
        return Transforms(stamp=stamp, transforms=(each,))

    def yaw(at_s: float) -> float | None:
        return sensors.camera_yaw("eye_optical", round((at_s + clock_s) * SECOND))

    sensors = DepthSensors()
    sensors.take(link("neck", "eye_optical", 0.0, optical))
    sensors.take(link("odom", "base_link", 200.0, still), moving=True)  # drives, but not between base and camera
    for tenth in range(2000, 2030):
        sensors.take(link("base_link", "neck", tenth / 10, still), moving=True)
        assert yaw(tenth / 10) == pytest.approx(0.0)
    assert yaw(204.0) == pytest.approx(0.0)
    assert not caplog.text
    assert yaw(205.5) is None
    assert "have stopped" in caplog.text
    sensors.take(link("base_link", "neck", 206.0, still), moving=True)
    assert yaw(206.0) == pytest.approx(0.0)
