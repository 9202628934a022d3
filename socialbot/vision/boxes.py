"""Boxes in a picture: how far two overlap, and which of many to keep."""

from __future__ import annotations

import numpy as np

__all__ = ["clip", "iou", "suppress"]


def clip(boxes: np.ndarray, width: int, height: int) -> np.ndarray:
    """``boxes``, shape (n, 4) as x, y, w, h in pixels, without what lies outside the picture.

    A box wholly outside keeps a width or height of 0.
    """
    corner = np.clip(boxes[:, :2], 0, (width, height))
    opposite = np.clip(boxes[:, :2] + boxes[:, 2:], 0, (width, height))
    return np.hstack([corner, opposite - corner])


def iou(one: np.ndarray, many: np.ndarray) -> np.ndarray:
    """Intersection over union of the box ``one``, shape (4,), with ``many``, (n, 4): shape (n,), 0 to 1."""
    corner = np.maximum(one[:2], many[:, :2])
    opposite = np.minimum(one[:2] + one[2:], many[:, :2] + many[:, 2:])
    shared = np.prod(np.clip(opposite - corner, 0, None), axis=1)
    union = one[2] * one[3] + many[:, 2] * many[:, 3] - shared
    return np.divide(shared, union, out=np.zeros(len(many)), where=union > 0)


def suppress(boxes: np.ndarray, scores: np.ndarray, overlap: float) -> np.ndarray:
    """Greedy non-maximum suppression: the indices of the boxes to keep, best first.

    ``boxes`` is (n, 4), ``scores`` (n,). A box goes when its IoU with a better one that stays is above
    ``overlap``. Equal scores are ranked by x, y, w and h, so the order of the input does not matter.
    """
    boxes = np.asarray(boxes, dtype=np.float64).reshape(-1, 4)
    waiting = np.lexsort((*boxes.T[::-1], -np.asarray(scores)))
    kept: list[int] = []
    while waiting.size:
        best, waiting = waiting[0], waiting[1:]
        kept.append(int(best))
        waiting = waiting[iou(boxes[best], boxes[waiting]) <= overlap]
    return np.array(kept, dtype=np.intp)
