"""Motion of a person in the image: Kalman filters of a box."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from socialbot.vision.detector import iou

_EDGE_SHARE, _BOX_SHARE = 0.005, 0.02  # A box this near to an edge is cut off: shares of image and box size.

# Noise of middle, top, height and width, relative to the height: measurement, first speed, change of speed per
# second; and the time constants of the speeds, s.
_MEASURED = np.array([0.03, 0.03, 0.05, 0.06])
_FIRST_SPEED = np.array([0.8, 0.2, 0.5, 0.3])
_RESTLESS = np.array([0.8, 0.15, 0.35, 0.2])
_EASE_S = np.array([1.5, 0.7, 0.7, 0.4])
_LEAST_PX = 1.0
_HEAD_JUMP = 0.35  # Between images, heads move up or down by less than this share of the height.


class Cut(NamedTuple):
    """Sides of a box that the image edge cuts off."""

    left: bool = False
    top: bool = False
    right: bool = False
    bottom: bool = False


def cut_off(box: np.ndarray, width: float, height: float) -> Cut:
    """The sides of ``box`` (x, y, w, h) that an image of ``width`` x ``height`` pixels cuts off."""
    x, y, w, h = box
    across, down = _EDGE_SHARE * width + _BOX_SHARE * w, _EDGE_SHARE * height + _BOX_SHARE * h
    return Cut(bool(x <= across), bool(y <= down), bool(x + w >= width - across), bool(y + h >= height - down))


class BoxFilter:
    """Kalman filters of middle x, top y, height and width of a box (pixels), each with a decaying speed.

    All noise is relative to the height, so it does not depend on the distance. Where the image cuts the box off, the
    rest is predicted: the state is the whole person.
    """

    __slots__ = ("_both", "_speed_variance", "speed", "value", "variance")

    def __init__(self, box: np.ndarray) -> None:
        x, y, w, h = box
        self.value = np.array([x + w / 2, y, max(h, _LEAST_PX), max(w, _LEAST_PX)])
        self.speed = np.zeros(4)
        self.variance = (_MEASURED * self.value[2]) ** 2
        self._both = np.zeros(4)
        self._speed_variance = (_FIRST_SPEED * self.value[2]) ** 2

    @property
    def box(self) -> np.ndarray:
        """Box of the whole person: x, y, w, h, shape (4,); may exceed the image."""
        middle, top, height, width = self.value
        return np.array([middle - width / 2, top, width, height])

    def predict(self, seconds: float) -> None:
        """Advance by ``seconds`` (0 or more)."""
        # With ease e = exp(-t / T) a speed v moves by T (1 - e) v in the time t.
        ease = np.exp(-seconds / _EASE_S)
        path = _EASE_S * (1 - ease)
        unrest, time = (_RESTLESS * self.value[2]) ** 2, min(seconds, 1.0)
        self.value = self.value + path * self.speed
        self.value[2:] = np.maximum(self.value[2:], _LEAST_PX)
        self.speed = ease * self.speed
        self.variance = self.variance + path * (2 * self._both + path * self._speed_variance) + unrest * time**3 / 3
        self._both = ease * (self._both + path * self._speed_variance) + unrest * time**2 / 2
        self._speed_variance = ease**2 * self._speed_variance + unrest * time

    def correct(self, box: np.ndarray, cut: Cut, *, feet_hidden: bool = False) -> None:
        """Update with the detected ``box``: x, y, w, h, clipped to the image.

        With ``feet_hidden`` the lower part is occluded, and the height stays as predicted.
        """
        measured, seen = self._whole(box, cut, feet_hidden)
        noise = (_MEASURED * measured[2]) ** 2
        share = np.where(seen, self.variance / (self.variance + noise), 0.0)
        pull = np.where(seen, self._both / (self.variance + noise), 0.0)
        missed = measured - self.value
        self.value = self.value + share * missed
        self.speed = self.speed + pull * missed
        self._speed_variance = self._speed_variance - pull * self._both
        self.variance = (1 - share) * self.variance
        self._both = (1 - share) * self._both

    def _whole(self, box: np.ndarray, cut: Cut, feet_hidden: bool) -> tuple[np.ndarray, np.ndarray]:
        """Measurement of the whole person, shape (4,), and a mask of its measured components."""
        x, y, w, h = box
        _, _, height, width = self.value
        # A cut box is a lower bound.
        narrow, short = (cut.left or cut.right) and width > w, (cut.top or cut.bottom or feet_hidden) and height > h
        width, height = (width if narrow else w), (height if short else h)
        middle, top = x + w / 2, y
        if narrow and cut.left is not cut.right:
            middle = x + w - width / 2 if cut.left else x + width / 2
        if short and cut.top and not cut.bottom:
            top = y + h - height
        seen = np.array([not (narrow and cut.left and cut.right), not (cut.top and cut.bottom), not short, not narrow])
        return np.array([middle, top, height, width]), seen

    def spread(self) -> tuple[float, float]:
        """Standard errors of the middle and of the top, in pixels."""
        return math.sqrt(self.variance[0]), math.sqrt(self.variance[1])

    def fit(self, expected: np.ndarray, boxes: np.ndarray) -> np.ndarray:
        """IoU of ``expected`` (4,), the box clipped to the image, with each of ``boxes``, (n, 4): shape (n,).

        Both are enlarged by the standard error of the prediction.
        """
        across, down = self.spread()
        across, down = min(across, self.value[2] / 2), min(down, self.value[2] / 4)
        margin = np.array([-across, -down, 2 * across, 2 * down])
        return iou(expected + margin, boxes + margin)

    def is_head(self, boxes: np.ndarray) -> np.ndarray:
        """Whether the top of each of ``boxes``, (n, 4), may be that of the person: bool, shape (n,)."""
        _, top, height, _ = self.value
        away = np.abs(boxes[:, 1] - max(top, 0.0))
        return away <= _HEAD_JUMP * np.minimum(height, boxes[:, 3]) + 2 * self.spread()[1]
