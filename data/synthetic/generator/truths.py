"""The ground truth of a clip: for the file beside the bag, for the messages in it, and counted by distance."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pictures import FrameRecord, brightness

IMAGE_TOPIC = "/camera/image_raw/compressed"
BANDS = ((0.0, 2.0), (2.0, 10.0), (10.0, 20.0))
ASKED = 0.25  # visible share from which a person counts
DARK = 0.78  # light that a shadow may leave to be called clear


@dataclass(frozen=True)
class ClipTruth:
    """What a clip is, and the things (boxes with a kind) that stand in it all the time."""

    name: str
    scene: str
    split: str
    objects: list[dict]


def clear(shadow: dict, picture: np.ndarray, background: np.ndarray) -> bool:
    """Whether a shadow is plainly darker than the empty corridor there; both pictures as linear light."""
    u, v = np.array(shadow["points"]).T
    before = brightness(background[v, u])
    return float(np.median(brightness(picture[v, u]) / np.maximum(before, 1e-4))) < DARK


def frame_truth(stamp: int, record: FrameRecord, picture: np.ndarray, background: np.ndarray) -> dict:
    """A frame of the truth: people, and the things of this frame, clear shadows among them."""
    shadows = [
        {key: shadow[key] for key in ("kind", "x", "y", "w", "h")}
        for shadow in record.shadows
        if clear(shadow, picture, background)
    ]
    objects = record.objects + shadows
    return {"stamp": stamp, "light": record.light, "persons": record.persons, "objects": objects}


def message_of(frame: dict, clip: ClipTruth) -> str:
    """The same frame as a message: complete in itself."""
    head = {"schema": "socialbot/truth_frame", "version": 1, "stamp": frame["stamp"], "image_topic": IMAGE_TOPIC}
    body = {"scene": clip.scene, "split": clip.split, "light": frame["light"], "persons": frame["persons"]}
    return json.dumps({**head, **body, "objects": clip.objects + frame["objects"]})


def write_truth(path: Path, frames: list[dict], clip: ClipTruth) -> None:
    """The truth file, one line a frame."""
    head = {"schema": "socialbot/truth", "version": 1, "image_topic": IMAGE_TOPIC, "scene": clip.scene}
    head |= {"split": clip.split, "objects": clip.objects}
    lines = ",\n".join(json.dumps(frame) for frame in frames)
    path.write_text(json.dumps(head)[:-1] + ', "frames": [\n' + lines + "\n]}\n")


def counted(frames: list[dict]) -> list[int]:
    """Person instances that are visible enough, by band of distance."""
    seen = [p["distance_m"] for frame in frames for p in frame["persons"] if p["visible"] >= ASKED]
    return [sum(low <= distance < high for distance in seen) for low, high in BANDS]


def rows(files: list[Path]) -> list[str]:
    """A Markdown table of what truth files hold, with sums by scene."""
    table = ["| | frames | empty | below 2 m | 2 - 10 m | 10 - 20 m |", "|---|---|---|---|---|---|"]
    sums: dict[str, np.ndarray] = {}
    for file in files:
        truth = json.loads(file.read_text())
        frames = truth["frames"]
        numbers = np.array([len(frames), sum(not frame["persons"] for frame in frames), *counted(frames)])
        table.append(row(f"{truth['scene']}, {truth['split']}", numbers))
        sums[truth["scene"]] = sums.get(truth["scene"], np.zeros(5, int)) + numbers
    return table + [row(f"**{scene}**", numbers) for scene, numbers in sums.items()]


def row(name: str, numbers: np.ndarray) -> str:
    """A line of the table."""
    return f"| {name} | " + " | ".join(str(number) for number in numbers) + " |"
