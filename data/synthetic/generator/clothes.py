"""Clothes cut from shells around the body: tops, trousers, skirts, shoes."""

from __future__ import annotations

import numpy as np
from body import SOLE, Body, Part, bell, mixed
from fabric import dyed
from mesh import Mesh, folds, normals, waves
from outfit import Colour, Line, Skirt, Top, Trousers

INSET = 0.008
SHOULDER = 0.45
HANG_FROM, SLICE = 0.18, 0.01


def gap_edge(body: Body, points: np.ndarray, line: Line) -> np.ndarray:
    """Metres from the edge of a front gap; positive on the cloth."""
    down, half = np.array(line).T
    depth = body.head("neck01")[2] - points[:, 2]
    behind = np.maximum(points[:, 1] - body.head("spine03")[1] + 0.02, 0)
    return np.abs(points[:, 0]) - np.interp(depth, down, half) + 10 * behind


def below_collar(body: Body, points: np.ndarray, top: Top) -> np.ndarray:
    """Metres below the plane of the neckline."""
    neck = body.head("neck01") + np.array([0, 0, 0.035 + top.neck])
    lean = 0.38 if top.collar == "rib" else -0.35
    return (neck - points) @ (np.array([0, lean, 1.0]) / np.hypot(lean, 1))


def top_cut(body: Body, mesh: Mesh, top: Top) -> dict[str, np.ndarray]:
    """Metres inside each hem of a top."""
    points = mesh.points
    arm = body.arm(mesh)
    if top.sleeve is None:
        cuff = (SHOULDER - arm) * 0.08
    else:
        cuff = np.where(arm > 0.5, body.along(points, "lowerarm01", "wrist") - top.sleeve, 1.0)
    collar = np.where(arm < 0.5, below_collar(body, points, top), 1.0)
    hips = body.head("upperleg01.L")[2] + top.hem
    cuts = {"hem": np.where(arm < 0.5, points[:, 2] - hips, 1.0), "collar": collar, "cuff": cuff}
    if top.opening:
        cuts["front"] = gap_edge(body, points, top.opening)
    if top.under:
        high = points[:, 2] - body.head("neck01")[2] + 0.1
        shown = np.maximum(-gap_edge(body, points, top.under) + 0.05, high)
        cuts["under"] = np.where(arm < 0.5, shown, -1.0)
    return cuts


def draped(mesh: Mesh, gap: np.ndarray, rounds: int) -> tuple[np.ndarray, np.ndarray]:
    """An inflated, smoothed shell that keeps half its gap to the body; points and their normals."""
    out = mesh.smoothed(mesh.normals(), 3)
    base, goal = mesh.points, mesh.points + out * gap[:, None]
    soft = mesh.smoothed(goal, rounds, mesh.border())
    missing = np.maximum(0.5 * gap - ((soft - base) * out).sum(1), 0)
    soft = mesh.smoothed(soft + out * missing[:, None], 2)
    return soft, normals(soft, mesh.faces)


def hull_radius(flat: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Distance from the origin to the convex hull of points (n, 2) along each angle."""
    way = np.stack([np.sin(angles), np.cos(angles)], 1)
    reach = (flat @ way.T).max(0)
    step = np.angle(np.exp(1j * (angles[:, None] - angles[None])))
    near = np.abs(step) < 1.2
    return np.where(near, reach[None] / np.cos(np.where(near, step, 0)), np.inf).min(1)


def hung(body: Body, points: np.ndarray, arm: np.ndarray, share: float) -> np.ndarray:
    """Lets the lower trunk of a top fall straight from what sticks out above, instead of following the body."""
    top = body.head("upperleg01.L")[2] + HANG_FROM
    trunk = np.flatnonzero((points[:, 2] < top) & (arm < 0.3))
    if not len(trunk):
        return points
    centre = np.array([0, body.head("spine03")[1]])
    flat, height = points[trunk, :2] - centre, points[trunk, 2]
    levels = np.arange(top, height.min() - 2 * SLICE, -SLICE)
    angles = np.linspace(-np.pi, np.pi, 73)
    radii: list[np.ndarray] = []
    for level in levels:
        near = np.abs(height - level) < SLICE
        found = hull_radius(flat[near], angles) if near.sum() > 20 else (radii[-1] if radii else np.zeros(73))
        radii.append(np.maximum(found, radii[-1] - SLICE * 0.25) if radii else found)
    angle, radius = np.arctan2(flat[:, 0], flat[:, 1]), np.linalg.norm(flat, axis=1)
    rows = np.clip((top - height) / SLICE, 0, len(levels) - 1.001)
    columns = (angle + np.pi) / (2 * np.pi) * 71.999
    i, j, table = rows.astype(int), columns.astype(int), np.array(radii)
    a, b = rows - i, columns - j
    wanted = table[i, j] * (1 - a) * (1 - b) + table[i + 1, j] * a * (1 - b)
    wanted += table[i, j + 1] * (1 - a) * b + table[i + 1, j + 1] * a * b
    more = np.maximum(wanted - radius, 0) * share * np.clip((top - height) / 0.08, 0, 1)
    out = points.copy()
    out[trunk, :2] += flat / np.maximum(radius, 1e-6)[:, None] * more[:, None]
    return out


def normalized(skin: np.ndarray) -> np.ndarray:
    """Skin weights that sum to one again after smoothing, in single precision."""
    return (skin / skin.sum(1, keepdims=True)).astype(np.float32)


def top_part(body: Body, top: Top, below: Colour, seed: int) -> Part:
    """A top with ribbed hems; long skirts of it also hang free of the legs. below: what shows under a panel."""
    mesh = body.groups["helper-tights"].subdivided()
    for hem in top_cut(body, mesh, top):
        mesh = mesh.clipped(top_cut(body, mesh, top)[hem])
    mesh = mesh.subdivided()
    cut = top_cut(body, mesh, top)
    edge = np.minimum.reduce([cut["hem"], cut["collar"], cut["cuff"]])
    arm = np.clip(body.rides(mesh, ("upperarm02", "lowerarm", "wrist")), 0, 1)
    points, out = draped(mesh, top_gap(body, top, mesh, arm, edge), 30)
    if top.hang:
        points = hung(body, points, body.arm(mesh), top.hang)
        out = normals(points, mesh.faces)
    calm = np.clip(np.minimum(edge, cut["front"] if top.opening else edge) / 0.05, 0.1, 1) * (1 - 0.75 * top.stiff)
    relief = (top_folds(body, mesh, arm, seed) - INSET * front_panel(body, top, mesh)) * calm
    relief += tailoring(body, top, mesh, arm, cut)
    mesh.points = points + out * (relief + 0.003 * np.clip((0.03 - edge) / 0.004, 0, 1))[:, None]
    colour = top_paint(body, top, below, mesh, points, edge)
    mesh.skin = normalized(mesh.smoothed(mesh.skin, 6))
    return dyed(body, Part("top", mesh, colour, "cloth"), top.motifs, arm)


def top_gap(body: Body, top: Top, mesh: Mesh, arm: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """Metres between body and cloth: close on the shoulders, loose below."""
    below = np.clip((body.head("upperarm01.L")[2] - mesh.points[:, 2]) / 0.3, 0, 1)
    sleeve = np.clip((body.along(mesh.points, "upperarm01", "lowerarm01") * -1 + 0.25) / 0.25, 0, 1)
    if top.sleeve is not None and top.sleeve > 0.2:
        sleeve = np.maximum(sleeve, 0.9)
    taper = np.clip(edge / 0.05, 0.8 if top.panel or top.sleeve is None or top.sleeve > 0.2 else 0.5, 1)
    return top.over + top.loose * taper * (0.25 + 0.75 * np.where(arm > 0.5, 0.75 * sleeve, below))


def top_folds(body: Body, mesh: Mesh, arm: np.ndarray, seed: int) -> np.ndarray:
    """Metres of folding: diagonal drapes at the waist and under the arms, rings around elbow and cuff."""
    points = mesh.points
    waist = bell(points[:, 2] - body.head("upperleg01.L")[2] - 0.12, 0.1)
    armpit = bell(np.abs(points[:, 0]) - 0.17, 0.05)
    slanted = points + np.abs(points[:, :1]) * [0, 0, 0.8]
    torso = 0.011 * (0.3 + 0.7 * np.maximum(waist, armpit)) * folds(slanted, 0.11, (2.2, 2, 0.8), seed)
    before = body.along(points, "lowerarm01", "wrist")
    ringed = np.stack([before, points[:, 1] * 0.4, points[:, 0] * 0.15], 1)
    elbow = bell(before - 0.24, 0.07) + bell(before - 0.03, 0.05)
    return torso * (1 - arm) + arm * 0.009 * (0.35 + 0.65 * elbow) * folds(ringed, 0.06, (1, 1, 1), seed + 1)


def tailoring(body: Body, top: Top, mesh: Mesh, arm: np.ndarray, cut: dict[str, np.ndarray]) -> np.ndarray:
    """Metres of relief of lapels along the gap and of padded rolls."""
    relief = np.zeros(len(mesh.points))
    if top.lapel and top.opening:
        depth = body.head("neck01")[2] - mesh.points[:, 2]
        end = max(down for down, half in top.opening if half > 0)
        width = top.lapel * np.clip((end - depth) / 0.1, 0, 1)
        relief += 0.006 * np.clip((width - cut["front"]) / 0.004, 0, 1) * (depth > -0.05)
    if top.quilt:
        along = np.where(arm > 0.5, body.along(mesh.points, "lowerarm01", "wrist"), mesh.points[:, 2])
        relief += top.quilt * np.abs(np.sin(np.pi * along / 0.075)) ** 0.6
    return relief


def front_panel(body: Body, top: Top, mesh: Mesh) -> np.ndarray:
    """1 where an open top shows the painted shirt under it."""
    if not top.panel:
        return np.zeros(len(mesh.points))
    points = mesh.points
    front = (points[:, 1] < body.head("spine03")[1] - 0.03) & (body.rides(mesh, ("upperarm", "lowerarm")) < 0.3)
    down = body.head("neck01")[2] - points[:, 2]
    half = 0.032 + 0.05 * down + 0.006 * waves(points, 0.3, (1, 1, 1), 17)
    return np.clip((half - np.abs(points[:, 0])) / 0.009, 0, 1) * front


def top_paint(body: Body, top: Top, below: Colour, mesh: Mesh, points: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """The top's colour with its hems, stripes, or what an open front shows; points: without folds."""
    colour = np.tile(np.array(top.colour), (len(points), 1))
    colour *= (1 + 0.08 * waves(points, 0.25, (1, 1, 1), 11))[:, None]
    dark, wide = (0.72, 0.03) if top.collar == "rib" else (0.8, 0.012)
    colour = mixed(colour, np.array(top.colour) * dark, (wide - edge) / 0.003)
    arm = body.arm(mesh)
    if top.stripes:
        across = np.where(arm > 0.5, body.along(points, "upperarm01", "wrist"), points[:, 0])
        colour = mixed(colour, top.stripes, (np.cos(2 * np.pi * across / 0.03) - 0.55) * 5)
        placket = (0.0015 - np.abs(np.abs(points[:, 0]) - 0.017)) / 0.001 * (points[:, 1] < 0)
        colour = mixed(colour, np.array(top.colour) * 0.5, placket * 0.8)
    if top.panel:
        belt = (body.head("upperleg01.L")[2] + 0.02 - points[:, 2]) / 0.003
        under = mixed(np.tile(np.array(top.panel), (len(points), 1)), below, belt)
        colour = mixed(colour, under, front_panel(body, top, mesh))
    if top.quilt:
        along = np.where(arm > 0.5, body.along(points, "lowerarm01", "wrist"), points[:, 2])
        colour = mixed(colour, np.array(top.colour) * 0.45, 1 - np.abs(np.sin(np.pi * along / 0.075)) * 3)
    return colour


def trousers_part(body: Body, trousers: Trousers, top: Top, seed: int) -> Part:
    """Straight trousers, bunched at knee and ankle."""
    mesh = body.groups["helper-tights"].subdivided()
    waist = body.head("upperleg01.L")[2] + min(0.1, top.hem + 0.05)
    ankle = body.head("foot.L")[2] + trousers.end
    hand = body.arm(mesh)
    mesh = mesh.clipped(np.where(hand > 0.1, -1, np.minimum(waist - mesh.points[:, 2], mesh.points[:, 2] - ankle)))
    mesh = mesh.subdivided()
    points = mesh.points
    knee = body.head("lowerleg01.L")[2]
    wide = trousers.wide if trousers.wide is not None else (0.018 if top.loose > 0.018 else 0.01)
    upper = max(0.011, wide * 0.6)
    gap = np.interp(points[:, 2], [min(ankle, knee - 0.01), knee, waist - 0.2, waist], [wide, wide, upper, 0.004])
    shell, out = draped(mesh, gap, 30)
    low = bell(points[:, 2] - ankle - 0.05, 0.06)
    bend = bell(points[:, 2] - knee, 0.08)
    crotch = bell(points[:, 2] - body.head("upperleg01.L")[2] + 0.08, 0.06)
    rings = folds(points + np.abs(points[:, :1]) * [0, 0, 0.5], 0.06, (2.2, 2.2, 0.7), seed)
    flow = folds(points, 0.12, (1, 1, 3), seed + 1) * max(1.0, wide / 0.014)
    mesh.points = shell + out * (rings * (0.011 * low + 0.009 * bend + 0.006 * crotch) + 0.004 * flow)[:, None]
    mesh.skin = normalized(mesh.smoothed(mesh.skin, 6))
    wear = np.clip(waves(points, 0.3, (1, 1, 1), seed + 2), -1, 1)
    colour = np.array(trousers.colour) * (1 + 0.12 * wear + 0.25 * bend * (points[:, 1] < 0))[:, None]
    return dyed(body, Part("trousers", mesh, colour, "cloth"), trousers.motifs, np.zeros(len(points)))


def skirt_part(body: Body, skirt: Skirt, seed: int) -> Part:
    """A skirt, or the lower part of a dress or coat, in pleats that widen downwards."""
    mesh = body.groups["helper-skirt"].subdivided()
    waist = body.head("upperleg01.L")[2] + skirt.waist
    hem = body.head("lowerleg01.L")[2] + skirt.hem
    mesh = mesh.clipped(waist - mesh.points[:, 2])
    mesh = mesh.clipped(mesh.points[:, 2] - hem)
    if skirt.opening:
        mesh = mesh.clipped(gap_edge(body, mesh.points, skirt.opening))
    mesh = mesh.subdivided()
    points = mesh.points
    down = np.clip((waist - points[:, 2]) / (waist - hem), 0, 1)
    out = mesh.smoothed(mesh.normals(), 6) * [1, 1, 0.2]
    hang = folds(points * [1, 1, 0.1], 0.11, (1, 1, 1), seed) + 0.3 * waves(points * [1, 1, 0.2], 0.06, (1, 1, 1), seed)
    relief = skirt.loose + skirt.flare * down + skirt.pleats * hang * np.clip(down * 2, 0.1, 1)
    mesh.points = mesh.smoothed(points, 10, mesh.border()) + out * relief[:, None]
    mesh.skin = normalized(mesh.smoothed(mesh.skin, 10))
    colour = np.array(skirt.colour) * (1 + 0.06 * waves(points, 0.25, (1, 1, 1), seed))[:, None]
    colour = mixed(colour, np.array(skirt.colour) * 0.8, (0.012 - (points[:, 2] - hem)) / 0.003)
    return dyed(body, Part("skirt", mesh, colour, "cloth"), skirt.motifs, np.zeros(len(points)))


def shoes_part(body: Body, paint: Colour, sole: Colour | None) -> Part:
    """Shoes with a flat pale sole."""
    mesh = body.groups["helper-tights"].subdivided()
    mesh = mesh.clipped(body.head("foot.L")[2] + 0.012 - mesh.points[:, 2]).subdivided()
    height = mesh.points[:, 2]
    out = mesh.smoothed(mesh.normals(), 6)
    points = mesh.smoothed(mesh.points + out * 0.009, 8, mesh.border())
    under = np.clip((SOLE + 0.02 - height) / 0.02, 0, 1)
    points[:, 2] = np.where(under > 0, points[:, 2] * (1 - under) + under * (points[:, 2] - SOLE * 0.8), points[:, 2])
    points[:, 2] = np.maximum(points[:, 2], 0.0)
    flare = under * 0.005 * (1 - (np.abs(out[:, 2]) > 0.8))
    mesh.points = points + out * [1, 1, 0] * flare[:, None]
    mesh.skin = normalized(mesh.smoothed(mesh.skin, 4))
    colour = np.tile(np.array(paint), (len(points), 1))
    rim = np.array(sole) if sole else np.array(paint) * 0.4 + 0.25
    colour = mixed(colour, rim, (SOLE + (0.006 if sole else 0) - points[:, 2]) / 0.003)
    return Part("shoes", mesh, colour, "leather")
