"""Distances of people from depth images and point clouds.

A box also contains background, occluders, holes and, at edges, pixels between two depths. So the distances in the
middle of the box are sorted into layers. The layer of the person has many of the samples, a plausible size for a
person, and agrees with the distance from the image.
"""

from __future__ import annotations

import logging
import math
import struct
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Protocol, TypeVar

import cv2
import numpy as np

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.errors import ImageError
from socialbot.core.messages import (
    CameraInfo,
    CompressedDepth,
    CompressedImage,
    DepthImage,
    DepthInfo,
    Image,
    Message,
    PointCloud,
    Transforms,
)
from socialbot.vision.camera import Box, CameraModel, CameraPose
from socialbot.vision.camera_pose import base_frames, pose_from_transforms
from socialbot.vision.distance import Estimate
from socialbot.vision.images import MOST_PIXELS
from socialbot.vision.transforms import AXES, OPTICAL, Matrix, TransformTree, parse_pose

log = logging.getLogger("socialbot.depth")

M = TypeVar("M", bound=Message)
Source = Literal["depth", "lidar"]

NEAREST_M, FARTHEST_M = 0.15, 80.0
"""Range of valid measurements."""

_MM = 0.001
_NO_RETURN = 65535
_PNG = b"\x89PNG\r\n\x1a\n"
_CONFIG = struct.Struct("<iff")  # Format, and two parameters of the quantisation.
_POINT_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def depth_from_image(image: Image) -> np.ndarray:
    """Decode a depth image: shape (height, width), float32, metres along the optical axis; NaN: no measurement.

    Raises ImageError for another encoding, or a size that the data does not fill.
    """
    return _metres(_raw_depth(image))


def _raw_depth(image: Image) -> np.ndarray:
    """Pixels of a depth image in their own type and byte order, without a copy."""

    def refused(what: str) -> ImageError:
        return ImageError(
            what,
            where=f"{image.encoding} depth image of {image.width}x{image.height}",
            remedy="have the depth camera publish 16UC1 (mm) or 32FC1 (m)",
        )

    kind = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}.get(image.encoding)
    if kind is None:
        raise refused(f"no depth encoding: {image.encoding!r}")
    dtype = np.dtype(kind).newbyteorder(">" if image.is_bigendian else "<")
    used = image.width * dtype.itemsize
    data = np.ascontiguousarray(image.data, np.uint8).reshape(-1)
    if min(image.width, image.height) < 1 or image.step < used or data.size < (image.height - 1) * image.step + used:
        raise refused(f"{data.size} bytes do not fill it with rows of {image.step} bytes")
    return np.ndarray((image.height, image.width), dtype, data.data, strides=(image.step, dtype.itemsize))


def _metres(raw: np.ndarray) -> np.ndarray:
    """Depth in metres, NaN where there is none, of integers in mm or floats in m."""
    if raw.dtype.kind == "u":
        metres = raw.astype(np.float32) * np.float32(_MM)
        metres[raw == _NO_RETURN] = np.nan
    else:
        metres = raw.astype(np.float32)
    with np.errstate(invalid="ignore"):
        metres[~((metres >= NEAREST_M) & (metres <= FARTHEST_M))] = np.nan
    return metres


def depth_from_compressed(image: CompressedImage) -> np.ndarray:
    """Decode a compressed depth image as `depth_from_image` does.

    ``format`` is that of compressed_depth_image_transport ("16UC1; compressedDepth", "32FC1; compressedDepth rvl",
    "passthrough; compressedDepth"), or of a 16-bit PNG ("16UC1; png compressed").

    Raises ImageError for another format, a damaged file, and more than `MOST_PIXELS`.
    """
    return _metres(_unpacked(image))


def _unpacked(image: CompressedImage) -> np.ndarray:
    def refused(what: str, remedy: str = "check the depth camera and its driver") -> ImageError:
        return ImageError(what, where=f"depth of format {image.format!r}, {image.data.size} bytes", remedy=remedy)

    data = np.ascontiguousarray(image.data, np.uint8).reshape(-1).tobytes()
    encoding, _, codec = image.format.partition(";")
    first, second = 0.0, 0.0
    if not data.startswith(_PNG) and len(data) > _CONFIG.size:
        _, first, second = _CONFIG.unpack_from(data)
        data = data[_CONFIG.size :]
    if data.startswith(_PNG):
        pixels = _png(data, refused)
    elif "jpeg" in codec.lower() or data.startswith(b"\xff\xd8"):
        raise refused("JPEG destroys depth", "record the raw topic or compressedDepth")
    elif "rvl" in codec.lower():
        pixels = _rvl(data, refused)
    else:
        raise refused("neither PNG nor RVL", "record the raw topic, or compressedDepth as png or rvl")
    encoding = encoding.strip()
    quantised = encoding == "32FC1" or (encoding not in ("16UC1", "mono16") and first > 0)
    if not quantised:
        return pixels
    if not (math.isfinite(first) and math.isfinite(second) and first > 0):
        raise refused(f"the quantisation {first:g}, {second:g} is invalid")
    levels = pixels.astype(np.float32) - np.float32(second)
    metres = np.full(pixels.shape, np.nan, np.float32)
    return np.divide(np.float32(first), levels, out=metres, where=(pixels > 0) & (levels > 0))


class _Refusal(Protocol):
    def __call__(self, what: str, remedy: str = ..., /) -> ImageError: ...


def _png(data: bytes, refused: _Refusal) -> np.ndarray:
    width, height = struct.unpack_from(">II", data, 16) if len(data) >= 24 else (0, 0)
    if width * height > MOST_PIXELS:
        raise refused(f"{width}x{height} pixels are too many", "use a lower resolution")
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if b"IEND" in data[-12:] else None
    except cv2.error:
        pixels = None
    if pixels is None:
        raise refused("the PNG is damaged")
    if pixels.ndim != 2 or pixels.dtype != np.uint16:
        raise refused(f"a PNG of {pixels.dtype} and {pixels.ndim - 1} dimensions is no depth image")
    return pixels


def _rvl(data: bytes, refused: _Refusal) -> np.ndarray:
    """Decode run-length and variable-length coded depth: differences of neighbours in groups of 3 bits."""
    width, height = struct.unpack_from("<II", data) if len(data) >= 8 else (0, 0)
    count = width * height
    if not 0 < count <= MOST_PIXELS:
        raise refused(f"{width}x{height} pixels cannot be")
    words = np.frombuffer(data[8 : 8 + (len(data) - 8) // 4 * 4], "<u4").byteswap().view(np.uint8)
    nibbles = np.empty(2 * words.size, np.uint8)
    nibbles[0::2], nibbles[1::2] = words >> 4, words & 15
    # Each number ends at a nibble without the continuation bit.
    ends = np.flatnonzero(nibbles < 8)
    starts = np.concatenate([[0], ends[:-1] + 1])
    if not ends.size or (ends - starts).max() > 10:
        raise refused("the RVL data is damaged")
    places = np.arange(ends[-1] + 1) - np.repeat(starts, ends - starts + 1)
    numbers = np.add.reduceat((nibbles[: ends[-1] + 1] & 7).astype(np.int64) << (3 * places), starts)
    pixels = np.zeros(count, np.int64)
    at = index = 0
    last = 0
    while at < count and index + 1 < numbers.size:
        zeros, filled = int(numbers[index]), int(numbers[index + 1])
        index += 2
        at += zeros
        codes = numbers[index : index + filled]
        if codes.size < filled or at + filled > count:
            break
        values = last + np.cumsum((codes >> 1) ^ -(codes & 1))
        pixels[at : at + filled] = values
        last = int(values[-1]) if filled else last
        index, at = index + filled, at + filled
    if at < count:
        raise refused("the RVL data is damaged")
    return pixels.astype(np.uint16).reshape(height, width)


def points_of(cloud: PointCloud) -> np.ndarray:
    """Points of a cloud in its frame: shape (n, 3), float32, metres, without invalid ones.

    Raises ImageError without fields x, y and z, or for a size that the data does not fill.
    """

    def refused(what: str) -> ImageError:
        where = f"point cloud of {cloud.width}x{cloud.height} in {cloud.frame_id!r}"
        return ImageError(what, where=where, remedy="check the driver of the lidar or depth camera")

    fields = {each.name: each for each in cloud.fields}
    types = {name: _POINT_TYPES.get(fields[name].datatype) for name in "xyz" if name in fields}
    if len(types) < 3 or None in types.values():
        raise refused(f"no fields x, y, z among {', '.join(fields) or 'none'}")
    count = cloud.width * cloud.height
    if not count:
        return np.empty((0, 3), np.float32)
    order = ">" if cloud.is_bigendian else "<"
    kinds = {name: np.dtype(f"{order}{kind}") for name, kind in types.items()}
    end = max(fields[name].offset + kind.itemsize for name, kind in kinds.items())
    data = np.ascontiguousarray(cloud.data, np.uint8).reshape(-1)
    row = cloud.row_step if cloud.height > 1 else cloud.width * cloud.point_step
    needed = (cloud.height - 1) * row + (cloud.width - 1) * cloud.point_step + end
    if end > cloud.point_step or row < cloud.width * cloud.point_step or data.size < needed:
        raise refused(f"{data.size} bytes do not fill it with points of {cloud.point_step} bytes")
    points = np.empty((cloud.height, cloud.width, 3), np.float32)
    for axis, (name, kind) in enumerate(kinds.items()):
        view = np.ndarray((cloud.height, cloud.width), kind, data.data, fields[name].offset, (row, cloud.point_step))
        points[..., axis] = view
    points = points.reshape(-1, 3)
    return points[np.isfinite(points).all(axis=1) & (np.abs(points) < FARTHEST_M).all(axis=1)]


# Distances of people

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
        z = _metres(self.pixels[top:bottom:step_y, left:right:step_x])
        rows, columns = np.nonzero(np.isfinite(z))
        z = z[rows, columns]
        u = (left + columns * step_x + 0.5) / across
        v = (top + rows * step_y + 0.5) / down
        x, y = (u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z
        return Samples(u, v, _horizontal(camera, x, y, z), across * down / (step_x * step_y))


@dataclass(frozen=True)
class ProjectedPoints:
    """Points (n, 3) in the optical frame of the camera: right, down and forward, m."""

    points: np.ndarray
    age_s: float = 0.0
    source: Source = "lidar"

    def samples(self, camera: CameraModel, box: Box, step: float) -> Samples:
        x, y, z = self.points.T
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = camera.cx + camera.fx * x / z, camera.cy + camera.fy * y / z
        inside = (z > NEAREST_M) & (u >= box[0]) & (u < box[0] + box[2]) & (v >= box[1]) & (v < box[1] + box[3])
        x, y, z = x[inside], y[inside], z[inside]
        return Samples(u[inside], v[inside], _horizontal(camera, x, y, z), 0.0)


def _horizontal(camera: CameraModel, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    cos, sin = math.cos(camera.roll_rad), math.sin(camera.roll_rad)
    right, down = cos * x - sin * y, sin * x + cos * y
    return np.hypot(right, z * math.cos(camera.pitch_rad) - down * math.sin(camera.pitch_rad))


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


# Synchronisation

TOLERANCE_S = 0.15
"""Largest difference of the stamps of a picture and a measurement."""
_KEPT_S = 3.0
_KEPT_IMAGES, _KEPT_CLOUDS = 20, 5
_SAME = 0.03
_PLACED_NS = 2 * SECOND  # Transforms that place the camera come within this time of its first image.
"""Largest relative difference of the intrinsics of a registered depth image and the picture."""
_MOST_POINTS = 120_000


@dataclass
class DepthSensors:
    """Latest depth images, point clouds and transforms of a robot, for pictures by stamp.

    Args:
        tolerance_s: Largest difference of the stamps of a picture and a measurement.
    """

    tolerance_s: float = TOLERANCE_S
    _depth: deque[Image | CompressedImage] = field(default_factory=deque, init=False)
    _clouds: deque[PointCloud] = field(default_factory=deque, init=False)
    _info: CameraInfo | None = field(default=None, init=False)
    _transforms: TransformTree = field(default_factory=TransformTree, init=False)
    _pose: Matrix | None = field(default=None, init=False)
    _warned: set[str] = field(default_factory=set, init=False)
    _unplaced_since: int = field(default=2**62, init=False)

    def set_pose(self, text: str) -> None:
        """Set the pose of the sensor, for frames without a transform.

        ``text`` is "x y z roll pitch yaw" in the camera's forward, left and up axes, m and rad; empty if unknown.
        Raises ParameterError for another text.
        """
        self._pose = parse_pose(text) if text else None

    def take(self, message: Message) -> None:
        """Keep a message of a sensor, or transforms."""
        if isinstance(message, Transforms):
            self._transforms.add(message.transforms)
        elif isinstance(message, DepthInfo):
            self._info = message
        elif isinstance(message, (DepthImage, CompressedDepth)):
            _keep(self._depth, message, _KEPT_IMAGES)
        elif isinstance(message, PointCloud):
            _keep(self._clouds, message, _KEPT_CLOUDS)

    def camera_pose(self, frame_id: str, stamp: int) -> CameraPose | None:
        """Pose of the camera ``frame_id`` at ``stamp`` (ns) by the transforms; None, logged once, if they lack it."""
        pose = pose_from_transforms(self._transforms, frame_id, stamp)
        if pose is not None or not (bases := base_frames(self._transforms)):
            return pose
        self._unplaced_since = min(self._unplaced_since, stamp)
        if stamp - self._unplaced_since > _PLACED_NS:
            self._warn(
                f"the transforms do not place the camera {frame_id!r} above the floor of {bases[0]}: its pose is "
                "estimated from people; check frame_id of the images, and /tf_static"
            )
        return None

    def at(self, stamp: int, frame_id: str, camera: CameraModel) -> tuple[RangeImage, ...]:
        """Measurements for the picture of ``stamp`` (ns) in ``frame_id``; unusable ones are logged once."""
        images: list[RangeImage | None] = []
        depth, cloud = _nearest(self._depth, stamp), _nearest(self._clouds, stamp)
        try:
            if depth is not None and abs(depth.stamp - stamp) <= nanoseconds(self.tolerance_s):
                images.append(self._depth_image(depth, frame_id, camera, abs(depth.stamp - stamp) / SECOND))
            if cloud is not None and abs(cloud.stamp - stamp) <= nanoseconds(self.tolerance_s):
                images.append(self._cloud(cloud, frame_id, camera, abs(cloud.stamp - stamp) / SECOND))
        except ImageError as error:
            self._warn(str(error))
        return tuple(image for image in images if image is not None)

    def _depth_image(
        self, message: Image | CompressedImage, frame_id: str, camera: CameraModel, age_s: float
    ) -> RangeImage | None:
        pixels = _raw_depth(message) if isinstance(message, Image) else _unpacked(message)
        same_frame = not message.frame_id or not frame_id or message.frame_id.lstrip("/") == frame_id.lstrip("/")
        intrinsics = self._intrinsics(pixels.shape[1], pixels.shape[0])
        if intrinsics is None:
            same_view = abs(pixels.shape[1] * camera.height / (pixels.shape[0] * camera.width) - 1) < _SAME
        else:
            same_view = _is_same_view(intrinsics, camera)
        if same_view and (same_frame or intrinsics is not None):
            # An aligned image has the intrinsics of the picture, whatever its frame is called.
            return RegisteredDepth(pixels, age_s)
        to_camera = np.eye(4) if same_frame else self._to_camera(message.frame_id, frame_id, message.stamp, "depth")
        if to_camera is None:
            return None
        if intrinsics is None:
            self._warn(
                f"depth images in {message.frame_id} are not registered to {frame_id} and have no camera_info: "
                "they are not used; record the camera_info of the depth camera, or the registered depth topic"
            )
            return None
        return ProjectedPoints(_transformed(_points(pixels, intrinsics), to_camera), age_s, "depth")

    def _cloud(self, message: PointCloud, frame_id: str, camera: CameraModel, age_s: float) -> RangeImage | None:
        same_frame = message.frame_id.lstrip("/") == frame_id.lstrip("/")
        to_camera = np.eye(4) if same_frame else self._to_camera(message.frame_id, frame_id, message.stamp, "points")
        if to_camera is None:
            return None
        points = points_of(message)
        points = points[:: 1 + len(points) // _MOST_POINTS]
        # An organised cloud comes from a depth camera.
        source: Source = "depth" if message.height > 1 and OPTICAL.search(message.frame_id) else "lidar"
        return ProjectedPoints(_transformed(points, to_camera), age_s, source)

    def _intrinsics(self, width: int, height: int) -> CameraModel | None:
        """Intrinsics of the depth camera for an image of ``width`` x ``height`` pixels, if known and valid."""
        info = self._info
        if info is None or len(info.k) != 9 or not (info.k[0] > 0 and info.k[4] > 0 and info.width and info.height):
            return None
        return CameraModel.from_info(info).scaled(width, height)

    def _to_camera(self, sensor: str, camera: str, stamp: int, what: str) -> Matrix | None:
        """Transform from the frame ``sensor`` to the optical axes of ``camera``; None, with a warning, if unknown."""
        found = self._transforms.lookup(camera, sensor, stamp)
        sensor_is_optical = what == "depth" or OPTICAL.search(sensor) is not None
        if found is not None:
            # Some drivers name the body frame of a camera, whose z axis points up, as that of its images.
            upright = found[2, 2] > 0.7 and not sensor_is_optical and not OPTICAL.search(camera)
            return AXES @ found if upright else found
        if self._pose is not None:
            return AXES @ self._pose @ (AXES.T if sensor_is_optical else np.eye(4))
        self._warn(
            f"{what} in {sensor or 'a frame without a name'}: no transform to {camera or 'the camera'} is known, so "
            "they are not used; record /tf and /tf_static (over ROS, install the package tf2_msgs), or set depth_pose"
        )
        return None

    def _warn(self, text: str) -> None:
        if text not in self._warned:
            self._warned.add(text)
            log.warning("%s", text)


def _nearest(kept: Iterable[M], stamp: int) -> M | None:
    return min(kept, key=lambda each: abs(each.stamp - stamp), default=None)


def _keep(kept: deque[Any], message: Message, most: int) -> None:
    if kept and message.stamp < kept[-1].stamp - nanoseconds(_KEPT_S):
        kept.clear()  # a new recording
    kept.append(message)
    while len(kept) > most or kept[0].stamp < message.stamp - nanoseconds(_KEPT_S):
        kept.popleft()


def _is_same_view(depth: CameraModel, camera: CameraModel) -> bool:
    scaled = depth.scaled(camera.width, camera.height)
    pairs = ((scaled.fx, camera.fx, camera.fx), (scaled.fy, camera.fy, camera.fy))
    centres = ((scaled.cx, camera.cx, camera.width), (scaled.cy, camera.cy, camera.height))
    return all(abs(one - other) < _SAME * size for one, other, size in (*pairs, *centres))


def _points(pixels: np.ndarray, intrinsics: CameraModel) -> np.ndarray:
    """Points (n, 3) of a depth image in its optical frame."""
    step = 1 + int(math.sqrt(pixels.size / _MOST_POINTS))
    z = _metres(pixels[::step, ::step])
    rows, columns = np.nonzero(np.isfinite(z))
    z = z[rows, columns]
    x = (columns * step + 0.5 - intrinsics.cx) / intrinsics.fx * z
    y = (rows * step + 0.5 - intrinsics.cy) / intrinsics.fy * z
    return np.stack([x, y, z], axis=1)


def _transformed(points: np.ndarray, matrix: Matrix) -> np.ndarray:
    return points @ matrix[:3, :3].T.astype(np.float32) + matrix[:3, 3].astype(np.float32)
