"""Draws the clips in rooms: the empty room is traced once by Blender, people are drawn into it, a frame in a second.

People are lit by the lamps of the room, shadowed by everybody from above, and darker in creases. Writes clip.json, the
empty room, and for every frame its light (16 bit, two stops of headroom), a JSON of its truth, and depths where the
clip asks for them. Frames that exist are kept, so a stopped run goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import time as clock
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import corridor
import cv2
import furniture
import numpy as np
import raster
import room
from camera import aim, render, static_depth
from carried import Load, loads_of
from clips import Clip
from gait import Walker
from optics import View
from outline import SLACK, DepthMap, box_of
from person import Figure, tailored
from pictures import HEADROOM, brightness, light_of
from poster import portrait
from rooms import CLIPS, ROOMS
from story import present
from visits import Visit
from wardrobe import OUTFITS

NEAR, FAINT, PLAIN = 0.05, 0.05, 0.3
FINE = 2  # samples on a side of a pixel
SPARSE = 2  # pixels between measured depths of the empty room where no depth images are asked for
REACH = 900  # px around the picture in which people still count as a whole
SLOPES = np.array([[0, 0], [0.55, 0], [-0.55, 0], [0, 0.55], [0, -0.55], [0.35, 0.35], [-0.35, 0.35]], np.float32)
CELL = 0.018  # m
DIRECT = 0.62  # share of the light on floor and walls that comes from above
HAIR_STEP, HAIR_WIDTH = 2, 2.6
CREASES = 0.05  # m around a point in which a crease is looked for
TILE = View(size=(800, 680), focal=500.0)
TILES = (-56.0, 0.0, 56.0)
CLEAR, MIRRORED = np.array([0.70, 0.71, 0.64]), 0.2  # Panes of glass: transmitted share (b, g, r), and reflected share


@dataclass(frozen=True)
class Model:
    """Surfaces of a person or an object at rest: faces (m, 3), colours (n, 3: b, g, r), gloss (n,), fabrics."""

    faces: np.ndarray
    colour: np.ndarray
    gloss: np.ndarray
    chart: np.ndarray
    cloth: np.ndarray
    pictures: list[np.ndarray]


GLOSS = {"skin": 0.02, "eye": 0.25, "hair": 0.015, "cloth": 0.0, "leather": 0.04}


def ribbons(figure: Figure, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hair as flat ribbons: points, faces, colours (r, g, b)."""
    points, faces, colours, count = [np.empty((0, 3))], [np.empty((0, 3), int)], [np.empty((0, 3))], 0
    rng = np.random.default_rng(3)
    for curves, radii in figure.grown:
        some = curves[::HAIR_STEP]
        along = np.gradient(some, axis=1)
        out = some - some.reshape(-1, 3).mean(0)
        across = np.cross(along, out)
        across /= np.maximum(np.linalg.norm(across, axis=2, keepdims=True), 1e-9)
        wide = across * (np.broadcast_to(radii, some.shape[:2])[..., None] * HAIR_WIDTH)
        edges = np.stack([some - wide, some + wide], 2)
        number = np.arange(edges.size // 3).reshape(edges.shape[:3]) + count
        a, b, c, d = number[:, :-1, 0], number[:, :-1, 1], number[:, 1:, 1], number[:, 1:, 0]
        faces += [np.stack([a, b, c], 2).reshape(-1, 3), np.stack([a, c, d], 2).reshape(-1, 3)]
        points.append(edges.reshape(-1, 3))
        shade = rng.uniform(0.7, 1.35, (len(some), 1, 1, 1)) * np.array(OUTFITS[name].look.hair)
        colours.append(np.broadcast_to(shade, edges.shape).reshape(-1, 3))
        count += edges.size // 3
    return np.concatenate(points), np.concatenate(faces), np.concatenate(colours)


def loose(load: Load) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A stiff thing whose faces share no corners: points, faces, colours."""
    flat = load.faces.reshape(-1)
    return load.points[flat], np.arange(len(flat)).reshape(-1, 3), load.colour[flat]


class Actor:
    """A dressed walker without Blender. Vertices are those of the parts, then of the hair."""

    def __init__(self, arrays: dict[str, np.ndarray], visit: Visit) -> None:
        """arrays: what anatomy.py wrote."""
        seed = ord(visit.name) - ord("A") + 1
        figure = tailored(arrays, visit.name, seed)
        self.name, self.role, self.parts = visit.name, visit.role, figure.parts
        self.walker = Walker(figure.body.skeleton, visit.role, seed, figure.build)
        self.skull = figure.body.skeleton.index["head"]
        self.hair, hair_faces, hair_colour = ribbons(figure, visit.name)
        self.loads = loads_of(figure.body, figure.build, visit.role.carries, {name for *_, name in visit.role.arms})
        self.stiff = [loose(load) for load in self.loads]
        count, faces, colours, gloss, charts, cloths, pictures = 0, [], [], [], [], [], []
        for part in self.parts:
            faces.append(part.mesh.faces + count)
            colours.append(np.clip(part.colour, 0.003, 0.9))
            gloss.append(np.full(len(part.mesh.points), GLOSS[part.material]))
            charts.append(
                np.zeros((len(part.mesh.faces), 3, 2)) if part.chart is None else part.chart.reshape(-1, 3, 2)
            )
            cloths.append(np.full(len(part.mesh.faces), -1 if part.picture is None else len(pictures)))
            if part.picture is not None:
                fabric = np.clip(part.picture, 0, 1)[..., [2, 1, 0, 3]]
                pictures.append((255 * fabric ** [0.5, 0.5, 0.5, 1.0]).astype(np.uint8))
            count += len(part.mesh.points)
        faces.append(hair_faces + count)
        colours.append(np.clip(hair_colour, 0.003, 0.9))
        gloss.append(np.full(len(self.hair), GLOSS["hair"]))
        charts.append(np.zeros((len(hair_faces), 3, 2)))
        cloths.append(np.full(len(hair_faces), -1))
        self.bare = count
        self.model = Model(
            np.concatenate(faces).astype(np.int32), np.concatenate(colours)[:, ::-1].astype(np.float32),
            np.concatenate(gloss).astype(np.float32), np.concatenate(charts).astype(np.float32),
            np.concatenate(cloths).astype(np.int32), pictures,
        )  # fmt: skip
        skull = figure.body.head("head") + np.array([0, 0, 0.06])
        self.hair_out = self.hair - skull
        self.hair_out /= np.maximum(np.linalg.norm(self.hair_out, axis=1, keepdims=True), 1e-9)
        self.skin_faces = self.model.faces[: len(self.model.faces) - len(hair_faces)]

    def pose(self, time: float) -> Posed:
        """Everything of the person at a time."""
        transforms = self.walker.pose(time)
        head = transforms[self.skull]
        points = np.concatenate(
            [*(part.posed(transforms) for part in self.parts), self.hair @ head[:, :3].T + head[:, 3]]
        ).astype(np.float32)
        normal = np.empty_like(points)
        raster.normals(points, self.skin_faces, normal)
        normal[self.bare :] = self.hair_out @ head[:, :3].T
        things = []
        for load, (rest, faces, colour) in zip(self.loads, self.stiff, strict=True):
            if load.shown(self.walker, time):
                matrix = load.matrix(self.walker, transforms, time)
                spots = (rest @ matrix[:, :3].T + matrix[:, 3]).astype(np.float32)
                things.append((spots, faces.astype(np.int32), colour))
        place = tuple(float(np.interp(time, self.walker.grid, self.walker.tracks[axis])) for axis in "xy")
        front = head[:, :3] @ [0, -1.0, 0]
        middle = head @ [*self.walker.skeleton.head("head"), 1]
        return Posed(self, place, points, normal, things, front, middle, self.walker.seating(time)[0] > 0.5)


@dataclass
class Posed:
    """A person at a time: place on the floor (m), vertices, normals, things in the hands, where the head looks."""

    actor: Actor
    place: tuple[float, float]
    points: np.ndarray
    normal: np.ndarray
    things: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
    front: np.ndarray
    head: np.ndarray
    seated: bool

    def facing(self, eye: np.ndarray) -> float:
        """Between the front of the head and the way to a camera, seen from above (rad)."""
        ahead, wanted = (np.arctan2(way[0], -way[1]) for way in (self.front, eye - self.head))
        return float(abs((ahead - wanted + np.pi) % (2 * np.pi) - np.pi))

    @cached_property
    def load(self) -> tuple[np.ndarray, np.ndarray]:
        """Points and faces of the things in the hands."""
        points, faces, count = [np.empty((0, 3), np.float32)], [np.empty((0, 3), np.int32)], 0
        for spots, some, _ in self.things:
            points.append(spots)
            faces.append(some + count)
            count += len(spots)
        return np.concatenate(points), np.concatenate(faces)


def outline_of(pixels: np.ndarray, faces: np.ndarray, shape: tuple[int, int]) -> DepthMap | None:
    """The depths of a mesh in and around the picture; None when out of reach."""
    near = pixels[pixels[:, 2] > NEAR]
    if not len(near) or not len(faces):
        return None
    low = np.maximum(np.floor(near[:, :2].min(0)), -REACH).astype(int)
    high = np.minimum(np.ceil(near[:, :2].max(0)), [shape[1] + REACH, shape[0] + REACH]).astype(int) + 1
    if (high <= low).any():
        return None
    depth = np.full((high[1] - low[1], high[0] - low[0]), np.inf, np.float32)
    raster.depths(pixels.astype(np.float32), faces, float(low[0]), float(low[1]), depth)
    return DepthMap(int(low[0]), int(low[1]), depth, 1, shape)


@dataclass
class Set:
    """An empty room seen by a camera: light (h, w, 3), depth, and the light without its panes of glass, if any."""

    view: View
    light: np.ndarray
    depth: np.ndarray
    clear: np.ndarray | None = None

    @cached_property
    def rays(self) -> np.ndarray:
        """Directions (h, w, 3) of depth 1."""
        v, u = np.mgrid[0 : self.view.size[1], 0 : self.view.size[0]] + 0.5
        return self.view.rays(u, v).astype(np.float32)


class Stage:
    """A clip, ready to draw."""

    def __init__(self, clip: Clip, arrays: dict[str, np.ndarray], out: Path, samples: int) -> None:
        """Builds the room and traces it, unless that was done before."""
        self.clip, self.arrays, self.actors = clip, arrays, {}
        self.tiles, self.lamps, self.objects = self.empty(out, samples)
        lit = brightness(np.concatenate([tile.light.reshape(-1, 3) for tile in self.tiles]))
        some = np.concatenate([tile.light.reshape(-1, 3) for tile in self.tiles])[lit < 1.5]
        self.ambient = (some.mean(0) * 1.1).astype(np.float32)
        self.corner = np.array([-clip.layout.half - 0.2, clip.layout.back], np.float32)
        size = np.array([2 * clip.layout.half + 0.4, clip.layout.depth + clip.layout.passage - clip.layout.back])
        self.cells = tuple(int(n) for n in (size / CELL)[::-1])

    def empty(self, out: Path, samples: int) -> tuple[list[Set], np.ndarray, list[dict]]:
        """The empty room as its cameras see it, its lamps, and boxes of what could be taken for people."""
        clip, view = self.clip, self.clip.view
        hung = any(thing.kind == "poster" for thing in clip.layout.things)
        if hung and not (out / "poster.png").exists():
            portrait(self.arrays, {"tune": "B"}.get(clip.split, "A"), out / "poster.png")
        views = [view]
        if clip.turning:
            views = [replace(TILE, eye=view.eye, pitch=view.pitch, yaw=float(np.radians(pan))) for pan in TILES]
        scene, rig, placed = room.build(clip.layout, views[0].ideal(), 1, str(out / "poster.png") if hung else None)
        state = clip.light(0)
        rig.switch(state)
        corridor.quick(scene, False)
        sets = []
        for number, one in enumerate(views):
            aim(scene, one)
            picture, depths = out / f"empty_{number}.png", out / f"empty_{number}.npy"
            if not picture.exists():
                render(scene, samples, picture)
            if not depths.exists():
                np.save(depths, static_depth(scene, one, 1 if clip.depth else SPARSE))
            found = light_of(picture)
            if one.lens:
                found = cv2.remap(found, one.lookup(), None, cv2.INTER_LINEAR)
            sets.append(Set(one, found, np.load(depths)))
        if clip.layout.glass:
            picture = out / "clear_0.png"
            for thing in scene.objects:
                thing.hide_render |= thing.name.startswith("pane")
            if not picture.exists():
                render(scene, samples, picture)
            sets[0].clear = light_of(picture)
        lamps = np.array(
            [[*lamp.thing.location, lamp.watts * state.lamps / np.pi**2] for lamp in rig.lit(state)], np.float32
        )
        return sets, lamps, [] if clip.turning else standing(placed, view)

    def set_at(self, view: View) -> Set:
        """The empty room as a view sees it; of a camera that turns from the tiles around it."""
        if not self.clip.turning:
            return self.tiles[0]
        v, u = np.mgrid[0 : view.size[1], 0 : view.size[0]] + 0.5
        ways = view.rays(u, v)
        light, depth = np.zeros((*view.shape, 3), np.float32), np.full(view.shape, 1e3, np.float32)
        best = np.full(view.shape, -1.0)
        for tile in self.tiles:
            seen = ways @ tile.view.axes.T
            share = seen[..., 2] / np.linalg.norm(ways, axis=-1)
            pixel = (tile.view.centre + tile.view.focal * seen[..., :2] / seen[..., 2:] - 0.5).astype(np.float32)
            inside = (pixel > 0).all(-1) & (pixel < np.array(tile.view.size) - 1).all(-1) & (share > best)
            light[inside] = cv2.remap(tile.light, pixel, None, cv2.INTER_LINEAR)[inside]
            found = cv2.remap(tile.depth, pixel, None, cv2.INTER_NEAREST)
            depth[inside] = (found / seen[..., 2])[inside]
            best[inside] = share[inside]
        return Set(view, light, depth)

    def posed(self, time: float) -> list[Posed]:
        """The people in the scene."""
        out = []
        for number, visit in enumerate(self.clip.visits):
            if present(visit.role, time):
                if number not in self.actors:
                    self.actors[number] = Actor(self.arrays, visit)
                out.append(self.actors[number].pose(time))
        return out

    def shadows(self, people: list[Posed]) -> np.ndarray:
        """Heights of everybody over the floor, seen along the slopes."""
        maps = np.full((len(SLOPES), *self.cells), -1.0, np.float32)
        for posed in people:
            raster.heights(posed.points, posed.actor.skin_faces, SLOPES, self.corner, CELL, maps)
            raster.heights(*posed.load, SLOPES, self.corner, CELL, maps)
        return maps

    def drawn(self, people: list[Posed], scene: Set, maps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Light (h, w, 3) of the people and which share (h, w, 1) of each pixel they cover."""
        shape = tuple(FINE * side for side in scene.view.shape)
        static = scene.depth.repeat(FINE, 0).repeat(FINE, 1)
        depth, seen = static.copy(), np.full(shape, -1, np.int32)
        weights = np.zeros((*shape, 2), np.float32)
        points, normal, colour, gloss, faces, chart, cloth, pictures = [], [], [], [], [], [], [], []
        vertices, count = 0, 0
        for posed in people:
            model = posed.actor.model
            pieces = [(posed.points, posed.normal, model)]
            for spots, some, paint in posed.things:
                flat = np.cross(spots[1::3] - spots[0::3], spots[2::3] - spots[0::3])
                flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
                blank = np.zeros((len(some), 3, 2), np.float32), np.full(len(some), -1, np.int32)
                thing = Model(
                    some, paint[:, ::-1].astype(np.float32), np.full(len(spots), 0.03, np.float32), *blank, []
                )
                pieces.append((spots, flat.repeat(3, 0), thing))
            for spots, up, thing in pieces:
                pixels = scene.view.projected(spots).astype(np.float32)
                raster.samples(pixels, thing.faces, count, float(FINE), depth, seen, weights)
                points.append(spots)
                normal.append(up)
                colour.append(thing.colour)
                gloss.append(thing.gloss)
                faces.append(thing.faces + vertices)
                chart.append(thing.chart)
                cloth.append(np.where(thing.cloth >= 0, thing.cloth + len(pictures), -1))
                pictures += thing.pictures
                vertices, count = vertices + len(spots), count + len(thing.faces)
        stacked = np.stack(pictures) if pictures else np.zeros((1, 1, 1, 4), np.uint8)
        whole = [np.concatenate(part) for part in (faces, points, normal, colour, chart, cloth)]
        lit = raster.shaded(
            depth, seen, weights, whole[0], whole[1].astype(np.float32), whole[2].astype(np.float32), whole[3],
            whole[4], whole[5].astype(np.int32), stacked, np.concatenate(gloss), np.array(scene.view.eye, np.float32),
            self.lamps, self.ambient, SLOPES, self.corner, CELL, maps, raster.RING,
            CREASES * scene.view.focal * FINE,
        )  # fmt: skip
        size = scene.view.size
        cover = cv2.resize((seen >= 0).astype(np.float32), size, interpolation=cv2.INTER_AREA)[..., None]
        return cv2.resize(np.minimum(lit, HEADROOM), size, interpolation=cv2.INTER_AREA), cover

    def through_glass(self, people: list[Posed], scene: Set, light: np.ndarray, maps: np.ndarray) -> np.ndarray:
        """The light of the empty room with people behind its panes, and those before them mirrored in the panes."""
        y, low, high = self.clip.layout.glass[0]
        steps = (y - scene.view.eye[1]) / scene.rays[..., 1]
        place = np.array(scene.view.eye, np.float32) + scene.rays * steps[..., None]
        pane = (place[..., 0] > low) & (place[..., 0] < high) & (place[..., 2] > 0.05) & (place[..., 2] < room.PANE)
        pane = (pane & (steps > 0) & (steps < scene.depth))[..., None]
        behind, mirrored = [], []
        for posed in people:
            if posed.place[1] > y:
                behind.append(posed)
            else:
                flip, shift = np.array([1, -1, 1], np.float32), np.array([0, 2 * y, 0], np.float32)
                things = [(spots * flip + shift, faces, paint) for spots, faces, paint in posed.things]
                mirrored.append(
                    replace(posed, points=posed.points * flip + shift, normal=posed.normal * flip, things=things)
                )
        beyond = scene.clear * light / np.maximum(scene.light, 1e-4)
        added = cv2.GaussianBlur(np.maximum(scene.light - CLEAR * scene.clear, 0), (0, 0), 2.0)
        if behind:
            found, cover = self.drawn(behind, scene, maps)
            beyond = beyond * (1 - cover) + found
            light = light * (1 - cover) + found
        if mirrored:
            open_ = Set(scene.view, scene.light, np.full_like(scene.depth, 1e3))
            found, cover = self.drawn(mirrored, open_, np.full_like(maps, -1))
            added = added * (1 - cover) + MIRRORED * found
        return np.where(pane, CLEAR * beyond + added, light)

    def frame(self, index: int, out: Path) -> None:
        """Draws a frame, and writes its record last."""
        time = index / self.clip.rate
        view = self.clip.view_at(time)
        scene, people = self.set_at(view), self.posed(time)
        light, persons, objects, depth = scene.light, [], [], scene.depth
        if people:
            maps = self.shadows(people)
            reached = raster.floor_shares(
                scene.depth, np.array(view.eye, np.float32), scene.rays, SLOPES, self.corner, CELL, maps
            )
            reached = cv2.GaussianBlur(reached, (0, 0), 2.0)[..., None]
            light = light * np.where(brightness(light)[..., None] > 1.5, 1, 1 - DIRECT * (1 - reached))
            if scene.clear is not None:
                light = self.through_glass(people, scene, light, maps)
                people_before = [posed for posed in people if posed.place[1] < self.clip.layout.glass[0][0]]
            else:
                people_before = people
            if people_before:
                found, cover = self.drawn(people_before, scene, maps)
                light = light * (1 - cover) + found
            persons, objects, depth = records(people, scene)
        code = np.clip(light / HEADROOM, 0, 1)
        code = np.where(code <= 0.0031308, 12.92 * code, 1.055 * np.maximum(code, 1e-8) ** (1 / 2.4) - 0.055)
        if people or self.clip.turning:
            cv2.imwrite(
                str(out / f"{index:04d}_0.png"),
                np.round(65535 * code).astype(np.uint16),
                [cv2.IMWRITE_PNG_COMPRESSION, 1],
            )
        if self.clip.depth:
            np.savez_compressed(out / f"{index:04d}_depth.npz", depth=depth.astype(np.float16))
        entry = {"light": self.clip.light(index).name, "persons": persons, "objects": objects, "shadows": []}
        entry["regions"] = [[0, 0, *view.size]] if people or self.clip.turning else []
        (out / f"{index:04d}.json").write_text(json.dumps(entry))


def records(people: list[Posed], scene: Set) -> tuple[list[dict], list[dict], np.ndarray]:
    """People who can be seen, what they push and ride, and the depths (h, w) of the whole picture."""
    view, shape, eye = scene.view, scene.view.shape, np.array(scene.view.eye)
    maps = []
    for posed in people:
        model = posed.actor.model
        pixels, load_pixels = view.projected(posed.points), view.projected(posed.load[0])
        own, load = outline_of(pixels, model.faces, shape), outline_of(load_pixels, posed.load[1], shape)
        maps.append((pixels, own, load_pixels, load))
    every = [part for _, own, _, load in maps for part in (own, load) if part is not None and part.shown]
    persons, objects = [], []
    for posed, (pixels, own, load_pixels, load) in zip(people, maps, strict=True):
        for part, spots in ((own, pixels), (load, load_pixels)):
            if part is None or not part.shown:
                continue
            others = np.minimum.reduce([scene.depth, *(other.in_picture for other in every if other is not part)])
            mine = part.in_picture
            share = float((np.isfinite(mine) & (mine <= others + SLACK)).sum() / max(part.filled().sum(), 1))
            x, y, w, h = box_of(spots[spots[:, 2] > NEAR], shape)
            box = {"x": x, "y": y, "w": w, "h": h}
            if part is load and share > PLAIN and posed.actor.role.carries:
                objects.append({"kind": posed.actor.role.carries, **box})
            if part is own and share >= FAINT and w > 0 and h > 0:
                persons.append({
                    "id": posed.actor.name, **box, "visible": round(share, 2),
                    "distance_m": round(float(np.hypot(*(np.array(posed.place) - eye[:2]))), 2),
                    "facing_rad": round(posed.facing(eye), 2), "posture": "seated" if posed.seated else "standing",
                })  # fmt: skip
    return persons, objects, np.minimum.reduce([scene.depth, *(part.in_picture for part in every)])


def standing(placed: list[furniture.Placed], view: View) -> list[dict]:
    """Boxes of static objects that may be taken for a person."""
    out = []
    for thing in placed:
        pixels = view.projected(thing.points)
        if (pixels[:, 2] > NEAR).any():
            x, y, w, h = box_of(pixels[pixels[:, 2] > NEAR], view.shape)
            if min(w, h) > 2:
                out.append({"kind": thing.kind, "x": x, "y": y, "w": w, "h": h})
    return out


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clip", choices=[clip.name for clip in ROOMS])
    parser.add_argument("--bodies", type=Path, default=Path("bodies.npz"))
    parser.add_argument("--out", type=Path, default=Path("frames"), help="the clip's frames go to a folder in it")
    parser.add_argument("--samples", type=int, default=10, help="of the empty room")
    parser.add_argument("--only", type=int, nargs="*", help="frame numbers, default all")
    options = parser.parse_args()
    clip, out = CLIPS[options.clip], options.out / options.clip
    out.mkdir(parents=True, exist_ok=True)
    stage = Stage(clip, dict(np.load(options.bodies)), out, options.samples)
    entry = {"name": clip.name, "scene": clip.scene, "split": clip.split, "objects": stage.objects}
    (out / "clip.json").write_text(json.dumps(entry))
    for index in range(clip.frames()) if options.only is None else options.only:
        if not (out / f"{index:04d}.json").exists():
            begun = clock.process_time()
            stage.frame(index, out)
            print(f"{clip.name} {index}: {clock.process_time() - begun:.2f} s", flush=True)


if __name__ == "__main__":
    main()
