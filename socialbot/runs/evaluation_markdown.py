"""An evaluation as Markdown tables and one drawing of its curves, for a document of one's own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from socialbot.core.errors import SocialbotError
from socialbot.runs.evaluation_chart import sheet
from socialbot.runs.evaluation_figures import (
    CONFIDENCE,
    Row,
    all_causes,
    asked,
    colours,
    curve_charts,
    metres,
    paper_rows,
    rate,
    scene_columns,
    told_bands,
)
from socialbot.vision.metrics.behaviour import OUTCOMES
from socialbot.vision.metrics.evaluation import Evaluation
from socialbot.vision.metrics.scores import Score

__all__ = ["markdown", "write_markdown"]


def write_markdown(evaluation: Evaluation, folder: Path) -> None:
    """Writes evaluation.md and curves.svg into ``folder``. Raises SocialbotError when that is not possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "evaluation.md").write_text(markdown(evaluation), "utf-8")
        charts = curve_charts(evaluation)
        if charts:
            drawing = sheet(charts, colours(evaluation), len(charts) // len(evaluation.scenes))
            (folder / "curves.svg").write_text(drawing, "utf-8")
    except OSError as error:
        raise SocialbotError(f"cannot be written: {error.strerror}", where=str(folder)) from error


def markdown(evaluation: Evaluation) -> str:
    """The tables as Markdown."""
    scenes = scene_columns(evaluation)
    rows = paper_rows(evaluation)
    parts: list[str] = []
    if rows:
        counts = _beside(rows, scenes, ("TP", "FP", "FN"), lambda score: [str(score.tp), str(score.fp), str(score.fn)])
        rates = _beside(rows, scenes, ("P", "R", "F1"), lambda score: _rates(score))
        parts += ["**Found, false, missed** (the paper's Table 2)", counts]
        parts += ["**Precision, recall, F1** (its Table 3)", rates]
    parts += [f"**With intervals** ({CONFIDENCE})", _intervals(evaluation)]
    if not evaluation.plan.rules.presence:
        parts += ["**False positives by cause**", _causes(evaluation)]
    acted = _behaviour(evaluation)
    parts += ["**What Waldo does with it**", acted] if acted else []
    speeds = _speeds(evaluation)
    parts += [speeds] if speeds else []
    return "\n\n".join(parts) + "\n"


def _beside(
    rows: Iterable[Row], scenes: Sequence[str], names: Sequence[str], cells: Callable[[Score], list[str]]
) -> str:
    lines, before = [], ""
    for band, who, scores in rows:
        told = [cell for scene in scenes for cell in (cells(scores[scene]) if scene in scores else [""] * len(names))]
        lines.append([metres(band) if band != before else "", who, *told])
        before = band
    return _table(["distance", "", *(f"{scene} {name}" for scene in scenes for name in names)], lines)


def _rates(score: Score) -> list[str]:
    return [rate(score.precision), rate(score.recall), rate(score.f1)]


def _intervals(evaluation: Evaluation) -> str:
    lines = []
    for name, result in evaluation.detectors.items():
        for scene, scored in result.scenes.items():
            for band, score in [*told_bands(scored), ("all", scored.score.overall)]:
                each: Score = score.score
                figures = {"precision": each.precision, "recall": each.recall, "f1": each.f1, "ap": score.ap}
                cells = [f"{rate(value)}{_between(score.intervals.get(key))}" for key, value in figures.items()]
                lines.append([name, scene, metres(band), str(each.tp + each.fn), *cells])
    return _table(["detector", "scene", "distance", asked(evaluation), "precision", "recall", "F1", "AP"], lines)


def _between(interval: tuple[float, float] | None) -> str:
    return "" if interval is None else f" ({interval[0]:.2f}-{interval[1]:.2f})"


def _causes(evaluation: Evaluation) -> str:
    columns, causes = all_causes(evaluation)
    lines = [[cause, *(str(count[cause]) for _, _, count in columns)] for cause in causes]
    return _table(["cause", *(f"{name}, {scene}" for name, scene, _ in columns)], lines) if lines else "None."


def _behaviour(evaluation: Evaluation) -> str:
    lines = [
        [name, clip.source.name, *(str(count) for deed in OUTCOMES for count in clip.behaviour.count(deed).values())]
        for name, result in evaluation.detectors.items()
        for scene in result.scenes.values()
        for clip in scene.clips
        if clip.behaviour is not None
    ]
    heads = [f"{deed}s {outcome}" for deed, outcomes in OUTCOMES.items() for outcome in outcomes]
    return _table(["detector", "clip", *heads], lines) if lines else ""


def _speeds(evaluation: Evaluation) -> str:
    speeds = {name: result.speed for name, result in evaluation.detectors.items()}
    return "\n".join(f"- {name}: {speed}" for name, speed in speeds.items() if speed is not None)


def _table(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = [heads, ["---"] * len(heads), *lines]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows)
