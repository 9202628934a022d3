"""Average precision and recall as COCO defines them, with the figures that pycocotools gives for boxes.

Source: Lin et al., "Microsoft COCO: Common Objects in Context" (2014), and the evaluation of its challenges.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from socialbot.core.messages import PersonDetection
from socialbot.vision.detector import shared_area
from socialbot.vision.metrics.frames import LabelledFrame
from socialbot.vision.metrics.matches import box_array, ranked

THRESHOLDS = np.linspace(0.5, 0.95, 10)
"""IoU thresholds."""

RECALLS = np.linspace(0.0, 1.0, 101)
"""Recalls at which the precision is sampled."""

MOST = 100
"""Detections of one image beyond this number, best first, are left out."""

SIZES = {"all": (0.0, 1e10), "small": (0.0, 32.0**2), "medium": (32.0**2, 96.0**2), "large": (96.0**2, 1e10)}
"""Areas of people, square pixels; both ends are included."""

_EVERYWHERE = (-1e9, -1e9, 4e9, 4e9)


@dataclass(frozen=True)
class CocoImage:
    """Labels and detections of one image.

    Args:
        people: Boxes, shape (n, 4).
        areas: Areas of the people, shape (n,).
        crowd: Which boxes are regions that may hold any number of people, shape (n,).
        ignore: Which people are not scored, shape (n,); regions are never scored.
        found: Boxes of the detector, best first, shape (m, 4).
        scores: Their scores, shape (m,).
    """

    people: np.ndarray
    areas: np.ndarray
    crowd: np.ndarray
    ignore: np.ndarray
    found: np.ndarray
    scores: np.ndarray


@dataclass(frozen=True)
class CocoScore:
    """Figures of COCO; None without people.

    Args:
        ap: Average precision, mean over the IoU thresholds .50, .55, ... .95.
        ap50: At an IoU of .50.
        ap75: At an IoU of .75.
        ap_small: Of people below 32x32 pixels.
        ap_medium: Of people from 32x32 to 96x96 pixels.
        ap_large: Of people above 96x96 pixels.
        ar: Average recall with up to 100 detections an image.
    """

    ap: float | None = None
    ap50: float | None = None
    ap75: float | None = None
    ap_small: float | None = None
    ap_medium: float | None = None
    ap_large: float | None = None
    ar: float | None = None


def coco_image(frame: LabelledFrame, found: Iterable[PersonDetection], least_visible: float) -> CocoImage:
    """Labels and detections of a frame; people less visible than ``least_visible`` are not scored."""
    people, best = frame.persons, ranked(found)
    boxes = np.vstack([box_array(people), box_array(frame.ignore)])
    if not frame.complete:
        # More people may be anywhere.
        boxes = np.vstack([boxes, _EVERYWHERE])
    crowd = np.arange(len(boxes)) >= len(people)
    areas = np.prod(boxes[:, 2:], axis=1)
    areas[: len(people)] = [
        area if person.area is None else person.area for person, area in zip(people, areas, strict=False)
    ]
    hidden = np.array([each.ignore or each.visible < least_visible for each in people], bool)
    return CocoImage(
        boxes,
        areas,
        crowd,
        np.append(hidden, np.ones(len(boxes) - len(people), bool)),
        box_array(best),
        np.array([each.score for each in best], np.float64),
    )


def coco_score(images: Iterable[CocoImage]) -> CocoScore:
    """Score the detections of all images, whose order decides between equal scores."""
    kept = list(images)
    precision: dict[str, np.ndarray | None] = {}
    recall: dict[str, float | None] = {}
    for size, limits in SIZES.items():
        results = [_match(image, limits) for image in kept]
        precision[size], recall[size] = _accumulate(results)

    def mean(size: str, least_iou: float | None = None) -> float | None:
        values = precision[size]
        if values is None:
            return None
        return float(np.mean(values if least_iou is None else values[np.isclose(THRESHOLDS, least_iou)]))

    return CocoScore(
        ap=mean("all"),
        ap50=mean("all", 0.5),
        ap75=mean("all", 0.75),
        ap_small=mean("small"),
        ap_medium=mean("medium"),
        ap_large=mean("large"),
        ar=recall["all"],
    )


@dataclass(frozen=True)
class _Matched:
    """Detections of an image with, by threshold, whether each has a person and is scored; and the scored people."""

    scores: np.ndarray
    hit: np.ndarray
    scored: np.ndarray
    people: int


def _match(image: CocoImage, limits: tuple[float, float]) -> _Matched:
    low, high = limits
    ignore = image.ignore | (image.areas < low) | (image.areas > high)
    order = np.argsort(ignore, kind="stable")
    people, crowd, ignore = image.people[order], image.crowd[order], ignore[order]
    scored_people = int(np.count_nonzero(~ignore))
    found, count = image.found[:MOST], min(len(image.found), MOST)
    free = np.ones((len(THRESHOLDS), len(people)), bool)
    hit = np.zeros((len(THRESHOLDS), count), bool)
    spared = np.zeros((len(THRESHOLDS), count), bool)
    every = np.arange(len(THRESHOLDS))
    least = np.minimum(THRESHOLDS, 1 - 1e-10)[:, None]
    for number, box in enumerate(found):
        overlaps = _overlaps(box, people, crowd)
        possible = (free | crowd) & (overlaps >= least)
        for part in (slice(0, scored_people), slice(scored_people, None)):
            # Of equal overlaps, the last.
            there = np.where(possible[:, part], overlaps[part], -1.0)[:, ::-1]
            if not there.shape[1]:
                continue
            best = there.shape[1] - 1 - np.argmax(there, axis=1) + (part.start or 0)
            taken = (there.max(axis=1) >= 0) & ~hit[:, number]
            hit[taken, number] = True
            spared[taken, number] = ignore[best[taken]]
            free[every[taken], best[taken]] = False
    areas = found[:, 2] * found[:, 3]
    spared |= ~hit & ((areas < low) | (areas > high))
    return _Matched(image.scores[:MOST], hit, ~spared, scored_people)


def _overlaps(box: np.ndarray, people: np.ndarray, crowd: np.ndarray) -> np.ndarray:
    """IoU with each person; for a region, the share of the box that lies in it."""
    shared = shared_area(box, people)
    own = box[2] * box[3]
    whole = np.where(crowd, own, own + people[:, 2] * people[:, 3] - shared)
    return np.divide(shared, whole, out=np.zeros(len(people)), where=whole > 0)


def _accumulate(results: Sequence[_Matched]) -> tuple[np.ndarray | None, float | None]:
    """Precision at each threshold and recall, shape (10, 101), and the mean recall."""
    people = sum(each.people for each in results)
    if not people:
        return None, None
    scores = np.concatenate([each.scores for each in results])
    order = np.argsort(-scores, kind="stable")
    hit = np.hstack([each.hit for each in results])[:, order]
    scored = np.hstack([each.scored for each in results])[:, order]
    hits = np.cumsum(hit & scored, axis=1, dtype=np.float64)
    false = np.cumsum(~hit & scored, axis=1, dtype=np.float64)
    recall = hits / people
    precision = hits / (hits + false + np.spacing(1))
    # The best precision at this or a higher recall.
    falling = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
    sampled = np.zeros((len(THRESHOLDS), len(RECALLS)))
    for row in range(len(THRESHOLDS)):
        at = np.searchsorted(recall[row], RECALLS, side="left")
        good = at < len(scores)
        sampled[row, good] = falling[row, at[good]]
    return sampled, float(recall[:, -1].mean()) if len(scores) else 0.0
