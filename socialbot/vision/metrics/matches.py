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
from typing import Literal

import numpy as np

from socialbot.core.errors import ParameterError
from socialbot.core.messages import PersonDetection
from socialbot.vision.detector import iou
from socialbot.vision.metrics.frames import Box, LabelledFrame, Person

__all__ = [
    "BANDS", "Band", "CAUSES", "FALSE", "OUTSIDE", "Rules", "SPARED", "UNKNOWN", "Match", "band_key", "judge", "pair",
    "parse_bands", "ranked",
]  # fmt: skip

Band = tuple[float, float]
"""From (included) and to (excluded), m."""

BANDS: tuple[Band, ...] = ((0.0, 2.0), (2.0, 10.0), (10.0, 20.0))
OUTSIDE, UNKNOWN = "outside", "unknown"
LEAST_IOU = 0.5
FALSE, SPARED = -1, -2
"""`pair` returns these for a false positive and for a detection that is not scored."""

Kind = Literal["hit", "false", "missed", "spared"]

NEAR_IOU = 0.1  # A false positive is caused by the region it overlaps by this IoU.
INSIDE = 0.5  # A detection belongs to an object or ignored region that contains this share of it.

POOR_BOX = "poor box"
DOUBLE = "double"
HARDLY_VISIBLE = "hardly visible person"
NOTHING_KNOWN = "nothing known"
CAUSES = {
    POOR_BOX: f"a person is there, but the box overlaps theirs only by {NEAR_IOU:g} to the IoU asked for",
    DOUBLE: "a person is there, and another detection has found them",
    HARDLY_VISIBLE: "overlaps somebody of whom less than a quarter is visible",
    NOTHING_KNOWN: "nothing that the truth knows of is there",
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
        """Names of all bands, nearest first, then "outside" and "unknown"."""
        return (*map(band_key, self.bands), OUTSIDE, UNKNOWN)

    def key_of(self, distance_m: float | None) -> str:
        """Name of the band of ``distance_m``."""
        if distance_m is None:
            return UNKNOWN
        return next((band_key(band) for band in self.bands if band[0] <= distance_m < band[1]), OUTSIDE)


@dataclass(frozen=True)
class Match:
    """Result of matching one detection or person.

    Args:
        kind: "hit" (true positive), "false" (false positive), "missed", or "spared" (not scored).
        band: Name of the distance band.
        box: Box of the detection, or of the missed person; empty when matching by presence.
        score: Score of the detection.
        person: Id of the matched or missed person.
        cause: Cause of a false positive.
    """

    kind: Kind
    band: str
    box: Box = (0.0, 0.0, 0.0, 0.0)
    score: float = 0.0
    person: str = ""
    cause: str = ""


def band_key(band: Band) -> str:
    """Name of a band in ``--bands`` and JSON: "2-10"."""
    return f"{band[0]:g}-{band[1]:g}"


def parse_bands(text: str) -> tuple[Band, ...]:
    """Parse bands such as "0-2,2-10,10-20". Raises ParameterError for invalid or overlapping bands."""
    bands = tuple(_band(word.strip(), text) for word in text.split(","))
    for nearer, farther in itertools.pairwise(bands):
        if farther[0] < nearer[1]:
            raise ParameterError(
                f"{band_key(farther)} does not lie beyond {band_key(nearer)}",
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
            result.append(SPARED if len(spared) and iou(box, spared).max() >= least_iou else FALSE)
    return result


def ranked(found: Iterable[PersonDetection]) -> list[PersonDetection]:
    """Sort detections by score; box, distance and track break ties, so the input order does not matter."""

    def key(person: PersonDetection) -> tuple[float | str, ...]:
        distance = math.inf if person.distance_m is None else person.distance_m
        return -person.score, person.x, person.y, person.w, person.h, distance, person.track_id

    return sorted(found, key=key)


def judge(frame: LabelledFrame, found: Iterable[PersonDetection], rules: Rules) -> tuple[Match, ...]:
    """Match the detections of a frame."""
    return _by_presence(frame, ranked(found), rules) if rules.presence else _by_boxes(frame, ranked(found), rules)


def _by_boxes(frame: LabelledFrame, found: Sequence[PersonDetection], rules: Rules) -> tuple[Match, ...]:
    asked = [person for person in frame.persons if person.counts]
    hidden = [person for person in frame.persons if not person.counts]
    boxes = _array((each.x, each.y, each.w, each.h) for each in found)
    pairs = pair(boxes, _array(each.box for each in asked), _array(each.box for each in hidden), rules.least_iou)
    hit = {who for who in pairs if who >= 0}
    matches = []
    for detection, box, who in zip(found, boxes, pairs, strict=True):
        at = (detection.x, detection.y, detection.w, detection.h)
        if who >= 0:
            band = rules.key_of(asked[who].distance_m)
            matches.append(Match("hit", band, at, detection.score, asked[who].id))
            continue
        band = rules.key_of(detection.distance_m if frame.ranged else None)
        false = who == FALSE and frame.complete and not _within(box, _array(frame.ignore))
        cause = _cause(box, frame, asked, hit, hidden) if false else ""
        matches.append(Match("false" if false else "spared", band, at, detection.score, cause=cause))
    for number, person in enumerate(asked):
        if number not in hit:
            matches.append(Match("missed", rules.key_of(person.distance_m), person.box, person=person.id))
    return tuple(matches)


def _by_presence(frame: LabelledFrame, found: Sequence[PersonDetection], rules: Rules) -> tuple[Match, ...]:
    """One match for each band with a person or a detection."""
    there, perhaps, seen = set[str](), set[str](), dict[str, float]()
    for person in frame.persons:
        (there if person.counts else perhaps).add(rules.key_of(person.distance_m))
    ignored = _array(frame.ignore)
    scored = [each for each in found if not _within(np.array((each.x, each.y, each.w, each.h)), ignored)]
    for detection in scored:
        seen.setdefault(rules.key_of(detection.distance_m if frame.ranged else None), detection.score)
    if UNKNOWN in there and scored:
        # Any detection finds a person of unknown distance.
        seen[UNKNOWN] = scored[0].score
    matches = []
    for band in rules.keys:
        if band in there:
            matches.append(Match("hit", band, score=seen[band]) if band in seen else Match("missed", band))
        elif band in seen:
            false = frame.complete and band not in perhaps
            matches.append(Match("false" if false else "spared", band, score=seen[band]))
    return tuple(matches)


def _cause(
    box: np.ndarray, frame: LabelledFrame, asked: Sequence[Person], hit: set[int], hidden: Sequence[Person]
) -> str:
    """Cause of a false positive: the person or object that it overlaps most."""
    causes = [
        *((DOUBLE if number in hit else POOR_BOX, person.box) for number, person in enumerate(asked)),
        *((HARDLY_VISIBLE, person.box) for person in hidden),
        *((thing.kind, (thing.x, thing.y, thing.w, thing.h)) for thing in frame.objects),
    ]
    if not causes:
        return NOTHING_KNOWN
    overlaps = iou(box, _array(at for _, at in causes))
    best = int(np.argmax(overlaps))
    if overlaps[best] >= NEAR_IOU:
        return causes[best][0]
    # A small detection on a large object, such as a head on a poster.
    things = _array((thing.x, thing.y, thing.w, thing.h) for thing in frame.objects)
    inside = _inside(box, things)
    return frame.objects[int(np.argmax(inside))].kind if len(things) and inside.max() >= INSIDE else NOTHING_KNOWN


def _within(box: np.ndarray, regions: np.ndarray) -> bool:
    return bool(len(regions)) and bool(_inside(box, regions).max() >= INSIDE)


def _inside(box: np.ndarray, regions: np.ndarray) -> np.ndarray:
    """Share of ``box`` that lies in each of ``regions`` (n, 4)."""
    corner = np.maximum(box[:2], regions[:, :2])
    opposite = np.minimum(box[:2] + box[2:], regions[:, :2] + regions[:, 2:])
    area = box[2] * box[3]
    shared = np.prod(np.clip(opposite - corner, 0, None), axis=1)
    return shared / area if area > 0 else np.zeros(len(regions))


def _array(boxes: Iterable[Box]) -> np.ndarray:
    return np.array(list(boxes), dtype=np.float64).reshape(-1, 4)
