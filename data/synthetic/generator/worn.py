"""Worn things: glasses, cap, headscarf, backpack, shoulder bag, badge on a string."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from body import Body, Part, mixed
from collar import sheet, smooth_loop
from fabric import around_trunk
from gait import SIDES
from mesh import Mesh, folds, waves
from outfit import Colour, Look

BELT, BELT_COLUMNS = 0.045, 96


def block(low: np.ndarray, high: np.ndarray, cells: int = 6, round_off: float = 0.25) -> tuple[np.ndarray, np.ndarray]:
    """A rounded box: points and faces."""
    side = np.linspace(-1, 1, cells + 1)
    points, faces = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = np.meshgrid(side, side, indexing="ij")
            grid = np.empty((cells + 1, cells + 1, 3))
            grid[:, :, axis], grid[:, :, (axis + 1) % 3], grid[:, :, (axis + 2) % 3] = sign, u, v
            index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1) + len(points) * (cells + 1) ** 2
            quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], 2).reshape(-1, 4)
            faces.append(quads if sign > 0 else quads[:, ::-1])
            points.append(grid.reshape(-1, 3))
    unit = np.concatenate(points)
    length = np.linalg.norm(unit, ord=4, axis=1, keepdims=True)
    unit = unit * (1 - round_off) + unit / length * round_off
    quads = np.concatenate(faces)
    middle, half = (np.asarray(low) + high) / 2, (np.asarray(high) - low) / 2
    return middle + unit * half, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def merged(pieces: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Several point and face lists as one."""
    starts = np.cumsum([0] + [len(points) for points, _ in pieces])
    return (
        np.concatenate([points for points, _ in pieces]),
        np.concatenate([faces + start for (_, faces), start in zip(pieces, starts[:-1], strict=True)]),
    )


def surface(parts: list[Part]) -> Mesh:
    """All cloth as one vertex cloud with normals to lay straps on (faces kept)."""
    chosen = [part for part in parts if part.name in ("top", "skirt")]
    starts = np.cumsum([0] + [len(part.mesh.points) for part in chosen])
    return Mesh(
        np.concatenate([part.mesh.points for part in chosen]),
        np.concatenate([part.mesh.faces + start for part, start in zip(chosen, starts[:-1], strict=True)]),
        np.concatenate([part.mesh.skin for part in chosen]),
    )


def strap(cloth: Mesh, path: np.ndarray, half: float, lift: float = 0.006) -> Mesh:
    """A band along a rough path over the cloth, laid onto its surface."""
    legs = np.linalg.norm(np.diff(path, axis=0), axis=1)
    length = np.concatenate([[0], np.cumsum(legs)])
    wanted = np.linspace(0, length[-1], max(12, int(length[-1] / 0.015)))
    rough = np.stack([np.interp(wanted, length, column) for column in path.T], 1)
    rough = smooth_loop(rough, np.ones(5) / 5, False)
    out = cloth.smoothed(cloth.normals(), 4)
    near = np.array([np.argmin(((cloth.points - point) ** 2).sum(1)) for point in rough])
    middle = smooth_loop(cloth.points[near] + out[near] * lift, np.ones(7) / 7, False)
    raised = middle + out[near] * 0.004
    ahead = np.gradient(raised, axis=0)
    aside = np.cross(ahead, out[near])
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-9)
    aside = smooth_loop(aside, np.ones(5) / 5, False)
    lower = out[near] * 0.005
    rows = np.stack([raised - aside * half - lower, raised - aside * half, raised, raised + aside * half,
                     raised + aside * half - lower])  # fmt: skip
    skin = smooth_loop(cloth.skin[near], np.ones(9) / 9, False)
    return sheet(rows, skin / skin.sum(1, keepdims=True), False)


def trunk_extent(body: Body, cloth: Mesh, height: float, half: float) -> tuple[float, float]:
    """Frontmost and hindmost y of the cloth at a height within half a width of the middle."""
    arm = body.arm(cloth)
    near = (np.abs(cloth.points[:, 2] - height) < 0.04) & (np.abs(cloth.points[:, 0]) < half) & (arm < 0.2)
    return float(cloth.points[near, 1].min()), float(cloth.points[near, 1].max())


def backpack(body: Body, parts: list[Part], paint: Colour) -> list[Part]:
    """A pack on the back with two padded straps."""
    cloth = surface(parts)
    neck, hip = body.head("neck01")[2], body.head("upperleg01.L")[2]
    back = trunk_extent(body, cloth, neck - 0.18, 0.12)[1]
    low = trunk_extent(body, cloth, hip + 0.15, 0.12)[1]
    base = max(back, low) - 0.015
    pieces = [
        block(np.array([-0.15, base, hip + 0.1]), np.array([0.15, base + 0.15, neck - 0.02]), 10, 0.55),
        block(np.array([-0.12, base + 0.11, hip + 0.12]), np.array([0.12, base + 0.19, neck - 0.22]), 8, 0.5),
    ]
    points, faces = merged(pieces)
    lump = Mesh(points, faces, body.bound(len(points), "spine02"))
    lump.points = points + lump.normals() * (0.006 * waves(points, 0.12, (1, 1, 1), 31))[:, None]
    colour = np.array(paint) * (1 + 0.15 * waves(points, 0.1, (1, 1, 1), 32))[:, None]
    seam = np.minimum(np.abs(points[:, 2] - neck + 0.14), np.abs(points[:, 1] - base - 0.075))
    colour = mixed(colour, np.array(paint) * 0.35, (0.006 - seam) / 0.003)
    made = [Part("backpack", lump, colour, "cloth")]
    shoulder = body.head("upperarm01.L")
    for sign in SIDES.values():
        x = sign * 0.6 * shoulder[0]
        front = trunk_extent(body, cloth, neck - 0.2, 0.14)[0]
        path = np.array([
            [x * 0.8, base + 0.01, neck - 0.07], [x * 0.85, (base + shoulder[1]) / 2, neck + 0.02],
            [x * 0.95, shoulder[1] - 0.03, neck + 0.03], [x, front, neck - 0.1], [x * 1.05, front, neck - 0.24],
            [x * 1.3, shoulder[1] - 0.02, neck - 0.33], [x * 1.1, base, neck - 0.38],
        ])  # fmt: skip
        band = strap(cloth, path, 0.028, 0.008)
        made.append(Part("strap", band, np.tile(np.array(paint) * 0.8, (len(band.points), 1)), "cloth"))
    return made


def shoulder_bag(body: Body, parts: list[Part], paint: Colour) -> list[Part]:
    """A bag at the right hip on a band over the left shoulder."""
    cloth = surface(parts)
    neck, hip = body.head("neck01")[2], body.head("upperleg01.L")[2]
    shoulder = body.head("upperarm01.L")
    front, back = trunk_extent(body, cloth, neck - 0.2, 0.14)
    wide = cloth.points[(np.abs(cloth.points[:, 2] - hip - 0.05) < 0.05) & (body.arm(cloth) < 0.2), 0].min()
    x = shoulder[0] * 0.55
    path = np.array([
        [wide, -0.02, hip + 0.07], [wide * 0.6, front, hip + 0.2], [0.0, front, neck - 0.24], [x, front, neck - 0.08],
        [x * 1.1, shoulder[1] - 0.01, neck + 0.03], [x, back, neck - 0.08], [0.0, back, neck - 0.26],
        [wide * 0.6, back, hip + 0.2], [wide, 0.06, hip + 0.07],
    ])  # fmt: skip
    band = strap(cloth, path, 0.014)
    low, high = np.array([wide - 0.085, -0.13, hip - 0.17]), np.array([wide + 0.015, 0.15, hip + 0.08])
    points, faces = merged([
        block(low, high, 8, 0.35),
        block(np.array([low[0] - 0.008, low[1] + 0.005, hip - 0.05]), high + np.array([0, -0.005, 0.008]), 6, 0.2),
    ])  # fmt: skip
    colour = np.array(paint) * (1 + 0.12 * waves(points, 0.1, (1, 1, 1), 33))[:, None]
    colour = mixed(colour, np.array(paint) * 0.4, (0.005 - np.abs(points[:, 2] - hip + 0.05)) / 0.003)
    bag = Mesh(points, faces, body.bound(len(points), "root"))
    straps = Part("strap", band, np.tile(np.array(paint) * 0.7, (len(band.points), 1)), "leather")
    return [Part("bag", bag, colour, "leather"), straps]


def badge(body: Body, parts: list[Part], paint: Colour) -> list[Part]:
    """A card on a string around the neck."""
    cloth = surface(parts)
    neck = body.head("neck01")
    front = trunk_extent(body, cloth, neck[2] - 0.3, 0.1)[0]
    made = []
    for sign in SIDES.values():
        path = np.array([
            [sign * 0.05, neck[1] + 0.04, neck[2] + 0.03], [sign * 0.068, neck[1] - 0.02, neck[2] + 0.02],
            [sign * 0.06, neck[1] - 0.07, neck[2] - 0.04], [sign * 0.03, front, neck[2] - 0.2],
            [sign * 0.004, front, neck[2] - 0.33],
        ])  # fmt: skip
        band = strap(cloth, path, 0.007, 0.003)
        made.append(Part("string", band, np.tile(np.array(paint), (len(band.points), 1)), "cloth"))
    near = cloth.points - [0, front, neck[2] - 0.37]
    anchor = int(np.argmin((near**2).sum(1)))
    at = cloth.points[anchor]
    y = trunk_extent(body, cloth, at[2], 0.05)[0]
    low, high = np.array([-0.029, y - 0.009, at[2] - 0.045]), np.array([0.029, y - 0.005, at[2] + 0.045])
    points, faces = block(low, high, 8, 0.05)
    colour = np.tile((0.7, 0.7, 0.68), (len(points), 1))
    colour = mixed(colour, paint, ((points[:, 2] - at[2] - 0.02) / 0.004))
    face = (np.abs(points[:, 0] + 0.01) < 0.012) & (np.abs(points[:, 2] - at[2] + 0.008) < 0.016)
    colour = mixed(colour, (0.2, 0.12, 0.09), face.astype(float))
    card = Mesh(points, faces, np.tile(cloth.skin[anchor], (len(points), 1)))
    return [*made, Part("badge", card, colour, "leather")]


def belt(body: Body, parts: list[Part], paint: Colour) -> list[Part]:
    """A belt around the outermost cloth, above the hip joints."""
    level = body.head("upperleg01.L")[2] + BELT
    cloth = surface(parts)
    trunk = (np.abs(cloth.points[:, 2] - level) < 0.03) & (body.arm(cloth) < 0.2)
    points, skin = cloth.points[trunk], cloth.skin[trunk]
    angle = around_trunk(body, points)
    centre = body.head("spine03")[:2] - [0, 0.01]
    radius = np.hypot(*(points[:, :2] - centre).T)
    wanted = np.linspace(-np.pi, np.pi, BELT_COLUMNS, endpoint=False)
    near = np.abs(np.angle(np.exp(1j * (wanted[:, None] - angle[None])))) < 0.12
    reach = np.array([np.quantile(radius[row], 0.7) if row.any() else np.median(radius) for row in near]) + 0.006
    weights = np.stack([skin[row].mean(0) if row.any() else skin.mean(0) for row in near])
    flat = np.stack([np.sin(wanted) * reach, -np.cos(wanted) * reach], 1)
    rows = np.stack([np.c_[centre + flat * (1 + k), np.full(BELT_COLUMNS, level + z)] for k, z in
                     ((-0.06, -0.014), (0.0, -0.013), (0.01, 0.0), (0.0, 0.013), (-0.06, 0.014))])  # fmt: skip
    mesh = sheet(rows, weights / weights.sum(1, keepdims=True), True)
    return [Part("belt", mesh, np.tile(np.array(paint), (len(mesh.points), 1)), "leather")]


def skull(body: Body, low: float, cells: int = 48) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions (rows, cells, 2: around, up) and points of a dome around the head from a height above the eyes."""
    around = np.linspace(0, 2 * np.pi, cells, endpoint=False)
    centre = body.eye() + np.array([0, 0.085, 0.02])
    rise = np.linspace(np.arcsin(np.clip((low - 0.02) / 0.135, -0.99, 0.99)), np.pi / 2 * 0.99, 14)
    turn, up = np.meshgrid(around, rise)
    size = np.array([0.088, 0.122, 0.127])
    unit = np.stack([np.cos(up) * np.sin(turn), -np.cos(up) * np.cos(turn), np.sin(up)], 2)
    return turn, up, centre + unit * size


def cap(body: Body, parts: list[Part], paint: Colour) -> list[Part]:
    """A cap with a peak."""
    turn, _, dome = skull(body, 0.055)
    mesh = sheet(dome, body.bound(dome.shape[1], "head"), True)
    colour = np.tile(np.array(paint), (len(mesh.points), 1))
    colour = mixed(colour, np.array(paint) * 0.6, (0.07 - np.abs(np.mod(turn.ravel(), np.pi / 3))) * 12)
    side = np.linspace(-1, 1, 25)
    reach = np.linspace(0, 1, 7)
    s, r = np.meshgrid(side, reach)
    eye = body.eye()
    wide = 0.078 * (1 - 0.12 * r)
    x = s * wide
    brim = eye[1] + 0.085 - 0.118 * np.sqrt(np.clip(1 - (x / 0.09) ** 2, 0.05, 1))
    y = brim - r * 0.075 * np.sqrt(np.clip(1 - 0.8 * s**2, 0, 1))
    z = eye[2] + 0.058 - 0.022 * s**2 - 0.02 * r
    top = sheet(np.stack([x, y, z], 2), body.bound(25, "head"), False)
    dark = np.tile(np.array(paint) * 0.7, (len(top.points), 1))
    return [Part("cap", mesh, colour, "cloth"), Part("peak", top, dark, "cloth")]


def beanie(body: Body, parts: list[Part], paint: Colour) -> list[Part]:
    """A knitted cap without a peak."""
    turn, up, dome = skull(body, 0.05)
    centre = body.eye() + np.array([0, 0.085, 0.02])
    rolled = np.where(up[:, :, None] < 0.55, 1.05, 1.0 + 0.12 * np.clip(up[:, :, None] - 0.9, 0, 1))
    ribbed = 1 + 0.008 * np.cos(turn * 24)[:, :, None]
    mesh = sheet(centre + (dome - centre) * rolled * ribbed, body.bound(dome.shape[1], "head"), True)
    colour = np.array(paint) * (1 + 0.25 * np.cos(turn * 24)).reshape(-1, 1)
    return [Part("beanie", mesh, colour, "cloth")]


def headscarf(body: Body, parts: list[Part], paint: Colour) -> list[Part]:
    """A cloth around head and neck that leaves the face free."""
    eye, neck = body.eye(), body.head("neck01")
    around = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    levels = np.linspace(0, 1, 26)
    turn, level = np.meshgrid(around, levels)
    top, low = eye[2] + 0.155, neck[2] - 0.09
    z = top + (low - top) * level
    share = (z - eye[2]) / 0.155
    head_x, head_y = (0.093 * np.sqrt(np.clip(1 - np.clip(share, 0, 1) ** 2.2, 0, 1)) + 0.001,
                      0.118 * np.sqrt(np.clip(1 - np.clip(share, 0, 1) ** 2.4, 0, 1)) + 0.001)  # fmt: skip
    below = np.clip((eye[2] - 0.06 - z) / 0.08, 0, 1)
    chest = np.clip((neck[2] + 0.05 - z) / 0.14, 0, 1)
    x = np.sin(turn) * (head_x * (1 - 0.12 * below) + 0.07 * chest)
    y = eye[1] + 0.09 + 0.015 * below - np.cos(turn) * (head_y * (1 - 0.14 * below) + 0.03 * chest)
    points = np.stack([x, y + 0.02 * chest, z], 2).reshape(-1, 3)
    slanted = points * [1, 1, 0.6]
    slanted[:, 2] += 0.3 * np.cos(turn.ravel())
    drape = folds(slanted, 0.07, (1, 1, 1), 41)
    rider = np.clip((z.ravel() - neck[2] - 0.0) / 0.12, 0, 1)[:, None]
    skin = body.bound(len(points), "head") * rider + body.bound(len(points), "spine01") * (1 - rider)
    mesh = sheet(points.reshape(26, 72, 3), skin[:72], True)
    mesh.skin = skin.astype(np.float32)
    mesh.points = points + mesh.normals() * (0.007 * drape * (0.3 + below.ravel()))[:, None]
    mesh = mesh.subdivided()
    oval = np.hypot(mesh.points[:, 0] / 0.066, (mesh.points[:, 2] - eye[2] + 0.022) / 0.1)
    field = np.where(mesh.points[:, 1] < eye[1] + 0.08, (oval - 1) * 0.07, 0.05)
    mesh = mesh.clipped(field)
    colour = np.array(paint) * (1 + 0.08 * waves(mesh.points, 0.06, (1, 1, 1), 42))[:, None]
    return [Part("headscarf", mesh, colour, "cloth")]


def glasses(body: Body, look: Look) -> list[Part]:
    """Two rims, a bridge and the temples, as thin tubes."""
    if look.glasses is None:
        return []
    eye, half = body.eye(), body.head("eye.L")[0]
    y = eye[1] - 0.026
    circle = np.linspace(0, 2 * np.pi, 25)
    tubes = []
    for sign in SIDES.values():
        wide = np.sign(np.cos(circle)) * np.abs(np.cos(circle)) ** 0.8
        rim = np.stack([sign * (half + 0.001) + wide * 0.025, np.full(25, y) + 0.006 * np.abs(wide + sign) * 0.5,
                        eye[2] - 0.004 + 0.019 * np.sin(circle)], 1)  # fmt: skip
        tubes.append(tube(rim, 0.0016))
        arm = np.array([
            [sign * (half + 0.026), y + 0.006, eye[2] + 0.004], [sign * 0.076, eye[1] + 0.04, eye[2] + 0.002],
            [sign * 0.079, eye[1] + 0.085, eye[2] + 0.002],
        ])  # fmt: skip
        tubes.append(tube(arm, 0.0016))
    bridge = np.array([[-0.011, y, eye[2] + 0.002], [0, y - 0.003, eye[2] + 0.005], [0.011, y, eye[2] + 0.002]])
    points, faces = merged([*tubes, tube(bridge, 0.0016)])
    mesh = Mesh(points, faces, body.bound(len(points), "head"))
    return [Part("glasses", mesh, np.tile(np.array(look.glasses), (len(points), 1)), "leather")]


def tube(path: np.ndarray, radius: float, sides: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """A tube along a path."""
    ahead = np.gradient(path, axis=0)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    hint = np.where(np.abs(ahead[:, 1:2]) < 0.8, [0, 1.0, 0], [1.0, 0, 0])
    first = np.cross(ahead, hint)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(ahead, first)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    rows = path[:, None] + radius * (first[:, None] * np.cos(angle)[:, None] + second[:, None] * np.sin(angle)[:, None])
    made = sheet(rows, np.zeros((sides, 1)), True)
    return made.points, made.faces


EXTRAS: dict[str, Callable[[Body, list[Part], Colour], list[Part]]] = {
    "backpack": backpack,
    "shoulder bag": shoulder_bag,
    "badge": badge,
    "belt": belt,
    "cap": cap,
    "beanie": beanie,
    "headscarf": headscarf,
}
