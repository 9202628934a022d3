"""Match detections with ground truth, by boxes or by presence.

By boxes, each detection, best score first, takes the unmatched person of the largest IoU, at least ``least_iou``. True
positives and misses belong to the distance band of the person, false positives to that of the detected distance. By
presence, each band is matched as a whole: is a person there?

Hardly visible people and ``ignore`` boxes are not scored. A frame that is not complete has no false positives.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from socialbot.core.errors import ParameterError
from socialbot.core.messages import PersonDetection
from socialbot.vision.detector import iou, shared_area
from socialbot.vision.metrics.frames import Box, LabelledFrame
from socialbot.vision.metrics.truth import Person, Region

Band = tuple[float, float]
"""From (included) and to (excluded), m."""

BANDS: tuple[Band, ...] = ((0.0, 2.0), (2.0, 10.0), (10.0, 20.0))
OUTSIDE, UNKNOWN = "outside", "unknown"
LEAST_IOU = 0.5
FALSE, SPARED = -1, -2
"""`pair` returns these for a false positive and for a detection that is not scored."""

NEAR_IOU = 0.1  # A false positive is caused by the region it overlaps by this IoU.
INSIDE = 0.5  # A detection belongs to an object or ignored region that contains this share of it.

POOR_BOX = "poor box"
DOUBLE = "double"
HARDLY_VISIBLE = "hardly visible person"
NOTHING_KNOWN = "nothing known"
CAUSES = {
    POOR_BOX: f"a person is there, but the box overlaps theirs only by {NEAR_IOU:g} to the IoU asked for",
    DOUBLE: "a person is there, and another detection has found them",
    HARDLY_VISIBLE: "overlaps a person that is less than a quarter visible",
    NOTHING_KNOWN: "no person or object of the ground truth is there",
}
"""Meaning of the causes that are not kinds of objects."""


@dataclass(frozen=True)
class Rules:
    """Matching rules: distance ``bands`` (m), least IoU, and matching by boxes or by presence."""

    bands: tuple[Band, ...] = BANDS
    least_iou: float = LEAST_IOU
    presence: bool = False

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of all bands as in ``--bands`` and JSON ("2-10"), nearest first, then "outside" and "unknown"."""
        return (*map(_key, self.bands), OUTSIDE, UNKNOWN)

    def key_of(self, distance_m: float | None) -> str:
        """Name of the band of ``distance_m``."""
        if distance_m is None:
            return UNKNOWN
        return next((_key(band) for band in self.bands if band[0] <= distance_m < band[1]), OUTSIDE)


class MeasuredDistance(NamedTuple):
    """Detected and true distance of a person, m, and the standard error of the detected one."""

    value: float
    std: float
    true: float


@dataclass(frozen=True)
class Match:
    """Result of matching one detection or person ("spared": not scored), in the distance ``band`` of that name.

    ``box`` is that of the detection or of the missed person; it is empty when matching by presence. ``distance``
    compares the distance of a detected person with the true one, if both are known.
    """

    kind: Literal["hit", "false", "missed", "spared"]
    band: str
    box: Box = (0.0, 0.0, 0.0, 0.0)
    score: float = 0.0
    person: str = ""
    cause: str = ""
    distance: MeasuredDistance | None = None


def _key(band: Band) -> str:
    return f"{band[0]:g}-{band[1]:g}"


def parse_bands(text: str) -> tuple[Band, ...]:
    """Parse bands such as "0-2,2-10,10-20". Raises ParameterError for invalid or overlapping bands."""
    bands = tuple(_band(word.strip(), text) for word in text.split(","))
    for nearer, farther in itertools.pairwise(bands):
        if farther[0] < nearer[1]:
            raise ParameterError(
                f"{_key(farther)} does not lie beyond {_key(nearer)}",
                where="--bands",
                remedy="list the bands from near to far, without overlap",
            )
    return bands


def _band(word: str, text: str) -> Band:
    try:
        low, high = map(float, word.split("-"))
    except ValueError:
        low, high = 0.0, 0.0
    if not 0 <= low < high < math.inf:
        raise ParameterError(
            f"{word!r} in {text!r} is not a band",
            where="--bands",
            remedy="write metres as NEAR-FAR, such as 0-2,2-10,10-20",
        )
    return low, high


def pair(found: np.ndarray, people: np.ndarray, spared: np.ndarray, least_iou: float = LEAST_IOU) -> list[int]:
    """Greedy matching of boxes of shape (n, 4), x, y, w, h.

    Args:
        found: Detections, best first.
        people: People to be found.
        spared: People who are not scored; a detection that matches only them is `SPARED`.
        least_iou: Least IoU of a match.

    Returns:
        For each detection an index into ``people``, `FALSE` or `SPARED`.
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
            result.append(SPARED if iou(box, spared).max(initial=0.0) >= least_iou else FALSE)
    return result


def ranked(found: Iterable[PersonDetection]) -> list[PersonDetection]:
    """Sort detections by score; box, distance and track break ties, so the input order does not matter."""

    def key(person: PersonDetection) -> tuple[float | str, ...]:
        distance = math.inf if person.distance_m is None else person.distance_m
        return -person.score, person.x, person.y, person.w, person.h, distance, person.track_id

    return sorted(found, key=key)


def judge(frame: LabelledFrame, found: Iterable[PersonDetection], rules: Rules) -> tuple[Match, ...]:
    """Match the detections of a frame."""
    return tuple((_by_presence if rules.presence else _by_boxes)(frame, ranked(found), rules))


def _by_boxes(frame: LabelledFrame, found: Sequence[PersonDetection], rules: Rules) -> Iterable[Match]:
    asked = [person for person in frame.persons if person.counts]
    hidden = [person for person in frame.persons if not person.counts]
    boxes = box_array(found)
    pairs = pair(boxes, box_array(asked), box_array(hidden), rules.least_iou)
    hit = set(pairs)
    for detection, box, index in zip(found, boxes, pairs, strict=True):
        at = (detection.x, detection.y, detection.w, detection.h)
        if index >= 0:
            person = asked[index]
            band, distance = rules.key_of(person.distance_m), _distance(detection, person)
            yield Match("hit", band, at, detection.score, person.id, distance=distance)
            continue
        false = index == FALSE and frame.complete and _share_within(box, frame.ignore).max(initial=0.0) < INSIDE
        cause = _cause(box, frame, asked, hit, hidden) if false else ""
        band = _detected_band(detection, frame, rules)
        yield Match("false" if false else "spared", band, at, detection.score, cause=cause)
    for number, person in enumerate(asked):
        if number not in hit:
            yield Match("missed", rules.key_of(person.distance_m), person.box, person=person.id)


def _distance(detection: PersonDetection, person: Person) -> MeasuredDistance | None:
    """The detected distance beside the true one."""
    value, std, true = detection.distance_m, detection.distance_std_m, person.distance_m
    return MeasuredDistance(value, std, true) if value is not None and std is not None and true else None


def _by_presence(frame: LabelledFrame, found: Sequence[PersonDetection], rules: Rules) -> Iterable[Match]:
    """One match for each band with a person or a detection."""
    there = {rules.key_of(person.distance_m) for person in frame.persons if person.counts}
    perhaps = {rules.key_of(person.distance_m) for person in frame.persons if not person.counts}
    within = (_share_within(box, frame.ignore).max(initial=0.0) for box in box_array(found))
    scored = [each for each, share in zip(found, within, strict=True) if share < INSIDE]
    seen = {_detected_band(each, frame, rules): each.score for each in reversed(scored)}
    if UNKNOWN in there and scored:
        # Any detection finds a person of unknown distance.
        seen[UNKNOWN] = scored[0].score
    for band in rules.keys:
        if band in there:
            yield Match("hit", band, score=seen[band]) if band in seen else Match("missed", band)
        elif band in seen:
            false = frame.complete and band not in perhaps
            yield Match("false" if false else "spared", band, score=seen[band])


def _detected_band(detection: PersonDetection, frame: LabelledFrame, rules: Rules) -> str:
    return rules.key_of(detection.distance_m if frame.ranged else None)


def _cause(
    box: np.ndarray, frame: LabelledFrame, asked: Sequence[Person], hit: set[int], hidden: Sequence[Person]
) -> str:
    """Cause of a false positive: the person or object that it overlaps most."""
    causes = [DOUBLE if number in hit else POOR_BOX for number in range(len(asked))]
    causes += [HARDLY_VISIBLE] * len(hidden) + [each.kind for each in frame.objects]
    if not causes:
        return NOTHING_KNOWN
    overlaps = iou(box, box_array([*asked, *hidden, *frame.objects]))
    best = int(np.argmax(overlaps))
    if overlaps[best] >= NEAR_IOU:
        return causes[best]
    # A small detection on a large object, such as a head on a poster.
    inside = _share_within(box, frame.objects)
    return frame.objects[int(np.argmax(inside))].kind if inside.max(initial=0.0) >= INSIDE else NOTHING_KNOWN


def _share_within(box: np.ndarray, regions: Sequence[Region]) -> np.ndarray:
    """Share of ``box`` that lies in each of ``regions``."""
    area = box[2] * box[3]
    return shared_area(box, box_array(regions)) / area if area > 0 else np.zeros(len(regions))


def box_array(items: Iterable[Region | PersonDetection]) -> np.ndarray:
    """Boxes as an array of shape (n, 4)."""
    return np.array([(each.x, each.y, each.w, each.h) for each in items], dtype=np.float64).reshape(-1, 4)
