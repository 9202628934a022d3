"""Small scenes: frames and detections by hand, and bags and folders of drawn people."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np

from socialbot.bags.types import RosbagsTypes
from socialbot.bags.writer import BagWriter
from socialbot.core.clock import SECOND
from socialbot.core.messages import CameraInfo, CompressedImage, PersonDetection
from socialbot.graph.files import load_graph
from socialbot.vision._hog import HogDetector
from socialbot.vision.detector import Detections
from socialbot.vision.metrics.behaviour import single_node
from socialbot.vision.metrics.evaluation import DetectorResult, Evaluation, EvaluationPlan, jobs_of, scored
from socialbot.vision.metrics.frames import LabelledFrame, LabelledSource
from socialbot.vision.metrics.matches import Rules
from socialbot.vision.metrics.pipeline import FoundFrame, PipelineSettings, run_job
from socialbot.vision.metrics.scores import BandScore
from socialbot.vision.metrics.truth import Person
from tests.vision.drawn import add_person, corridor

WALDO = single_node(load_graph("waldo"), "bdi_engine")
START = 1_700_000_000 * SECOND
IMAGES = "/camera/image_raw/compressed"
TENTH = SECOND // 10
POSE = ("mount_height_m=1.62", "pitch_rad=0.052")
"""Pose of the camera that people are drawn for."""
TOP = 202
"""Where the head is of somebody 220 pixels high who stands on the floor before Waldo's camera."""


def person(x=0.0, *, w=10.0, h=20.0, distance: float | None = 5.0, visible=1.0, id="p") -> Person:
    return Person(x=x, y=0.0, w=w, h=h, distance_m=distance, visible=visible, id=id)


def seen(x=0.0, *, w=10.0, h=20.0, score=0.5, distance: float | None = 5.0, track="") -> PersonDetection:
    return PersonDetection(x=x, y=0, w=w, h=h, score=score, distance_m=distance, track_id=track)


def frame(*persons: Person, number=0, **fields) -> LabelledFrame:
    return LabelledFrame(stamp=START + number * TENTH, name=str(number), block=number // 30, persons=persons, **fields)


def found(*persons: PersonDetection, number=0, raw: Sequence[PersonDetection] = ()) -> FoundFrame:
    return FoundFrame(START + number * TENTH, 640, 480, tuple(persons), tuple(raw) or tuple(persons))


def walking(count: int = 12, seed: int = 0) -> list[tuple[np.ndarray, tuple[float, float, float, float]]]:
    """Images of a person who crosses the view, with the box in each."""
    shown = []
    for number in range(count):
        picture = corridor(seed=seed + number)
        shown.append((picture, add_person(picture, 220 + 12 * number, TOP, 220)))
    return shown


def drawn_bag(
    folder: Path,
    name: str = "clip",
    *,
    frames: int = 12,
    seed: int = 0,
    beside: bool = True,
    inside: bool = False,
    **about,
) -> Path:
    """Bag of a person who crosses the view, with the ground truth beside or inside it."""
    entries, types = [], RosbagsTypes()
    with BagWriter(folder / name) as bag:
        info = CameraInfo(stamp=START, frame_id="c", width=640, height=480, k=(525, 0, 320, 0, 525, 240, 0, 0, 1))
        bag.write("/camera/camera_info", info, START)
        for number, (picture, box) in enumerate(walking(frames, seed)):
            stamp = START + number * TENTH
            data = cv2.imencode(".jpg", picture)[1].reshape(-1)
            bag.write(IMAGES, CompressedImage(stamp=stamp, frame_id="c", format="jpeg", data=data), stamp)
            body = dict(zip("xywh", box, strict=True))
            entry = {"stamp": stamp, "persons": [{"id": "w", **body, "distance_m": 4.0, "visible": 1.0}]}
            entries.append(entry)
            if inside:
                head = {"schema": "socialbot/truth_frame", "version": 1, "image_topic": IMAGES, **about}
                text = types.make("std_msgs/msg/String", data=json.dumps({**head, **entry}))
                bag.write_raw("/ground_truth/persons", "std_msgs/msg/String", types.serialize(text), stamp)
    if beside:
        content = {"schema": "socialbot/truth", "version": 1, "image_topic": IMAGES, **about, "frames": entries}
        (folder / f"{name}.truth.json").write_text(json.dumps(content))
    return folder / name


def drawn_pictures(folder: Path, count: int = 3, *, distance: float | None = 4.0, **entry) -> Path:
    """A folder of pictures with labels."""
    folder.mkdir(exist_ok=True)
    entries = []
    for number, (picture, box) in enumerate(walking(count)):
        cv2.imwrite(str(folder / f"{number}.png"), picture)
        body = dict(zip("xywh", box, strict=True))
        boxes = [{**body, "distance_m": distance, "truncated": False, "occluded": False}]
        entries.append({"image": f"{number}.png", "complete": True, "boxes": boxes, "ignore": [], **entry})
    (folder / "persons.json").write_text(json.dumps(entries))
    return folder


_detect = HogDetector.detect
_detected: dict[tuple[object, ...], Detections] = {}


def _detect_once(detector: HogDetector, image: np.ndarray) -> Detections:
    """What HOG finds in an image; many tests evaluate the same ones, and it takes a quarter of a second."""
    key = (
        image.shape,
        sha256(image.tobytes()).digest(),
        detector.threshold,
        detector.horizon,
        detector.camera_height,
    )
    if key not in _detected:
        _detected[key] = _detect(detector, image)
    return _detected[key]


def evaluated(
    sources: Iterable[LabelledSource], *pipelines: PipelineSettings, rules: Rules | None = None
) -> Evaluation:
    """An evaluation without processes of its own, and without speeds; of HOG, which needs nothing beyond OpenCV."""
    plan = EvaluationPlan(
        tuple(sources), pipelines or (PipelineSettings("hog"),), rules or Rules(), threads=0, waldo=WALDO
    )
    with patch.object(HogDetector, "detect", _detect_once):
        found = [run_job(job, lambda done: None) for job in jobs_of(plan)]
    return scored(plan, found, [None] * len(plan.pipelines))


def with_band(result: DetectorResult, scene: str, band: str, score: BandScore) -> DetectorResult:
    """``result`` with another score of one band."""
    scored = result.scenes[scene]
    bands = {**scored.score.bands, band: score}
    return replace(result, scenes={**result.scenes, scene: replace(scored, score=replace(scored.score, bands=bands))})
