"""Evaluate detectors on sources with ground truth, scene by scene."""

from __future__ import annotations

import functools
import multiprocessing
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from socialbot.core.errors import ImageError, TruthError
from socialbot.core.process import safe_path
from socialbot.graph.node import Graph
from socialbot.vision.metrics.behaviour import Behaviour, behaviour
from socialbot.vision.metrics.coco import CocoScore, coco_image, coco_score
from socialbot.vision.metrics.frames import BagImages, LabelledFrame, LabelledSource
from socialbot.vision.metrics.matches import Match, Rules, judge
from socialbot.vision.metrics.pipeline import Found, FoundFrame, Job, PipelineSettings, Speed, measure, run_job
from socialbot.vision.metrics.scores import FrameMatches, SceneScore, score_scene
from socialbot.vision.metrics.tracks import TrackingScore, tracked_frame, tracking_score
from socialbot.vision.metrics.workers import run_in_processes, run_on_dask

SPEED_SOURCES = 4
"""Number of sources, from the first, on which the speed is measured."""

Advance = Callable[[int, int], None]
"""Progress callback: the number of the job and how many frames it has done."""

_PROGRESS_FRAMES = 5
"""A worker process reports progress once per this many frames."""

_progress: Any = None
"""In a worker process: the queue for its progress."""


@dataclass(frozen=True)
class EvaluationPlan:
    """What to evaluate, and how.

    Args:
        sources: Frames with ground truth.
        pipelines: Detectors with their settings; each is evaluated on all sources.
        rules: How detections are matched with people.
        processes: Number of parallel processes on this machine.
        threads: Processor threads for the measurement of the speed; 0 skips it.
        scheduler: Address of a Dask scheduler whose cluster does the work instead.
        waldo: Graph of Waldo's node alone, to judge behaviour with; None skips that.
    """

    sources: tuple[LabelledSource, ...]
    pipelines: tuple[PipelineSettings, ...]
    rules: Rules = field(default_factory=Rules)
    processes: int = 1
    threads: int = 1
    scheduler: str | None = None
    waldo: Graph | None = None


@dataclass(frozen=True)
class ScoredImage:
    """Frame, detections and their matches."""

    frame: LabelledFrame
    found: FoundFrame
    matches: tuple[Match, ...]

    @property
    def errors(self) -> int:
        """Number of false positives and missed people."""
        return sum(match.kind in ("false", "missed") for match in self.matches)


@dataclass(frozen=True)
class ClipResult:
    """Result for one source; ``missing_frames`` have ground truth but no image.

    ``tracking`` is None for single images and for a pipeline without a tracker.
    """

    source: LabelledSource
    frames: tuple[ScoredImage, ...]
    behaviour: Behaviour | None
    missing_frames: int
    damaged: int
    first_damage: str
    tracking: TrackingScore | None = None

    @property
    def outside(self) -> int:
        """Number of labelled people who lie outside their image."""
        return sum(not (person.w > 0 and person.h > 0) for each in self.frames for person in each.frame.persons)


@dataclass(frozen=True)
class SceneResult:
    """Score of a scene over all its clips."""

    score: SceneScore
    clips: tuple[ClipResult, ...]
    coco: CocoScore

    @property
    def tracking(self) -> TrackingScore | None:
        """Tracking score of all clips; None if nothing was tracked."""
        scores = [clip.tracking for clip in self.clips if clip.tracking is not None]
        return functools.reduce(operator.add, scores) if scores else None


@dataclass(frozen=True)
class DetectorResult:
    """Results of one pipeline by scene, and its speed."""

    pipeline: PipelineSettings
    scenes: Mapping[str, SceneResult]
    speed: Speed | None


@dataclass(frozen=True)
class Evaluation:
    """Results by detector name."""

    plan: EvaluationPlan
    detectors: Mapping[str, DetectorResult]

    @property
    def scenes(self) -> tuple[str, ...]:
        """Names of the scenes in the order of the sources."""
        return tuple(dict.fromkeys(scene_names(self.plan.sources)))


def scene_names(sources: Sequence[LabelledSource]) -> list[str]:
    """Scene of each source, with the split if its sources have several, which must not be mixed."""
    splits: dict[str, set[str]] = {}
    for source in sources:
        splits.setdefault(source.scene, set()).add(source.split)
    return [
        f"{source.scene} ({source.split or 'no split'})" if len(splits[source.scene]) > 1 else source.scene
        for source in sources
    ]


def evaluate(plan: EvaluationPlan, advance: Advance, say: Callable[[str], None]) -> Evaluation:
    """Run an evaluation; ``say`` is called with a description of each phase.

    Raises:
        SocialbotError: A source or detector is unusable.
    """
    jobs = jobs_of(plan)
    count = len(plan.sources)
    speeds: list[Speed | None] = [None] * len(plan.pipelines)
    for number, pipeline in enumerate(plan.pipelines if plan.threads else ()):
        say(f"measuring the speed of {pipeline.detector}")
        speeds[number] = measure(jobs[number * count : (number + 1) * count][:SPEED_SOURCES], plan.threads)
    say("detecting people")
    found = _run_jobs(jobs, plan, advance)
    say("scoring")
    return scored(plan, found, speeds)


def _run_jobs(jobs: Sequence[Job], plan: EvaluationPlan, advance: Advance) -> list[Found]:
    def done(number: int, result: Found) -> None:
        advance(number, jobs[number].frames)

    def drain() -> None:
        while not progress.empty():
            advance(*progress.get())

    numbered = list(enumerate(jobs))
    if plan.scheduler is not None:
        return run_on_dask(_run, numbered, plan.scheduler, done=done, names=[job.name for job in jobs])
    with safe_path():
        progress = multiprocessing.get_context("spawn").SimpleQueue()
        return run_in_processes(
            _run, numbered, plan.processes, initializer=_set_progress, initargs=(progress,), done=done, poll=drain
        )


def _set_progress(queue: Any) -> None:
    global _progress
    _progress = queue


def _run(number: int, job: Job) -> Found:
    def advance(done: int) -> None:
        if _progress is not None and done % _PROGRESS_FRAMES == 0:
            _progress.put((number, done))

    return run_job(job, advance)


def jobs_of(plan: EvaluationPlan) -> list[Job]:
    """One job for each pipeline and source, ordered by pipeline."""
    return [
        Job(
            name=f"{pipeline.detector}: {source.name}",
            images=source.images,
            pipeline=pipeline,
            frames=len(source.frames),
            outermost=_outermost(source) if source.format == "socialbot" else {},
            sizes={frame.stamp: frame.size for frame in source.frames if frame.size is not None},
        )
        for pipeline in plan.pipelines
        for source in plan.sources
    ]


def scored(plan: EvaluationPlan, found: Sequence[Found], speeds: Sequence[Speed | None]) -> Evaluation:
    """Score what the jobs of `jobs_of` have ``found``, in their order; one speed for each pipeline.

    Raises:
        ImageError: A source has no readable image.
        TruthError: The stamps of its ground truth match no image.
    """
    count = len(plan.sources)
    detectors = {}
    for number, (pipeline, speed) in enumerate(zip(plan.pipelines, speeds, strict=True)):
        clips: dict[str, list[ClipResult]] = {}
        results = found[number * count : (number + 1) * count]
        for scene, source, result in zip(scene_names(plan.sources), plan.sources, results, strict=True):
            clips.setdefault(scene, []).append(_clip_result(plan, pipeline, source, result))
        scenes = {scene: _scene_result(plan.rules, each) for scene, each in clips.items()}
        detectors[pipeline.detector] = DetectorResult(pipeline, scenes, speed)
    return Evaluation(plan, detectors)


def _outermost(source: LabelledSource) -> dict[int, tuple[float, float]]:
    regions = {frame.stamp: (*frame.persons, *frame.ignore) for frame in source.frames}
    return {stamp: (max(r.x for r in there), max(r.y for r in there)) for stamp, there in regions.items() if there}


def _clip_result(plan: EvaluationPlan, pipeline: PipelineSettings, source: LabelledSource, found: Found) -> ClipResult:
    answers = {frame.stamp: frame for frame in found.frames}
    frames = []
    for frame in source.frames:
        answer = answers.get(frame.stamp)
        if answer is not None:
            # Labels may exceed the image; detections cannot.
            inside = frame.clipped(answer.width, answer.height)
            frames.append(ScoredImage(inside, answer, judge(inside, answer.persons, plan.rules)))
    if source.frames and not frames:
        if not found.frames:
            raise ImageError(
                f"none of its images can be read; the first: {found.first_damage or 'there are none'}",
                where=source.name,
                remedy="record or copy them again",
            )
        raise TruthError(
            f"no image has the stamp of a frame of its ground truth: the first image has {found.frames[0].stamp}, "
            f"the first frame {source.frames[0].stamp}",
            where=source.name,
            remedy="use the stamps of the image headers, in ns",
        )
    acted = None
    if plan.waldo is not None and isinstance(source.images, BagImages):
        acted = behaviour(plan.waldo, source.frames, found.frames)
    tracking = None
    if pipeline.tracked and source.images.consecutive and source.identities:
        tracking = tracking_score(
            # As labelled: other tools do not clip boxes to the image.
            tracked_frame(frame, answers[frame.stamp].persons, source.least_visible)
            for frame in source.frames
            if frame.stamp in answers
        )
    missing = len(source.frames) - len(frames)
    return ClipResult(source, tuple(frames), acted, missing, found.damaged, found.first_damage, tracking)


def _scene_result(rules: Rules, clips: Sequence[ClipResult]) -> SceneResult:
    frames = [((clip.source.name, each.frame.block), each) for clip in clips for each in clip.frames]
    scored = [FrameMatches(block, each.matches) for block, each in frames]
    raw = [FrameMatches(block, judge(each.frame, each.found.raw, rules)) for block, each in frames]
    return SceneResult(score_scene(scored, raw, rules.keys), tuple(clips), _coco_score(clips))


def _coco_score(clips: Sequence[ClipResult]) -> CocoScore:
    """Score of the detector alone, with the boxes as labelled."""
    images = []
    for clip in clips:
        labelled = {frame.stamp: frame for frame in clip.source.frames}
        for each in clip.frames:
            frame = labelled[each.frame.stamp]
            # pycocotools takes the images in the order of their ids.
            rank = frame.number if clip.source.format == "coco" and isinstance(frame.number, int) else 0
            images.append((rank, coco_image(frame, each.found.raw, clip.source.least_visible)))
    return coco_score(image for _, image in sorted(images, key=lambda each: each[0]))
