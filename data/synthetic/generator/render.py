"""Renders the story: the empty corridor once, then for every frame only the regions around the people.

Writes background.png, and for every frame a JSON of its truth and its regions (PNG each). Frames that exist are kept,
so a stopped run goes on where it was.
"""

from __future__ import annotations

import argparse
import json
from itertools import combinations
from pathlib import Path

import bpy
import corridor
import numpy as np
from camera import HEIGHT, WIDTH, Region, projected, render
from person import Person
from story import RATE, ROLES, SECONDS, present

NEAR = 0.05
FAINT = 0.05


def region_of(pixels: np.ndarray) -> Region | None:
    """The part of the picture that a person, their shadow and their mirror image on the floor can change."""
    (left, top), (right, bottom) = pixels.min(0), pixels.max(0)
    wide, high = right - left, bottom - top
    spread = [left - 0.35 * wide - 8, top - 0.04 * high - 8, right + 0.35 * wide + 8, bottom + 1.2 * high + 8]
    clipped = [int(c) for c in np.clip(spread, 0, [WIDTH, HEIGHT, WIDTH, HEIGHT])]
    return tuple(clipped) if clipped[2] - clipped[0] > 4 and clipped[3] - clipped[1] > 4 else None


def merged(regions: list[Region]) -> list[Region]:
    """Regions that overlap become one."""
    for a, b in combinations(regions, 2):
        if a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]:
            union = (min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3]))
            return merged([union, *(region for region in regions if region not in (a, b))])
    return regions


def truth(person: Person, scene: bpy.types.Scene, pixels: np.ndarray, time: float) -> dict:
    """Box, distance and visible share of one person."""
    left, top = np.clip(pixels.min(0), 0, [WIDTH, HEIGHT])
    right, bottom = np.clip(pixels.max(0), 0, [WIDTH, HEIGHT])
    tracks = person.walker.tracks
    place = [np.interp(time, person.walker.grid, tracks[axis]) for axis in "xy"]
    box = {"x": left, "y": top, "w": right - left, "h": bottom - top}
    return {
        "id": person.name,
        **{key: round(float(value), 1) for key, value in box.items()},
        "distance_m": round(float(np.hypot(*place)), 2),
        "visible": round(person.visible_share(scene, pixels), 2),
    }


def outline(person: Person, time: float) -> np.ndarray:
    """Poses a person, or hides one who is away; pixels of all vertices before the camera."""
    here = present(ROLES[person.name], time)
    person.show(here)
    if not here:
        return np.empty((0, 2))
    pixels = projected(person.pose(time))
    return pixels[pixels[:, 2] > NEAR, :2]


def frame(scene: bpy.types.Scene, people: list[Person], index: int, samples: int, out: Path) -> None:
    """Renders one frame's regions and writes its record last."""
    time = index / RATE
    outlines = [(person, outline(person, time)) for person in people]
    bpy.context.view_layer.update()
    records, regions = [], []
    for person, pixels in outlines:
        region = region_of(pixels) if len(pixels) else None
        if region is None:
            continue
        record = truth(person, scene, pixels, time)
        if record["visible"] > 0:
            regions.append(region)
        if record["visible"] >= FAINT:
            records.append(record)
    regions = merged(regions)
    for number, region in enumerate(regions):
        render(scene, samples, out / f"{index:04d}_{number}.png", region)
    (out / f"{index:04d}.json").write_text(json.dumps({"persons": records, "regions": regions}))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", type=Path, default=Path("bodies.npz"))
    parser.add_argument("--out", type=Path, default=Path("frames"))
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--background-samples", type=int, default=64)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--only", type=int, nargs="*", help="frame numbers, default all")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    arrays = dict(np.load(options.bodies))
    scene = corridor.build(options.threads)
    if not (options.out / "background.png").exists():
        render(scene, options.background_samples, options.out / "background.png")
    people = [Person(scene, arrays, name, role, seed) for seed, (name, role) in enumerate(ROLES.items(), 1)]
    for index in options.only or range(SECONDS * RATE):
        if not (options.out / f"{index:04d}.json").exists():
            frame(scene, people, index, options.samples, options.out)


if __name__ == "__main__":
    main()
