"""What never moves is no person: coats on stands, posters, dolls.

Nobody stands so still that a camera sees nothing of it. A detected place that looks as it did a second ago shows a
thing, unless life has been seen there not long before. And what looks as its place did before anybody was there is
that place: `_Background` is the picture without people. So a thing stays one when shadows fall on it, when somebody
passes before it, and when a track goes over to it from who has passed.

Pictures are compared by their shapes, each as strong as those around it: light and shadow change few of them.
While everything changes at once, because the camera turns, nothing is judged anew.
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

__all__ = ["StaticObjectFilter"]

_WIDTH = 320
"""Pictures are compared at this width: coarse enough to forgive a shaking wall, fine enough to see a breath nearby."""
_LARGE_SIGMA = 4.0
"""What is larger than about so many pixels is light and dark, not shape."""
_FAINT = 3.0
"""Shapes of fewer grey levels than about so many are lost in the noise."""

_LAG_S = 1.0
"""What looks as it did so long ago has not moved ..."""
_LEAST_LAG_S = 0.2
"""... and while that cannot be seen, as it did so long ago."""
_STEP_S = 0.2
"""How far apart the pictures are that are kept."""
_STILL = 0.9
"""What is so much like itself (1 is wholly) has not moved ..."""
_SHORT_S, _STILL_SHORT = 0.4, 0.97
"""... but in less than so long nobody gets far: what is less than so much like itself may still be moving."""
_LIFE_S = 30.0
"""So long somebody may stand like a stone ..."""
_LIFE_UNKNOWN_S = 2.0
"""... and so long where nobody knows what the place looks like without them: it may be a thing that somebody passed."""

_LEARN_S = 2.0
"""What nobody has covered for so long is background: longer than a detector usually overlooks somebody."""
_FAMILIAR = 0.8
"""What is so much like the background is nothing else ..."""
_VAGUE = 0.6
"""... and so much will do for who has never moved ..."""
_STILL_VAGUE = 0.45
"""... and so much for what was a thing a moment ago: somebody may stand before a half of it."""
_STIRRED = 0.75
"""Of what is vaguely like the background, only what changes more than this has moved: shadows change a thing, too."""

_TURNED = 0.5
"""When all but people is less like itself than this, everything has changed."""
_ROOM = 0.3
"""The share of a box that others leave free, from which that part alone is looked at."""
_LEAST_REST = 0.05
"""When people take up all but this share of the picture, all of it has to do."""
_MIDDLE = np.array([0.25, 0.0, 0.5, 0.6])
"""The part of a box, x, y, w, h as shares of it, that is taken up by whoever is in it."""
_MARGIN = 0.1
"""So much of a box's width people may reach beyond it."""


@dataclass(frozen=True, eq=False)
class _Snapshot:
    """A picture's shapes, (height, width), float32, and in it the boxes, (n, 4), of the tracks of these ``names``."""

    stamp: int
    shapes: np.ndarray
    boxes: np.ndarray
    names: tuple[str, ...]

    def others(self, name: str) -> np.ndarray:
        """The boxes of all tracks but that of this ``name``, (n, 4)."""
        return self.boxes[[each != name for each in self.names]]

    def only(self, numbers: Sequence[int]) -> _Snapshot:
        """The same picture with those of its tracks that have these ``numbers``."""
        return replace(self, boxes=self.boxes[list(numbers)], names=tuple(self.names[number] for number in numbers))


class _Background:
    """What a camera sees without people: ``shapes``, float32, where ``known``, bool, both (height, width)."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shapes = np.zeros(shape, np.float32)
        self.known = np.zeros(shape, bool)

    def learn(self, shapes: np.ndarray, free: np.ndarray) -> None:
        """Takes over ``shapes`` where they are ``free`` of people."""
        self.shapes[free] = shapes[free]
        self.known |= free

    def likeness(self, now: _Snapshot, box: np.ndarray, free: np.ndarray) -> float | None:
        """How much ``box`` is like the background, where it is ``free`` of others or, if that is little, everywhere.

        Where its middle is more so, that counts: it is not where somebody stands, but a thing with somebody before it.
        """
        whole = _likeness(now.shapes, self.shapes, box, self.known & free)
        if whole is None:
            whole = _likeness(now.shapes, self.shapes, box, self.known)
        middle = np.hstack([box[:2] + _MIDDLE[:2] * box[2:], _MIDDLE[2:] * box[2:]])
        looks = whole, _likeness(now.shapes, self.shapes, middle, self.known)
        return max((look for look in looks if look is not None), default=None)


class StaticObjectFilter:
    """Tells people from things by whether they move; for one camera that mostly keeps its place."""

    def __init__(self) -> None:
        self._forget((0, 0))

    def _forget(self, shape: tuple[int, ...]) -> None:
        self._views: deque[_Snapshot] = deque()  # with people only
        self._background = _Background(shape)
        self._alive: dict[str, int] = {}  # when each track last showed life
        self._things: set[str] = set()  # the tracks that were things in the last picture

    def people(self, image_bgr: np.ndarray, stamp_ns: int, tracks: Sequence[Track]) -> tuple[Track, ...]:
        """Those of ``tracks`` that are no things, in the picture taken at ``stamp_ns``, (height, width, 3), uint8."""
        now = _view(image_bgr, stamp_ns, tracks)
        # Time that begins anew is another recording, or a clock that was set.
        anew = self._views and stamp_ns < self._views[-1].stamp
        if anew or now.shapes.shape != self._background.known.shape:
            self._forget(now.shapes.shape)
        earlier = self._earlier(stamp_ns)
        restless = bool(earlier) and _turned(now, earlier[0])
        people = [
            number
            for number, track in enumerate(tracks)
            if self._is_person(track.id, number, now, [] if restless else earlier, restless=restless)
        ]
        kept = tuple(tracks[number] for number in people)
        self._things = {track.id for track in tracks} - {track.id for track in kept}
        self._keep(now.only(people), {track.id for track in tracks})
        return kept

    def _is_person(
        self, name: str, number: int, now: _Snapshot, earlier: Sequence[_Snapshot], *, restless: bool
    ) -> bool:
        box = now.boxes[number]
        free = ~_covered(now.shapes.shape, now.others(name), _MARGIN)
        familiar = self._background.likeness(now, box, free)
        if familiar is not None and familiar >= _FAMILIAR:
            self._alive.pop(name, None)
            return False
        was_thing = name in self._things
        if familiar is None:
            vague = was_thing
        else:
            vague = name not in self._alive and familiar >= (_STILL_VAGUE if was_thing else _VAGUE)
        since = _since(now, earlier, name, box, free)
        if since is None:
            return not (vague or (restless and was_thing))
        likeness, lag_s = since
        if likeness < (_STIRRED if vague else _STILL):
            self._alive[name] = now.stamp
        if lag_s < _SHORT_S and likeness < _STILL_SHORT and not vague:
            return True
        life_s = _LIFE_UNKNOWN_S if familiar is None else _LIFE_S
        return name in self._alive and now.stamp - self._alive[name] <= life_s * SECOND

    def _earlier(self, stamp_ns: int) -> list[_Snapshot]:
        """The pictures to compare with: the newest of those that are old enough, and what came after."""
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
        self._alive = {name: stamp for name, stamp in self._alive.items() if name in names or stamp >= limit}


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
    """How much ``box`` is like itself in the first of ``earlier`` that shows it, and how many seconds ago that was.

    None where all show too little of it: where people are now, or were then, they have changed the picture.
    """
    for view in earlier:
        then = _covered(now.shapes.shape, view.others(name), _MARGIN)
        likeness = _likeness(now.shapes, view.shapes, box, free & ~then)
        if likeness is not None:
            return likeness, (now.stamp - view.stamp) / SECOND
    return None


def _turned(now: _Snapshot, then: _Snapshot) -> bool:
    """Whether what is not taken up by people has changed."""
    rest = ~_covered(now.shapes.shape, np.vstack([now.boxes, then.boxes]), 2 * _MARGIN)
    if rest.mean() < _LEAST_REST:
        rest[:] = True
    return _correlation(now.shapes[rest], then.shapes[rest]) < _TURNED


def _likeness(now: np.ndarray, then: np.ndarray, box: np.ndarray, free: np.ndarray) -> float | None:
    """How much alike ``now`` and ``then``, (height, width), are in ``box`` where it is ``free``: -1 to 1.

    None where that is too little of it.
    """
    x, y, right, bottom = _edges(box, now.shape)
    there = free[y:bottom, x:right]
    if there.mean() < _ROOM:
        return None
    return _correlation(now[y:bottom, x:right][there], then[y:bottom, x:right][there])


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    energy = float((one * one).sum()) * float((other * other).sum())
    return float((one * other).sum()) / math.sqrt(energy) if energy else 1.0


def _covered(shape: tuple[int, ...], boxes: np.ndarray, margin: float) -> np.ndarray:
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
