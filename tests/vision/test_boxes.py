from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.vision.detector import LEAST_FUSED, clip, iou, same_head, select, suppress

coordinate = st.integers(0, 60)
box = st.tuples(coordinate, coordinate, st.integers(1, 60), st.integers(1, 60))
scored = st.lists(st.tuples(box, st.sampled_from([0.3, 0.5, 0.5, 0.9])), max_size=12)


def counted_iou(a, b):
    """Intersection over union by counting pixels."""
    grid = np.zeros((2, 130, 130), bool)
    for layer, (x, y, w, h) in zip(grid, (a, b), strict=True):
        layer[y : y + h, x : x + w] = True
    return (grid[0] & grid[1]).sum() / (grid[0] | grid[1]).sum()


@settings(max_examples=50, deadline=None)
@given(box, st.lists(box, min_size=1, max_size=5))
def test_iou_is_the_share_of_common_pixels(one, many):
    result = iou(np.array(one, float), np.array(many, float))
    np.testing.assert_allclose(result, [counted_iou(one, other) for other in many])


def test_iou_of_empty_boxes_is_0():
    assert iou(np.zeros(4), np.zeros((2, 4))).tolist() == [0.0, 0.0]


@settings(max_examples=60, deadline=None)
@given(scored, st.randoms(use_true_random=False), st.sampled_from([0.0, 0.3, 0.6]))
def test_suppression_keeps_the_best_box_in_any_order(items, random, overlap):
    boxes = np.array([item[0] for item in items], float).reshape(-1, 4)
    scores = np.array([item[1] for item in items], float)
    kept = suppress(boxes, scores, overlap)
    assert list(scores[kept]) == sorted(scores[kept], reverse=True)
    for place, index in enumerate(kept):
        assert (iou(boxes[index], boxes[kept[:place]]) <= overlap).all()
    for index in set(range(len(boxes))) - set(kept.tolist()):
        better = kept[scores[kept] >= scores[index]]
        assert (iou(boxes[index], boxes[better]) > overlap).any()
    order = list(range(len(boxes)))
    random.shuffle(order)
    again = suppress(boxes[order], scores[order], overlap)
    np.testing.assert_array_equal(boxes[order][again], boxes[kept])


PERSON = (100, 100, 60, 180)


@pytest.mark.parametrize(
    ("other", "same"),
    [
        pytest.param((105, 102, 50, 80), True, id="upper body"),
        pytest.param((95, 98, 110, 184), True, id="with a neighbour"),
        pytest.param((130, 100, 90, 180), False, id="mostly the neighbour"),
        pytest.param((105, 170, 40, 110), False, id="child before somebody"),
        pytest.param((105, 200, 50, 80), False, id="legs"),
        pytest.param((110, 105, 20, 60), False, id="somebody far behind"),
        pytest.param((300, 100, 60, 180), False, id="elsewhere"),
        pytest.param((100, 100, 0, 0), False, id="empty"),
    ],
)
def test_boxes_with_one_head(other, same):
    one, two = np.array(PERSON, float), np.array(other, float)
    assert same_head(one, two[None], 0.65).tolist() == same_head(two, one[None], 0.65).tolist() == [same]


def test_of_boxes_with_one_head_the_better_stays():
    part, group = (105, 102, 50, 80), (95, 98, 110, 184)
    boxes = np.array([PERSON, part, group], float)
    assert suppress(boxes, np.array([0.9, 0.5, 0.5]), 0.6, 0.65).tolist() == [0]
    assert sorted(suppress(boxes, np.array([0.9, 0.5, 0.5]), 0.6).tolist()) == [0, 1, 2]
    assert suppress(boxes, np.array([0.5, 0.4, 0.9]), 0.6, 0.65).tolist() == [2]


def test_better_part_does_not_drive_out_the_whole():
    boxes = np.array([PERSON, (105, 102, 50, 80)], float)
    assert suppress(boxes, np.array([0.5, 0.9]), 0.6, 0.65).tolist() == [1, 0]


@settings(max_examples=60, deadline=None)
@given(scored)
def test_suppression_does_not_depend_on_lower_scores(items):
    boxes = np.array([item[0] for item in items], float).reshape(-1, 4)
    scores = np.array([item[1] for item in items], float)
    good = np.flatnonzero(scores >= 0.5)
    kept = suppress(boxes, scores, 0.5, 0.65)
    np.testing.assert_array_equal(good[suppress(boxes[good], scores[good], 0.5, 0.65)], kept[scores[kept] >= 0.5])


def test_equal_scores_are_ranked_from_left_to_right():
    boxes = np.array([[50, 0, 20, 20], [40, 5, 20, 20], [40, 0, 20, 20]], float)
    assert suppress(boxes, np.ones(3), 1.0).tolist() == [2, 1, 0]


def test_clip():
    boxes = np.array([[-10, -5, 30, 20], [90, 40, 30, 20], [200, 200, 5, 5], [10, 10, 5, 5]], float)
    assert clip(boxes, 100, 50).tolist() == [[0, 0, 20, 15], [90, 40, 10, 10], [100, 50, 0, 0], [10, 10, 5, 5]]


def test_select_suppresses_before_it_clips():
    boxes = np.array([[300, 0, 10, 10], [-40, 0, 50, 100], [-10, 0, 20, 100], [50, 0, 10, 10]], float)
    found = select(boxes, np.array([4.0, 3, 2, 1]), width=100, height=100, overlap=0.5)
    # The two at the left edge look alike only after they are clipped.
    assert found.boxes.tolist() == [[0, 0, 10, 100], [0, 0, 10, 100], [50, 0, 10, 10]]
    assert found.scores.tolist() == [3, 2, 1]


def test_select_of_nothing():
    found = select(np.empty((0, 4)), np.empty(0), width=10, height=10, overlap=0.5)
    assert found.boxes.shape == (0, 4)
    assert len(found) == 0


def test_boxes_of_one_person_are_averaged_by_squared_scores():
    boxes = np.array([[100.0, 100, 50, 200], [104, 96, 50, 204], [300, 100, 50, 200]])
    scores = np.array([0.8, 0.4, 0.6])
    found = select(boxes, scores, width=640, height=480, overlap=0.5, fused=0.6)
    assert found.boxes == pytest.approx(np.array([[100.8, 99.2, 50, 200.8], [300, 100, 50, 200]]))
    assert found.scores.tolist() == [0.8, 0.6]


@given(scored)
def test_averages_do_not_depend_on_boxes_below_the_least_score(found):
    boxes = np.array([one for one, _ in found], np.float64).reshape(-1, 4)
    scores = np.array([score for _, score in found]) - 0.1
    how = {"width": 640, "height": 480, "overlap": 0.5, "fused": 0.6}
    strong = scores >= LEAST_FUSED
    every, fewer = select(boxes, scores, **how), select(boxes[strong], scores[strong], **how)
    assert every.boxes[every.scores >= LEAST_FUSED] == pytest.approx(fewer.boxes)
