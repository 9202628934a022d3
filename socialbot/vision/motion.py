"""Motion in the image: of a person, as Kalman filters of a box, and of the camera."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from socialbot.vision.camera import CameraModel
from socialbot.vision.detector import iou

_EDGE_SHARE, _BOX_SHARE = 0.005, 0.02  # A box this near to an edge is cut off: shares of image and box size.

# Noise of middle, top, height and width, relative to the height: measurement, first speed, change of speed per
# second; and the time constants of the speeds, s.
_MEASURED = np.array([0.03, 0.03, 0.05, 0.06])
_FIRST_SPEED = np.array([0.8, 0.2, 0.5, 0.3])
_RESTLESS = np.array([0.8, 0.15, 0.35, 0.2])
_EASE_S = np.array([1.5, 0.7, 0.7, 0.4])
_LEAST_PX = 1.0
_PLACE, _ASIDE = 0.25, 0.35  # A person who stands is found again this near, up or down, and aside: heights.
_STANDING = 0.12  # Speed of people who stand, heights per second: they turn and sway.
_HEAD_JUMP = 0.35  # Between images, heads move up or down by less than this share of the height.


class Cut(NamedTuple):
    """Sides of a box that the image edge cuts off."""

    left: bool = False
    top: bool = False
    right: bool = False
    bottom: bool = False


def cut_off(box: np.ndarray, width: float, height: float) -> Cut:
    """The sides of ``box`` (x, y, w, h) that an image of ``width`` x ``height`` pixels cuts off."""
    x, y, w, h = box.tolist()
    across, down = _EDGE_SHARE * width + _BOX_SHARE * w, _EDGE_SHARE * height + _BOX_SHARE * h
    return Cut(x <= across, y <= down, x + w >= width - across, y + h >= height - down)


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

    def shift(self, turn: np.ndarray, place: np.ndarray | None = None) -> None:
        """Move the state with the background, by a homography (3, 3), or as far as it moves a ``place``."""
        if place is not None:
            self.value[:2] += moved(turn, place[None])[0] - place
            return
        middle, top, height, width = self.value
        centre = top + height / 2
        sides = [(middle, top), (middle, top + height), (middle - width / 2, centre), (middle + width / 2, centre)]
        head, feet, left, right = moved(turn, np.array(sides))
        self.value = np.array([*head, math.dist(head, feet), math.dist(left, right)])

    def is_at(self, box: np.ndarray, cut: Cut) -> bool:
        """Whether a person who stood at the last place may be the one in ``box``, which the image may cut off."""
        middle, top, height, _ = self.value
        x, y, w, h = box
        same_top = cut.top or abs(y - top) <= _PLACE * height
        same_end = cut.bottom or abs(y + h - top - height) <= _PLACE * height
        return bool(self.is_standing() and same_top and same_end and abs(x + w / 2 - middle) <= _ASIDE * height)

    def is_standing(self) -> bool:
        """Whether the person does not walk across the image."""
        return bool(abs(self.speed[0]) <= _STANDING * self.value[2])

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


def moved(turn: np.ndarray, points: np.ndarray) -> np.ndarray:
    """``points`` (n, 2) after a homography (3, 3)."""
    moved = points @ turn[:, :2].T + turn[:, 2]
    return moved[:, :2] / moved[:, 2:]


_SMALL = 160  # The background is followed at this width.
_CORNERS, _QUALITY, _APART, _WINDOW, _LEVELS = 40, 0.02, 6.0, (11, 11), 3
_LEAST_CORNERS, _LEAST_SHARE = 8, 0.4  # The motion is known if so many corners, and this share of them, agree on it.
_TOLERANCE, _STILL = 0.7, 0.15  # Pixels at that width.


_AGREED, _AGREED_SHARE = 1.5, 0.25  # Difference of stated and seen motion: pixels at that width, share of the path.

_NO_TURN = np.eye(3)


class CameraMotion:
    """Motion of the background from image to image: the stated turn of the camera, or from corners outside of people.

    A stated turn is exact up to the edges of the image, and known where there are no corners. Where the corners
    contradict it, they count: the base of the robot turns as well, or the transforms are late.

    Attributes:
        contradicted: Whether the last two images showed another turn than the stated one.
    """

    def __init__(self) -> None:
        self.contradicted = False
        self._camera: CameraModel | None = None
        self._grey: np.ndarray | None = None
        self._corners: np.ndarray | None = None

    def follow(self, image: np.ndarray, boxes: np.ndarray, camera: CameraModel | None = None) -> np.ndarray | None:
        """Homography from the last image to this one, shape (3, 3); None if it is still or unknown.

        Args:
            image: Grey levels, shape (height, width), uint8.
            boxes: People, (n, 4) as x, y, w, h in pixels; they are left out when this image is the last one.
            camera: The camera as stated, with its direction if that is known.
        """
        seen = self._seen(image, boxes)
        before, self._camera = self._camera, camera
        stated = None if camera is None or before is None else camera.turn_from(before)
        self.contradicted = False
        if camera is not None and stated is not None:
            scale, middle = _SMALL / camera.width, np.array([[camera.width / 2, camera.height / 2]])
            there = moved(stated, middle)[0]
            path = math.dist(there, middle[0]) * scale
            apart = 0.0 if seen is None else math.dist(there, moved(seen, middle)[0]) * scale
            self.contradicted = apart > _AGREED + _AGREED_SHARE * path
            if path >= _STILL and not self.contradicted:
                return stated
        return None if seen is not None and (seen == _NO_TURN).all() else seen

    def _seen(self, image: np.ndarray, boxes: np.ndarray) -> np.ndarray | None:
        """Similarity transform (3, 3) that moves the corners of the last image; None if it is unknown."""
        height, width = image.shape
        scale = _SMALL / width
        size = _SMALL, max(1, round(height * scale))
        step = max(1, width // (2 * _SMALL))
        grey = cv2.resize(image[::step, ::step], size, interpolation=cv2.INTER_AREA)
        before, corners = self._grey, self._corners
        free = np.full(grey.shape, 255, np.uint8)
        for x, y, right, bottom in np.hstack([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]]) * scale:
            free[max(0, int(y)) : math.ceil(bottom), max(0, int(x)) : math.ceil(right)] = 0
        self._grey, self._corners = grey, cv2.goodFeaturesToTrack(grey, _CORNERS, _QUALITY, _APART, mask=free)
        if before is None or before.shape != grey.shape or corners is None or len(corners) < _LEAST_CORNERS:
            return None
        there, found, _ = cv2.calcOpticalFlowPyrLK(
            before, grey, corners, corners.copy(), winSize=_WINDOW, maxLevel=_LEVELS
        )
        good = found[:, 0] > 0
        if good.sum() < _LEAST_CORNERS:
            return None
        # numpy's own median takes ten times as long. Those of x and y make the number of values even.
        away = np.sort(np.abs(there - corners)[good], axis=None)
        if away[len(away) // 2 - 1 : len(away) // 2 + 1].sum() / 2 < _STILL:
            return _NO_TURN
        turn, same = cv2.estimateAffinePartial2D(corners[good], there[good], ransacReprojThreshold=_TOLERANCE)
        if turn is None or same.sum() < max(_LEAST_CORNERS, _LEAST_SHARE * len(corners)):
            return None
        turn[:, 2] /= scale
        return np.vstack([turn, (0.0, 0.0, 1.0)])
