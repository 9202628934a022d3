"""Clothes cut from shells around the body: a top, trousers, shoes."""

from __future__ import annotations

import numpy as np
from body import SOLE, Body, Outfit, Part, bell, mixed
from mesh import Mesh, folds, normals, waves

INSET = 0.008


def top_cut(body: Body, mesh: Mesh, outfit: Outfit) -> dict[str, np.ndarray]:
    """Metres inside each hem of a long-sleeved top."""
    points = mesh.points
    arm = body.rides(mesh, ("upperarm", "lowerarm", "wrist"))
    cuff = np.where(arm > 0.5, body.along(points, "lowerarm01", "wrist") - 0.012, 1.0)
    neck = body.head("neck01") + np.array([0, 0, 0.035 + outfit.neck])
    slope = np.array([0, 0.38, 1.0]) / np.hypot(0.38, 1)
    collar = np.where(arm < 0.5, (neck - points) @ slope, 1.0)
    hips = body.head("upperleg01.L")[2] + outfit.hem
    return {"hem": np.where(arm < 0.5, points[:, 2] - hips, 1.0), "collar": collar, "cuff": cuff}


def draped(mesh: Mesh, gap: np.ndarray, rounds: int) -> tuple[np.ndarray, np.ndarray]:
    """An inflated, smoothed shell that keeps half its gap to the body; points and their normals."""
    out = mesh.smoothed(mesh.normals(), 3)
    base, goal = mesh.points, mesh.points + out * gap[:, None]
    soft = mesh.smoothed(goal, rounds, mesh.border())
    missing = np.maximum(0.5 * gap - ((soft - base) * out).sum(1), 0)
    soft = mesh.smoothed(soft + out * missing[:, None], 2)
    return soft, normals(soft, mesh.faces)


def normalized(skin: np.ndarray) -> np.ndarray:
    """Skin weights that sum to one again after smoothing, in single precision."""
    return (skin / skin.sum(1, keepdims=True)).astype(np.float32)


def top_part(body: Body, outfit: Outfit, seed: int) -> Part:
    """A long-sleeved top with ribbed hems; long skirts of it also hang free of the legs."""
    mesh = body.groups["helper-tights"].subdivided()
    for hem in ("hem", "collar", "cuff"):
        mesh = mesh.clipped(top_cut(body, mesh, outfit)[hem])
    mesh = mesh.subdivided()
    cut = top_cut(body, mesh, outfit)
    edge = np.minimum(cut["hem"], np.minimum(cut["collar"], cut["cuff"]))
    arm = np.clip(body.rides(mesh, ("upperarm02", "lowerarm", "wrist")), 0, 1)
    points, out = draped(mesh, top_gap(body, outfit, mesh, arm, edge), 30)
    calm = np.clip(edge / 0.05, 0.1, 1)
    relief = (top_folds(body, mesh, arm, seed) - INSET * front_panel(body, outfit, mesh)) * calm
    mesh.points = points + out * (relief + 0.003 * np.clip((0.03 - edge) / 0.004, 0, 1))[:, None]
    colour = top_paint(body, outfit, mesh, points, edge)
    mesh.skin = normalized(mesh.smoothed(mesh.skin, 6))
    return Part("top", mesh, colour, "cloth")


def top_gap(body: Body, outfit: Outfit, mesh: Mesh, arm: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """Metres between body and cloth: close on the shoulders, loose below."""
    below = np.clip((body.head("upperarm01.L")[2] - mesh.points[:, 2]) / 0.3, 0, 1)
    sleeve = np.clip((body.along(mesh.points, "upperarm01", "lowerarm01") * -1 + 0.25) / 0.25, 0, 1)
    taper = np.clip(edge / 0.05, 0.8 if outfit.open_front else 0.5, 1)
    return outfit.loose * taper * (0.25 + 0.75 * np.where(arm > 0.5, 0.75 * sleeve, below))


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


def front_panel(body: Body, outfit: Outfit, mesh: Mesh) -> np.ndarray:
    """1 where an open top shows what is under it."""
    if not outfit.open_front:
        return np.zeros(len(mesh.points))
    points = mesh.points
    front = (points[:, 1] < body.head("spine03")[1] - 0.03) & (body.rides(mesh, ("upperarm", "lowerarm")) < 0.3)
    down = body.head("neck01")[2] - points[:, 2]
    half = 0.032 + 0.05 * down + 0.006 * waves(points, 0.3, (1, 1, 1), 17)
    return np.clip((half - np.abs(points[:, 0])) / 0.009, 0, 1) * front


def top_paint(body: Body, outfit: Outfit, mesh: Mesh, points: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """The top's colour with its hems, stripes, or what an open front shows; points: without folds."""
    colour = np.tile(np.array(outfit.top), (len(points), 1))
    colour *= (1 + 0.08 * waves(points, 0.25, (1, 1, 1), 11))[:, None]
    colour = mixed(colour, np.array(outfit.top) * 0.72, (0.03 - edge) / 0.003)
    arm = body.rides(mesh, ("upperarm", "lowerarm", "wrist"))
    if outfit.stripes:
        across = np.where(arm > 0.5, body.along(points, "upperarm01", "wrist"), points[:, 0])
        colour = mixed(colour, outfit.stripes, (np.cos(2 * np.pi * across / 0.03) - 0.55) * 5)
        placket = (0.0015 - np.abs(np.abs(points[:, 0]) - 0.017)) / 0.001 * (points[:, 1] < 0)
        colour = mixed(colour, np.array(outfit.top) * 0.5, placket * 0.8)
    if outfit.open_front:
        belt = (body.head("upperleg01.L")[2] + 0.02 - points[:, 2]) / 0.003
        under = mixed(np.tile(np.array(outfit.open_front), (len(points), 1)), outfit.trousers, belt)
        colour = mixed(colour, under, front_panel(body, outfit, mesh))
    return colour


def trousers_part(body: Body, outfit: Outfit, seed: int) -> Part:
    """Straight trousers, bunched at knee and ankle, with a pocket seam."""
    mesh = body.groups["helper-tights"].subdivided()
    waist = body.head("upperleg01.L")[2] + min(0.1, outfit.hem + 0.05)
    ankle = body.head("foot.L")[2] - 0.05
    hand = body.rides(mesh, ("upperarm", "lowerarm", "wrist"))
    mesh = mesh.clipped(np.where(hand > 0.1, -1, np.minimum(waist - mesh.points[:, 2], mesh.points[:, 2] - ankle)))
    mesh = mesh.subdivided()
    points = mesh.points
    knee = body.head("lowerleg01.L")[2]
    wide = 0.018 if outfit.loose > 0.018 else 0.01
    gap = np.interp(points[:, 2], [ankle, knee, waist - 0.2, waist], [wide, wide, 0.011, 0.004])
    shell, out = draped(mesh, gap, 30)
    low = bell(points[:, 2] - ankle - 0.05, 0.06)
    bend = bell(points[:, 2] - knee, 0.08)
    crotch = bell(points[:, 2] - body.head("upperleg01.L")[2] + 0.08, 0.06)
    rings = folds(points + np.abs(points[:, :1]) * [0, 0, 0.5], 0.06, (2.2, 2.2, 0.7), seed)
    flow = folds(points, 0.12, (1, 1, 3), seed + 1)
    mesh.points = shell + out * (rings * (0.011 * low + 0.009 * bend + 0.006 * crotch) + 0.004 * flow)[:, None]
    mesh.skin = normalized(mesh.smoothed(mesh.skin, 6))
    wear = np.clip(waves(points, 0.3, (1, 1, 1), seed + 2), -1, 1)
    colour = np.array(outfit.trousers) * (1 + 0.12 * wear + 0.25 * bend * (points[:, 1] < 0))[:, None]
    return Part("trousers", mesh, colour, "cloth")


def shoes_part(body: Body, outfit: Outfit) -> Part:
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
    colour = np.tile(np.array(outfit.shoes), (len(points), 1))
    colour = mixed(colour, np.array(outfit.shoes) * 0.4 + 0.25, (SOLE - points[:, 2]) / 0.003)
    return Part("shoes", mesh, colour, "leather")
