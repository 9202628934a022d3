"""An evaluation: detectors look through sources, and what they found is judged, scene by scene."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from socialbot.core.errors import ImageError, SocialbotError, TruthError
from socialbot.graph.node import Graph
from socialbot.vision.metrics.behaviour import Behaviour, behaviour
from socialbot.vision.metrics.frames import BagImages, LabelledFrame, LabelledSource
from socialbot.vision.metrics.matches import Match, Rules, judge
from socialbot.vision.metrics.pipeline import Found, FoundFrame, Job, PipelineSettings, Speed, measure, run_job
from socialbot.vision.metrics.scores import FrameMatches, SceneScore, score_scene
from socialbot.vision.metrics.workers import run_in_processes, run_on_dask

__all__ = [
    "ClipResult",
    "DetectorResult",
    "Evaluation",
    "ScoredImage",
    "EvaluationPlan",
    "SceneResult",
    "evaluate",
    "jobs_of",
    "scored",
    "scene_names",
]

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
    """A frame, what was found in it, and the verdicts."""

    frame: LabelledFrame
    found: FoundFrame
    matches: tuple[Match, ...]

    @property
    def errors(self) -> int:
        """False alarms and missed people."""
        return sum(verdict.kind in ("false", "missed") for verdict in self.matches)


@dataclass(frozen=True)
class ClipResult:
    """What became of one source: its frames, what Waldo did, and how many frames of the truth had no picture."""

    source: LabelledSource
    frames: tuple[ScoredImage, ...]
    behaviour: Behaviour | None
    missing_frames: int
    damaged: int
    first_damage: str


@dataclass(frozen=True)
class SceneResult:
    """The score of a scene, over all its clips."""

    score: SceneScore
    clips: tuple[ClipResult, ...]


@dataclass(frozen=True)
class DetectorResult:
    """How one pipeline did in each scene, and how fast it is."""

    pipeline: PipelineSettings
    scenes: Mapping[str, SceneResult]
    speed: Speed | None


@dataclass(frozen=True)
class Evaluation:
    """The results by the name of the detector."""

    plan: EvaluationPlan
    detectors: Mapping[str, DetectorResult]

    @property
    def scenes(self) -> tuple[str, ...]:
        """The names of the scenes in the order of the sources."""
        return tuple(dict.fromkeys(scene_names(self.plan.sources)))


def scene_names(sources: Sequence[LabelledSource]) -> list[str]:
    """The scene of each source; with the split where a scene has sources of several, which must not be mixed."""
    splits: dict[str, set[str]] = {}
    for source in sources:
        splits.setdefault(source.scene, set()).add(source.split)
    return [
        f"{source.scene} ({source.split or 'no split'})" if len(splits[source.scene]) > 1 else source.scene
        for source in sources
    ]


def evaluate(plan: EvaluationPlan, advance: Advance, say: Callable[[str], None]) -> Evaluation:
    """Carries out ``plan``. ``advance`` hears how many frames of each job are done, ``say`` what is going on.

    Raises SocialbotError for sources or detectors that cannot be used.
    """
    jobs = jobs_of(plan)
    count = len(plan.sources)
    speeds: list[Speed | None] = []
    for number, pipeline in enumerate(plan.pipelines):
        if plan.threads:
            say(f"measuring the speed of {pipeline.detector}")
            speeds.append(measure(jobs[number * count : number * count + min(count, SPEED_SOURCES)], plan.threads))
        else:
            speeds.append(None)
    say("looking for people")
    found = _run_jobs(jobs, plan, advance)
    say("judging")
    return scored(plan, found, speeds)


def _run_jobs(jobs: Sequence[Job], plan: EvaluationPlan, advance: Advance) -> list[Found]:
    def done(number: int, result: Found) -> None:
        advance(number, jobs[number].frames)

    def drain() -> None:
        while not progress.empty():
            advance(*progress.get())

    if plan.scheduler is not None:
        names = [job.name for job in jobs]
        return run_on_dask(_run_quietly, [(job,) for job in jobs], plan.scheduler, done=done, names=names)
    progress = multiprocessing.get_context("spawn").SimpleQueue()
    numbered = list(enumerate(jobs))
    return run_in_processes(
        _run_numbered, numbered, plan.processes, initializer=_set_progress, initargs=(progress,), done=done, poll=drain
    )


def _set_progress(queue: Any) -> None:
    global _progress
    _progress = queue


def _run_numbered(number: int, job: Job) -> Found:
    def told(done: int) -> None:
        if done % _PROGRESS_FRAMES == 0:
            _progress.put((number, done))

    return run_job(job, told)


def _run_quietly(job: Job) -> Found:
    return run_job(job, lambda done: None)


def jobs_of(plan: EvaluationPlan) -> list[Job]:
    """A job for each pipeline and source, all sources of the first pipeline first."""
    return [
        Job(
            name=f"{pipeline.detector}: {source.name}",
            images=source.images,
            pipeline=pipeline,
            frames=len(source.frames),
            outermost=_outermost(source),
        )
        for pipeline in plan.pipelines
        for source in plan.sources
    ]


def scored(plan: EvaluationPlan, found: Sequence[Found], speeds: Sequence[Speed | None]) -> Evaluation:
    """What is to be said of what all `jobs_of` have ``found``, in their order; a speed for each pipeline.

    Raises ImageError or TruthError for a source of which nothing can be judged.
    """
    count = len(plan.sources)
    return Evaluation(
        plan,
        {
            pipeline.detector: _detector_result(plan, pipeline, found[number * count : (number + 1) * count], speed)
            for number, (pipeline, speed) in enumerate(zip(plan.pipelines, speeds, strict=True))
        },
    )


def _outermost(source: LabelledSource) -> dict[int, tuple[float, float]]:
    outermost = {}
    for frame in source.frames:
        boxes = [*(person.box for person in frame.persons), *frame.ignore]
        if boxes:
            outermost[frame.stamp] = (max(x for x, _, _, _ in boxes), max(y for _, y, _, _ in boxes))
    return outermost


def _detector_result(
    plan: EvaluationPlan, pipeline: PipelineSettings, found: Sequence[Found], speed: Speed | None
) -> DetectorResult:
    clips: dict[str, list[ClipResult]] = {}
    for scene, source, result in zip(scene_names(plan.sources), plan.sources, found, strict=True):
        clips.setdefault(scene, []).append(_clip_result(plan, source, result))
    scenes = {scene: _scene_result(plan.rules, results) for scene, results in clips.items()}
    return DetectorResult(pipeline, scenes, speed)


def _clip_result(plan: EvaluationPlan, source: LabelledSource, found: Found) -> ClipResult:
    answers = {frame.stamp: frame for frame in found.frames}
    frames = []
    for frame in source.frames:
        answer = answers.get(frame.stamp)
        if answer is not None:
            # Some labels go on beyond the picture; detections cannot.
            inside = frame.clipped(answer.width, answer.height)
            frames.append(ScoredImage(inside, answer, judge(inside, answer.persons, plan.rules)))
    if source.frames and not frames:
        raise _nothing_judged(source, found)
    acted = None
    if plan.waldo is not None and isinstance(source.images, BagImages):
        acted = behaviour(plan.waldo, source.frames, found.frames)
    return ClipResult(source, tuple(frames), acted, len(source.frames) - len(frames), found.damaged, found.first_damage)


def _nothing_judged(source: LabelledSource, found: Found) -> SocialbotError:
    if not found.frames:
        return ImageError(
            f"none of its pictures can be read; the first: {found.first_damage or 'there are none'}",
            where=source.name,
            remedy="record or copy them again",
        )
    return TruthError(
        f"no picture has the stamp of a frame of its truth: the first picture has {found.frames[0].stamp}, the first "
        f"frame {source.frames[0].stamp}",
        where=source.name,
        remedy="give the truth the stamps of the pictures' headers, in ns",
    )


def _scene_result(rules: Rules, clips: Sequence[ClipResult]) -> SceneResult:
    scored: list[FrameMatches] = []
    raw: list[FrameMatches] = []
    for clip in clips:
        for each in clip.frames:
            block = (clip.source.name, each.frame.block)
            scored.append(FrameMatches(block, each.matches))
            raw.append(FrameMatches(block, judge(each.frame, each.found.raw, rules)))
    return SceneResult(score_scene(scored, raw, rules.keys), tuple(clips))
