"""Fabrics: pictures laid over the colour of a garment, checks, stripes, prints, zips, buttons, pockets."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from body import Body, Part
from gait import SIDES
from outfit import Motif

SIDE, PIXELS = 1.6, 1024  # of the picture: metres, pixels
TRUNK_RADIUS, ARM_RADIUS = 0.175, 0.055
TRUNK_MIDDLE, TRUNK_FOOT = 0.6, 0.8
SLEEVE_MIDDLE, SLEEVE_FOOT = 1.41, 0.05
SLEEVE_FROM = 1.21

Grid = tuple[np.ndarray, np.ndarray, np.ndarray]


def band(value: np.ndarray, period: float, share: float = 0.5) -> np.ndarray:
    """1 on a share of every period."""
    return (np.mod(value / period, 1) < share).astype(float)


def line(value: np.ndarray, half: float | np.ndarray) -> np.ndarray:
    """1 within half a width of zero."""
    return (np.abs(value) < half).astype(float)


def within(value: np.ndarray, low: float, high: float) -> np.ndarray:
    """1 between two bounds."""
    return ((value > low) & (value < high)).astype(float)


def checks(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Woven squares with a thin line through them."""
    thin = np.maximum.reduce([line(np.mod(way, size) - size * 0.75, 0.0025) for way in (around, height)])
    return np.maximum(0.45 * band(around, size) + 0.45 * band(height, size), 0.8 * thin)


def stripes(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Level stripes."""
    return band(height, size)


def pinstripes(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Thin upright stripes."""
    return 0.6 * band(around, size, 0.14)


def block(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Another colour above a height over the hips; sleeves wholly in it."""
    return np.where(arm > 0, 1.0, (height > size).astype(float))


def yoke(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Sleeves in another colour."""
    return np.where(arm > 0, 1.0, 0.0)


def flowers(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Scattered five-leaved blots."""
    cell_u, cell_v = np.floor(around / size), np.floor(height / size)
    dice = np.sin(cell_u * 127.1 + cell_v * 311.7) * 43758.5453
    jump, turned = np.mod(dice, 1), np.mod(dice * 7.3, 1) * 6.28
    u = around - (cell_u + 0.35 + 0.3 * jump) * size
    v = height - (cell_v + 0.35 + 0.3 * np.mod(dice * 3.1, 1)) * size
    radius = size * (0.2 + 0.12 * jump) * (1 + 0.35 * np.cos(5 * np.arctan2(v, u) + turned))
    return np.where(np.hypot(u, v) < radius, np.where(np.hypot(u, v) < size * 0.07, 0.0, 1.0), 0.0)


def logo(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """A ring over bars of letters, on the breast."""
    v = height - 0.33
    ring = line(np.hypot(around, v - 0.03) - size * 0.45, size * 0.12)
    uneven = around * 3.7 + np.sin(around * 90) * 0.02
    letters = within(v, -size * 0.95, -size * 0.65) * line(around, size) * band(uneven, 0.05, 0.62)
    return np.maximum(ring, letters) * (arm == 0)


def reflectors(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Two level bands and two over the shoulders, as on safety vests."""
    level = np.maximum(line(height - 0.06, size / 2), line(height - 0.17, size / 2))
    braces = line(np.abs(around) - 0.13, size / 2) * (height > 0.17)
    back = line(np.abs(around) - 0.42, size / 2) * (height > 0.17)
    return np.maximum.reduce([level, braces, back])


def zipper(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """A zip between two seams."""
    teeth = line(around, 0.004) * band(height, 0.006, 0.7)
    return np.maximum(teeth, 0.5 * line(np.abs(around) - 0.02, 0.0018)) * (arm == 0)


def buttons(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Buttons on a placket."""
    knobs = np.hypot(around, np.mod(height, size) - size / 2) < 0.0065
    return np.maximum(knobs, 0.5 * line(np.abs(around) - 0.017, 0.0018)) * (arm == 0)


def tie(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """A knotted tie."""
    top = 0.575
    half = np.where(height > top - 0.035, size * 0.55, size * (0.4 + 0.9 * np.clip(top - height, 0, 0.5)))
    shade = 1 - 0.25 * band(height + around, 0.03, 0.25) - 0.5 * line(height - top + 0.035, 0.003)
    return line(around, half) * (height < top) * shade * (arm == 0)


def pockets(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Outlines of two patch pockets with flaps at the hips."""
    u, v = np.abs(around) - 0.16, height - 0.0
    box = np.maximum(np.abs(u) / (size / 2), np.abs(v) / (size * 0.6))
    flap = line(v - size * 0.35, 0.002) * (np.abs(u) < size / 2)
    return 0.6 * np.maximum(within(box, 0.96, 1.0), flap) * (arm == 0)


def tweed(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Herringbone of light threads."""
    slope = np.abs(np.mod(around, size) - size / 2)
    return 0.4 * band(height + slope, size / 3) + 0.3 * (np.mod(np.sin(around * 9e3 + height * 7e3) * 999, 1) < 0.25)


def knit(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Upright cables."""
    cable = np.abs(np.mod(around, size) - size / 2) < size * 0.16
    return 0.55 * np.where(cable, band(height + around * 0.8, 0.018, 0.3), band(around, 0.007, 0.3) * 0.5)


def cords(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Two strings that hang from a hood; a pouch below."""
    strings = line(np.abs(around) - 0.035 - 0.008 * np.sin(height * 25), 0.003) * within(height, 0.46 - size, 0.55)
    pouch = line(np.maximum(np.abs(around) - 0.03 - (0.2 - height) * 0.4, np.abs(height - 0.12) - 0.08), 0.002)
    return np.maximum(strings, 0.35 * pouch * (around**2 < 0.026)) * (arm == 0)


def seams(around: np.ndarray, height: np.ndarray, arm: np.ndarray, size: float) -> np.ndarray:
    """Side seams and the curved front pockets of jeans."""
    side = line(np.abs(around) - TRUNK_RADIUS * np.pi / 2, 0.002)
    bow = line(np.hypot(np.abs(around) - 0.26, height - 0.09) - 0.11, 0.002)
    return 0.7 * np.maximum(side, bow * (np.abs(around) < 0.26) * (height < 0.09))


MOTIFS: dict[str, Callable[[np.ndarray, np.ndarray, np.ndarray, float], np.ndarray]] = {
    "checks": checks, "stripes": stripes, "pinstripes": pinstripes, "block": block, "yoke": yoke, "flowers": flowers,
    "logo": logo,
    "reflectors": reflectors, "zip": zipper, "buttons": buttons, "pockets": pockets, "tweed": tweed, "tie": tie,
    "knit": knit, "cords": cords, "seams": seams,
}  # fmt: skip


def fabric_grid(scale: float) -> Grid:
    """Metres around and up at every pixel, and whether it belongs to the sleeves (1) or the trunk (0)."""
    across, up = np.meshgrid((np.arange(PIXELS) + 0.5) / PIXELS * SIDE, (np.arange(PIXELS) + 0.5) / PIXELS * SIDE)
    arm = (across > SLEEVE_FROM).astype(float)
    around = np.where(arm > 0, across - SLEEVE_MIDDLE, across - TRUNK_MIDDLE)
    height = np.where(arm > 0, up - SLEEVE_FOOT, (up - TRUNK_FOOT) / scale)
    return around, height, arm


def picture_of(motifs: tuple[Motif, ...], scale: float) -> np.ndarray:
    """The fabric (PIXELS, PIXELS, 4): colour and cover, bottom row first. scale: length of the trunk, 1 usual."""
    around, height, arm = fabric_grid(scale)
    colour, cover = np.zeros((PIXELS, PIXELS, 3)), np.zeros((PIXELS, PIXELS))
    for name, paint, size in motifs:
        share = np.clip(MOTIFS[name](around, height, arm, size), 0, 1)
        total = share + cover * (1 - share)
        mix = np.divide(share, total, out=np.zeros_like(share), where=total > 0)[:, :, None]
        colour, cover = colour * (1 - mix) + np.array(paint) * mix, total
    return np.concatenate([colour, cover[:, :, None]], 2).astype(np.float32)


def around_trunk(body: Body, points: np.ndarray) -> np.ndarray:
    """Angle around the spine, 0 in front."""
    return np.arctan2(points[:, 0], body.head("spine03")[1] - 0.01 - points[:, 1])


def around_arm(body: Body, points: np.ndarray) -> np.ndarray:
    """Angle around the nearer arm, 0 on top."""
    out = np.zeros(len(points))
    for name, sign in SIDES.items():
        start = body.head(f"upperarm01.{name}")
        axis = body.head(f"wrist.{name}") - start
        axis /= np.linalg.norm(axis)
        top = np.array([0, 0, 1.0]) - axis * axis[2]
        top /= np.linalg.norm(top)
        away = points - start
        angle = np.arctan2(away @ np.cross(axis, top), away @ top)
        out = np.where(points[:, 0] * sign >= 0, angle, out)
    return out


def unwrapped(angle: np.ndarray) -> np.ndarray:
    """Angles (faces, 3) of corners without the jump at the back."""
    jump = np.ptp(angle, axis=1, keepdims=True) > np.pi
    return np.where(jump & (angle < 0), angle + 2 * np.pi, angle)


def chart_of(body: Body, part: Part, arm: np.ndarray) -> np.ndarray:
    """Place in the picture (faces * 3, 2) of every corner; arm: how much each vertex belongs to a sleeve."""
    points, faces = part.rest, part.mesh.faces
    sleeve = (arm[faces].mean(1) > 0.5)[:, None]
    trunk = unwrapped(around_trunk(body, points)[faces]) * TRUNK_RADIUS + TRUNK_MIDDLE
    round_arm = unwrapped(around_arm(body, points)[faces]) * ARM_RADIUS + SLEEVE_MIDDLE
    height = (points[:, 2] - body.head("upperleg01.L")[2] + TRUNK_FOOT)[faces]
    before = (body.along(points, "lowerarm01", "wrist") + SLEEVE_FOOT)[faces]
    chart = np.stack([np.where(sleeve, round_arm, trunk), np.where(sleeve, before, height)], 2)
    return chart.reshape(-1, 2) / SIDE


def dyed(body: Body, part: Part, motifs: tuple[Motif, ...], arm: np.ndarray) -> Part:
    """The part with its fabric."""
    if motifs:
        trunk = body.head("neck01")[2] - body.head("upperleg01.L")[2]
        part.picture, part.chart = picture_of(motifs, trunk / 0.6), chart_of(body, part, arm)
    return part
