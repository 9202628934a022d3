"""Hair: a cap over the scalp and strands that grow from it; beards; brows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from body import Body, Part, mixed
from mesh import Mesh, folds, waves
from outfit import Look

Strands = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Style:
    """How hair grows. Lengths in metres.

    count, knots, step: strands, points on each, metres between points. spring: how far it stands off at first. fall:
    how it is drawn down. forehead, temples: raise of the hairline there. crown: highest point that bears hair, above
    the eyes. cap: thickness of the cap on top. curl: radius of curls. tie: where it is bound behind the eyes (back,
    up). tail: metres of a tail from there; 0 with a tie makes a bun. flowing: falls over the neck.
    """

    count: int = 6000
    knots: int = 5
    step: float = 0.0085
    spring: float = 0.8
    fall: float = 0.14
    forehead: float = 0.0
    temples: float = 0.0
    crown: float = 1.0
    cap: float = 0.012
    curl: float = 0.0
    tie: tuple[float, float] | None = None
    tail: float = 0.0
    flowing: bool = False
    comb: tuple[float, float] = (0.5, -0.35)
    parting: float = -0.5


STYLES = {
    "short": Style(),
    "long": Style(9000, 14, 0.031, 0.3, 0.95, cap=0.0156, flowing=True, comb=(0.0, 0.5), parting=0.7),
    "straight": Style(10000, 14, 0.031, 0.3, 0.95, cap=0.006, flowing=True, comb=(0.0, 0.5), parting=0.7),
    "crop": Style(5000, 3, 0.004, 1.0, 0.05, cap=0.004),
    "brush": Style(6500, 5, 0.009, 1.0, 0.05, cap=0.012, comb=(0.0, 0.35), parting=0.2),
    "side": Style(6500, 6, 0.011, 0.6, 0.2, cap=0.014, comb=(0.6, 0.1), parting=-0.3),
    "receding": Style(4500, 5, 0.008, 0.6, 0.15, forehead=0.032, temples=0.05, cap=0.007, comb=(0.1, 0.5), parting=0.2),
    "rim": Style(3000, 4, 0.006, 0.5, 0.2, crown=0.055, forehead=0.2, temples=0.12, cap=0.003, comb=(0.0, 0.5)),
    "afro": Style(9000, 9, 0.009, 1.3, 0.0, cap=0.042, curl=0.006, comb=(0.0, 0.0), parting=0.3),
    "curls": Style(5000, 21, 0.016, 0.9, 0.75, cap=0.007, curl=0.011, flowing=True, comb=(0.0, 0.4), parting=0.8),
    "bob": Style(10000, 10, 0.025, 0.35, 0.9, cap=0.006, flowing=True, comb=(0.3, 0.1), parting=0.7),
    "tail": Style(8000, 14, 0.016, 0.05, 0.0, cap=0.0, tie=(0.185, 0.03), tail=0.26),
    "bun": Style(8000, 13, 0.016, 0.05, 0.0, cap=0.0, tie=(0.19, 0.05), tail=0.0),
    "none": Style(0, 2, 0.01),
}


def hairline(body: Body, points: np.ndarray, look: Look) -> np.ndarray:
    """Metres above the hairline, which runs over the forehead, around the ears and down the nape."""
    style = STYLES[look.style]
    centre = body.eye() + np.array([0, 0.09, 0])
    angle = np.degrees(np.arctan2(np.abs(points[:, 0]), -(points[:, 1] - centre[1])))
    high = (0.075 if look.stubble else 0.068) + style.forehead
    temple = style.temples
    sides = [high, high + temple * 0.4, 0.05 + temple, 0.02 + temple * 0.8, 0.03, 0.03, -0.06, -0.075]
    bound = np.interp(angle, [0, 35, 55, 70, 84, 118, 130, 180], sides)
    if style.crown < 1:
        bound = np.interp(angle, [0, 35, 55, 70, 84, 118, 130, 180], [1, 1, 1, 0.06, 0.03, 0.03, -0.06, -0.075])
    above = points[:, 2] - body.eye()[2] - bound + 0.004 * waves(points, 0.02, (1, 1, 1), 5)
    return np.minimum(above, body.eye()[2] + style.crown - points[:, 2] + 0.01 * waves(points, 0.05, (1, 1, 1), 6))


def scalp(body: Body, look: Look) -> Mesh:
    """The hair-bearing skin."""
    mesh = body.groups["body"]
    top = mesh.points[:, 2] > body.eye()[2] - 0.12
    mesh = mesh.kept(mesh.faces[top[mesh.faces].all(1)]).subdivided()
    return mesh.clipped(hairline(body, mesh.points, look))


def hair_part(body: Body, look: Look) -> Part:
    """A cap over the scalp, thicker on top, tufted."""
    style = STYLES[look.style]
    mesh = scalp(body, look).subdivided()
    rise = np.clip(hairline(body, mesh.points, look) / (0.05 if style.flowing else 0.03), 0, 1) ** 0.7
    crown = np.clip((mesh.points[:, 2] - body.eye()[2]) / 0.1, 0, 1)
    thick = 0.002 + rise * style.cap * (0.667 + crown if style.cap < 0.03 else 0.75 + 0.35 * crown)
    tufts = folds(mesh.points, 0.018, (1, 3, 2), 7)
    if style.curl:
        tufts = folds(mesh.points, 0.016, (1, 1, 1), 7) * (1 + style.curl * 300)
    rough = 0.0 if style.tie else 0.0012 if style.flowing else 0.003
    out = mesh.smoothed(mesh.normals(), 12)
    mesh.points = mesh.points + out * (thick + rough * rise * tufts)[:, None]
    colour = np.array(look.hair) * (1 + 0.25 * np.clip(tufts, -1, 1))[:, None]
    return Part("hair", mesh, colour, "hair")


def rooted(mesh: Mesh, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Random points on a mesh (count, 3) and their normals."""
    corners = mesh.points[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    share = rng.dirichlet((1, 1, 1), count)[:, :, None]
    return (corners[chosen] * share).sum(1), (mesh.smoothed(mesh.normals(), 4)[mesh.faces[chosen]] * share).sum(1)


def strands(body: Body, look: Look, seed: int) -> Strands:
    """Hair curves (count, knots, 3) at rest and the radii of their knots."""
    style, rng = STYLES[look.style], np.random.default_rng(seed)
    if not style.count:
        return np.empty((0, style.knots, 3)), np.empty(style.knots)
    root, out = rooted(scalp(body, look), style.count, rng)
    if style.tie:
        return bound_hair(body, style, root, out, rng)
    return grow(body, style, root, out, rng)


def grow(body: Body, style: Style, root: np.ndarray, out: np.ndarray, rng: np.random.Generator) -> Strands:
    """Lets hairs grow from their roots in small steps."""
    centre = body.eye() + np.array([0, 0.095, 0.02])
    aside = np.sign(root[:, 0] - 0.015)[:, None] * [1.0, 0, 0]
    comb = style.parting * aside + np.array([style.comb[0], style.comb[1], 0.1 * (not style.flowing)])
    length = rng.uniform(0.85, 1.05, (len(root), 1)) * style.step
    path, heading = [root], out * style.spring + comb * 0.6 + rng.normal(0, 0.15, root.shape)
    clumps = np.stack([waves(root, 0.03, (1, 1, 1), 60 + k) for k in range(3)], 1)
    clumps *= 0.05 if style.flowing else 0.08
    for knot in range(1, style.knots):
        fall = np.array([0, 0, -1.0]) * (style.fall if style.flowing else style.fall * knot)
        heading = heading * 0.72 + fall + clumps + rng.normal(0, 0.05, root.shape)
        heading /= np.linalg.norm(heading, axis=1, keepdims=True)
        path.append(clear(body, path[-1] + heading * length, centre, style))
    curves = np.stack(path, 1)
    if style.curl:
        curves = curled(curves, style, rng)
    radii = np.linspace(1, 0.35, style.knots) * 0.0009
    tame = curves[:, :, 2].max(1) < np.quantile(curves[:, :, 2], 0.999)
    return curves[tame], radii


def curled(curves: np.ndarray, style: Style, rng: np.random.Generator) -> np.ndarray:
    """Winds every strand around its path; neighbours in flowing hair wind together."""
    count, knots = curves.shape[:2]
    if style.flowing:
        start = np.floor(3 * waves(curves[:, 0], 0.03, (1, 1, 1), 61))[:, None] * 2.1
        pace = 1.9 + 0.25 * np.sin(start * 7)
        start = start + rng.normal(0, 0.25, (count, 1))
    else:
        start, pace = rng.uniform(0, 2 * np.pi, (count, 1)), rng.uniform(1.4, 2.2, (count, 1))
    phase = start + np.arange(knots) * pace
    grown = style.curl * np.minimum(np.arange(knots) / 3, 1)
    return curves + np.stack([np.cos(phase), np.sin(phase), 0.5 * np.sin(phase * 1.3)], 2) * grown[:, None]


def tie_of(body: Body, style: Style) -> np.ndarray:
    """Where bound hair meets."""
    back, up = style.tie or (0.0, 0.0)
    return body.eye() + np.array([0, back, up])


def bound_hair(body: Body, style: Style, root: np.ndarray, out: np.ndarray, rng: np.random.Generator) -> Strands:
    """Hair combed tightly to the tie, then a hanging tail or a bun."""
    tie, centre = tie_of(body, style), body.eye() + np.array([0, 0.095, 0.02])
    path = [root]
    steps = style.knots - (6 if style.tail else 0)
    start = root + out * rng.uniform(0.003, 0.008, (len(root), 1))
    size = np.array([0.081, 0.104, 0.125])
    own = np.linalg.norm((start - centre) / size, axis=1, keepdims=True)
    for share in np.linspace(0, 1, steps)[1:]:
        away = (start + (tie - start) * share - centre) / size
        depth = np.linalg.norm(away, axis=1, keepdims=True)
        lifted = centre + away / depth * np.maximum(depth, own + (1.03 - own) * share) * size
        path.append(lifted + rng.normal(0, 0.0012, root.shape) * np.sin(np.pi * share))
    if style.tail:
        spread = rng.normal(0, 1, (len(root), 3)) * [0.016, 0.012, 0.008]
        for knot in range(1, 7):
            drop = np.array([0, 0.035 * min(knot, 2), -style.tail / 6 * (knot - 0.8)])
            path.append(tie + drop + spread * (0.7 + 0.5 * np.sin(knot * 0.5)) + rng.normal(0, 0.001, root.shape))
    return np.stack(path, 1), np.linspace(1, 0.4, style.knots) * 0.0009


def knot_part(body: Body, look: Look) -> Part | None:
    """The bun, or the bundle inside a tail."""
    style = STYLES[look.style]
    if style.tie is None:
        return None
    angle, rise = np.meshgrid(np.linspace(0, 2 * np.pi, 33), np.linspace(-1, 1, 17))
    ring = np.sqrt(np.maximum(1 - rise**2, 0))
    wound = 1 + 0.06 * np.cos(3 * angle + 9 * rise)
    size = np.array([0.014, 0.014, style.tail * 0.55]) if style.tail else np.array([0.036, 0.03, 0.034])
    ball = np.stack([ring * np.cos(angle) * wound, ring * np.sin(angle) * wound, rise], 2).reshape(-1, 3) * size
    middle = np.array([0, 0.05, -style.tail * 0.45]) if style.tail else np.array([0, 0.012, 0.0])
    grid = np.arange(17 * 33).reshape(17, 33)
    quads = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], 2).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    points = tie_of(body, style) + middle + ball
    colour = np.array(look.hair) * (0.8 + 0.3 * np.cos(3 * angle + 9 * rise)).reshape(-1, 1)
    return Part("knot", Mesh(points, faces, body.bound(len(points), "head")), colour, "hair")


def clear(body: Body, points: np.ndarray, centre: np.ndarray, style: Style) -> np.ndarray:
    """Pushes hair out of the head, off the face and out of the shoulders."""
    size = np.array([0.083, 0.11, 0.132]) if style.flowing else np.array([0.08, 0.102, 0.12])
    away = (points - centre) / size
    depth = np.linalg.norm(away, axis=1, keepdims=True)
    points = centre + away / np.minimum(depth, 1) * size
    if style.flowing:
        cheek = body.eye()[1] + 0.055
        face = (points[:, 2] < body.eye()[2] + 0.06) & (points[:, 1] < cheek)
        points[:, 1] = np.where(face, cheek + 0.2 * (points[:, 1] - cheek), points[:, 1])
        back = points[:, 2] < body.head("neck01")[2] + 0.05
        nape = body.head("spine01")[1] + 0.06
        points[:, 1] = np.where(back & (points[:, 1] > centre[1]), np.maximum(points[:, 1], nape), points[:, 1])
    return points


def jaw(body: Body, points: np.ndarray) -> np.ndarray:
    """Metres inside the part of the face that bears a beard."""
    mouth = body.head("oris05")[2] * 0.5 + body.head("oris01")[2] * 0.5
    down = mouth + 0.022 - points[:, 2]
    side = np.abs(points[:, 0])
    high = np.where(side > 0.035, body.eye()[2] - 0.02 - points[:, 2] - (0.07 - side) * 1.2, down)
    low = points[:, 2] - mouth + 0.072
    behind = body.eye()[1] + 0.085 - points[:, 1]
    lips = np.hypot(points[:, 0] / 0.026, (points[:, 2] - mouth) / 0.011)
    return np.minimum.reduce([high, low, behind, (lips - 1) * 0.012])


def beard(body: Body, look: Look, seed: int) -> Strands | None:
    """Beard curves and their radii."""
    if not look.beard:
        return None
    mesh = body.groups["body"]
    near = mesh.points[:, 2] > body.eye()[2] - 0.2
    mesh = mesh.kept(mesh.faces[near[mesh.faces].all(1)]).subdivided()
    mesh = mesh.clipped(jaw(body, mesh.points) + 0.002 * waves(mesh.points, 0.012, (1, 1, 1), 8))
    rng = np.random.default_rng(seed + 100)
    root, out = rooted(mesh, 3500, rng)
    knots, step = 4, look.beard / 3
    path, heading = [root], out + rng.normal(0, 0.25, root.shape)
    for knot in range(1, knots):
        heading = heading * 0.8 + np.array([0, 0, -0.25 * knot]) + rng.normal(0, 0.12, root.shape)
        heading /= np.linalg.norm(heading, axis=1, keepdims=True)
        path.append(path[-1] + heading * step)
    return np.stack(path, 1), np.linspace(1, 0.4, knots) * 0.0007


def scalp_paint(body: Body, look: Look, points: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """Shadow of the hair on the skin under it."""
    if look.style == "none":
        return colour
    inside = np.clip(hairline(body, points, look) / 0.006, 0, 1)
    return mixed(colour, np.array(look.hair) + 0.01, 0.75 * inside)
