"""The detector interface, and boxes: overlap and non-maximum suppression."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

__all__ = ["Detections", "Detector", "clip", "iou", "same_head", "select", "suppress"]


_HEADS_ALIKE = 0.15
"""Tops that are this near, as a share of the smaller height, may be those of one head ..."""
_NARROWER = 0.4
"""... if the smaller box has at least this share of the larger one's width; far people behind near ones have less."""
_TALLER = 4 / 3
"""A box that is so many times as high as a better one may be the whole body, and that one the upper half."""


def clip(boxes: np.ndarray, width: int, height: int) -> np.ndarray:
    """``boxes``, shape (n, 4) as x, y, w, h in pixels, without what lies outside the picture.

    A box wholly outside keeps a width or height of 0.
    """
    corner = np.clip(boxes[:, :2], 0, (width, height))
    opposite = np.clip(boxes[:, :2] + boxes[:, 2:], 0, (width, height))
    return np.hstack([corner, opposite - corner])


def iou(one: np.ndarray, many: np.ndarray) -> np.ndarray:
    """Intersection over union of the box ``one``, shape (4,), with ``many``, (n, 4): shape (n,), 0 to 1."""
    shared = _shared(one, many)
    return _ratio(shared, one[2] * one[3] + many[:, 2] * many[:, 3] - shared)


def same_head(one: np.ndarray, many: np.ndarray, within: float) -> np.ndarray:
    """Whether ``one``, shape (4,), and each of ``many``, (n, 4), may be boxes of one person: bool, shape (n,).

    They are when their tops are alike, their widths do not differ much, and more than the share ``within`` of the
    smaller lies in the larger: the upper body and the whole, or somebody alone and together with who stands beside
    them. A child before a grown person has a top of their own, and somebody far behind is much narrower.
    """
    share = _ratio(_shared(one, many), np.minimum(one[2] * one[3], many[:, 2] * many[:, 3]))
    alike = np.abs(one[1] - many[:, 1]) < _HEADS_ALIKE * np.minimum(one[3], many[:, 3])
    widths = np.minimum(one[2], many[:, 2]) >= _NARROWER * np.maximum(one[2], many[:, 2])
    return (share > within) & alike & widths


def suppress(boxes: np.ndarray, scores: np.ndarray, overlap: float, within: float = 1.0) -> np.ndarray:
    """Greedy non-maximum suppression: the indices of the boxes to keep, best first.

    ``boxes`` is (n, 4), ``scores`` (n,). A box goes when its IoU with a better one that stays is above
    ``overlap``, or when the two have the `same_head` by ``within`` (of 1 none have) and it is not much the
    taller. Equal scores are ranked by x, y, w and h, so the order of the input does not matter.
    """
    boxes = np.asarray(boxes, dtype=np.float64).reshape(-1, 4)
    waiting = np.lexsort((*boxes.T[::-1], -np.asarray(scores)))
    kept: list[int] = []
    while waiting.size:
        best, waiting = waiting[0], waiting[1:]
        kept.append(int(best))
        others = boxes[waiting]
        gone = iou(boxes[best], others) > overlap
        if within < 1:
            gone |= same_head(boxes[best], others, within) & (others[:, 3] < _TALLER * boxes[best, 3])
        waiting = waiting[~gone]
    return np.array(kept, dtype=np.intp)


def _shared(one: np.ndarray, many: np.ndarray) -> np.ndarray:
    """The area that the box ``one``, shape (4,), shares with each of ``many``, (n, 4): shape (n,)."""
    corner = np.maximum(one[:2], many[:, :2])
    opposite = np.minimum(one[:2] + one[2:], many[:, :2] + many[:, 2:])
    return np.prod(np.clip(opposite - corner, 0, None), axis=1)


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.divide(part, whole, out=np.zeros(len(part)), where=whole > 0)


@dataclass(frozen=True, eq=False)
class Detections:
    """The people in one picture, best first.

    ``boxes`` is float64 of shape (n, 4): x, y, w, h in pixels, clipped to the picture; ``scores`` is
    float64 of shape (n,), the higher the surer, in the detector's own scale.
    """

    boxes: np.ndarray
    scores: np.ndarray

    @classmethod
    def none(cls) -> Detections:
        """Nobody."""
        return cls(np.empty((0, 4)), np.empty(0))

    def __len__(self) -> int:
        return len(self.scores)


class Detector(Protocol):
    """Anything that finds people; the same picture gives the same result, whatever the number of threads."""

    threshold: float
    """The least score of a detection; may change between two pictures."""
    box_width_m: float
    """How wide its boxes are round somebody of 1.70 m seen from the front, m."""
    horizon: float
    """Where the horizon runs, as a share of the picture's height: 0 top, 1 bottom; may change between two pictures.

    Far people stand there and are looked for there more closely. 0.5 until somebody knows better.
    """
    camera_height: float | None
    """How high the camera is above the floor on which people stand, in heights of a person; None where nobody knows."""

    def detect(self, image: np.ndarray) -> Detections:
        """The people in ``image``, shape (height, width, 3), uint8, blue first."""
        ...


def select(
    boxes: np.ndarray, scores: np.ndarray, *, width: int, height: int, overlap: float, within: float = 1.0
) -> Detections:
    """Detections from raw ``boxes`` (n, 4) and ``scores`` (n,): suppressed (see `suppress`), then clipped.

    What lies outside the picture of ``width`` x ``height`` pixels is left out.
    """
    if not len(scores):
        return Detections.none()
    boxes = np.asarray(boxes, dtype=np.float64)
    scores = np.asarray(scores, dtype=np.float64)
    kept = suppress(boxes, scores, overlap, within)
    boxes = clip(boxes[kept], width, height)
    visible = (boxes[:, 2] > 0) & (boxes[:, 3] > 0)
    return Detections(boxes[visible], scores[kept][visible])
