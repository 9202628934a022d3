"""People by histograms of oriented gradients and a linear support vector machine (Dalal and Triggs, 2005).

The weights are those that come with OpenCV, trained on the INRIA pictures of upright people. They score a
window of 64 x 128 pixels, so the picture is looked at in many sizes: each is a *level* of a pyramid. The band along the
horizon is made larger as well, since people there are too small for the window.

Where the camera's height is known, people of each size are looked for only where they would stand on the floor: there
is less to be taken for them, and less to do. Those whose legs are below the picture are then known by the upper part
of the window, with the weights that it has in the whole.
"""

from __future__ import annotations

import functools
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from socialbot.core.errors import InstallationError
from socialbot.vision.detector import Detections, clip, suppress
from socialbot.vision.network import View, band, scaled

__all__ = ["HogDetector"]

_WIDTH, _HEIGHT = 64, 128
"""Of the window."""
_BLOCK, _CELL, _BINS = 16, 8, 9
_LARGEST = 1.5
"""How many times larger the picture is made; beyond, there is more to be taken for people than there are people."""
_PERSON = np.array([0.2, 0.125, 0.6, 0.75]) * (_WIDTH, _HEIGHT, _WIDTH, _HEIGHT)
"""Where in its window a person stands, x, y, w, h in pixels: the pictures it was trained on have such margins."""
_UPPER = 80
"""Height of the upper part of the window: a person down to the knees."""
_UPPER_BIAS = -5.5
"""The part has no bias of its own. With this one it scores near people as the whole does those farther off."""
_UPPER_FROM = 7 / 8
"""Whoever is higher than this share of the picture may stand with their legs below it."""
_INSIDE, _BETTER = 0.5, 0.25
"""What lies by this share in somebody whose legs are below the picture, and does not score so much better, is a part of
them, or hidden by them."""
_STATURES = 0.9, 1.15
"""The heights of people, as shares of the usual one ..."""
_SLACK = 1 / 24
"""... and what their boxes are wrong by, as a share of the height: half a stride."""


@dataclass(frozen=True)
class _Template:
    """A window, or its upper part: so many pixels high, laid over a level at every ``stride``-th pixel.

    It may reach so far into the border of a level, which goes on as the picture ends: ``across`` pixels at the sides,
    ``above`` and ``below``. The window is larger than the person in it; with a border it also fits round somebody who
    fills the picture or is cut off by it.
    """

    hog: cv2.HOGDescriptor
    height: int
    stride: int
    across: int
    above: int
    below: int


@dataclass(frozen=True)
class _Level:
    """A part of the picture in one size, with a border of ``above`` and ``below`` pixels."""

    view: View
    template: _Template
    above: int
    below: int

    @property
    def holds_window(self) -> bool:
        width, height = self.view.width + 2 * self.template.across, self.above + self.view.height + self.below
        return width >= _WIDTH and height >= self.template.height


class HogDetector:
    """The classic detector: no network, no weights to install; upright people, whole, from about 100 pixels high.

    Along the ``horizon`` (a share of the picture's height) they may be smaller, from about 65 pixels. Where the
    ``camera_height`` is known, in heights of a person, only grown-up people who stand on the same floor are looked
    for, and near ones may be without their legs. ``threshold`` is the distance from the separating plane that a window
    must reach (0 to about 3). ``scale`` is the ratio of neighbouring levels, ``overlap`` the IoU above which the
    weaker of two detections goes. Pictures wider than ``max_width`` pixels are made smaller first. ``threads`` levels
    are looked at side by side; the result does not depend on it.
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
        self.camera_height: float | None = None
        self.scale = scale
        self.overlap = overlap
        self.max_width = max_width
        self._whole, self._upper = _whole(), _upper()
        self._pool = ThreadPoolExecutor(threads, "hog") if threads > 1 else None

    def detect(self, image: np.ndarray) -> Detections:
        """The people in ``image``, shape (height, width, 3), uint8, blue first."""
        height, width = image.shape[:2]
        if width > self.max_width:
            size = (self.max_width, max(1, round(height * self.max_width / width)))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        levels = self._levels(image.shape[1], image.shape[0])
        look = functools.partial(self._windows, image, self.threshold)
        # Levels come back in order, so threads change nothing but the time.
        found = list((self._pool.map if self._pool else map)(look, levels))
        boxes = np.vstack([np.empty((0, 4)), *(boxes for boxes, _ in found)])
        scores = np.concatenate([np.empty(0), *(scores for _, scores in found)])
        near = [
            np.full(len(scores), level.template is self._upper)
            for level, (_, scores) in zip(levels, found, strict=True)
        ]
        boxes = clip(boxes * np.tile([width / image.shape[1], height / image.shape[0]], 2), width, height)
        kept = suppress(boxes, scores, self.overlap)
        kept = kept[_apart(boxes[kept], scores[kept], np.concatenate([np.empty(0, bool), *near])[kept])]
        return Detections(boxes[kept], scores[kept])

    def _levels(self, width: int, height: int) -> list[_Level]:
        """What is looked at in a picture of ``width`` x ``height`` pixels."""
        larger = math.floor(math.log(_LARGEST, self.scale))
        smaller = math.floor(math.log(max(width / _WIDTH, height / _HEIGHT, 1.0) * 2, self.scale))
        if self.camera_height is not None:
            ratios = [self.scale**step for step in range(larger, -smaller - 1, -1)]
            levels = self._on_floor(width, height, self.camera_height, ratios)
        else:
            views = [
                *(scaled((0, 0, width, height), self.scale**-step) for step in range(smaller + 1)),
                *(scaled(band(width, height, self.horizon), self.scale**step) for step in range(1, larger + 1)),
            ]
            levels = [_Level(view, self._whole, self._whole.above, self._whole.below) for view in views]
        return [level for level in levels if level.holds_window]

    def _on_floor(self, width: int, height: int, camera_height: float, ratios: list[float]) -> list[_Level]:
        """For each size of people the rows in which they would stand."""
        levels = []
        for ratio in ratios:
            levels.append(self._strip(self._whole, width, height, ratio, camera_height))
            if _PERSON[3] / ratio > _UPPER_FROM * height:
                levels.append(self._strip(self._upper, width, height, ratio, camera_height))
        return levels

    def _strip(self, template: _Template, width: int, height: int, ratio: float, camera_height: float) -> _Level:
        """The rows of a level in which ``template`` may lie round people on the floor."""
        _, head, _, tall = _PERSON
        least, most = _below_horizon(camera_height)
        top = self.horizon * height * ratio + (least - 1) * tall - head
        bottom = top + (most - least) * tall + template.height
        first, last = max(0, math.floor(top / ratio)), min(height, math.ceil(bottom / ratio))
        view = scaled((0, first, width, max(0, last - first)), ratio)
        above = min(max(0, math.ceil(-top)), template.above)
        below = min(max(0, math.ceil(bottom - height * ratio)), template.below)
        return _Level(view, template, above, below)

    def _windows(self, image: np.ndarray, threshold: float, level: _Level) -> tuple[np.ndarray, np.ndarray]:
        """The boxes (n, 4) and scores (n,) of the people that reach ``threshold`` at one level."""
        view, template = level.view, level.template
        edges = level.above, level.below, template.across, template.across
        canvas = cv2.copyMakeBorder(view.cut(image), *edges, cv2.BORDER_REPLICATE)
        stride = (template.stride, template.stride)
        corners, scores = template.hog.detect(canvas, hitThreshold=threshold, winStride=stride)
        corners = np.asarray(corners, dtype=np.float64).reshape(-1, 2) - (template.across, level.above)
        boxes = view.back(np.hstack([corners, np.zeros_like(corners)]) + _PERSON)
        good = self._believable(boxes, view, image.shape[1], image.shape[0])
        return boxes[good], np.ravel(scores).astype(np.float64)[good]

    def _believable(self, boxes: np.ndarray, view: View, width: int, height: int) -> np.ndarray:
        """Which of ``boxes`` (n, 4) show people who may be there: bool, (n,)."""
        if self.camera_height is None:
            return view.trusted(boxes, width, height)
        least, most = _below_horizon(self.camera_height)
        below = (boxes[:, 1] + boxes[:, 3] - self.horizon * height) / boxes[:, 3]
        return (below >= least) & (below <= most)


def _below_horizon(camera_height: float) -> tuple[float, float]:
    """Which share of people on the floor is below the horizon, at least and at most, seen from ``camera_height``."""
    short, tall = _STATURES
    return camera_height / tall - _SLACK, camera_height / short + _SLACK


def _whole() -> _Template:
    return _Template(_hog(_HEIGHT, _weights()), _HEIGHT, stride=8, across=16, above=32, below=32)


def _upper() -> _Template:
    weights = _weights()
    # Its blocks come column by column, from top to bottom.
    columns = weights[:-1].reshape(_WIDTH // _CELL - 1, _HEIGHT // _CELL - 1, -1)
    part = np.append(columns[:, : _UPPER // _CELL - 1], np.float32(_UPPER_BIAS))
    return _Template(_hog(_UPPER, part), _UPPER, stride=4, across=24, above=24, below=8)


def _weights() -> np.ndarray:
    """Of the whole window, the bias last."""
    return np.array(cv2.HOGDescriptor.getDefaultPeopleDetector(), dtype=np.float32).ravel()


def _hog(height: int, weights: np.ndarray) -> cv2.HOGDescriptor:
    hog = cv2.HOGDescriptor((_WIDTH, height), (_BLOCK, _BLOCK), (_CELL, _CELL), (_CELL, _CELL), _BINS)
    hog.setSVMDetector(weights)
    return hog


def _apart(boxes: np.ndarray, scores: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Which of ``boxes`` (n, 4), best first, do not lie below the head of one that is ``near`` (n,): bool, (n,)."""
    apart = np.min(boxes[:, 2:], axis=1, initial=1.0) > 0
    for index in np.flatnonzero(near & apart):
        inside = clip(boxes - [*boxes[index, :2], 0, 0], *boxes[index, 2:])
        within = np.prod(inside[:, 2:], axis=1) > _INSIDE * np.prod(boxes[:, 2:], axis=1)
        lower = boxes[:, 1] > boxes[index, 1]
        apart &= ~(apart[index] & within & lower & (scores < scores[index] + _BETTER))
    return apart
