"""Tables and curves of an evaluation, for the terminal, Markdown and the page, beside those of the paper."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from rich.console import Console

from socialbot.runs.pages import Cell, Table, rate, render, write_file
from socialbot.vision.metrics.behaviour import OUTCOMES
from socialbot.vision.metrics.evaluation import ClipResult, DetectorResult, Evaluation, SceneResult
from socialbot.vision.metrics.matches import CAUSES, UNKNOWN
from socialbot.vision.metrics.scores import COVERAGE, BandScore, Interval, PrecisionRecallCurve, Score

COLOURS = ("#0b7fb0", "#c06a10", "#4f8a2a", "#a558a0", "#8a7015")
"""Colours of the detectors in their order, for light and dark backgrounds."""

CURVE_POINTS = 200
CONFIDENCE = f"{100 * COVERAGE:g} %"
Point = tuple[float, float]
"""Recall and precision."""

SCENES = ("Scene 1", "Scene 2")

PAPER: Mapping[str, Mapping[str, Score]] = MappingProxyType(
    {
        "Scene 1": {"0-2": Score(tp=253, fp=160, fn=187), "2-10": Score(tp=401, fp=87, fn=112)},
        "Scene 2": {"0-2": Score(tp=175, fp=160, fn=265), "2-10": Score(tp=354, fp=114, fn=132)},
    }
)
"""The paper's Table 2 by scene and band; its Table 3 follows from it."""


def paper_scene(name: str) -> str | None:
    """The paper's scene for a scene called ``name``: "Scene 1" for "scene1"; None for others."""
    found = re.match(r"scene[\W_]*([12])(?!\d)", name.lower())
    return f"Scene {found[1]}" if found else None


RATES = ("precision", "recall", "f1")


def metres(band: str) -> str:
    """A band as text: "2-10 m"."""
    return f"{band} m" if "-" in band else band


def scene_columns(evaluation: Evaluation) -> dict[str, str]:
    """Each scene with its name in the comparison with the paper: that of the paper if only one scene has it."""
    papers = {scene: paper_scene(scene) for scene in evaluation.scenes}
    count = Counter(papers.values())
    return {scene: paper if paper is not None and count[paper] == 1 else scene for scene, paper in papers.items()}


def shown_bands(evaluation: Evaluation, scenes: Sequence[SceneResult]) -> list[str]:
    """The bands that are shown for any of ``scenes``: the configured ones, and others that have counts.

    None without any known distance.
    """
    if not any(
        _has_counts(score.score) for scene in scenes for band, score in scene.score.bands.items() if band != UNKNOWN
    ):
        return []
    shown = {
        band for scene in scenes for band, score in scene.score.bands.items() if "-" in band or _has_counts(score.score)
    }
    return [band for band in evaluation.plan.rules.keys if band in shown]


def _has_counts(score: Score) -> bool:
    return bool(score.tp or score.fp or score.fn)


def tracking_text(evaluation: Evaluation, result: DetectorResult) -> str:
    """Whether the results include tracking, as text."""
    consecutive = {source.images.consecutive for source in evaluation.plan.sources}
    if not result.pipeline.tracked or True not in consecutive:
        return "without tracking"
    return "with tracking" if False not in consecutive else "with tracking (single images without)"


def colours(evaluation: Evaluation) -> list[tuple[str, str]]:
    """Name and colour of each detector."""
    return [(name, COLOURS[number % len(COLOURS)]) for number, name in enumerate(evaluation.detectors)]


def paper_score(evaluation: Evaluation, scene: str, band: str) -> Score | None:
    """The score of the paper for a scene and band; None if it has none."""
    if evaluation.plan.rules.presence:
        return None
    return PAPER.get(paper_scene(scene) or "", {}).get(band)


# Tables


def detector_table(evaluation: Evaluation, name: str, *, intervals: bool) -> Table:
    """Scores of a detector by scene and band, with the intervals of all rates or of F1 only."""
    result = evaluation.detectors[name]
    speed = f", {result.speed}" if result.speed is not None and not intervals else ""
    rows = []
    for scene, scored in result.scenes.items():
        for band in [*shown_bands(evaluation, [scored]), "all"]:
            score = scored.score.overall if band == "all" else scored.score.bands[band]
            counts = score.score
            row: list[Cell] = [scene, metres(band), counts.tp + counts.fn, counts.tp, counts.fp, counts.fn]
            if intervals:
                row += [(with_interval(score, key), "r") for key in (*RATES, "ap")]
            else:
                row += [(rate(counts.precision), "r"), (rate(counts.recall), "r"), (rate(counts.f1), "best")]
                row += [(interval_text(score.intervals.get("f1")), "r"), (rate(score.ap), "r")]
            rows.append(row)
    rates = ("precision", "recall", "F1", *(() if intervals else (CONFIDENCE,)), "AP")
    heads = ("scene", "distance", _unit(evaluation), "found", "false", "missed", *rates)
    return Table(heads, _without_repeats(rows), f"{name} {tracking_text(evaluation, result)}{speed}")


def summary_table(evaluation: Evaluation) -> Table:
    """F1 with its interval by scene and band, a column for each detector and for the paper."""
    rows = []
    for scene in evaluation.scenes:
        results = [result.scenes[scene] for result in evaluation.detectors.values()]
        for band in [*shown_bands(evaluation, results), "all"]:
            scores = [each.score.overall if band == "all" else each.score.bands[band] for each in results]
            best = max((each.score.f1 for each in scores if each.score.f1 is not None), default=None)
            row: list[Cell] = [scene, metres(band), max(each.score.tp + each.score.fn for each in scores)]
            row += [
                (with_interval(each, "f1"), "best" if each.score.f1 == best is not None else "r") for each in scores
            ]
            paper = paper_score(evaluation, scene, band)
            rows.append([*row, (rate(paper.f1) if paper else "", "r")])
    heads = ("scene", "distance", _unit(evaluation), *evaluation.detectors, "paper")
    return Table(heads, _without_repeats(rows), "F1 by distance")


def paper_tables(evaluation: Evaluation) -> list[Table]:
    """The scores in the form of the paper's Tables 2 and 3, together with those of the paper.

    Only scenes that stand for one of the paper are compared. Empty without such a scene, when matching by presence,
    which the paper does not use, and without any known distance.
    """
    columns = {scene: name for scene, name in scene_columns(evaluation).items() if paper_scene(scene)}
    scenes_of = [result.scenes[scene] for result in evaluation.detectors.values() for scene in columns]
    if not shown_bands(evaluation, scenes_of):
        return []
    scenes = list(dict.fromkeys([*SCENES, *columns.values()]))
    found: list[tuple[str, str, Mapping[str, Score]]] = []
    for band in () if evaluation.plan.rules.presence else evaluation.plan.rules.keys:
        paper = {scene: scores[band] for scene, scores in PAPER.items() if band in scores}
        found += [(band, "paper", paper)] if paper else []
        for name, result in evaluation.detectors.items():
            scores = {name: result.scenes[scene].score.bands[band].score for scene, name in columns.items()}
            found += [(band, name, scores)] if any(map(_has_counts, scores.values())) else []

    def build(title: str, names: tuple[str, ...], cells: Callable[[Score], Sequence[object]]) -> Table:
        rows = []
        for band, name, scores in found:
            values = [value for scene in scenes for value in (cells(scores[scene]) if scene in scores else ("",) * 3)]
            rows.append([metres(band), name, *((str(value), "r") for value in values)])
        heads = ("distance", "", *(f"{scene} {name}" for scene in scenes for name in names))
        return Table(heads, _without_repeats(rows), f"Beside the paper's {title}")

    return [
        build(
            "Table 2: true positives, false positives, false negatives",
            ("TP", "FP", "FN"),
            lambda score: (score.tp, score.fp, score.fn),
        ),
        build(
            "Table 3: precision, recall, F1",
            ("P", "R", "F1"),
            lambda score: [rate(getattr(score, name)) for name in RATES],
        ),
    ]


def causes_table(evaluation: Evaluation, *, explained: bool = False) -> Table:
    """False positives by cause, most frequent first; ``explained`` adds the meaning of each cause."""
    columns = {
        f"{name}, {scene}": Counter(scored.score.overall.causes)
        for name, result in evaluation.detectors.items()
        for scene, scored in result.scenes.items()
    }
    total: Counter[str] = Counter()
    for causes in columns.values():
        total.update(causes)
    rows: list[list[Cell]] = [
        [cause, *(causes[cause] for causes in columns.values())] for cause, _ in total.most_common()
    ]
    if explained:
        rows = [[*row, CAUSES.get(str(row[0]), "an object of this kind is there")] for row in rows]
    return Table(("cause", *columns, *(("meaning",) if explained else ())), rows, "False positives by cause")


COCO = MappingProxyType(
    {
        "ap": "AP",
        "ap50": "AP50",
        "ap75": "AP75",
        "ap_small": "AP small",
        "ap_medium": "AP medium",
        "ap_large": "AP large",
        "ar": "AR",
    }
)
"""Figures of `CocoScore` and their usual names."""


def coco_table(evaluation: Evaluation) -> Table:
    """Average precision as COCO defines it, by detector and scene."""
    rows = [
        [name, scene, *((rate(getattr(each.coco, key)), "r") for key in COCO)]
        for name, result in evaluation.detectors.items()
        for scene, each in result.scenes.items()
        if each.coco.ap is not None
    ]
    return Table(("detector", "scene", *COCO.values()), _without_repeats(rows), "Average precision as COCO defines it")


TRACKING = MappingProxyType(
    {
        "hota": "HOTA",
        "deta": "DetA",
        "assa": "AssA",
        "idf1": "IDF1",
        "idp": "IDP",
        "idr": "IDR",
        "mota": "MOTA",
        "motp": "MOTP",
    }
)
"""Rates of `TrackingScore` and their usual names."""

TRACKING_COUNTS = ("switches", "fragments", "false", "missed", "people", "tracks", "mostly_tracked", "mostly_lost")


def tracking_table(evaluation: Evaluation, *, full: bool = True) -> Table:
    """Tracking metrics by detector and scene, for recordings; without ``full`` only the most important ones."""
    rates = [key for key in TRACKING if full or key not in ("idp", "idr", "motp")]
    rows = [
        [
            name,
            scene,
            *((rate(getattr(score, key)), "r") for key in rates),
            *(getattr(score, key) for key in TRACKING_COUNTS[:6]),
        ]
        for name, result in evaluation.detectors.items()
        for scene, each in result.scenes.items()
        if (score := each.tracking) is not None
    ]
    heads = ("detector", "scene", *(TRACKING[key] for key in rates), *TRACKING_COUNTS[:6])
    return Table(heads, _without_repeats(rows), "Tracking")


def distance_table(evaluation: Evaluation) -> Table:
    """Distance errors of detected people by detector, scene and distance band, in percent."""
    rows = []
    for name, result in evaluation.detectors.items():
        for scene, scored in result.scenes.items():
            bands = [*shown_bands(evaluation, [scored]), "all"]
            for band in bands:
                score = (scored.score.overall if band == "all" else scored.score.bands[band]).distance
                if score is not None:
                    figures = f"{score.median:.1%}", f"{score.p90:.1%}", f"{score.bias:+.1%}", f"{score.within:.0%}"
                    rows.append([f"{name}, {scene}", metres(band), score.people, *((each, "r") for each in figures)])
    heads = ("detector", "distance", "people", "median", "90 % below", "bias", "within 2 sigma")
    return Table(heads, _without_repeats(rows), "Errors of distances")


def behaviour_clips(evaluation: Evaluation) -> Iterator[tuple[str, ClipResult]]:
    """Detector name and clip of each clip whose behaviour was evaluated."""
    for name, result in evaluation.detectors.items():
        for scene in result.scenes.values():
            yield from ((name, clip) for clip in scene.clips if clip.behaviour is not None)


def behaviour_table(evaluation: Evaluation) -> Table:
    """Outcomes of greetings and offers of help by detector and clip."""
    rows = []
    for name, clip in behaviour_clips(evaluation):
        assert clip.behaviour is not None
        counts = [count for deed in OUTCOMES for count in clip.behaviour.count(deed).values()]
        rows.append([name, clip.source.name, *counts])
    groups = (("", 2), *((f"{deed}s", len(outcomes)) for deed, outcomes in OUTCOMES.items()))
    heads = ("detector", "clip", *(outcome for outcomes in OUTCOMES.values() for outcome in outcomes))
    return Table(heads, rows, "What Waldo does with it", groups)


def interval_text(interval: Interval | None) -> str:
    """An interval as text; empty for None."""
    return "" if interval is None else f"{interval[0]:.2f}-{interval[1]:.2f}"


def with_interval(score: BandScore, key: str) -> str:
    """The rate called ``key`` ("precision", "recall", "f1" or "ap") with its interval in parentheses."""
    value = rate(score.ap if key == "ap" else getattr(score.score, key))
    interval = score.intervals.get(key)
    return value if interval is None else f"{value} ({interval_text(interval)})"


def _unit(evaluation: Evaluation) -> str:
    return "frames" if evaluation.plan.rules.presence else "people"


def _without_repeats(rows: Sequence[Sequence[Cell]]) -> list[Sequence[Cell]]:
    return [["", *row[1:]] if number and rows[number - 1][0] == row[0] else row for number, row in enumerate(rows)]


# Curves


@dataclass(frozen=True)
class DetectorCurve:
    """Precision-recall curve of a detector alone, and the operating ``point`` (recall, precision) of its pipeline."""

    name: str
    colour: str
    curve: PrecisionRecallCurve | None
    point: Point | None

    def thinned(self) -> list[Point]:
        """At most `CURVE_POINTS` points (recall, precision) of the curve, with its first and last."""
        return [] if self.curve is None else list(zip(*thinned(self.curve)[:2], strict=True))


@dataclass(frozen=True)
class CurveChart:
    """Curves of all detectors for one scene and band, and the operating point of the paper."""

    title: str
    lines: tuple[DetectorCurve, ...]
    paper: Point | None


def curve_charts(evaluation: Evaluation) -> list[CurveChart]:
    """A chart for each scene and each band with people."""
    scores = [scored.score.bands for result in evaluation.detectors.values() for scored in result.scenes.values()]
    keys = [key for key in evaluation.plan.rules.keys if any(bands[key].curve is not None for bands in scores)]
    charts = []
    for scene in evaluation.scenes:
        for band in keys:
            lines = []
            for name, colour in colours(evaluation):
                score = evaluation.detectors[name].scenes[scene].score.bands[band]
                lines.append(DetectorCurve(name, colour, score.curve, _point(score.score)))
            paper = _point(paper_score(evaluation, scene, band))
            charts.append(CurveChart(f"{scene}, {metres(band)}", tuple(lines), paper))
    return charts


def _point(score: Score | None) -> Point | None:
    if score is None or score.recall is None or score.precision is None:
        return None
    return score.recall, score.precision


def thinned(curve: PrecisionRecallCurve) -> list[list[float]]:
    """Recalls, precisions and thresholds of at most `CURVE_POINTS` points of a curve, with its first and last."""
    count = len(curve.recall)
    kept = np.linspace(0, count - 1, min(count, CURVE_POINTS)).round().astype(np.intp)
    return [
        [round(float(value), 4) for value in column[kept]] for column in (curve.recall, curve.precision, curve.scores)
    ]


# Output


def show(evaluation: Evaluation, console: Console) -> None:
    """Print all tables that have rows to a terminal."""
    tables = [
        *(detector_table(evaluation, name, intervals=False) for name in evaluation.detectors),
        *paper_tables(evaluation),
        coco_table(evaluation),
        tracking_table(evaluation, full=False),
        distance_table(evaluation),
        causes_table(evaluation),
        behaviour_table(evaluation),
    ]
    for table in tables:
        if table.rows:
            # A Table would wrap its title at its own width.
            console.print(table.title, soft_wrap=True, markup=False, style="bold")
            console.print(table.terminal())
            console.print()


def markdown(evaluation: Evaluation) -> str:
    """The tables and speeds as Markdown."""
    tables = [table for table in paper_tables(evaluation) if table.rows]
    tables += [detector_table(evaluation, name, intervals=True) for name in evaluation.detectors]
    tables += [] if evaluation.plan.rules.presence else [causes_table(evaluation)]
    tables += [
        table
        for make in (coco_table, tracking_table, distance_table, behaviour_table)
        if (table := make(evaluation)).rows
    ]
    parts = [part for table in tables for part in (f"**{table.title}**", _markdown(table))]
    speeds = [f"- {name}: {result.speed}" for name, result in evaluation.detectors.items() if result.speed is not None]
    return "\n\n".join([*parts, *(["\n".join(speeds)] if speeds else [])]) + "\n"


def _markdown(table: Table) -> str:
    if not table.rows:
        return "None."
    above = [group for group, count in table.groups for _ in range(count)] or [""] * len(table.heads)
    heads = [f"{group} {head}".strip() for group, head in zip(above, table.heads, strict=True)]
    rows = [heads, ["---"] * len(heads), *([text for text, _ in row] for row in table.cells())]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows)


def write_markdown(evaluation: Evaluation, folder: Path) -> None:
    """Write evaluation.md and curves.svg into ``folder``.

    Raises:
        ParameterError: A file cannot be written.
    """
    write_file(folder / "evaluation.md", markdown(evaluation))
    charts = curve_charts(evaluation)
    if charts:
        columns = len(charts) // len(evaluation.scenes)
        drawing = render("curves.svg", charts=charts, columns=columns, colours=colours(evaluation))
        write_file(folder / "curves.svg", drawing)
