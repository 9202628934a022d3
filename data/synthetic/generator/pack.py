"""Packs rendered clips: blends the regions, exposes, adds noise, and writes bags, truth files and contact sheets."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
from clips import CLIPS, Clip
from optics import HEIGHT, WIDTH
from pictures import Empty, composed, empty_of, record_of
from recording import write_bag
from sensor import Exposure, developed, noisy
from story import RATE
from truths import BANDS, ClipTruth, counted, frame_truth, message_of, rows, write_truth

ACROSS, DOWN = 4, 4
MARKS = ("<!-- counts -->\n", "<!-- end of counts -->\n")


def stamp_of(clip: Clip, index: int) -> int:
    """Nanoseconds of a frame."""
    return clip.start * 10**9 + index * (10**9 // RATE)


def exposed(clip: Clip, frames: Path, count: int, noise: float) -> tuple[list[np.ndarray], list[dict]]:
    """The pictures (bgr uint8) of the clip's first frames, and their truth."""
    states = {state.name: empty_of(frames, state.name) for _, state in clip.lights}
    exposure, pictures, truths = Exposure(), [], []
    for index in range(count):
        before, after, share = clip.fading(index)
        empty = states[before.name]
        if share:
            empty = Empty(empty.true * (1 - share) + states[after.name].true * share, empty.quick)
        record = record_of(frames, index)
        light = composed(frames, index, record.regions, empty)
        truths.append(frame_truth(stamp_of(clip, index), record, light, empty.true))
        gain = exposure.step(light, 1 / RATE)
        pictures.append(noisy(developed(light, gain), index, noise * np.clip(gain, 0.8, 4.0) ** 0.5))
    return pictures, truths


def encoded(pictures: list[np.ndarray], quality: int) -> list[np.ndarray]:
    """JPEG bytes."""
    return [cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1] for picture in pictures]


def write_sheet(path: Path, pictures: list[np.ndarray], truths: list[dict], label: str) -> None:
    """Sample frames at half size, evenly spread over those with somebody in them."""
    busy = [index for index, truth in enumerate(truths) if truth["persons"]] or list(range(len(pictures)))
    tiles = []
    for index in [busy[int(k)] for k in np.linspace(0, len(busy) - 1, ACROSS * DOWN)]:
        tile = cv2.resize(pictures[index], (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA)
        text = f"{label} {index / RATE:.1f} s"
        cv2.putText(tile, text, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (255, 255, 255), 3, cv2.LINE_AA)
        tiles.append(cv2.putText(tile, text, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (20, 20, 20), 1, cv2.LINE_AA))
    rows = [np.hstack(tiles[i : i + ACROSS]) for i in range(0, len(tiles), ACROSS)]
    cv2.imwrite(str(path), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 80])


def pack(clip: Clip, frames: Path, out: Path, noise: float, quality: int, count: int) -> None:
    """Writes one clip's bag, truth and sheet, and says what is in them."""
    about = ClipTruth(**json.loads((frames / "clip.json").read_text()))
    pictures, truths = exposed(clip, frames, count, noise)
    jpegs = encoded(pictures, quality)
    stamps = [truth["stamp"] for truth in truths]
    write_bag(out / clip.name, stamps, jpegs, [message_of(truth, about) for truth in truths], RATE)
    write_truth(out / f"{clip.name}.truth.json", truths, about)
    write_sheet(out / f"{clip.name}.jpg", pictures, truths, clip.name)
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
    parser.add_argument("--quality", type=int, default=80)
    parser.add_argument("--noise", type=float, default=1.3, help="grey levels")
    parser.add_argument("--first", type=int, help="only so many frames from the start, default all")
    options = parser.parse_args()
    for name in options.clips:
        count = options.first or CLIPS[name].frames()
        pack(CLIPS[name], options.frames / name, options.out, options.noise, options.quality, count)
    if (options.out / "README.md").exists():
        write_counts(options.out / "README.md", sorted(options.out.glob("scene*.truth.json")))


if __name__ == "__main__":
    main()
