"""Verdicts: what became of each person and each detection in a frame.

By boxes: the detections, best score first, take the free person they overlap most, given an IoU of at least
``least_iou`` (see `socialbot.vision.metrics.scores`). Hits and misses belong to the distance band of the true person, a
false alarm to that of the distance which the detector gave it. By presence: in each band, is somebody there or not?

Hardly visible people and what lies in an ``ignore`` box are neither asked for nor held against a detector. In a frame
that is not complete nothing is a false alarm.
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

NEAR_IOU = 0.1
"""From this overlap on, a false alarm is taken to come from what it overlaps."""
INSIDE = 0.5
"""A detection of which this share lies within a thing or an ignored box belongs to it."""

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
"""What the causes mean that are not the kind of a thing."""


@dataclass(frozen=True)
class Rules:
    """How frames are judged: distance ``bands`` (m), the IoU of a hit, by boxes or by presence."""

    bands: tuple[Band, ...] = BANDS
    least_iou: float = LEAST_IOU
    presence: bool = False

    @property
    def keys(self) -> tuple[str, ...]:
        """The names of all bands, nearest first, then those of people beyond them and of unknown distance."""
        return (*map(band_key, self.bands), OUTSIDE, UNKNOWN)

    def key_of(self, distance_m: float | None) -> str:
        """The name of the band that ``distance_m`` is in."""
        if distance_m is None:
            return UNKNOWN
        return next((band_key(band) for band in self.bands if band[0] <= distance_m < band[1]), OUTSIDE)


@dataclass(frozen=True)
class Match:
    """One hit, false alarm or missed person, or a detection that is spared.

    ``score`` is the detection's, and ``person`` the true person's id where there is one. ``box`` is the detection's,
    of a missed person the true one; by presence it is empty. ``cause`` says where a false alarm comes from.
    """

    kind: Kind
    band: str
    box: Box = (0.0, 0.0, 0.0, 0.0)
    score: float = 0.0
    person: str = ""
    cause: str = ""


def band_key(band: Band) -> str:
    """A band as ``--bands`` and the JSON name it: "2-10"."""
    return f"{band[0]:g}-{band[1]:g}"


def parse_bands(text: str) -> tuple[Band, ...]:
    """The bands in "0-2,2-10,10-20". Raises ParameterError when they overlap, or are no bands."""
    bands = tuple(_band(word.strip(), text) for word in text.split(","))
    for nearer, farther in itertools.pairwise(bands):
        if farther[0] < nearer[1]:
            raise ParameterError(
                f"{band_key(farther)} does not lie beyond {band_key(nearer)}",
                where="--bands",
                remedy="name the bands from near to far, without overlap",
            )
    return bands


def _band(word: str, text: str) -> Band:
    try:
        low, high = map(float, word.split("-"))
    except ValueError:
        low, high = 0.0, 0.0
    if not 0 <= low < high < math.inf:
        raise ParameterError(
            f"{word!r} in {text!r} is no band",
            where="--bands",
            remedy="write metres as NEAR-FAR, such as 0-2,2-10,10-20",
        )
    return low, high


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


def judge(frame: LabelledFrame, found: Iterable[PersonDetection], rules: Rules) -> tuple[Match, ...]:
    """The verdicts on what was ``found`` in ``frame``, whatever its order."""
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
    """One verdict for each band where somebody is, or seems to be."""
    there, perhaps, seen = set[str](), set[str](), dict[str, float]()
    for person in frame.persons:
        (there if person.counts else perhaps).add(rules.key_of(person.distance_m))
    ignored = _array(frame.ignore)
    scored = [each for each in found if not _within(np.array((each.x, each.y, each.w, each.h)), ignored)]
    for detection in scored:
        # The first of a band is its best.
        seen.setdefault(rules.key_of(detection.distance_m if frame.ranged else None), detection.score)
    if UNKNOWN in there and scored:
        # Somebody of unknown distance is found by whatever is found.
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
    """Where a false alarm comes from: what it overlaps most of all that is known to be there."""
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
    # A small detection on a large thing, such as a head on a poster.
    things = _array((thing.x, thing.y, thing.w, thing.h) for thing in frame.objects)
    inside = _inside(box, things)
    return frame.objects[int(np.argmax(inside))].kind if len(things) and inside.max() >= INSIDE else NOTHING_KNOWN


def _within(box: np.ndarray, regions: np.ndarray) -> bool:
    return bool(len(regions)) and bool(_inside(box, regions).max() >= INSIDE)


def _inside(box: np.ndarray, regions: np.ndarray) -> np.ndarray:
    """The share of ``box``, shape (4,), that lies in each of ``regions``, (n, 4)."""
    corner = np.maximum(box[:2], regions[:, :2])
    opposite = np.minimum(box[:2] + box[2:], regions[:, :2] + regions[:, 2:])
    area = box[2] * box[3]
    shared = np.prod(np.clip(opposite - corner, 0, None), axis=1)
    return shared / area if area > 0 else np.zeros(len(regions))


def _array(boxes: Iterable[Box]) -> np.ndarray:
    return np.array(list(boxes), dtype=np.float64).reshape(-1, 4)
