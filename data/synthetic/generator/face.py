"""Bare skin with a painted face, and the eyes."""

from __future__ import annotations

import numpy as np
from body import Body, Outfit, Part, bell, mixed, spot
from gait import SIDES
from mesh import Mesh, waves


def skin_part(body: Body, outfit: Outfit) -> Part:
    """Head, neck and hands, with brows, lips, cheeks and stubble painted on; clothes hide the rest."""
    mesh = body.groups["body"]
    shown = body.rides(mesh, ("wrist", "finger", "metacarpal")) > 0.02
    shown |= mesh.points[:, 2] > body.head("spine01")[2] - 0.1
    shown |= np.abs(body.along(mesh.points, "lowerarm01", "wrist")) < 0.06
    mesh = mesh.kept(mesh.faces[shown[mesh.faces].all(1)]).subdivided()
    return Part("skin", mesh, face_paint(body, outfit, mesh), "skin")


def face_paint(body: Body, outfit: Outfit, mesh: Mesh) -> np.ndarray:
    """Colours of the skin."""
    points, skin = mesh.points, np.array(outfit.skin)
    colour = skin * (1 + 0.05 * waves(points, 0.05, (1, 1, 1), 3))[:, None]
    mouth = (body.head("oris05") + body.head("oris01")) * [0, 0.5, 0.5]
    front = points[:, 1] < body.eye()[1] + 0.03
    for side in SIDES.values():
        colour = eye_paint(body, outfit, points, colour, side)
    jaw = spot(points, mouth - [0, 0, 0.015], (0.05, 0.07, 0.032)) * front
    colour = mixed(colour, np.array(outfit.hair) + 0.03, outfit.stubble * 1.4 * jaw)
    shape = ((points[:, 0] / 0.024) ** 2 + ((points[:, 2] - mouth[2]) / 0.0085) ** 2) ** 2
    return mixed(colour, outfit.lips, 0.9 * np.exp(-shape) * (points[:, 1] < mouth[1] + 0.03))


def eye_paint(body: Body, outfit: Outfit, points: np.ndarray, colour: np.ndarray, side: float) -> np.ndarray:
    """Brow, lashes and cheek of one side over the colours so far."""
    skin, eye = np.array(outfit.skin), body.eye()
    half = body.head("eye.L")[0]
    bow = eye[2] + 0.026 - 6.0 * (points[:, 0] - side * (half + 0.004)) ** 2
    brow = bell(points[:, 2] - bow, 0.0034) * (np.abs(points[:, 0] - side * half) < 0.023)
    colour = mixed(colour, np.array(outfit.hair) * 1.1, 0.85 * brow * (points[:, 1] < eye[1] + 0.03))
    lashes = spot(points, np.array([side * half, eye[1] - 0.01, eye[2]]), (0.019, 0.03, 0.008))
    colour = mixed(colour, skin * 0.45, 0.5 * lashes)
    cheek = spot(points, np.array([side * 0.045, eye[1], eye[2] - 0.045]), (0.02, 0.05, 0.02))
    return mixed(colour, np.array(outfit.lips) * 0.6 + skin * 0.4, 0.35 * cheek)


def eye_part(body: Body, outfit: Outfit, side: str) -> Part:
    """White, iris and pupil by the angle from straight ahead."""
    mesh = body.groups[f"helper-{side.lower()}-eye"].subdivided().subdivided()
    centre = (mesh.points.min(0) + mesh.points.max(0)) / 2
    away = mesh.points - centre
    radius = np.linalg.norm(away, axis=1).max()
    off = np.hypot(away[:, 0], away[:, 2]) / radius + (away[:, 1] > 0) * 2
    colour = np.tile(np.array([0.55, 0.53, 0.5]), (len(off), 1))
    colour = mixed(colour, outfit.iris, (0.56 - off) * 30)
    colour = mixed(colour, (0.005, 0.005, 0.005), (0.24 - off) * 30)
    return Part(f"eye {side}", mesh, colour, "eye")
