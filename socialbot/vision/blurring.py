"""Blur people in images beyond recognition."""

from __future__ import annotations

import cv2
import numpy as np

from socialbot.vision.detectors import DETECTORS, DetectorSettings

FLOOR_SCORE = 0.15  # Detections from here are blurred: a false one costs some pixels, a missed one a face.
NEAR_NS = 500_000_000
"""A box also blurs images this near in time (ns), which covers those in which the detector misses a person."""
_HEAD_SHARE, _ABOVE, _BESIDE = 0.38, 0.12, 0.08  # Region of a head, and its margins: shares of the height of a box.
_UPRIGHT = 0.5  # A box wider than this share of its height may show the upper body only: it is blurred whole.
_BLOCKS = 6  # Blocks across a blurred region: its mean colours are all that is left.


def regions_of(boxes: np.ndarray, *, whole: bool) -> np.ndarray:
    """Return the regions to blur, (n, 4): heads with a margin, or whole people."""
    x, y, w, h = np.asarray(boxes, np.float64).reshape(-1, 4).T
    tall = h * (1.0 if whole else _HEAD_SHARE)
    tall = np.where(w > _UPRIGHT * h, h, tall)
    return np.stack([x - _BESIDE * h, y - _ABOVE * h, w + 2 * _BESIDE * h, tall + _ABOVE * h], axis=1)


def blurred(pixels: np.ndarray, boxes: np.ndarray, *, whole: bool = False) -> np.ndarray:
    """Return a copy of BGR ``pixels`` with people in ``boxes`` blurred beyond recognition."""
    image = pixels.copy()
    height, width = image.shape[:2]
    for x, y, w, h in regions_of(boxes, whole=whole):
        left, top = max(0, int(x)), max(0, int(y))
        right, bottom = min(width, int(np.ceil(x + w))), min(height, int(np.ceil(y + h)))
        if right <= left or bottom <= top:
            continue
        part = pixels[top:bottom, left:right]
        blocks = (min(_BLOCKS, right - left), min(_BLOCKS, bottom - top))
        small = cv2.resize(part, blocks, interpolation=cv2.INTER_AREA)
        image[top:bottom, left:right] = cv2.resize(small, (right - left, bottom - top), interpolation=cv2.INTER_LINEAR)
    return image


class PeopleFinder:
    """Person detector with a low threshold: a false person costs less than a missed one."""

    def __init__(self) -> None:
        """Load the detector. Raises InstallationError."""
        self._detector = DETECTORS["nanodet"].make(DetectorSettings())
        self._detector.threshold = FLOOR_SCORE

    def find(self, pixels: np.ndarray) -> np.ndarray:
        """Return the boxes in BGR ``pixels``, (n, 4) as x, y, w, h in pixels."""
        return self._detector.detect(pixels).boxes
