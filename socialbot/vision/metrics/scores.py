"""Precision, recall, F1 and average precision by distance band, with intervals and curves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np

from socialbot.core.messages import PersonDetection, PersonDetections
from socialbot.vision.metrics.matches import BANDS, FALSE, OUTSIDE, UNKNOWN, Band, Match, pair, ranked
from socialbot.vision.metrics.truth import LEAST_VISIBLE, GroundTruth, TruthFrame, TruthPerson

__all__ = [
    "COVERAGE", "DRAWS", "BandScore", "FrameMatches", "Interval", "PrecisionRecallCurve", "SceneScore", "Score",
    "ScoredFrame", "Scores", "average_precision", "band_name", "score", "score_scene",
]  # fmt: skip


@dataclass
class Score:
    """Counts of true positives, false positives and misses; rates without data are None."""

    tp: int = 0
    fp: int = 0
    fn: int = 0

    @property
    def precision(self) -> float | None:
        """TP / (TP + FP)."""
        return _share(self.tp, self.tp + self.fp)

    @property
    def recall(self) -> float | None:
        """TP / (TP + FN)."""
        return _share(self.tp, self.tp + self.fn)

    @property
    def f1(self) -> float | None:
        """Harmonic mean of precision and recall."""
        return _share(2 * self.tp, 2 * self.tp + self.fp + self.fn)

    def __add__(self, other: Score) -> Score:
        return Score(self.tp + other.tp, self.fp + other.fp, self.fn + other.fn)


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


class ScoredFrame(msgspec.Struct, frozen=True):
    """Found and missed people and false positives of one frame; ``stamp`` (ns) is that of its image."""

    stamp: int
    found: tuple[TruthPerson, ...] = ()
    missed: tuple[TruthPerson, ...] = ()
    false: tuple[PersonDetection, ...] = ()

    @property
    def score(self) -> Score:
        """Counts at all distances."""
        return Score(len(self.found), len(self.false), len(self.missed))

    @property
    def errors(self) -> int:
        """Number of misses and false positives."""
        return len(self.missed) + len(self.false)


@dataclass
class Scores:
    """Scores by band ("2-10 m", ..., "outside", "unknown") and by frame.

    Args:
        bands: Scores by band.
        frames: Number of scored frames.
        missing_frames: Frames with ground truth but without a detections message.
        unjudged_frames: Detections messages without ground truth.
        ignored: Number of hardly visible people.
        by_frame: Results of each scored frame.
    """

    bands: dict[str, Score] = field(default_factory=dict)
    frames: int = 0
    missing_frames: int = 0
    unjudged_frames: int = 0
    ignored: int = 0
    by_frame: list[ScoredFrame] = field(default_factory=list)

    @property
    def overall(self) -> Score:
        """Sum of all bands."""
        return sum(self.bands.values(), Score())


def band_name(band: Band) -> str:
    """Display name of a band: "2-10 m"."""
    return f"{band[0]:g}-{band[1]:g} m"


def score(truth: GroundTruth, detections: Iterable[PersonDetections], bands: Sequence[Band] = BANDS) -> Scores:
    """Score ``detections`` by ``truth``; the last of several messages with one stamp counts."""
    answers = {message.stamp: message for message in detections}
    result = Scores(bands={name: Score() for name in (*map(band_name, bands), OUTSIDE, UNKNOWN)})
    for frame in truth.frames:
        answer = answers.pop(frame.stamp, None)
        if answer is None:
            result.missing_frames += 1
        else:
            result.frames += 1
            scored = _scored(frame, answer.persons)
            _count(scored, bands, result)
            result.by_frame.append(scored)
            result.ignored += sum(person.visible < LEAST_VISIBLE for person in frame.persons)
    result.unjudged_frames = len(answers)
    return result


def _scored(frame: TruthFrame, found: Sequence[PersonDetection]) -> ScoredFrame:
    counted = [person for person in frame.persons if person.visible >= LEAST_VISIBLE]
    ignored = [person for person in frame.persons if person.visible < LEAST_VISIBLE]
    detections = ranked(found)
    pairs = pair(_boxes(detections), _boxes(counted), _boxes(ignored))
    return ScoredFrame(
        frame.stamp,
        found=tuple(person for number, person in enumerate(counted) if number in pairs),
        missed=tuple(person for number, person in enumerate(counted) if number not in pairs),
        false=tuple(detection for detection, who in zip(detections, pairs, strict=True) if who == FALSE),
    )


def _count(frame: ScoredFrame, bands: Sequence[Band], result: Scores) -> None:
    for person in frame.found:
        result.bands[_band_of(person.distance_m, bands)].tp += 1
    for detection in frame.false:
        result.bands[_band_of(detection.distance_m, bands)].fp += 1
    for person in frame.missed:
        result.bands[_band_of(person.distance_m, bands)].fn += 1


def _boxes(persons: Sequence[PersonDetection | TruthPerson]) -> np.ndarray:
    return np.array([(person.x, person.y, person.w, person.h) for person in persons]).reshape(-1, 4)


def _band_of(distance: float | None, bands: Sequence[Band]) -> str:
    if distance is None:
        return UNKNOWN
    return next((band_name(band) for band in bands if band[0] <= distance < band[1]), OUTSIDE)


DRAWS = 1000
COVERAGE = 0.95
LEAST_BLOCKS = 4
"""With fewer blocks of people or detections there is no interval."""
_SEED = 20211108

Interval = tuple[float, float]


@dataclass(frozen=True)
class FrameMatches:
    """Matches of one frame, and its ``block`` of the bootstrap."""

    block: Hashable
    matches: tuple[Match, ...]


@dataclass(frozen=True)
class PrecisionRecallCurve:
    """Recall and precision, shape (n,), at the falling thresholds ``scores``."""

    recall: np.ndarray
    precision: np.ndarray
    scores: np.ndarray


@dataclass(frozen=True)
class BandScore:
    """Score of one band.

    Args:
        score: Counts of the pipeline.
        intervals: Intervals of "precision", "recall", "f1" and "ap", where defined.
        ap: Average precision of the detector alone.
        curve: Curve of the detector alone.
        causes: Number of false positives by cause.
    """

    score: Score
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    ap: float | None = None
    curve: PrecisionRecallCurve | None = None
    causes: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class SceneScore:
    """Scores of one scene by band and overall, with the number of frames and of bootstrap blocks."""

    bands: Mapping[str, BandScore]
    overall: BandScore
    frames: int
    blocks: int


def score_scene(scored: Sequence[FrameMatches], raw: Sequence[FrameMatches], keys: Sequence[str]) -> SceneScore:
    """Score a scene.

    Args:
        scored: Matches of the pipeline, frame by frame.
        raw: Matches of all boxes of the detector down to a low score, for the same frames.
        keys: Names of the bands.
    """
    names = list(dict.fromkeys(frame.block for frame in scored))
    index = {name: number for number, name in enumerate(names)}
    blocks = np.array([index[frame.block] for frame in scored], dtype=np.intp)
    draws = _draws(len(names))
    bands = {key: _band_score(scored, raw, blocks, draws, {key}) for key in keys}
    overall = _band_score(scored, raw, blocks, draws, set(keys))
    return SceneScore(bands, overall, len(scored), len(names))


def average_precision(recall: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Area under curves of shape (..., n) with rising recall, by all-point interpolation."""
    falling = np.maximum.accumulate(precision[..., ::-1], axis=-1)[..., ::-1]
    return np.sum(np.diff(recall, axis=-1, prepend=0.0) * falling, axis=-1)


def _draws(blocks: int) -> np.ndarray:
    """Bootstrap weights, shape (DRAWS, blocks)."""
    if not blocks:
        return np.zeros((DRAWS, 0), dtype=np.int64)
    return np.random.default_rng(_SEED).multinomial(blocks, np.full(blocks, 1 / blocks), size=DRAWS)


def _band_score(
    scored: Sequence[FrameMatches], raw: Sequence[FrameMatches], blocks: np.ndarray, draws: np.ndarray, keys: set[str]
) -> BandScore:
    counts = np.zeros((draws.shape[1], 3), dtype=np.int64)
    column = {"hit": 0, "false": 1, "missed": 2}
    causes: Counter[str] = Counter()
    for block, frame in zip(blocks, scored, strict=True):
        for verdict in frame.matches:
            if verdict.band in keys and verdict.kind in column:
                counts[block, column[verdict.kind]] += 1
                causes.update([verdict.cause] if verdict.cause else [])
    score = Score(*map(int, counts.sum(axis=0)))
    curve, area, areas = _curve(raw, blocks, draws, keys)
    intervals: dict[str, Interval] = {}
    if np.count_nonzero(counts.sum(axis=1)) >= LEAST_BLOCKS:
        intervals = _intervals(score, draws @ counts)
        if area is not None:
            intervals["ap"] = _interval(areas, area)
    return BandScore(score, intervals, area, curve, dict(sorted(causes.items(), key=lambda item: (-item[1], item[0]))))


def _intervals(score: Score, drawn: np.ndarray) -> dict[str, Interval]:
    """Intervals of the rates from the TP, FP and FN of each draw, shape (draws, 3)."""
    hits, false, missed = drawn.T
    rates = {
        "precision": (score.precision, _ratio(hits, hits + false)),
        "recall": (score.recall, _ratio(hits, hits + missed)),
        "f1": (score.f1, _ratio(2 * hits, 2 * hits + false + missed)),
    }
    return {name: _interval(values, rate) for name, (rate, values) in rates.items() if rate is not None}


def _interval(values: np.ndarray, figure: float) -> Interval:
    """Central interval of the finite ``values``, extended to contain ``figure``."""
    known = values[~np.isnan(values)]
    if not known.size:
        return figure, figure
    low, high = np.quantile(known, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    return min(float(low), figure), max(float(high), figure)


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.divide(part, whole, out=np.full(part.shape, np.nan), where=whole > 0)


def _curve(
    raw: Sequence[FrameMatches], blocks: np.ndarray, draws: np.ndarray, keys: set[str]
) -> tuple[PrecisionRecallCurve | None, float | None, np.ndarray]:
    """Curve of a band, its area, and the areas of all draws."""
    people = np.zeros(draws.shape[1], dtype=np.int64)
    found: list[tuple[float, bool, int]] = []
    for block, frame in zip(blocks, raw, strict=True):
        for verdict in frame.matches:
            if verdict.band in keys:
                people[block] += verdict.kind in ("hit", "missed")
                if verdict.kind in ("hit", "false"):
                    found.append((verdict.score, verdict.kind == "hit", int(block)))
    if not people.sum():
        return None, None, np.empty(0)
    found.sort(key=lambda item: (-item[0], not item[1]))
    scores = np.array([score for score, _, _ in found], dtype=np.float64)
    hit = np.array([hit for _, hit, _ in found], dtype=bool)
    of_block = np.array([block for _, _, block in found], dtype=np.intp)
    # Detections of equal score give one point of the curve.
    last = np.append(np.diff(scores) != 0, True)[: len(scores)]
    weights = np.vstack([np.ones(draws.shape[1], dtype=np.int64), draws])
    areas = np.full(len(weights), np.nan)
    curve = PrecisionRecallCurve(np.empty(0), np.empty(0), np.empty(0))
    for number, weight in enumerate(weights):
        drawn = weight[of_block]
        hits = np.cumsum(drawn * hit)[last]
        all_found = np.cumsum(drawn)[last]
        there = int(weight @ people)
        if not there:
            continue
        precision = np.divide(hits, all_found, out=np.ones(len(hits)), where=all_found > 0)
        # Dividing once makes a perfect area exactly 1.
        areas[number] = average_precision(hits, precision) / there
        if number == 0:
            curve = PrecisionRecallCurve(hits / there, precision, scores[last])
    return curve, float(areas[0]), areas[1:]
