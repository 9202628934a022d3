"""Distance of people from one camera, with standard errors.

Four cues estimate the distance. Their symbols are the elevations e of the box's top and bottom, the camera height c,
and the person's height p and width q:

* ground, c / -tan(e_bottom): needs visible feet below the horizon, on the floor of the camera;
* height, p / (tan(e_top) - tan(e_bottom)): needs the whole person, upright;
* head, (p - c) / tan(e_top): useful if the camera is much lower or higher than heads;
* width, q / (2 tan(b / 2)) with b the angle of the box at the shoulders: for hidden feet. It is rough, since a person
  seen from the side is half as wide.

Ground and height measure the foot that is nearest to the camera; the body is a little farther. Each cue is a logarithm
with a standard error, and they are combined by inverse variance. A cut box gives an upper bound: feet below the image
are nearer than the floor at its edge, and the visible part is no taller than the person.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from socialbot.vision.camera import Box, CameraModel
from socialbot.vision.tracking import Cut

HEAD_CENTRE_M = 0.12  # From the top of the head to its middle.

# Standard errors.
_EDGE_PX, _EDGE_SHARE = 1.0, 0.03  # Top and bottom of a box: pixels, and share of its height.
_WIDE_SHARE = 0.06  # Width of a box.
_MOUNT_RAD = 0.010  # Camera pitch and slope of the floor.
_HEIGHTS_M, _WIDTHS = 0.09, 0.22  # Heights (m) and widths (share) of people.
_POSTURE = 0.02  # Height of one person while walking, share.
_TURNING = 0.15  # Width of one person while turning, share.
_JITTER = 0.03  # Distance from frame to frame, share.

_TOES_M = 0.12  # From the body to the nearer foot.
_LIKE_S = 0.5  # Correlation time of the error of a cue.
_POSE_S = 5.0  # Duration of a pose, which causes such an error.
_PACE, _WALK_S = 1.0, 2.0  # Usual speed along the line of sight (m/s), and how long it lasts.
_NEAREST_M = 0.1


class Estimate(NamedTuple):
    """A length in metres and its standard error."""

    value: float
    std: float


class Stature(NamedTuple):
    """Height of a person, and width of the box at the shoulders."""

    height: Estimate
    width: Estimate

    @classmethod
    def of_people(cls, height_m: float = 1.70, width_m: float = 0.5) -> Stature:
        """The prior for an unknown person."""
        return cls(Estimate(height_m, _HEIGHTS_M), Estimate(width_m, _WIDTHS * width_m))


class _Cue(NamedTuple):
    """The logarithm of a distance and its standard error."""

    log: float
    std: float


class _BoxAngles(NamedTuple):
    """Tangents of the elevations of a box's top and bottom, of half its width, and their standard error ``edge``."""

    top: float
    bottom: float
    half: float
    edge: float


def measure(
    camera: CameraModel, box: Box, stature: Stature, cut: Cut | None = None, *, feet_hidden: bool = False
) -> Estimate | None:
    """Estimate the horizontal distance from the camera to the person in ``box`` (x, y, w, h).

    Args:
        stature: Height and width of the person.
        cut: Sides that the image cuts off.
        feet_hidden: Whether the feet are occluded.

    Returns:
        The distance; None for an empty box.
    """
    view = _view(camera, box)
    if view is None:
        return None
    cut = cut or Cut()
    feet, head, sides = not (cut.bottom or feet_hidden), not cut.top, not (cut.left or cut.right)
    cues = [
        *(_ground(camera, view) if feet else ()),
        *(_height(camera, view, stature.height) if feet and head else ()),
        *(_head(camera, view, stature.height) if head and not feet else ()),
    ]
    by_width = math.log(stature.width.value / 2 / view.half)
    if sides and not (feet and head):
        cues.append(_Cue(by_width, math.hypot(stature.width.std / stature.width.value, _WIDE_SHARE)))
    bounds = [_height_log(camera, view, stature.height.value + stature.height.std)]
    if not feet and view.bottom < 0:
        bounds.append(math.log(camera.mount_height_m / -view.bottom))
    if not sides:
        bounds.append(by_width)
    if not cues:
        return _metres(_Cue(min(bounds) - _WIDTHS, _WIDTHS))
    cue = _combined(cues)
    return _metres(cue if feet and head and sides else _below(cue, min(bounds)))


def whole_height(camera: CameraModel, box: Box, distance: float) -> float:
    """Height in pixels of ``box`` if it reached down to the feet of a person ``distance`` m away."""
    view = _view(camera, box)
    if view is None:
        return box[3]
    feet = camera.mount_height_m / max(distance - _TOES_M, _NEAREST_M)
    return box[3] * (view.top + feet) / (view.top - view.bottom)


def height_on_floor(camera: CameraModel, box: Box) -> float:
    """Height in metres of the person in ``box`` if its lower edge is on the floor; 0 if it is not below the horizon."""
    view = _view(camera, box)
    if view is None or view.bottom >= 0:
        return 0.0
    return camera.mount_height_m * (1 - view.top / view.bottom)


def _view(camera: CameraModel, box: Box) -> _BoxAngles | None:
    x, y, w, h = box
    if not (w > 0 and h > 0 and all(map(math.isfinite, box))):
        return None
    left, _ = camera.direction(x, y + h / 8)
    right, _ = camera.direction(x + w, y + h / 8)
    _, top = camera.direction(x + w / 2, y)
    _, bottom = camera.direction(x + w / 2, y + h)
    half = math.tan((left - right) / 2) if 0 < left - right < math.pi else 0.0
    if half <= 0 or top <= bottom:
        return None  # The box contains the zenith or nadir.
    return _BoxAngles(math.tan(top), math.tan(bottom), half, (_EDGE_PX + _EDGE_SHARE * h) / camera.fy)


def _ground(camera: CameraModel, view: _BoxAngles) -> list[_Cue]:
    if view.bottom >= 0:
        return []
    distance = camera.mount_height_m / -view.bottom
    # An angle d too small moves the point where the ray meets the floor by d (z2 + c2) / c.
    stretch = (distance**2 + camera.mount_height_m**2) / camera.mount_height_m / distance
    return [_Cue(math.log(distance + _TOES_M), stretch * math.hypot(view.edge, _MOUNT_RAD))]


def _height_log(camera: CameraModel, view: _BoxAngles, height: float) -> float:
    return math.log(height / (view.top - view.bottom) + _TOES_M * camera.mount_height_m / height)


def _height(camera: CameraModel, view: _BoxAngles, height: Estimate) -> list[_Cue]:
    span = view.top - view.bottom
    box = math.sqrt(2) * view.edge * (1 + view.bottom**2) / span
    return [_Cue(_height_log(camera, view, height.value), math.hypot(height.std / height.value, box, _POSTURE))]


def _head(camera: CameraModel, view: _BoxAngles, height: Estimate) -> list[_Cue]:
    above = height.value - camera.mount_height_m
    if above * view.top <= 0:
        return []
    edge = math.hypot(view.edge, _MOUNT_RAD) * (1 + view.top**2)
    std = math.hypot(height.std / above, edge / view.top)
    return [_Cue(math.log(above / view.top), std)] if std < 0.5 else []


def _combined(cues: Sequence[_Cue]) -> _Cue:
    weights = [cue.std**-2 for cue in cues]
    whole = sum(weights)
    log = sum(weight * cue.log for weight, cue in zip(weights, cues, strict=True)) / whole
    # Cues that disagree have larger errors than estimated.
    strain = sum(weight * (cue.log - log) ** 2 for weight, cue in zip(weights, cues, strict=True))
    return _Cue(log, math.sqrt(max(1.0, strain / max(len(cues) - 1, 1)) / whole))


def _below(cue: _Cue, bound: float) -> _Cue:
    """The cue, truncated at ``bound``: the mode and the error around it.

    A normal distribution truncated at ``limit`` has the mean -slope and the variance 1 - limit * slope - slope ** 2.
    """
    limit = max((bound - cue.log) / cue.std, -3.0)
    density = math.exp(-(limit**2) / 2) / math.sqrt(2 * math.pi)
    slope = density / (0.5 * math.erfc(-limit / math.sqrt(2)))
    square = (1 - limit * slope - slope**2) + (min(limit, 0.0) + slope) ** 2
    return _Cue(min(cue.log, bound), cue.std * math.sqrt(max(square, 0.05)))


def _metres(cue: _Cue) -> Estimate:
    value = math.exp(cue.log)
    return Estimate(value, value * cue.std)


@dataclass
class Figure:
    """Learns the stature of one person while the whole person is visible.

    The ground cue gives the distance, and with it the size. Images count by the time between them, since errors of
    close ones are correlated.
    """

    stature: Stature
    _learnt_s: float = field(default=0.0, init=False)

    def learn(self, camera: CameraModel, box: Box, seconds: float) -> None:
        """Update with a ``box`` of the whole person, ``seconds`` after the last one."""
        view = _view(camera, box)
        ground = _ground(camera, view) if view else []
        if view is None or not ground:
            return
        distance, std = math.exp(ground[0].log), ground[0].std
        tall, wide = camera.mount_height_m + distance * view.top, 2 * distance * view.half
        news = min(seconds / _LIKE_S, 1.0)
        self._learnt_s += seconds
        height = _learnt(self.stature.height, Estimate(tall, tall * math.hypot(std, _POSTURE)), news, 0.5 * std * tall)
        width = _learnt(
            self.stature.width, Estimate(wide, wide * math.hypot(std, _WIDE_SHARE, 0.2)), news, _TURNING * wide
        )
        self.stature = Stature(height, width)


def _learnt(known: Estimate, seen: Estimate, news: float, least: float) -> Estimate:
    """Update ``known`` with ``seen``, which counts as the share ``news`` of an independent measurement.

    The error does not fall below ``least``, which all measurements have in common.
    """
    if known.std <= least:
        weight = 0.1 * news
    else:
        weight = news * known.std**2 / (news * known.std**2 + seen.std**2)
    value = known.value + weight * (seen.value - known.value)
    return Estimate(value, known.std if known.std <= least else max(math.sqrt(1 - weight) * known.std, least))


class Range:
    """Kalman filter of the distance of one person, of its speed, and of the error of the cues.

    The relative error of a cue changes slowly, so a cue measures changes better than the distance itself. Another set
    of cues, for example when the feet leave the image, has another error.
    """

    def __init__(self, first: Estimate, kind: object = None) -> None:
        """Start with an estimate from the cues ``kind``."""
        share = first.std / first.value
        self._state = np.array([first.value, 0.0, 0.0])
        self._variances = np.diag([first.std**2, _PACE**2, share**2])
        self._variances[0, 2] = self._variances[2, 0] = -first.std * share
        self._variances[0, 0] += (_JITTER * first.value) ** 2
        self._kind, self._share = kind, share

    @property
    def estimate(self) -> Estimate:
        """The current distance."""
        return Estimate(float(self._state[0]), math.sqrt(self._variances[0, 0]))

    def pass_(self, seconds: float) -> None:
        """Advance by ``seconds``."""
        keep = math.exp(-seconds / _WALK_S)
        step = np.array([[1.0, _WALK_S * (1 - keep), 0.0], [0.0, keep, 0.0], [0.0, 0.0, 1.0]])
        self._state = step @ self._state
        self._state[0] = max(self._state[0], _NEAREST_M)
        self._variances = step @ self._variances @ step.T
        time = min(seconds, _WALK_S)
        unrest = np.array([[time**3 / 3, time**2 / 2], [time**2 / 2, time]])
        self._variances[:2, :2] += 2 * _PACE**2 / _WALK_S * unrest

    def see(self, estimate: Estimate, kind: object = None, seconds: float = 0.0) -> None:
        """Update with an ``estimate`` from the cues ``kind``, ``seconds`` after the last one."""
        share = estimate.std / estimate.value
        # A more precise cue has a smaller error.
        fade = math.exp(-seconds / _POSE_S) * min(1.0, share / self._share) if kind == self._kind else 0.0
        self._kind, self._share = kind, share
        fading = np.array([1.0, 1.0, fade])
        self._state *= fading
        self._variances *= np.outer(fading, fading)
        self._variances[2, 2] += (1 - fade**2) * share**2
        distance, _, error = self._state
        slope = np.array([1.0, 0.0, distance]) * math.exp(error)
        spread = self._variances @ slope
        gain = spread / (slope @ spread + (_JITTER * estimate.value) ** 2)
        self._state = self._state + gain * (estimate.value - distance * math.exp(error))
        self._state[0] = max(self._state[0], _NEAREST_M)
        self._variances = self._variances - np.outer(gain, spread)
        self._variances = (self._variances + self._variances.T) / 2


def head_direction(
    camera: CameraModel, box: Box, cut: Cut, distance: float | None, height_m: float
) -> tuple[float, float]:
    """Bearing and elevation (rad) of the head of the person in ``box``, ``distance`` m away.

    The elevation of a head above the image follows from ``height_m``.
    """
    x, y, w, h = box
    bearing, top = camera.direction(x + w / 2, y)
    if distance is None:
        return bearing, top
    if cut.top:
        return bearing, max(top, math.atan2(height_m - HEAD_CENTRE_M - camera.mount_height_m, distance))
    _, bottom = camera.direction(x + w / 2, y + h)
    middle = math.atan(math.tan(top) - HEAD_CENTRE_M / distance)
    return bearing, max(middle, (top + bottom) / 2)
