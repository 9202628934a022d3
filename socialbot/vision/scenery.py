"""What never moves is no person: coats on stands, posters, dolls.

Nobody stands so still that a camera sees nothing of it. A detected place that looks as it did a second ago, but for
the light and the camera's noise, shows a thing, unless life has been seen there not long before. Such places
are remembered: when a shadow or somebody has passed by, the same picture is the same thing.

Pictures are compared without their large shapes of light and dark, so that a lamp or the camera's gain hardly counts.
While everything changes at once - a switched lamp, a camera that turns - nothing is judged anew.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from socialbot.clock import SECOND
from socialbot.vision.boxes import clip, iou
from socialbot.vision.tracking import Track

__all__ = ["Scenery"]

_WIDTH = 320
"""Pictures are compared at this width: coarse enough to forgive a shaking wall, fine enough to see a breath nearby."""
_LAG_S = 1.0
"""What looks as it did so long ago has not moved ..."""
_LEAST_LAG_S = 0.4
"""... and while there is no such picture yet, as it did so long ago."""
_STEP_S = 0.2
"""How far apart the pictures are that are kept."""
_LIFE_S = 30.0
"""So long somebody may stand like a stone."""
_ALIVE = 0.03
"""The share of a box's pixels that life changes, at least."""
_UNREST = 0.15
"""When this share of everything else changes too, it is the light or the camera."""
_MOST_NOISE = 6.0
"""Standard error of the camera's noise at this width, grey levels; what changes more is no noise."""
_LARGE_SIGMA = 4.0
"""What is larger than about so many pixels is light and dark, not shape."""
_NOISE_FACTOR, _LEAST_CHANGE = 5.0, 3.0
"""A pixel has changed when it differs by this multiple of the noise, and by so many grey levels."""
_ROOM = 0.3
"""The share of a box that others leave free, from which that part alone is looked at."""
_LEAST_REST = 0.05
"""When people take up all but this share of the picture, all of it has to do."""
_SAME_PLACE = 0.5
_SAME_BOX = 0.75
"""Who has not moved before and is found just where a thing is, is that thing."""
_PLACES, _LOOKS = 60, 4
"""So many things are remembered, and so many looks of one: in this light and that."""
_MOST_GAIN = 1.6
"""How much more, or less, one place may follow the light than the picture."""


@dataclass(frozen=True, eq=False)
class _View:
    """A picture's shapes, (height, width), float32, and where people or things were found in it, (n, 4)."""

    stamp: int
    shapes: np.ndarray
    boxes: np.ndarray


class _Change:
    """What has changed between two pictures, and whether that is so ``everywhere``."""

    def __init__(self, now: _View, then: _View) -> None:
        rest = ~_covered(now.shapes.shape, np.vstack([now.boxes, then.boxes]), margin=0.2)
        if rest.mean() < _LEAST_REST:
            rest[:] = True
        self._now, self._then = now.shapes, then.shapes
        self._gain = _gain(now.shapes[rest], then.shapes[rest])
        difference = np.abs(now.shapes[rest] - np.float32(self._gain) * then.shapes[rest])
        # Most of a picture shows nothing that moves, so the median tells the noise.
        self._least = max(_LEAST_CHANGE, _NOISE_FACTOR * min(1.48 * float(np.median(difference)), _MOST_NOISE))
        self.everywhere = float((difference > self._least).mean()) > _UNREST

    def within(self, box: np.ndarray, others: np.ndarray) -> bool | None:
        """Whether something has moved in ``box`` outside of ``others``, (n, 4); None where these leave little room."""
        x, y, right, bottom = _edges(box, self._now.shape)
        free = ~_covered(self._now.shape, others, margin=0.1)[y:bottom, x:right]
        if free.mean() < _ROOM:
            return None
        new, old = (shapes[y:bottom, x:right][free] for shapes in (self._now, self._then))
        # Light changes more in one place than in another, and dark things follow it less.
        gain = min(max(_gain(new, old), self._gain / _MOST_GAIN), self._gain * _MOST_GAIN)
        return float((np.abs(new - np.float32(gain) * old) > self._least).mean()) > _ALIVE


@dataclass(eq=False)
class _Thing:
    """A place where nothing moves: its box, (4,), and a picture in which it can be seen."""

    box: np.ndarray
    view: _View


class Scenery:
    """Tells people from things by whether they move; for one camera that mostly keeps its place."""

    def __init__(self) -> None:
        self._views: deque[_View] = deque()
        self._things: list[_Thing] = []
        self._alive: dict[str, int] = {}  # when each track last showed life

    def people(self, image_bgr: np.ndarray, stamp_ns: int, tracks: Sequence[Track]) -> tuple[Track, ...]:
        """Those of ``tracks`` that are no things, in the picture taken at ``stamp_ns``, (height, width, 3), uint8."""
        if self._views and stamp_ns < self._views[-1].stamp:
            self._forget()  # Time has begun anew: another recording, or a clock that was set.
        now = _view(image_bgr, stamp_ns, tracks)
        before = self._before(stamp_ns)
        change = _Change(now, before) if before is not None else None
        kept = [track for number, track in enumerate(tracks) if self._is_person(track.id, number, now, before, change)]
        self._keep(now, {track.id for track in tracks})
        return tuple(kept)

    def _is_person(self, name: str, number: int, now: _View, before: _View | None, change: _Change | None) -> bool:
        box, others = now.boxes[number], np.delete(now.boxes, number, axis=0)
        restless = change is not None and change.everywhere
        things = self._things_at(box)
        if any(self._is_still(thing, others, now, restless) for thing in things):
            self._alive.pop(name, None)
            return False
        if name not in self._alive and any(_overlap(box, thing.box) >= _SAME_BOX for thing in things):
            return False  # Shadows and light change a thing's looks, but not its place.
        if before is None or change is None or restless:
            return True
        # Where others are now, and where they were then, they have changed the picture.
        then = before.boxes[iou(box, before.boxes) < _SAME_PLACE]
        moved = change.within(box, np.vstack([others, then]))
        if moved is None:
            return not things or name in self._alive
        if moved:
            self._alive[name] = now.stamp
        if name in self._alive and now.stamp - self._alive[name] <= _LIFE_S * SECOND:
            return True
        self._things = [*self._things[-_PLACES + 1 :], _Thing(box, now)]
        return False

    def _is_still(self, thing: _Thing, others: np.ndarray, now: _View, restless: bool) -> bool:
        """Whether ``thing`` is still to be seen at its place."""
        if restless:
            thing.view = now
            return True
        return _Change(now, thing.view).within(thing.box, others) is False

    def _things_at(self, box: np.ndarray) -> list[_Thing]:
        """The things remembered at the place of ``box``, the latest first."""
        if not self._things:
            return []
        same = iou(box, np.array([thing.box for thing in self._things])) >= _SAME_PLACE
        return [self._things[number] for number in np.flatnonzero(same)[::-1][:_LOOKS]]

    def _before(self, stamp_ns: int) -> _View | None:
        """The picture to compare with: the newest of those that are old enough, or else the oldest."""
        old = [view for view in self._views if stamp_ns - view.stamp >= _LAG_S * SECOND]
        if old:
            return old[-1]
        oldest = self._views[0] if self._views else None
        return oldest if oldest is not None and stamp_ns - oldest.stamp >= _LEAST_LAG_S * SECOND else None

    def _keep(self, now: _View, names: set[str]) -> None:
        if not self._views or now.stamp - self._views[-1].stamp >= _STEP_S * SECOND:
            self._views.append(now)
        while len(self._views) > 1 and now.stamp - self._views[1].stamp >= _LAG_S * SECOND:
            self._views.popleft()
        limit = now.stamp - _LIFE_S * SECOND
        self._alive = {name: stamp for name, stamp in self._alive.items() if name in names or stamp >= limit}

    def _forget(self) -> None:
        self._views.clear()
        self._things.clear()
        self._alive.clear()


def _view(image: np.ndarray, stamp: int, tracks: Sequence[Track]) -> _View:
    scale = min(1.0, _WIDTH / image.shape[1])
    size = (round(image.shape[1] * scale), max(1, round(image.shape[0] * scale)))
    grey = cv2.resize(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), size, interpolation=cv2.INTER_AREA).astype(np.float32)
    boxes = np.array([track.box for track in tracks], dtype=np.float64).reshape(-1, 4) * scale
    return _View(stamp, grey - cv2.GaussianBlur(grey, (0, 0), _LARGE_SIGMA), clip(boxes, *size))


def _overlap(one: np.ndarray, other: np.ndarray) -> float:
    return float(iou(one, other[None])[0])


def _gain(new: np.ndarray, old: np.ndarray) -> float:
    """How much brighter it has become: by a lamp, or by the camera's gain; shapes stay the same."""
    energy = float((old * old).sum(dtype=np.float64))
    return float((new * old).sum(dtype=np.float64)) / energy if energy else 1.0


def _covered(shape: tuple[int, ...], boxes: np.ndarray, *, margin: float) -> np.ndarray:
    """The pixels within ``boxes``, each larger by ``margin`` of its width on all sides: bool of this ``shape``."""
    mask = np.zeros(shape, bool)
    for box in boxes:
        x, y, right, bottom = _edges(box + margin * box[2] * np.array([-1, -1, 2, 2]), shape)
        mask[y:bottom, x:right] = True
    return mask


def _edges(box: np.ndarray, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of a box in whole pixels: one at least, within ``shape``."""
    height, width = shape
    x, y = min(max(0, int(box[0])), width - 1), min(max(0, int(box[1])), height - 1)
    right, bottom = round(box[0] + box[2]), round(box[1] + box[3])
    return x, y, min(width, max(x + 1, right)), min(height, max(y + 1, bottom))
