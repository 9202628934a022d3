"""Distances of people from depth images and point clouds.

A box also contains background, occluders, holes and, at edges, pixels between two depths. So the distances in the
middle of the box are sorted into layers. The layer of the person has many of the samples, a plausible size for a
person, and agrees with the distance from the image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np

from socialbot.vision.camera import Box, CameraModel
from socialbot.vision.depth_images import NEAREST_M, depth_in_metres
from socialbot.vision.distance import Estimate

Source = Literal["depth", "lidar"]

_BODY_M, _BODY_STD_M = 0.10, 0.06
"""From the visible surface of a body to its axis, and the error of that."""
_NOISE: dict[Source, tuple[float, float]] = {"depth": (0.01, 0.002), "lidar": (0.005, 0.0)}
"""Share of the distance, and metres per square metre of distance: the noise of stereo and quantisation."""
_PACE = 1.0
"""Speed of a person (m/s) between the image and the measurement."""
_LAYER_M = 0.35
_LAYER_SHARE: dict[Source, float] = {"depth": 0.04, "lidar": 0.01}
"""Half the thickness of a layer: a person with arms, and the noise."""
_BIN = 0.04
"""Width of the bins of the logarithm of the distance."""
_PRIOR, _PRIOR_STDS, _OUTLIERS = 0.2, 1.5, 0.08
"""Prior around the distance from the image: least width as a logarithm, standard errors, and share of outliers."""
_MOST_HEIGHT_M, _LEAST_HEIGHT_M, _MOST_WIDTH_M = 2.3, 0.7, 1.6
_LEAST_SCORE = 0.03
_MOST_STD = 0.3
"""Relative error from which a distance is not stated."""
_UNSEEN, _ENOUGH = 0.3, 8.0
"""Score of a person without measurements in an empty box; it falls with the number of measurements by ``_ENOUGH``."""
_LEAST_SAMPLES: dict[Source, int] = {"depth": 12, "lidar": 3}
_GRID = 32
"""Largest number of samples along each side of a box."""
_MOST_CLOUD = 4000
"""Largest number of points for the floor."""
_GAP, _BESIDE, _ABOVE, _FEET = 0.15, 0.6, 0.25, 0.8
"""The background is seen beside a box, from ``_GAP`` to ``_BESIDE`` of its width, and up to ``_ABOVE`` of its height
above it, but not below ``_FEET`` of its height."""
_CONTINUED = 0.4
"""Share of the surroundings from which a layer is rather background."""
_CLAIM = 0.08
"""Share of its width by which a person exceeds the box."""


class Samples(NamedTuple):
    """Valid measurements in a box: pixels ``u``, ``v`` of the picture, and horizontal ``distance``, shape (n,) each.

    ``density`` is the number of measurements in a square pixel, with the invalid ones; 0 if it is not constant.
    """

    u: np.ndarray
    v: np.ndarray
    distance: np.ndarray
    density: float


class RangeImage(Protocol):
    """Measurements of one sensor in the picture of a camera."""

    @property
    def source(self) -> Source:
        """Kind of the sensor."""
        ...

    @property
    def age_s(self) -> float:
        """Time from the measurement to the picture, without sign."""
        ...

    def samples(self, camera: CameraModel, box: Box, step: float) -> Samples:
        """The measurements in ``box``, about ``step`` pixels of the picture apart if there are more."""
        ...

    def cloud(self, camera: CameraModel) -> np.ndarray:
        """Some thousand measurements in the optical frame of ``camera``: right, down and forward, m, (n, 3)."""
        ...


@dataclass(frozen=True)
class RegisteredDepth:
    """Depth image (``pixels``: mm or m) in the view of the camera, in any resolution."""

    pixels: np.ndarray
    age_s: float = 0.0
    source: Source = "depth"

    def samples(self, camera: CameraModel, box: Box, step: float) -> Samples:
        height, width = self.pixels.shape
        across, down = width / camera.width, height / camera.height
        left, right = (min(max(math.floor(x * across), 0), width) for x in (box[0], box[0] + box[2]))
        top, bottom = (min(max(math.floor(y * down), 0), height) for y in (box[1], box[1] + box[3]))
        step_x, step_y = max(1, int(step * across)), max(1, int(step * down))
        z = depth_in_metres(self.pixels[top:bottom:step_y, left:right:step_x])
        rows, columns = np.nonzero(np.isfinite(z))
        z = z[rows, columns]
        u = (left + columns * step_x + 0.5) / across
        v = (top + rows * step_y + 0.5) / down
        x, y = camera.points(u, v)
        return Samples(u, v, _horizontal(camera, x * z, y * z, z), across * down / (step_x * step_y))

    def cloud(self, camera: CameraModel) -> np.ndarray:
        height, width = self.pixels.shape
        step = max(1, math.ceil(math.sqrt(self.pixels.size / _MOST_CLOUD)))
        z = depth_in_metres(self.pixels[::step, ::step])
        rows, columns = np.nonzero(np.isfinite(z))
        z = z[rows, columns]
        u, v = (columns * step + 0.5) * camera.width / width, (rows * step + 0.5) * camera.height / height
        x, y = camera.points(u, v)
        return np.stack([x * z, y * z, z], axis=1)


@dataclass(frozen=True)
class ProjectedPoints:
    """Points (n, 3) in the optical frame of the camera: right, down and forward, m."""

    points: np.ndarray
    age_s: float = 0.0
    source: Source = "lidar"

    def samples(self, camera: CameraModel, box: Box, step: float) -> Samples:
        x, y, z = self.points.T
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = camera.pixels(x / z, y / z)
        inside = (z > NEAREST_M) & (u >= box[0]) & (u < box[0] + box[2]) & (v >= box[1]) & (v < box[1] + box[3])
        x, y, z = x[inside], y[inside], z[inside]
        return Samples(u[inside], v[inside], _horizontal(camera, x, y, z), 0.0)

    def cloud(self, camera: CameraModel) -> np.ndarray:
        return self.points[:: 1 + len(self.points) // _MOST_CLOUD]


def _horizontal(camera: CameraModel, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    cos, sin = math.cos(camera.pose.roll_rad), math.sin(camera.pose.roll_rad)
    right, down = cos * x - sin * y, sin * x + cos * y
    return np.hypot(right, z * math.cos(camera.pose.pitch_rad) - down * math.sin(camera.pose.pitch_rad))


class Ranged(NamedTuple):
    """Measured distance of a person, and its source."""

    estimate: Estimate
    source: Source


def measure_people(
    images: Sequence[RangeImage], camera: CameraModel, boxes: Sequence[Box], expected: Sequence[Estimate | None]
) -> list[Ranged | None]:
    """Distance of the person in each box (x, y, w, h): horizontal, to the axis of the body.

    The clearest and largest person is measured first. Their measurements are then ignored in the other boxes, unless
    such a box seems to show the same person.

    Args:
        images: Measurements, the preferred ones first.
        boxes: All people in the picture: one may be in front of another.
        expected: Their distances from the picture; None if unknown.

    Returns:
        The distances; None where no sensor measures the person.
    """
    found: list[Ranged | None] = [None] * len(boxes)
    for image in images:
        views = {
            index: _View(image, camera, box, expected[index])
            for index, (box, each) in enumerate(zip(boxes, found, strict=True))
            if each is None and box[2] > 0 and box[3] > 0
        }
        while views:
            index = max(views, key=lambda index: views[index].claim)
            layer = views.pop(index).choice
            if layer is None:
                continue
            value = layer.distance + _BODY_M
            linear, square = _NOISE[image.source]
            noise = math.hypot(linear * value, square * value**2)
            std = math.hypot(layer.std, noise, _BODY_STD_M, _PACE * image.age_s)
            found[index] = Ranged(Estimate(value, std), image.source)
            for other in views.values():
                other.exclude(boxes[index], layer)
    return found


class _Layer(NamedTuple):
    """Measurements of similar distance in a box: score as a person, and size in pixels of the picture."""

    distance: float
    std: float
    score: float
    size: float


def _overlap(box: Box, other: Box) -> float:
    """Intersection over union of two boxes."""
    across = min(box[0] + box[2], other[0] + other[2]) - max(box[0], other[0])
    down = min(box[1] + box[3], other[1] + other[3]) - max(box[1], other[1])
    shared = max(across, 0.0) * max(down, 0.0)
    return shared / max(box[2] * box[3] + other[2] * other[3] - shared, 1e-9)


class _View:
    """Measurements in and around the box of a person, and the layer that is most likely the person."""

    def __init__(self, image: RangeImage, camera: CameraModel, box: Box, expected: Estimate | None) -> None:
        self._source: Source = image.source
        self._camera, self._box, self._expected = camera, box, expected
        x, y, w, h = box
        wide = (x - _BESIDE * w, y - _ABOVE * h, (1 + 2 * _BESIDE) * w, (1 + _ABOVE) * h)
        self._samples = image.samples(camera, wide, max(w, h / 2) / _GRID)
        across, down = (self._samples.u - x) / w, (self._samples.v - y) / h
        self._inside = (across >= 0) & (across < 1) & (down >= 0)
        beside = (down >= 0) & (down < _FEET)
        self._sides = (
            beside & (across < -_GAP),
            beside & (across >= 1 + _GAP),
            (down < -_GAP / 2) & (across >= 0) & (across < 1),
        )
        # The trunk is in the middle of the upper half; the legs have gaps.
        weights = np.clip(1.0 - np.abs(across - 0.5) / 0.45, 0.02, 1.0)
        self._weights = weights * np.where(down < 0.65, 1.0, 0.35) * np.where(down < 0.08, 0.3, 1.0)
        self._whole = float(self._weights[self._inside].sum())
        if self._samples.density and self._whole:
            width = min(x + w, camera.width) - max(x, 0.0)
            height = min(y + h, camera.height) - max(y, 0.0)
            valid = np.count_nonzero(self._inside) / (self._samples.density * width * height)
            self._whole /= min(valid, 1.0)
        self._free = np.ones(self._inside.shape, bool)
        self._same: list[_Layer] = []
        self._layers = self._find()

    @property
    def claim(self) -> float:
        """How well the best layer belongs to this box: a layer in several boxes is of the box with most of it."""
        best = max((*self._layers, *self._same), key=lambda layer: layer.score, default=None)
        return 0.0 if best is None else best.score * best.size

    @property
    def choice(self) -> _Layer | None:
        """The best layer, with an error that includes the doubt about it; None if there is no person in it."""
        layers = sorted((*self._layers, *self._same), key=lambda layer: -layer.score)
        unseen = max(_UNSEEN * math.exp(-np.count_nonzero(self._inside) / _ENOUGH), _LEAST_SCORE)
        if not layers or layers[0].score < unseen:
            return None
        best = layers[0]
        rivals = [(layer.distance, layer.score) for layer in layers[1:]]
        if self._expected is not None:
            rivals.append((self._expected.value - _BODY_M, unseen))
        # With another layer that is nearly as good, the choice is uncertain.
        doubt = 0.0
        for distance, score in rivals:
            odds = (score / best.score) ** 4
            doubt = max(doubt, abs(distance - best.distance) * math.sqrt(odds / (1 + odds)))
        std = math.hypot(best.std, doubt)
        return best._replace(std=std) if std < _MOST_STD * best.distance else None

    def exclude(self, box: Box, layer: _Layer) -> None:
        """Ignore the measurements of another person, of ``layer`` in ``box``, or share them in a box of that person."""
        x, y, w, h = box
        u, v, distances, _ = self._samples
        theirs = (u >= x - _CLAIM * w) & (u < x + (1 + _CLAIM) * w) & (v >= y - _CLAIM * w) & (v < y + h + _CLAIM * w)
        theirs &= self._free & (np.abs(distances - layer.distance) < self._thickness(layer.distance))
        if not theirs.any():
            return
        alone = [each.score for each in self._layers if abs(each.distance - layer.distance) < _LAYER_M]
        if alone:
            # The larger the common part, the less likely are two people.
            self._same.append(layer._replace(score=max(alone) * _overlap(self._box, box) ** 2))
        self._free &= ~theirs
        self._layers = self._find()

    def _thickness(self, distance: float) -> float:
        return _LAYER_M + _LAYER_SHARE[self._source] * distance

    def _find(self) -> list[_Layer]:
        """Layers of the measurements that are not of other people."""
        mine = self._inside & self._free
        order = np.argsort(self._samples.distance[mine])
        distances, weights = self._samples.distance[mine][order], self._weights[mine][order]
        self._around = [np.sort(self._samples.distance[side & self._free]) for side in self._sides]
        least = _LEAST_SAMPLES[self._source]
        layers: list[_Layer] = []
        if distances.size < least:
            return layers
        total = np.concatenate([[0.0], np.cumsum(weights)])
        pixels = self._box[2] * self._box[3] / np.count_nonzero(self._inside)
        for middle in _peaks(distances, weights):
            first = end = 0
            for _ in range(2):
                thickness = self._thickness(middle)
                first, end = np.searchsorted(distances, [middle - thickness, middle + thickness]).tolist()
                if end > first:
                    half = np.searchsorted(total, (total[first] + total[end]) / 2)
                    middle = float(distances[min(max(half - 1, first), end - 1)])
            if end - first < least or any(abs(layer.distance - middle) < _BIN * middle for layer in layers):
                continue
            share = float(total[end] - total[first]) / self._whole
            score = share * _likelihood(self._camera, self._box, middle, self._expected)
            if score < _LEAST_SCORE / 3:
                continue
            # A layer that fills the box cannot be the background of the person in it.
            background = self._continued(middle) * (1.0 - share**4)
            score /= 1.0 + (background / _CONTINUED) ** 2
            spread = float(1.48 * np.median(np.abs(distances[first:end] - middle)))
            layers.append(_Layer(middle, spread / math.sqrt(min(end - first, 9)), score, (end - first) * pixels))
        return layers

    def _continued(self, distance: float) -> float:
        """Share of the surroundings of the box at ``distance``, among those that nothing nearer hides.

        A wall continues on all sides, a person on none.
        """
        thickness, least = self._thickness(distance), _LEAST_SAMPLES[self._source]
        shares: list[float] = []
        for side in self._around:
            first, end = np.searchsorted(side, [distance - thickness, distance + thickness]).tolist()
            if side.size - first >= least:
                shares.append((end - first) / (side.size - first))
        return sum(shares) / len(shares) if shares else 0.0


def _peaks(distances: np.ndarray, weights: np.ndarray) -> list[float]:
    """Distances of which there are many, from a histogram of their logarithms."""
    logs = np.log(np.maximum(distances, NEAREST_M))
    bins = np.floor((logs - logs.min()) / _BIN).astype(int)
    histogram = np.convolve(np.pad(np.bincount(bins, weights), 1), [0.5, 1.0, 0.5], mode="same")
    return [
        math.exp(logs.min() + (index - 0.5) * _BIN)
        for index, value in enumerate(histogram)
        if value > 0 and value == histogram[max(index - 2, 0) : index + 3].max()
    ]


def _likelihood(camera: CameraModel, box: Box, distance: float, expected: Estimate | None) -> float:
    """How well a person at ``distance`` fits the size of the box and the distance ``expected`` from the picture."""
    _, y, w, h = box
    height, width = distance * h / camera.fy, distance * w / camera.fx
    fit = 1.0
    if expected is not None and expected.value > 0:
        prior = math.hypot(_PRIOR, _PRIOR_STDS * expected.std / expected.value)
        apart = math.log((distance + _BODY_M) / expected.value) / prior
        fit = _OUTLIERS + (1.0 - _OUTLIERS) / (1.0 + apart**2)
    if height > _MOST_HEIGHT_M:
        fit *= math.exp(-(((height / _MOST_HEIGHT_M - 1.0) / 0.15) ** 2))
    if width > _MOST_WIDTH_M:
        fit *= 0.3
    cut = y <= 1 or y + h >= camera.height - 1
    if not cut and height < _LEAST_HEIGHT_M:
        fit *= math.exp(-(((_LEAST_HEIGHT_M / height - 1.0) / 0.4) ** 2))
    return fit
