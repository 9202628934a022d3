from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.vision.network import LAYOUTS, LayoutMismatch, ModelOutput, TensorInfo

WIDTH, HEIGHT = 96, 64
CELLS = [
    (stride, column, row)
    for stride in (8, 16, 32)
    for row in range(HEIGHT // stride)
    for column in range(WIDTH // stride)
]

chosen = st.sets(st.integers(0, len(CELLS) - 1), max_size=6).map(sorted)
number = st.floats(0.5, 60)
score = st.floats(0.01, 1)
boxes = st.lists(st.tuples(number, number, number, number, score), max_size=6)


def answers(*arrays: np.ndarray, names: str = "", **changes) -> ModelOutput:
    words = names.split() or [f"out{index}" for index in range(len(arrays))]
    ports = [TensorInfo(name, array.shape, "") for name, array in zip(words, arrays, strict=True)]
    return ModelOutput(arrays, ports, WIDTH, HEIGHT, **changes)


def read(layout: str, *arrays: np.ndarray, **changes) -> list[tuple[float, ...]]:
    """Boxes with scores as the layout reads them: x, y, w, h, score."""
    found, scores = LAYOUTS[layout].read(answers(*arrays, **changes))
    assert found.dtype == scores.dtype == np.float64
    return [(*box, value) for box, value in zip(found.tolist(), scores.tolist(), strict=True)]


def assert_same(found, expected):
    assert len(found) == len(expected)
    np.testing.assert_allclose(np.array(found).reshape(-1, 5), np.array(expected).reshape(-1, 5), rtol=1e-4, atol=1e-3)


@settings(max_examples=40, deadline=None)
@given(
    st.data(),
    chosen,
    st.sampled_from([1, 3, 80]),
    st.sampled_from([8, 11]),
    st.sampled_from(["nanodet", "nanodet-plus"]),
)
def test_nanodet(data, cells, classes, bins, layout):
    person = data.draw(st.integers(0, classes - 1))
    table = np.full((1, len(CELLS), classes + 4 * bins), 0.0, np.float32)
    expected = []
    for index in cells:
        stride, column, row = CELLS[index]
        edges = data.draw(st.lists(st.floats(0.25, bins - 1.25), min_size=4, max_size=4))
        value = data.draw(score)
        table[0, index, person] = value
        logits = np.full((4, bins), -40.0)
        for edge, distance in enumerate(edges):
            low = math.floor(distance)
            logits[edge, low : low + 2] = np.log([1 - distance + low + 1e-9, distance - low + 1e-9])
        table[0, index, classes:] = logits.ravel()
        middle = 0.5 if layout == "nanodet" else 0.0
        left, top, right, bottom = (stride * distance for distance in edges)
        x, y = (column + middle) * stride - left, (row + middle) * stride - top
        expected.append((x, y, left + right, top + bottom, value))
    assert_same(read(layout, table, person=person, classes=classes, threshold=0.005), expected)


@settings(max_examples=40, deadline=None)
@given(st.data(), chosen, st.integers(1, 9))
def test_yolox(data, cells, classes):
    person = data.draw(st.integers(0, classes - 1))
    table = np.zeros((1, len(CELLS), 5 + classes), np.float32)
    expected = []
    for index in cells:
        stride, column, row = CELLS[index]
        x, y, w, h, value = data.draw(st.tuples(number, number, number, number, score))
        table[0, index, :5] = (
            (x + w / 2) / stride - column, (y + h / 2) / stride - row, math.log(w / stride), math.log(h / stride), value
        )  # fmt: skip
        table[0, index, 5 + person] = 1
        expected.append((x, y, w, h, value))
    assert_same(read("yolox", table, person=person, threshold=0.005), expected)


@settings(max_examples=40, deadline=None)
@given(boxes, st.integers(0, 3))
def test_yolov5_and_yolov8(people, person):
    v5, v8 = np.zeros((1, 40, 9), np.float32), np.zeros((1, 8, 40), np.float32)
    for index, (x, y, w, h, value) in enumerate(people):
        v5[0, index, :5] = (x + w / 2, y + h / 2, w, h, value)
        v5[0, index, 5 + person] = 0.5
        v8[0, :4, index] = (x + w / 2, y + h / 2, w, h)
        v8[0, 4 + person, index] = value / 2
    expected = [(*box, value / 2) for *box, value in people]
    assert_same(read("yolov5", v5, person=person, threshold=0.001), expected)
    assert_same(read("yolov8", v8, person=person, threshold=0.001), expected)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(number, number, number, number, score, st.integers(0, 2)), max_size=6), st.booleans())
def test_detections_in_one_output_or_in_several(rows, batch):
    corners = np.array([(x, y, x + w, y + h) for x, y, w, h, _, _ in rows], np.float32).reshape(-1, 4)
    scores = np.array([row[4] for row in rows], np.float32)
    labels = np.array([row[5] for row in rows], np.int64)
    expected = [row[:5] for row in rows if row[5] == 1]
    forms = [
        (np.hstack([corners, scores[:, None], labels[:, None]]).astype(np.float32),),
        (np.hstack([corners, scores[:, None]]), labels),
        (labels, corners, scores),
        (corners, scores, labels),
    ]
    for form in forms:
        arrays = [array[None] for array in form] if batch else form
        assert_same(read("detections", *arrays, person=1), expected)


def test_labels_may_be_known_by_their_name():
    corners, scores = np.array([[1, 2, 4, 6]], np.float32), np.array([0.5], np.float32)
    labels = np.array([7], np.float32)
    assert read("detections", corners, labels, scores, names="boxes classes confidence", person=7) == [
        (1, 2, 3, 4, 0.5)
    ]


@pytest.mark.parametrize("layout", ["nanodet", "nanodet-plus", "yolox", "yolov5", "yolov8"])
def test_only_scores_from_the_threshold_on_are_read(layout):
    count = len(CELLS)
    table = np.zeros((1, count, 80 + 44 if "nano" in layout else 85), np.float32)
    table[0, :, 0 if "nano" in layout else 4] = np.linspace(0, 1, count)
    table[0, :, 5] = 1
    if layout == "yolov8":
        table = np.zeros((1, 84, count), np.float32)
        table[0, 4] = np.linspace(0, 1, count)
    all_of_them = read(layout, table)
    some = read(layout, table, threshold=0.6)
    assert len(all_of_them) == count
    assert some == [row for row in all_of_them if row[4] >= 0.6]
    assert 0 < len(some) < count


def table(*shape: int) -> np.ndarray:
    return np.zeros(shape, np.float32)


@pytest.mark.parametrize(
    ("layout", "arrays", "expected"),
    [
        ("nanodet", (table(1, len(CELLS) - 1, 112),), "cells of 96 x 64 pixels"),
        ("nanodet", (table(1, len(CELLS), 113),), "80 classes"),
        ("nanodet", (table(1, len(CELLS), 84),), "bins"),
        ("nanodet", (table(1, 8, 80), table(1, 8, 32)), "one output"),
        ("yolox", (table(1, len(CELLS) + 3, 85),), "cells of 96 x 64 pixels"),
        ("yolox", (table(1, len(CELLS), 5),), "5 . classes"),
        ("yolov5", (table(1, 84, 8400),), "n the larger"),
        ("yolov5", (table(8400, 85),), "one output 1 x n"),
        ("yolov8", (table(1, 8400, 84),), "n the larger"),
        ("yolov8", (table(1, 4, 8400),), "classes"),
        ("detections", (table(7, 7),), "n x 6"),
        ("detections", (table(7, 4), table(7)), "boxes n x 4, scores n and labels n"),
        ("detections", (table(7, 4), table(7), table(7)), "labels"),
        ("detections", (table(7, 4), table(6), np.zeros(6, np.int64)), "labels n"),
        ("detections", (table(7, 5),), "labels"),
    ],
)
def test_error_names_the_expected_layout(layout, arrays, expected):
    with pytest.raises(LayoutMismatch, match=expected):
        LAYOUTS[layout].read(answers(*arrays))


@pytest.mark.parametrize(
    ("layout", "shape"), [("yolov5", (1, 40, 9)), ("yolov8", (1, 8, 40)), ("yolox", (1, len(CELLS), 9))]
)
def test_people_have_to_be_among_the_classes(layout, shape):
    LAYOUTS[layout].read(answers(table(*shape), person=3))
    with pytest.raises(LayoutMismatch):
        LAYOUTS[layout].read(answers(table(*shape), person=4))
