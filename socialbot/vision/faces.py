"""Faces of tracked people, and the direction that people face."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from socialbot.core.clock import SECOND
from socialbot.vision._occlusion import USUAL_ASPECT
from socialbot.vision.distance import Estimate
from socialbot.vision.network import OnnxModel, View, included_model
from socialbot.vision.tracking import Track

SHA256 = "d5c7dcdb5537bcc224c29a9f00ffa58d8ee2049f40e54ef0cf7ce2ff96ec5c98"
"""Checksum of the BlazeFace weights."""
_FILE = "blazeface.onnx"
_SIZE = 128  # Width and height of the network's input, pixels.
_LEVELS = ((8, 2), (16, 6))  # Pixels and anchors of a cell.
_LEAST_SCORE = 0.65  # Backs of heads reach 0.64.

# Region of the head: side as a share of the height and of the width of a person's box, and the part above the box.
_HEIGHT_SHARE, _WIDTH_SHARE, _ABOVE = 0.3, 0.75, 0.15
_WIDEST = 0.6  # Largest side: share of the height of the box.
_HEAD_SHARE = 0.13  # Height of a head: share of the height of a standing person.
_NOSE = 1.6  # Distance of the nose from the line between the ears, in halves of that line.


@dataclass(frozen=True)
class Face:
    """Face in an image.

    Args:
        box: x, y, w, h in pixels; from the eyebrows to the chin.
        score: 0 to 1.
        turn_rad: Angle between the direction of the face and the direction to the camera, positive to the right side
            of the image.
    """

    box: tuple[float, float, float, float]
    score: float
    turn_rad: float


class FaceDetector:
    """BlazeFace on the heads of detected people."""

    def __init__(self) -> None:
        """Load the network. Raises InstallationError if onnxruntime or the weights are missing."""
        self._network = OnnxModel(included_model(_FILE, SHA256), where=f"socialbot/vision/models/{_FILE}")
        self._anchors = _anchors()

    def find(self, image: np.ndarray, person: np.ndarray) -> Face | None:
        """The face of a ``person`` (x, y, w, h in pixels) in ``image``, shape (height, width, 3), uint8, BGR."""
        view = _head_view(person, image.shape[1], image.shape[0])
        if view is None:
            return None
        data = view.cut(image).transpose(2, 0, 1)[::-1].astype(np.float32, order="C")
        data /= 127.5
        data -= 1.0
        rows = self._network.run(data)[0][0].astype(np.float64)
        scores = 1.0 / (1.0 + np.exp(-np.clip(rows[:, 0], -50.0, 50.0)))
        good = scores >= _LEAST_SCORE
        if not good.any():
            return None
        scores, rows, anchors = scores[good], rows[good, 1:], self._anchors[good]
        best = int(scores.argmax())
        centres = rows[:, :2] + anchors
        # Neighbouring anchors find the same face: their mean is more accurate.
        same = np.abs(centres - centres[best]).max(axis=1) < rows[best, 2] / 2
        weights = scores[same, None] / scores[same].sum()
        points = ((rows[same, 4:].reshape(-1, 6, 2) + anchors[same, None]) * weights[:, :, None]).sum(axis=0)
        centre, size = (centres[same] * weights).sum(axis=0), (rows[same, 2:4] * weights).sum(axis=0)
        x, y, w, h = view.back(np.concatenate([centre - size / 2, size])[None])[0].tolist()
        return Face((x, y, w, h), float(scores[best]), _turn(points))


def _anchors() -> np.ndarray:
    """Middles of the anchors in pixels of the input, shape (896, 2)."""
    levels = []
    for cell, count in _LEVELS:
        row, column = np.divmod(np.arange((_SIZE // cell) ** 2), _SIZE // cell)
        levels.append(np.repeat((np.stack([column, row], axis=1) + 0.5) * cell, count, axis=0))
    return np.vstack(levels)


def _head_view(person: np.ndarray, width: int, height: int) -> View | None:
    """Square view of the head of a ``person``; None if it is outside the image."""
    x, y, w, h = person.tolist()
    side = min(max(_HEIGHT_SHARE * h, _WIDTH_SHARE * w), _WIDEST * h)
    if side < 1:
        return None
    left, top, scale = x + (w - side) / 2, y - _ABOVE * side, _SIZE / side
    first = (max(0, round(left)), max(0, round(top)))
    last = (min(width, round(left + side)), min(height, round(top + side)))
    across, down = (min(round((end - start) * scale), _SIZE) for start, end in zip(first, last, strict=True))
    if across < 1 or down < 1:
        return None
    beside = min(max(round((first[0] - left) * scale), 0), _SIZE - across)
    above = min(max(round((first[1] - top) * scale), 0), _SIZE - down)
    return View(*first, last[0] - first[0], last[1] - first[1], _SIZE, _SIZE, across, down, beside, above)


def _turn(points: np.ndarray) -> float:
    """Turn of a face with these points: eyes, nose, mouth and ears, right ones first; (6, 2)."""
    _, _, nose, _, right, left = points[:, 0]
    return math.atan2((nose - (left + right) / 2) / _NOSE, max((left - right) / 2, 1e-3))


_PAUSE_S = 0.15  # Least time between two searches for the same face.
_LEAST_HEAD, _CLEAR_HEAD, _LARGE_HEAD = 20.0, 28.0, 40.0  # Heads are searched for faces from the first size on: pixels.
# Log odds that a person faces the camera, by one search: rounded ones of people who do, and who turn their back.
_SURE_FACE = 0.75  # Score from which a face tells much. Hair at the back of a head sometimes looks like a weaker one.
_SURE_ODDS, _WEAK_ODDS = 3.0, 1.0
# No face on a head that is clear, or large; on smaller ones it tells nothing.
_NONE_ODDS, _NONE_LARGE_ODDS = -1.0, -2.0
_LEAST_ODDS, _MOST_ODDS = -6.0, 5.0  # Odds stay between these, so that they follow a turn.
_SURE_BOX = 0.5  # A head without a face tells something if the box of the person has this score.
_FACES_ODDS, _BACK_ODDS = 1.0, -5.0  # From the first odds on a person faces the camera, until the second one not.
_SMOOTHING = 0.5  # Weight of a new turn.
_KEPT_S = 1.0  # A face counts for this long.
_CERTAIN_FACES, _PERSON_S = 3, 30.0  # So many faces show a person, for this long,
_LIVE, _LIVE_PX = 0.015, 0.25  # if their middles spread by this share of their width. Printed faces stay in place.
_MOST_FACES = 12
_AWAY_RAD = 2.5  # Assumed direction of a person who stands and turns their back.

_WALK_S, _LEAST_WALK_S, _LEAST_POINTS = 1.2, 0.6, 5  # Duration of a walk that shows its direction.
_WALKING_MPS = 0.5
_LEAVES_RAD, _LEAVES_SIGMA = 1.75, 2.0  # Nobody shows a face who walks away by this angle, and so many standard errors.


@dataclass
class Attention:
    """Direction that one tracked person faces, from the face or else from the walking direction.

    ``velocity`` is the mean one relative to the camera, m/s: forward and to the left; None if it is not known.
    """

    face: Face | None = None
    turn_rad: float = 0.0
    looked: int | None = None
    found: int | None = None
    faces: int = 0
    odds: float = 0.0
    velocity: tuple[float, float] | None = None
    _is_live: bool = False
    _places: deque[tuple[int, float, float]] = field(default_factory=deque)
    _errors: deque[float] = field(default_factory=deque)
    _faces: deque[tuple[float, float, float]] = field(default_factory=lambda: deque(maxlen=_MOST_FACES))

    def see(self, stamp: int, face: Face | None, *, head_px: float) -> None:
        """Record a search on a head of this height; 0 if the box of the person is not certain."""
        self.looked, self.face = stamp, face
        self.odds = min(max(self.odds + _odds(face, head_px), _LEAST_ODDS), _MOST_ODDS)
        if face is not None:
            recent = self.found is not None and stamp - self.found <= _KEPT_S * SECOND
            share = _SMOOTHING if recent else 1.0
            self.turn_rad += share * (face.turn_rad - self.turn_rad)
            self.found = stamp
            self.faces += 1
            x, y, w, h = face.box
            self._faces.append((x + w / 2, y + h / 2, w))
            across, down, width = np.array(self._faces).T
            spread = max(float(across.std()), float(down.std()))
            self._is_live = spread >= max(_LIVE * float(np.median(width)), _LIVE_PX)

    def is_person(self, stamp: int) -> bool:
        """Whether faces have shown that this is a person, and not the picture of one."""
        recent = stamp - (self.found or 0) <= _PERSON_S * SECOND
        return self.faces >= _CERTAIN_FACES and recent and self._is_live

    def walk(self, stamp: int, distance: Estimate, bearing_rad: float) -> None:
        """Record the place of the person, relative to the camera."""
        ahead, aside = distance.value * math.cos(bearing_rad), distance.value * math.sin(bearing_rad)
        self._places.append((stamp, ahead, aside))
        self._errors.append(distance.std)
        while stamp - self._places[0][0] > _WALK_S * SECOND:
            self._places.popleft()
            self._errors.popleft()
        self.velocity = self._mean_velocity()

    def facing_rad(self, stamp: int) -> float | None:
        """Angle between the direction that the person faces and the direction to the camera, 0 to pi."""
        course = self._course()
        if course is not None and course >= _LEAVES_RAD and self._leaves():
            return course
        if self.found is not None and stamp - self.found <= _KEPT_S * SECOND and self.odds >= _FACES_ODDS:
            return abs(self.turn_rad)
        if course is not None:
            return course
        return _AWAY_RAD if self.odds <= _BACK_ODDS else None

    def _course(self) -> float | None:
        """Angle between the walking direction and the direction to the camera; None of people who do not walk."""
        if self.velocity is None or math.hypot(*self.velocity) < _WALKING_MPS:
            return None
        _, x, y = self._places[-1]
        ahead, aside = self.velocity
        toward = -(ahead * x + aside * y) / (math.hypot(ahead, aside) * max(math.hypot(x, y), 1e-6))
        return math.acos(min(max(toward, -1.0), 1.0))

    def _leaves(self) -> bool:
        """Whether the distance has grown by more than its errors explain."""
        (_, x0, y0), (_, x1, y1) = self._places[0], self._places[-1]
        grown = math.hypot(x1, y1) - math.hypot(x0, y0)
        return grown >= _LEAVES_SIGMA * math.hypot(self._errors[0], self._errors[-1])

    def approach_mps(self) -> float | None:
        """Speed towards the camera."""
        if self.velocity is None:
            return None
        _, x, y = self._places[-1]
        ahead, aside = self.velocity
        return -(ahead * x + aside * y) / max(math.hypot(x, y), 1e-6)

    def _mean_velocity(self) -> tuple[float, float] | None:
        if len(self._places) < _LEAST_POINTS or self._places[-1][0] - self._places[0][0] < _LEAST_WALK_S * SECOND:
            return None
        rows = np.array(self._places, np.float64)
        times = (rows[:, 0] - rows[-1, 0]) / SECOND
        times -= times.mean()
        return tuple((times @ rows[:, 1:] / (times @ times)).tolist())


def _odds(face: Face | None, head_px: float) -> float:
    """Log odds that a person faces the camera by one search of the head."""
    if face is None:
        return 0.0 if head_px < _CLEAR_HEAD else _NONE_ODDS if head_px < _LARGE_HEAD else _NONE_LARGE_ODDS
    return _SURE_ODDS if face.score >= _SURE_FACE else _WEAK_ODDS


def _head_px(track: Track) -> float:
    """Height of the head of a person, pixels; the width of a box that the image cuts off below tells the size."""
    _, _, w, h = track.box.tolist()
    return _HEAD_SHARE * (max(h, w / USUAL_ASPECT) if track.cut.bottom else h)


class FaceFinder:
    """Searches the faces of tracked people, at most one in each image."""

    def __init__(self) -> None:
        """Load the network. Raises InstallationError if onnxruntime or the weights are missing."""
        self._detector = FaceDetector()

    def look(
        self, image: np.ndarray, stamp: int, tracks: Sequence[Track], known: Mapping[str, Attention]
    ) -> Face | None:
        """Search the face of the person that waits longest, and record it in ``known`` (by track id)."""
        for attention in known.values():
            attention.face = None
        waiting = [
            (known[track.id].looked or 0, track.id, track)
            for track in tracks
            if track.id in known
            and not track.unseen_s
            and not track.cut.top
            and _head_px(track) >= _LEAST_HEAD
            and (known[track.id].looked is None or stamp - (known[track.id].looked or 0) >= _PAUSE_S * SECOND)
        ]
        if not waiting:
            return None
        _, name, track = min(waiting, key=lambda each: each[:2])
        face = self._detector.find(image, track.box)
        known[name].see(stamp, face, head_px=_head_px(track) if track.score >= _SURE_BOX else 0.0)
        return face
