"""Annotated video of a run: bag images with detections, beliefs and speech."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from pathlib import Path

import cv2
import msgspec
import numpy as np

from socialbot.bags.reader import Bag
from socialbot.core.clock import SECOND
from socialbot.core.errors import BagError, ImageError
from socialbot.core.messages import CompressedImage, Image, TraceRecord, Utterance
from socialbot.runs.record import RunRecord
from socialbot.vision.annotate import draw
from socialbot.vision.images import bgr_from_compressed, bgr_from_image
from socialbot.vision.metrics.truth import GroundTruth

SPOKEN_FOR_NS = 3 * SECOND

DEFAULT_RATE_HZ = 10.0


def write_video(
    bag: Bag,
    image_topic: str,
    record: RunRecord,
    truth: GroundTruth | None,
    path: Path,
    advance: Callable[[int], None] = lambda done: None,
) -> Path:
    """Write all images of ``image_topic`` with detections, beliefs and speech as .mp4; damaged ones are skipped.

    Raises:
        BagError: There is no image, or the video cannot be written.
    """
    detections = {message.stamp: message for message in record.detections}
    people = {frame.stamp: frame.persons for frame in truth.frames} if truth else {}
    captions = _Captions(record, bag.start)
    writer: cv2.VideoWriter | None = None
    size = (0, 0)
    for number, (_, message) in enumerate(bag.messages({image_topic: image_topic})):
        advance(number)
        assert isinstance(message, (Image, CompressedImage))
        try:
            pixels = _pixels(message)
        except ImageError:
            continue
        stamp = message.stamp
        frame = draw(pixels, detections.get(stamp), people.get(stamp, ()), captions.at(stamp))
        if writer is None:
            writer, size = _open_writer(path, frame, _rate_hz(bag, image_topic)), frame.shape[1::-1]
        writer.write(frame if frame.shape[1::-1] == size else cv2.resize(frame, size))
    if writer is None:
        raise BagError("no picture to make a video of", where=str(bag.path))
    writer.release()
    return path


class _Captions:
    def __init__(self, record: RunRecord, start: int) -> None:
        self._start = start
        self._beliefs = _beliefs(record.folder / "trace.jsonl")
        self._utterances: list[Utterance] = record.utterances

    def at(self, stamp: int) -> list[str]:
        lines = [f"{(stamp - self._start) / SECOND:6.1f} s   {self._belief(stamp)}"]
        spoken = [u.text for u in self._utterances if u.stamp <= stamp < u.stamp + SPOKEN_FOR_NS]
        return [*lines, f'says: "{spoken[-1]}"'] if spoken else lines

    def _belief(self, stamp: int) -> str:
        index = bisect_right(self._beliefs, stamp, key=lambda belief: belief[0])
        return self._beliefs[index - 1][1] if index else ""


def _beliefs(trace: Path) -> list[tuple[int, str]]:
    records = (msgspec.json.decode(line, type=TraceRecord) for line in trace.read_bytes().splitlines())
    return [(r.stamp, f"believes {r.what}") for r in records if r.kind == "belief" and r.what.startswith("personD")]


def _pixels(message: Image | CompressedImage) -> np.ndarray:
    return bgr_from_image(message) if isinstance(message, Image) else bgr_from_compressed(message)


def _rate_hz(bag: Bag, image_topic: str) -> float:
    count = bag.topic(image_topic).count
    return (count - 1) / bag.duration_s if count > 1 and bag.duration_s > 0 else DEFAULT_RATE_HZ


def _open_writer(path: Path, frame: np.ndarray, rate_hz: float) -> cv2.VideoWriter:
    height, width = frame.shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate_hz, (width, height))
    if not writer.isOpened():
        raise BagError("the video cannot be written", where=str(path), remedy="leave it out with --no-video")
    return writer


__all__ = ["write_video"]
