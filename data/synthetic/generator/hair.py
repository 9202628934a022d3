"""Hair: a cap over the scalp and strands that grow from it."""

from __future__ import annotations

import numpy as np
from body import Body, Outfit, Part
from mesh import Mesh, folds, waves


def hairline(body: Body, points: np.ndarray, outfit: Outfit) -> np.ndarray:
    """Metres above the hairline, which runs over the forehead, around the ears and down the nape."""
    centre = body.eye() + np.array([0, 0.09, 0])
    angle = np.degrees(np.arctan2(np.abs(points[:, 0]), -(points[:, 1] - centre[1])))
    high = 0.075 if outfit.stubble else 0.068
    bound = np.interp(angle, [0, 35, 55, 70, 84, 118, 130, 180], [high, high, 0.05, 0.02, 0.03, 0.03, -0.06, -0.075])
    return points[:, 2] - body.eye()[2] - bound + 0.004 * waves(points, 0.02, (1, 1, 1), 5)


def scalp(body: Body, outfit: Outfit) -> Mesh:
    """The hair-bearing skin."""
    mesh = body.groups["body"]
    top = mesh.points[:, 2] > body.eye()[2] - 0.12
    mesh = mesh.kept(mesh.faces[top[mesh.faces].all(1)]).subdivided()
    return mesh.clipped(hairline(body, mesh.points, outfit))


def hair_part(body: Body, outfit: Outfit) -> Part:
    """A cap over the scalp, thicker on top, tufted."""
    mesh = scalp(body, outfit).subdivided()
    rise = np.clip(hairline(body, mesh.points, outfit) / (0.05 if outfit.long_hair else 0.03), 0, 1) ** 0.7
    crown = np.clip((mesh.points[:, 2] - body.eye()[2]) / 0.1, 0, 1)
    thick = 0.002 + rise * (0.008 + 0.012 * crown) * (1.3 if outfit.long_hair else 1.0)
    tufts = folds(mesh.points, 0.018, (1, 3, 2), 7)
    out = mesh.smoothed(mesh.normals(), 12)
    mesh.points = mesh.points + out * (thick + (0.0012 if outfit.long_hair else 0.003) * rise * tufts)[:, None]
    colour = np.array(outfit.hair) * (1 + 0.25 * tufts)[:, None]
    return Part("hair", mesh, colour, "hair")


def strands(body: Body, outfit: Outfit, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Hair curves (count, knots, 3) at rest and the radii of their knots."""
    mesh, rng = scalp(body, outfit), np.random.default_rng(seed)
    corners = mesh.points[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    share = rng.dirichlet((1, 1, 1), count)[:, :, None]
    root = (corners[chosen] * share).sum(1)
    out = (mesh.smoothed(mesh.normals(), 4)[mesh.faces[chosen]] * share).sum(1)
    return grow(body, outfit, root, out, rng)


def grow(
    body: Body, outfit: Outfit, root: np.ndarray, out: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Lets hairs grow from their roots in small steps."""
    centre = body.eye() + np.array([0, 0.095, 0.02])
    parting = np.sign(root[:, 0] - 0.015)[:, None] * [1.0, 0, 0]
    back = np.array([0, 1.0, 0.0])
    comb = 0.7 * parting + 0.5 * back if outfit.long_hair else 0.5 * parting * [-1, 1, 1] + [0.5, -0.35, 0.1]
    knots, step = (14, 0.031) if outfit.long_hair else (5, 0.0085)
    length = rng.uniform(0.85, 1.05, (len(root), 1)) * step
    spring = 0.3 if outfit.long_hair else 0.8
    path, heading = [root], out * spring + comb * 0.6 + rng.normal(0, 0.15, root.shape)
    clumps = np.stack([waves(root, 0.03, (1, 1, 1), 60 + k) for k in range(3)], 1)
    clumps *= 0.05 if outfit.long_hair else 0.08
    for knot in range(1, knots):
        fall = np.array([0, 0, -1.0]) * (0.95 if outfit.long_hair else 0.14 * knot)
        heading = heading * 0.72 + fall + clumps + rng.normal(0, 0.05, root.shape)
        heading /= np.linalg.norm(heading, axis=1, keepdims=True)
        path.append(clear(body, path[-1] + heading * length, centre, outfit))
    radii = np.linspace(1, 0.35, knots) * 0.0009
    curves = np.stack(path, 1)
    tame = curves[:, :, 2].max(1) < np.quantile(curves[:, :, 2], 0.999)
    return curves[tame], radii


def clear(body: Body, points: np.ndarray, centre: np.ndarray, outfit: Outfit) -> np.ndarray:
    """Pushes hair out of the head, off the face and out of the shoulders."""
    size = np.array([0.083, 0.11, 0.132]) if outfit.long_hair else np.array([0.08, 0.102, 0.12])
    away = (points - centre) / size
    depth = np.linalg.norm(away, axis=1, keepdims=True)
    points = centre + away / np.minimum(depth, 1) * size
    if outfit.long_hair:
        cheek = body.eye()[1] + 0.055
        face = (points[:, 2] < body.eye()[2] + 0.06) & (points[:, 1] < cheek)
        points[:, 1] = np.where(face, cheek + 0.2 * (points[:, 1] - cheek), points[:, 1])
        back = points[:, 2] < body.head("neck01")[2] + 0.05
        nape = body.head("spine01")[1] + 0.06
        points[:, 1] = np.where(back & (points[:, 1] > centre[1]), np.maximum(points[:, 1], nape), points[:, 1])
    return points
