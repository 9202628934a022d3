"""Scores: verdicts counted by distance band, with intervals, curves and average precision.

**Intervals** come from a bootstrap. Frames that follow each other show nearly the same, so not frames but blocks of
``BLOCK_S`` seconds are drawn, with replacement, as many as there are; single pictures are blocks of their own. The
interval is that of the middle 95 % of `DRAWS` such draws, widened to the figure itself should it lie outside; with
less than `LEAST_BLOCKS` blocks there is none. People who stand still for longer than a block make it narrower than
the truth. The draws are seeded: the same verdicts give the same interval.

**Average precision** is the area under the curve of precision over recall, every point of it, after precision has
been made to fall (all-point interpolation); for a band without people it is None.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from socialbot.vision.metrics.matches import Verdict
from socialbot.vision.metrics.scores import Score

__all__ = [
    "COVERAGE", "DRAWS", "BandScore", "Curve", "Interval", "Judged", "SceneScore", "average_precision", "score_scene",
]  # fmt: skip

DRAWS = 1000
COVERAGE = 0.95
LEAST_BLOCKS = 4
"""With fewer blocks of people or detections there is no interval: there would be nothing to draw from."""
_SEED = 20211108

Interval = tuple[float, float]


@dataclass(frozen=True)
class Judged:
    """The verdicts on one frame; frames of one ``block`` belong together."""

    block: Hashable
    verdicts: tuple[Verdict, ...]


@dataclass(frozen=True)
class Curve:
    """Precision and recall for falling thresholds, each of shape (n,); ``scores`` are the thresholds."""

    recall: np.ndarray
    precision: np.ndarray
    scores: np.ndarray


@dataclass(frozen=True)
class BandScore:
    """The score of one band.

    ``intervals`` are those of "precision", "recall", "f1" and "ap" where they are defined. ``ap`` and
    ``curve`` judge the detector alone, at all its thresholds; ``causes`` count the false alarms.
    """

    score: Score
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    ap: float | None = None
    curve: Curve | None = None
    causes: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class SceneScore:
    """The scores of one scene by band, and of all bands together; ``blocks`` were drawn from for the intervals."""

    bands: Mapping[str, BandScore]
    overall: BandScore
    frames: int
    blocks: int


def score_scene(judged: Sequence[Judged], raw: Sequence[Judged], keys: Sequence[str]) -> SceneScore:
    """The scores of a scene by bands named ``keys``.

    ``judged`` are the verdicts on what the pipeline says, ``raw`` those on every box of the detector down to low
    scores, of the same frames in the same order.
    """
    names = list(dict.fromkeys(frame.block for frame in judged))
    index = {name: number for number, name in enumerate(names)}
    blocks = np.array([index[frame.block] for frame in judged], dtype=np.intp)
    draws = _draws(len(names))
    bands = {key: _band_score(judged, raw, blocks, draws, {key}) for key in keys}
    overall = _band_score(judged, raw, blocks, draws, set(keys))
    return SceneScore(bands, overall, len(judged), len(names))


def average_precision(recall: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """The area under curves of shape (..., n) whose recall rises along the last axis, shape (...,)."""
    falling = np.maximum.accumulate(precision[..., ::-1], axis=-1)[..., ::-1]
    return np.sum(np.diff(recall, axis=-1, prepend=0.0) * falling, axis=-1)


def _draws(blocks: int) -> np.ndarray:
    """How often each block is drawn, shape (DRAWS, blocks)."""
    if not blocks:
        return np.zeros((DRAWS, 0), dtype=np.int64)
    return np.random.default_rng(_SEED).multinomial(blocks, np.full(blocks, 1 / blocks), size=DRAWS)


def _band_score(
    judged: Sequence[Judged], raw: Sequence[Judged], blocks: np.ndarray, draws: np.ndarray, keys: set[str]
) -> BandScore:
    counts = np.zeros((draws.shape[1], 3), dtype=np.int64)
    column = {"hit": 0, "false": 1, "missed": 2}
    causes: Counter[str] = Counter()
    for block, frame in zip(blocks, judged, strict=True):
        for verdict in frame.verdicts:
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
    """The intervals of the rates; ``drawn`` holds hits, false alarms and misses of each draw, shape (draws, 3)."""
    hits, false, missed = drawn.T
    rates = {
        "precision": (score.precision, _ratio(hits, hits + false)),
        "recall": (score.recall, _ratio(hits, hits + missed)),
        "f1": (score.f1, _ratio(2 * hits, 2 * hits + false + missed)),
    }
    return {name: _interval(values, rate) for name, (rate, values) in rates.items() if rate is not None}


def _interval(values: np.ndarray, figure: float) -> Interval:
    """The middle of ``values`` that are numbers, widened to ``figure``."""
    known = values[~np.isnan(values)]
    if not known.size:
        return figure, figure
    low, high = np.quantile(known, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    return min(float(low), figure), max(float(high), figure)


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.divide(part, whole, out=np.full(part.shape, np.nan), where=whole > 0)


def _curve(
    raw: Sequence[Judged], blocks: np.ndarray, draws: np.ndarray, keys: set[str]
) -> tuple[Curve | None, float | None, np.ndarray]:
    """The curve of a band, its area, and the areas of all draws."""
    people = np.zeros(draws.shape[1], dtype=np.int64)
    found: list[tuple[float, bool, int]] = []
    for block, frame in zip(blocks, raw, strict=True):
        for verdict in frame.verdicts:
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
    # Detections of one score come and go together: only the last of them is a point of the curve.
    last = np.append(np.diff(scores) != 0, True)[: len(scores)]
    weights = np.vstack([np.ones(draws.shape[1], dtype=np.int64), draws])
    areas = np.full(len(weights), np.nan)
    curve = Curve(np.empty(0), np.empty(0), np.empty(0))
    for number, weight in enumerate(weights):
        drawn = weight[of_block]
        hits = np.cumsum(drawn * hit)[last]
        all_found = np.cumsum(drawn)[last]
        there = int(weight @ people)
        if not there:
            continue
        precision = np.divide(hits, all_found, out=np.ones(len(hits)), where=all_found > 0)
        # Over the number of hits, and divided once, so that what is perfect is 1 and not a rounding error less.
        areas[number] = average_precision(hits, precision) / there
        if number == 0:
            curve = Curve(hits / there, precision, scores[last])
    return curve, float(areas[0]), areas[1:]
