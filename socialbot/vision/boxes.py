"""Boxes in a picture: how far two overlap, and which of many to keep."""

from __future__ import annotations

import numpy as np

__all__ = ["clip", "iou", "same_head", "suppress"]

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
