"""The evaluated pipeline: what the robot runs, all boxes of its detector, and its speed."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import cv2
import numpy as np

from socialbot.core.errors import ImageError, ParameterError, TruthError, suggestion
from socialbot.core.messages import CameraInfo, PersonDetection
from socialbot.graph.node import check_parameters
from socialbot.vision.camera import CameraModel
from socialbot.vision.detector import Detections, Detector
from socialbot.vision.detectors import DETECTORS, DetectorSettings, DetectorSpec
from socialbot.vision.metrics.frames import EncodedImage, ImageSequence
from socialbot.vision.metrics.workers import run_in_processes
from socialbot.vision.person_detector import PersonDetector
from socialbot.vision.pipeline import PersonPipeline, make_pipeline

__all__ = [
    "Found",
    "FoundFrame",
    "Job",
    "EvaluatedPipeline",
    "PipelineSettings",
    "RecordingDetector",
    "Speed",
    "Told",
    "measure",
    "run_job",
    "with_changes",
]


FLOOR_SHARE = 0.2
"""Curves begin at this share of the score that a detector is believed from."""

_NOT_SET = ("detector", "threads")
"""Parameters of the node that have options of their own."""

Persons = tuple[PersonDetection, ...]


@dataclass(frozen=True)
class PipelineSettings:
    """A detector by name, one of `DETECTORS`, and what differs from the defaults of the node `PersonDetector`."""

    detector: str
    changes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def spec(self) -> DetectorSpec:
        """The detector's description. Raises ParameterError when there is none of that name."""
        if self.detector not in DETECTORS:
            remedy = suggestion(self.detector, DETECTORS)
            raise ParameterError(f"no detector {self.detector!r}", where="--detector", remedy=remedy)
        return DETECTORS[self.detector]

    @property
    def values(self) -> dict[str, Any]:
        """Every parameter of the node. Raises ParameterError for one that does not fit."""
        return check_parameters(PersonDetector, {**self.changes, "detector": self.detector}, where="--set")

    @property
    def tracked(self) -> bool:
        """Whether people are followed from frame to frame."""
        return self.values["tracker"] != "none"

    @property
    def sure(self) -> float:
        """The score from which a detection alone is believed."""
        threshold = self.values["threshold"]
        return self.spec.sure if threshold < 0 else threshold

    @property
    def floor(self) -> float:
        """The least score of the boxes that curves are drawn from."""
        return min(self.spec.weak, FLOOR_SHARE * self.spec.sure, self.sure)


def with_changes(pipeline: PipelineSettings, changes: Sequence[str]) -> PipelineSettings:
    """``pipeline`` with changes written as NAME=VALUE, or DETECTOR.NAME=VALUE for that detector only.

    Raises ParameterError for what cannot be read, or does not fit.
    """
    changed = dict(pipeline.changes)
    for change in changes:
        target, equals, text = change.partition("=")
        detector, dot, name = target.rpartition(".")
        if not equals:
            raise ParameterError(f"cannot read {change!r}", where="--set", remedy="write NAME=VALUE")
        if dot and detector not in DETECTORS:
            raise ParameterError(f"no detector {detector!r}", where="--set", remedy=suggestion(detector, DETECTORS))
        value = _value(name, text)
        if not dot or detector == pipeline.detector:
            changed[name] = value
    return PipelineSettings(pipeline.detector, changed)


def _value(name: str, text: str) -> Any:
    declared = {key: each for key, each in PersonDetector.parameters().items() if key not in _NOT_SET}
    if name not in declared:
        raise ParameterError(f"no setting {name!r}", where="--set", remedy=suggestion(name, declared))
    kind = type(declared[name].default)
    try:
        value = {"true": True, "false": False}.get(text.lower(), text) if kind is bool else kind(text)
    except ValueError as error:
        raise ParameterError(f"{text!r} is not of type {kind.__name__}", where=f"--set {name}") from error
    return declared[name].check(value, where=f"--set {name}")


class RecordingDetector:
    """A detector that shows another's boxes, and keeps those that it holds back in ``seen``.

    ``threshold`` is what the pipeline asks for; the other detector is asked for everything above ``floor``. Greedy
    suppression makes both the same: the boxes above a higher threshold do not depend on those below it.
    """

    def __init__(self, detector: Detector, floor: float) -> None:
        self._detector = detector
        self._floor = floor
        self.threshold = detector.threshold
        self.box_width_m = detector.box_width_m
        self.horizon = detector.horizon
        self.camera_height = detector.camera_height
        self.seen = Detections.none()

    def detect(self, image: np.ndarray) -> Detections:
        """The people in ``image`` that reach the threshold."""
        self._detector.threshold = min(self._floor, self.threshold)
        self._detector.horizon = self.horizon
        self._detector.camera_height = self.camera_height
        self.seen = self._detector.detect(image)
        return _above(self.seen, self.threshold)


class _ReplayDetector:
    """A detector that says again what a recorder saw in the last picture."""

    def __init__(self, recorder: RecordingDetector, floor: float) -> None:
        self._recorder = recorder
        self.threshold = floor
        self.box_width_m = recorder.box_width_m
        self.horizon = recorder.horizon
        self.camera_height = recorder.camera_height

    def detect(self, image: np.ndarray) -> Detections:
        return _above(self._recorder.seen, self.threshold)


class EvaluatedPipeline:
    """A detector with what follows it. With ``recording`` it also gives every box down to a low score."""

    def __init__(
        self, settings: PipelineSettings, *, threads: int = 1, consecutive: bool = True, recording: bool = True
    ) -> None:
        """Pictures that are not ``consecutive`` are not tracked.

        Raises InstallationError or ParameterError when the detector cannot be made.
        """
        spec, floor, values = settings.spec, settings.floor, settings.values
        own = {each.name: values[each.name] for each in fields(DetectorSettings) if each.name != "threads"}
        detector = spec.make(DetectorSettings(threads=threads, **own))
        tall = values["person_height_m"]
        self._values = values
        self._all: PersonPipeline | None = None
        if recording:
            detector = RecordingDetector(detector, floor)
            self._all = PersonPipeline(_ReplayDetector(detector, floor), sure=floor, weak=floor, person_height_m=tall)
        self._finder = make_pipeline(
            spec,
            detector,
            tracker=values["tracker"] if consecutive else "none",
            threshold=settings.sure,
            bridge_s=values["bridge_s"],
            person_height_m=tall,
            hide_still=values["hide_still"],
        )

    def find(self, image: np.ndarray, stamp: int, info: CameraInfo | None = None) -> tuple[Persons, Persons]:
        """The people in ``image``, and every box that the detector saw (none without ``recording``).

        Raises MessageError for an uncalibrated camera.
        """
        camera = self._camera(info, image.shape[1], image.shape[0])
        persons = self._finder.find(image, stamp, camera)
        return persons, self._all.find(image, stamp, camera) if self._all is not None else ()

    def _camera(self, info: CameraInfo | None, width: int, height: int) -> CameraModel:
        """The camera of pictures of ``width`` x ``height`` pixels, as the node has it."""
        pose = {"mount_height_m": self._values["mount_height_m"], "pitch_rad": self._values["pitch_rad"]}
        if info is None:
            return CameraModel.from_field_of_view(width, height, self._values["hfov_rad"], **pose)
        camera = CameraModel.from_info(info, **pose)
        return camera if (camera.width, camera.height) == (width, height) else camera.scaled(width, height)


def _above(found: Detections, threshold: float) -> Detections:
    good = found.scores >= threshold
    return Detections(found.boxes[good], found.scores[good])


Told = Callable[[int], None]
"""Told of every frame that a job has done: how many so far."""


@dataclass(frozen=True)
class Job:
    """What to look through, with what; ``name`` is for people.

    ``frames`` is how many are expected. ``outermost`` has, by stamp, the x farthest to the right and the y farthest
    down at which a box of the truth begins: none may lie outside its picture.
    """

    name: str
    images: ImageSequence
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
    pipeline = EvaluatedPipeline(job.pipeline, threads=1, consecutive=job.images.consecutive)
    frames: list[FoundFrame] = []
    damaged, first = 0, ""
    for number, encoded in enumerate(job.images.read(), 1):
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
    (result,) = run_in_processes(_measure, [(tuple(jobs), threads)], 1)
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
    pipeline = EvaluatedPipeline(job.pipeline, threads=threads, consecutive=job.images.consecutive, recording=False)
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


def _stretch(job: Job, count: int) -> list[EncodedImage]:
    """``count`` pictures from the middle of the job's footage, read beforehand."""
    begin = max(0, (job.frames - count) // 2)
    return list(itertools.islice(job.images.read(), begin, begin + count))
