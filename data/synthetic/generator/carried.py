"""Carried, pushed and ridden things: a phone, a box, a trolley, a briefcase, a plank, a wheelchair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from body import Body, mixed
from gait import Walker, turn
from mesh import waves
from posture import Build, reaches
from worn import block, merged, tube

Triple = tuple[float, float, float]
Shape = tuple[np.ndarray, np.ndarray]
Points = tuple[np.ndarray, np.ndarray, np.ndarray]
CARDBOARD, STEEL, BLACK = (0.36, 0.23, 0.12), (0.42, 0.43, 0.45), (0.015, 0.015, 0.017)
FABRIC = (0.03, 0.035, 0.05)


@dataclass(frozen=True)
class Load:
    """A stiff thing: points around its own origin, faces, colours, and what it follows.

    follows: "trunk" (rest coordinates of the trunk), "palm" (the right palm, upright, turned with the trunk), "hand"
    (rest coordinates of the right hand) or "floor" (before the feet). posture: shown only in it, None always.
    """

    name: str
    points: np.ndarray
    faces: np.ndarray
    colour: np.ndarray
    follows: str
    posture: str | None = None

    def matrix(self, walker: Walker, transforms: np.ndarray, time: float) -> np.ndarray:
        """Place (3, 4) in the world."""
        skeleton = walker.skeleton
        if self.follows == "trunk":
            return transforms[skeleton.index["spine03"]]
        if self.follows == "hand":
            return transforms[skeleton.index["wrist.R"]]
        x, y, heading = walker.track(time)
        spin = turn("z", heading)
        if self.follows == "floor":
            return np.c_[spin, [x, y, 0]]
        palm = (skeleton.head("finger3-1.R") + skeleton.head("wrist.R")) / 2
        bone = transforms[skeleton.index["finger3-1.R"]]
        return np.c_[spin, bone[:, :3] @ (palm * 0.4 + skeleton.head("finger3-1.R") * 0.6) + bone[:, 3]]

    def shown(self, walker: Walker, time: float) -> bool:
        """Whether it is in the hand now."""
        return self.posture is None or walker.postures.share(time, self.posture) > 0.05


def painted(pieces: list[tuple[Shape, Triple]]) -> Points:
    """Points, faces and colours of pieces in one colour each."""
    points, faces = merged([piece for piece, _ in pieces])
    colour = np.concatenate([np.tile(np.array(paint), (len(piece[0]), 1)) for piece, paint in pieces])
    return points, faces, colour


def bar(low: Triple, high: Triple, cells: int = 1) -> Shape:
    """A sharp block."""
    return block(np.array(low), np.array(high), cells, 0.0)


def box(body: Body, build: Build) -> Load:
    """A cardboard box in the arms, with tape."""
    wrist = reaches("carry", build)["L"].wrist
    low = np.array([-0.205, wrist[1] - 0.2, wrist[2] - 0.075])
    points, faces = block(low, low + np.array([0.41, 0.33, 0.27]), 16, 0.04)
    middle = low + np.array([0.205, 0.165, 0.135])
    colour = np.array(CARDBOARD) * (1 + 0.12 * waves(points, 0.2, (1, 1, 1), 51))[:, None]
    colour = mixed(colour, (0.42, 0.33, 0.2), (0.03 - np.abs(points[:, 0] - middle[0])) / 0.004)
    label = (np.abs(points[:, 0] - 0.1) < 0.06) & (np.abs(points[:, 2] - middle[2]) < 0.05)
    label &= points[:, 1] < low[1] + 0.02
    return Load("box", points, faces, mixed(colour, (0.7, 0.7, 0.68), label.astype(float)), "trunk")


def trolley(body: Body, build: Build) -> Load:
    """Two trays on wheels, with things on them."""
    wrist = reaches("push", build)["L"].wrist
    grip, near = wrist[2], wrist[1] - 0.08
    far, half = near - 0.78, 0.25
    pieces = [(bar((-half, far, z), (half, near - 0.06, z + 0.03)), STEEL) for z in (0.18, 0.72)]
    for x in (-half, half):
        for y in (far + 0.02, near - 0.08):
            pieces.append((tube(np.array([[x, y, 0.1], [x, y, 0.78]]), 0.014), STEEL))
            wheel = tube(np.array([[x - 0.015, y, 0.055], [x + 0.015, y, 0.055]]), 0.055, 14)
            pieces.append((wheel, BLACK))
        bow = np.array([[x, near - 0.08, 0.74], [x, near - 0.04, grip - 0.06], [x, near, grip]])
        pieces.append((tube(bow, 0.014), STEEL))
    pieces.append((tube(np.array([[-half, near, grip], [half, near, grip]]), 0.016), BLACK))
    pieces += [
        (bar((-0.2, far + 0.08, 0.75), (0.12, far + 0.42, 0.98), 3), CARDBOARD),
        (bar((-0.18, far + 0.46, 0.75), (0.2, far + 0.62, 0.86), 3), (0.1, 0.16, 0.3)),
        (bar((-0.22, far + 0.06, 0.21), (0.2, far + 0.5, 0.46), 3), (0.55, 0.55, 0.52)),
    ]
    return Load("trolley", *painted(pieces), "floor")


def case(body: Body, build: Build) -> Load:
    """A briefcase that hangs from the right hand."""
    leather = (0.07, 0.032, 0.016)
    handle = np.array([[0, -0.06, -0.045], [0, -0.055, -0.005], [0, 0.055, -0.005], [0, 0.06, -0.045]])
    pieces = [
        (block(np.array([-0.05, -0.21, -0.35]), np.array([0.05, 0.21, -0.04]), 8, 0.12), leather),
        (tube(handle, 0.01), BLACK),
        (bar((-0.054, -0.14, -0.14), (-0.048, -0.11, -0.08)), STEEL),
        (bar((-0.054, 0.11, -0.14), (-0.048, 0.14, -0.08)), STEEL),
    ]
    return Load("case", *painted(pieces), "palm")


def plank(body: Body, build: Build) -> Load:
    """A long board under the right arm."""
    board = bar((-0.012, -0.95, -0.05), (0.012, 0.85, 0.19), 4)
    points, faces, colour = painted([(board, (0.42, 0.27, 0.13))])
    grain = 1 + 0.15 * waves(points, 0.1, (1, 8, 1), 52)
    return Load("plank", points, faces, colour * grain[:, None], "palm")


def phone(body: Body, build: Build, posture: str) -> Load:
    """A phone in the right hand, placed at rest where the palm is."""
    skeleton = body.skeleton
    wrist, knuckle = skeleton.head("wrist.R"), skeleton.head("finger3-1.R")
    ahead = (knuckle - wrist) / np.linalg.norm(knuckle - wrist)
    thumb = np.array([0, -1.0, 0]) - ahead * -ahead[1]
    thumb /= np.linalg.norm(thumb)
    palm = np.cross(ahead, thumb)
    palm *= np.sign(palm @ np.array([1.0, 0, -1.0]))
    points, faces = block(np.array([-0.075, -0.036, -0.004]), np.array([0.075, 0.036, 0.004]), 4, 0.1)
    axes = np.stack([ahead, thumb, palm], 1)
    centre = wrist + ahead * 0.105 + palm * 0.03 + thumb * 0.005
    colour = np.tile(np.array(BLACK), (len(points), 1))
    return Load("phone", points @ axes.T + centre, faces, colour, "hand", posture)


def wheelchair(body: Body, build: Build) -> Load:
    """A self-propelled wheelchair around its rider, its seat over the origin."""
    angle = np.linspace(0, 2 * np.pi, 41)
    pieces = [
        (block(np.array([-0.2, -0.3, 0.425]), np.array([0.2, 0.16, 0.47]), 6, 0.1), FABRIC),
        (block(np.array([-0.2, 0.155, 0.5]), np.array([0.2, 0.185, 0.9]), 6, 0.1), FABRIC),
    ]
    for side in (-1, 1):
        for x, radius, thick, paint in ((0.26, 0.3, 0.016, BLACK), (0.285, 0.26, 0.008, STEEL)):
            rim = np.stack([0 * angle + side * x, 0.08 + radius * np.cos(angle), 0.316 + radius * np.sin(angle)], 1)
            pieces.append((tube(rim, thick), paint))
        for spoke in angle[:-1:4]:
            end = np.array([side * 0.26, 0.08 + 0.29 * np.cos(spoke), 0.316 + 0.29 * np.sin(spoke)])
            pieces.append((tube(np.stack([[side * 0.23, 0.08, 0.316], end]), 0.003, 4), STEEL))
        caster = np.stack([0 * angle + side * 0.19, -0.36 + 0.055 * np.cos(angle), 0.07 + 0.055 * np.sin(angle)], 1)
        pieces.append((tube(caster, 0.014), BLACK))
        paths = (
            [[0.21, 0.17, 0.2], [0.21, 0.17, 0.94], [0.21, 0.29, 0.95]],
            [[0.21, 0.17, 0.45], [0.21, -0.34, 0.45], [0.18, -0.46, 0.2], [0.18, -0.5, 0.11]],
            [[0.21, 0.17, 0.2], [0.21, -0.33, 0.2], [0.19, -0.36, 0.07]],
            [[0.235, 0.08, 0.316], [0.21, 0.08, 0.45]],
        )
        pieces += [(tube(np.array(path) * [side, 1, 1], 0.013), STEEL) for path in paths]
        low, high = sorted((side * 0.03, side * 0.19))
        pieces.append((bar((low, -0.66, 0.1), (high, -0.48, 0.115)), BLACK))
    return Load("wheelchair", *painted(pieces), "floor")


LOADS = {"box": box, "trolley": trolley, "case": case, "plank": plank, "wheelchair": wheelchair}


def loads_of(body: Body, build: Build, carries: str | None, postures: set[str]) -> list[Load]:
    """Everything a role has in the hands at some time."""
    made = [LOADS[carries](body, build)] if carries in LOADS else []
    return made + [phone(body, build, name) for name in ("phone", "reading") if name in postures]
