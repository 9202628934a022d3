"""Remove tracks of static objects: coats on stands, posters, dolls.

An object is hidden only if it was known before anybody came, or never looked like a person with any certainty:

* A box that looks like the background (`_Background`, places where nothing was detected) shows an object.
* A box without any motion shows an object after a while. The time depends on its score, on its size and on whether
  anybody has moved in the view before. A box with a certain score, or one that moved, is a person.

Motion is measured in pixels, against the noise of the image (`_Motion`). Standing people sway by more than that, unless
they are small in the image: then the lack of motion tells little, and the score must tell more. Pixels
that do not change at all, as in a paused or strongly compressed video, say nothing. While the camera turns, no track
changes its class.

What is known belongs to a place and its look. A new track in the place of a lost one continues its history if the
place looks the same, also when the camera was off in between.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from socialbot.core.clock import SECOND
from socialbot.vision.camera import Box
from socialbot.vision.detector import clip, iou
from socialbot.vision.tracking import Track

_WIDTH = 320  # Images are compared at this width: coarse for vibrations, fine enough for breathing.
_LARGE_SIGMA = 1.95  # Contrast is local to about this many pixels of half the resolution.
_LARGE_SIZE = (13, 13)  # Pixels that count: three sigmas. OpenCV takes four, in twice the time.
_FAINT = 3.0  # Contrast of fewer grey levels is noise.

_LAG_S, _LEAST_LAG_S = 1.0, 0.3  # Usual and least age of the image to compare with.
_STEP_S = 0.2  # Interval of the images that are kept.

_ACROSS = np.array([[-1.0, 0.0, 1.0]])  # Gradient of the grey levels; it is 0 at the edges of the image.
_DOWN = _ACROSS.T
_CELL = 8  # Motion is measured in cells of so many pixels.
_TEXTURE = 4.0  # Cells with a squared gradient below this multiple of the noise show no motion.
_MOVED_PX, _STILL_PX = 0.35, 0.2  # A box moves from this apparent motion, and is still below that one,
_MOVED_NOISE, _STILL_NOISE = 4.0, 1.2  # or these multiples of the apparent motion of the background.
_HIGH = 0.8  # The motion of a box is this quantile of its cells. That of the background is the same quantile,
_NOISE_TAIL = 2.6  # at most this multiple of its median: leaves and cars move too.
_UNREST = 1.0  # Motion between still and moving counts against being still for so many times its duration.
_FROZEN = 0.02  # Cells whose difference has a lower variance have not been updated by the video codec.
_FROZEN_SHARE = 0.5
_TURNED_PX = 0.8  # The camera moves when the background does.

# Scores as multiples of the score that is certain.
_ALONE_S, _ALONE_SCORE = 0.5, 1.0  # Still since the first image, before anybody moved: objects below this score,
_ALONE_VAGUE_SCORE = 0.8  # or below this one, if the sway of a person of this height would not be visible.
_STILL_S, _STILL_SCORE = 8.0, 0.9  # Still for so long: objects below this score,
_LOW_STILL_S, _LOW_SCORE = 5.0, 0.75  # or for so long, below this one,
_CLEARLY_STILL_S = 3.0  # or for so long, if the sway of a person of this height would be visible. Objects below the
# score of those alone must then be still against the oldest image too: in two seconds, people sway by more than in one.
_SWAY = 0.004  # Standing people sway by at least this share of their height.
_LIFE_S = 30.0  # if they never moved; after a movement they may be still for longer.
_AWAKE_S, _ASIDE = 1.5, 0.7  # An object that moves for so long, others being so many widths away, is a person.
_FAMILIAR_SCORE = 1.05  # A score that contradicts the background.
_FIRST_S = 0.35  # Tracks that begin so early were there in the first image.
_NEWS = 0.1  # Weight of the newest score in the mean.

_SAME_PLACE = 0.6  # A new track with this IoU to a lost one may show the same object, if it looks like it.
_MOST_PLACES, _PLACE_S = 32, 900.0  # Lost tracks that are remembered, and for how long.

_LEARN_S = 2.0  # Places without detections for so long are background.
_FAMILIAR = 0.8  # A box shows background from this correlation,
_SAME = 0.9  # from this one if something moves in it,
_STILL_VAGUE = 0.45  # and from this one if it was an object before, of which a person may hide a half.
# Below this one, only boxes that have been still for long show objects.

_TURNED = 0.5  # The camera turns when the rest of the image correlates less.
_LEAST_FREE = 0.3  # A box is compared where it is free of other people, if that is this share of it.
_LEAST_REST = 0.05  # If people leave less of the image, all of it is compared.
_MIDDLE = np.array([0.25, 0.0, 0.5, 0.6])  # Part of a box that a person fills: x, y, w, h as shares.
_MARGIN = 0.1  # People may exceed their box by this share of its width.


@dataclass(frozen=True, eq=False)
class _Snapshot:
    """Grey levels and local contrast ``shapes`` of an image, both (height, width), float32.

    ``mean`` and ``variance`` are those of the grey levels in each cell. ``boxes`` (n, 4) and ``names`` are those of its
    tracks.
    """

    stamp: int
    grey: np.ndarray
    mean: np.ndarray
    variance: np.ndarray
    shapes: np.ndarray
    boxes: np.ndarray
    names: tuple[int, ...]

    def free(self, name: int) -> np.ndarray:
        """Mask of the image without the boxes of other tracks."""
        others = [box for box, each in zip(self.boxes, self.names, strict=True) if each != name]
        return ~_covered(self.shapes.shape, others, _MARGIN)

    @cached_property
    def cover(self) -> np.ndarray:
        """Number of boxes at each pixel."""
        count = np.zeros(self.shapes.shape, np.int16)
        for box in self.boxes:
            count[_inside(_widened(box, _MARGIN), count.shape)] += 1
        return count


class _Background:
    """Local contrast of the scene without people, valid where ``known``; arrays of shape (height, width)."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shapes = np.zeros(shape, np.float32)
        self.known = np.zeros(shape, bool)

    def learn(self, shapes: np.ndarray, free: np.ndarray) -> None:
        cv2.copyTo(shapes, free.view(np.uint8), self.shapes)
        self.known |= free

    def likeness(self, now: _Snapshot, box: np.ndarray, free: np.ndarray) -> float | None:
        """Correlation of ``box`` with the background where it is ``free`` of other people, if enough is free.

        A higher correlation of the middle counts instead: a person in front hides only a side of an object.
        """
        whole = _likeness(now.shapes, self.shapes, box, self.known & free)
        if whole is None:
            whole = _likeness(now.shapes, self.shapes, box, self.known)
        middle = np.hstack([box[:2] + _MIDDLE[:2] * box[2:], _MIDDLE[2:] * box[2:]])
        looks = whole, _likeness(now.shapes, self.shapes, middle, self.known)
        return max((look for look in looks if look is not None), default=None)


class _Motion:
    """Apparent motion between two images in pixels, by cell, from the residuals of a local fit of gain and offset.

    ``noise`` is its median outside of all boxes: noise and compression look like a small motion at edges. Boxes with
    less motion than ``still`` move no more than the background.
    """

    def __init__(self, now: _Snapshot, then: _Snapshot) -> None:
        shared = _cells(now.grey * then.grey) - now.mean * then.mean
        gain = np.clip(shared / np.maximum(then.variance, 1e-3), 0.4, 2.5)
        rest = np.maximum(now.variance - 2 * gain * shared + gain**2 * then.variance, 0.0)
        squares = cv2.filter2D(now.grey, -1, _ACROSS)
        squares *= squares
        cv2.accumulateSquare(cv2.filter2D(now.grey, -1, _DOWN), squares)
        slope = _cells(squares) / 8
        outside = ~_covered(rest.shape, np.vstack([now.boxes, then.boxes]) / _CELL, _MARGIN)
        if _share(outside) < _LEAST_REST:
            outside[:] = True
        (middle,) = _quantiles(slope[outside], 0.5)
        (noise,) = _quantiles(rest[outside & (slope <= middle)], 0.5)
        self.pixels = np.sqrt(np.maximum(rest - noise, 0.0) / (slope + noise + 1.0))
        self.shown = slope > _TEXTURE * noise + 2.0
        self.frozen = rest < _FROZEN
        behind = self.pixels[outside & self.shown]
        self.noise, high = _quantiles(behind, 0.5, _HIGH) if len(behind) else (0.0, 0.0)
        self.still = max(_STILL_PX, _STILL_NOISE * min(high, _NOISE_TAIL * self.noise))

    def of(self, box: np.ndarray, free: np.ndarray) -> float | None:
        """Motion of the ``free`` part of ``box`` in pixels; None if the image does not show it."""
        x, y, right, bottom = _edges(box / _CELL + np.array([0.15, 0.0, -0.3, 0.0]) * box[2] / _CELL, self.pixels.shape)
        part = free[y * _CELL : bottom * _CELL, x * _CELL : right * _CELL]
        there = _cells(part.astype(np.float32)) > 0.5
        if _share(there) < _LEAST_FREE or _share(self.frozen[y:bottom, x:right][there]) > _FROZEN_SHARE:
            return None
        pixels = self.pixels[y:bottom, x:right][there & self.shown[y:bottom, x:right]]
        return _quantiles(pixels, _HIGH)[0] if len(pixels) else None


@dataclass(eq=False)
class _History:
    """Record of one track: ``still_s`` without motion, and the mean ``score`` of ``count`` images, most of the newest.

    ``look`` is the local contrast in ``box`` when it was last seen, in pixels of a `_Snapshot`, by the track ``key``.
    ``begin`` is the first box. A track that ``moved`` ``lives`` if nobody else was the cause.
    """

    first: bool
    score: float
    stamp: int
    key: int
    box: np.ndarray
    look: np.ndarray
    begin: np.ndarray
    count: int = 0
    still_s: float = 0.0
    moving_s: float = 0.0
    moved: bool = False
    lives: bool = False
    is_object: bool = False


class StaticObjectFilter:
    """Removes tracks that never move and do not look like people with certainty.

    Args:
        certain: Score from which a box shows a person for certain; infinite if none does.
    """

    def __init__(self, certain: float) -> None:
        self._certain = certain
        self._forget((0, 0))

    def _forget(self, shape: tuple[int, ...]) -> None:
        self._views: deque[_Snapshot] = deque()
        self._background = _Background(shape)
        self._histories: dict[int, _History] = {}
        self._lost: list[_History] = []
        self._company = False  # whether anybody may have moved
        self._begin: int | None = None

    def people(
        self,
        image: np.ndarray,
        stamp_ns: int,
        tracks: Sequence[Track],
        doubtful: Sequence[Track] = (),
        people: Collection[str] = (),
    ) -> tuple[Track, ...]:
        """Tracks that are not static objects.

        Args:
            image: Grey levels, shape (height, width), uint8.
            stamp_ns: Time of the image.
            tracks: Published tracks.
            doubtful: Tracks that are not published. They may be people and are not learnt as background.
            people: Ids of tracks that are people for another reason, such as a face.

        Returns:
            The people of ``tracks``.
        """
        both = (*tracks, *doubtful)
        now = _view(image, stamp_ns, both)
        # An earlier stamp means another recording, or that a clock was set.
        is_new = self._views and stamp_ns < self._views[-1].stamp
        if is_new or now.shapes.shape != self._background.known.shape:
            self._forget(now.shapes.shape)
        self._begin = stamp_ns if self._begin is None else self._begin
        then = self._earlier(stamp_ns)
        motion = _Motion(now, then) if then else None
        is_turning = motion is not None and (motion.noise > _TURNED_PX or _has_turned(now, then))
        if is_turning:
            motion = None
            self._company = True  # Nobody knows whether people move.
        keys = {track.key for track in both}
        self._lost += [each for key, each in self._histories.items() if key not in keys]
        oldest = stamp_ns - round(_PLACE_S * SECOND)
        self._lost = [each for each in self._lost if each.stamp >= oldest][-_MOST_PLACES:]
        self._histories = {key: each for key, each in self._histories.items() if key in keys}
        objects = {
            track.key
            for number, track in enumerate(both)
            if self._is_object(track, number, now, then, motion, is_turning=is_turning) and track.id not in people
        }
        for key, history in self._histories.items():
            history.is_object = key in objects
        self._keep(now, [number for number, track in enumerate(both) if track.key not in objects])
        return tuple(track for track in tracks if track.key not in objects)

    def _is_object(
        self,
        track: Track,
        number: int,
        now: _Snapshot,
        then: _Snapshot | None,
        motion: _Motion | None,
        *,
        is_turning: bool,
    ) -> bool:
        box = now.boxes[number]
        history = self._history(track, box, now)
        was_object = history.is_object
        seconds = (now.stamp - history.stamp) / SECOND
        history.stamp = now.stamp
        if track.unseen_s:
            return was_object
        history.count += 1
        history.score += max(_NEWS, 1 / history.count) * (track.score - history.score)
        if is_turning:
            return was_object
        history.box, history.look = box, now.shapes[_inside(box, now.shapes.shape)]
        free = now.free(track.key)
        before, history.key = history.key, track.key
        free_then = then.free(_own(then, track.key, before)) if then else free
        pixels = motion.of(box, free & free_then) if motion else None
        is_moving = False
        if pixels is not None and motion is not None:
            is_moving = pixels > max(_MOVED_PX, _MOVED_NOISE * motion.noise)
            around = _inside(_widened(box, _ASIDE), now.cover.shape)
            is_aside = then is not None and now.cover[around].max() <= 1 and then.cover[around].max() <= 1
            history.moving_s = history.moving_s + seconds if is_moving and is_aside else 0.0
            if is_moving:
                history.still_s, history.moved = 0.0, True
                # People who pass move the edges and the light of an object, but do not carry it away.
                history.lives = history.lives or is_aside or _has_gone(box, history.begin)
            elif pixels < motion.still:
                history.still_s += seconds if history.still_s else (now.stamp - then.stamp) / SECOND if then else 0.0
            else:
                history.still_s = max(history.still_s - _UNREST * seconds, 0.0)
        if was_object and history.moving_s >= _AWAKE_S:
            self._background.known[_inside(box, now.shapes.shape)] = False
        familiar = self._background.likeness(now, box, free)
        if familiar is not None:
            least = _SAME if is_moving and not was_object else _FAMILIAR
            if was_object and not history.moved:
                least = _STILL_VAGUE
            if familiar >= least and min(track.score, history.score) < _FAMILIAR_SCORE * self._certain:
                return True
        self._company |= is_moving
        clear = motion is not None and motion.still < _SWAY * box[3]
        alone = history.first and not history.moved and not self._company
        least = _ALONE_SCORE if clear or was_object else _ALONE_VAGUE_SCORE
        if alone and history.score < least * self._certain:
            is_object = was_object or history.still_s >= _ALONE_S
        else:
            likely = history.score >= _STILL_SCORE * self._certain
            if likely and not (clear and history.score < _ALONE_SCORE * self._certain):
                return False
            low = math.isfinite(self._certain) and history.score < _LOW_SCORE * self._certain
            least_s = _LIFE_S if history.lives else _CLEARLY_STILL_S if clear else _LOW_STILL_S if low else _STILL_S
            looks_new = familiar is not None and familiar < _STILL_VAGUE
            is_object = was_object and not is_moving and not looks_new
            if not is_object and history.still_s >= least_s:
                is_object = not likely or self._is_still_for_long(now, number, before)
        if is_object and not was_object:
            self._background.learn(now.shapes, _covered(now.shapes.shape, box[None], 0.0) & free)
        return is_object

    def _history(self, track: Track, box: np.ndarray, now: _Snapshot) -> _History:
        """The history of a track: its own, else that of a lost track in its place, else a new one."""
        history = self._histories.get(track.key)
        if history is not None:
            return history
        overlaps = iou(box, np.array([each.box for each in self._lost]).reshape(-1, 4))
        there = [each for each, overlap in zip(self._lost, overlaps, strict=True) if overlap >= _SAME_PLACE]
        same = [each for each in self._lost if each.key == track.key]
        same = same or [each for each in there if _shows(now.shapes, each) >= _FAMILIAR]
        if same:
            history = max(same, key=lambda each: each.stamp)
            self._lost = [each for each in self._lost if each not in same]
        else:
            first = now.stamp - (self._begin or 0) <= _FIRST_S * SECOND
            look = now.shapes[_inside(box, now.shapes.shape)]
            history = _History(first, track.score, now.stamp, track.key, box, look, box)
        self._histories[track.key] = history
        return history

    def _is_still_for_long(self, now: _Snapshot, number: int, before: int) -> bool:
        """Whether a box is still against the oldest image, where its track may have had the key ``before``."""
        key, oldest = now.names[number], self._views[0]
        motion = _Motion(now, oldest)
        pixels = motion.of(now.boxes[number], now.free(key) & oldest.free(_own(oldest, key, before)))
        return pixels is not None and pixels < motion.still

    def _earlier(self, stamp_ns: int) -> _Snapshot | None:
        """The image to compare with: the newest that is old enough, or else the oldest."""
        views = [view for view in self._views if stamp_ns - view.stamp >= _LEAST_LAG_S * SECOND]
        old = [view for view in views if stamp_ns - view.stamp >= _LAG_S * SECOND]
        return old[-1] if old else views[0] if views else None

    def _keep(self, now: _Snapshot, people: Sequence[int]) -> None:
        now = replace(now, boxes=now.boxes[list(people)], names=tuple(now.names[number] for number in people))
        if not self._views or now.stamp - self._views[-1].stamp >= _STEP_S * SECOND:
            self._views.append(now)
        while len(self._views) > 1 and now.stamp - self._views[0].stamp >= _LEARN_S * SECOND:
            boxes = np.vstack([now.boxes, *(view.boxes for view in self._views)])
            free = ~_covered(now.shapes.shape, boxes, _MARGIN)
            self._background.learn(self._views.popleft().shapes, free)


def _own(view: _Snapshot, key: int, before: int) -> int:
    """Key in ``view`` of a track that may have had another one ``before``."""
    return key if key in view.names else before


def _cells(image: np.ndarray) -> np.ndarray:
    """Mean of ``image`` in each whole cell."""
    height, width = (max(side // _CELL, 1) for side in image.shape)
    part = image[: height * _CELL, : width * _CELL]
    return cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)


def _view(image: np.ndarray, stamp: int, tracks: Sequence[Track]) -> _Snapshot:
    scale = min(1.0, _WIDTH / image.shape[1])
    size = (round(image.shape[1] * scale), max(1, round(image.shape[0] * scale)))
    grey = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    boxes = np.array([track.box for track in tracks], dtype=np.float64).reshape(-1, 4) * scale
    shapes = grey - _surroundings(grey)
    shapes /= cv2.sqrt(_surroundings(shapes * shapes)) + _FAINT
    mean = _cells(grey)
    variance = _cells(grey**2) - mean**2
    return _Snapshot(stamp, grey, mean, variance, shapes, clip(boxes, *size), tuple(track.key for track in tracks))


def _surroundings(image: np.ndarray) -> np.ndarray:
    """Weighted mean around each pixel. It varies slowly: half the resolution gives it in a third of the time."""
    height, width = image.shape
    half = cv2.resize(image, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA)
    return cv2.resize(cv2.GaussianBlur(half, _LARGE_SIZE, _LARGE_SIGMA), (width, height))


def _has_turned(now: _Snapshot, then: _Snapshot | None) -> bool:
    """Whether the image outside of people has changed; every second row tells it."""
    if then is None:
        return False
    rest = ~_covered(now.shapes.shape, np.vstack([now.boxes, then.boxes]), 2 * _MARGIN)
    if _share(rest) < _LEAST_REST:
        rest[:] = True
    return _correlation(now.shapes[::2], then.shapes[::2], rest[::2]) < _TURNED


def _likeness(now: np.ndarray, then: np.ndarray, box: np.ndarray, free: np.ndarray) -> float | None:
    """Correlation (-1 to 1) of two images in the free part of ``box``; None if too little is free."""
    x, y, right, bottom = _edges(box, now.shape)
    there = free[y:bottom, x:right]
    if _share(there) < _LEAST_FREE:
        return None
    return _correlation(now[y:bottom, x:right], then[y:bottom, x:right], there)


def _has_gone(box: np.ndarray, begin: np.ndarray) -> bool:
    """Whether a box has left the place where it was at the ``begin``."""
    return bool(iou(box, begin[None])[0] < _SAME_PLACE / 2)


def _shows(shapes: np.ndarray, history: _History) -> float:
    """Correlation of an image with the last look of a track in its place."""
    return _correlation(shapes[_inside(history.box, shapes.shape)], history.look)


def _share(mask: np.ndarray) -> float:
    """Share of an image that a mask covers."""
    return np.count_nonzero(mask) / mask.size


def _quantiles(values: np.ndarray, *shares: float) -> list[float]:
    """Quantiles of ``values`` (n,), n > 0, interpolated; those of numpy take 20 times as long for few values."""
    ordered = np.sort(values)
    found = []
    for share in shares:
        place = share * (len(ordered) - 1)
        below, above = ordered[[int(place), math.ceil(place)]].tolist()
        found.append(below + (above - below) * (place % 1))
    return found


def _correlation(one: np.ndarray, other: np.ndarray, there: np.ndarray | None = None) -> float:
    """Correlation of two images where the mask ``there`` is set; it does not depend on the number of threads."""
    mask = None if there is None else there.view(np.uint8)
    first, second = cv2.norm(one, cv2.NORM_L2SQR, mask), cv2.norm(other, cv2.NORM_L2SQR, mask)
    energy = math.sqrt(first * second)
    # The sum of the products, from that of the squared differences.
    return (first + second - cv2.norm(one, other, cv2.NORM_L2SQR, mask)) / 2 / energy if energy else 1.0


def _covered(shape: tuple[int, ...], boxes: Sequence[np.ndarray] | np.ndarray, margin: float) -> np.ndarray:
    """Mask of ``boxes``, each enlarged by ``margin`` of its width on all sides."""
    mask = np.zeros(shape, bool)
    for box in boxes:
        mask[_inside(_widened(box, margin), shape)] = True
    return mask


def _widened(box: np.ndarray, margin: float) -> Box:
    x, y, w, h = box.tolist()
    more = margin * w
    return x - more, y - more, w + 2 * more, h + 2 * more


def _inside(box: np.ndarray | Box, shape: tuple[int, ...]) -> tuple[slice, slice]:
    x, y, right, bottom = _edges(box, shape)
    return slice(y, bottom), slice(x, right)


def _edges(box: np.ndarray | Box, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of a box in pixels, clipped to ``shape``, at least one pixel large."""
    height, width = shape
    left, top, w, h = box.tolist() if isinstance(box, np.ndarray) else box
    x, y = min(max(0, int(left)), width - 1), min(max(0, int(top)), height - 1)
    return x, y, min(width, max(x + 1, round(left + w))), min(height, max(y + 1, round(top + h)))
