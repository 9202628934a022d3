"""How good detections are, judged by ground truth: precision, recall and F1, by distance.

In each frame the detections, best score first, take the free true person they overlap most, given an IoU of
at least 0.5. True positives and misses belong to the distance band of the true person. A false positive has no true
distance and belongs to the band of the distance the detector gave it, or to "unknown" where it gave none.
People and false positives beyond all bands are counted under "outside".

People of whom less than a quarter is visible are neither asked for nor held against a detector that finds them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from socialbot.messages import PersonDetection, PersonDetections
from socialbot.vision.boxes import iou
from socialbot.vision.truth import Truth, TruthFrame, TruthPerson

__all__ = ["BANDS", "OUTSIDE", "UNKNOWN", "Score", "Scores", "band_name", "score"]

Band = tuple[float, float]
"""From (included) and to (excluded), m."""

BANDS: tuple[Band, ...] = ((0.0, 2.0), (2.0, 10.0), (10.0, 20.0))
OUTSIDE = "outside"
UNKNOWN = "unknown"
LEAST_IOU = 0.5
LEAST_VISIBLE = 0.25


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


@dataclass
class Scores:
    """The scores by band ("2-10 m", ..., "outside", "unknown").

    ``frames`` were judged; ``missing_frames`` have a truth but no detections message and were left out,
    ``unjudged_frames`` the other way round. ``ignored`` people were hardly visible.
    """

    bands: dict[str, Score] = field(default_factory=dict)
    frames: int = 0
    missing_frames: int = 0
    unjudged_frames: int = 0
    ignored: int = 0

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
            _score_frame(frame, answer.persons, bands, result)
    result.unjudged_frames = len(answers)
    return result


def _score_frame(frame: TruthFrame, found: Sequence[PersonDetection], bands: Sequence[Band], result: Scores) -> None:
    counted = [person for person in frame.persons if person.visible >= LEAST_VISIBLE]
    ignored = [person for person in frame.persons if person.visible < LEAST_VISIBLE]
    result.ignored += len(ignored)
    for detection in sorted(found, key=lambda person: (-person.score, person.x, person.y, person.w, person.h)):
        match = _best(detection, counted)
        if match is not None:
            counted.remove(match)
            result.bands[_band_of(match.distance_m, bands)].tp += 1
        elif _best(detection, ignored) is None:
            result.bands[_band_of(detection.distance_m, bands)].fp += 1
    for person in counted:
        result.bands[_band_of(person.distance_m, bands)].fn += 1


def _best(detection: PersonDetection, persons: Sequence[TruthPerson]) -> TruthPerson | None:
    """The one of ``persons`` that ``detection`` overlaps most, if it does so enough."""
    if not persons:
        return None
    overlaps = iou(_box(detection), np.array([_box(person) for person in persons]))
    best = int(np.argmax(overlaps))
    return persons[best] if overlaps[best] >= LEAST_IOU else None


def _box(person: PersonDetection | TruthPerson) -> np.ndarray:
    return np.array([person.x, person.y, person.w, person.h])


def _band_of(distance: float | None, bands: Sequence[Band]) -> str:
    if distance is None:
        return UNKNOWN
    return next((band_name(band) for band in bands if band[0] <= distance < band[1]), OUTSIDE)
