"""Distance of people from one camera, with standard errors.

Five cues estimate the distance. Their symbols are the elevations e of the box's top and bottom, the camera height c,
and the person's height p and width q:

* ground, c / -tan(e_bottom): needs visible feet below the horizon, on the floor of the camera;
* height, p / (tan(e_top) - tan(e_bottom)): needs the whole person, upright;
* head, (p - c) / tan(e_top): useful if the camera is much lower or higher than heads;
* width, q / (2 tan(b / 2)) with b the angle of the box at the shoulders: for hidden feet. It is rough, since a person
  seen from the side is half as wide;
* face, f / angle of the height of its box: for near people, whose feet are below the image.

Ground and height measure the foot that is nearest to the camera; the body is a little farther, that of a seated
person more so. Each cue is a logarithm with a standard error, and they are combined by inverse variance. A cut box
gives an upper bound: feet below the image are nearer than the floor at its edge, and the visible part is no taller
than the person.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from socialbot.vision.camera import Box, CameraModel
from socialbot.vision.motion import Cut

PERSON_HEIGHT_M = 1.73
"""Mean height of adults, with shoes and hair."""
HEAD_CENTRE_M = 0.12  # From the top of the head to its middle.

# Standard errors.
_EDGE_PX, _EDGE_SHARE = 1.0, 0.03  # Top and bottom of a box: pixels, and share of its height.
_WIDE_SHARE = 0.06  # Width of a box.
_MOUNT_RAD = 0.010  # Camera pitch and slope of the floor.
_HEIGHTS_M, _WIDTHS = 0.10, 0.22  # Heights (m) and widths (share) of people.
_GROUP, _BOXES = 0.03, 0.043  # Common to all: mean height of a group (0.05 m), and of their boxes, share.
_BY_HEIGHT = 0.12  # Distance from the height of a person alone, share.
_POSTURE = 0.02  # Height of one person while walking, share.
_TURNING = 0.15  # Width of one person while turning, share.
_JITTER = 0.03  # Distance from frame to frame, share.

_TOES_M, _TOES_STD_M = 0.19, 0.10  # From the body to the nearer foot.
_KNEES_M, _KNEES_STD_M = 0.46, 0.26  # The same of seated people: 0.1 m from the side, 0.7 m from the front.
_LIKE_S = 0.5  # Correlation time of the error of a cue.
_POSE_S = 5.0  # Duration of a pose, which causes such an error.
_PACE, _WALK_S = 1.0, 2.0  # Usual speed along the line of sight (m/s), and how long it lasts.
_NEAREST_M = 0.1

# Postures: height of the head and width relative to standing.
_SEATED, _SEATED_STD, _SEATED_WIDTH, _SEATED_WIDTHS = 0.77, 0.07, 1.20, 0.35
_CHILD, _CHILD_STD = 0.70, 0.15
_HEADLESS, _SHOULDER, _SHOULDER_STD = 0.3, 0.75, 0.2  # Share of people of whom a side shows no head; height then (m).
_SURPRISE = 0.01  # Weight of what does not fit the prediction, which may be wrong.
_KNOWN_STD = 0.07  # The height of a person with a smaller error was learnt: no child.
_FREE_RAD = 0.3  # Error of the pitch where the floor says nothing.
_LEVELS, _LEVEL_STD = (0.35, 0.65, 0.95), 0.15  # Heights of occluding objects, m.
_SHARES = {"standing": 0.83, "seated": 0.13, "child": 0.04}
_LAP = 0.27  # Share of seated people among those whose feet are hidden.
HIDDEN_SHARE = 0.1
"""Probability that the feet of any person are hidden."""
_CLEAR, _WHOLE = 0.7, 0.9  # Probabilities from which a posture is stated, and from which a whole person stands.
FACE_HEIGHT_M, FACE_AHEAD_M = 0.17, 0.12
"""Height of the box of a face, and distance from the face back to the body."""
_FACE_SPREAD = 0.15  # Relative error of that height.
_NO_FACE = 0.002  # Likelihood, relative to that of the right height, of a face that is not this person's.

_LOGS = np.linspace(math.log(0.15), math.log(80.0), 224)
_STEP = float(_LOGS[1] - _LOGS[0])
_DISTANCES = np.exp(_LOGS)

Posture = Literal["unknown", "standing", "seated"]
"""Posture of a person, as far as it is clear."""


class Estimate(NamedTuple):
    """A length in metres and its standard error."""

    value: float
    std: float


class Stature(NamedTuple):
    """Height of a person, and width of the box at the shoulders."""

    height: Estimate
    width: Estimate

    @classmethod
    def of_people(cls, height_m: float = PERSON_HEIGHT_M, width_m: float = 0.5) -> Stature:
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


_TOES, _KNEES = Estimate(_TOES_M, _TOES_STD_M), Estimate(_KNEES_M, _KNEES_STD_M)


class _Hypothesis(NamedTuple):
    """Height of the head and of the lower end of the box above the floor (m), and width of the box; its probability."""

    posture: Posture
    top: Estimate
    bottom: float
    width: Estimate
    share: float
    free: bool = False  # Not on the floor of the camera, or its pose is wrong.
    toes: Estimate = _TOES  # From the body to the lower end of a box that ends at the feet.


class Expected(NamedTuple):
    """Distance (m) that the same person is expected to have by the next image, and its relative error.

    ``alike`` is whether the cues are those of the last image, so that they have the same error.
    """

    value: float
    share: float
    alike: bool


class Measurement(NamedTuple):
    """Distance of a person (m), the posture if it is clear, and whether the box clearly shows a whole standing one."""

    distance: Estimate
    posture: Posture
    whole: bool


def measure(
    camera: CameraModel,
    box: Box,
    stature: Stature,
    cut: Cut | None = None,
    *,
    hidden: float = HIDDEN_SHARE,
    face: float = 0.0,
    expected: Expected | None = None,
) -> Measurement | None:
    """Estimate the horizontal distance from the camera to the person in ``box`` (x, y, w, h), and their posture.

    Args:
        stature: Height and width of the person, standing.
        cut: Sides that the image cuts off.
        hidden: Probability that the box ends above the feet, which something hides.
        expected: Distance predicted from earlier images. It says which posture, and which lower end of the box, is
            likely, but is no part of the measured distance.
        face: Height of the face from the eyebrows to the chin, pixels; 0 if it is not known.

    Returns:
        The measurement; None for an empty box.
    """
    view = _view(camera, box)
    if view is None:
        return None
    cut = cut or Cut()
    hypotheses = _hypotheses(stature, 0.0 if cut.bottom else hidden, aside=cut.left or cut.right)
    likelihood = _likelihood(camera, view, hypotheses, cut)
    if face > 0:
        away = np.log(np.maximum(_DISTANCES - FACE_AHEAD_M, _NEAREST_M))
        aside = (away - math.log(FACE_HEIGHT_M * camera.fy / face)) / _FACE_SPREAD
        likelihood += np.log(np.exp(-0.5 * aside**2) + _NO_FACE)
    # Between people who are equally likely at each distance, and at each logarithm of it.
    likelihood += np.log([each.share for each in hypotheses])[:, None] + 0.5 * _LOGS
    shares = np.exp(likelihood - likelihood.max())
    if expected is not None:
        floor = np.array([each.bottom == 0 for each in hypotheses])
        shares *= (_SURPRISE + _agreement(shares, expected, floor))[:, None]
    shares /= shares.sum()
    by_distance = shares.sum(axis=0)
    log = float(by_distance @ _LOGS)
    std = max(math.sqrt(float(by_distance @ (_LOGS - log) ** 2)), _STEP / 2)
    by_posture: dict[Posture, float] = {}
    whole = 0.0
    for each, share in zip(hypotheses, shares.sum(axis=1).tolist(), strict=True):
        by_posture[each.posture] = by_posture.get(each.posture, 0.0) + share
        if each.posture == "standing" and each.bottom == 0 and not each.free:
            whole += share
    best = max(by_posture, key=lambda posture: by_posture[posture])
    posture = best if by_posture[best] > _CLEAR else "unknown"
    return Measurement(_metres(_Cue(log, std)), posture, whole > _WHOLE)


def _agreement(shares: np.ndarray, expected: Expected, floor: np.ndarray) -> np.ndarray:
    """How well each hypothesis, with its ``shares`` by distance, fits the prediction: 0 to 1.

    Those whose lower end is on the ``floor`` have the error of the earlier images, if the cues are the same.
    """
    sums = np.maximum(shares.sum(axis=1), 1e-300)
    aside = (_LOGS - math.log(expected.value)) / max(expected.share, _STEP)
    fits = shares @ np.exp(-0.5 * aside**2) / sums
    if expected.alike:
        fits = np.where(floor, np.exp(-0.5 * (shares @ aside / sums) ** 2), fits)
    return fits


def _hypotheses(stature: Stature, hidden: float, *, aside: bool) -> list[_Hypothesis]:
    """What the box may show.

    Its lower end is the feet or cut off, or with the probability ``hidden`` an object. If a side is cut off
    (``aside``), the head may be outside the image, and the box may show a shoulder, an arm or a leg.
    """
    height, width = stature
    unknown = height.std > _KNOWN_STD
    seated = Estimate(_SEATED * height.value, math.hypot(height.std * _SEATED, _SEATED_STD))
    lap = Estimate(_SEATED_WIDTH * width.value, _SEATED_WIDTHS * _SEATED_WIDTH * width.value)
    shown = {name: (1 - hidden) * share for name, share in _SHARES.items()}
    found = [
        _Hypothesis("standing", height, 0.0, width, shown["standing"]),
        _Hypothesis("seated", seated, 0.0, lap, shown["seated"], toes=_KNEES),
    ]
    if unknown:
        child = Estimate(_CHILD * height.value, _CHILD_STD)
        found.append(_Hypothesis("standing", child, 0.0, _scaled(width, _CHILD), shown["child"]))
    found.append(_Hypothesis("standing", height, 0.0, width, 0.003, free=True))
    for level in _LEVELS if hidden > 0 else ():
        each = hidden / len(_LEVELS)
        found.append(_Hypothesis("standing", height, level, width, (1 - _LAP) * each))
        found.append(_Hypothesis("seated", seated, level, width, _LAP * each))
    if aside:
        found = [each._replace(share=(1 - _HEADLESS) * each.share) for each in found]
        part = Estimate(_SHOULDER * height.value, math.hypot(_SHOULDER * height.std, _SHOULDER_STD))
        for level, share in ((0.0, 0.5), *((level, 0.5 / len(_LEVELS)) for level in _LEVELS)):
            found.append(_Hypothesis("standing", part, level, width, _HEADLESS * share))
    return found


def _scaled(estimate: Estimate, factor: float) -> Estimate:
    return Estimate(factor * estimate.value, factor * estimate.std)


def _likelihood(camera: CameraModel, view: _BoxAngles, hypotheses: Sequence[_Hypothesis], cut: Cut) -> np.ndarray:
    """Log likelihood of the box under each hypothesis (rows) at each of `_DISTANCES` (columns).

    The tangents of its top and bottom have errors of their own, and common ones: those of the camera's pose.
    """
    height, pitch_std = camera.pose.height_m, camera.pose.pitch_std_rad
    columns = [
        (
            each.top.value,
            math.hypot(each.top.std, _POSTURE * each.top.value),
            each.bottom,
            each.toes.value,
            each.toes.std,
            math.hypot(pitch_std, _FREE_RAD if each.free else _MOUNT_RAD),
            math.log(each.width.value / 2 / view.half),
            math.hypot(each.width.std / each.width.value, _WIDE_SHARE),
        )
        for each in hypotheses
    ]
    head, tall, lower_end, toes, toes_std, pitch, width, wide = np.array(columns).T[:, :, None]
    on_floor = lower_end == 0
    lowest = np.where(on_floor, np.maximum(_DISTANCES - toes, _NEAREST_M), _DISTANCES)
    top = view.top - (head - height) / _DISTANCES
    bottom = view.bottom - (lower_end - height) / lowest
    at_top, at_bottom = 1 + view.top**2, 1 + view.bottom**2
    lift = camera.pose.height_std_m / _DISTANCES
    mixed = -camera.pose.correlation * pitch_std * lift
    variance_top = view.edge**2 + (tall / _DISTANCES) ** 2
    variance_top = variance_top + (pitch * at_top) ** 2 + lift**2 + 2 * mixed * at_top
    # Hidden feet end anywhere.
    vague = np.where(on_floor, height * toes_std / lowest**2, _LEVEL_STD / _DISTANCES) ** 2
    variance_bottom = (view.edge * at_bottom) ** 2 + vague + (pitch * at_bottom) ** 2 + lift**2 + 2 * mixed * at_bottom
    common = pitch**2 * at_top * at_bottom + lift**2 + mixed * (at_top + at_bottom)
    if not (cut.top or cut.bottom):
        determinant = np.maximum(variance_top * variance_bottom - common**2, 1e-12)
        square = top**2 * variance_bottom - 2 * top * bottom * common + bottom**2 * variance_top
        log = -0.5 * square / determinant - 0.5 * np.log(determinant)
    elif cut.bottom and not cut.top:
        # The feet are below the image, given the top.
        rest = variance_bottom - common**2 / variance_top
        log = -0.5 * top**2 / variance_top - 0.5 * np.log(variance_top)
        log += _log_normal_cdf((bottom - top * common / variance_top) / np.sqrt(rest))
    elif cut.top and not cut.bottom:
        rest = variance_top - common**2 / variance_bottom
        log = -0.5 * bottom**2 / variance_bottom - 0.5 * np.log(variance_bottom)
        log += _log_normal_cdf(-(top - bottom * common / variance_bottom) / np.sqrt(rest))
    else:
        log = _log_normal_cdf(bottom / np.sqrt(variance_bottom)) + _log_normal_cdf(-top / np.sqrt(variance_top))
    wider = (width - _LOGS) / wide
    log += _log_normal_cdf(wider) if cut.left or cut.right else -0.5 * wider**2 - np.log(wide)
    return log


def _log_normal_cdf(values: np.ndarray) -> np.ndarray:
    """Approximate logarithm of the standard normal distribution function."""
    return -np.logaddexp(0.0, -1.702 * values)


def whole_height(camera: CameraModel, box: Box, distance: float) -> float:
    """Height in pixels of ``box`` if it reached down to the feet of a person ``distance`` m away."""
    view = _view(camera, box)
    if view is None:
        return box[3]
    feet = camera.pose.height_m / max(distance - _TOES_M, _NEAREST_M)
    return box[3] * (view.top + feet) / (view.top - view.bottom)


def height_on_floor(camera: CameraModel, box: Box) -> float:
    """Height in metres of the person in ``box`` if its lower edge is on the floor; 0 if it is not below the horizon."""
    view = _view(camera, box)
    if view is None or view.bottom >= 0:
        return 0.0
    return camera.pose.height_m * (1 - view.top / view.bottom)


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
    distance = camera.pose.height_m / -view.bottom
    # An angle d too small moves the point where the ray meets the floor by d (z2 + c2) / c.
    stretch = (distance**2 + camera.pose.height_m**2) / camera.pose.height_m / distance
    lift, turn = camera.pose.height_std_m / camera.pose.height_m, stretch * camera.pose.pitch_std_rad
    pose = lift**2 + turn**2 - 2 * camera.pose.correlation * lift * turn
    error = math.sqrt(max(pose, 0.0) + stretch**2 * (view.edge**2 + _MOUNT_RAD**2))
    return [_Cue(math.log(distance + _TOES_M), error)]


def shared_error(camera: CameraModel, distance: float) -> float:
    """Relative error that the estimated pose of ``camera`` gives to all distances of about ``distance`` m; 0 if known.

    Neither more people nor more images reduce it: a group may be taller than usual, and a detector's boxes too large.
    """
    lift, pitch = camera.pose.height_std_m / camera.pose.height_m, camera.pose.pitch_std_rad
    if not (lift or pitch):
        return 0.0
    turn = (distance / camera.pose.height_m + camera.pose.height_m / distance) * pitch
    ground = math.sqrt(max(lift**2 + turn**2 - 2 * camera.pose.correlation * lift * turn, 0.0))
    # The height of people limits it where the floor says little.
    return math.hypot(_GROUP, _BOXES, 1 / math.hypot(1 / max(ground, 1e-6), 1 / _BY_HEIGHT))


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

    def learn(self, camera: CameraModel, box: Box, seconds: float) -> None:
        """Update with a ``box`` of the whole person, ``seconds`` after the last one."""
        view = _view(camera, box)
        ground = _ground(camera, view) if view else []
        if view is None or not ground:
            return
        distance, std = math.exp(ground[0].log), ground[0].std
        tall, wide = camera.pose.height_m + distance * view.top, 2 * distance * view.half
        news = min(seconds / _LIKE_S, 1.0)
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

    def expected(self, kind: object = None) -> Expected:
        """The distance that an image with the cues ``kind`` is expected to show."""
        if kind != self._kind:
            return Expected(float(self._state[0]), math.sqrt(self._variances[0, 0]) / float(self._state[0]), False)
        value = float(self._state[0] * math.exp(self._state[2]))
        slope = np.array([1 / self._state[0], 0.0, 1.0])
        return Expected(value, math.sqrt(float(slope @ self._variances @ slope) + _JITTER**2), True)

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
        return bearing, max(top, math.atan2(height_m - HEAD_CENTRE_M - camera.pose.height_m, distance))
    _, bottom = camera.direction(x + w / 2, y + h)
    middle = math.atan(math.tan(top) - HEAD_CENTRE_M / distance)
    return bearing, max(middle, (top + bottom) / 2)
