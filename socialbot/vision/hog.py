"""People by histograms of oriented gradients and a linear support vector machine (Dalal and Triggs, 2005).

The weights are those that come with OpenCV, trained on the INRIA pictures of upright people. They score a
window of 64 x 128 pixels, so the picture is looked at in many sizes: each is a *level* of a pyramid. The band along the
horizon is made larger as well, since people there are too small for the window.
"""

from __future__ import annotations

import functools
import math
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from socialbot.errors import InstallationError
from socialbot.vision.detector import Detections, select
from socialbot.vision.views import View, band, scaled

__all__ = ["HogDetector"]

_WINDOW = (64, 128)
_STRIDE = (8, 8)
_BORDER = (16, 32)
"""Pixels added left and right, above and below each level: a quarter of the window.

The window is larger than the person in it. With a border it also fits round somebody who fills the
picture or is cut off by it.
"""
_SMALLEST = (_WINDOW[0] - 2 * _BORDER[0], _WINDOW[1] - 2 * _BORDER[1])
"""Width and height of the smallest level that holds a window."""
_LARGEST = 1.5
"""How many times larger the band is made; beyond that there is more to be taken for people than there are people."""
_PERSON = np.array([0.2, 0.125, 0.6, 0.75]) * (*_WINDOW, *_WINDOW)
"""Where in its window a person stands, x, y, w, h in pixels: the pictures it was trained on have such margins."""


class HogDetector:
    """The classic detector: no network, no weights to install; upright people, whole, from about 100 pixels high.

    Along the ``horizon`` (a share of the picture's height) they may be smaller, from about 65 pixels. ``threshold`` is
    the distance from the separating plane that a window must reach (0 to about 3). ``scale`` is the ratio of
    neighbouring levels, ``overlap`` the IoU above which the weaker of two detections goes. Pictures wider than
    ``max_width`` pixels are made smaller first. ``threads`` levels are looked at side by side; the result does not
    depend on it.
    """

    box_width_m = 0.4 * 1.70
    """All its boxes have one shape, 0.4 times as wide as high, and arms or none do not change it."""

    def __init__(
        self,
        threshold: float = 0.5,
        *,
        scale: float = 1.05,
        overlap: float = 0.3,
        max_width: int = 640,
        threads: int = 1,
    ) -> None:
        """Raises InstallationError when this OpenCV has no HOG detector, as from version 5 on."""
        if not hasattr(cv2, "HOGDescriptor"):
            raise InstallationError(
                f"OpenCV {cv2.__version__} has no HOGDescriptor",
                where="hog detector",
                remedy="pip install 'opencv-python-headless>=4.12,<5', or choose another detector",
            )
        self.threshold = threshold
        self.horizon = 0.5
        self.scale = scale
        self.overlap = overlap
        self.max_width = max_width
        self._hog = cv2.HOGDescriptor()
        self._hog.setSVMDetector(np.array(cv2.HOGDescriptor.getDefaultPeopleDetector(), dtype=np.float32))
        self._pool = ThreadPoolExecutor(threads, "hog") if threads > 1 else None

    def detect(self, image: np.ndarray) -> Detections:
        """The people in ``image``, shape (height, width, 3), uint8, blue first."""
        height, width = image.shape[:2]
        if width > self.max_width:
            size = (self.max_width, max(1, round(height * self.max_width / width)))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        look = functools.partial(self._windows, image, self.threshold)
        # Levels come back in order, so threads change nothing but the time.
        found = list((self._pool.map if self._pool else map)(look, self._levels(image)))
        boxes = np.vstack([np.empty((0, 4)), *(boxes for boxes, _ in found)])
        scores = np.concatenate([np.empty(0), *(scores for _, scores in found)])
        boxes *= np.tile([width / image.shape[1], height / image.shape[0]], 2)
        return select(boxes, scores, width=width, height=height, overlap=self.overlap)

    def _levels(self, image: np.ndarray) -> list[View]:
        """The whole in ever smaller sizes, and the band in ever larger ones."""
        height, width = image.shape[:2]
        room = min(width / _SMALLEST[0], height / _SMALLEST[1])
        smaller = range(1 + math.floor(math.log(room, self.scale)) if room >= 1 else 0)
        larger = range(1, 1 + math.floor(math.log(_LARGEST, self.scale)))
        levels = [
            *(scaled((0, 0, width, height), self.scale**-step) for step in smaller),
            *(scaled(band(width, height, self.horizon), self.scale**step) for step in larger),
        ]
        return [level for level in levels if level.width >= _SMALLEST[0] and level.height >= _SMALLEST[1]]

    def _windows(self, image: np.ndarray, threshold: float, level: View) -> tuple[np.ndarray, np.ndarray]:
        """The boxes (n, 4) and scores (n,) of the people that reach ``threshold`` at one level."""
        across, down = _BORDER
        canvas = cv2.copyMakeBorder(level.cut(image), down, down, across, across, cv2.BORDER_REPLICATE)
        corners, scores = self._hog.detect(canvas, hitThreshold=threshold, winStride=_STRIDE)
        corners = np.asarray(corners, dtype=np.float64).reshape(-1, 2) - _BORDER
        boxes = level.back(np.hstack([corners, np.zeros_like(corners)]) + _PERSON)
        trusted = level.trusted(boxes, image.shape[1], image.shape[0])
        return boxes[trusted], np.ravel(scores).astype(np.float64)[trusted]
