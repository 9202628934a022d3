"""How good detections are, judged by ground truth: precision, recall and F1, by distance.

In each frame the detections, best score first, take the free true person they overlap most, given an IoU of
at least 0.5. True positives and misses belong to the distance band of the true person. A false positive has no true
distance and belongs to the band of the distance the detector gave it, or to "unknown" where it gave none.
People and false positives beyond all bands are counted under "outside".

People of whom less than a quarter is visible are neither asked for nor held against a detector that finds them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np

from socialbot.core.messages import PersonDetection, PersonDetections
from socialbot.vision.detector import iou
from socialbot.vision.metrics.truth import Truth, TruthFrame, TruthPerson

__all__ = [
    "BANDS", "FALSE", "LEAST_IOU", "LEAST_VISIBLE", "OUTSIDE", "SPARED", "UNKNOWN", "Band", "Score", "ScoredFrame",
    "Scores", "band_name", "pair", "ranked", "score",
]  # fmt: skip

Band = tuple[float, float]
"""From (included) and to (excluded), m."""

BANDS: tuple[Band, ...] = ((0.0, 2.0), (2.0, 10.0), (10.0, 20.0))
OUTSIDE = "outside"
UNKNOWN = "unknown"
LEAST_IOU = 0.5
LEAST_VISIBLE = 0.25
FALSE, SPARED = -1, -2
"""What `pair` says of a detection that finds nobody, and of one that is not held against the detector."""


@dataclass
class Score:
    """True positives, false positives and misses, and what follows from them.

    A rate that would be nothing divided by nothing is None.
    """

    tp: int = 0
    fp: int = 0
    fn: int = 0

    @property
    def precision(self) -> float | None:
        """The share of detections that are people; None without detections."""
        return _share(self.tp, self.tp + self.fp)

    @property
    def recall(self) -> float | None:
        """The share of people that were found; None without people."""
        return _share(self.tp, self.tp + self.fn)

    @property
    def f1(self) -> float | None:
        """The harmonic mean of both; None without people and detections."""
        return _share(2 * self.tp, 2 * self.tp + self.fp + self.fn)

    def __add__(self, other: Score) -> Score:
        return Score(self.tp + other.tp, self.fp + other.fp, self.fn + other.fn)


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


class ScoredFrame(msgspec.Struct, frozen=True):
    """One frame (``stamp``, ns, of its image): who was found, who was missed, and the boxes that fit nobody."""

    stamp: int
    found: tuple[TruthPerson, ...] = ()
    missed: tuple[TruthPerson, ...] = ()
    false: tuple[PersonDetection, ...] = ()

    @property
    def score(self) -> Score:
        """The counts, at all distances."""
        return Score(len(self.found), len(self.false), len(self.missed))

    @property
    def errors(self) -> int:
        """How many were missed or seen where nobody is."""
        return len(self.missed) + len(self.false)


@dataclass
class Scores:
    """The scores by band ("2-10 m", ..., "outside", "unknown"), and each frame by itself.

    ``frames`` were judged; ``missing_frames`` have a truth but no detections message and were left out,
    ``unjudged_frames`` the other way round. ``ignored`` people were hardly visible.
    """

    bands: dict[str, Score] = field(default_factory=dict)
    frames: int = 0
    missing_frames: int = 0
    unjudged_frames: int = 0
    ignored: int = 0
    by_frame: list[ScoredFrame] = field(default_factory=list)

    @property
    def overall(self) -> Score:
        """All bands together."""
        return sum(self.bands.values(), Score())


def band_name(band: Band) -> str:
    """A band as people write it: "2-10 m"."""
    return f"{band[0]:g}-{band[1]:g} m"


def score(truth: Truth, detections: Iterable[PersonDetections], bands: Sequence[Band] = BANDS) -> Scores:
    """Judges ``detections`` by ``truth``. Of several messages with one stamp the last counts."""
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


def pair(found: np.ndarray, people: np.ndarray, spared: np.ndarray, least_iou: float = LEAST_IOU) -> list[int]:
    """Whom each detection finds: an index into ``people``, or `FALSE`, or `SPARED`.

    ``found``, best first, ``people`` and ``spared`` are boxes of shape (n, 4), x, y, w, h. Each detection takes the
    free person it overlaps most, given an IoU of at least ``least_iou``; where there is none, it is spared if it
    overlaps one of ``spared`` as much.
    """
    free = np.ones(len(people), dtype=bool)
    result = []
    for box in found:
        overlaps = np.where(free, iou(box, people), -1.0)
        best = int(np.argmax(overlaps)) if len(people) else -1
        if best >= 0 and overlaps[best] >= least_iou:
            free[best] = False
            result.append(best)
        else:
            result.append(SPARED if len(spared) and iou(box, spared).max() >= least_iou else FALSE)
    return result


def ranked(found: Iterable[PersonDetection]) -> list[PersonDetection]:
    """``found``, best first; of equal scores box, distance and track decide, so that their order does not matter."""

    def key(person: PersonDetection) -> tuple[float | str, ...]:
        distance = math.inf if person.distance_m is None else person.distance_m
        return -person.score, person.x, person.y, person.w, person.h, distance, person.track_id

    return sorted(found, key=key)


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
