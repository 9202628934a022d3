"""Figures of an evaluation that terminal, page and JSON share, beside those of the paper."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from socialbot.core.errors import SocialbotError
from socialbot.runs.evaluation_chart import COLOURS, Line, Point, curves_chart
from socialbot.runs.record import versions
from socialbot.vision.metrics.behaviour import OUTCOMES, Behaviour
from socialbot.vision.metrics.evaluation import ClipResult, DetectorResult, Evaluation, SceneResult
from socialbot.vision.metrics.frames import BLOCK_S
from socialbot.vision.metrics.scores import COVERAGE, DRAWS, BandScore, PrecisionRecallCurve, Score

__all__ = [
    "CONFIDENCE",
    "PAPER",
    "Row",
    "SCENES",
    "all_causes",
    "asked",
    "colours",
    "content",
    "curve_charts",
    "followed",
    "metres",
    "paper_rows",
    "paper_scene",
    "paper_score",
    "rate",
    "scene_columns",
    "told_bands",
    "told_of_any",
    "write_json",
]


SCENES = ("Scene 1", "Scene 2")

PAPER: Mapping[str, Mapping[str, Score]] = MappingProxyType(
    {
        "Scene 1": {"0-2": Score(tp=253, fp=160, fn=187), "2-10": Score(tp=401, fp=87, fn=112)},
        "Scene 2": {"0-2": Score(tp=175, fp=160, fn=265), "2-10": Score(tp=354, fp=114, fn=132)},
    }
)
"""Table 2 by scene and band. Table 3 follows from it."""


def paper_scene(name: str) -> str | None:
    """The paper's scene that the scene called ``name`` stands for: "scene1" for "Scene 1"."""
    found = re.match(r"scene[\W_]*([12])(?!\d)", name.lower())
    return f"Scene {found[1]}" if found else None


CONFIDENCE = f"{100 * COVERAGE:g} %"
"""How sure intervals are, as tables say it."""

Row = tuple[str, str, dict[str, Score]]
"""Distance band, who (the paper or a detector), and the scores by scene."""


def rate(value: float | None, places: int = 3) -> str:
    """A rate as people read it; "-" for none."""
    return "-" if value is None else f"{value:.{places}f}"


def metres(band: str) -> str:
    """A band as people read it: "2-10 m"."""
    return f"{band} m" if "-" in band else band


def paper_rows(evaluation: Evaluation) -> list[Row]:
    """The scores laid beside those of the paper: for each band the paper's row, if any, then the detectors'.

    By presence, which the paper does not judge by, there are none.
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
    """The columns of the tables beside the paper: its scenes, then others."""
    return list(dict.fromkeys([*SCENES, *_column_of(evaluation.scenes).values()]))


def _column_of(scenes: Sequence[str]) -> dict[str, str]:
    """The column of each scene: the paper's where it alone stands for one of its scenes, else its own."""
    papers = {scene: paper_scene(scene) for scene in scenes}
    alone = Counter(papers.values())
    return {scene: paper if paper is not None and alone[paper] == 1 else scene for scene, paper in papers.items()}


def told_bands(scene: SceneResult) -> Iterable[tuple[str, BandScore]]:
    """The bands with anything in them, and those that were asked for."""
    for band, score in scene.score.bands.items():
        if "-" in band or score.score.tp or score.score.fp or score.score.fn:
            yield band, score


def told_of_any(evaluation: Evaluation, scene: str) -> list[str]:
    """The names of the bands of ``scene`` that are told of any detector."""
    told = {band for result in evaluation.detectors.values() for band, _ in told_bands(result.scenes[scene])}
    return [band for band in evaluation.plan.rules.keys if band in told]


def followed(evaluation: Evaluation, result: DetectorResult) -> str:
    """Whether people were followed from frame to frame."""
    consecutive = {source.images.consecutive for source in evaluation.plan.sources}
    if not result.pipeline.tracked or True not in consecutive:
        return "without tracking"
    return "with tracking" if False not in consecutive else "with tracking (single pictures without)"


def asked(evaluation: Evaluation) -> str:
    """What is found or missed: people, or by presence frames with somebody in the band."""
    return "frames" if evaluation.plan.rules.presence else "people"


def colours(evaluation: Evaluation) -> list[tuple[str, str]]:
    """The name and the colour of each detector."""
    return [(name, COLOURS[number % len(COLOURS)]) for number, name in enumerate(evaluation.detectors)]


def all_causes(evaluation: Evaluation) -> tuple[list[tuple[str, str, Counter[str]]], list[str]]:
    """The causes of false alarms: detector, scene and counts; and all causes there are, the most frequent first."""
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
    """What the paper has for a scene and band; None by presence, which it did not judge by."""
    if evaluation.plan.rules.presence:
        return None
    return PAPER.get(paper_scene(scene) or "", {}).get(band)


def curve_charts(evaluation: Evaluation) -> list[str]:
    """A chart of precision over recall for each scene and band with people."""
    scores = [scored.score.bands for result in evaluation.detectors.values() for scored in result.scenes.values()]
    keys = [key for key in evaluation.plan.rules.keys if any(bands[key].curve is not None for bands in scores)]
    return [_chart(evaluation, scene, band) for scene in evaluation.scenes for band in keys]


def _chart(evaluation: Evaluation, scene: str, band: str) -> str:
    lines = []
    for name, colour in colours(evaluation):
        score = evaluation.detectors[name].scenes[scene].score.bands[band]
        lines.append(Line(name, colour, score.curve, _point(score.score)))
    return curves_chart(f"{scene}, {metres(band)}", lines, _point(paper_score(evaluation, scene, band)))


def _point(score: Score | None) -> Point | None:
    if score is None or score.recall is None or score.precision is None:
        return None
    return score.recall, score.precision


CURVE_POINTS = 200
"""Curves are thinned to so many points, the first and the last among them."""


def content(evaluation: Evaluation) -> dict[str, Any]:
    """Everything but the single frames."""
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
    """Writes `content` to ``path``. Raises SocialbotError when that is not possible."""
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
    count = len(curve.recall)
    kept = np.linspace(0, count - 1, min(count, CURVE_POINTS)).round().astype(np.intp)
    columns = {"recall": curve.recall, "precision": curve.precision, "score": curve.scores}
    return {name: [round(float(value), 4) for value in column[kept]] for name, column in columns.items()}
