"""The light of a whole frame: rendered regions blended into the empty corridor's picture."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from optics import CORRIDOR, View

HEADROOM = 4.0  # of light over white in the stored pictures, as light.py has it
FEATHER = 12
WIDTH, HEIGHT = CORRIDOR.size
FACTORS = (0.4, 2.5)
SOFT = 1.2  # pixels


@dataclass(frozen=True)
class FrameRecord:
    """What render.py wrote about a frame."""

    light: str
    persons: list[dict]
    objects: list[dict]
    shadows: list[dict]
    regions: list[list[int]]


def record_of(frames: Path, index: int) -> FrameRecord:
    """The record of a frame."""
    return FrameRecord(**json.loads((frames / f"{index:04d}.json").read_text()))


@cache
def decoding() -> np.ndarray:
    """Linear light of every 16-bit value."""
    code = np.arange(65536) / 65535
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    return (HEADROOM * linear).astype(np.float32)


def light_of(path: Path) -> np.ndarray:
    """Linear light (h, w, 3: blue, green, red) of a stored picture; 1 is white."""
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if picture is None or picture.dtype != np.uint16 or picture.shape[2:] != (3,):
        raise SystemExit(f"{path} is no picture of render.py: delete it and run render.py again")
    return decoding()[picture]


def ramp(low: int, high: int, limit: int) -> np.ndarray:
    """Weights along one side of a region."""
    rise = np.clip(np.arange(1, high - low + 1) / FEATHER, 0, 1)
    return np.minimum(rise if low > 0 else 1, rise[::-1] if high < limit else 1) * np.ones(high - low)


def feather(region: list[int]) -> np.ndarray:
    """Weights (h, w, 1) that fall to zero at the region's edges, but not at the picture's."""
    left, top, right, bottom = region
    across, down = ramp(left, right, WIDTH), ramp(top, bottom, HEIGHT)
    return np.minimum(across[None], down[:, None])[:, :, None]


@dataclass(frozen=True)
class Empty:
    """The empty corridor as linear light: as it is, and as the quick renders of the regions would show it."""

    true: np.ndarray
    quick: np.ndarray

    def correction(self, bodies: np.ndarray) -> np.ndarray:
        """Factors (h, w, 3) that make a quick render true; nothing is changed on bodies (h, w: bool)."""
        factor = np.clip(self.true / np.maximum(self.quick, 1e-3), *FACTORS)
        on_body = cv2.dilate(bodies.astype(np.float32), np.ones((3, 3), np.uint8))
        on_body = cv2.GaussianBlur(on_body, (0, 0), SOFT)[:, :, None]
        return factor + (1 - factor) * on_body


def empty_of(frames: Path, state: str) -> Empty:
    """The empty corridor under a state of the light."""
    return Empty(*(light_of(frames / f"{kind}_{state.replace(' ', '_')}.png") for kind in ("background", "plain")))


def room_light(frames: Path, index: int, view: View) -> np.ndarray:
    """The light of a frame of draw.py; the empty room's where nobody was drawn."""
    drawn = frames / f"{index:04d}_0.png"
    if drawn.exists():
        return light_of(drawn)
    empty = light_of(frames / "empty_0.png")
    return cv2.remap(empty, view.lookup(), None, cv2.INTER_LINEAR) if view.lens else empty


def depth_of(frames: Path, index: int) -> np.ndarray:
    """Depths (h, w, m) of a frame, exact."""
    return np.load(frames / f"{index:04d}_depth.npz")["depth"].astype(np.float32)


def bodies_of(frames: Path, index: int) -> np.ndarray:
    """Where people and what they carry are seen (h, w)."""
    packed = np.load(frames / f"{index:04d}.npz")["bodies"]
    return np.unpackbits(packed)[: WIDTH * HEIGHT].reshape(HEIGHT, WIDTH).astype(bool)


def composed(frames: Path, index: int, regions: list[list[int]], empty: Empty) -> np.ndarray:
    """The empty corridor with the frame's regions blended in."""
    picture = empty.true.copy()
    correction = empty.correction(bodies_of(frames, index)) if regions else picture
    for number, region in enumerate(regions):
        left, top, right, bottom = region
        patch = light_of(frames / f"{index:04d}_{number}.png") * correction[top:bottom, left:right]
        hole = picture[top:bottom, left:right]
        picture[top:bottom, left:right] = hole + (patch - hole) * feather(region)
    return picture


def brightness(light: np.ndarray) -> np.ndarray:
    """Luminance of linear light (..., 3: blue, green, red)."""
    return light @ np.array([0.0722, 0.7152, 0.2126], np.float32)
