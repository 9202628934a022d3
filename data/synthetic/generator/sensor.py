"""What happens behind the lens: a gain that follows the light within about a second, a curve, blur and noise.

And a depth camera of the kind that projects a pattern: it measures disparities, and sees nothing in the projector's
shadow.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from pictures import brightness

GREY, BRIGHTEST = 0.30, 1.5
WILL = 0.75  # how far a change of light is made up for: a dim corridor stays dimmer than a bright one
LEAST, MOST = 0.35, 5.0
LAG = 0.35  # s
KNEE = 0.75
BASE = 39.4  # px m: disparity at a depth of 1 m
SPREAD, STEP = 0.06, 0.25  # px: noise of a disparity, and the steps in which it is measured
GRAIN = 3.0  # px
REACH = (0.4, 9.0)  # m


def centred(height: int, width: int) -> np.ndarray:
    """Weights of metering (h, w): the middle counts three times as much as the edges."""
    v, u = np.mgrid[0:height, 0:width]
    away = np.hypot((u + 0.5) / width - 0.5, (v + 0.5) / height - 0.5) / math.hypot(0.5, 0.5)
    weights = 3.0 - 2.0 * away
    return weights / weights.sum()


class Exposure:
    """The gain over time."""

    def __init__(self) -> None:
        """Takes the first picture's gain at once."""
        self.gain: float | None = None

    def wanted(self, light: np.ndarray) -> float:
        """The gain that suits a picture."""
        level = float((np.minimum(brightness(light), BRIGHTEST) * centred(*light.shape[:2])).sum())
        return min(max((GREY / max(level, 1e-4)) ** WILL, LEAST), MOST)

    def step(self, light: np.ndarray, seconds: float) -> float:
        """The gain for this picture, seconds after the last one."""
        wanted = self.wanted(light)
        if self.gain is None:
            self.gain = wanted
        else:
            self.gain *= (wanted / self.gain) ** (1 - math.exp(-seconds / LAG))
        return self.gain


def developed(light: np.ndarray, gain: float) -> np.ndarray:
    """Grey values 0 to 255 (float): a straight line with a soft shoulder, then the usual gamma."""
    x = light * gain
    x = np.where(x < KNEE, x, 1 - (1 - KNEE) * np.exp(-(x - KNEE) / (1 - KNEE)))
    return 255 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-6) ** (1 / 2.4) - 0.055)


def noisy(picture: np.ndarray, seed: int, amount: float) -> np.ndarray:
    """Sensor noise (grey levels): grows with brightness, a little blurred by demosaicing, another for each seed."""
    rng = np.random.default_rng(seed)
    grain = rng.normal(0, 1, picture.shape) * 0.4 + rng.normal(0, 1, picture.shape[:2])[:, :, None]
    grain = cv2.GaussianBlur(grain, (3, 3), 0.6) * amount * (0.6 + picture / 255)
    return np.clip(picture + grain, 0, 255).round().astype(np.uint8)


def smeared(light: np.ndarray, boxes: list[tuple[tuple[float, ...], tuple[float, float]]]) -> np.ndarray:
    """Motion blur: boxes (x, y, w, h) whose content moves by (px, px) while the shutter is open."""
    out = light.copy()
    for (x, y, wide, high), shift in boxes:
        length = int(math.hypot(*shift))
        if length < 2:
            continue
        kernel = np.zeros((2 * length + 1, 2 * length + 1), np.float32)
        ends = [(round(length + s * shift[0] / 2), round(length + s * shift[1] / 2)) for s in (-1, 1)]
        cv2.line(kernel, *ends, 1.0)
        mask = np.zeros(light.shape[:2], np.float32)
        mask[max(int(y), 0) : int(y + high), max(int(x), 0) : int(x + wide)] = 1
        mask = cv2.GaussianBlur(mask, (0, 0), 4)[:, :, None]
        out += (cv2.filter2D(out, -1, kernel / kernel.sum()) - out) * mask
    return out


def depth_image(depth: np.ndarray, seed: int) -> np.ndarray:
    """Depths (m) as a sensor measures them (uint16, mm, 0 where it does not)."""
    rng = np.random.default_rng(seed)
    disparity = BASE / np.maximum(depth, 0.05)
    across = np.arange(depth.shape[1]) + disparity
    shadow = np.maximum.accumulate(across, axis=1) > across + 1.0
    grain = cv2.GaussianBlur(rng.normal(0, 1, depth.shape).astype(np.float32), (0, 0), GRAIN)
    grain *= 2 * math.sqrt(math.pi) * GRAIN
    measured = np.round((disparity + SPREAD * grain) / STEP) * STEP
    found = BASE / np.maximum(measured, 0.01)
    edge = cv2.morphologyEx(disparity.astype(np.float32), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 1.0
    lost = shadow | (edge & (rng.uniform(size=depth.shape) < 0.6)) | (found < REACH[0]) | (found > REACH[1])
    return np.where(lost, 0, np.round(1000 * found)).astype(np.uint16)
