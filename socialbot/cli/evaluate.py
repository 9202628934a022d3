"""``socialbot evaluate``: score person detectors by distance, beside published results."""

from __future__ import annotations

import operator
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.markup import escape

from socialbot.cli._console import Console
from socialbot.cli._options import CORES, bar, expect_effect
from socialbot.core.errors import ParameterError
from socialbot.core.paths import writing

if TYPE_CHECKING:
    from socialbot.vision.metrics.evaluation import Evaluation
    from socialbot.vision.metrics.frames import LabelledSource
    from socialbot.vision.metrics.pipeline import PipelineSettings

PANEL = "Bags, cameras and scores"
EXAMPLES = (
    "socialbot evaluate data/synthetic/scene1_heldback --detector nanodet,hog",
    "socialbot evaluate labels.json --format coco",
)
PAGE_WIDTH = 150  # width of the tables if the output is not a terminal


def evaluate(
    context: typer.Context,
    bags: Annotated[
        list[Path] | None, typer.Argument(metavar="BAG", help="Bags with ground truth, or labelled data sets.")
    ] = None,
    images: Annotated[Path | None, typer.Option(metavar="DIR", help="A folder of labelled images, or a video.")] = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Ground truth of the images; default: found in DIR.")
    ] = None,
    format: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Format of the labels: socialbot, coco, mot, kitti, yolo, voc, cvat, or module:NAME of your own.",
        ),
    ] = None,
    people: Annotated[
        list[str] | None, typer.Option(metavar="CLASS", help="Further class names of people; repeatable.")
    ] = None,
    distance_from: Annotated[
        str | None, typer.Option(metavar="TOPIC", help="Fill unknown distances from depth or points in the bags.")
    ] = None,
    detector: Annotated[
        list[str] | None, typer.Option(help="Detectors, repeated or separated by commas; default: all but onnx.")
    ] = None,
    bands: Annotated[str, typer.Option(help="Distance bands, m.")] = "0-2,2-10,10-20",
    split: Annotated[Literal["held-back", "tune"] | None, typer.Option(help="Only bags of this split.")] = None,
    iou: Annotated[float, typer.Option(min=0.05, max=0.95, help="Least overlap (IoU) of a match.")] = 0.5,
    presence: Annotated[bool, typer.Option("--presence", help="Match by presence in each frame and band.")] = False,
    tracking: Annotated[bool, typer.Option(help="Evaluate detectors with tracking, as on the robot, or alone.")] = True,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="[DETECTOR.]NAME=VALUE", help="Change a parameter of a detector; repeatable."),
    ] = None,
    figures: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the figures as JSON.")] = None,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a page with curves and frames.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for both, with Markdown tables and SVG.")
    ] = None,
    exports: Annotated[
        list[str] | None,
        typer.Option("--export", metavar="coco=FILE|mot=DIR", help="Write the detections for other tools; repeatable."),
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Parallel processes; default: cores.")] = None,
    threads: Annotated[int, typer.Option(min=1, max=64, help="Threads of the speed measurement.")] = min(2, CORES),
    speed: Annotated[bool, typer.Option(help="Measure the frames per second.")] = True,
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS", help="Scheduler of a Dask cluster.")] = None,
) -> None:
    """Evaluate detectors: precision, recall and F1 by scene and distance, and Waldo's behaviour.

    The pipeline includes tracking, as on the robot. docs/evaluation.md explains every figure.
    """
    from socialbot.graph.files import load_graph
    from socialbot.runs.evaluation_json import write_json
    from socialbot.runs.evaluation_page import page
    from socialbot.runs.evaluation_tables import show as show_tables
    from socialbot.runs.evaluation_tables import write_markdown
    from socialbot.vision.metrics.behaviour import single_node
    from socialbot.vision.metrics.evaluation import EvaluationPlan
    from socialbot.vision.metrics.evaluation import evaluate as carry_out
    from socialbot.vision.metrics.exports import export
    from socialbot.vision.metrics.matches import Rules, parse_bands
    from socialbot.vision.metrics.pipeline import with_distances

    if not speed:
        expect_effect(context, ("threads",), "with --no-speed")
    if scheduler is not None:
        expect_effect(context, ("jobs",), "with --scheduler")
    if images is None and not format and all(map(_is_bag, bags or [])):
        expect_effect(context, ("people",), "for bags, which label people only")
    errors = Console(stderr=True)
    rules = Rules(parse_bands(bands), iou, presence)
    pipelines = _pipelines(detector or [], changes or [], tracking=tracking)
    exported = _exports(exports or [])
    sources = _sources(_labelled(bags or [], images, truth, format, people or [], pipelines[0].values), split, errors)
    if distance_from is not None:
        sources = tuple(with_distances(source, distance_from, pipelines[0]) for source in sources)
    for source in sources:
        for note in source.notes:
            errors.print_plain(f"{source.name}: {note}", style="dim")
    waldo = single_node(load_graph("waldo"), "bdi_engine")
    plan = EvaluationPlan(sources, pipelines, rules, jobs or CORES, threads if speed else 0, scheduler, waldo=waldo)
    figure_files = [path for path in (figures, out and out / "evaluation.json") if path is not None]
    pages = [path for path in (html, out and out / "index.html") if path is not None]
    documents = [out / "evaluation.md", out / "curves.svg"] if out is not None else []
    for path in (*figure_files, *pages, *documents, *(path for name, path in exported if name == "coco")):
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
    console = Console()
    show_tables(evaluation, console if console.is_terminal else Console(width=PAGE_WIDTH))
    for path in figure_files:
        write_json(evaluation, path)
    if out is not None:
        write_markdown(evaluation, out)
    for name, path in exported:
        for written in export(evaluation, name, path):
            console.print_plain(f"The detections: {written}")
    for path in pages:
        page(evaluation).write(path)
        console.print_plain(f"\nThe page: {path}")


def _pipelines(detectors: list[str], changes: list[str], *, tracking: bool) -> tuple[PipelineSettings, ...]:
    from socialbot.vision.detectors import DETECTORS
    from socialbot.vision.metrics.pipeline import PipelineSettings, with_changes

    names = [name.strip() for word in detectors for name in word.split(",")]
    names = names or [name for name in DETECTORS if name != "onnx"]
    pipelines = []
    for name in dict.fromkeys(names):
        plain = PipelineSettings(name)
        plain.spec  # noqa: B018 - raises for an unknown name
        pipeline = with_changes(plain, changes)
        pipelines.append(pipeline if tracking else with_changes(pipeline, ["tracker=none"]))
    return tuple(pipelines)


def _exports(texts: list[str]) -> list[tuple[str, Path]]:
    from socialbot.vision.metrics.exports import EXPORTS

    split = [text.partition("=") for text in texts]
    for text, (name, _, path) in zip(texts, split, strict=True):
        if name not in EXPORTS or not path:
            raise ParameterError(f"cannot read {text!r}", where="--export", remedy="write coco=FILE or mot=DIR")
    return [(name, Path(path)) for name, _, path in split]


def _labelled(
    paths: list[Path],
    images: Path | None,
    truth: Path | None,
    format: str | None,
    people: list[str],
    settings: Mapping[str, Any],
) -> list[LabelledSource]:
    """Open the bags and data sets ``paths``, and the labelled ``images``; ``settings`` are those of the detector."""
    from socialbot.vision.metrics.formats import labelled_sources
    from socialbot.vision.metrics.frames import bag_source, with_own_names

    if truth is not None and images is None and len(paths) != 1:
        remedy = "name one bag, or the folder of the images with --images"
        raise ParameterError("labels without images", where="--truth", remedy=remedy)
    if not paths and images is None:
        raise ParameterError("nothing to evaluate", where="evaluate", remedy="name bags, or use --images")
    sources = []
    for path in paths:
        if path.exists() and (format or not _is_bag(path)):
            found = labelled_sources(path, truth if images is None else None, format, people)
        else:
            given = {"hfov_rad": settings["hfov_rad"], "calibrated": bool(settings["camera_info_url"])}
            found = [bag_source(path, truth if images is None else None, **given)]
        sources += [(path, source) for source in found]
    if images is not None:
        sources += [(images, source) for source in labelled_sources(images, truth, format, people)]
    return with_own_names(sources)


def _is_bag(path: Path) -> bool:
    files = [path] if path.is_file() else [*path.glob("metadata.yaml"), *path.glob("*.mcap"), *path.glob("*.db3")]
    return any(each.name == "metadata.yaml" or each.suffix in (".mcap", ".db3", ".bag") for each in files)


def _sources(known: list[LabelledSource], split: str | None, errors: Console) -> tuple[LabelledSource, ...]:
    """The sources to evaluate; prints what is left out."""
    from socialbot.vision.metrics.frames import BagImages

    sources = [
        source for source in known if split is None or source.split == split or not isinstance(source.images, BagImages)
    ]
    for source in known:
        if source not in sources:
            errors.print(f"{source.name} is skipped: its split is {source.split or 'none'}", style="dim", markup=False)
    names = [source.name for source in sources]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ParameterError(f"{twice} is given twice", where="evaluate", remedy="name it once")
    if not sources:
        raise ParameterError(f"no bag has the split {split}", where="--split", remedy="omit it, or name other bags")
    return tuple(sources)


def _expect_writable(path: Path) -> None:
    """Create the folder of ``path``. Raises ParameterError early if the file cannot be written."""
    there = path.exists() or path.is_symlink()
    with writing(path, ParameterError, remedy="choose another place for the results"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
        if not there:
            path.unlink()


def _report_missing(evaluation: Evaluation, errors: Console) -> None:
    """Print the frames without scores, which are the same for every detector."""
    first = next(iter(evaluation.detectors.values()))
    for clip in (clip for scene in first.scenes.values() for clip in scene.clips):
        if clip.outside:
            errors.print(
                f"{clip.source.name}: {clip.outside} people outside the image are not scored", style="dim", markup=False
            )
        if clip.missing_frames or clip.damaged:
            what = f"{clip.source.name}: {clip.missing_frames} of {len(clip.source.frames)} frames have no image"
            damage = f"; {clip.damaged} images are damaged, the first: {clip.first_damage}" if clip.damaged else ""
            errors.print(f"[yellow]warning[/] {escape(what + damage)}", soft_wrap=True)
