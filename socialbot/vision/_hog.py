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
from socialbot.core.installation import pip_command
from socialbot.vision.detector import Detections, clip, suppress
from socialbot.vision.network import View, band, scaled

_WIDTH, _HEIGHT = 64, 128  # Window.
_BLOCK, _CELL, _BINS = 16, 8, 9
_SCALE = 1.05  # Ratio of neighbouring levels.
_OVERLAP = 0.3  # IoU above which the weaker of two detections is suppressed.
_MAX_WIDTH = 640  # Wider images are scaled down.
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

    It may exceed the image by ``across``, ``above`` and ``below`` pixels, to fit people whom the image cuts off.
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


class HogDetector:
    """HOG and SVM detector for upright people from 100 pixels high, or from 65 pixels along the horizon.

    With a ``camera_height`` it finds only adults on the floor of the camera, also without their legs.

    Args:
        threshold: Least distance from the separating plane, 0 to about 3.
        threads: Parallel levels; the result does not depend on it.
    """

    box_width_m = 0.4 * 1.70

    def __init__(self, threshold: float = 0.5, *, threads: int = 1) -> None:
        """Raises InstallationError for OpenCV 5, which has no HOG detector."""
        if not hasattr(cv2, "HOGDescriptor"):
            raise InstallationError(
                f"OpenCV {cv2.__version__} has no HOGDescriptor",
                where="hog detector",
                remedy=f"{pip_command('install', 'opencv-python-headless>=4.12,<5')}, or choose another detector",
            )
        self.threshold = threshold
        self.horizon = 0.5
        self.camera_height: float | None = None
        weights = np.array(cv2.HOGDescriptor.getDefaultPeopleDetector(), dtype=np.float32).ravel()
        # Blocks are stored column by column, the bias last.
        columns = weights[:-1].reshape(_WIDTH // _CELL - 1, _HEIGHT // _CELL - 1, -1)
        upper = np.append(columns[:, : _UPPER // _CELL - 1], np.float32(_UPPER_BIAS))
        self._whole = _Template(_hog(_HEIGHT, weights), _HEIGHT, stride=8, across=16, above=32, below=32)
        self._upper = _Template(_hog(_UPPER, upper), _UPPER, stride=4, across=24, above=24, below=8)
        self._pool = ThreadPoolExecutor(threads, "hog") if threads > 1 else None

    def detect(self, image: np.ndarray) -> Detections:
        """The people in ``image``, shape (height, width, 3), uint8, blue first."""
        height, width = image.shape[:2]
        if width > _MAX_WIDTH:
            size = (_MAX_WIDTH, max(1, round(height * _MAX_WIDTH / width)))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        levels = self._levels(image.shape[1], image.shape[0])
        look = functools.partial(self._windows, image, self.threshold)
        found = list((self._pool.map if self._pool else map)(look, levels))
        boxes = np.vstack([np.empty((0, 4)), *(boxes for boxes, _ in found)])
        scores = np.concatenate([np.empty(0), *(scores for _, scores in found)])
        lengths = np.array([len(scores) for _, scores in found], dtype=np.intp)
        near = np.repeat(np.array([level.template is self._upper for level in levels], dtype=bool), lengths)
        boxes = clip(boxes * np.tile([width / image.shape[1], height / image.shape[0]], 2), width, height)
        kept = suppress(boxes, scores, _OVERLAP)
        kept = kept[_apart(boxes[kept], scores[kept], near[kept])]
        return Detections(boxes[kept], scores[kept])

    def _levels(self, width: int, height: int) -> list[_Level]:
        larger = math.floor(math.log(_LARGEST, _SCALE))
        smaller = math.floor(math.log(max(width / _WIDTH, height / _HEIGHT, 1.0) * 2, _SCALE))
        if self.camera_height is not None:
            levels = []
            for ratio in (_SCALE**step for step in range(larger, -smaller - 1, -1)):
                levels.append(self._strip(self._whole, width, height, ratio, self.camera_height))
                if _PERSON[3] / ratio > _UPPER_FROM * height:
                    levels.append(self._strip(self._upper, width, height, ratio, self.camera_height))
        else:
            views = [
                *(scaled((0, 0, width, height), _SCALE**-step) for step in range(smaller + 1)),
                *(scaled(band(width, height, self.horizon), _SCALE**step) for step in range(1, larger + 1)),
            ]
            levels = [_Level(view, self._whole, self._whole.above, self._whole.below) for view in views]
        return [
            level
            for level in levels
            if level.view.width + 2 * level.template.across >= _WIDTH
            and level.above + level.view.height + level.below >= level.template.height
        ]

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
        if self.camera_height is None:
            good = view.trusted(boxes, image.shape[1], image.shape[0])
        else:
            least, most = _below_horizon(self.camera_height)
            below = (boxes[:, 1] + boxes[:, 3] - self.horizon * image.shape[0]) / boxes[:, 3]
            good = (below >= least) & (below <= most)
        return boxes[good], np.ravel(scores).astype(np.float64)[good]


def _below_horizon(camera_height: float) -> tuple[float, float]:
    """Least and largest share of a standing person below the horizon."""
    short, tall = _STATURES
    return camera_height / tall - _SLACK, camera_height / short + _SLACK


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
