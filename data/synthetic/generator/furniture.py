"""Furniture, and things that could be taken for people: coats, posters, banners, trolleys."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from layout import HALF, Thing
from surfaces import CORNERS, SIDES, Blocks, Material, material, shape

Solid = tuple[np.ndarray, list]

CLOTH = ((0.10, 0.085, 0.06), (0.05, 0.06, 0.085))
LINING = ((0.03, 0.03, 0.03), (0.22, 0.05, 0.04))
HATS = ((0.03, 0.028, 0.026), (0.21, 0.16, 0.1))
CARTON = (0.36, 0.24, 0.13)
SEATS = ((0.05, 0.09, 0.2), (0.3, 0.05, 0.04), (0.1, 0.1, 0.1))
BENCHES, TABLES = ((0.3, 0.17, 0.07), (0.16, 0.08, 0.04)), ((0.5, 0.36, 0.2), (0.6, 0.6, 0.58))
BOOKS = ((0.25, 0.04, 0.03), (0.04, 0.09, 0.2), (0.45, 0.42, 0.35), (0.05, 0.15, 0.07), (0.4, 0.25, 0.05))


@dataclass(frozen=True)
class Placed:
    """A distractor in the scene: its kind and its vertices (n, 3) in the world."""

    kind: str
    points: np.ndarray


def surfaces() -> dict[str, Material]:
    """Materials of the blocks below."""
    return {
        "cork": material("cork", (0.3, 0.19, 0.1), 0.9, 0.2, 30),
        "paper": material("paper", (0.75, 0.75, 0.72)),
        "radiator": material("radiator", (0.6, 0.6, 0.58), 0.4),
        "red": material("red", (0.45, 0.02, 0.02), 0.3),
    }


def board(blocks: Blocks, thing: Thing) -> None:
    """A notice board with papers."""
    side, start = int(thing.x), thing.y - 0.55
    blocks.side(side, (0, 0.02), (start, start + 1.1), (1.1, 1.85), "cork")
    for k, (y, z) in enumerate(((0.1, 1.5), (0.4, 1.45), (0.7, 1.52), (0.15, 1.15), (0.55, 1.13))):
        y, z = (start + y, start + y + 0.21), (z, z + 0.29 - 0.02 * k)
        blocks.side(side, (0.02, 0.023), y, z, "paper")


def radiator(blocks: Blocks, thing: Thing) -> None:
    """A flat radiator."""
    blocks.side(int(thing.x), (0.02, 0.09), (thing.y - 0.7, thing.y + 0.7), (0.12, 0.72), "radiator")


def extinguisher(blocks: Blocks, thing: Thing) -> None:
    """A red box with a fire extinguisher in it."""
    blocks.side(int(thing.x), (0, 0.14), (thing.y - 0.075, thing.y + 0.075), (0.7, 1.15), "red")


def loft(rings: np.ndarray, closed: bool = True) -> Solid:
    """A surface through rings (k, n, 3), capped at both ends if closed."""
    k, n = rings.shape[:2]
    faces = [
        [r * n + i, r * n + (i + 1) % n, (r + 1) * n + (i + 1) % n, (r + 1) * n + i]
        for r in range(k - 1)
        for i in range(n)
    ]
    if closed:
        faces += [list(range(n))[::-1], list(range((k - 1) * n, k * n))]
    return rings.reshape(-1, 3), faces


def turned(profile: Sequence[tuple[float, float]], around: int = 24, dent: float = 0.0) -> Solid:
    """A body of revolution through (radius, z)."""
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    rings = [np.stack([r * np.cos(angle), r * np.sin(angle) * (1 - dent), np.full(around, z)], 1) for r, z in profile]
    return loft(np.array(rings))


def blocks_of(spans: Sequence[tuple[tuple[float, float, float], tuple[float, float, float]]]) -> Solid:
    """Several blocks as one body."""
    points = [np.array(low) + CORNERS * (np.array(high) - low) for low, high in spans]
    faces = np.concatenate([SIDES + 8 * k for k in range(len(spans))])
    return np.concatenate(points), faces.tolist()


def cloth(heights: np.ndarray, wide: np.ndarray, deep: np.ndarray, seed: int, folds: float) -> np.ndarray:
    """Rings of a hanging garment whose folds deepen downwards."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    down = np.linspace(0, 1, len(heights))[:, None]
    ripple = sum(
        amount * np.cos(times * angle[None] + rng.uniform(0, 6.3) + 1.3 * down * rng.normal())
        for times, amount in ((5, 0.4), (8, 0.35), (13, 0.25), (3, 0.3))
    )
    radius = 1 + folds * (0.25 + 0.75 * down) * ripple
    radius *= 1 - 0.16 * np.exp(-(((angle[None] - 1.5 * np.pi) / 0.07) ** 2))
    x, y = wide[:, None] * np.cos(angle) * radius, deep[:, None] * np.sin(angle) * radius
    return np.stack([x, y, np.broadcast_to(heights[:, None], x.shape)], 2)


def coat(top: float, length: float, flat: float, seed: int) -> list[Solid]:
    """A coat that hangs by its collar: body and two sleeves; flat: depth in shares of a full one."""
    share = np.linspace(0, 1, 40)
    wide = np.interp(share, [0, 0.03, 0.1, 0.2, 0.5, 1], [0.05, 0.08, 0.16, 0.2, 0.225, 0.27])
    deep = flat * np.interp(share, [0, 0.03, 0.1, 0.2, 0.5, 1], [0.05, 0.07, 0.1, 0.13, 0.15, 0.19])
    body = loft(cloth(top - share * length, wide, deep, seed, 0.09))
    sleeves = []
    for side in (-1, 1):
        along = np.linspace(0, 1, 20)
        thick = np.interp(along, [0, 0.15, 0.6, 1], [0.05, 0.075, 0.065, 0.055])
        rings = cloth(top - 0.1 - along * 0.6, thick, thick * (0.55 + 0.45 * flat), seed + side + 5, 0.08)
        rings[:, :, 0] += side * np.interp(along, [0, 0.2, 1], [0.13, 0.2, 0.25])[:, None]
        rings[:, :, 1] -= (0.02 + 0.04 * along)[:, None]
        sleeves.append(loft(rings))
    return [body, *sleeves]


def put(thing: Thing, name: str, parts: Sequence[tuple[Solid, Material]], smooth: bool = True) -> Placed:
    """Turns the parts, sets them at the thing's place, and links them into the scene."""
    turn = np.radians(thing.turn)
    around = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    placed = []
    for (points, faces), surface in parts:
        points = points @ around.T + [thing.x, thing.y, 0]
        shape(name, points, faces, surface, smooth)
        placed.append(points)
    return Placed(name, np.concatenate(placed))


def fabric(name: str, colour: tuple[float, float, float]) -> Material:
    """Woollen cloth."""
    return material(name, colour, 0.95, 0.15, 60)


def coat_stand(thing: Thing, picture: str | None) -> Placed:
    """A stand with a coat and a hat."""
    wood, wool = material("stand", (0.07, 0.04, 0.02), 0.4), fabric("coat", CLOTH[thing.look])
    pole = turned([(0.0, 0), (0.2, 0.005), (0.19, 0.03), (0.025, 0.05), (0.022, 1.72), (0.03, 1.76), (0.0, 1.79)])
    hooks = blocks_of([((-0.16, -0.01, 1.66), (0.16, 0.01, 1.68)), ((-0.01, -0.16, 1.7), (0.01, 0.16, 1.72))])
    hat = turned(
        [(0.0, 1.76), (0.16, 1.755), (0.165, 1.765), (0.1, 1.775), (0.098, 1.84), (0.085, 1.875), (0, 1.87)], 32
    )
    parts = [(pole, wood), (hooks, wood), (hat, fabric("hat", HATS[thing.look]))]
    for points, faces in coat(1.64, 0.95, 0.9, 3 + thing.look):
        parts.append(((points - [0, 0.13, 0], faces), wool))
    return put(thing, "coat stand", parts)


def coat_on_hook(thing: Thing, picture: str | None) -> Placed:
    """A jacket on the wall."""
    side = int(thing.x)
    at = Thing(thing.kind, side * (HALF - 0.1), thing.y, 90.0 * side, thing.look)
    parts = [(solid, fabric("jacket", LINING[thing.look])) for solid in coat(1.7, 0.82, 0.5, 11 + thing.look)]
    rail = blocks_of([((-0.4, 0.06, 1.68), (0.4, 0.1, 1.76)), ((-0.01, -0.03, 1.69), (0.01, 0.1, 1.71))])
    put(at, "rail", [(rail, material("rail", (0.2, 0.12, 0.06), 0.5))], smooth=False)
    return put(at, "coat on a hook", parts)


def trolley(thing: Thing, picture: str | None) -> Placed:
    """A parked trolley with two shelves and some cartons."""
    posts = [((x, y, 0.1), (x + 0.025, y + 0.025, 0.92)) for x in (-0.23, 0.205) for y in (-0.4, 0.375)]
    shelves = [((-0.23, -0.4, z), (0.23, 0.4, z + 0.03)) for z in (0.22, 0.8)]
    handle = [((-0.23, -0.46, 0.92), (0.23, -0.435, 0.945))]
    wheels = [((x - 0.02, y - 0.05, 0), (x + 0.02, y + 0.05, 0.1)) for x in (-0.2, 0.2) for y in (-0.36, 0.36)]
    cartons = [((-0.18, -0.3, 0.83), (0.16, 0.05, 1.14)), ((-0.15, 0.1, 0.83), (0.18, 0.36, 1.05))]
    if thing.look:
        cartons += [((-0.12, -0.25, 1.14), (0.15, 0.02, 1.38)), ((-0.2, -0.3, 0.25), (0.2, 0.2, 0.6))]
    metal, board_ = material("metal", (0.42, 0.43, 0.45), 0.35), material("carton", CARTON, 0.9, 0.1, 8)
    parts = [(blocks_of(posts + shelves + handle), metal), (blocks_of(cartons), board_)]
    parts.append((blocks_of(wheels), material("tyre", (0.02, 0.02, 0.02), 0.7)))
    return put(thing, "trolley", parts, smooth=False)


def bin_(thing: Thing, picture: str | None) -> Placed:
    """A waste-paper bin."""
    body = turned([(0.0, 0), (0.13, 0.0), (0.17, 0.5), (0.16, 0.51), (0.12, 0.06), (0.0, 0.06)])
    return put(thing, "bin", [(body, material("bin", (0.06, 0.065, 0.07), 0.5))])


def plant(thing: Thing, picture: str | None) -> Placed:
    """A pot with long leaves."""
    rng = np.random.default_rng(5)
    pot = turned([(0.0, 0), (0.14, 0.0), (0.19, 0.36), (0.17, 0.36), (0.16, 0.3), (0.0, 0.3)])
    leaves = []
    for k in range(26):
        angle, lean, tall = 2.4 * k, rng.uniform(0.12, 0.55), rng.uniform(0.6, 1.25)
        along = np.linspace(0, 1, 8)[:, None]
        out = np.array([np.cos(angle), np.sin(angle), 0])
        path = out * lean * along**1.6 + [0, 0, 1] * (0.3 + tall * along - 0.45 * lean * along**3)
        across = np.array([-np.sin(angle), np.cos(angle), 0]) * 0.035 * np.sin(np.pi * (0.12 + 0.88 * along))
        points = np.concatenate([path - across, path + across])
        leaves.append((points, [[i, i + 1, i + 9, i + 8] for i in range(7)]))
    green = material("leaf green", (0.035, 0.11, 0.025), 0.45)
    return put(thing, "plant", [(pot, material("pot", (0.3, 0.29, 0.27), 0.6)), *((leaf, green) for leaf in leaves)])


def printed(name: str, image: bpy.types.Image) -> Material:
    """A surface that shows a picture."""
    made = material(name, (1, 1, 1), 0.5)
    nodes = made.node_tree.nodes
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = image
    made.node_tree.links.new(texture.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return made


def sheet(name: str, corners: np.ndarray, surface: Material) -> None:
    """A rectangle (lower left, lower right, upper right, upper left) with a picture."""
    made = shape(name, corners, [[0, 1, 2, 3]], surface)
    layer = made.data.uv_layers.new()
    for loop, uv in zip(layer.data, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
        loop.uv = uv


def poster(thing: Thing, picture: str | None) -> Placed:
    """A life-size picture of a person on a side wall (x -1 or 1), or at x, y on the end wall."""
    side, half = int(thing.x), 0.4
    low, high = 0.08, 2.0
    if side:
        x = side * (HALF - 0.012)
        ends = [(x, thing.y + step) for step in (half * side, -half * side)]
    else:
        ends = [(thing.x + step, thing.y - 0.012) for step in (-half, half)]
    corners = np.array([[x, y, z] for (x, y), z in zip([*ends, *ends[::-1]], (low, low, high, high), strict=True)])
    if picture is None:
        surface = material("empty poster", (0.5, 0.6, 0.7))
    else:
        surface = printed("poster", bpy.data.images.load(picture))
    sheet("poster", corners, surface)
    return Placed("poster", corners)


def advert(look: int) -> bpy.types.Image:
    """The picture on a banner: a disc, bars of text, a band of colour."""
    wide, high = 200, 500
    v, u = np.mgrid[0:high, 0:wide] / wide
    ground = ((0.05, 0.22, 0.3), (0.8, 0.78, 0.72))[look]
    accent = ((0.85, 0.8, 0.3), (0.55, 0.08, 0.1))[look]
    text = ((0.85, 0.87, 0.85), (0.12, 0.12, 0.14))[look]
    picture = np.ones((high, wide, 3)) * ground * (0.8 + 0.12 * v[..., None])
    picture[np.hypot(u - 0.5, v - 1.85) < 0.28] = accent
    picture[(v > 0.25 + 0.08 * np.sin(4 * u)) & (v < 0.55 + 0.1 * np.sin(3 * u + 1))] = accent
    for k, width in enumerate((0.6, 0.72, 0.5, 0.66, 0.3)):
        picture[(np.abs(v - (1.35 - 0.13 * k)) < 0.03) & (np.abs(u - 0.12 - width / 2) < width / 2)] = text
    image = bpy.data.images.new("advert", wide, high)
    image.pixels.foreach_set(np.concatenate([picture, np.ones((high, wide, 1))], 2).astype(np.float32).ravel())
    image.pack()
    return image


def banner(thing: Thing, picture: str | None) -> Placed:
    """A roll-up banner that faces the camera."""
    foot = blocks_of([((-0.43, -0.1, 0), (0.43, 0.1, 0.07)), ((-0.42, 0.0, 2.0), (0.42, 0.02, 2.03))])
    placed = put(thing, "banner", [(foot, material("foot", (0.5, 0.5, 0.52), 0.3))], smooth=False)
    turn = np.radians(thing.turn)
    across, base = np.array([np.cos(turn), np.sin(turn), 0]) * 0.41, np.array([thing.x, thing.y, 0])
    up = np.array([0, 0, 1.0])
    corners = np.array(
        [base - across + 0.06 * up, base + across + 0.06 * up, base + across + 2 * up, base - across + 2 * up]
    )
    sheet("banner", corners, printed("advert", advert(thing.look)))
    return Placed("banner", np.concatenate([placed.points, corners]))


def legs(corners: Sequence[tuple[float, float]], top: float, thick: float = 0.035) -> list:
    """Spans of upright legs around some corners."""
    return [((x - thick / 2, y - thick / 2, 0), (x + thick / 2, y + thick / 2, top)) for x, y in corners]


def chair(thing: Thing, picture: str | None) -> Placed:
    """A chair that faces the camera; the middle of its seat is at the thing's place."""
    seat, frame_ = material("seat", SEATS[thing.look], 0.8), material("chair frame", (0.3, 0.3, 0.31), 0.4)
    corners = [(x, y) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]
    back = [((x - 0.017, 0.19, 0.4), (x + 0.017, 0.225, 0.88)) for x in (-0.2, 0.2)]
    parts = [(blocks_of([*legs(corners, 0.42), *back]), frame_)]
    parts.append((blocks_of([((-0.22, -0.22, 0.41), (0.22, 0.22, 0.45)), ((-0.2, 0.19, 0.6), (0.2, 0.22, 0.9))]), seat))
    return put(thing, "chair", parts, smooth=False)


def bench(thing: Thing, picture: str | None) -> Placed:
    """A wooden bench 1.8 m long."""
    corners = [(x, y) for x in (-0.8, 0.8) for y in (-0.16, 0.16)]
    wood = material("bench wood", BENCHES[thing.look], 0.55, 0.15, 12)
    slats = [((-0.9, y, 0.41), (0.9, y + 0.12, 0.45)) for y in (-0.2, -0.065, 0.07)]
    slats += [((-0.9, 0.2, z), (0.9, 0.225, z + 0.11)) for z in (0.56, 0.72)]
    posts = [((x - 0.02, 0.19, 0.4), (x + 0.02, 0.21, 0.84)) for x in (-0.8, 0.8)]
    steel = material("bench frame", (0.06, 0.06, 0.065), 0.4)
    return put(thing, "bench", [(blocks_of(slats), wood), (blocks_of([*legs(corners, 0.41), *posts]), steel)], False)


def table(thing: Thing, picture: str | None) -> Placed:
    """A table with a few things on it."""
    corners = [(x, y) for x in (-0.6, 0.6) for y in (-0.33, 0.33)]
    top = blocks_of([((-0.7, -0.4, 0.71), (0.7, 0.4, 0.74))])
    papers = blocks_of([((-0.4, -0.2, 0.74), (-0.19, 0.1, 0.745)), ((0.2, -0.1, 0.74), (0.5, 0.15, 0.765))])
    cup = turned([(0.0, 0.74), (0.035, 0.74), (0.04, 0.83), (0.033, 0.83), (0.03, 0.75), (0.0, 0.75)])
    wood = material("table top", TABLES[thing.look], 0.4, 0.1, 10)
    steel, white = material("table legs", (0.1, 0.1, 0.11), 0.4), material("white", (0.7, 0.7, 0.68), 0.5)
    parts = [(top, wood), (blocks_of(legs(corners, 0.71, 0.05)), steel), (papers, white), (cup, white)]
    return put(thing, "table", parts, smooth=False)


def shelf(thing: Thing, picture: str | None) -> Placed:
    """A shelf full of books and boxes."""
    rng = np.random.default_rng(20 + thing.look)
    boards = [((-0.5, -0.15, z), (0.5, 0.15, z + 0.025)) for z in (0.04, 0.42, 0.8, 1.18, 1.56, 1.9)]
    boards += [((x, -0.15, 0), (x + 0.025, 0.15, 1.92)) for x in (-0.525, 0.5)] + [((-0.5, 0.14, 0), (0.5, 0.15, 1.92))]
    parts = [(blocks_of(boards), material("shelf", TABLES[1 - thing.look], 0.5, 0.1, 8))]
    books: list[list] = [[] for _ in BOOKS]
    for z in (0.065, 0.445, 0.825, 1.205, 1.585):
        x = -0.48
        while x < 0.4:
            wide, tall = rng.uniform(0.02, 0.06), rng.uniform(0.18, 0.27)
            if rng.uniform() < 0.85:
                books[int(rng.integers(len(BOOKS)))].append(((x, -0.1, z), (x + wide, 0.12, z + tall)))
            x += wide + 0.002
    parts += [(blocks_of(some), material("book", paint, 0.7)) for some, paint in zip(books, BOOKS, strict=True) if some]
    return put(thing, "shelf", parts, smooth=False)


def painting(thing: Thing, picture: str | None) -> Placed:
    """A framed abstract picture on the far wall, at x, y."""
    rng = np.random.default_rng(40 + thing.look)
    fields = []
    for _ in range(7):
        x, z = rng.uniform(-0.5, 0.3), rng.uniform(1.2, 1.7)
        size, paint = rng.uniform(0.1, 0.35, 2), tuple(rng.uniform(0.05, 0.6, 3))
        far = (min(x + size[0], 0.53), -0.021, min(z + size[1], 1.93))
        fields.append((blocks_of([((x, -0.024, z), far)]), material("field", paint, 0.7)))
    frame_ = blocks_of([((-0.6, -0.015, 1.1), (0.6, 0.0, 2.0))])
    canvas = blocks_of([((-0.55, -0.02, 1.15), (0.55, -0.014, 1.95))])
    parts = [(frame_, material("frame", (0.1, 0.08, 0.06), 0.4)), (canvas, material("canvas", (0.6, 0.58, 0.52)))]
    return put(thing, "painting", [*parts, *fields], smooth=False)


FIXED: dict[str, Callable[[Blocks, Thing], None]] = {
    "board": board,
    "radiator": radiator,
    "extinguisher": extinguisher,
}
STANDING: dict[str, Callable[[Thing, str | None], Placed]] = {
    "coat stand": coat_stand,
    "coat on a hook": coat_on_hook,
    "trolley": trolley,
    "bin": bin_,
    "plant": plant,
    "poster": poster,
    "banner": banner,
    "chair": chair,
    "bench": bench,
    "table": table,
    "shelf": shelf,
    "painting": painting,
}
PLAIN = ("chair", "bench", "table", "shelf", "painting")


def place(blocks: Blocks, things: Sequence[Thing], picture: str | None) -> list[Placed]:
    """Sets all things up; returns those that could be taken for people."""
    for thing in things:
        if thing.kind in FIXED:
            FIXED[thing.kind](blocks, thing)
    placed = [STANDING[thing.kind](thing, picture) for thing in things if thing.kind in STANDING]
    return [thing for thing in placed if thing.kind not in PLAIN]
