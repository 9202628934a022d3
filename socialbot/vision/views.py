"""Views: parts of a picture, made larger or smaller, as a network looks at them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

__all__ = ["Part", "View", "band", "fitting", "scaled", "whole"]

Part = tuple[int, int, int, int]
"""A rectangle within a picture: x, y, w, h in pixels."""

_NEAR_EDGE = 0.06
"""How near to an edge of its view a box is taken to be cut off by it, as a share of the view's height."""
_LARGEST_SCALE = 2.0
"""Beyond that a picture gains nothing from being made larger."""
_ABOVE, _BELOW = 0.13, 0.2
"""How far the band reaches above and below the horizon, as a share of the picture's height.

From a camera at the height of eyes or hips, with the horizon a little off, people from 10 m on are within.
"""


@dataclass(frozen=True)
class View:
    """A rectangle of the picture, ``x``, ``y``, ``w``, ``h``, on a canvas of ``width`` x ``height``, all in pixels.

    There it takes ``across`` x ``down`` pixels from ``left``, ``top`` on; ``fill`` is the grey of the rest. Boxes
    less than ``least`` pixels high on the canvas are left to finer views.
    """

    x: int
    y: int
    w: int
    h: int
    width: int
    height: int
    across: int
    down: int
    left: int
    top: int
    fill: int = 0
    least: float = 0.0

    def cut(self, image: np.ndarray) -> np.ndarray:
        """The canvas, (height, width, 3), uint8, of ``image``, (any height, any width, 3), uint8."""
        canvas = np.full((self.height, self.width, 3), self.fill, np.uint8)
        part = image[self.y : self.y + self.h, self.x : self.x + self.w]
        # Averaging keeps what linear interpolation would skip; at mild reductions networks know the latter better.
        method = cv2.INTER_AREA if self.across < self.w / 2 else cv2.INTER_LINEAR
        target = canvas[self.top : self.top + self.down, self.left : self.left + self.across]
        target[:] = cv2.resize(part, (self.across, self.down), interpolation=method)
        return canvas

    def back(self, boxes: np.ndarray) -> np.ndarray:
        """``boxes`` of the canvas, (n, 4) as x, y, w, h, in pixels of the picture."""
        scale = np.array([self.w / self.across, self.h / self.down])
        corner = (boxes[:, :2] - (self.left, self.top)) * scale + (self.x, self.y)
        return np.hstack([corner, boxes[:, 2:] * scale])

    def trusted(self, boxes: np.ndarray, width: int, height: int) -> np.ndarray:
        """Which of ``boxes``, (n, 4) in pixels of the picture of ``width`` x ``height``, to believe: bool, (n,).

        Those that are large enough and not cut off. Only where the picture goes on beyond the view can it cut off.
        """
        margin = _NEAR_EDGE * self.h
        return (
            (boxes[:, 3] * self.down >= self.least * self.h)
            & ((boxes[:, 0] > self.x + margin) | (self.x <= 0))
            & ((boxes[:, 1] > self.y + margin) | (self.y <= 0))
            & ((boxes[:, 0] + boxes[:, 2] < self.x + self.w - margin) | (self.x + self.w >= width))
            & ((boxes[:, 1] + boxes[:, 3] < self.y + self.h - margin) | (self.y + self.h >= height))
        )


def band(width: int, height: int, horizon: float) -> Part:
    """Where far people are in a picture of ``width`` x ``height`` pixels; ``horizon`` is a share of the height."""
    middle = min(max(horizon, 0.0), 1.0)
    top, bottom = round(max(0.0, middle - _ABOVE) * height), round(min(1.0, middle + _BELOW) * height)
    return 0, min(top, height - 1), width, max(1, bottom - top)


def whole(width: int, height: int, canvas: tuple[int, int], *, centred: bool = True, fill: int = 0) -> View:
    """The whole picture of ``width`` x ``height`` on a ``canvas`` (width, height), with its proportions.

    It is as large as fits, in the middle or at the upper left.
    """
    return _placed((0, 0, width, height), canvas, centred, fill, 0.0)


def scaled(part: Part, ratio: float) -> View:
    """The ``part`` of a picture made ``ratio`` times as large, with nothing beside it."""
    x, y, w, h = part
    width, height = max(1, round(w * ratio)), max(1, round(h * ratio))
    return View(x, y, w, h, width, height, width, height, 0, 0)


def fitting(part: Part, pixels: int, *, step: int = 32, fill: int = 0, least: float = 0.0) -> View:
    """The ``part`` of a picture on a canvas of about ``pixels``, whose sides ``step`` divides."""
    _, _, w, h = part
    scale = min(math.sqrt(pixels / (w * h)), _LARGEST_SCALE)
    canvas = (max(1, round(w * scale / step)) * step, max(1, round(h * scale / step)) * step)
    return _placed(part, canvas, True, fill, least)


def _placed(part: Part, canvas: tuple[int, int], centred: bool, fill: int, least: float) -> View:
    x, y, w, h = part
    width, height = canvas
    scale = min(width / w, height / h)
    across, down = max(1, min(width, round(w * scale))), max(1, min(height, round(h * scale)))
    left, top = ((width - across) // 2, (height - down) // 2) if centred else (0, 0)
    return View(x, y, w, h, width, height, across, down, left, top, fill, least)
