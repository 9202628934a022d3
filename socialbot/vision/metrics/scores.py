"""Precision, recall, F1 and average precision by distance band, with intervals and curves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np

from socialbot.core.messages import PersonDetection, PersonDetections
from socialbot.vision.metrics.matches import FALSE, Match, MeasuredDistance, Rules, box_array, pair, ranked
from socialbot.vision.metrics.truth import GroundTruth, TruthFrame, TruthPerson


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
        missing_frames: Frames with ground truth but without a detections message.
        by_frame: Results of each scored frame.
    """

    bands: dict[str, Score] = field(default_factory=dict)
    missing_frames: int = 0
    by_frame: list[ScoredFrame] = field(default_factory=list)

    @property
    def frames(self) -> int:
        """Number of scored frames."""
        return len(self.by_frame)


def score(truth: GroundTruth, detections: Iterable[PersonDetections]) -> Scores:
    """Score ``detections`` by ``truth``; the last of several messages with one stamp counts."""
    rules = Rules()
    answers = {message.stamp: message for message in detections}
    result = Scores({f"{key} m" if "-" in key else key: Score() for key in rules.keys})
    bands = dict(zip(rules.keys, result.bands.values(), strict=True))
    for frame in truth.frames:
        answer = answers.get(frame.stamp)
        if answer is None:
            result.missing_frames += 1
            continue
        scored = _scored(frame, answer.persons)
        result.by_frame.append(scored)
        for person in scored.found:
            bands[rules.key_of(person.distance_m)].tp += 1
        for detection in scored.false:
            bands[rules.key_of(detection.distance_m)].fp += 1
        for person in scored.missed:
            bands[rules.key_of(person.distance_m)].fn += 1
    return result


def _scored(frame: TruthFrame, found: Sequence[PersonDetection]) -> ScoredFrame:
    counted = [person for person in frame.persons if person.counts]
    ignored = [person for person in frame.persons if not person.counts]
    detections = ranked(found)
    pairs = pair(box_array(detections), box_array(counted), box_array(ignored))
    return ScoredFrame(
        frame.stamp,
        found=tuple(person for number, person in enumerate(counted) if number in pairs),
        missed=tuple(person for number, person in enumerate(counted) if number not in pairs),
        false=tuple(detection for detection, index in zip(detections, pairs, strict=True) if index == FALSE),
    )


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
class DistanceScore:
    """Distance errors of detected people, as shares of the true distances.

    Args:
        people: Number of distances.
        median: Median of the absolute errors.
        p90: 90th percentile of the absolute errors.
        bias: Median of the errors; above 0 if detected distances are too large.
        within: Share of the distances that differ by at most two of their standard errors.
    """

    people: int
    median: float
    p90: float
    bias: float
    within: float


def distance_score(distances: Sequence[MeasuredDistance]) -> DistanceScore | None:
    """Errors of ``distances``; None if there are none."""
    if not distances:
        return None
    values, stds, true = np.array(distances, np.float64).T
    errors = (values - true) / true
    return DistanceScore(
        people=len(distances),
        median=float(np.median(np.abs(errors))),
        p90=float(np.quantile(np.abs(errors), 0.9)),
        bias=float(np.median(errors)),
        within=float(np.mean(np.abs(values - true) <= 2 * stds)),
    )


@dataclass(frozen=True)
class BandScore:
    """Score of one band.

    Args:
        score: Counts of the pipeline.
        intervals: Intervals of "precision", "recall", "f1" and "ap", where defined.
        ap: Average precision of the detector alone.
        curve: Curve of the detector alone.
        causes: Number of false positives by cause.
        distance: Errors of the distances; None if none is known.
    """

    score: Score
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    ap: float | None = None
    curve: PrecisionRecallCurve | None = None
    causes: Mapping[str, int] = field(default_factory=dict)
    distance: DistanceScore | None = None


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
    index = {name: number for number, name in enumerate(dict.fromkeys(frame.block for frame in scored))}
    count = len(index)
    draws = np.zeros((DRAWS, 0), dtype=np.int64)
    if count:
        draws = np.random.default_rng(_SEED).multinomial(count, np.full(count, 1 / count), size=DRAWS)
    blocks = [index[frame.block] for frame in scored]
    found = [
        [(block, match) for block, frame in zip(blocks, frames, strict=True) for match in frame.matches]
        for frames in (scored, raw)
    ]

    def band_score(names: set[str]) -> BandScore:
        judged, every = ([each for each in matches if each[1].band in names] for matches in found)
        return _band_score(judged, every, draws)

    bands = {key: band_score({key}) for key in keys}
    return SceneScore(bands, band_score(set(keys)), len(scored), count)


def average_precision(recall: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Area under curves of shape (..., n) with rising recall, by all-point interpolation."""
    falling = np.maximum.accumulate(precision[..., ::-1], axis=-1)[..., ::-1]
    return np.sum(np.diff(recall, axis=-1, prepend=0.0) * falling, axis=-1)


def _band_score(scored: list[tuple[int, Match]], raw: list[tuple[int, Match]], draws: np.ndarray) -> BandScore:
    counts = np.zeros((draws.shape[1], 3), dtype=np.int64)
    kinds = ("hit", "false", "missed")
    for block, match in scored:
        if match.kind in kinds:
            counts[block, kinds.index(match.kind)] += 1
    causes = Counter(match.cause for _, match in scored if match.cause)
    score = Score(*map(int, counts.sum(axis=0)))
    curve, area, areas = _curve(raw, draws)
    intervals: dict[str, Interval] = {}
    if np.count_nonzero(counts.sum(axis=1)) >= LEAST_BLOCKS:
        hits, false, missed = (draws @ counts).T
        rates = {
            "precision": (score.precision, _ratio(hits, hits + false)),
            "recall": (score.recall, _ratio(hits, hits + missed)),
            "f1": (score.f1, _ratio(2 * hits, 2 * hits + false + missed)),
            "ap": (area, areas),
        }
        intervals = {name: _interval(values, rate) for name, (rate, values) in rates.items() if rate is not None}
    return BandScore(
        score,
        intervals,
        area,
        curve,
        dict(sorted(causes.items(), key=lambda item: (-item[1], item[0]))),
        distance_score([match.distance for _, match in scored if match.distance is not None]),
    )


def _interval(values: np.ndarray, figure: float) -> Interval:
    """Central interval of the finite ``values``, extended to contain ``figure``."""
    known = values[~np.isnan(values)]
    if not known.size:
        return figure, figure
    low, high = np.quantile(known, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    return min(float(low), figure), max(float(high), figure)


def _ratio(part: np.ndarray, whole: np.ndarray, empty: float = np.nan) -> np.ndarray:
    return np.divide(part, whole, out=np.full(part.shape, empty), where=whole > 0)


def _curve(
    raw: list[tuple[int, Match]], draws: np.ndarray
) -> tuple[PrecisionRecallCurve | None, float | None, np.ndarray]:
    """Curve of a band, its area, and the areas of all draws."""
    people = np.zeros(draws.shape[1], dtype=np.int64)
    for block, match in raw:
        people[block] += match.kind in ("hit", "missed")
    if not people.sum():
        return None, None, np.empty(0)
    found = [(match.score, match.kind == "hit", block) for block, match in raw if match.kind in ("hit", "false")]
    scores, hit, blocks = np.array(sorted(found, reverse=True)).reshape(-1, 3).T
    # Detections of equal score give one point of the curve.
    last = np.append(np.diff(scores) != 0, True)[: len(scores)]
    areas = np.full(len(draws), np.nan)

    def points(weight: np.ndarray, there: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Recall, precision and area where each block counts ``weight`` times, with ``there`` people."""
        drawn = weight[blocks.astype(np.intp)]
        hits = np.cumsum(drawn * hit)[last]
        precision = _ratio(hits, np.cumsum(drawn)[last], empty=1.0)
        # Dividing once makes a perfect area exactly 1.
        return hits / there, precision, float(average_precision(hits, precision) / there)

    for number, weight in enumerate(draws):
        there = int(weight @ people)
        if there:
            areas[number] = points(weight, there)[2]
    recall, precision, area = points(np.ones(draws.shape[1], dtype=np.int64), int(people.sum()))
    return PrecisionRecallCurve(recall, precision, scores[last]), area, areas
