"""What a person detector is: a picture in, boxes and scores out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from socialbot.vision.boxes import clip, suppress

__all__ = ["Detections", "Detector", "select"]


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
