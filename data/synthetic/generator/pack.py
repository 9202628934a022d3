"""Packs rendered clips: blends the regions, exposes, adds noise, and writes bags, truth files and contact sheets."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
from clips import NOSE, Clip
from layout import Room
from pictures import Empty, FrameRecord, composed, depth_of, empty_of, record_of, room_light
from recording import Head, write_bag
from rooms import CLIPS
from sensor import Exposure, depth_image, developed, noisy, smeared
from truths import BANDS, ClipTruth, counted, frame_truth, message_of, rows, write_truth

ACROSS, DOWN, TILE = 4, 4, 320
SOFT = 0.6  # px, of the lens in rooms, where drawn edges are too sharp
DEPTH_EVERY = 3  # images
MARKS = ("<!-- counts -->\n", "<!-- end of counts -->\n")


def stamp_of(clip: Clip, index: int) -> int:
    """Nanoseconds of a frame."""
    return clip.start * 10**9 + index * (10**9 // clip.rate)


def moves(clip: Clip, frames: Path, index: int, record: FrameRecord) -> list[tuple]:
    """Boxes of people and of the whole picture, and how far (px) their content moves while the shutter is open."""
    share, out = clip.shutter * clip.rate, []
    before = {person["id"]: person for person in record_of(frames, max(index - 1, 0)).persons}
    for now in record.persons:
        then = before.get(now["id"], now)
        middles = [np.array([p["x"] + p["w"] / 2, p["y"] + p["h"] / 2]) for p in (then, now)]
        shift = share * (middles[1] - middles[0]) * (not clip.turning)
        out.append(((now["x"], now["y"], now["w"], now["h"]), tuple(shift)))
    turned = np.subtract(clip.pan_tilt(index / clip.rate), clip.pan_tilt((index - 1) / clip.rate))
    out.append(((0, 0, *clip.view.size), tuple(share * clip.view.focal * turned * [1, -1])))
    return out


def corridor_light(clip: Clip, frames: Path, index: int, states: dict[str, Empty]) -> tuple[np.ndarray, np.ndarray]:
    """The light of a frame of render.py, and of the empty corridor."""
    before, after, share = clip.fading(index)
    empty = states[before.name]
    if share:
        empty = Empty(empty.true * (1 - share) + states[after.name].true * share, empty.quick)
    return composed(frames, index, record_of(frames, index).regions, empty), empty.true


def exposed(clip: Clip, frames: Path, count: int, noise: float) -> tuple[list[np.ndarray], list[dict]]:
    """The pictures (bgr uint8) of the clip's first frames, and their truth."""
    in_room = isinstance(clip.layout, Room)
    states = {} if in_room else {state.name: empty_of(frames, state.name) for _, state in clip.lights}
    exposure, pictures, truths = Exposure(), [], []
    for index in range(count):
        record = record_of(frames, index)
        if in_room:
            light = background = room_light(frames, index, clip.view)
        else:
            light, background = corridor_light(clip, frames, index, states)
        truths.append(frame_truth(stamp_of(clip, index), record, light, background))
        gain = exposure.step(light, 1 / clip.rate)
        if clip.shutter:
            light = smeared(light, moves(clip, frames, index, record))
        picture = developed(light, gain)
        if in_room:
            picture = cv2.GaussianBlur(picture, (0, 0), SOFT)
        pictures.append(noisy(picture, index, noise * np.clip(gain, 0.8, 4.0) ** 0.5))
    return pictures, truths


def encoded(pictures: list[np.ndarray], quality: int) -> list[np.ndarray]:
    """JPEG bytes."""
    how = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    return [cv2.imencode(".jpg", picture, how)[1] for picture in pictures]


def write_sheet(path: Path, pictures: list[np.ndarray], truths: list[dict], label: str, rate: int) -> None:
    """Sample frames made small, evenly spread over those with somebody in them."""
    busy = [index for index, truth in enumerate(truths) if truth["persons"]] or list(range(len(pictures)))
    tiles = []
    for index in [busy[int(k)] for k in np.linspace(0, len(busy) - 1, ACROSS * DOWN)]:
        high = round(TILE * pictures[index].shape[0] / pictures[index].shape[1])
        tile = cv2.resize(pictures[index], (TILE, high), interpolation=cv2.INTER_AREA)
        text = f"{label} {index / rate:.1f} s"
        cv2.putText(tile, text, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (255, 255, 255), 3, cv2.LINE_AA)
        tiles.append(cv2.putText(tile, text, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (20, 20, 20), 1, cv2.LINE_AA))
    rows = [np.hstack(tiles[i : i + ACROSS]) for i in range(0, len(tiles), ACROSS)]
    cv2.imwrite(str(path), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 70])


def pack(clip: Clip, frames: Path, out: Path, noise: float, quality: int, count: int) -> None:
    """Writes one clip's bag, truth and sheet, and says what is in them."""
    about = ClipTruth(**json.loads((frames / "clip.json").read_text()))
    pictures, truths = exposed(clip, frames, count, noise)
    jpegs = encoded(pictures, quality)
    stamps = [truth["stamp"] for truth in truths]
    indices = range(0, count, DEPTH_EVERY) if clip.depth else ()
    depths = {stamps[index]: depth_image(depth_of(frames, index), index) for index in indices}
    head = Head(clip.pan_tilt, clip.view.eye[2], NOSE) if clip.turning else None
    messages = [message_of(truth, about) for truth in truths]
    write_bag(out / clip.name, stamps, jpegs, messages, clip.rate, clip.view, depths, head)
    write_truth(out / f"{clip.name}.truth.json", truths, about)
    write_sheet(out / f"{clip.name}.jpg", pictures, truths, clip.name, clip.rate)
    empty = sum(not truth["persons"] for truth in truths)
    bands = ", ".join(
        f"{number} at {low:.0f}-{high:.0f} m" for (low, high), number in zip(BANDS, counted(truths), strict=True)
    )
    size = sum(file.stat().st_size for file in (out / clip.name).iterdir())
    print(f"{clip.name}: {len(jpegs)} frames, {empty} of them empty; {bands}; {size} bytes")


def write_counts(readme: Path, files: list[Path]) -> None:
    """Renews the table of counts between its marks in the README."""
    before, rest = readme.read_text().split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    readme.write_text(before + MARKS[0] + "\n".join(rows(files)) + "\n" + MARKS[1] + after)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clips", nargs="+", choices=CLIPS, metavar="CLIP", help=", ".join(CLIPS))
    parser.add_argument("--frames", type=Path, default=Path("frames"), help="where render.py wrote")
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1])
    parser.add_argument("--quality", type=int, help="of the JPEGs, default as the clip says")
    parser.add_argument("--noise", type=float, help="grey levels, default as the clip says")
    parser.add_argument("--first", type=int, help="only so many frames from the start, default all")
    options = parser.parse_args()
    for name in options.clips:
        clip = CLIPS[name]
        quality = options.quality or clip.quality
        noise = clip.noise if options.noise is None else options.noise
        pack(clip, options.frames / name, options.out, noise, quality, options.first or clip.frames())
    if (options.out / "README.md").exists():
        write_counts(options.out / "README.md", sorted(options.out.glob("*_*.truth.json")))


if __name__ == "__main__":
    main()
