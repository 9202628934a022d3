"""Detector interface, and boxes: overlap and non-maximum suppression."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

_HEADS_ALIKE = 0.15  # Box tops this close belong to one head: share of the smaller height.
_NARROWER = 0.4  # Boxes of one head differ less in width; distant people behind near ones are narrower.
LEAST_FUSED = 0.25
"""Score from which a box counts in an average. A fixed one: averages do not depend on a threshold below it."""
_WITHIN = 0.8  # A box that others cover by this share is within them.
_TALLER = 4 / 3  # A taller box may be the whole body, and the better one its upper half.


def clip(boxes: np.ndarray, width: int, height: int) -> np.ndarray:
    """Clip ``boxes``, (n, 4) as x, y, w, h in pixels, to the image; a box outside gets a size of 0."""
    corner, size = boxes[:, :2], np.array((width, height))
    opposite = np.minimum(np.maximum(corner + boxes[:, 2:], 0), size)
    corner = np.minimum(np.maximum(corner, 0), size)
    return np.hstack([corner, opposite - corner])


def iou(one: np.ndarray, many: np.ndarray) -> np.ndarray:
    """Intersection over union of ``one``, shape (4,), with each of ``many``, (n, 4)."""
    shared = shared_area(one, many)
    return _ratio(shared, one[2] * one[3] + many[:, 2] * many[:, 3] - shared)


def same_head(one: np.ndarray, many: np.ndarray, within: float) -> np.ndarray:
    """Whether ``one``, shape (4,), and each of ``many``, (n, 4), may show the same head: bool, shape (n,).

    Their tops and widths must be similar, and the larger box must contain more than the share ``within`` of the
    smaller. This matches the upper body and the whole body, or a person alone and with a neighbour.
    """
    share = _ratio(shared_area(one, many), np.minimum(one[2] * one[3], many[:, 2] * many[:, 3]))
    alike = np.abs(one[1] - many[:, 1]) < _HEADS_ALIKE * np.minimum(one[3], many[:, 3])
    widths = np.minimum(one[2], many[:, 2]) >= _NARROWER * np.maximum(one[2], many[:, 2])
    return (share > within) & alike & widths


def suppress(boxes: np.ndarray, scores: np.ndarray, overlap: float, within: float = 1.0) -> np.ndarray:
    """Greedy non-maximum suppression; the result does not depend on the order of the input.

    Args:
        boxes: Shape (n, 4).
        scores: Shape (n,); equal scores are ranked by x, y, w and h.
        overlap: IoU with a better box above which a box is suppressed.
        within: Share for `same_head`, which suppresses boxes that are not much taller; 1 turns this off.

    Returns:
        Indices of the boxes to keep, best first.
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


def shared_area(one: np.ndarray, many: np.ndarray) -> np.ndarray:
    """Area that ``one``, shape (4,), shares with each of ``many``, (n, 4)."""
    corner = np.maximum(one[:2], many[:, :2])
    opposite = np.minimum(one[:2] + one[2:], many[:, :2] + many[:, 2:])
    sides = np.maximum(opposite - corner, 0)
    return sides[:, 0] * sides[:, 1]


def contained(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Whether each of ``boxes`` (n, 4) lies mostly within each of ``others`` (m, 4): bool, shape (n, m)."""
    corner = np.maximum(boxes[:, None, :2], others[None, :, :2])
    opposite = np.minimum(boxes[:, None, :2] + boxes[:, None, 2:], others[None, :, :2] + others[None, :, 2:])
    sides = np.maximum(opposite - corner, 0)
    return sides[:, :, 0] * sides[:, :, 1] > _WITHIN * (boxes[:, 2] * boxes[:, 3])[:, None]


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.divide(part, whole, out=np.zeros(len(part)), where=whole > 0)


@dataclass(frozen=True, eq=False)
class Detections:
    """Detected people in one image, best first.

    Args:
        boxes: float64, shape (n, 4): x, y, w, h in pixels, clipped to the image.
        scores: float64, shape (n,), in the scale of the detector.
    """

    boxes: np.ndarray
    scores: np.ndarray

    def __len__(self) -> int:
        return len(self.scores)


class Detector(Protocol):
    """Interface of person detectors; the same image gives the same result."""

    threshold: float
    """Least score of a detection; may change between images."""
    box_width_m: float
    """Width of its boxes around a person of 1.70 m seen from the front, m."""
    horizon: float
    """Height of the horizon as a share of the image, 0 at the top; may change between images.

    Distant people are there and are searched at a larger scale. The default is 0.5.
    """
    camera_height: float | None
    """Height of the camera above the floor, in heights of a person; None if unknown."""

    def detect(self, image: np.ndarray) -> Detections:
        """Detect people in ``image``, shape (height, width, 3), uint8, BGR."""
        ...


def fuse(boxes: np.ndarray, scores: np.ndarray, kept: np.ndarray, overlap: float) -> np.ndarray:
    """The ``kept`` ones of ``boxes`` (n, 4), each averaged with those that overlap it by more than the IoU ``overlap``.

    Weights are the squares of ``scores`` (n,); scores below `LEAST_FUSED` do not count. Several views of a person place
    its edges better than the best one.
    """
    fused = boxes[kept]
    for number, index in enumerate(kept):
        same = (iou(boxes[index], boxes) > overlap) & (scores >= LEAST_FUSED)
        if same.any():
            fused[number] = np.average(boxes[same], axis=0, weights=scores[same] ** 2)
    return fused


def select(
    boxes: np.ndarray,
    scores: np.ndarray,
    *,
    width: int,
    height: int,
    overlap: float,
    within: float = 1.0,
    fused: float = 1.0,
) -> Detections:
    """Suppress raw ``boxes`` (n, 4) with ``scores`` (n,), see `suppress`, and clip them to the image.

    Boxes that overlap by more than the IoU ``fused`` are averaged, see `fuse`; 1 turns this off.
    """
    boxes = np.asarray(boxes, dtype=np.float64).reshape(-1, 4)
    scores = np.asarray(scores, dtype=np.float64)
    kept = suppress(boxes, scores, overlap, within)
    boxes = clip(fuse(boxes, scores, kept, fused) if fused < 1 else boxes[kept], width, height)
    visible = (boxes[:, 2] > 0) & (boxes[:, 3] > 0)
    return Detections(boxes[visible], scores[kept][visible])
