"""Run the perception pipeline on the images of a source, record all boxes, and measure its speed."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np

from socialbot.core.errors import ImageError, ParameterError, TruthError, suggestion
from socialbot.core.messages import CompressedImage, Image, PersonDetection
from socialbot.graph.node import check_parameters
from socialbot.vision.camera import ASSUMED, CameraModel, CameraPose, calibrated_info, calibration_at
from socialbot.vision.camera_pose import PoseEstimator, load_pose, pose_beside
from socialbot.vision.depth import RangeImage, measure_people
from socialbot.vision.detector import Detections
from socialbot.vision.detectors import DETECTORS, DetectorSettings, DetectorSpec
from socialbot.vision.distance import Estimate
from socialbot.vision.metrics.frames import BagImages, EncodedImage, ImageSequence, LabelledFrame, LabelledSource
from socialbot.vision.metrics.workers import run_in_processes
from socialbot.vision.person_detector import PersonDetector
from socialbot.vision.pipeline import PersonPipeline

FLOOR_SHARE = 0.2  # Curves start at this share of the threshold.

_LEVEL = msgspec.structs.replace(ASSUMED, pitch_rad=0.0)

_NOT_SET = ("detector", "threads")  # These have options of their own.

Persons = tuple[PersonDetection, ...]


@dataclass(frozen=True)
class PipelineSettings:
    """Name of a detector in `DETECTORS`, and changed parameters of the node `PersonDetector`."""

    detector: str
    changes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def spec(self) -> DetectorSpec:
        """The registered detector. Raises ParameterError for an unknown name."""
        return DETECTORS[_known("detector", self.detector, DETECTORS, "--detector")]

    @property
    def values(self) -> dict[str, Any]:
        """All parameters of the node. Raises ParameterError for an invalid one."""
        return check_parameters(PersonDetector, {**self.changes, "detector": self.detector}, where="--set")

    @property
    def tracked(self) -> bool:
        """Whether a tracker is used."""
        return self.values["tracker"] != "none"

    @property
    def sure(self) -> float:
        """Score from which a detection counts alone."""
        threshold = self.values["threshold"]
        return self.spec.sure if threshold < 0 else threshold

    @property
    def floor(self) -> float:
        """Least score of the boxes for curves."""
        return min(self.spec.weak, FLOOR_SHARE * self.spec.sure, self.sure)


def with_changes(pipeline: PipelineSettings, changes: Sequence[str]) -> PipelineSettings:
    """Apply changes of the form NAME=VALUE, or DETECTOR.NAME=VALUE for that detector only.

    Raises:
        ParameterError: A change is malformed, or its name or value is unknown.
    """
    changed = dict(pipeline.changes)
    for change in changes:
        target, equals, text = change.partition("=")
        detector, dot, name = target.rpartition(".")
        if not equals:
            raise ParameterError(f"cannot read {change!r}", where="--set", remedy="write NAME=VALUE")
        if dot:
            _known("detector", detector, DETECTORS, "--set")
        value = _value(name, text)
        if not dot or detector == pipeline.detector:
            changed[name] = value
    return PipelineSettings(pipeline.detector, changed)


def _known(what: str, name: str, names: Collection[str], where: str) -> str:
    if name not in names:
        raise ParameterError(f"no {what} {name!r}", where=where, remedy=suggestion(name, names))
    return name


def _value(name: str, text: str) -> Any:
    declared = {key: each for key, each in PersonDetector.parameters().items() if key not in _NOT_SET}
    kind = type(declared[_known("setting", name, declared, "--set")].default)
    try:
        value = {"true": True, "false": False}.get(text.lower(), text) if kind is bool else kind(text)
    except ValueError as error:
        raise ParameterError(f"{text!r} is not of type {kind.__name__}", where=f"--set {name}") from error
    return declared[name].check(value, where=f"--set {name}")


class SourceCamera:
    """Camera and depth of the images of a source, as the node `PersonDetector` knows them with these settings.

    The pose of the camera is that of the settings, else of the pose file beside the bag, else of its transforms.
    """

    def __init__(self, settings: PipelineSettings, images: ImageSequence | None) -> None:
        self._values = settings.values
        beside = load_pose(pose_beside(Path(images.path))) if isinstance(images, BagImages) else None
        self._stated = self._values["mount_height_m"], self._values["pitch_rad"]
        self._pose = CameraPose.stated(*self._stated, beside)

        url, rectified = self._values["camera_info_url"], self._values["rectified"]
        self._info = calibration_at(url, where="--set camera_info_url", rectified=rectified)

    def at(self, encoded: EncodedImage, width: int, height: int) -> tuple[CameraModel, Sequence[RangeImage]]:
        """The camera, and the depth near the stamp, of an image of ``width`` x ``height`` pixels.

        Raises MessageError for invalid intrinsics.
        """
        hfov_rad, info = self._values["hfov_rad"], calibrated_info(encoded.info, self._info)
        camera = CameraModel.of_images(info, width, height, hfov_rad=hfov_rad, pose=self._pose)
        if encoded.sensors is None or not isinstance(encoded.content, (Image, CompressedImage)):
            return camera, ()
        sensors, frame_id = encoded.sensors, encoded.content.frame_id
        if self._pose.source == "assumed":
            known = sensors.camera_pose(frame_id, encoded.stamp)
            camera = camera if known is None else camera.at(CameraPose.stated(*self._stated, known))
        camera = replace(camera, yaw_rad=sensors.camera_yaw(frame_id, encoded.stamp))
        sensors.tolerance_s = self._values["depth_tolerance_s"]
        sensors.set_pose(self._values["depth_pose"])
        return camera, sensors.at(encoded.stamp, frame_id, camera)


class EvaluatedPipeline:
    """Perception pipeline that, with ``recording``, also returns all boxes down to a low score."""

    def __init__(
        self,
        settings: PipelineSettings,
        images: ImageSequence | None = None,
        *,
        threads: int = 1,
        recording: bool = True,
    ) -> None:
        """Build the pipeline for ``images``, which are not tracked if they are not consecutive.

        Raises:
            InstallationError: A package of the detector is missing.
            ParameterError: Its settings are invalid.
        """
        values = settings.values
        consecutive = images is None or images.consecutive
        self._camera = SourceCamera(settings, images)
        self._floor = settings.floor if recording else None
        own = {each.name: values[each.name] for each in fields(DetectorSettings) if each.name != "threads"}
        self._pipeline = PersonPipeline(
            settings.spec,
            settings.spec.make(DetectorSettings(threads=threads, **own)),
            tracker=values["tracker"] if consecutive else "none",
            threshold=settings.sure,
            bridge_s=None if values["bridge_s"] < 0 else values["bridge_s"],
            **{name: values[name] for name in ("remember_s", "person_height_m", "hide_still", "faces")},
        )

    def find(self, image: np.ndarray, encoded: EncodedImage) -> FoundFrame:
        """The people in ``image``, decoded from ``encoded``, and all boxes of the detector with ``recording``.

        Raises MessageError for an uncalibrated camera.
        """
        height, width = image.shape[:2]
        camera, depth = self._camera.at(encoded, width, height)
        raw: Persons = ()
        if self._floor is None:
            persons = self._pipeline.find(image, encoded.stamp, camera, depth)
        else:
            # With greedy suppression, boxes above the threshold do not depend on those below it.
            found = self._pipeline.detect(image, camera, self._floor)
            good = found.scores >= self._pipeline.threshold
            kept = Detections(found.boxes[good], found.scores[good])
            persons = self._pipeline.follow(kept, image, encoded.stamp, camera, depth)
            raw = self._pipeline.measured(found, camera)
        yaw_rad = camera.yaw_rad
        return FoundFrame(
            encoded.stamp, width, height, persons, raw, self._pipeline.searches_faces,
            yaw_rad, None if yaw_rad is None else camera.hfov_rad,
        )  # fmt: skip


def with_distances(source: LabelledSource, topic: str, settings: PipelineSettings) -> LabelledSource:
    """Fill the unknown distances of people from a topic of the bag with depth images or point clouds.

    They are horizontal, so the pitch of the camera counts: that of the settings, of the pose file, of the transforms,
    or else of the floor in the depth.

    Raises:
        BagError: The bag has no such topic.
        TruthError: ``source`` is no bag, or the depth shows none of the people.
    """
    where = f"{source.name}: --distance-from {topic}"
    if not isinstance(source.images, BagImages):
        raise TruthError("only bags have depth", where=where, remedy="name bags, or omit it")
    unknown = {frame.stamp: frame for frame in source.frames if any(each.distance_m is None for each in frame.persons)}
    eyes, floor = SourceCamera(settings, source.images), PoseEstimator(_LEVEL)
    filled: dict[int, LabelledFrame] = {}
    level = 0
    for encoded in replace(source.images, depth=topic).read():
        frame = unknown.get(encoded.stamp)
        if frame is None:
            continue
        try:
            height, width = encoded.bgr().shape[:2]
        except ImageError:
            continue
        camera, depth = eyes.at(encoded, width, height)
        if camera.pose.source == "assumed":
            if depth:
                floor.see_floor(depth[0].cloud(camera))
            camera = camera.at(floor.pose)
            level += not floor.floors
        people = frame.clipped(width, height).persons
        stated = [None if each.distance_m is None else Estimate(each.distance_m, 0.0) for each in people]
        found = measure_people(depth, camera, [each.box for each in people], stated)
        persons = tuple(
            person
            if person.distance_m is not None or each is None
            else msgspec.structs.replace(person, distance_m=each.estimate.value)
            for person, each in zip(frame.persons, found, strict=True)
        )
        filled[frame.stamp] = replace(frame, persons=persons, ranged=True)
    distances = [each.distance_m for frame in filled.values() for each in frame.persons]
    missing = distances.count(None)
    if unknown and missing == len(distances):
        remedy = "check that the depth topic is registered, or that /tf_static has the pose of its sensor"
        raise TruthError("it measures none of the labelled people", where=where, remedy=remedy)
    notes = [*source.notes]
    if missing:
        notes.append(f"{missing} of {len(distances)} distances stay unknown: {topic} does not measure these people")
    if level:
        notes.append(
            f"in {level} of {len(filled)} images the camera is taken as level for the distances on {topic}: "
            "calibrate it, or set mount_height_m and pitch_rad"
        )
    frames = tuple(filled.get(frame.stamp, frame) for frame in source.frames)
    return replace(source, frames=frames, notes=tuple(notes))


@dataclass(frozen=True)
class Job:
    """Work unit: a pipeline on the images of a source, of which ``frames`` are expected.

    Args:
        outermost: Largest x and y of the ground truth boxes by stamp, which must lie inside the image.
        sizes: Labelled width and height of images by stamp; an image of another size counts as damaged.
    """

    name: str
    images: ImageSequence
    pipeline: PipelineSettings
    frames: int
    outermost: dict[int, tuple[float, float]]
    sizes: dict[int, tuple[int, int]] = field(default_factory=dict)


@dataclass(frozen=True)
class FoundFrame:
    """Result for one image: people of the pipeline, and ``raw`` boxes of the detector down to a low score.

    ``faces`` tells whether faces are searched. The direction of the camera and its field of view are those of
    `PersonDetections`.
    """

    stamp: int
    width: int
    height: int
    persons: tuple[PersonDetection, ...]
    raw: tuple[PersonDetection, ...]
    faces: bool | None = None
    camera_yaw_rad: float | None = None
    camera_hfov_rad: float | None = None


@dataclass(frozen=True)
class Found:
    """Results of a job by frame; ``damaged`` images are skipped, the first for the reason given."""

    frames: tuple[FoundFrame, ...]
    damaged: int = 0
    first_damage: str = ""


def run_job(job: Job, advance: Callable[[int], None]) -> Found:
    """Run a job, and report the number of processed frames. Raises SocialbotError for unusable images or detectors."""
    # Jobs run in parallel, so one thread each is the fastest.
    cv2.setNumThreads(1)
    pipeline = EvaluatedPipeline(job.pipeline, job.images, threads=1)
    frames: list[FoundFrame] = []
    damaged, first = 0, ""
    for number, encoded in enumerate(job.images.read(), 1):
        labelled = job.sizes.get(encoded.stamp)
        try:
            image = encoded.bgr(labelled)
        except ImageError as error:
            damaged, first = damaged + 1, first or str(error)
            continue
        height, width = image.shape[:2]
        if labelled is not None and labelled != (width, height):
            what = f"has {width}x{height} pixels, but its labels are for {labelled[0]}x{labelled[1]}"
            error = ImageError(what, where=encoded.name, remedy="give the images that were labelled")
            damaged, first = damaged + 1, first or str(error)
            continue
        x, y = job.outermost.get(encoded.stamp, (0.0, 0.0))
        if x >= width or y >= height:
            raise TruthError(
                f"a box begins at {x:g}, {y:g}, outside the image of {width}x{height} pixels",
                where=encoded.name or f"{job.name}: frame {encoded.stamp}",
                remedy="check that the boxes belong to this image, in its original size",
            )
        frames.append(pipeline.find(image, encoded))
        advance(number)
    return Found(tuple(frames), damaged, first)


FRAMES = 80
WARM_UP = 5  # Not counted: caches are cold and the tracker is empty.


@dataclass(frozen=True)
class Speed:
    """Throughput with ``threads``, and median and 95th percentile of the time per image, ms.

    ``decode_ms`` is the median time for decoding.
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
    """Measure the speed on images from the middle of each job; None without readable images.

    Raises SocialbotError for unusable images or detectors.
    """
    (result,) = run_in_processes(_measure, [(tuple(jobs), threads)], 1)
    return result


def _measure(jobs: Sequence[Job], threads: int) -> Speed | None:
    times = np.vstack([np.empty((0, 2)), *(_times(job, threads, len(jobs)) for job in jobs)])
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


def _times(job: Job, threads: int, jobs: int) -> np.ndarray:
    """Seconds for decoding and for the rest, shape (n, 2), for images from the middle of ``job``, read in advance."""
    cv2.setNumThreads(threads)
    pipeline = EvaluatedPipeline(job.pipeline, job.images, threads=threads, recording=False)
    count = max(1, FRAMES // jobs) + WARM_UP
    begin = max(0, (job.frames - count) // 2)
    times: list[tuple[float, float]] = []
    for encoded in list(itertools.islice(job.images.read(), begin, begin + count)):
        begun = time.perf_counter()
        try:
            image = encoded.bgr()
        except ImageError:
            continue
        decoded = time.perf_counter()
        pipeline.find(image, encoded)
        times.append((decoded - begun, time.perf_counter() - decoded))
    return np.array(times[min(WARM_UP, len(times) // 2) :]).reshape(-1, 2)
