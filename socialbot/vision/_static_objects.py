"""Remove tracks of static objects: coats on stands, posters, dolls.

A person always moves a little. A box that looks as it did a second ago shows an object, unless it moved shortly
before. A box that looks like the background (`_Background`, the scene without people) shows an object as well. An
object therefore stays one when a shadow falls on it, when a person passes in front of it, and when the track of that
person jumps to it.

Images are compared by local contrast, which light and shadow hardly change. While the whole image changes because the
camera turns, no track changes its class.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from socialbot.core.clock import SECOND
from socialbot.vision.detector import clip
from socialbot.vision.tracking import Track

_WIDTH = 320  # Images are compared at this width: coarse for vibrations, fine enough for breathing.
_LARGE_SIGMA = 4.0  # Contrast is local to about this many pixels.
_FAINT = 3.0  # Contrast of fewer grey levels is noise.

_LAG_S = 1.0  # Age of the image to compare with;
_LEAST_LAG_S = 0.2  # younger ones are used if that one shows too little of the box.
_STEP_S = 0.2  # Interval of the images that are kept.
_STILL = 0.9  # A box is still from this correlation,
_SHORT_S, _STILL_SHORT = 0.4, 0.97  # or from this one after less time, in which a person moves little.
_LIFE_S = 30.0  # A person may stand still for this long,
_LIFE_UNKNOWN_S = 2.0  # and for this long where the background is unknown.

_LEARN_S = 2.0  # Pixels without people for this long are background; detectors miss people for less.
_FAMILIAR = 0.8  # A box shows background from this correlation,
_VAGUE = 0.6  # from this one if its track never moved,
_STILL_VAGUE = 0.45  # and from this one if it was an object before, of which a person may hide a half.
_STIRRED = 0.75  # Below this correlation such a box has moved; shadows change less.

_TURNED = 0.5  # The camera turns when the rest of the image correlates less.
_LEAST_FREE = 0.3  # A box is compared where it is free of other people, if that is this share of it.
_LEAST_REST = 0.05  # If people leave less of the image, all of it is compared.
_MIDDLE = np.array([0.25, 0.0, 0.5, 0.6])  # Part of a box that a person fills: x, y, w, h as shares.
_MARGIN = 0.1  # People may exceed their box by this share of its width.


@dataclass(frozen=True, eq=False)
class _Snapshot:
    """Local contrast ``shapes`` of an image, (height, width), float32, with boxes (n, 4) and ids of its tracks."""

    stamp: int
    shapes: np.ndarray
    boxes: np.ndarray
    names: tuple[str, ...]

    def free(self, name: str) -> np.ndarray:
        """Mask of the image without the boxes of other tracks."""
        return ~_covered(self.shapes.shape, self.boxes[[each != name for each in self.names]], _MARGIN)


class _Background:
    """Local contrast of the scene without people, valid where ``known``; arrays of shape (height, width)."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shapes = np.zeros(shape, np.float32)
        self.known = np.zeros(shape, bool)

    def learn(self, shapes: np.ndarray, free: np.ndarray) -> None:
        self.shapes[free] = shapes[free]
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


class StaticObjectFilter:
    """Removes tracks that never move, for one camera that is mostly at rest."""

    def __init__(self) -> None:
        self._forget((0, 0))

    def _forget(self, shape: tuple[int, ...]) -> None:
        self._views: deque[_Snapshot] = deque()
        self._background = _Background(shape)
        self._moved: dict[str, int] = {}  # last motion of each track
        self._objects: set[str] = set()  # objects in the last image

    def people(self, image_bgr: np.ndarray, stamp_ns: int, tracks: Sequence[Track]) -> tuple[Track, ...]:
        """The tracks that are not static objects in the image (height, width, 3), uint8, taken at ``stamp_ns``."""
        now = _view(image_bgr, stamp_ns, tracks)
        # An earlier stamp means another recording, or that a clock was set.
        is_new = self._views and stamp_ns < self._views[-1].stamp
        if is_new or now.shapes.shape != self._background.known.shape:
            self._forget(now.shapes.shape)
        earlier = self._earlier(stamp_ns)
        is_turning = bool(earlier) and _has_turned(now, earlier[0])
        people = [
            number
            for number, track in enumerate(tracks)
            if self._is_person(track.id, number, now, [] if is_turning else earlier, is_turning=is_turning)
        ]
        kept = tuple(tracks[number] for number in people)
        names = {track.id for track in tracks}
        self._objects = names - {track.id for track in kept}
        self._keep(replace(now, boxes=now.boxes[people], names=tuple(track.id for track in kept)), names)
        return kept

    def _is_person(
        self, name: str, number: int, now: _Snapshot, earlier: Sequence[_Snapshot], *, is_turning: bool
    ) -> bool:
        box = now.boxes[number]
        free = now.free(name)
        familiar = self._background.likeness(now, box, free)
        if familiar is not None and familiar >= _FAMILIAR:
            self._moved.pop(name, None)
            return False
        was_object = name in self._objects
        if familiar is None:
            vague = was_object
        else:
            vague = name not in self._moved and familiar >= (_STILL_VAGUE if was_object else _VAGUE)
        since = _since(now, earlier, name, box, free)
        if since is None:
            return not (vague or (is_turning and was_object))
        likeness, lag_s = since
        if likeness < (_STIRRED if vague else _STILL):
            self._moved[name] = now.stamp
        if lag_s < _SHORT_S and likeness < _STILL_SHORT and not vague:
            return True
        life_s = _LIFE_UNKNOWN_S if familiar is None else _LIFE_S
        return name in self._moved and now.stamp - self._moved[name] <= life_s * SECOND

    def _earlier(self, stamp_ns: int) -> list[_Snapshot]:
        """The images to compare with: the newest that is old enough, and younger ones."""
        views = [view for view in self._views if stamp_ns - view.stamp >= _LEAST_LAG_S * SECOND]
        old = sum(stamp_ns - view.stamp >= _LAG_S * SECOND for view in views)
        return views[max(old - 1, 0) :]

    def _keep(self, now: _Snapshot, names: set[str]) -> None:
        if not self._views or now.stamp - self._views[-1].stamp >= _STEP_S * SECOND:
            self._views.append(now)
        while len(self._views) > 1 and now.stamp - self._views[0].stamp >= _LEARN_S * SECOND:
            boxes = np.vstack([now.boxes, *(view.boxes for view in self._views)])
            free = ~_covered(now.shapes.shape, boxes, _MARGIN)
            self._background.learn(self._views.popleft().shapes, free)
        limit = now.stamp - _LIFE_S * SECOND
        self._moved = {name: stamp for name, stamp in self._moved.items() if name in names or stamp >= limit}


def _view(image: np.ndarray, stamp: int, tracks: Sequence[Track]) -> _Snapshot:
    scale = min(1.0, _WIDTH / image.shape[1])
    size = (round(image.shape[1] * scale), max(1, round(image.shape[0] * scale)))
    grey = cv2.resize(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), size, interpolation=cv2.INTER_AREA).astype(np.float32)
    boxes = np.array([track.box for track in tracks], dtype=np.float64).reshape(-1, 4) * scale
    shapes = grey - cv2.GaussianBlur(grey, (0, 0), _LARGE_SIGMA)
    shapes /= np.sqrt(cv2.GaussianBlur(shapes * shapes, (0, 0), _LARGE_SIGMA)) + _FAINT
    return _Snapshot(stamp, shapes, clip(boxes, *size), tuple(track.id for track in tracks))


def _since(
    now: _Snapshot, earlier: Sequence[_Snapshot], name: str, box: np.ndarray, free: np.ndarray
) -> tuple[float, float] | None:
    """Correlation of ``box`` with itself in the first of ``earlier`` that shows it, and the age of that image, s.

    None if other people hide too much of it in all of them.
    """
    for view in earlier:
        likeness = _likeness(now.shapes, view.shapes, box, free & view.free(name))
        if likeness is not None:
            return likeness, (now.stamp - view.stamp) / SECOND
    return None


def _has_turned(now: _Snapshot, then: _Snapshot) -> bool:
    """Whether the image outside of people has changed."""
    rest = ~_covered(now.shapes.shape, np.vstack([now.boxes, then.boxes]), 2 * _MARGIN)
    if rest.mean() < _LEAST_REST:
        rest[:] = True
    return _correlation(now.shapes[rest], then.shapes[rest]) < _TURNED


def _likeness(now: np.ndarray, then: np.ndarray, box: np.ndarray, free: np.ndarray) -> float | None:
    """Correlation (-1 to 1) of two images in the free part of ``box``; None if too little is free."""
    x, y, right, bottom = _edges(box, now.shape)
    there = free[y:bottom, x:right]
    if there.mean() < _LEAST_FREE:
        return None
    return _correlation(now[y:bottom, x:right][there], then[y:bottom, x:right][there])


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    energy = float((one * one).sum()) * float((other * other).sum())
    return float((one * other).sum()) / math.sqrt(energy) if energy else 1.0


def _covered(shape: tuple[int, ...], boxes: np.ndarray, margin: float) -> np.ndarray:
    """Mask of ``boxes``, each enlarged by ``margin`` of its width on all sides."""
    mask = np.zeros(shape, bool)
    for box in boxes:
        x, y, right, bottom = _edges(box + margin * box[2] * np.array([-1, -1, 2, 2]), shape)
        mask[y:bottom, x:right] = True
    return mask


def _edges(box: np.ndarray, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of a box in pixels, clipped to ``shape``, at least one pixel large."""
    height, width = shape
    x, y = min(max(0, int(box[0])), width - 1), min(max(0, int(box[1])), height - 1)
    right, bottom = round(box[0] + box[2]), round(box[1] + box[3])
    return x, y, min(width, max(x + 1, right)), min(height, max(y + 1, bottom))
