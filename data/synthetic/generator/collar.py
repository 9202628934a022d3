"""Collars and hoods: strips that stand on the neckline of a top."""

from __future__ import annotations

import numpy as np
from body import Body, Part, mixed
from clothes import below_collar
from mesh import Mesh, waves
from outfit import Top

COLUMNS = 96
REACH = 0.015


def neckline(body: Body, top: Top, top_part: Part) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles (0 in front, ascending), points and skin weights of the edge around the neck."""
    mesh = top_part.mesh
    points = mesh.points
    edge = np.flatnonzero(mesh.border() & (np.abs(below_collar(body, points, top)) < REACH))
    angle = around_neck(body, points[edge])
    order = np.argsort(angle)
    return angle[order], points[edge][order], mesh.skin[edge][order]


def around_neck(body: Body, points: np.ndarray) -> np.ndarray:
    """Angle around the neck, 0 in front."""
    centre = body.head("neck01")
    return np.arctan2(points[:, 0], centre[1] + 0.005 - points[:, 1])


def sheet(rows: np.ndarray, skin: np.ndarray, closed: bool) -> Mesh:
    """A mesh from rows of points (rows, columns, 3); skin (columns, bones)."""
    count, columns = rows.shape[:2]
    grid = np.arange(count * columns).reshape(count, columns)
    if closed:
        grid = np.concatenate([grid, grid[:, :1]], 1)
    quads = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], 2).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Mesh(rows.reshape(-1, 3), faces, np.tile(skin, (count, 1)))


def profile(kind: str, back: np.ndarray, front: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Steps (out, up) of a collar from the neckline; back: 0 in front to 1 behind; front: 1 at its front ends."""
    flat = np.zeros_like(back)
    if kind == "shirt":
        drop = 0.004 - 0.03 * front
        spread = 0.026 + 0.012 * front
        return [(flat, flat - 0.004), (flat + 0.002, flat + 0.026), (flat + 0.007, flat + 0.037),
                (flat + 0.014, flat + 0.035), (spread * 0.8, 0.5 * (drop + 0.03)), (spread, drop)]  # fmt: skip
    if kind == "polo":
        return profile("shirt", back, 0.6 * front)
    if kind == "jacket":
        drop = -0.012 - 0.02 * front
        return [(flat, flat - 0.004), (flat + 0.003, flat + 0.016), (flat + 0.009, flat + 0.026),
                (flat + 0.02, flat + 0.022), (flat + 0.034, 0.5 * (drop + 0.015)), (flat + 0.044, drop)]  # fmt: skip
    if kind == "stand":
        return [(flat, flat - 0.004), (flat + 0.008, flat + 0.025), (flat + 0.011, flat + 0.05),
                (flat + 0.007, flat + 0.058), (flat + 0.002, flat + 0.05), (flat + 0.001, flat + 0.02)]  # fmt: skip
    if kind == "hood":
        return [(flat, flat - 0.006), (flat + 0.002, 0.02 + 0.015 * back), (0.014 + 0.02 * back, 0.035 + 0.025 * back),
                (0.03 + 0.05 * back, 0.03 + 0.02 * back), (0.034 + 0.085 * back, 0.008 - 0.01 * back),
                (0.028 + 0.09 * back, -0.012 - 0.07 * back), (0.018 + 0.06 * back, -0.02 - 0.12 * back),
                (0.006 + 0.02 * back, -0.022 - 0.13 * back)]  # fmt: skip
    return [(flat - 0.002, flat - 0.004), (flat + 0.004, flat), (flat + 0.006, flat + 0.007),
            (flat + 0.003, flat + 0.015), (flat - 0.002, flat + 0.015), (flat - 0.004, flat + 0.006)]  # fmt: skip


def collar_part(body: Body, part: Part, top: Top) -> Part | None:
    """The collar of a top."""
    if top.collar in ("rib", "none"):
        return None
    angle, points, skin = neckline(body, top, part)
    gap = np.abs(angle).min() if top.opening else 0.0
    closed = gap < 0.08
    wanted = np.linspace(gap, 2 * np.pi - gap, COLUMNS, endpoint=not closed) if not closed else (
        np.linspace(0, 2 * np.pi, COLUMNS, endpoint=False))  # fmt: skip
    if top.collar in ("shirt", "polo", "jacket") and closed:
        closed, wanted = False, np.linspace(0.05, 2 * np.pi - 0.05, COLUMNS)
    spread = np.concatenate([angle - 2 * np.pi, angle, angle + 2 * np.pi])
    place = np.interp(wanted, spread, np.arange(len(spread))).astype(int)
    base = np.stack([np.interp(wanted, spread, np.tile(points[:, k], 3)) for k in range(3)], 1)
    weights = np.tile(skin, (3, 1))[place]
    width = max(3, COLUMNS // 32)
    kernel = np.ones(2 * width + 1) / (2 * width + 1)
    base = smooth_loop(base, kernel, closed)
    out = base - body.head("neck01") - [0, 0.005, 0]
    out[:, 2] = 0
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    back = (1 - np.cos(wanted)) / 2
    front = np.clip(1 - np.minimum(wanted, 2 * np.pi - wanted) / 0.9, 0, 1)
    up = np.array([0, -0.25, 1.0])
    steps = [base + out * o[:, None] + up * u[:, None] for o, u in profile(top.collar, back, front)]
    rows = finer(np.stack(steps))
    mesh = sheet(rows, weights, closed)
    if top.collar == "hood":
        mesh.points = mesh.points + mesh.normals() * (0.006 * waves(mesh.points, 0.06, (1, 1, 1), 21))[:, None]
    colour = np.array(top.colour) * (1 + 0.06 * waves(mesh.points, 0.1, (1, 1, 1), 4))[:, None]
    if top.collar in ("shirt", "polo", "jacket"):
        last = np.repeat(np.arange(len(rows)) == len(rows) - 1, rows.shape[1])
        colour = mixed(colour, np.array(top.colour) * 0.75, last.astype(float))
    return Part("collar", mesh, colour, "cloth")


def smooth_loop(values: np.ndarray, kernel: np.ndarray, closed: bool) -> np.ndarray:
    """Moving average along a ring or a strip."""
    pad = len(kernel) // 2
    wide = np.pad(values, ((pad, pad), (0, 0)), mode="wrap" if closed else "edge")
    soft = np.stack([np.convolve(column, kernel, mode="valid") for column in wide.T], 1)
    return soft


def finer(rows: np.ndarray) -> np.ndarray:
    """Rows with rounded ones between them (cubic through the neighbours)."""
    wide = np.concatenate([2 * rows[:1] - rows[1:2], rows, 2 * rows[-1:] - rows[-2:-1]])
    middle = (9 * (wide[1:-2] + wide[2:-1]) - wide[:-3] - wide[3:]) / 16
    out = np.empty((2 * len(rows) - 1, *rows.shape[1:]))
    out[0::2], out[1::2] = rows, middle
    return out
