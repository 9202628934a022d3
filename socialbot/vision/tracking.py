"""Track people from frame to frame: Kalman filter, assignment and track state."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from socialbot.core.clock import SECOND
from socialbot.vision.appearance import LIKE, OTHER, UNLIKE, Appearance, clarity_of, noise_of
from socialbot.vision.detector import clip, contained, iou, same_head, shared_area
from socialbot.vision.motion import BoxFilter, Cut, cut_off
from socialbot.vision.reidentification import REMEMBER_S, Locate, LostPeople, TrackedPerson
from socialbot.vision.whereabouts import LastSeen


def assign(costs: np.ndarray, limit: float) -> list[tuple[int, int]]:
    """Solve the assignment problem for ``costs``, shape (n, m), which may be infinite.

    Returns:
        Pairs (row, column) in the order of rows. An unassigned row costs ``limit``; no pair costs that much.
    """
    rows, columns = costs.shape
    if not rows or not columns:
        return []
    # The earth mover's distance of unit weights is an assignment problem.
    bounded = np.minimum(costs, limit).astype(np.float32)
    flow = cv2.EMD(_unit_weights(rows), _unit_weights(columns), cv2.DIST_USER, bounded)[2]
    return [(int(row), int(column)) for row, column in np.argwhere(flow > 0.5) if costs[row, column] < limit]


def _unit_weights(count: int) -> np.ndarray:
    return np.tile(np.array([1, 0], np.float32), (count, 1))


_LEAST_FIT, _LEAST_FIT_WEAK = 0.2, 0.4  # Smallest IoU of a track with a box above the threshold, and with a weak box.
_ABSENCE_COSTS = 0.15  # A track unseen for a second must fit better by this IoU.
_SAME = 0.5  # A prediction that overlaps a detected box this much is hidden by it or a duplicate,
_WITHIN = 0.8  # and so is a new box with the head of another one that contains this share of it.
_DOUBLE = 0.25  # A new track that overlaps another one by this IoU may be a second box of the same person,
_DOUBLE_HITS = 5  # until it has so many sure detections, or a score of `_AT_ONCE`.
_RECENT_S = 0.5  # A track unseen for longer does not continue with a weak box, which is published for as long,
_EXPECTED = 0.7  # if it overlaps the prediction by this IoU.
_HEADS_ALIKE = 0.1  # Box tops closer than this share of the height belong to one head.
_GAP_S = 0.5  # After a longer gap between images, new tracks get an id at once.
_DOUBT_S = 0.35  # A new track waits this long for its second detection.
_TRUSTED_HITS = 3
_AT_ONCE = 0.75  # A new track gets an id at once if its score exceeds the sure one by this share of sure - weak.
_DRIFT = 0.35  # A prediction is trusted while its standard error is below this share of the width.
_COVERED, _COVERED_S = 0.7, 0.25  # If a nearer person covers this share of someone, that one is predicted for so long.
# The last score must be enough to get an id at once: people who were half hidden before have lower ones.
_OUTWARD = 0.1  # A person at the edge leaves the image from this speed, heights per second.
_SUDDEN = 0.8  # Feet are hidden when a box shrinks below this share of the predicted height at the same top,
_HIDDEN_S = 1.5  # for at most this long.

_LOOK_COSTS = 0.5  # A box of clearly another look costs a track as much as this IoU.
_LEAST_MORE = 0.2  # and it must fit better by this.
_UNKNOWN = 0.2  # A box whose colours are not known counts as this much unlike,
_LEAST_FIT_UNKNOWN = 0.4  # and must fit this well.
_FOREIGN = 0.4  # A track that looks so different shows somebody else.
_DECIDING_LOOKS = 5  # The id of a new track may change until it has so many looks.
_LEAST_LOOKS = 3  # So many looks tell that a track shows somebody else now,
_SURE_FIT = 0.6  # From this IoU, a track that nobody has touched for a while may change its look: light changes.
_TOUCHING = 0.1  # Tracks that share this part of a box may be confused.
_MIXED_S = 3.0  # for this long after it was lost or touched by another one.


@dataclass(frozen=True, eq=False)
class Track:
    """Tracked person in one image.

    ``box`` is x, y, w, h in pixels, shape (4,): the prediction if ``unseen_s`` (s, since the last detection) > 0.
    ``score`` is that of the last detection. ``key`` is the number of the track, also of one without an id.
    """

    id: str
    box: np.ndarray
    score: float
    unseen_s: float
    cut: Cut
    feet_hidden: bool = False
    key: int = 0


class Tracker:
    """Multi-object tracker for the people in one recording.

    All boxes with a score of ``sure`` are published, as without a tracker. A track without an id is a person who is not
    known yet: it gets its id after ``confirm`` detections, or at once in a first image, after a gap, and if its score
    exceeds ``sure`` by three quarters of the distance from ``weak``, unless it lies within another person.

    Only second boxes around a person are left out: a new track that overlaps another person is published when its
    colours differ from theirs or its score is high, or later.

    A weak box is published where a person was expected whose track has once reached the score ``clear``.

    A lost track is published as predicted for up to ``bridge_s``. Its scores must have reached ``sure``, its prediction
    must be precise, and the person must not be leaving the image or within another box.
    A person with a high score whom a nearer one covers suddenly is published for at least 0.25 s, also within that box.

    The result does not depend on the order of the boxes. Ids are never reused.

    Args:
        sure: Score that a track needs at least once.
        weak: Score from which a box supports a track or starts a tentative one.
        confirm: Detections before a track gets an id.
        clear: Score that shows a person for certain, see above; default: ``sure``.
        bridge_s: Longest time to publish predictions, s.
        keep_s: Time after which a lost track is deleted, s.

    Attributes:
        doubtful: Detected tracks of the last image that are not published.
    """

    def __init__(
        self,
        sure: float,
        weak: float,
        *,
        confirm: int = 2,
        clear: float | None = None,
        bridge_s: float = 0.5,
        keep_s: float = 2.0,
        remember_s: float = REMEMBER_S,
    ) -> None:
        self.sure = sure
        self.weak = weak
        self.confirm = confirm
        self.clear = sure if clear is None else clear
        self.bridge_s = bridge_s
        self.keep_s = keep_s
        self.remember_s = remember_s
        self._persons: list[TrackedPerson] = []
        self._stamp: int | None = None
        self._count = self._begun = 0
        self._lost = LostPeople()
        self._locate: Locate | None = None
        self.doubtful: tuple[Track, ...] = ()

    def update(
        self,
        stamp_ns: int,
        boxes: np.ndarray,
        scores: np.ndarray,
        size: tuple[int, int] | None = None,
        looks: np.ndarray | None = None,
        turn: np.ndarray | None = None,
        locate: Locate | None = None,
    ) -> tuple[Track, ...]:
        """Update with the detections of the image taken at ``stamp_ns``; an earlier stamp starts a new recording.

        Args:
            boxes: x, y, w, h in pixels, shape (n, 4).
            scores: Shape (n,).
            size: Width and height of the image; without it no box counts as cut off.
            looks: Colours of each box (`appearance.looks_of`); without them nobody is recognised.
            turn: Homography (3, 3) of the background since the last image (`motion.CameraMotion`).
            locate: Places of boxes on the floor, if the direction of the camera is known.

        Returns:
            The tracks, best score first.
        """
        after_gap, seconds = self._pass_to(stamp_ns)
        self._locate = locate
        for person in self._persons:
            person.motion.predict(seconds)
            if turn is not None:
                person.motion.shift(turn)
            person.turned = person.misses > 0 and (person.turned or turn is not None)
        if turn is not None and size:
            self._lost.turn(turn, np.array(size) / 2)
        boxes, scores = np.asarray(boxes, np.float64).reshape(-1, 4), np.asarray(scores, np.float64)
        order = np.lexsort((*boxes.T[::-1], -scores))
        boxes, scores = boxes[order], scores[order]
        recognising = looks is not None
        looks = looks[order] if looks is not None else np.full((len(boxes), 1, 1), np.nan)
        cuts = [cut_off(box, *size) if size else Cut() for box in boxes]
        expected = np.array([person.motion.box for person in self._persons]).reshape(-1, 4)
        expected = clip(expected, *size) if size else expected
        taken = self._match(expected, boxes, scores, looks)
        for number, person in enumerate(self._persons):
            if number in taken:
                index = taken[number]
                if scores[index] < self.sure:
                    person.fit = float(iou(expected[number], boxes[index, None])[0])
                self._see(person, boxes[index], float(scores[index]), cuts[index], seconds)
            else:
                person.mixed = stamp_ns
                person.misses += 1
                person.unseen_s += seconds
        seen = list(taken.values())
        matched = [self._persons[number] for number in taken]
        if recognising:
            for person, index in zip(matched, seen, strict=True):
                box = boxes[index]
                shared = shared_area(box, boxes[seen]) > _TOUCHING * box[2] * box[3] if len(seen) > 1 else None
                self._look(person, looks[index], touched=shared is not None and shared.sum() > 1)
        for person in matched:
            if (person.due and not self._is_double(person)) or (person.new and recognising):
                self._confirm(person)
        # Largest first, so that parts of a person find the whole.
        left = [each for each in np.argsort(-boxes[:, 2] * boxes[:, 3], kind="stable").tolist() if each not in seen]
        for index in [index for index in left if scores[index] >= self.sure]:
            at_once = after_gap or bool(scores[index] >= self._above(_AT_ONCE))
            self._begin(boxes[index], float(scores[index]), cuts[index], looks[index], boxes[seen], at_once=at_once)
            seen.append(index)
        for index in [index for index in left if self.weak <= scores[index] < self.sure]:
            self._begin(boxes[index], float(scores[index]), cuts[index], looks[index], boxes[seen], at_once=False)
        self._drop([person for person in self._persons if not self._kept(person, size)])
        self._meet([person for person in self._persons if not person.misses])
        return self._published(size)

    def place(self, track: str, seen: LastSeen) -> None:
        """Note where the person of a published track is."""
        for person in self._persons:
            if person.id == track:
                person.seen = seen

    def forget_places(self) -> None:
        """Forget where people were seen, since the base of the robot has moved."""
        for person in (*self._persons, *self._lost.people):
            person.seen = None

    def _above(self, share: float) -> float:
        """The score that exceeds ``sure`` by a ``share`` of its distance from ``weak``."""
        return self.sure + share * (self.sure - self.weak)

    def _pass_to(self, stamp_ns: int) -> tuple[bool, float]:
        """Whether the image is the first or follows a gap, and the seconds since the last one."""
        before, self._stamp = self._stamp, stamp_ns
        if before is None or stamp_ns < before:
            self._persons, self._lost = [], LostPeople()
            return True, 0.0
        seconds = (stamp_ns - before) / SECOND
        self._drop([person for person in self._persons if person.unseen_s + seconds > max(self.keep_s, _GAP_S)])
        self._lost.forget_before(stamp_ns - round(self.remember_s * SECOND))
        return seconds >= _GAP_S, seconds

    def _drop(self, persons: Sequence[TrackedPerson]) -> None:
        """Delete tracks, and remember their people."""
        if persons:
            self._persons = [each for each in self._persons if each not in persons]
            self._remember(each for each in persons if each.id)

    def _remember(self, persons: Iterable[TrackedPerson]) -> None:
        self._lost.add(persons)
        known = {each.id for each in (*self._persons, *self._lost.people)}
        for each in (*self._persons, *self._lost.people):
            each.met &= known

    def _match(self, expected: np.ndarray, boxes: np.ndarray, scores: np.ndarray, looks: np.ndarray) -> dict[int, int]:
        """Assign boxes to tracks: box index by track index."""
        sure = np.flatnonzero(scores >= self.sure)
        weak = np.flatnonzero((scores >= self.weak) & (scores < self.sure))
        known = [number for number, person in enumerate(self._persons) if person.id]
        new = [number for number, person in enumerate(self._persons) if not person.id]
        taken = self._assigned(known, sure, expected, boxes, looks, _LEAST_FIT)
        near = [number for number in known if number not in taken and self._persons[number].unseen_s <= _RECENT_S]
        weak = weak[~contained(boxes[weak], boxes[list(taken.values())]).any(axis=1)]
        taken |= self._assigned(near, weak, expected, boxes, looks, _LEAST_FIT_WEAK)
        rest = np.array([index for index in (*sure, *weak) if index not in taken.values()], np.intp)
        return taken | self._assigned(new, rest, expected, boxes, looks, _LEAST_FIT)

    def _assigned(
        self,
        numbers: list[int],
        indices: np.ndarray,
        expected: np.ndarray,
        boxes: np.ndarray,
        looks: np.ndarray,
        least: float,
    ) -> dict[int, int]:
        if not numbers or not len(indices):
            return {}
        costs = np.ones((len(numbers), len(indices)))
        # Colours of few pixels tell little, and so do those that few pixels would show.
        noise, clarity = noise_of(boxes[indices]), clarity_of(boxes[indices])
        hidden = least + clarity * max(_LEAST_FIT_UNKNOWN - least, 0.0)
        for row, number in enumerate(numbers):
            person = self._persons[number]
            fit = person.motion.fit(expected[number], boxes[indices])
            absence = _ABSENCE_COSTS * min(person.unseen_s, 1.0)
            far = person.appearance.distances(looks[indices])
            known = len(person.appearance) >= _LEAST_LOOKS
            unknown = _UNKNOWN if known else 0.0
            unlike = np.where(
                np.isfinite(far),
                np.minimum(np.maximum((far - noise - LIKE) / (UNLIKE - LIKE), 0), 1),
                unknown * clarity,
            )
            mixed = (self._stamp or 0) - person.mixed <= _MIXED_S * SECOND
            other = (far - noise >= OTHER) & np.isfinite(far) & known & (mixed | (fit < _SURE_FIT))
            needed = np.where(np.isfinite(far) | (not known), least + _LEAST_MORE * unlike, hidden)
            good = person.motion.is_head(boxes[indices]) & (fit >= needed)
            costs[row] = np.where(good & ~other, 1 - fit + absence + _LOOK_COSTS * unlike, np.inf)
        return {numbers[row]: int(indices[column]) for row, column in assign(costs, 1.0 + _LOOK_COSTS)}

    def _see(self, person: TrackedPerson, box: np.ndarray, score: float, cut: Cut, seconds: float) -> None:
        _, top, height, _ = person.motion.value
        short = box[3] < _SUDDEN * height and abs(box[1] - top) < _HEADS_ALIKE * height
        hidden = short and not (cut.top or cut.bottom) and person.hits >= _TRUSTED_HITS
        person.hidden_s = person.hidden_s + max(seconds, 1e-9) if hidden and person.hidden_s < _HIDDEN_S else 0.0
        person.motion.correct(box, cut, feet_hidden=person.feet_hidden)
        person.box, person.score, person.cut = box, score, cut
        person.hits, person.misses, person.unseen_s = person.hits + 1, 0, 0.0
        person.last = self._stamp or 0
        if score >= self.sure:
            person.sure_hits, person.sure_at = person.sure_hits + 1, person.last
        person.best = max(person.best, score)
        if not person.id and person.hits >= self.confirm and person.best >= self.sure:
            person.due = True

    def _is_double(self, person: TrackedPerson) -> bool:
        """Whether a track without an id may be a second box around a person."""
        if person.id or person.sure_hits >= _DOUBLE_HITS or person.score >= self._above(_AT_ONCE):
            return False
        others = [each for each in self._persons if each.id and not each.misses]
        shared = iou(person.box, np.array([each.box for each in others]).reshape(-1, 4)) > _DOUBLE
        looks = [each.appearance.distance_to(person.appearance) for each in others]
        return any(near and not UNLIKE < far < math.inf for near, far in zip(shared, looks, strict=True))

    def _meet(self, present: Sequence[TrackedPerson]) -> None:
        """Note which tracks are in view together: they are different people.

        A track without id may be a second box around a person whose box it touches.
        """
        known = [person for person in present if person.id]
        names = {person.id for person in known}
        boxes = np.array([person.box for person in known]).reshape(-1, 4)
        for person in present:
            if person.id:
                person.met |= names - {person.id}
            else:
                apart = iou(person.box, boxes) < _TOUCHING
                person.met.update(each.id for each, aside in zip(known, apart.tolist(), strict=True) if aside)

    def _look(self, person: TrackedPerson, look: np.ndarray, *, touched: bool) -> None:
        """Learn the ``look`` of a track, or notice that it shows somebody else since it was lost or touched."""
        now = self._stamp or 0
        if touched:
            person.mixed = now
        mixed = now - person.mixed <= _MIXED_S * SECOND
        if not mixed:
            person.others.clear()
        far = float(person.appearance.distances(look[None])[0]) if person.id else math.inf
        if mixed and len(person.appearance) >= _LEAST_LOOKS and _FOREIGN < far < math.inf:
            person.others.append(look)
            if len(person.others) >= _LEAST_LOOKS:
                self._replace(person)
        else:
            if math.isfinite(far):
                person.others.clear()
            person.appearance.see(look)
            self._prove(person, look)

    def _prove(self, person: TrackedPerson, look: np.ndarray) -> None:
        """Compare a recognised person with their memory, until it is proven or refuted."""
        claim = person.claim
        proven = None if claim is None else claim.prove(look, self._stamp or 0)
        if proven:
            person.accept()
        elif claim is not None and proven is False:
            self._lost.add([claim.person])
            person.appearance = Appearance(claim.looks)
            self._forget_id(person)
            person.met.add(claim.person.id)

    def _forget_id(self, person: TrackedPerson) -> None:
        """Let a track show somebody else from now on, whose id is due."""
        person.begun, person.met, person.id, person.due, person.claim = self._stamp or 0, set(), "", True, None

    def _replace(self, person: TrackedPerson) -> None:
        """Let a track be another person than before."""
        self._remember([replace(person, last=person.mixed)])
        self._forget_id(person)
        person.appearance = Appearance(person.others)
        person.others.clear()

    def _begin(
        self, box: np.ndarray, score: float, cut: Cut, look: np.ndarray, others: np.ndarray, *, at_once: bool
    ) -> None:
        """Start a track, unless ``box`` is a part of a person in ``others`` (n, 4)."""
        within = contained(box[None], others)[0]
        # A person cut off below is near and large; a box within another one is then an arm.
        if same_head(box, others, _WITHIN).any() or (cut.bottom and within.any()):
            return
        self._begun += 1
        person = TrackedPerson(BoxFilter(box), box, score, cut, self._begun, best=score)
        person.sure_hits = int(score >= self.sure)
        person.begun = person.last = person.sure_at = self._stamp or 0
        person.appearance.see(look)
        self._persons.append(person)
        if score >= self.sure and (self.confirm <= 1 or (at_once and not within.any())):
            self._confirm(person)

    def _confirm(self, person: TrackedPerson) -> None:
        """Give a track the id of the lost person whom it shows, or else, if it has none, a new one.

        The id of a new track is decided with its first looks.
        """
        claim = self._lost.recognise(person, self._persons, self._stamp or 0, self._locate)
        if claim is not None:
            before = claim.person
            if before.claim is not None:  # The proof goes on.
                claim = before.claim
                person.appearance.learn(before.appearance)
            self._persons = [each for each in self._persons if each is not before]
            self._lost.remove(before)
            person.id, person.new, person.claim = before.id, False, claim
            if before.turned and before.motion.is_at(person.box, person.cut):
                person.accept()
        elif not person.id and self._lost.may_return(person):
            person.due = True
            return
        elif not person.id:
            self._count += 1
            person.id, person.new = f"t{self._count}", True
        person.new = person.new and len(person.appearance) < _DECIDING_LOOKS
        person.due = False

    def _kept(self, person: TrackedPerson, size: tuple[int, int] | None) -> bool:
        if not person.misses:
            return True
        if not person.id:
            return person.misses < 2 or person.unseen_s <= _DOUBT_S
        if person.unseen_s > self.keep_s:
            return False
        return size is None or bool((clip(person.motion.box[None], *size)[0, 2:] > 0).all())

    def _published(self, size: tuple[int, int] | None) -> tuple[Track, ...]:
        seen = [person for person in self._persons if not person.misses and self._is_shown(person)]
        boxes = np.array([person.box for person in seen]).reshape(-1, 4)
        tracks = [_track(person) for person in seen]
        self.doubtful = tuple(_track(each) for each in self._persons if not each.misses and each not in seen)
        for person in self._persons:
            if not (person.id and person.misses):
                continue
            box = clip(person.motion.box[None], *size)[0] if size else person.motion.box
            hidden = person.score >= self._above(_AT_ONCE) and _is_covered(box, boxes)
            within = contained(box[None], boxes)[0] & (not hidden)
            if self._trusted(person, size, hidden=hidden) and not ((iou(box, boxes) > _SAME) | within).any():
                cut = cut_off(box, *size) if size else Cut()
                tracks.append(Track(person.id, box, person.score, person.unseen_s, cut, key=person.key))
        return tuple(sorted(tracks, key=lambda track: (-track.score, track.key)))

    def _is_shown(self, person: TrackedPerson) -> bool:
        """Whether the box of a detected track is published."""
        if person.score >= self.sure:
            return not self._is_double(person)
        recent = person.last - person.sure_at <= _RECENT_S * SECOND
        return bool(person.id) and recent and person.best >= self.clear and person.fit >= _EXPECTED

    def _trusted(self, person: TrackedPerson, size: tuple[int, int] | None, *, hidden: bool) -> bool:
        motion = person.motion
        longest_s = max(self.bridge_s, _COVERED_S) if hidden and self.bridge_s else self.bridge_s
        if (
            not 0 < person.unseen_s <= longest_s
            or person.hits < _TRUSTED_HITS
            # The score of a person who leaves falls first; a flicker is sudden.
            or person.score < self.sure
            or motion.spread()[0] > _DRIFT * motion.value[3]
        ):
            return False
        cut = cut_off(motion.box, *size) if size else Cut()
        outward = _OUTWARD * motion.value[2]
        return not ((cut.left and motion.speed[0] < -outward) or (cut.right and motion.speed[0] > outward))


def _is_covered(box: np.ndarray, others: np.ndarray) -> bool:
    """Whether a nearer one of ``others`` (n, 4) covers most of ``box``."""
    nearer = others[others[:, 1] + others[:, 3] > box[1] + box[3]]
    return bool((shared_area(box, nearer) > _COVERED * box[2] * box[3]).any())


def _track(person: TrackedPerson) -> Track:
    return Track(person.id, person.box, person.score, 0.0, person.cut, person.feet_hidden, person.key)
