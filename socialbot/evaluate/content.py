"""An evaluation as plain data, for JSON. Rates that are nothing divided by nothing are null."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from socialbot.errors import SocialbotError
from socialbot.evaluate.behaviour import OUTCOMES, Behaviour
from socialbot.evaluate.evaluation import ClipResult, DetectorResult, Evaluation, SceneResult
from socialbot.evaluate.paper import PAPER
from socialbot.evaluate.scores import COVERAGE, DRAWS, BandScore, Curve
from socialbot.evaluate.sources import BLOCK_S
from socialbot.replay import versions
from socialbot.vision.scoring import Score

__all__ = ["content", "write_json"]

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


def _curve(curve: Curve) -> dict[str, list[float]]:
    count = len(curve.recall)
    kept = np.linspace(0, count - 1, min(count, CURVE_POINTS)).round().astype(np.intp)
    columns = {"recall": curve.recall, "precision": curve.precision, "score": curve.scores}
    return {name: [round(float(value), 4) for value in column[kept]] for name, column in columns.items()}
