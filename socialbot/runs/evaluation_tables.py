"""Tables of an evaluation: one source of rows for the terminal, Markdown and the page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from socialbot.core.errors import SocialbotError
from socialbot.runs.evaluation_figures import (
    CONFIDENCE,
    all_causes,
    colours,
    counted_unit,
    curve_charts,
    metres,
    paper_rows,
    paper_score,
    rate,
    scene_columns,
    shown_bands,
    shown_in_scene,
    tracking_text,
)
from socialbot.runs.pages import Cells, render
from socialbot.vision.metrics.behaviour import OUTCOMES
from socialbot.vision.metrics.evaluation import ClipResult, Evaluation
from socialbot.vision.metrics.matches import CAUSES
from socialbot.vision.metrics.scores import BandScore, Interval, Score

BEST = "best"


@dataclass(frozen=True)
class ScoreTable:
    """Table with a title; the first ``left`` columns hold text, the others numbers.

    ``groups`` are headings above the columns, each with its column count.
    """

    title: str
    heads: tuple[str, ...]
    rows: Sequence[Cells]
    left: int = 1
    groups: tuple[tuple[str, int], ...] = ()

    @property
    def right(self) -> list[int]:
        """Numbers of the right-aligned columns."""
        return list(range(self.left, len(self.heads)))


def detector_table(evaluation: Evaluation, name: str, *, intervals: bool) -> ScoreTable:
    """Scores of a detector by scene and band, with the intervals of all rates or of F1 only."""
    result = evaluation.detectors[name]
    speed = f", {result.speed}" if result.speed is not None and not intervals else ""
    rows = []
    for scene, scored in result.scenes.items():
        for band, score in [*shown_bands(scored), ("all", scored.score.overall)]:
            counts = score.score
            cells = [_text(scene), _text(metres(band))]
            cells += [_number(value) for value in (counts.tp + counts.fn, counts.tp, counts.fp, counts.fn)]
            if intervals:
                cells += [(with_interval(score, key), "r") for key in ("precision", "recall", "f1", "ap")]
            else:
                cells += [_number(rate(counts.precision)), _number(rate(counts.recall)), (rate(counts.f1), BEST)]
                cells += [_number(interval_text(score.intervals.get("f1"))), _number(rate(score.ap))]
            rows.append(cells)
    rates = ("precision", "recall", "F1", *(() if intervals else (CONFIDENCE,)), "AP")
    heads = ("scene", "distance", counted_unit(evaluation), "found", "false", "missed", *rates)
    return ScoreTable(f"{name} {tracking_text(evaluation, result)}{speed}", heads, _without_repeats(rows), left=2)


def summary_table(evaluation: Evaluation) -> ScoreTable:
    """F1 with its interval by scene and band, a column for each detector and for the paper."""
    rows = []
    for scene in evaluation.scenes:
        results = {name: result.scenes[scene].score for name, result in evaluation.detectors.items()}
        for band in [*shown_in_scene(evaluation, scene), "all"]:
            scores = [score.overall if band == "all" else score.bands[band] for score in results.values()]
            best = max((each.score.f1 for each in scores if each.score.f1 is not None), default=None)
            people = max(each.score.tp + each.score.fn for each in scores)
            cells = [_text(scene), _text(metres(band)), _number(people)]
            cells += [
                (with_interval(each, "f1"), BEST if each.score.f1 == best is not None else "r") for each in scores
            ]
            paper = paper_score(evaluation, scene, band)
            rows.append([*cells, _number(rate(paper.f1) if paper else "")])
    heads = ("scene", "distance", counted_unit(evaluation), *evaluation.detectors, "paper")
    return ScoreTable("F1 by distance", heads, _without_repeats(rows), left=2)


def paper_tables(evaluation: Evaluation) -> list[ScoreTable]:
    """The scores in the form of the paper's Tables 2 and 3, together with those of the paper."""

    def build(title: str, names: tuple[str, ...], cells: Callable[[Score], Sequence[object]]) -> ScoreTable:
        rows = []
        for band, name, scores in paper_rows(evaluation):
            values = [cells(scores[scene]) if scene in scores else [""] * len(names) for scene in scenes]
            rows.append([_text(metres(band)), _text(name), *(_number(value) for each in values for value in each)])
        heads = ("distance", "", *(f"{scene} {name}" for scene in scenes for name in names))
        return ScoreTable(title, heads, _without_repeats(rows), left=2)

    scenes = scene_columns(evaluation)
    return [
        build(
            "Beside the paper's Table 2: true positives, false positives, false negatives",
            ("TP", "FP", "FN"),
            lambda score: (score.tp, score.fp, score.fn),
        ),
        build(
            "Beside the paper's Table 3: precision, recall, F1",
            ("P", "R", "F1"),
            lambda score: (rate(score.precision), rate(score.recall), rate(score.f1)),
        ),
    ]


def causes_table(evaluation: Evaluation, *, explained: bool = False) -> ScoreTable:
    """False positives by cause; ``explained`` adds the meaning of each cause."""
    columns, causes = all_causes(evaluation)
    rows = []
    for cause in causes:
        cells = [_text(cause), *(_number(counts[cause]) for _, _, counts in columns)]
        rows.append([*cells, _text(CAUSES.get(cause, "an object of this kind is there"))] if explained else cells)
    heads = ("cause", *(f"{name}, {scene}" for name, scene, _ in columns), *(("meaning",) if explained else ()))
    return ScoreTable("False positives by cause", heads, rows)


def behaviour_clips(evaluation: Evaluation) -> Iterator[tuple[str, ClipResult]]:
    """Detector name and clip of each clip whose behaviour was evaluated."""
    for name, result in evaluation.detectors.items():
        for scene in result.scenes.values():
            yield from ((name, clip) for clip in scene.clips if clip.behaviour is not None)


def behaviour_table(evaluation: Evaluation) -> ScoreTable:
    """Outcomes of greetings and offers of help by detector and clip."""
    rows = []
    for name, clip in behaviour_clips(evaluation):
        assert clip.behaviour is not None
        counts = [count for deed in OUTCOMES for count in clip.behaviour.count(deed).values()]
        rows.append([_text(name), _text(clip.source.name), *map(_number, counts)])
    groups = (("", 2), *((f"{deed}s", len(outcomes)) for deed, outcomes in OUTCOMES.items()))
    heads = ("detector", "clip", *(outcome for outcomes in OUTCOMES.values() for outcome in outcomes))
    return ScoreTable("What Waldo does with it", heads, rows, left=2, groups=groups)


def interval_text(interval: Interval | None) -> str:
    """An interval as text; empty for None."""
    return "" if interval is None else f"{interval[0]:.2f}-{interval[1]:.2f}"


def with_interval(score: BandScore, key: str) -> str:
    """The rate called ``key`` ("precision", "recall", "f1" or "ap") with its interval in parentheses."""
    value = score.ap if key == "ap" else getattr(score.score, key)
    interval = score.intervals.get(key)
    return rate(value) if interval is None else f"{rate(value)} ({interval_text(interval)})"


def _text(text: str) -> tuple[str, str]:
    return text, ""


def _number(value: object) -> tuple[str, str]:
    return str(value), "r"


def _without_repeats(rows: Sequence[list[tuple[str, str]]]) -> list[list[tuple[str, str]]]:
    return [
        [("", ""), *row[1:]] if number and rows[number - 1][0] == row[0] else row for number, row in enumerate(rows)
    ]


def show(evaluation: Evaluation, console: Console) -> None:
    """Print all tables that have rows to a terminal."""
    tables = [
        *(detector_table(evaluation, name, intervals=False) for name in evaluation.detectors),
        *paper_tables(evaluation),
        causes_table(evaluation),
        behaviour_table(evaluation),
    ]
    for table in tables:
        if table.rows:
            # A Table would wrap its title at its own width.
            console.print(table.title, soft_wrap=True, markup=False, style="bold")
            console.print(_rich(table))
            console.print()


def _rich(table: ScoreTable) -> Table:
    shown = Table(box=None, pad_edge=False, header_style="dim")
    above = [word for group, count in table.groups for word in (group, *[""] * (count - 1))]
    for number, head in enumerate(table.heads):
        heading = f"{above[number]}\n{head}" if above and number >= table.left else head.replace(", ", "\n")
        shown.add_column(escape(heading), justify="left" if number < table.left else "right", no_wrap=True)
    for row in table.rows:
        shown.add_row(*(f"[bold]{escape(text)}[/]" if kind == BEST else escape(text) for text, kind in row))
    return shown


def markdown(evaluation: Evaluation) -> str:
    """The tables and speeds as Markdown."""
    tables = paper_tables(evaluation) if paper_rows(evaluation) else []
    tables += [detector_table(evaluation, name, intervals=True) for name in evaluation.detectors]
    tables += [] if evaluation.plan.rules.presence else [causes_table(evaluation)]
    behaviour = behaviour_table(evaluation)
    tables += [behaviour] if behaviour.rows else []
    parts = [part for table in tables for part in (f"**{table.title}**", _markdown(table))]
    speeds = [f"- {name}: {result.speed}" for name, result in evaluation.detectors.items() if result.speed is not None]
    return "\n\n".join([*parts, *(["\n".join(speeds)] if speeds else [])]) + "\n"


def _markdown(table: ScoreTable) -> str:
    if not table.rows:
        return "None."
    above = [group for group, count in table.groups for _ in range(count)] or [""] * len(table.heads)
    heads = [f"{group} {head}".strip() for group, head in zip(above, table.heads, strict=True)]
    rows = [heads, ["---"] * len(heads), *([text for text, _ in row] for row in table.rows)]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows)


def write_markdown(evaluation: Evaluation, folder: Path) -> None:
    """Write evaluation.md and curves.svg into ``folder``.

    Raises:
        SocialbotError: A file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "evaluation.md").write_text(markdown(evaluation), "utf-8")
        charts = curve_charts(evaluation)
        if charts:
            columns = len(charts) // len(evaluation.scenes)
            drawing = render("curves.svg", charts=charts, columns=columns, colours=colours(evaluation))
            (folder / "curves.svg").write_text(drawing, "utf-8")
    except OSError as error:
        raise SocialbotError(f"cannot be written: {error.strerror}", where=str(folder)) from error
