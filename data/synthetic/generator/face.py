"""Bare skin with a painted face, and the eyes."""

from __future__ import annotations

import numpy as np
from body import Body, Part, bell, mixed, spot
from gait import SIDES
from hair import jaw, scalp_paint
from mesh import Mesh, waves
from outfit import Look, Outfit


def bare(body: Body, outfit: Outfit, mesh: Mesh) -> np.ndarray:
    """Which vertices clothes may leave bare: head, neck and hands, arms beyond the sleeves, legs below the hems."""
    points = mesh.points
    sleeves = [top.sleeve for top in outfit.tops if top.sleeve is not None]
    shown = body.rides(mesh, ("wrist", "finger", "metacarpal")) > 0.02
    shown |= points[:, 2] > body.head("neck01")[2] - 0.07
    before = body.along(points, "lowerarm01", "wrist")
    if min(sleeves) > 0.1:
        shown |= (body.arm(mesh) > 0.5) & (before < min(sleeves) + 0.06)
    else:
        shown |= np.abs(before) < 0.06
    hems = [body.head("foot.L")[2] - 0.06]
    if outfit.trousers:
        hems.append(body.head("foot.L")[2] + outfit.trousers.end)
    elif outfit.skirt:
        hems.append(body.head("lowerleg01.L")[2] + outfit.skirt.hem)
    if max(hems) > body.head("foot.L")[2] + 0.05:
        legs = body.rides(mesh, ("upperleg", "lowerleg", "foot")) > 0.5
        shown |= legs & (points[:, 2] < max(hems) + 0.08) & (points[:, 2] > body.head("foot.L")[2] - 0.04)
    return shown


def skin_part(body: Body, outfit: Outfit) -> Part:
    """What clothes leave bare, the face fine, with brows, lips, cheeks and stubble painted on."""
    mesh = body.groups["body"]
    shown = bare(body, outfit, mesh)[mesh.faces].all(1)
    head = (mesh.points[:, 2] > body.head("neck01")[2] + 0.02)[mesh.faces].all(1)
    fine, coarse = mesh.kept(mesh.faces[shown & head]).subdivided(), mesh.kept(mesh.faces[shown & ~head])
    mesh = fine.joined(coarse, np.concatenate([fine.faces, coarse.faces + len(fine.points)]))
    colour = face_paint(body, outfit.look, mesh)
    if outfit.stockings:
        legs = body.rides(mesh, ("upperleg", "lowerleg", "foot", "toe", "root", "pelvis"))
        colour = mixed(colour, outfit.stockings, 0.85 * legs)
    return Part("skin", mesh, colour, "skin")


def face_paint(body: Body, look: Look, mesh: Mesh) -> np.ndarray:
    """Colours of the skin."""
    points, skin = mesh.points, np.array(look.skin)
    colour = skin * (1 + 0.05 * waves(points, 0.05, (1, 1, 1), 3))[:, None]
    mouth = (body.head("oris05") + body.head("oris01")) * [0, 0.5, 0.5]
    front = points[:, 1] < body.eye()[1] + 0.03
    for side in SIDES.values():
        colour = eye_paint(body, look, points, colour, side)
    chin = spot(points, mouth - [0, 0, 0.015], (0.05, 0.07, 0.032)) * front
    colour = mixed(colour, np.array(look.hair) + 0.03, look.stubble * 1.4 * chin)
    if look.beard:
        colour = mixed(colour, np.array(look.hair), 0.8 * np.clip(jaw(body, points) / 0.008, 0, 1))
    colour = age_paint(body, look, points, colour, mouth)
    shape = ((points[:, 0] / 0.024) ** 2 + ((points[:, 2] - mouth[2]) / 0.0085) ** 2) ** 2
    colour = mixed(colour, look.lips, 0.9 * np.exp(-shape) * (points[:, 1] < mouth[1] + 0.03))
    parted = bell(points[:, 2] - mouth[2], 0.0016) * (np.abs(points[:, 0]) < 0.022) * (points[:, 1] < mouth[1] + 0.03)
    colour = mixed(colour, np.array(look.lips) * 0.35, 0.5 * parted)
    return scalp_paint(body, look, points, colour)


def age_paint(body: Body, look: Look, points: np.ndarray, colour: np.ndarray, mouth: np.ndarray) -> np.ndarray:
    """Lines on the forehead, beside the nose and under the eyes."""
    if not look.lines:
        return colour
    eye, dark = body.eye(), np.array(look.skin) * 0.62
    front = points[:, 1] < eye[1] + 0.03
    height = points[:, 2] - eye[2] - 0.006 * np.cos(points[:, 0] * 60)
    brow = sum(bell(height - level, 0.0016) for level in (0.044, 0.054, 0.064)) * (np.abs(points[:, 0]) < 0.04)
    drop = eye[2] - 0.035 - points[:, 2]
    fold = bell(np.abs(points[:, 0]) - 0.019 - 0.28 * drop, 0.0022) * (drop > 0) * (points[:, 2] > mouth[2] - 0.015)
    share = 0.5 * brow + 0.65 * fold
    for side in SIDES.values():
        under = np.hypot((points[:, 0] - side * body.head("eye.L")[0]) / 1.2, points[:, 2] - eye[2] + 0.002)
        share = share + 0.5 * bell(under - 0.018, 0.0022) * (points[:, 2] < eye[2] - 0.008)
    return mixed(colour, dark, look.lines * share * front)


def eye_paint(body: Body, look: Look, points: np.ndarray, colour: np.ndarray, side: float) -> np.ndarray:
    """Brow, lashes and cheek of one side over the colours so far."""
    skin, eye = np.array(look.skin), body.eye()
    half = body.head("eye.L")[0]
    bow = eye[2] + 0.026 - 6.0 * (points[:, 0] - side * (half + 0.004)) ** 2
    brow = bell(points[:, 2] - bow, 0.0034) * (np.abs(points[:, 0] - side * half) < 0.023)
    tint = np.array(look.hair) * (1.1 if look.lines < 0.6 else 0.55)
    colour = mixed(colour, tint, look.brows * brow * (points[:, 1] < eye[1] + 0.03))
    lashes = spot(points, np.array([side * half, eye[1] - 0.01, eye[2]]), (0.019, 0.03, 0.008))
    colour = mixed(colour, skin * 0.45, 0.5 * lashes)
    cheek = spot(points, np.array([side * 0.045, eye[1], eye[2] - 0.045]), (0.02, 0.05, 0.02))
    return mixed(colour, np.array(look.lips) * 0.6 + skin * 0.4, 0.35 * cheek)


def eye_part(body: Body, look: Look, side: str) -> Part:
    """White, iris and pupil by the angle from straight ahead."""
    mesh = body.groups[f"helper-{side.lower()}-eye"].subdivided().subdivided()
    centre = (mesh.points.min(0) + mesh.points.max(0)) / 2
    away = mesh.points - centre
    radius = np.linalg.norm(away, axis=1).max()
    off = np.hypot(away[:, 0], away[:, 2]) / radius + (away[:, 1] > 0) * 2
    colour = np.tile(np.array([0.55, 0.53, 0.5]), (len(off), 1))
    colour = mixed(colour, look.iris, (0.56 - off) * 30)
    colour = mixed(colour, (0.005, 0.005, 0.005), (0.24 - off) * 30)
    return Part(f"eye {side}", mesh, colour, "eye")


def lash_part(body: Body, side: str) -> Part:
    """The lashes of the upper lid."""
    mesh = body.groups[f"helper-{side.lower()}-eyelashes-2"]
    return Part(f"lashes {side}", mesh, np.full((len(mesh.points), 3), 0.01), "hair")
