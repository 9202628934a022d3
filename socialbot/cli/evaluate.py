"""``socialbot evaluate``: score person detectors by distance, beside published results."""

from __future__ import annotations

import operator
import os
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.console import Console
from rich.markup import escape

from socialbot.cli._options import bar
from socialbot.core.errors import ParameterError

if TYPE_CHECKING:
    from socialbot.vision.metrics.evaluation import Evaluation
    from socialbot.vision.metrics.frames import LabelledSource
    from socialbot.vision.metrics.pipeline import PipelineSettings

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
PAGE_WIDTH = 150  # width of the tables if the output is not a terminal


def evaluate(
    bags: Annotated[list[Path] | None, typer.Argument(metavar="BAG", help="Bags with ground truth.")] = None,
    images: Annotated[Path | None, typer.Option(metavar="DIR", help="A folder of labelled images.")] = None,
    truth: Annotated[Path | None, typer.Option(metavar="FILE", help="Label file; default: DIR/persons.json.")] = None,
    detector: Annotated[
        list[str] | None, typer.Option(help="Detectors, repeated or separated by commas; default: all but onnx.")
    ] = None,
    bands: Annotated[str, typer.Option(help="Distance bands, m.")] = "0-2,2-10,10-20",
    split: Annotated[Literal["held-back", "tune"] | None, typer.Option(help="Only bags of this split.")] = None,
    iou: Annotated[float, typer.Option(min=0.05, max=0.95, help="Least overlap (IoU) of a match.")] = 0.5,
    presence: Annotated[bool, typer.Option("--presence", help="Match by presence in each frame and band.")] = False,
    raw: Annotated[bool, typer.Option("--raw", help="Evaluate the detector without tracking.")] = False,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="[DETECTOR.]NAME=VALUE", help="Change a detector parameter; repeatable."),
    ] = None,
    json: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the figures as JSON.")] = None,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a page with curves and frames.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write both, with Markdown tables and SVG.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Parallel processes; default: cores.")] = None,
    threads: Annotated[int, typer.Option(min=1, max=64, help="Threads of the speed measurement.")] = min(2, CORES),
    speed: Annotated[bool, typer.Option(help="Measure the frames per second.")] = True,
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS", help="Scheduler of a Dask cluster.")] = None,
) -> None:
    """Evaluate detectors: precision, recall and F1 by scene and distance, and Waldo's behaviour.

    The pipeline includes tracking, as on the robot. docs/evaluation.md explains every figure.
    """
    from socialbot.graph.files import load_graph
    from socialbot.runs.evaluation_page import page
    from socialbot.runs.evaluation_tables import show as show_tables
    from socialbot.runs.evaluation_tables import write_json, write_markdown
    from socialbot.vision.metrics.behaviour import single_node
    from socialbot.vision.metrics.evaluation import EvaluationPlan
    from socialbot.vision.metrics.evaluation import evaluate as carry_out
    from socialbot.vision.metrics.matches import Rules, parse_bands

    errors = Console(stderr=True, highlight=False)
    rules = Rules(parse_bands(bands), iou, presence)
    pipelines = _pipelines(detector or [], changes or [], raw=raw)
    sources = _sources(bags or [], images, truth, split, errors)
    waldo = single_node(load_graph("waldo"), "bdi_engine")
    plan = EvaluationPlan(sources, pipelines, rules, jobs or CORES, threads if speed else 0, scheduler, waldo=waldo)
    figures = [path for path in (json, out and out / "evaluation.json") if path is not None]
    pages = [path for path in (html, out and out / "index.html") if path is not None]
    documents = [out / "evaluation.md", out / "curves.svg"] if out is not None else []
    for path in (*figures, *pages, *documents):
        _expect_writable(path)
    totals = [len(source.frames) for _ in plan.pipelines for source in plan.sources]
    finished = [0] * len(totals)
    lock = threading.Lock()
    with bar("", "frames", sum(totals)) as show:

        def advance(job: int, frames: int) -> None:
            with lock:
                finished[job] = max(finished[job], min(frames, totals[job]))
                clips = sum(map(operator.eq, finished, totals))
                show(sum(finished), f"detecting people: {clips}/{len(totals)} clips")

        evaluation = carry_out(plan, advance, lambda phase: show(None, phase))
    _report_missing(evaluation, errors)
    console = Console(highlight=False)
    show_tables(evaluation, console if console.is_terminal else Console(highlight=False, width=PAGE_WIDTH))
    for path in figures:
        write_json(evaluation, path)
    if out is not None:
        write_markdown(evaluation, out)
    for path in pages:
        page(evaluation).write(path)
        console.print(f"\nThe page: {path}", soft_wrap=True, markup=False)


def _pipelines(detectors: list[str], changes: list[str], *, raw: bool) -> tuple[PipelineSettings, ...]:
    from socialbot.vision.detectors import DETECTORS
    from socialbot.vision.metrics.pipeline import PipelineSettings, with_changes

    names = [name.strip() for word in detectors for name in word.split(",")]
    names = names or [name for name in DETECTORS if name != "onnx"]
    pipelines = []
    for name in dict.fromkeys(names):
        plain = PipelineSettings(name)
        plain.spec  # noqa: B018 - raises for an unknown name
        pipeline = with_changes(plain, changes)
        pipelines.append(with_changes(pipeline, ["tracker=none"]) if raw else pipeline)
    return tuple(pipelines)


def _sources(
    bags: list[Path], images: Path | None, truth: Path | None, split: str | None, errors: Console
) -> tuple[LabelledSource, ...]:
    from socialbot.vision.metrics.frames import bag_source, image_sources

    if truth is not None and images is None:
        raise ParameterError("labels without images", where="--truth", remedy="name their folder with --images")
    if not bags and images is None:
        raise ParameterError("nothing to evaluate", where="evaluate", remedy="name bags, or use --images")
    known = [bag_source(path) for path in bags]
    sources = [source for source in known if split is None or source.split == split]
    for source in known:
        if source not in sources:
            errors.print(f"{source.name} is skipped: its split is {source.split or 'none'}", style="dim", markup=False)
    if images is not None:
        sources += image_sources(images, truth)
    names = [source.name for source in sources]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ParameterError(f"two sources have the name {twice}", where="evaluate", remedy="give each its own name")
    if not sources:
        raise ParameterError(f"no bag has the split {split}", where="--split", remedy="omit it, or name other bags")
    return tuple(sources)


def _expect_writable(path: Path) -> None:
    """Create the folder of ``path``. Raises ParameterError early if the file cannot be written."""
    there = path.exists() or path.is_symlink()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
        if not there:
            path.unlink()
    except OSError as error:
        raise ParameterError(
            f"cannot be written: {error.strerror}", where=str(path), remedy="choose another place for the results"
        ) from error


def _report_missing(evaluation: Evaluation, errors: Console) -> None:
    """Print the frames without scores, which are the same for every detector."""
    first = next(iter(evaluation.detectors.values()))
    for clip in (clip for scene in first.scenes.values() for clip in scene.clips):
        if clip.missing_frames or clip.damaged:
            what = f"{clip.source.name}: {clip.missing_frames} of {len(clip.source.frames)} frames have no image"
            damage = f"; {clip.damaged} images are damaged, the first: {clip.first_damage}" if clip.damaged else ""
            errors.print(f"[yellow]warning[/] {escape(what + damage)}", soft_wrap=True)
