"""Lens distortion: the direction of a pixel of an image that is not rectified, and the pixel of a direction.

Points are on the plane at distance 1 before the camera, x to the right and y down: those of an ideal pinhole are
straight, those of the lens are bent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from socialbot.core.errors import MessageError
from socialbot.core.messages import CameraInfo

_FISHEYE = ("equidistant", "fisheye", "kannala_brandt", "kannala_brandt4")
LENS_MODELS = ("plumb_bob", "rational_polynomial", "brown_conrady", *_FISHEYE)
"""The distortion models that are known; recordings of librealsense name them in words, such as ``Brown Conrady``."""
_COUNTS, _FISHEYE_COUNTS = (4, 5, 8, 12, 14), (0, 4)
"""Possible numbers of coefficients. Drivers publish a plumb_bob with eight, too: its number tells its meaning."""

_WIDEST_RAD = 1.5  # Directions farther aside have no place on the plane.
_ANGLES = np.linspace(0.0, _WIDEST_RAD, 1000)
_ITERATIONS = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-9)
_EYE = np.eye(3)


def is_known(info: CameraInfo) -> bool:
    """Whether the distortion model of ``info`` is known, or there is no distortion."""
    return _model(info) in LENS_MODELS or not any(info.d)


def _model(info: CameraInfo) -> str:
    return info.distortion_model.lower().replace(" ", "_")


@dataclass(frozen=True)
class Lens:
    """Lens of a camera whose images are not rectified.

    Args:
        fisheye: Whether the model is equidistant, of four coefficients; otherwise it is plumb_bob, or
            rational_polynomial.
        coefficients: The distortion of the CameraInfo.
    """

    fisheye: bool
    coefficients: tuple[float, ...]

    @classmethod
    def of(cls, info: CameraInfo) -> Lens | None:
        """The lens of ``info``; None for a straight one, and for an unknown distortion model.

        Raises:
            MessageError: The model has another number of coefficients, or one is not finite.
        """
        fisheye = _model(info) in _FISHEYE
        if not is_known(info) or not (fisheye or any(info.d)):
            return None
        counts = _FISHEYE_COUNTS if fisheye else _COUNTS
        count = max((each for each in counts if each <= len(info.d)), default=-1)
        # Some drivers publish further coefficients, which are 0.
        if count < 0 or any(info.d[count:]) or not all(map(math.isfinite, info.d)):
            raise MessageError(
                f"d = {list(info.d)} is no distortion of the model {info.distortion_model}",
                where=f"camera_info of {info.frame_id or 'a camera without a frame'}",
                remedy=f"calibrate the camera: the model has {' or '.join(map(str, counts))} finite coefficients",
            )
        return cls(fisheye, tuple(info.d[:count]) or (0.0,) * 4)

    @cached_property
    def _radii(self) -> np.ndarray:
        """Bent radii of `_ANGLES`, which end where the model folds back."""
        d = np.array(self.coefficients)
        if self.fisheye:
            radii = _ANGLES * (1 + np.polyval([*d[::-1], 0.0], _ANGLES**2))
        else:
            straight = np.tan(_ANGLES)
            k = np.zeros(8)
            k[: min(len(d), 8)] = d[:8]
            square = straight**2
            up, down = (np.polyval([c, b, a, 1.0], square) for a, b, c in ((k[0], k[1], k[4]), tuple(k[5:8])))
            radii = straight * up / np.where(down > 0, down, np.inf)
        falls = np.diff(radii) <= 0
        return radii[: int(np.argmax(falls)) + 1] if falls.any() else radii

    @property
    def widest_rad(self) -> float:
        """Largest angle to the optical axis at which the model is valid."""
        return float(_ANGLES[len(self._radii) - 1])

    def straightened(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Straight points of bent ones, of any shape. Points beyond the widest angle are moved to it."""
        radius = np.hypot(x, y)
        radii = self._radii
        safe = np.maximum(radius, 1e-12)
        if self.fisheye:
            factor = np.where(radius > 1e-9, np.tan(np.interp(radius, radii, _ANGLES[: len(radii)])) / safe, 1.0)
            return x * factor, y * factor
        inside = np.minimum(1.0, 0.999 * radii[-1] / safe)
        bent = np.stack([x * inside, y * inside], axis=-1).reshape(-1, 1, 2).astype(np.float64)
        if not len(bent):
            return x, y
        found = cv2.undistortPointsIter(bent, _EYE, np.array(self.coefficients), _EYE, _EYE, _ITERATIONS)
        found = found.reshape(*np.shape(x), 2)
        return found[..., 0], found[..., 1]

    def bent(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bent points of straight ones, of any shape; NaN beyond the widest angle."""
        radius = np.hypot(x, y)
        outside = ~(np.arctan(radius) <= self.widest_rad)
        if self.fisheye:
            bent = np.interp(np.arctan(radius), _ANGLES[: len(self._radii)], self._radii)
            factor = np.where(outside, np.nan, np.where(radius > 1e-9, bent / np.maximum(radius, 1e-12), 1.0))
            return x * factor, y * factor
        flat = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3).astype(np.float64)
        flat[outside.reshape(-1)] = 0.0, 0.0, 1.0
        if not len(flat):
            return x, y
        found, _ = cv2.projectPoints(flat, np.zeros(3), np.zeros(3), _EYE, np.array(self.coefficients))
        found = np.where(outside[..., None], np.nan, found.reshape(*np.shape(x), 2))
        return found[..., 0], found[..., 1]
