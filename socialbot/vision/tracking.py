"""Track people from frame to frame: Kalman filter, assignment and track state."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from socialbot.core.clock import SECOND
from socialbot.vision.detector import clip, iou, same_head

__all__ = ["Cut", "BoxFilter", "Track", "Tracker", "assign", "cut_off"]


def assign(costs: np.ndarray, limit: float) -> list[tuple[int, int]]:
    """The pairs (row, column) of ``costs``, shape (n, m), with the least sum, each row and column at most once.

    A pair that costs ``limit`` or more is none; staying alone costs as much as ``limit``. Pairs come in the order
    of rows. Infinite costs are allowed.
    """
    rows, columns = costs.shape
    if not rows or not columns:
        return []
    # Moving one heap of earth from each row to some column, in whole heaps, is the assignment problem.
    bounded = np.minimum(costs, limit).astype(np.float32)
    flow = cv2.EMD(_heaps(rows), _heaps(columns), cv2.DIST_USER, bounded)[2]
    return [(int(row), int(column)) for row, column in np.argwhere(flow > 0.5) if costs[row, column] < limit]


def _heaps(count: int) -> np.ndarray:
    """So many heaps of weight 1; where they lie (the second column) does not matter."""
    return np.tile(np.array([1, 0], np.float32), (count, 1))


_EDGE_SHARE, _BOX_SHARE = 0.005, 0.02
"""A box that comes so near to the picture's edge is cut off by it: shares of the picture's size and of its own."""

_MEASURED = np.array([0.03, 0.03, 0.05, 0.06])
_FIRST_SPEED = np.array([0.8, 0.2, 0.5, 0.3])
_RESTLESS = np.array([0.8, 0.15, 0.35, 0.2])
_EASE_S = np.array([1.5, 0.7, 0.7, 0.4])
_LEAST_PX = 1.0


class Cut(NamedTuple):
    """Which sides of a box the picture's edge cuts off."""

    left: bool = False
    top: bool = False
    right: bool = False
    bottom: bool = False


def cut_off(box: np.ndarray, width: float, height: float) -> Cut:
    """Which sides of ``box`` (x, y, w, h) the edges of a picture of ``width`` x ``height`` pixels cut off."""
    x, y, w, h = box
    across, down = _EDGE_SHARE * width + _BOX_SHARE * w, _EDGE_SHARE * height + _BOX_SHARE * h
    return Cut(bool(x <= across), bool(y <= down), bool(x + w >= width - across), bool(y + h >= height - down))


class BoxFilter:
    """Middle x, top y, height and width of a person's box (pixels), each with a speed that wears off.

    The four are independent Kalman filters of position and speed. All noise is relative to the height: a
    person is as restless near the camera as far away. Where the picture cuts the box off the rest is
    taken from the prediction, so that the state is the whole person.
    """

    __slots__ = ("_both", "_speed_variance", "speed", "value", "variance")

    def __init__(self, box: np.ndarray) -> None:
        """Begins with ``box``: x, y, w, h."""
        x, y, w, h = box
        self.value = np.array([x + w / 2, y, max(h, _LEAST_PX), max(w, _LEAST_PX)])
        self.speed = np.zeros(4)
        self.variance = (_MEASURED * self.value[2]) ** 2
        self._both = np.zeros(4)
        self._speed_variance = (_FIRST_SPEED * self.value[2]) ** 2

    @property
    def box(self) -> np.ndarray:
        """The whole person: x, y, w, h, shape (4,); may reach beyond the picture."""
        middle, top, height, width = self.value
        return np.array([middle - width / 2, top, width, height])

    def predict(self, seconds: float) -> None:
        """Lets ``seconds`` (0 or more) pass."""
        # With ease e = exp(-t / T) a speed v moves by T (1 - e) v in the time t.
        ease = np.exp(-seconds / _EASE_S)
        path = _EASE_S * (1 - ease)
        unrest, time = (_RESTLESS * self.value[2]) ** 2, min(seconds, 1.0)
        self.value = self.value + path * self.speed
        self.value[2:] = np.maximum(self.value[2:], _LEAST_PX)
        self.speed = ease * self.speed
        self.variance = self.variance + path * (2 * self._both + path * self._speed_variance) + unrest * time**3 / 3
        self._both = ease * (self._both + path * self._speed_variance) + unrest * time**2 / 2
        self._speed_variance = ease**2 * self._speed_variance + unrest * time

    def correct(self, box: np.ndarray, cut: Cut, *, feet_hidden: bool = False) -> None:
        """Takes in that the person's box was seen as ``box``: x, y, w, h, clipped to the picture.

        With ``feet_hidden`` something stands before the lower part: then the height stays as predicted.
        """
        measured, seen = self._whole(box, cut, feet_hidden)
        noise = (_MEASURED * measured[2]) ** 2
        share = np.where(seen, self.variance / (self.variance + noise), 0.0)
        pull = np.where(seen, self._both / (self.variance + noise), 0.0)
        missed = measured - self.value
        self.value = self.value + share * missed
        self.speed = self.speed + pull * missed
        self._speed_variance = self._speed_variance - pull * self._both
        self.variance = (1 - share) * self.variance
        self._both = (1 - share) * self._both

    def _whole(self, box: np.ndarray, cut: Cut, feet_hidden: bool) -> tuple[np.ndarray, np.ndarray]:
        """What was measured of the whole person, shape (4,), and which of the four were."""
        x, y, w, h = box
        _, _, height, width = self.value
        # What is cut off is at least as large as what can be seen of it.
        narrow, short = (cut.left or cut.right) and width > w, (cut.top or cut.bottom or feet_hidden) and height > h
        width, height = (width if narrow else w), (height if short else h)
        middle, top = x + w / 2, y
        if narrow and cut.left is not cut.right:
            middle = x + w - width / 2 if cut.left else x + width / 2
        if short and cut.top and not cut.bottom:
            top = y + h - height
        seen = np.array([not (narrow and cut.left and cut.right), not (cut.top and cut.bottom), not short, not narrow])
        return np.array([middle, top, height, width]), seen

    def spread(self) -> tuple[float, float]:
        """Standard errors of the middle and of the top, in pixels."""
        return math.sqrt(self.variance[0]), math.sqrt(self.variance[1])


_LEAST_FIT = 0.2
"""Overlap (IoU, widened by how unsure the prediction is) from which a sure box may belong to a track."""
_LEAST_FIT_WEAK = 0.4
"""The same for a weak box."""
_ABSENCE_COSTS = 0.15
"""How much better (in overlap) a track that was not seen for a second must fit than one that was."""
_SAME = 0.5
"""A predicted box that overlaps a seen one this much is hidden behind it, or is the same person twice; so is one that
lies within it."""
_WITHIN = 0.8
"""A box that lies within a taken one by this share may be a part of that person, twice found."""
_RECENT_S = 0.5
"""So long a track that was not seen may go on with a weak box."""
_HEADS_ALIKE = 0.1
"""Tops that are this near, as a share of the height, are those of one head."""
_GAP_S = 0.5
"""After so long without a picture nothing can be waited for: what is sure is believed at once."""
_DOUBT_S = 0.35
"""So long a new track waits to be seen a second time."""
_TRUSTED_HITS = 3
_NEWS = 0.2
"""The weight of the newest score in the usual one."""
_DRIFT = 0.35
"""A prediction is trusted while its standard error is below this share of the box's width."""
_OUTWARD = 0.1
"""Heights a second, from which somebody at the picture's edge is leaving."""
_SUDDEN = 0.8
"""When a box is suddenly shorter than this share of what was expected, and its top is not, something hides the feet."""
_HIDDEN_S = 1.5
"""So long hidden feet are believed in."""


@dataclass(frozen=True, eq=False)
class Track:
    """One person at one moment.

    ``box`` is what the picture shows: x, y, w, h, shape (4,), in pixels; for ``unseen_s`` > 0, so long since
    the detector last saw them, it is the prediction and ``score`` that of the last detection. ``cut`` tells which
    sides the picture cuts off, ``feet_hidden`` that something stands before the lower part.
    """

    id: str
    box: np.ndarray
    score: float
    unseen_s: float
    cut: Cut
    feet_hidden: bool = False


@dataclass(eq=False)
class _Person:
    """A track from the inside; without ``id`` it is not confirmed yet."""

    motion: BoxFilter
    box: np.ndarray
    score: float
    cut: Cut
    id: str = ""
    hits: int = 1
    misses: int = 0
    unseen_s: float = 0.0
    usual_score: float = 0.0
    best: float = 0.0
    """The highest score."""
    hidden_s: float = 0.0

    @property
    def feet_hidden(self) -> bool:
        return self.hidden_s > 0


class Tracker:
    """Follows people through the frames of one recording.

    ``sure`` is the score of a box without which there is no track; those from ``weak`` on only support it: they go on
    tracks that are known and count as long as these usually score ``sure``, or are the first sign of somebody. A
    track is published when it has been seen ``confirm`` times, or at once when its score is as far above ``sure`` as
    that is above ``weak``, in a first picture, and after a gap; but never at once within somebody else. One that is
    not seen is published, as predicted, for ``bridge_s`` at most, and only if it usually scores ``sure`` and did so
    last, the prediction can be trusted, and the person is not leaving the picture or within somebody else. It is
    remembered for ``keep_s``. Ids are never used again by the same tracker.

    The same boxes give the same tracks, in whatever order they come.
    """

    def __init__(
        self,
        sure: float,
        weak: float,
        *,
        confirm: int = 2,
        bridge_s: float = 0.5,
        keep_s: float = 2.0,
    ) -> None:
        self.sure = sure
        self.weak = weak
        self.confirm = confirm
        self.bridge_s = bridge_s
        self.keep_s = keep_s
        self._persons: list[_Person] = []
        self._stamp: int | None = None
        self._count = 0

    def update(
        self, stamp_ns: int, boxes: np.ndarray, scores: np.ndarray, size: tuple[int, int] | None = None
    ) -> tuple[Track, ...]:
        """The people in the picture taken at ``stamp_ns``, best score first.

        ``boxes`` is (n, 4) as x, y, w, h in pixels, ``scores`` (n,); ``size`` is the picture's width and height,
        without which nothing counts as cut off. A stamp before the last one is a new recording.
        """
        seconds = self._pass_to(stamp_ns)
        for person in self._persons:
            person.motion.predict(seconds or 0.0)
        order = np.lexsort((*np.asarray(boxes, np.float64).reshape(-1, 4).T[::-1], -np.asarray(scores, np.float64)))
        boxes, scores = np.asarray(boxes, np.float64).reshape(-1, 4)[order], np.asarray(scores, np.float64)[order]
        cuts = [cut_off(box, *size) if size else Cut() for box in boxes]
        expected = self._expected(size)
        taken = self._match(expected, boxes, scores)
        for number, person in enumerate(self._persons):
            if number in taken:
                index = taken[number]
                self._see(person, boxes[index], float(scores[index]), cuts[index], seconds or 0.0)
            else:
                person.misses += 1
                person.unseen_s += seconds or 0.0
        seen = list(taken.values())
        # The largest first: a part is known by the whole.
        left = [each for each in np.argsort(-np.prod(boxes[:, 2:], axis=1), kind="stable").tolist() if each not in seen]
        for index in [index for index in left if scores[index] >= self.sure]:
            at_once = self._after_gap(seconds) or bool(scores[index] >= 2 * self.sure - self.weak)
            self._begin(boxes[index], float(scores[index]), cuts[index], boxes[seen], at_once=at_once)
            seen.append(index)
        for index in [index for index in left if self.weak <= scores[index] < self.sure]:
            self._begin(boxes[index], float(scores[index]), cuts[index], boxes[seen], at_once=False)
        self._persons = [person for person in self._persons if self._kept(person, size)]
        return self._published(size)

    def _pass_to(self, stamp_ns: int) -> float | None:
        """Seconds since the last picture; None when there is none, or time has begun anew."""
        before, self._stamp = self._stamp, stamp_ns
        if before is None or stamp_ns < before:
            self._persons = []
            return None
        seconds = (stamp_ns - before) / SECOND
        self._persons = [person for person in self._persons if person.unseen_s + seconds <= max(self.keep_s, _GAP_S)]
        return seconds

    @staticmethod
    def _after_gap(seconds: float | None) -> bool:
        return seconds is None or seconds >= _GAP_S

    def _expected(self, size: tuple[int, int] | None) -> np.ndarray:
        """Where the picture should show each person: (n, 4)."""
        boxes = np.array([person.motion.box for person in self._persons]).reshape(-1, 4)
        return clip(boxes, *size) if size else boxes

    def _match(self, expected: np.ndarray, boxes: np.ndarray, scores: np.ndarray) -> dict[int, int]:
        """Which box each person gets: numbers of persons and of boxes."""
        sure = np.flatnonzero(scores >= self.sure)
        weak = np.flatnonzero((scores >= self.weak) & (scores < self.sure))
        known = [number for number, person in enumerate(self._persons) if person.id]
        new = [number for number, person in enumerate(self._persons) if not person.id]
        taken = self._assigned(known, sure, expected, boxes, _LEAST_FIT)
        near = [number for number in known if number not in taken and self._persons[number].unseen_s <= _RECENT_S]
        weak = weak[~_within(boxes[weak], boxes[list(taken.values())]).any(axis=1)]
        taken |= self._assigned(near, weak, expected, boxes, _LEAST_FIT_WEAK)
        rest = np.array([index for index in (*sure, *weak) if index not in taken.values()], np.intp)
        return taken | self._assigned(new, rest, expected, boxes, _LEAST_FIT)

    def _assigned(
        self, numbers: list[int], indices: np.ndarray, expected: np.ndarray, boxes: np.ndarray, least: float
    ) -> dict[int, int]:
        costs = np.ones((len(numbers), len(indices)))
        for row, number in enumerate(numbers):
            fit = _fit(self._persons[number].motion, expected[number], boxes[indices])
            absence = _ABSENCE_COSTS * min(self._persons[number].unseen_s, 1.0)
            costs[row] = np.where(fit >= least, 1 - fit + absence, np.inf)
        return {numbers[row]: int(indices[column]) for row, column in assign(costs, 1.0)}

    def _see(self, person: _Person, box: np.ndarray, score: float, cut: Cut, seconds: float) -> None:
        """Takes in that ``person`` was seen in ``box``."""
        _, top, height, _ = person.motion.value
        short = box[3] < _SUDDEN * height and abs(box[1] - top) < _HEADS_ALIKE * height
        hidden = short and not (cut.top or cut.bottom) and person.hits >= _TRUSTED_HITS
        person.hidden_s = person.hidden_s + max(seconds, 1e-9) if hidden and person.hidden_s < _HIDDEN_S else 0.0
        person.motion.correct(box, cut, feet_hidden=person.feet_hidden)
        person.box, person.score, person.cut = box, score, cut
        person.hits, person.misses, person.unseen_s = person.hits + 1, 0, 0.0
        # Of a track that begins with weak boxes nothing is usual before the first sure one.
        first = person.best < self.sure <= score
        person.usual_score = score if first else person.usual_score + _NEWS * (score - person.usual_score)
        person.best = max(person.best, score)
        if not person.id and person.hits >= self.confirm and person.best >= self.sure:
            self._confirm(person)

    def _begin(self, box: np.ndarray, score: float, cut: Cut, others: np.ndarray, *, at_once: bool) -> None:
        """Begins a track, unless ``box`` is a part of somebody in ``others`` (n, 4)."""
        within = _within(box[None], others)[0]
        # Whoever the picture cuts off below is near, and too large to be seen within somebody: that is an arm.
        if same_head(box, others, _WITHIN).any() or (cut.bottom and within.any()):
            return
        person = _Person(BoxFilter(box), box, score, cut, usual_score=score, best=score)
        self._persons.append(person)
        if score >= self.sure and (self.confirm <= 1 or (at_once and not within.any())):
            self._confirm(person)

    def _confirm(self, person: _Person) -> None:
        self._count += 1
        person.id = f"t{self._count}"

    def _kept(self, person: _Person, size: tuple[int, int] | None) -> bool:
        """Whether ``person`` may still be in the picture."""
        if not person.misses:
            return True
        if not person.id:
            return person.misses < 2 or person.unseen_s <= _DOUBT_S
        if person.unseen_s > self.keep_s:
            return False
        return size is None or bool((clip(person.motion.box[None], *size)[0, 2:] > 0).all())

    def _published(self, size: tuple[int, int] | None) -> tuple[Track, ...]:
        likely = [person for person in self._persons if person.id and not person.misses and self._likely(person)]
        seen = _one_a_head(likely)
        boxes = np.array([person.box for person in seen]).reshape(-1, 4)
        tracks = [Track(person.id, person.box, person.score, 0.0, person.cut, person.feet_hidden) for person in seen]
        for person in self._persons:
            if person.id and person.misses and self._trusted(person, size):
                box = clip(person.motion.box[None], *size)[0] if size else person.motion.box
                if not ((iou(box, boxes) > _SAME) | _within(box[None], boxes)[0]).any():
                    cut = cut_off(box, *size) if size else Cut()
                    tracks.append(Track(person.id, box, person.score, person.unseen_s, cut))
        return tuple(sorted(tracks, key=lambda track: (-track.score, int(track.id[1:]))))

    def _likely(self, person: _Person) -> bool:
        """Whether somebody is likely enough; a track of weak boxes fades away."""
        return max(person.score, person.usual_score) >= self.sure

    def _trusted(self, person: _Person, size: tuple[int, int] | None) -> bool:
        """Whether the prediction of somebody who was not seen is good enough to be published."""
        if not 0 < person.unseen_s <= self.bridge_s or person.hits < _TRUSTED_HITS:
            return False
        # Whoever goes round a corner gets weaker first; a flicker comes suddenly.
        if min(person.score, person.usual_score) < self.sure:
            return False
        motion = person.motion
        if motion.spread()[0] > _DRIFT * motion.value[3]:
            return False
        if size is None:
            return True
        cut = cut_off(motion.box, *size)
        outward = _OUTWARD * motion.value[2]
        return not ((cut.left and motion.speed[0] < -outward) or (cut.right and motion.speed[0] > outward))


def _one_a_head(persons: list[_Person]) -> list[_Person]:
    """Of those ``persons`` whose boxes have the same head only the one that was seen most often."""
    boxes = np.array([person.box for person in persons]).reshape(-1, 4)
    if _within(boxes, boxes).sum() == len(persons):
        return persons
    kept: list[_Person] = []
    for person in sorted(persons, key=lambda person: -person.hits):
        if not same_head(person.box, np.array([each.box for each in kept]).reshape(-1, 4), _WITHIN).any():
            kept.append(person)
    return kept


def _within(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Which of ``boxes`` (n, 4) lie, nearly all of them, within which of ``others`` (m, 4): bool, shape (n, m)."""
    corner = np.maximum(boxes[:, None, :2], others[None, :, :2])
    opposite = np.minimum(boxes[:, None, :2] + boxes[:, None, 2:], others[None, :, :2] + others[None, :, 2:])
    shared = np.prod(np.clip(opposite - corner, 0, None), axis=2)
    return shared > _WITHIN * np.prod(boxes[:, None, 2:], axis=2)


def _fit(motion: BoxFilter, expected: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """How well each of ``boxes`` (n, 4) fits the box ``expected`` (4,): 0 to 1, shape (n,).

    It is their IoU, both widened by the standard error of the prediction: the less is known of the speed, the
    farther somebody may have gone.
    """
    across, down = motion.spread()
    across, down = min(across, motion.value[2] / 2), min(down, motion.value[2] / 4)
    margin = np.array([-across, -down, 2 * across, 2 * down])
    return iou(expected + margin, boxes + margin)
