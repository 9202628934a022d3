"""Renders a clip: the empty corridor once for every state of the light, then only the regions around the people.

Writes clip.json, pictures of the empty corridor (16 bit, two stops of headroom), and for every frame the regions (a
picture each), where the bodies are in them, and a JSON of its truth. Light that walls throw back is followed in
background_*.png, and only estimated in plain_*.png and in the regions. Frames that exist are kept, so a stopped run
goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import time as clock
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import bpy
import corridor
import furniture
import light
import numpy as np
from camera import Region, render, static_depth
from clips import CLIPS, Clip
from layout import HALF, Light
from optics import CORRIDOR
from outline import DepthMap, box_of, drawn, ground_shadow, sunlit, visible_mask, visible_share
from person import Person
from poster import portrait
from story import RATE, present

NEAR, FAINT = 0.05, 0.05
APART = 12_000  # pixels that a render of its own costs
SPARSE = 1200  # points that stand for a body where its shadow is looked for
PLAIN = 0.3
WIDTH, HEIGHT = CORRIDOR.size
SHAPE, projected = CORRIDOR.shape, CORRIDOR.projected
LARGE = 60_000  # pixels of a region in which fewer samples do
ON_POSTER = {"tune": "B", "held-back": "A", "": "A"}
CLEAR_POINTS, LEAST_SHADOW = 120, 14.0


def merged(regions: list[Region]) -> list[Region]:
    """Regions that overlap, or are cheaper as one, become one."""
    for a, b in combinations(regions, 2):
        union = (min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3]))
        overlap = a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
        if overlap or size(union) < size(a) + size(b) + APART:
            return merged([union, *(region for region in regions if region not in (a, b))])
    return regions


def size(region: Region) -> int:
    """Pixels of a region."""
    return (region[2] - region[0]) * (region[3] - region[1])


def region_of(pixels: np.ndarray, side: float, below: float) -> Region | None:
    """The rectangle of some pixels with a margin, inside the picture."""
    pixels = pixels[pixels[:, 2] > NEAR, :2]
    if not len(pixels):
        return None
    spread = np.concatenate([pixels.min(0) - np.array([side, 8]), pixels.max(0) + np.array([side, below])])
    clipped = tuple(int(c) for c in np.clip(spread, 0, [WIDTH, HEIGHT, WIDTH, HEIGHT]))
    return clipped if clipped[2] - clipped[0] > 4 and clipped[3] - clipped[1] > 4 else None


class Meshes:
    """Points and triangles of Blender objects."""

    def __init__(self) -> None:
        """Remembers the triangles of every mesh."""
        self.faces: dict[str, np.ndarray] = {}

    def triangles(self, thing: bpy.types.Object) -> np.ndarray:
        """Vertex numbers (n, 3)."""
        if thing.data.name not in self.faces:
            thing.data.calc_loop_triangles()
            faces = np.empty(len(thing.data.loop_triangles) * 3, np.int32)
            thing.data.loop_triangles.foreach_get("vertices", faces)
            self.faces[thing.data.name] = faces.reshape(-1, 3)
        return self.faces[thing.data.name]

    def joined(self, things: list[bpy.types.Object]) -> tuple[np.ndarray, np.ndarray]:
        """World points (n, 3) and triangles (m, 3) of several objects; curves give points only."""
        points, faces, count = [np.empty((0, 3))], [np.empty((0, 3), np.int32)], 0
        for thing in things:
            source, key = (thing.data.vertices, "co") if thing.type == "MESH" else (thing.data.points, "position")
            own = np.empty(len(source) * 3, np.float32)
            source.foreach_get(key, own)
            matrix = np.array(thing.matrix_world)
            points.append(own.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3])
            if thing.type == "MESH":
                faces.append(self.triangles(thing) + count)
            count += len(source)
        return np.concatenate(points), np.concatenate(faces)


@dataclass
class Figure:
    """A person in one frame: what they are and what they carry, in the world and in the picture."""

    person: Person
    place: tuple[float, float]
    points: np.ndarray
    pixels: np.ndarray
    own: DepthMap | None
    load: DepthMap | None
    load_pixels: np.ndarray
    carries: str | None


@dataclass
class Stage:
    """A clip's scene, ready to render frame by frame."""

    clip: Clip
    scene: bpy.types.Scene
    rig: light.Rig
    static: np.ndarray
    arrays: dict[str, np.ndarray]
    meshes: Meshes = field(default_factory=Meshes)
    people: dict[int, Person] = field(default_factory=dict)
    state: Light | None = None

    def switch(self, state: Light) -> None:
        """Sets the lights."""
        if state != self.state:
            self.rig.switch(state)
            self.state = state

    def person(self, number: int) -> Person:
        """Who makes a visit, dressed when needed first."""
        if number not in self.people:
            visit = self.clip.visits[number]
            self.people[number] = Person(
                self.scene, self.arrays, visit.name, visit.role, ord(visit.name) - ord("A") + 1
            )
        return self.people[number]

    def figures(self, time: float) -> list[Figure]:
        """Poses everybody who is there and shows those who can be seen."""
        here = []
        for number, visit in enumerate(self.clip.visits):
            if present(visit.role, time):
                here.append((self.person(number), visit.role))
                here[-1][0].pose(time)
                here[-1][0].show(True)
            elif number in self.people:
                self.people[number].show(False)
        bpy.context.view_layer.update()
        return [self.figure(person, role.carries, time) for person, role in here]

    def figure(self, person: Person, carries: str | None, time: float) -> Figure:
        """What a posed person covers."""
        points, faces = self.meshes.joined([thing for thing in person.objects if not thing.hide_render])
        pixels = projected(points)
        load_points, load_faces = self.meshes.joined(
            [thing for thing in getattr(person, "things", []) if not thing.hide_render]
        )
        load_pixels = projected(load_points)
        own = drawn(pixels, faces, SHAPE)
        load = drawn(load_pixels, load_faces, SHAPE) if len(load_faces) else None
        walker = person.walker
        place = tuple(float(np.interp(time, walker.grid, walker.tracks[axis])) for axis in "xy")
        seen = any(part is not None and part.shown for part in (own, load))
        person.show(seen and place[1] > -0.6)
        return Figure(person, place, np.concatenate([points, load_points]), pixels, own, load, load_pixels, carries)

    def others(self, figures: list[Figure], but: DepthMap | None) -> np.ndarray:
        """Depths of everything but one thing."""
        out = self.static
        for figure in figures:
            for part in (figure.own, figure.load):
                if part is not None and part is not but and part.shown:
                    out = np.minimum(out, part.in_picture)
        return out

    def shadows(self, figure: Figure) -> list[tuple[np.ndarray, np.ndarray]]:
        """World points of the shadow of each light that throws one; the sun's first, if it reaches the person."""
        state = self.state
        assert state is not None
        points = figure.points[:: max(1, len(figure.points) // SPARSE)]
        out = []
        if state.sun:
            lit = points[sunlit(points, self.rig.way, corridor.panes(self.clip.layout), HALF)]
            if len(lit):
                out.append(ground_shadow(lit, np.append(self.rig.way, 0.0), HALF))
        low = points if self.rig.kind == "spots" else points[points[:, 2] < PLAIN]
        return out + [ground_shadow(low, lamp, HALF) for lamp in self.rig.casters(state, figure.place[1])]

    def regions(self, figure: Figure) -> list[Region]:
        """Parts of the picture that a person can change: the body, its mirror image in the floor, its shadows."""
        pixels = projected(figure.points)
        wide = np.ptp(np.clip(pixels[pixels[:, 2] > NEAR, 0], -WIDTH, 2 * WIDTH))
        mirrored = projected(figure.points[::7] * [1, 1, -1] * (figure.points[::7, 2:] < 1.0))
        found = [region_of(pixels, 8 + 0.12 * wide, 10), region_of(mirrored, 6, 6)]
        found += [region_of(projected(shadow), 8 + 0.05 * wide, 8) for shadow in self.shadows(figure)]
        return [region for region in found if region]


def record(stage: Stage, figure: Figure, figures: list[Figure]) -> dict | None:
    """Box, distance and visible share of one person; None when hardly visible."""
    if figure.own is None:
        return None
    share = visible_share(figure.own, stage.others(figures, figure.own))
    x, y, w, h = box_of(figure.pixels[figure.pixels[:, 2] > NEAR], SHAPE)
    if share < FAINT or w <= 0 or h <= 0:
        return None
    distance = round(float(np.hypot(*figure.place)), 2)
    return {
        "id": figure.person.name, "x": x, "y": y, "w": w, "h": h, "distance_m": distance, "visible": round(share, 2),
    }  # fmt: skip


def loads(stage: Stage, figures: list[Figure]) -> list[dict]:
    """Boxes of what people push and carry."""
    out = []
    for figure in figures:
        if (
            figure.load is None
            or figure.carries is None
            or visible_share(figure.load, stage.others(figures, figure.load)) < PLAIN
        ):
            continue
        x, y, w, h = box_of(figure.load_pixels[figure.load_pixels[:, 2] > NEAR], SHAPE)
        out.append({"kind": figure.carries, "x": x, "y": y, "w": w, "h": h})
    return out


def bodies(stage: Stage, figures: list[Figure]) -> np.ndarray:
    """Pixels (h, w) in which people or what they carry are seen."""
    parts = [part for figure in figures for part in (figure.own, figure.load) if part is not None and part.shown]
    return np.logical_or.reduce([visible_mask(part, stage.static) for part in parts])


def cast(stage: Stage, figures: list[Figure]) -> list[dict]:
    """Boxes of shadows that lie beside their person, with pixels by which their darkness can be judged."""
    if stage.rig.kind != "spots":
        return []
    people = stage.others(figures, None)
    out = []
    for figure in figures:
        x, y, w, h = (
            box_of(figure.pixels[figure.pixels[:, 2] > NEAR], SHAPE) if figure.own is not None else (0, 0, 0, 0)
        )
        for shadow in stage.shadows(figure):
            pixels = projected(shadow)
            inside = (pixels[:, :2] >= 0).all(1) & (pixels[:, :2] < [WIDTH, HEIGHT]).all(1) & (pixels[:, 2] > NEAR)
            spots = pixels[inside]
            u, v = spots[:, 0].astype(int), spots[:, 1].astype(int)
            spots = spots[spots[:, 2] <= people[v, u] * 1.01 + 0.03]
            if len(spots) < PLAIN * len(shadow):
                continue
            beside = (spots[:, 0] < x) | (spots[:, 0] > x + w) | (spots[:, 1] < y) | (spots[:, 1] > y + h)
            left, top, wide, high = box_of(spots, SHAPE)
            if beside.mean() < 0.5 or min(wide, high) < LEAST_SHADOW:
                continue
            few = spots[beside][:: max(1, int(beside.sum()) // CLEAR_POINTS), :2].astype(int).tolist()
            out.append({"kind": "shadow", "x": left, "y": top, "w": wide, "h": high, "points": few})
    return out


def frame(stage: Stage, index: int, samples: int, out: Path) -> None:
    """Renders one frame's regions and writes its record last."""
    figures = stage.figures(index / RATE)
    state = stage.clip.light(index)
    persons, regions, objects, shadows, shown = [], [], [], [], []
    if figures:
        stage.switch(state)
        records = [record(stage, figure, figures) for figure in figures]
        persons = [entry for entry in records if entry]
        shown = [figure for figure in figures if not figure.person.objects[0].hide_render]
        visible = [figure for figure in shown if changes(stage, figure, figures)]
        regions = merged([region for figure in visible for region in stage.regions(figure)])
        objects, shadows = loads(stage, figures), cast(stage, visible)
    for number, region in enumerate(regions):
        enough = samples if size(region) < LARGE else -(-2 * samples // 3)
        render(stage.scene, enough, out / f"{index:04d}_{number}.png", region)
    if regions:
        np.savez_compressed(out / f"{index:04d}.npz", bodies=np.packbits(bodies(stage, shown)))
    entry = {"light": state.name, "persons": persons, "objects": objects, "shadows": shadows, "regions": regions}
    (out / f"{index:04d}.json").write_text(json.dumps(entry))


def changes(stage: Stage, figure: Figure, figures: list[Figure]) -> bool:
    """Whether anything of a person or of what they carry can be seen."""
    parts = [part for part in (figure.own, figure.load) if part is not None]
    return any(visible_mask(part, stage.others(figures, part)).any() for part in parts)


def opened(clip: Clip, bodies: Path, out: Path, threads: int, samples: int) -> Stage:
    """Builds the clip's scene and writes what stays the same in all frames."""
    arrays = dict(np.load(bodies))
    hung = any(thing.kind == "poster" for thing in clip.layout.things)
    if hung and not (out / "poster.png").exists():
        portrait(arrays, ON_POSTER[clip.split], out / "poster.png")
    scene, rig, placed = corridor.build(clip.layout, clip.view, threads, str(out / "poster.png") if hung else None)
    for state in dict.fromkeys(state for _, state in clip.lights):
        rig.switch(state)
        for kind, plain in (("background", False), ("plain", True)):
            picture = out / f"{kind}_{state.name.replace(' ', '_')}.png"
            corridor.quick(scene, plain)
            if not picture.exists():
                render(scene, samples, picture)
    entry = {"name": clip.name, "scene": clip.scene, "split": clip.split, "objects": standing(placed)}
    (out / "clip.json").write_text(json.dumps(entry))
    return Stage(clip, scene, rig, static_depth(scene, clip.view), arrays)


def standing(placed: list[furniture.Placed]) -> list[dict]:
    """Boxes of the distractors that stand there all the time."""
    out = []
    for thing in placed:
        x, y, w, h = box_of(projected(thing.points), SHAPE)
        if min(w, h) > 2:
            out.append({"kind": thing.kind, "x": x, "y": y, "w": w, "h": h})
    return out


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clip", choices=CLIPS)
    parser.add_argument("--bodies", type=Path, default=Path("bodies.npz"))
    parser.add_argument("--out", type=Path, default=Path("frames"), help="the clip's frames go to a folder in it")
    parser.add_argument("--samples", type=int, default=6)
    parser.add_argument("--background-samples", type=int, default=16)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*", help="frame numbers, default all")
    options = parser.parse_args()
    clip, out = CLIPS[options.clip], options.out / options.clip
    out.mkdir(parents=True, exist_ok=True)
    stage = opened(clip, options.bodies, out, options.threads, options.background_samples)
    for index in range(clip.frames()) if options.only is None else options.only:
        if not (out / f"{index:04d}.json").exists():
            begun = clock.perf_counter()
            frame(stage, index, options.samples, out)
            print(f"{clip.name} {index}: {clock.perf_counter() - begun:.2f} s", flush=True)


if __name__ == "__main__":
    main()
