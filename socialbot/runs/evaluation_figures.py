"""Figures of an evaluation for the terminal, Markdown, the page and JSON, and those of the paper."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from socialbot.core.errors import SocialbotError
from socialbot.runs.record import versions
from socialbot.vision.metrics.behaviour import OUTCOMES, Behaviour
from socialbot.vision.metrics.evaluation import ClipResult, DetectorResult, Evaluation, SceneResult
from socialbot.vision.metrics.frames import BLOCK_S
from socialbot.vision.metrics.scores import COVERAGE, DRAWS, BandScore, PrecisionRecallCurve, Score

COLOURS = ("#0b7fb0", "#c06a10", "#4f8a2a", "#a558a0", "#8a7015")
"""Colours of the detectors in their order, for light and dark backgrounds."""

CURVE_POINTS = 200
"""Curves are thinned to at most this many points."""

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


CONFIDENCE = f"{100 * COVERAGE:g} %"
"""Coverage of the intervals as text."""

Row = tuple[str, str, dict[str, Score]]
"""Distance band, "paper" or detector name, and the scores by scene."""


def rate(value: float | None, places: int = 3) -> str:
    """A rate as text; "-" for None."""
    return "-" if value is None else f"{value:.{places}f}"


def metres(band: str) -> str:
    """A band as text: "2-10 m"."""
    return f"{band} m" if "-" in band else band


def paper_rows(evaluation: Evaluation) -> list[Row]:
    """Rows of the comparison with the paper: for each band the paper, if it has it, then the detectors.

    Empty when matching by presence, which the paper does not use.
    """
    rows: list[Row] = []
    if evaluation.plan.rules.presence:
        return rows
    columns = _column_of(evaluation.scenes)
    for band in evaluation.plan.rules.keys:
        paper = {scene: scores[band] for scene, scores in PAPER.items() if band in scores}
        if paper:
            rows.append((band, "paper", paper))
        for name, result in evaluation.detectors.items():
            scores = {columns[scene]: each.score.bands[band].score for scene, each in result.scenes.items()}
            if any(score.tp or score.fp or score.fn for score in scores.values()):
                rows.append((band, name, scores))
    return rows


def scene_columns(evaluation: Evaluation) -> list[str]:
    """Scene columns of the comparison with the paper: its scenes, then others."""
    return list(dict.fromkeys([*SCENES, *_column_of(evaluation.scenes).values()]))


def _column_of(scenes: Sequence[str]) -> dict[str, str]:
    papers = {scene: paper_scene(scene) for scene in scenes}
    alone = Counter(papers.values())
    return {scene: paper if paper is not None and alone[paper] == 1 else scene for scene, paper in papers.items()}


def shown_bands(scene: SceneResult) -> Iterable[tuple[str, BandScore]]:
    """The configured bands, and others that have counts."""
    for band, score in scene.score.bands.items():
        if "-" in band or score.score.tp or score.score.fp or score.score.fn:
            yield band, score


def shown_in_scene(evaluation: Evaluation, scene: str) -> list[str]:
    """Names of the bands of ``scene`` shown for at least one detector."""
    told = {band for result in evaluation.detectors.values() for band, _ in shown_bands(result.scenes[scene])}
    return [band for band in evaluation.plan.rules.keys if band in told]


def tracking_text(evaluation: Evaluation, result: DetectorResult) -> str:
    """Whether the results include tracking, as text."""
    consecutive = {source.images.consecutive for source in evaluation.plan.sources}
    if not result.pipeline.tracked or True not in consecutive:
        return "without tracking"
    return "with tracking" if False not in consecutive else "with tracking (single images without)"


def counted_unit(evaluation: Evaluation) -> str:
    """The unit of the counts: people, or frames when matching by presence."""
    return "frames" if evaluation.plan.rules.presence else "people"


def colours(evaluation: Evaluation) -> list[tuple[str, str]]:
    """Name and colour of each detector."""
    return [(name, COLOURS[number % len(COLOURS)]) for number, name in enumerate(evaluation.detectors)]


def all_causes(evaluation: Evaluation) -> tuple[list[tuple[str, str, Counter[str]]], list[str]]:
    """Causes of false positives: (detector, scene, counts), and all causes, most frequent first."""
    columns = [
        (name, scene, Counter(scored.score.overall.causes))
        for name, result in evaluation.detectors.items()
        for scene, scored in result.scenes.items()
    ]
    total: Counter[str] = Counter()
    for _, _, causes in columns:
        total.update(causes)
    return columns, [cause for cause, _ in total.most_common()]


def paper_score(evaluation: Evaluation, scene: str, band: str) -> Score | None:
    """The score of the paper for a scene and band; None if it has none."""
    if evaluation.plan.rules.presence:
        return None
    return PAPER.get(paper_scene(scene) or "", {}).get(band)


@dataclass(frozen=True)
class DetectorCurve:
    """Precision-recall curve of a detector alone, and the operating ``point`` (recall, precision) of its pipeline."""

    name: str
    colour: str
    curve: PrecisionRecallCurve | None
    point: Point | None

    def thinned(self) -> list[Point]:
        """At most `CURVE_POINTS` points (recall, precision) of the curve, with its first and last."""
        return [] if self.curve is None else list(zip(*_thinned(self.curve)[:2], strict=True))


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


def content(evaluation: Evaluation) -> dict[str, Any]:
    """The evaluation as plain data, without single frames."""
    plan = evaluation.plan
    return {
        "schema": "socialbot/evaluation",
        "version": 1,
        "settings": {
            "bands": [list(band) for band in plan.rules.bands],
            "matching": "presence" if plan.rules.presence else "boxes",
            "iou": plan.rules.least_iou,
            "intervals": {"block_s": BLOCK_S, "draws": DRAWS, "coverage": COVERAGE},
            "average_precision": "all-point interpolation",
        },
        "sources": [
            {"name": source.name, "scene": source.scene, "split": source.split, "frames": len(source.frames)}
            for source in plan.sources
        ],
        "detectors": {name: _detector(result) for name, result in evaluation.detectors.items()},
        "paper": {
            scene: {"bands": {band: _rates(score) for band, score in bands.items()}} for scene, bands in PAPER.items()
        },
        "versions": versions(),
    }


def write_json(evaluation: Evaluation, path: Path) -> None:
    """Write `content` to ``path`` as JSON.

    Raises:
        SocialbotError: The file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(msgspec.json.format(msgspec.json.encode(content(evaluation)), indent=2) + b"\n")
    except OSError as error:
        raise SocialbotError(f"cannot be written: {error.strerror}", where=str(path)) from error


def _detector(result: DetectorResult) -> dict[str, Any]:
    pipeline, speed = result.pipeline, result.speed
    return {
        "scenes": {name: _scene(scene) for name, scene in result.scenes.items()},
        "frames_per_s": None if speed is None else round(speed.frames_per_s, 2),
        "speed": None if speed is None else asdict(speed),
        "sure": pipeline.sure,
        "weak": pipeline.spec.weak,
        "parameters": pipeline.values,
    }


def _scene(scene: SceneResult) -> dict[str, Any]:
    return {
        "bands": {band: _band(score) for band, score in scene.score.bands.items()},
        "overall": _band(scene.score.overall),
        "frames": scene.score.frames,
        "blocks": scene.score.blocks,
        "clips": {clip.source.name: _clip(clip) for clip in scene.clips},
    }


def _clip(clip: ClipResult) -> dict[str, Any]:
    return {
        "frames": len(clip.frames),
        "missing_frames": clip.missing_frames,
        "damaged": clip.damaged,
        "behaviour": None if clip.behaviour is None else _behaviour(clip.behaviour),
    }


def _behaviour(acted: Behaviour) -> dict[str, Any]:
    return {f"{deed}s": acted.count(deed) for deed in OUTCOMES}


def _band(band: BandScore) -> dict[str, Any]:
    return {
        **_rates(band.score),
        "people": band.score.tp + band.score.fn,
        "ap": band.ap,
        "intervals": {name: list(interval) for name, interval in band.intervals.items()},
        "causes": dict(band.causes),
        "curve": None if band.curve is None else _curve(band.curve),
    }


def _rates(score: Score) -> dict[str, Any]:
    return {
        "tp": score.tp,
        "fp": score.fp,
        "fn": score.fn,
        "precision": score.precision,
        "recall": score.recall,
        "f1": score.f1,
    }


def _curve(curve: PrecisionRecallCurve) -> dict[str, list[float]]:
    return dict(zip(("recall", "precision", "score"), _thinned(curve), strict=True))


def _thinned(curve: PrecisionRecallCurve) -> list[list[float]]:
    count = len(curve.recall)
    kept = np.linspace(0, count - 1, min(count, CURVE_POINTS)).round().astype(np.intp)
    return [
        [round(float(value), 4) for value in column[kept]] for column in (curve.recall, curve.precision, curve.scores)
    ]
