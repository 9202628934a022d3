"""HOG detector: histograms of oriented gradients and a linear support vector machine (Dalal and Triggs, 2005).

The weights come with OpenCV and are trained on the INRIA images of upright people. They score a window of 64 x 128
pixels on each level of an image pyramid. The band along the horizon is enlarged too, because distant people are
smaller than the window.

If the camera height is known, each level is searched only where people of that size would stand on the floor. This
saves time and false positives. People whose legs are below the image are then found by the upper part of the window.
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

_WIDTH, _HEIGHT = 64, 128  # Window.
_BLOCK, _CELL, _BINS = 16, 8, 9
_LARGEST = 1.5  # Largest magnification; more of it adds more false positives than people.
# Person in the window, x, y, w, h in pixels: the training images have these margins.
_PERSON = np.array([0.2, 0.125, 0.6, 0.75]) * (_WIDTH, _HEIGHT, _WIDTH, _HEIGHT)
_UPPER = 80  # Height of the upper part of the window: a person down to the knees.
_UPPER_BIAS = -5.5  # Makes the scores of the upper part comparable to those of the whole window.
_UPPER_FROM = 7 / 8  # People taller than this share of the image may have their legs below it.
_INSIDE, _BETTER = 0.5, 0.25  # A box inside such a person by this share, and not this much better, is a part of them.
_STATURES = 0.9, 1.15  # Range of heights, as shares of the usual one;
_SLACK = 1 / 24  # boxes are wrong by half a stride, as a share of the height.


@dataclass(frozen=True)
class _Template:
    """Detection window or its upper part, ``height`` pixels high, moved by ``stride`` pixels.

    It may exceed the image by ``across``, ``above`` and ``below`` pixels, where the border is replicated. So it also
    fits a person who fills the image or is cut off by it.
    """

    hog: cv2.HOGDescriptor
    height: int
    stride: int
    across: int
    above: int
    below: int


@dataclass(frozen=True)
class _Level:
    """Pyramid level: a scaled region with a border of ``above`` and ``below`` pixels."""

    view: View
    template: _Template
    above: int
    below: int

    @property
    def holds_window(self) -> bool:
        width, height = self.view.width + 2 * self.template.across, self.above + self.view.height + self.below
        return width >= _WIDTH and height >= self.template.height


class HogDetector:
    """HOG and SVM detector for upright people from 100 pixels high, or from 65 pixels along the horizon.

    With a ``camera_height`` it finds only adults on the floor of the camera, also without their legs.

    Args:
        threshold: Least distance from the separating plane, 0 to about 3.
        scale: Ratio of neighbouring levels.
        overlap: IoU above which the weaker of two detections is suppressed.
        max_width: Wider images are scaled down, pixels.
        threads: Parallel levels; the result does not depend on it.
    """

    box_width_m = 0.4 * 1.70

    def __init__(
        self,
        threshold: float = 0.5,
        *,
        scale: float = 1.05,
        overlap: float = 0.3,
        max_width: int = 640,
        threads: int = 1,
    ) -> None:
        """Raises InstallationError for OpenCV 5, which has no HOG detector."""
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
        levels = []
        for ratio in ratios:
            levels.append(self._strip(self._whole, width, height, ratio, camera_height))
            if _PERSON[3] / ratio > _UPPER_FROM * height:
                levels.append(self._strip(self._upper, width, height, ratio, camera_height))
        return levels

    def _strip(self, template: _Template, width: int, height: int, ratio: float, camera_height: float) -> _Level:
        """The rows of a level in which people on the floor can be."""
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
        """Boxes (n, 4) and scores (n,) above ``threshold`` of one level."""
        view, template = level.view, level.template
        edges = level.above, level.below, template.across, template.across
        canvas = cv2.copyMakeBorder(view.cut(image), *edges, cv2.BORDER_REPLICATE)
        stride = (template.stride, template.stride)
        corners, scores = template.hog.detect(canvas, hitThreshold=threshold, winStride=stride)
        corners = np.asarray(corners, dtype=np.float64).reshape(-1, 2) - (template.across, level.above)
        boxes = view.back(np.hstack([corners, np.zeros_like(corners)]) + _PERSON)
        good = self._plausible(boxes, view, image.shape[1], image.shape[0])
        return boxes[good], np.ravel(scores).astype(np.float64)[good]

    def _plausible(self, boxes: np.ndarray, view: View, width: int, height: int) -> np.ndarray:
        if self.camera_height is None:
            return view.trusted(boxes, width, height)
        least, most = _below_horizon(self.camera_height)
        below = (boxes[:, 1] + boxes[:, 3] - self.horizon * height) / boxes[:, 3]
        return (below >= least) & (below <= most)


def _below_horizon(camera_height: float) -> tuple[float, float]:
    """Least and largest share of a standing person below the horizon."""
    short, tall = _STATURES
    return camera_height / tall - _SLACK, camera_height / short + _SLACK


def _whole() -> _Template:
    return _Template(_hog(_HEIGHT, _weights()), _HEIGHT, stride=8, across=16, above=32, below=32)


def _upper() -> _Template:
    weights = _weights()
    # Blocks are stored column by column.
    columns = weights[:-1].reshape(_WIDTH // _CELL - 1, _HEIGHT // _CELL - 1, -1)
    part = np.append(columns[:, : _UPPER // _CELL - 1], np.float32(_UPPER_BIAS))
    return _Template(_hog(_UPPER, part), _UPPER, stride=4, across=24, above=24, below=8)


def _weights() -> np.ndarray:
    """Weights of the whole window, the bias last."""
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
