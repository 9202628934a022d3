from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.vision.camera import CameraModel, CameraPose
from socialbot.vision.detector import clip
from socialbot.vision.motion import BoxFilter, CameraMotion, Cut, cut_off, moved

WIDTH, HEIGHT = 640, 480


def box(middle: float, top: float, height: float, width: float) -> np.ndarray:
    return np.array([middle - width / 2, top, width, height])


def follow(motion: BoxFilter, boxes: list[np.ndarray], seconds: float = 0.1) -> None:
    """Shows ``motion`` what the picture shows of ``boxes``."""
    for whole in boxes:
        motion.predict(seconds)
        seen = clip(whole[None], WIDTH, HEIGHT)[0]
        motion.correct(seen, cut_off(seen, WIDTH, HEIGHT))


def test_first_box_is_believed():
    assert BoxFilter(box(300, 100, 200, 80)).box == pytest.approx(box(300, 100, 200, 80))


def test_steady_walk_is_predicted():
    motion = BoxFilter(box(100, 100, 200, 80))
    follow(motion, [box(100 + 10 * step, 100, 200, 80) for step in range(1, 15)])
    motion.predict(0.3)
    assert motion.box == pytest.approx(box(270, 100, 200, 80), abs=7)


def test_speed_decays_without_detections():
    motion = BoxFilter(box(100, 100, 200, 80))
    follow(motion, [box(100 + 10 * step, 100, 200, 80) for step in range(1, 15)])
    motion.predict(60.0)
    assert 0 < abs(motion.value[0] - 240) < 200
    assert abs(motion.speed[0]) < 1


def test_prediction_becomes_less_certain():
    motion = BoxFilter(box(100, 100, 200, 80))
    spreads = [motion.spread()]
    for _ in range(5):
        motion.predict(0.2)
        spreads.append(motion.spread())
    assert spreads == sorted(spreads)
    motion.correct(box(100, 100, 200, 80), Cut())
    assert motion.spread()[0] < spreads[1][0]


def test_many_short_steps_equal_a_long_one():
    one, many = BoxFilter(box(100, 100, 200, 80)), BoxFilter(box(100, 100, 200, 80))
    for motion in (one, many):
        follow(motion, [box(100 + 10 * step, 100, 200, 80) for step in range(1, 15)])
    one.predict(0.5)
    for _ in range(50):
        many.predict(0.01)
    assert many.box == pytest.approx(one.box, abs=1e-6)
    assert many.spread() == pytest.approx(one.spread(), rel=0.25)


def test_noise_is_relative_to_the_height():
    near, far = BoxFilter(box(300, 50, 400, 160)), BoxFilter(box(300, 100, 40, 16))
    for motion in (near, far):
        motion.predict(0.4)
    assert near.spread()[0] == pytest.approx(10 * far.spread()[0])


def test_legs_below_the_image_are_predicted():
    motion = BoxFilter(box(300, 60, 300, 110))
    # Whole until 420 pixels high, then cut off by the lower edge.
    follow(motion, [box(300, 60, 300 + 15 * step, 110 + 5.5 * step) for step in range(1, 21)])
    assert motion.value[2] > 450
    assert motion.value[:2] == pytest.approx([300, 60], abs=10)
    assert clip(motion.box[None], WIDTH, HEIGHT)[0] == pytest.approx(box(300, 60, 420, 220), abs=15)


def test_width_is_kept_while_leaving():
    motion = BoxFilter(box(200, 100, 300, 110))
    follow(motion, [box(200 - 20 * step, 100, 300, 110) for step in range(1, 11)])
    assert motion.value[3] == pytest.approx(110, abs=8)
    assert motion.value[0] == pytest.approx(0, abs=12)
    assert motion.speed[0] == pytest.approx(-200, rel=0.25)


def test_width_grows_while_entering():
    motion = BoxFilter(box(20, 100, 300, 40))
    follow(motion, [box(-40 + 20 * step, 100, 300, 110) for step in range(1, 12)])
    assert motion.box == pytest.approx(box(180, 100, 300, 110), abs=12)


def test_hidden_feet_leave_the_height():
    motion = BoxFilter(box(300, 100, 200, 80))
    follow(motion, [box(300, 100, 200, 80)] * 5)
    motion.predict(0.1)
    motion.correct(box(300, 100, 120, 80), Cut(), feet_hidden=True)
    assert motion.value[2] == pytest.approx(200, abs=2)
    motion.correct(box(300, 100, 120, 80), Cut())
    assert motion.value[2] < 190


@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        ((100, 100, 50, 50), Cut()),
        ((0, 100, 50, 50), Cut(left=True)),
        ((100, 1, 50, 477), Cut(top=True, bottom=True)),
        ((590, 100, 49, 50), Cut(right=True)),
        ((0, 0, 640, 480), Cut(True, True, True, True)),
    ],
)
def test_edges_cut_boxes_off(seen, expected):
    assert cut_off(np.array(seen, float), WIDTH, HEIGHT) == expected


@settings(deadline=None, max_examples=100)
@given(
    st.lists(
        st.tuples(
            st.floats(0, 20), st.floats(-200, 600), st.floats(-200, 400), st.floats(1, 900), st.floats(1, 900),
        ),
        min_size=1,
        max_size=12,
    )
)  # fmt: skip
def test_whatever_is_seen_the_state_stays_sound(steps):
    motion = BoxFilter(np.array([300.0, 100, 50, 120]))
    for seconds, *whole in steps:
        motion.predict(seconds)
        seen = clip(np.array([whole]), WIDTH, HEIGHT)[0]
        if (seen[2:] > 0).all():
            motion.correct(seen, cut_off(seen, WIDTH, HEIGHT))
        assert np.isfinite(motion.box).all()
        assert (motion.box[2:] > 0).all()
        assert (motion.variance > 0).all()


# Camera


def _room() -> np.ndarray:
    noise = np.random.default_rng(0).integers(0, 255, (30, 50, 3)).astype(np.uint8)
    return cv2.cvtColor(cv2.resize(noise, (1000, 600), interpolation=cv2.INTER_LINEAR), cv2.COLOR_BGR2GRAY)


@pytest.mark.parametrize(("across", "down"), [(24, 0), (-40, 8), (0, -16)])
def test_turn_of_the_camera_is_measured_beside_people(across, down):
    room, nobody = _room(), np.empty((0, 4))
    first, second = room[60:540, 150:790].copy(), room[60 - down : 540 - down, 150 - across : 790 - across].copy()
    person = np.array([[200.0, 100.0, 150.0, 300.0]])
    first[100:400, 200:350] = second[100:400, 200:350]
    motion = CameraMotion()
    assert motion.follow(first, person) is None
    turn = motion.follow(second, nobody)
    assert turn is not None
    assert moved(turn, np.array([[320, 240]]))[0] == pytest.approx([320 + across, 240 + down], abs=2.5)


def _view(yaw_rad: float) -> CameraModel:
    return CameraModel(500, 500, 320, 240, 640, 480, CameraPose(height_m=1.5, pitch_rad=0.0), yaw_rad)


def _turned(first: np.ndarray, second: np.ndarray, yaw_rad: float) -> tuple[np.ndarray | None, bool]:
    """Motion between two images of a camera that turns by ``yaw_rad`` as stated, and whether they contradict that."""
    motion, nobody = CameraMotion(), np.empty((0, 4))
    motion.follow(first, nobody, _view(0.0))
    return motion.follow(second, nobody, _view(yaw_rad)), motion.contradicted


def test_stated_turn_counts_where_nothing_is_seen():
    dark = np.zeros((480, 640), np.uint8)
    turn, contradicted = _turned(dark, dark, 0.1)
    assert turn is not None
    assert not contradicted
    middle, edge = moved(turn, np.array([[320, 240], [590, 240]]))
    assert middle == pytest.approx([320 + 500 * math.tan(0.1), 240])
    assert edge == pytest.approx([320 + 500 * math.tan(0.1 + math.atan(270 / 500)), 240])
    assert edge[0] - 590 > 1.3 * (middle[0] - 320), "directions near the edge are farther apart in the image"


@pytest.mark.parametrize("seen", [0, -40])
def test_turn_that_is_seen_counts_where_it_contradicts_the_stated_one(seen):
    # The base of the robot turns against its head.
    room = _room()
    turn, contradicted = _turned(room[:480, 100:740].copy(), room[:480, 100 - seen : 740 - seen].copy(), 0.1)
    assert contradicted
    middle = np.array([[320.0, 240.0]])
    assert (0 if turn is None else moved(turn, middle)[0, 0] - 320) == pytest.approx(seen, abs=2.5)


def test_stated_turn_counts_where_the_image_agrees():
    room = _room()
    turn, contradicted = _turned(room[:480, 100:740].copy(), room[:480, 76:716].copy(), 0.05)
    assert not contradicted
    assert turn == pytest.approx(_view(0.05).turn_from(_view(0.0)))


def test_box_follows_the_turn_of_the_camera_at_the_edge():
    before, after = _view(0.0), _view(0.3)
    motion = BoxFilter(box(400, 100, 200, 80))
    turn = after.turn_from(before)
    assert turn is not None
    motion.shift(turn)
    x, _, width, height = motion.box
    left, right = (before.direction(each, 200)[0] - 0.3 for each in (360, 440))
    ends = [320 - 500 * math.tan(each) for each in (left, right)]
    assert (x, x + width) == pytest.approx(ends, abs=3)
    assert width > 1.2 * 80
    assert height > 200


def test_still_camera_does_not_turn():
    room, nobody = _room()[:480, :640], np.empty((0, 4))
    motion = CameraMotion()
    assert [motion.follow(room, nobody) for _ in range(3)] == [None] * 3
    assert motion.follow(np.zeros_like(room), nobody) is None, "a dark image shows nothing"
    assert motion.follow(room, nobody) is None
    assert motion.follow(room[:240, :320], nobody) is None, "another size is another recording"
