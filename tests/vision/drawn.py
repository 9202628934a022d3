"""Drawn people that a detector of upright people finds, with boxes known exactly."""

from __future__ import annotations

import cv2
import numpy as np


def corridor(width: int = 640, height: int = 480, *, seed: int = 0) -> np.ndarray:
    """Image of an empty corridor: a wall, a floor, a little noise."""
    picture = np.full((height, width, 3), (150, 160, 165), np.uint8)
    picture[height * 3 // 5 :] = (105, 110, 120)
    noise = np.random.default_rng(seed).normal(0, 2, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def add_person(picture: np.ndarray, x: float, y: float, h: float) -> tuple[float, float, float, float]:
    """Draws somebody ``h`` pixels tall with the head's top at ``y`` and the middle at ``x``; gives the box."""

    def at(across: float, down: float) -> tuple[int, int]:
        return round(x + across * h), round(y + down * h)

    def limb(start: tuple[float, float], end: tuple[float, float], thick: float, colour: tuple[int, int, int]) -> None:
        cv2.line(picture, at(*start), at(*end), colour, max(1, round(thick * h)), cv2.LINE_AA)

    for side in (-1, 1):
        limb((side * 0.045, 0.48), (side * 0.07, 0.93), 0.085, (40, 30, 25))
        limb((side * 0.07, 0.965), (side * 0.085, 0.965), 0.07, (20, 20, 20))
        limb((side * 0.12, 0.2), (side * 0.15, 0.5), 0.06, (50, 40, 90))
    cv2.rectangle(picture, at(-0.105, 0.17), at(0.105, 0.52), (55, 45, 100), cv2.FILLED, cv2.LINE_AA)
    cv2.ellipse(picture, at(0, 0.07), (round(0.05 * h), round(0.07 * h)), 0, 0, 360, (60, 60, 80), -1, cv2.LINE_AA)
    limb((0, 0.12), (0, 0.18), 0.06, (60, 60, 80))
    return x - 0.18 * h, y, 0.36 * h, h
