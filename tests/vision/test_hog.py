from __future__ import annotations

import cv2
import numpy as np
import pytest

from socialbot.errors import InstallationError
from socialbot.vision.boxes import iou
from socialbot.vision.hog import HogDetector
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


@pytest.mark.parametrize("height", [110, 180, 250, 330])
def test_somebody_is_found_first_and_where_they_are(height):
    picture = corridor()
    box = add_person(picture, 300, 440 - height, height)
    found = HogDetector().detect(picture)
    overlap, rank = best(found, box)
    assert overlap > 0.6
    assert rank == 0


def test_an_empty_room_is_empty():
    found = HogDetector().detect(corridor())
    assert found.boxes.shape == (0, 4)
    assert found.boxes.dtype == found.scores.dtype == np.float64


@pytest.mark.parametrize(("x", "y", "height"), [(320, 5, 470), (320, 20, 520), (60, 100, 330), (585, 100, 330)])
def test_somebody_who_fills_the_picture_or_is_cut_off_by_it_is_found(x, y, height):
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


def test_threshold_may_change_between_pictures():
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


def test_a_large_picture_is_made_smaller_and_the_boxes_larger():
    picture = corridor()
    box = add_person(picture, 300, 190, 250)
    small = HogDetector().detect(picture)
    large = HogDetector().detect(cv2.resize(picture, (1920, 1440), interpolation=cv2.INTER_CUBIC))
    overlap, rank = best(large, np.array(box) * 3)
    assert (overlap > 0.6, rank) == (True, 0)
    np.testing.assert_allclose(large.boxes[0] / 3, small.boxes[0], atol=15)


@pytest.mark.parametrize("shape", [(1, 1), (30, 500), (64, 31), (64, 32), (70, 40), (200, 33)])
def test_small_and_narrow_pictures_are_no_error(shape):
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
