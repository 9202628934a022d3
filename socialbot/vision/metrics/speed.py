"""Speed: how many pictures a second go through the whole pipeline, measured while nothing else runs.

End to end: JPEG decoding, conversion, detection, tracking, distance. In a process of its own, before the jobs that
run side by side, with as many threads as the robot would give it.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from socialbot.core.errors import ImageError
from socialbot.vision.metrics.frames import Encoded
from socialbot.vision.metrics.pipeline import Job, Pipeline
from socialbot.vision.metrics.workers import apart

__all__ = ["Speed", "measure"]

FRAMES = 80
WARM_UP = 5
"""The first pictures are not counted: caches are cold, and a tracker knows nobody."""


@dataclass(frozen=True)
class Speed:
    """Pictures a second with ``threads``, and how long a picture takes: the middle one and the slowest of twenty, ms.

    ``decode_ms`` is the part of the middle that goes into decoding.
    """

    frames: int
    threads: int
    frames_per_s: float
    median_ms: float
    p95_ms: float
    decode_ms: float

    def __str__(self) -> str:
        threads = "1 thread" if self.threads == 1 else f"{self.threads} threads"
        spread = f"median {self.median_ms:.0f} ms, 95 % within {self.p95_ms:.0f} ms"
        return f"{self.frames_per_s:.1f} frames/s end to end with {threads} ({spread})"


def measure(jobs: Sequence[Job], threads: int) -> Speed | None:
    """The speed of the pipeline of ``jobs`` on stretches from the middle of their footage; None without good pictures.

    Raises SocialbotError when the footage or the detector cannot be used.
    """
    (result,) = apart(_measure, [(tuple(jobs), threads)], 1)
    return result


def _measure(jobs: Sequence[Job], threads: int) -> Speed | None:
    times = np.array(list(itertools.chain.from_iterable(_times(job, threads, len(jobs)) for job in jobs)))
    if not len(times):
        return None
    whole = times.sum(axis=1)
    return Speed(
        frames=len(times),
        threads=threads,
        frames_per_s=float(len(times) / whole.sum()),
        median_ms=float(np.median(whole) * 1000),
        p95_ms=float(np.quantile(whole, 0.95) * 1000),
        decode_ms=float(np.median(times[:, 0]) * 1000),
    )


def _times(job: Job, threads: int, jobs: int) -> list[tuple[float, float]]:
    """Seconds for decoding and for all that follows, for each picture of a stretch of ``job``."""
    cv2.setNumThreads(threads)
    pipeline = Pipeline(job.pipeline, threads=threads, consecutive=job.footage.consecutive, recording=False)
    times: list[tuple[float, float]] = []
    for encoded in _stretch(job, max(1, FRAMES // jobs) + WARM_UP):
        begun = time.perf_counter()
        try:
            image = encoded.bgr()
        except ImageError:
            continue
        decoded = time.perf_counter()
        pipeline.find(image, encoded.stamp, encoded.info)
        times.append((decoded - begun, time.perf_counter() - decoded))
    return times[min(WARM_UP, len(times) // 2) :]


def _stretch(job: Job, count: int) -> list[Encoded]:
    """``count`` pictures from the middle of the job's footage, read beforehand."""
    begin = max(0, (job.frames - count) // 2)
    return list(itertools.islice(job.footage.pictures(), begin, begin + count))
