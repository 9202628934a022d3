"""Tracking metrics: CLEAR MOT, identity F1 (IDF1) and HOTA, with the figures that TrackEval gives.

Sources: Bernardin and Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT metrics" (2008);
Ristani et al., "Performance measures and a data set for multi-target, multi-camera tracking" (2016); Luiten et al.,
"HOTA: a higher order metric for evaluating multi-object tracking" (2021).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from socialbot.core.messages import PersonDetection
from socialbot.vision.detector import iou, shared_area
from socialbot.vision.metrics.frames import LabelledFrame
from socialbot.vision.metrics.matches import INSIDE, LEAST_IOU, box_array
from socialbot.vision.metrics.truth import LEAST_VISIBLE

ALPHAS = np.arange(0.05, 0.99, 0.05)
"""The 19 IoU thresholds of HOTA."""

MOSTLY_TRACKED, MOSTLY_LOST = 0.8, 0.2  # Shares of the frames of a person.
_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class TrackedFrame:
    """People and tracks in one image.

    Args:
        people: Ids of the people who are scored.
        tracks: Ids of the tracks that are scored.
        overlaps: IoU of each person with each track, shape (people, tracks).
    """

    people: tuple[Hashable, ...]
    tracks: tuple[Hashable, ...]
    overlaps: np.ndarray


@dataclass(frozen=True)
class TrackingScore:
    """Counts of one or more recordings, which ``+`` adds up, and the rates that follow from them.

    Rates without data are None. Arrays have shape (19,), one value for each of `ALPHAS`.

    Args:
        hits: Pairs of person and track at an IoU of 0.5 (TP); ``hit_overlap`` is the sum of their IoU.
        false: Tracks without a person in a frame (FP).
        missed: People without a track in a frame (FN).
        switches: Changes of the track of a person (IDSW).
        fragments: Interruptions of a person's track.
        people: People in the ground truth.
        tracks: Tracks of the tracker.
        mostly_tracked: People tracked in more than 80 % of their frames.
        mostly_lost: People tracked in less than 20 % of their frames.
        id_hits: Pairs in the best one-to-one assignment of people and tracks (IDTP).
        hota_hits: Pairs at each threshold; ``hota_people`` and ``hota_tracks`` are those to be paired.
        associations: Sums of the association accuracy over the pairs, for AssA.
        localisations: Sums of the IoU over the pairs, for LocA.
    """

    hits: int = 0
    hit_overlap: float = 0.0
    false: int = 0
    missed: int = 0
    switches: int = 0
    fragments: int = 0
    people: int = 0
    tracks: int = 0
    mostly_tracked: int = 0
    mostly_lost: int = 0
    id_hits: int = 0
    hota_hits: np.ndarray = field(default_factory=lambda: np.zeros(len(ALPHAS)))
    associations: np.ndarray = field(default_factory=lambda: np.zeros(len(ALPHAS)))
    localisations: np.ndarray = field(default_factory=lambda: np.zeros(len(ALPHAS)))

    def __add__(self, other: TrackingScore) -> TrackingScore:
        return TrackingScore(*(mine + theirs for mine, theirs in zip(self._values, other._values, strict=True)))

    @property
    def _values(self) -> tuple:
        return tuple(getattr(self, name) for name in self.__dataclass_fields__)

    @property
    def mota(self) -> float | None:
        """Multi-object tracking accuracy: 1 - (FP + FN + IDSW) / people in all frames; may be negative."""
        return _ratio(self.hits - self.false - self.switches, self.hits + self.missed)

    @property
    def motp(self) -> float | None:
        """Multi-object tracking precision: mean IoU of the pairs."""
        return _ratio(self.hit_overlap, self.hits)

    @property
    def idf1(self) -> float | None:
        """Identity F1: 2 IDTP / (people + tracks in all frames)."""
        return _ratio(2 * self.id_hits, 2 * self.hits + self.false + self.missed)

    @property
    def idp(self) -> float | None:
        """Identity precision: IDTP / tracks in all frames."""
        return _ratio(self.id_hits, self.hits + self.false)

    @property
    def idr(self) -> float | None:
        """Identity recall: IDTP / people in all frames."""
        return _ratio(self.id_hits, self.hits + self.missed)

    @property
    def hota(self) -> float | None:
        """Higher order tracking accuracy: geometric mean of detection and association, mean over `ALPHAS`."""
        return None if self._either is None else float(np.sqrt(self._detection * self._association).mean())

    @property
    def deta(self) -> float | None:
        """Detection accuracy of HOTA, mean over `ALPHAS`."""
        return None if self._either is None else float(self._detection.mean())

    @property
    def assa(self) -> float | None:
        """Association accuracy of HOTA, mean over `ALPHAS`."""
        return None if self._either is None else float(self._association.mean())

    @property
    def loca(self) -> float | None:
        """Localisation accuracy of HOTA: mean IoU of the pairs, mean over `ALPHAS`."""
        if self._either is None:
            return None
        return float(
            np.divide(self.localisations, self.hota_hits, out=np.ones(len(ALPHAS)), where=self.hota_hits > 0).mean()
        )

    @property
    def _either(self) -> int | None:
        return 2 * self.hits + self.false + self.missed or None

    @property
    def _detection(self) -> np.ndarray:
        return self.hota_hits / np.maximum(1, 2 * self.hits + self.false + self.missed - self.hota_hits)

    @property
    def _association(self) -> np.ndarray:
        return self.associations / np.maximum(1, self.hota_hits)


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def tracking_score(frames: Iterable[TrackedFrame], least_iou: float = LEAST_IOU) -> TrackingScore:
    """Score the tracks of one recording.

    Args:
        frames: All frames in order.
        least_iou: Least IoU of a pair for CLEAR MOT and IDF1.
    """
    # Numbered ids are indices into the matrices.
    people: dict[Hashable, int] = {}
    tracks: dict[Hashable, int] = {}
    numbered = []
    for frame in frames:
        rows = np.array([people.setdefault(each, len(people)) for each in frame.people], np.intp)
        columns = np.array([tracks.setdefault(each, len(tracks)) for each in frame.tracks], np.intp)
        numbered.append(_Numbered(rows, columns, frame.overlaps))
    shape = len(people), len(tracks)
    return _clear(numbered, *shape, least_iou) + _identity(numbered, shape, least_iou) + _hota(numbered, shape)


@dataclass(frozen=True)
class _Numbered:
    """Frame with people and tracks as indices."""

    people: np.ndarray
    tracks: np.ndarray
    overlaps: np.ndarray


def _clear(frames: Sequence[_Numbered], people: int, tracks: int, least_iou: float) -> TrackingScore:
    hits = false = missed = switches = 0
    overlap = 0.0
    last = np.full(people, -1)  # The last track of each person,
    current = np.full(people, -1)  # and that in the last frame that had both people and tracks.
    seen, tracked, begun = np.zeros(people), np.zeros(people), np.zeros(people)
    for frame in frames:
        seen[frame.people] += 1
        if not len(frame.people) or not len(frame.tracks):
            false, missed = false + len(frame.tracks), missed + len(frame.people)
            continue
        possible = np.where(frame.overlaps >= least_iou - _EPSILON, frame.overlaps, 0.0)
        # Pairs go on as long as they overlap enough; the others are chosen anew.
        kept = (frame.tracks == current[frame.people][:, None]) & (possible > 0)
        rows, columns = np.nonzero(kept)
        free = possible.copy()
        free[rows], free[:, columns] = 0.0, 0.0
        more_rows, more_columns = best_pairs(free)
        rows, columns = np.append(rows, more_rows), np.append(columns, more_columns)
        who, track = frame.people[rows], frame.tracks[columns]
        switches += int(np.count_nonzero((last[who] >= 0) & (last[who] != track)))
        before = current >= 0
        last[who] = track
        current[:] = -1
        current[who] = track
        begun += (current >= 0) & ~before
        tracked[who] += 1
        hits, overlap = hits + len(rows), overlap + float(frame.overlaps[rows, columns].sum())
        false, missed = false + len(frame.tracks) - len(rows), missed + len(frame.people) - len(rows)
    share = tracked[seen > 0] / seen[seen > 0]
    return TrackingScore(
        hits=hits,
        hit_overlap=overlap,
        false=false,
        missed=missed,
        switches=switches,
        fragments=int((begun[begun > 0] - 1).sum()),
        people=people,
        tracks=tracks,
        mostly_tracked=int(np.count_nonzero(share > MOSTLY_TRACKED)),
        mostly_lost=int(np.count_nonzero(share < MOSTLY_LOST)),
    )


def _identity(frames: Sequence[_Numbered], shape: tuple[int, int], least_iou: float) -> TrackingScore:
    together = np.zeros(shape)
    for frame in frames:
        rows, columns = np.nonzero(frame.overlaps >= least_iou)
        together[frame.people[rows], frame.tracks[columns]] += 1
    return TrackingScore(id_hits=int(together[best_pairs(together)].sum()))


def _hota(frames: Sequence[_Numbered], shape: tuple[int, int]) -> TrackingScore:
    people, tracks, likely = np.zeros(shape[0]), np.zeros(shape[1]), np.zeros(shape)
    for frame in frames:
        people[frame.people] += 1
        tracks[frame.tracks] += 1
        overlaps = frame.overlaps
        either = overlaps.sum(0)[None, :] + overlaps.sum(1)[:, None] - overlaps
        shares = np.divide(overlaps, either, out=np.zeros_like(overlaps), where=either > _EPSILON)
        likely[np.ix_(frame.people, frame.tracks)] += shares
    both = people[:, None] + tracks[None, :]
    alignment = np.divide(likely, both - likely, out=np.zeros(shape), where=both > likely)
    hits, localisations = np.zeros(len(ALPHAS)), np.zeros(len(ALPHAS))
    together: dict[tuple[int, int], np.ndarray] = {}
    for frame in frames:
        rows, columns = best_pairs(alignment[np.ix_(frame.people, frame.tracks)] * frame.overlaps)
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            overlap = frame.overlaps[row, column]
            good = overlap >= ALPHAS - _EPSILON
            pair = int(frame.people[row]), int(frame.tracks[column])
            hits += good
            localisations += good * overlap
            together[pair] = together.get(pair, 0) + good
    associations = np.zeros(len(ALPHAS))
    for pair, counts in together.items():
        associations += counts * counts / np.maximum(1, both[pair] - counts)
    return TrackingScore(hota_hits=hits, associations=associations, localisations=localisations)


def best_pairs(gains: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Assign rows to columns one to one so that the sum of the ``gains`` is largest.

    `tracking.assign` is faster for few boxes, but has single precision and a bounded number of steps.

    Args:
        gains: Shape (n, m), not negative; pairs without gain are left out.

    Returns:
        Rows (ascending) and columns of the pairs.
    """
    rows, columns = np.flatnonzero(gains.any(axis=1)), np.flatnonzero(gains.any(axis=0))
    small = gains[np.ix_(rows, columns)]
    if len(rows) > len(columns):
        back, forth = best_pairs(small.T)
        order = np.argsort(forth)
        return rows[forth[order]], columns[back[order]]
    row_of = _shortest_paths(-small)
    taken = np.flatnonzero(row_of >= 0)
    taken = taken[np.argsort(row_of[taken])]
    taken = taken[small[row_of[taken], taken] > 0]
    return rows[row_of[taken]], columns[taken]


def _shortest_paths(costs: np.ndarray) -> np.ndarray:
    """Hungarian method with shortest augmenting paths: the row of each column, -1 for none; n <= m."""
    n, m = costs.shape
    row_of = np.full(m, -1)
    row_price, column_price = np.zeros(n), np.zeros(m)
    for start in range(n):
        best, via = np.full(m, np.inf), np.full(m, -1)
        done = np.zeros(m, dtype=bool)
        row, column, length = start, -1, 0.0
        reached = [start]
        while True:
            slack = length + costs[row] - row_price[row] - column_price
            nearer = ~done & (slack < best)
            best[nearer], via[nearer] = slack[nearer], column
            column = int(np.argmin(np.where(done, np.inf, best)))
            length, done[column] = float(best[column]), True
            if row_of[column] < 0:
                break
            row = int(row_of[column])
            reached.append(row)
        ends = np.flatnonzero(done & (row_of >= 0))
        row_price[start] += length
        row_price[row_of[ends]] += length - best[ends]
        column_price[ends] -= length - best[ends]
        while column >= 0:
            before = int(via[column])
            row_of[column] = row_of[before] if before >= 0 else start
            column = before
    return row_of


def tracked_frame(
    frame: LabelledFrame, found: Sequence[PersonDetection], least_visible: float = LEAST_VISIBLE
) -> TrackedFrame:
    """Compare a labelled frame with the tracks found in it.

    Tracks that match a person who is not scored are left out, as are other tracks that lie by half in an ignored
    region and, where the labels are not complete, all tracks that match nobody. Tentative detections are no tracks yet.

    Args:
        frame: The labels.
        found: Detections of a tracker.
        least_visible: Visible share from which a person is scored.
    """
    found = [person for person in found if not person.tentative]
    scored = np.array([not each.ignore and each.visible >= least_visible for each in frame.persons], bool)
    people, boxes, areas = box_array(frame.persons), box_array(found), box_array(frame.ignore)
    overlaps = np.array([iou(person, boxes) for person in people]).reshape(len(people), len(boxes))
    rows, columns = best_pairs(np.where(overlaps >= LEAST_IOU, overlaps, 0.0))
    kept = np.array([_is_scored(box, areas, complete=frame.complete) for box in boxes], bool)
    kept[columns] = scored[rows]
    return TrackedFrame(
        tuple(person.id for person, counts in zip(frame.persons, scored, strict=True) if counts),
        tuple(each.track_id for each, counts in zip(found, kept, strict=True) if counts),
        overlaps[np.ix_(scored, kept)],
    )


def _is_scored(box: np.ndarray, ignored: np.ndarray, *, complete: bool) -> bool:
    """Whether a track that matches nobody is a false positive."""
    area = box[2] * box[3]
    return complete and not (shared_area(box, ignored) >= INSIDE * area).any() and not math.isnan(area)
