"""A job: one detector looks through one piece of footage, in whatever process or on whatever machine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2

from socialbot.errors import ImageError, TruthError
from socialbot.evaluate.footage import Footage
from socialbot.evaluate.pipeline import Pipeline, PipelineSettings
from socialbot.messages import PersonDetection

__all__ = ["Found", "FoundFrame", "Job", "Told", "run_job"]

Told = Callable[[int], None]
"""Told of every frame that a job has done: how many so far."""


@dataclass(frozen=True)
class Job:
    """What to look through, with what; ``name`` is for people.

    ``frames`` is how many are expected. ``outermost`` has, by stamp, the x farthest to the right and the y farthest
    down at which a box of the truth begins: none may lie outside its picture.
    """

    name: str
    footage: Footage
    pipeline: PipelineSettings
    frames: int
    outermost: dict[int, tuple[float, float]]


@dataclass(frozen=True)
class FoundFrame:
    """What was found in one picture: by the pipeline, and every box of the detector down to low scores."""

    stamp: int
    width: int
    height: int
    persons: tuple[PersonDetection, ...]
    raw: tuple[PersonDetection, ...]


@dataclass(frozen=True)
class Found:
    """What a job has found, frame by frame; ``damaged`` pictures were left out, the first for the reason given."""

    frames: tuple[FoundFrame, ...]
    damaged: int = 0
    first_damage: str = ""


def run_job(job: Job, told: Told) -> Found:
    """Does ``job``. Raises SocialbotError for footage or a detector that cannot be used."""
    # Many jobs run side by side; one thread each is the fastest, and gives the same figures for any number.
    cv2.setNumThreads(1)
    pipeline = Pipeline(job.pipeline, threads=1, consecutive=job.footage.consecutive)
    frames: list[FoundFrame] = []
    damaged, first = 0, ""
    for number, encoded in enumerate(job.footage.pictures(), 1):
        try:
            image = encoded.bgr()
        except ImageError as error:
            damaged, first = damaged + 1, first or str(error)
            continue
        height, width = image.shape[:2]
        _check_size(job, encoded.stamp, encoded.name, width, height)
        persons, raw = pipeline.find(image, encoded.stamp, encoded.info)
        frames.append(FoundFrame(encoded.stamp, width, height, persons, raw))
        told(number)
    return Found(tuple(frames), damaged, first)


def _check_size(job: Job, stamp: int, name: str, width: int, height: int) -> None:
    x, y = job.outermost.get(stamp, (0.0, 0.0))
    if x >= width or y >= height:
        raise TruthError(
            f"a box begins at {x:g}, {y:g}, outside the picture of {width}x{height} pixels",
            where=name or f"{job.name}: frame {stamp}",
            remedy="are the boxes those of this picture, in its own size?",
        )
