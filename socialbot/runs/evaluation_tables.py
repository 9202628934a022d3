"""An evaluation in the terminal."""

from __future__ import annotations

from collections.abc import Callable

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from socialbot.runs.evaluation_figures import (
    CONFIDENCE,
    Row,
    all_causes,
    asked,
    followed,
    metres,
    paper_rows,
    rate,
    scene_columns,
    told_bands,
)
from socialbot.vision.metrics.behaviour import OUTCOMES
from socialbot.vision.metrics.evaluation import Evaluation
from socialbot.vision.metrics.scores import BandScore, Interval, Score

__all__ = ["show"]

HEADINGS = ("found", "false", "missed", "precision", "recall", "F1", CONFIDENCE, "AP")


def show(evaluation: Evaluation, console: Console) -> None:
    """Prints the tables: each detector by scene and band, beside the paper, causes and behaviour."""
    rows, scenes = paper_rows(evaluation), scene_columns(evaluation)
    tables = [
        *(_bands(evaluation, name) for name, result in evaluation.detectors.items()),
        _counts(rows, scenes),
        _rates(rows, scenes),
        _causes(evaluation),
        _behaviour(evaluation),
    ]
    for table in tables:
        if table.row_count:
            # By itself, since a table breaks its title where its columns end.
            console.print(table.title, soft_wrap=True)
            table.title = None
            console.print(table)
            console.print()


def _bands(evaluation: Evaluation, name: str) -> Table:
    result = evaluation.detectors[name]
    pace = "" if result.speed is None else f", {result.speed}"
    table = _table(
        f"[bold]{escape(name)}[/] {followed(evaluation, result)}{pace}",
        "scene",
        "distance",
        asked(evaluation),
        *HEADINGS,
    )
    for scene, scored in result.scenes.items():
        for number, (band, score) in enumerate([*told_bands(scored), ("all", scored.score.overall)]):
            table.add_row(escape(scene) if not number else "", metres(band), *_figures(score))
        table.add_section()
    return table


def _figures(band: BandScore) -> list[str]:
    score = band.score
    return [
        str(score.tp + score.fn),
        str(score.tp),
        str(score.fp),
        str(score.fn),
        rate(score.precision),
        rate(score.recall),
        f"[bold]{rate(score.f1)}[/]",
        _interval(band.intervals.get("f1")),
        rate(band.ap),
    ]


def _interval(interval: Interval | None) -> str:
    return "" if interval is None else f"{interval[0]:.2f}-{interval[1]:.2f}"


def _counts(rows: list[Row], scenes: list[str]) -> Table:
    headings = [f"{escape(scene)} {what}" for scene in scenes for what in ("TP", "FP", "FN")]
    table = _table(
        "Beside the paper's Table 2: true positives, false positives, false negatives", "distance", "", *headings
    )
    _fill(table, rows, scenes, lambda score: [str(score.tp), str(score.fp), str(score.fn)])
    return table


def _rates(rows: list[Row], scenes: list[str]) -> Table:
    headings = [f"{escape(scene)} {what}" for scene in scenes for what in ("P", "R", "F1")]
    table = _table("Beside the paper's Table 3: precision, recall, F1", "distance", "", *headings)
    _fill(table, rows, scenes, lambda score: [rate(score.precision), rate(score.recall), rate(score.f1)])
    return table


def _fill(table: Table, rows: list[Row], scenes: list[str], cells: Callable[[Score], list[str]]) -> None:
    before = ""
    for band, who, scores in rows:
        if before and band != before:
            table.add_section()
        told = [cell for scene in scenes for cell in (cells(scores[scene]) if scene in scores else ["", "", ""])]
        table.add_row(metres(band) if band != before else "", escape(who), *told, style="dim" if who == "paper" else "")
        before = band


def _causes(evaluation: Evaluation) -> Table:
    columns, causes = all_causes(evaluation)
    table = _table("False positives by cause", "cause")
    for name, scene, _ in columns:
        table.add_column(f"{escape(name)}\n{escape(scene)}", justify="right")
    for cause in causes:
        table.add_row(escape(cause), *(str(counts[cause]) for _, _, counts in columns))
    return table


def _behaviour(evaluation: Evaluation) -> Table:
    headings = [f"{deed}s\n{outcome}" if not n else f"\n{outcome}"
                for deed, outcomes in OUTCOMES.items() for n, outcome in enumerate(outcomes)]  # fmt: skip
    table = _table("What Waldo does with it", "detector", "clip", *headings)
    for name, result in evaluation.detectors.items():
        for scene in result.scenes.values():
            for clip in scene.clips:
                if clip.behaviour is not None:
                    counts = [str(count) for deed in OUTCOMES for count in clip.behaviour.count(deed).values()]
                    table.add_row(escape(name), escape(clip.source.name), *counts)
    return table


def _table(title: str, *headings: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, header_style="dim", title_style="")
    for number, heading in enumerate(headings):
        words = ("scene", "distance", "", "detector", "clip", "cause")
        table.add_column(heading, justify="left" if heading in words and number < 2 else "right", no_wrap=True)
    return table
