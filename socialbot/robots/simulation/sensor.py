"""Image sensor of the simulated camera: blur of the lens, and shot and read noise."""

from __future__ import annotations

import random
from statistics import NormalDist

import cv2
import numpy as np

_READ_E = 3.0  # Read noise in electrons, as of a small CMOS sensor.
_MID_GREY = 128


class ImageSensor:
    """Adds what a real camera adds to drawn pictures.

    The noise of each channel of each pixel is independent and normal. Shot noise grows with the square root of the
    light; read noise does not depend on it. The transfer curve of sRGB follows.

    Args:
        noise: Standard deviation of the noise of mid-grey pixels, grey levels; 0: none.
        blur_px: Standard deviation of the blur, px; 0: none.
        seed: Random seed.
    """

    def __init__(self, *, noise: float, blur_px: float, seed: int = 0) -> None:
        self._blur_px, self._seed = blur_px, seed
        self._deviations = deviations_of(noise).astype(np.float32) if noise > 0 else None
        # Random bytes become normal by the quantiles of the normal distribution.
        normal = np.array([NormalDist().inv_cdf((byte + 0.5) / 256) for byte in range(256)])
        self._normal = (normal / normal.std()).astype(np.float32)

    def expose(self, picture: np.ndarray, time_ns: int) -> np.ndarray:
        """Return the picture, shape (height, width, 3), uint8, with the blur and with the noise of this time."""
        if self._blur_px > 0:
            picture = cv2.GaussianBlur(picture, (0, 0), self._blur_px)
        if self._deviations is None:
            return picture
        levels = random.Random(f"{self._seed} {time_ns}").randbytes(picture.size)
        noise = cv2.LUT(np.frombuffer(levels, np.uint8).reshape(picture.shape), self._normal)
        return cv2.add(picture, noise * cv2.LUT(picture, self._deviations), dtype=cv2.CV_8U)


def deviations_of(noise: float) -> np.ndarray:
    """Standard deviations of the 256 grey levels, shape (256,), of a sensor with this ``noise`` at mid-grey."""
    grey = np.arange(256) / 255
    light = np.where(grey <= 0.04045, grey / 12.92, ((grey + 0.055) / 1.055) ** 2.4)
    slope = np.gradient(light)
    # The electrons of a white pixel solve: noise^2 = (light * white_e + read_e^2) / (white_e * slope)^2.
    square = (noise * slope[_MID_GREY]) ** 2
    white_e = (light[_MID_GREY] + np.sqrt(light[_MID_GREY] ** 2 + 4 * square * _READ_E**2)) / (2 * square)
    return np.sqrt(light * white_e + _READ_E**2) / white_e / slope
