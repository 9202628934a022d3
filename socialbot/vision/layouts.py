"""Layouts: how the answers of a network are to be read as boxes and scores of people."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from socialbot.vision.network import NetworkPort

__all__ = ["LAYOUTS", "Answers", "Layout", "Misfit"]

_STRIDES = (8, 16, 32, 64)
"""Pixels of the picture between two cells, level by level; many networks have no fourth level."""


class Misfit(Exception):  # noqa: N818
    """Answers that are not of a layout; says what the layout expects."""


@dataclass(frozen=True)
class Answers:
    """What a network said to a picture of ``width`` x ``height`` pixels, an array for each of its ``ports``.

    It knows ``classes`` kinds of things, of which people are number ``person``. Only scores from ``threshold`` on
    are asked for.
    """

    arrays: Sequence[np.ndarray]
    ports: Sequence[NetworkPort]
    width: int
    height: int
    person: int = 0
    classes: int = 80
    threshold: float = 0.0

    def table(self, expected: str) -> np.ndarray:
        """The only answer, without the dimension of the batch. Raises Misfit with ``expected``."""
        if len(self.arrays) != 1 or self.arrays[0].ndim != 3 or self.arrays[0].shape[0] != 1:
            raise Misfit(expected)
        return self.arrays[0][0]

    def cells(self, count: int) -> np.ndarray | None:
        """Column, row and stride (pixels) of ``count`` cells, shape (count, 3); None if no grids have so many."""
        rows: list[np.ndarray] = []
        for stride in _STRIDES:
            across, down = math.ceil(self.width / stride), math.ceil(self.height / stride)
            row, column = np.divmod(np.arange(across * down), across)
            rows.append(np.stack([column, row, np.full_like(row, stride)], axis=1))
            if sum(map(len, rows)) == count:
                return np.vstack(rows)
        return None


Found = tuple[np.ndarray, np.ndarray]
"""Boxes, (n, 4) as x, y, w, h in pixels of the network's picture, and scores, (n,), both float64."""


@dataclass(frozen=True)
class Layout:
    """How answers are read, and how networks with such answers usually want their pictures.

    ``channels`` is the order of colours, ``pixels`` what a pixel's 0 to 255 become; the picture stands in the middle
    of the network's or, unless ``centred``, at its upper left, and ``fill`` is the grey beside it. ``read`` raises
    Misfit when the answers are of another layout.
    """

    name: str
    read: Callable[[Answers], Found]
    channels: str
    pixels: str
    centred: bool
    fill: int


def _nanodet(offset: float, answers: Answers) -> Found:
    """Rows of cells: a score for each class, then for each edge of the box the logits of distances in strides."""
    expected = (
        f"one output 1 x n x ({answers.classes} classes + 4 x bins), class {answers.person} among them, n the cells of "
        f"{answers.width} x {answers.height} pixels with strides 8, 16, 32 and perhaps 64"
    )
    table = answers.table(expected)
    bins, rest = divmod(table.shape[1] - answers.classes, 4)
    cells = answers.cells(len(table))
    if cells is None or rest or bins < 2 or answers.person >= answers.classes:
        raise Misfit(expected)
    scores = table[:, answers.person]
    good = scores >= answers.threshold
    logits = table[good, answers.classes :].reshape(-1, 4, bins).astype(np.float64)
    shares = np.exp(logits - logits.max(axis=2, keepdims=True))
    column, row, stride = cells[good].astype(np.float64).T
    distances = shares @ np.arange(bins) / shares.sum(axis=2) * stride[:, None]
    centre = np.stack([column + offset, row + offset], axis=1) * stride[:, None]
    return _corners(centre - distances[:, :2], centre + distances[:, 2:]), scores[good].astype(np.float64)


def _yolox(answers: Answers) -> Found:
    """Rows of cells: centre in strides from the cell, logarithms of width and height in strides, then as in YOLOv5."""
    expected = (
        f"one output 1 x n x (5 + classes), class {answers.person} among them, n the cells of {answers.width} x "
        f"{answers.height} pixels with strides 8, 16 and 32"
    )
    table = answers.table(expected)
    cells = answers.cells(len(table))
    if cells is None:
        raise Misfit(expected)
    rows, scores, good = _objects(table, answers, expected)
    place, stride = cells[good, :2].astype(np.float64), cells[good, 2:].astype(np.float64)
    return _centred((rows[:, :2] + place) * stride, np.exp(rows[:, 2:4]) * stride), scores


def _yolov5(answers: Answers) -> Found:
    """Rows: centre, width and height in pixels, the score of a thing, the score of each class."""
    expected = f"one output 1 x n x (5 + classes), n the larger, class {answers.person} among them"
    rows, scores, _ = _objects(answers.table(expected), answers, expected)
    return _centred(rows[:, :2], rows[:, 2:4]), scores


def _objects(table: np.ndarray, answers: Answers, expected: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The rows of people, their scores, and which rows they are."""
    if answers.person >= table.shape[1] - 5 or table.shape[1] >= len(table):
        raise Misfit(expected)
    scores = table[:, 4].astype(np.float64) * table[:, 5 + answers.person]
    good = scores >= answers.threshold
    return table[good].astype(np.float64), scores[good], good


def _yolov8(answers: Answers) -> Found:
    """Columns: centre, width and height in pixels, the score of each class."""
    expected = f"one output 1 x (4 + classes) x n, n the larger, class {answers.person} among them"
    table = answers.table(expected)
    if answers.person >= len(table) - 4 or len(table) >= table.shape[1]:
        raise Misfit(expected)
    scores = table[4 + answers.person]
    good = scores >= answers.threshold
    rows = table[:4, good].astype(np.float64)
    return _centred(rows[:2].T, rows[2:].T), scores[good].astype(np.float64)


def _detections(answers: Answers) -> Found:
    """Left, top, right, bottom in pixels, with score and class, in one output or in several."""
    rows = _detection_rows(answers)
    good = (rows[:, 5] == answers.person) & (rows[:, 4] >= answers.threshold)
    return _corners(rows[good, :2], rows[good, 2:4]), rows[good, 4]


def _detection_rows(answers: Answers) -> np.ndarray:
    """Shape (n, 6): left, top, right, bottom, score, class."""
    expected = (
        "n x 6 (left, top, right, bottom, score, class), or boxes n x 5 (with scores) and labels n, or boxes n x 4, "
        "scores n and labels n; each perhaps with a batch of 1 before it"
    )
    # Where the boxes have a batch, all have.
    batch = any(array.ndim == 3 for array in answers.arrays)
    tables = [array[0] if batch and len(array) == 1 else array for array in answers.arrays]
    wide = [table for table in tables if table.ndim == 2 and table.shape[1] in (4, 5, 6)]
    flat = [(port, table) for port, table in zip(answers.ports, tables, strict=True) if table.ndim == 1]
    if len(wide) != 1 or any(len(table) != len(wide[0]) for _, table in flat):
        raise Misfit(expected)
    labels = [_is_label(port, table) for port, table in flat]
    if (wide[0].shape[1], labels.count(False), labels.count(True)) not in {(6, 0, 0), (5, 0, 1), (4, 1, 1)}:
        raise Misfit(expected)
    # Sorting puts the scores before the labels.
    rest = [table[:, None] for _, (_, table) in sorted(zip(labels, flat, strict=True), key=lambda pair: pair[0])]
    return np.hstack([wide[0], *rest]).astype(np.float64)


def _is_label(port: NetworkPort, table: np.ndarray) -> bool:
    """Whether an answer of one number a box is the classes: whole numbers, or so called."""
    return table.dtype.kind in "iu" or any(word in port.name.lower() for word in ("label", "class"))


def _corners(corner: np.ndarray, opposite: np.ndarray) -> np.ndarray:
    return np.hstack([corner, opposite - corner])


def _centred(centre: np.ndarray, size: np.ndarray) -> np.ndarray:
    return np.hstack([centre - size / 2, size])


LAYOUTS: Mapping[str, Layout] = {
    layout.name: layout
    for layout in (
        Layout("nanodet", lambda answers: _nanodet(0.5, answers), "bgr", "imagenet", True, 0),
        Layout("nanodet-plus", lambda answers: _nanodet(0.0, answers), "bgr", "imagenet", True, 0),
        Layout("yolox", _yolox, "bgr", "0-255", False, 114),
        Layout("yolov5", _yolov5, "rgb", "0-1", True, 114),
        Layout("yolov8", _yolov8, "rgb", "0-1", True, 114),
        Layout("detections", _detections, "rgb", "0-1", False, 0),
    )
}
"""The layouts by name."""
