from __future__ import annotations

import numpy as np
import pytest

from socialbot.core.messages import PersonDetection, PersonDetections
from socialbot.vision.annotate import draw
from socialbot.vision.metrics.truth import TruthPerson

GREY = np.full((480, 640, 3), 128, np.uint8)


def detections(*persons: PersonDetection) -> PersonDetections:
    return PersonDetections(stamp=0, frame_id="c", width=640, height=480, persons=persons)


def person(
    x=200.0, y=100.0, w=100.0, h=250.0, *, track="", distance: float | None = 3.4, std: float | None = None, unseen=0.0
) -> PersonDetection:
    return PersonDetection(
        x=x, y=y, w=w, h=h, score=0.87, track_id=track, distance_m=distance, distance_std_m=std, unseen_s=unseen
    )


def touched(picture: np.ndarray) -> np.ndarray:
    """Return the pixels that are no longer grey: (height, width), bool."""
    return (picture != 128).any(axis=2)


def test_without_anything_it_is_an_equal_copy():
    result = draw(GREY, None)
    np.testing.assert_array_equal(result, GREY)
    assert not np.shares_memory(result, GREY)
    np.testing.assert_array_equal(draw(GREY, detections()), GREY)


def test_picture_given_is_left_alone():
    before = GREY.copy()
    draw(before, detections(person()), (), ["hello"])
    np.testing.assert_array_equal(before, GREY)


def test_box_and_a_label_above_it():
    marks = touched(draw(GREY, detections(person())))
    assert marks[100:350, 200].all()
    assert marks[100:350, 300].all()
    assert marks[350, 200:300].all()
    assert not marks[120:340, 210:290].any()
    assert marks[85:98, 205:240].mean() > 0.9
    assert not marks[:75].any()


@pytest.mark.parametrize("box", [(-20, -30, 100, 300), (600, 0, 80, 500), (0, 0, 640, 480), (630, 470, 5, 5)])
def test_label_stays_in_the_image(box):
    plain = touched(draw(GREY, detections(person(*box))))
    labelled = touched(draw(GREY, detections(person(*box, track="a-long-name"))))
    assert labelled.sum() > plain.sum()


def test_label_shows_track_and_distance():
    pictures = [
        draw(GREY, detections(item))
        for item in (
            person(),
            person(distance=4.4),
            person(distance=None),
            person(track="t1"),
            person(track="t2"),
            person(std=0.3),
            person(std=0.4),
        )
    ]
    for index, one in enumerate(pictures):
        for other in pictures[index + 1 :]:
            assert (one != other).any()


def test_track_keeps_its_colour_whatever_its_place():
    first = draw(GREY, detections(person(track="t7")))[200, 200]
    second = draw(GREY, detections(person(400, track="t1"), person(track="t7")))[200, 200]
    assert first.tolist() == second.tolist()


def test_predictions_are_dashed_in_the_same_colour():
    seen, predicted = (draw(GREY, detections(person(track="t1", unseen=unseen))) for unseen in (0.0, 0.2))
    column = touched(predicted)[100:350, 200]
    assert 0.3 < column.mean() < 0.8
    assert touched(seen)[100:350, 200].all()
    assert (predicted[100:350, 200][column] == seen[225, 200]).all()


def test_truth_is_dashed_and_white():
    truth = TruthPerson(id="p", x=200, y=100, w=100, h=250, distance_m=3, visible=1)
    result = draw(GREY, None, [truth])
    column = touched(result)[100:350, 200]
    assert 0.3 < column.mean() < 0.7
    assert (result[touched(result)] == 255).all()


def test_caption_darkens_the_bottom_as_far_as_it_has_lines():
    one, three = (touched(draw(GREY, None, (), ["hello"] * count)) for count in (1, 3))
    assert one[-25:].all()
    assert not one[:440].any()
    assert three[-60:].all()
    assert not three[:400].any()


def test_long_and_foreign_lines_fit():
    plain = draw(GREY, None, (), ["Gruss an Rene"])
    np.testing.assert_array_equal(draw(GREY, None, (), ["Gruß an René"]), plain)
    long = draw(GREY, None, (), ["word " * 100])
    assert (long[-25:, -8:] < 80).all()
    draw(GREY, None, (), ["日本", ""])


@pytest.mark.parametrize("shape", [(1, 1), (20, 30), (1080, 1920)])
def test_any_size(shape):
    picture = np.zeros((*shape, 3), np.uint8)
    assert draw(picture, detections(person()), (), ["a", "b", "c", "d"]).shape == picture.shape
