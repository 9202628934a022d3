"""JSON of an evaluation."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec

from socialbot.runs.evaluation_tables import PAPER, RATES, TRACKING, TRACKING_COUNTS, thinned
from socialbot.runs.pages import write_file
from socialbot.runs.record import versions
from socialbot.vision.metrics.behaviour import OUTCOMES
from socialbot.vision.metrics.evaluation import ClipResult, DetectorResult, Evaluation
from socialbot.vision.metrics.frames import BLOCK_S
from socialbot.vision.metrics.scores import COVERAGE, DRAWS, BandScore, Score
from socialbot.vision.metrics.tracks import TrackingScore


def write_json(evaluation: Evaluation, path: Path) -> None:
    """Write `content` to ``path`` as JSON.

    Raises:
        ParameterError: The file cannot be written.
    """
    write_file(path, msgspec.json.format(msgspec.json.encode(content(evaluation)), indent=2) + b"\n")


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
            {
                "name": source.name,
                "scene": source.scene,
                "split": source.split,
                "frames": len(source.frames),
                "format": source.format,
                "notes": list(source.notes),
            }
            for source in plan.sources
        ],
        "detectors": {name: _detector(result) for name, result in evaluation.detectors.items()},
        "paper": {
            scene: {"bands": {band: _rates(score) for band, score in bands.items()}} for scene, bands in PAPER.items()
        },
        "versions": versions(),
    }


def _detector(result: DetectorResult) -> dict[str, Any]:
    pipeline, speed = result.pipeline, result.speed
    return {
        "scenes": {
            name: {
                "bands": {band: _band(score) for band, score in scene.score.bands.items()},
                "overall": _band(scene.score.overall),
                "frames": scene.score.frames,
                "blocks": scene.score.blocks,
                "coco": asdict(scene.coco),
                "tracking": _tracking(scene.tracking),
                "clips": {clip.source.name: _clip(clip) for clip in scene.clips},
            }
            for name, scene in result.scenes.items()
        },
        "frames_per_s": None if speed is None else round(speed.frames_per_s, 2),
        "speed": None if speed is None else asdict(speed),
        "sure": pipeline.sure,
        "weak": pipeline.spec.weak,
        "parameters": pipeline.values,
    }


def _clip(clip: ClipResult) -> dict[str, Any]:
    acted = clip.behaviour
    return {
        "frames": len(clip.frames),
        "missing_frames": clip.missing_frames,
        "damaged": clip.damaged,
        "tracking": _tracking(clip.tracking),
        "behaviour": None if acted is None else {f"{deed}s": acted.count(deed) for deed in OUTCOMES},
    }


def _tracking(score: TrackingScore | None) -> dict[str, Any] | None:
    return score and {key: getattr(score, key) for key in (*TRACKING, "loca", "hits", *TRACKING_COUNTS)}


def _band(band: BandScore) -> dict[str, Any]:
    curve = band.curve
    return {
        **_rates(band.score),
        "people": band.score.tp + band.score.fn,
        "ap": band.ap,
        "distance": None if band.distance is None else asdict(band.distance),
        "intervals": {name: list(interval) for name, interval in band.intervals.items()},
        "causes": dict(band.causes),
        "curve": None if curve is None else dict(zip(("recall", "precision", "score"), thinned(curve), strict=True)),
    }


def _rates(score: Score) -> dict[str, Any]:
    return {name: getattr(score, name) for name in ("tp", "fp", "fn", *RATES)}
