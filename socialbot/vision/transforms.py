"""Poses of frames, as on /tf and /tf_static."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterable

import numpy as np

from socialbot.core.clock import SECOND
from socialbot.core.errors import ParameterError
from socialbot.core.messages import Transform

Matrix = np.ndarray
"""Homogeneous transform, shape (4, 4)."""

AXES: Matrix = np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From body axes (forward, left, up) to optical axes (right, down, forward), REP-103."""

OPTICAL = re.compile(r"optical")
"""Part of the names of frames with optical axes, REP-103."""

_KEPT = 200
"""Transforms kept of each frame."""

_FORGET_NS = 60 * SECOND
"""Time after which a frame that moves is forgotten, such as that of a person who left."""

_CHECKED_FRAMES, _MOST_FRAMES = 200, 2000
"""Numbers of frames from which frames are forgotten, and above which new ones are ignored."""

_MOST_ANCESTORS = 100
"""Frames between a frame and the one beyond which nothing is looked for: robots have about thirty."""

_FARTHEST_M = 1e9
"""Largest coordinate of a transform: products of larger ones have no finite value."""


class TransformTree:
    """Tree of frames, with the latest transforms of each by stamp."""

    def __init__(self) -> None:
        self._parents: dict[str, deque[Transform]] = {}
        self._moving: set[str] = set()
        self._check_at = _CHECKED_FRAMES
        self._forget_from, self._ignored = 0, 0
        """Stamp (ns) from which more frames can be forgotten, and the number of frames ignored since then."""
        self._steps: dict[str, tuple[str, Matrix]] = {}
        """Parents of frames, and transforms to them, at the stamp of the last lookup: one for many people."""
        self._steps_at = 0

    def add(self, transforms: Iterable[Transform], *, moving: bool = False) -> None:
        """Add transforms. One with another parent replaces those of its frame.

        A transform to its own frame, or whose numbers are not finite, is ignored, as in tf2.

        Args:
            transforms: The transforms.
            moving: Whether they are repeated, as those of /tf: their frames are forgotten some time after the last.
        """
        self._steps.clear()
        for each in transforms:
            if each.child == each.parent or not _is_usable(each):
                continue
            known = self._parents.get(each.child)
            if known is None and len(self._parents) >= self._check_at:
                if each.stamp >= self._forget_from or self._ignored >= _MOST_FRAMES:  # a flood costs little
                    self._forget(each.stamp)
                if len(self._parents) >= _MOST_FRAMES:
                    self._ignored += 1
                    continue
            if known is None or known[-1].parent != each.parent:
                known = self._parents[each.child] = deque(maxlen=_KEPT)
            known.append(each)
            (self._moving.add if moving else self._moving.discard)(each.child)

    def _forget(self, now: int) -> None:
        """Forget moving frames of the past, if there are many frames."""
        for frame in tuple(self._moving):
            if self._parents[frame][-1].stamp < now - _FORGET_NS:
                del self._parents[frame]
                self._moving.discard(frame)
        self._forget_from, self._ignored = now + _FORGET_NS // 6, 0
        self._check_at = min(max(2 * len(self._parents), _CHECKED_FRAMES), _MOST_FRAMES)

    def newest(self, frame: str) -> int | None:
        """Stamp (ns) of the newest transform of ``frame``; None if there is none."""
        known = self._parents.get(frame)
        return None if known is None else known[-1].stamp

    def moved_at(self, target: str, source: str) -> int | None:
        """Stamp (ns) up to which all moving frames between two frames are known; None if none of them moves."""
        between = (self._ancestors(source.lstrip("/")) ^ self._ancestors(target.lstrip("/"))) & self._moving
        return min((self._parents[frame][-1].stamp for frame in between), default=None)

    def _ancestors(self, frame: str) -> set[str]:
        """``frame`` and its ancestors."""
        found: set[str] = set()
        while frame not in found and len(found) <= _MOST_ANCESTORS:
            found.add(frame)
            if known := self._parents.get(frame):
                frame = known[-1].parent
        return found

    def lookup(self, target: str, source: str, stamp: int) -> Matrix | None:
        """Transform of points from frame ``source`` to frame ``target`` at about ``stamp`` (ns); None if unknown."""
        to_root, of_root = self._chain(source.lstrip("/"), stamp), self._chain(target.lstrip("/"), stamp)
        common = next((frame for frame in to_root if frame in of_root), None)
        return None if common is None else np.linalg.inv(of_root[common]) @ to_root[common]

    def frames(self) -> set[str]:
        """Names of all frames."""
        return {*self._parents, *(known[-1].parent for known in self._parents.values())}

    def _chain(self, frame: str, stamp: int) -> dict[str, Matrix]:
        """Transforms from ``frame`` to itself and each of its ancestors, in this order."""
        chain = {frame: np.eye(4)}
        matrix = np.eye(4)
        while len(chain) <= _MOST_ANCESTORS and (step := self._step(frame, stamp)) is not None:
            frame, matrix = step[0], step[1] @ matrix
            if frame in chain:
                break
            chain[frame] = matrix
        return chain

    def _step(self, frame: str, stamp: int) -> tuple[str, Matrix] | None:
        """Parent of ``frame`` and the transform to it at about ``stamp`` (ns); None if it is a root."""
        if stamp != self._steps_at:
            self._steps.clear()
            self._steps_at = stamp
        if (found := self._steps.get(frame)) is None and (known := self._parents.get(frame)):
            nearest = min(known, key=lambda each: abs(each.stamp - stamp))
            found = self._steps[frame] = nearest.parent, matrix_of(nearest.translation, nearest.rotation)
        return found


def _is_usable(transform: Transform) -> bool:
    numbers = (*transform.translation, *transform.rotation)
    return all(-_FARTHEST_M <= number <= _FARTHEST_M for number in numbers)


def matrix_of(translation: tuple[float, float, float], rotation: tuple[float, float, float, float]) -> Matrix:
    """Matrix of a translation (m) and a quaternion x, y, z, w; one of length 0 means no rotation."""
    x, y, z, w = rotation
    length = math.hypot(x, y, z, w)
    x, y, z, w = (x / length, y / length, z / length, w / length) if length > 0 else (0.0, 0.0, 0.0, 1.0)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = translation
    return matrix


def parse_pose(text: str) -> Matrix:
    """Matrix of a pose "x y z roll pitch yaw" (m, rad; rotations about fixed axes, as in URDF).

    Raises ParameterError for another text.
    """
    try:
        x, y, z, roll, pitch, yaw = (float(word) for word in text.replace(",", " ").split())
        if not all(map(math.isfinite, (x, y, z, roll, pitch, yaw))):
            raise ValueError
    except ValueError:
        remedy = 'write six numbers "x y z roll pitch yaw", m and rad: "0.1 0 -0.3 0 0 0"'
        raise ParameterError(f"no pose: {text!r}", where="depth_pose", remedy=remedy) from None
    half = [(math.cos(angle / 2), math.sin(angle / 2)) for angle in (roll, pitch, yaw)]
    matrix = np.eye(4)
    for axis, (cos, sin) in enumerate(half):
        turn = [0.0, 0.0, 0.0, cos]
        turn[axis] = sin
        matrix = matrix_of((0.0, 0.0, 0.0), (turn[0], turn[1], turn[2], turn[3])) @ matrix
    matrix[:3, 3] = x, y, z
    return matrix
