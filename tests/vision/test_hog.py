from __future__ import annotations

import cv2
import numpy as np
import pytest

from socialbot.core.errors import InstallationError
from socialbot.vision._hog import HogDetector, _apart
from socialbot.vision.detector import iou
from tests.vision.drawn import add_person, corridor


@pytest.fixture
def opencv_threads():
    before = cv2.getNumThreads()
    yield
    cv2.setNumThreads(before)


def best(found, box):
    """The IoU with ``box`` and the rank of the detection that overlaps it most."""
    overlaps = iou(np.array(box), found.boxes)
    return (float(overlaps.max()), int(overlaps.argmax())) if len(found) else (0.0, -1)


@pytest.mark.parametrize("height", [110, 330, *(pytest.param(height, marks=pytest.mark.slow) for height in (180, 250))])
def test_person_is_found_first_at_their_place(height):
    picture = corridor()
    box = add_person(picture, 300, 440 - height, height)
    found = HogDetector().detect(picture)
    overlap, rank = best(found, box)
    assert overlap > 0.6
    assert rank == 0


def test_empty_room_is_empty():
    found = HogDetector().detect(corridor())
    assert found.boxes.shape == (0, 4)
    assert found.boxes.dtype == found.scores.dtype == np.float64


@pytest.mark.parametrize(
    ("x", "y", "height"),
    [
        (320, 20, 520),
        (585, 100, 330),
        *(pytest.param(*each, marks=pytest.mark.slow) for each in ((320, 5, 470), (60, 100, 330))),
    ],
)
def test_large_or_cut_off_person_is_found(x, y, height):
    picture = corridor()
    left, top, width, tall = add_person(picture, x, y, height)
    right, bottom = min(left + width, 640), min(top + tall, 480)
    left = max(left, 0)
    found = HogDetector().detect(picture)
    overlap, _ = best(found, (left, top, right - left, bottom - top))
    assert overlap > 0.55
    assert (found.boxes[:, :2] >= 0).all()
    assert (found.boxes[:, :2] + found.boxes[:, 2:] <= (640, 480)).all()


def test_several_people():
    picture = corridor()
    boxes = [add_person(picture, 120, 180, 220), add_person(picture, 330, 220, 160), add_person(picture, 520, 200, 200)]
    found = HogDetector().detect(picture)
    assert sorted(best(found, box)[1] for box in boxes) == [0, 1, 2]


def test_threads_change_nothing(opencv_threads):
    picture = corridor(seed=4)
    add_person(picture, 200, 150, 260)
    add_person(picture, 420, 200, 180)
    results = []
    for threads in (1, 2, 4):
        cv2.setNumThreads(threads)
        detector = HogDetector(-0.2, threads=threads)
        results += [detector.detect(picture) for _ in range(2)]
    assert len(results[0]) > 5
    for result in results[1:]:
        assert result.boxes.tobytes() == results[0].boxes.tobytes()
        assert result.scores.tobytes() == results[0].scores.tobytes()


def test_threshold_may_change_between_images():
    picture = corridor()
    add_person(picture, 300, 190, 250)
    detector = HogDetector(-0.5)
    many = detector.detect(picture)
    detector.threshold = 1.0
    few = detector.detect(picture)
    assert 0 < len(few) < len(many)
    assert few.scores.min() >= 1.0 > many.scores.min()


def test_box_width_is_that_of_its_boxes():
    picture = corridor()
    add_person(picture, 300, 190, 250)
    detector = HogDetector()
    _, _, width, height = detector.detect(picture).boxes[0]
    assert detector.box_width_m == pytest.approx(1.70 * width / height, rel=0.02)


def test_large_image_is_made_smaller_and_the_boxes_larger():
    picture = corridor()
    box = add_person(picture, 300, 190, 250)
    small = HogDetector().detect(picture)
    large = HogDetector().detect(cv2.resize(picture, (1920, 1440), interpolation=cv2.INTER_CUBIC))
    overlap, rank = best(large, np.array(box) * 3)
    assert (overlap > 0.6, rank) == (True, 0)
    np.testing.assert_allclose(large.boxes[0] / 3, small.boxes[0], atol=15)


@pytest.mark.parametrize("shape", [(1, 1), (30, 500), (64, 31), (64, 32), (70, 40), (200, 33)])
def test_small_and_narrow_images_are_no_error(shape):
    assert len(HogDetector().detect(np.zeros((*shape, 3), np.uint8))) == 0


def test_opencv_5_has_no_hog(monkeypatch):
    monkeypatch.delattr(cv2, "HOGDescriptor")
    with pytest.raises(InstallationError, match=r"opencv-python-headless.*<5"):
        HogDetector()


def test_small_people_are_found_along_the_horizon():
    picture = corridor()
    box = add_person(picture, 300, 250, 70)
    detector = HogDetector()
    overlap, rank = best(detector.detect(picture), box)
    assert (overlap > 0.5, rank) == (True, 0)
    detector.horizon = 0.1
    assert best(detector.detect(picture), box)[0] < 0.5


EYES = 1.62 / 1.70
"""The height of the camera, in heights of a person."""


def on_floor(**settings) -> HogDetector:
    """A detector that knows its camera, which looks along the corridor."""
    detector = HogDetector(**settings)
    detector.camera_height = EYES
    return detector


def add_standing(picture, x, h):
    """Draws somebody ``h`` pixels tall who stands on the floor, when the horizon is in the middle; gives the box."""
    return add_person(picture, x, picture.shape[0] / 2 - h * (1 - EYES), h)


@pytest.mark.parametrize("height", [70, 110, 180, 230])
def test_person_on_the_floor_is_found_first_at_their_place(height):
    picture = corridor()
    box = add_standing(picture, 300, height)
    overlap, rank = best(on_floor().detect(picture), box)
    assert overlap > 0.55
    assert rank == 0


@pytest.mark.parametrize(("top", "height"), [(20, 180), (290, 180), (60, 110)])
def test_people_off_the_floor_are_not_found(top, height):
    picture = corridor()
    box = add_person(picture, 300, top, height)
    assert best(HogDetector().detect(picture), box)[0] > 0.55
    assert best(on_floor().detect(picture), box)[0] < 0.3


def test_from_a_low_camera_heads_are_high():
    picture = corridor()
    box = add_person(picture, 300, 100, 180)  # the horizon is at their ankles
    detector = on_floor()
    assert best(detector.detect(picture), box)[0] < 0.3
    detector.camera_height = 0.22
    assert best(detector.detect(picture), box)[0] > 0.55


@pytest.mark.parametrize("height", [430, 480, 540])
def test_near_person_is_found_without_legs(height):
    picture = corridor()
    left, top, width, _ = add_standing(picture, 320, height)
    body = (left, top, width, 480 - top)
    overlap, rank = best(on_floor().detect(picture), body)
    assert overlap > 0.5
    assert rank == 0


def test_parts_of_a_near_person_are_suppressed():
    boxes = np.array([[100.0, 100, 200, 380], [150, 200, 60, 200], [270, 200, 65, 200], [270, 200, 55, 200]])
    scores, nobody = np.array([1.0, 0.9, 0.8, 0.7]), np.zeros(4, bool)
    assert _apart(boxes, scores, np.array([True, False, False, False])).tolist() == [True, False, True, False]
    assert _apart(boxes, scores, nobody).all()


def test_parts_are_suppressed_unless_better_or_higher():
    near = [100.0, 100, 200, 380]
    boxes = np.array([[120.0, 150, 50, 100], [180, 150, 50, 100], [240, 90, 50, 100], near])
    scores, last = np.array([1.3, 1.2, 1.1, 1.0]), np.array([False, False, False, True])
    assert _apart(boxes, scores, last).tolist() == [True, False, True, True]


def test_on_the_floor_threads_change_nothing_either():
    picture = corridor(seed=4)
    add_standing(picture, 200, 200)
    add_standing(picture, 420, 500)
    one, two = (on_floor(threshold=-0.2, threads=threads).detect(picture) for threads in (1, 2))
    assert len(one) >= 2
    assert one.boxes.tobytes() == two.boxes.tobytes()
    assert one.scores.tobytes() == two.scores.tobytes()


@pytest.mark.parametrize("shape", [(1, 1), (30, 500), (64, 31), (64, 32), (200, 33), (480, 640)])
@pytest.mark.parametrize("horizon", [0.0, 0.5, 1.0])
def test_with_any_horizon_small_and_empty_images_are_no_error(shape, horizon):
    detector = on_floor()
    detector.horizon = horizon
    assert len(detector.detect(np.zeros((*shape, 3), np.uint8))) == 0
