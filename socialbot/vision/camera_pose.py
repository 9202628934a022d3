"""Pose of a camera above the floor: estimated from people and from points of the floor, and kept in a file.

`PoseEstimator` holds the joint posterior of camera height and pitch on a grid. Top and bottom of the box of a
standing person give the height of that person for each cell of the grid. People have similar heights, and one person
keeps their height from image to image; cells where this holds become likely.

* Heights are a mixture: adults, children and seated people, and objects of any height.
* Single boxes may be wrong (hidden feet), so each observation has an outlier component.
* Observations of one person share one unknown height. Without that, one tall person would move the camera.

The grid zooms in as the posterior narrows. The floor in depth images, if any, is combined with the result.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np

from socialbot.core.decoding import from_json
from socialbot.core.errors import ParameterError
from socialbot.core.messages import NO_JSON
from socialbot.core.paths import replace_file, writing
from socialbot.core.reading import read_bytes
from socialbot.vision.camera import ASSUMED, Box, CameraModel, CameraPose
from socialbot.vision.transforms import AXES, OPTICAL, TransformTree

HEIGHTS_M, PITCHES_RAD = (0.15, 8.0), (-0.7, 1.3)
"""Range of the poses that are estimated."""

# Heights of people: mean, and weight of each. Those below 1.5 m are children and seated people.
_ADULTS = (1.52, 1.58, 1.64, 1.70, 1.76, 1.82, 1.88)
_ADULTS_STD = 0.09
_SHORT = (0.9, 1.05, 1.2, 1.3, 1.4)
_SHORT_SHARE, _OBJECT_SHARE, _OUTLIER_SHARE = 0.15, 0.05, 0.15
_BETWEEN_M = 0.03  # Half of the distance between two of these heights.
_OUTLIER_M = 0.6  # Spread of the apparent heights of outliers.
_GAIT = 0.015  # Change of height while walking, share.
_EDGE_PX, _EDGE_SHARE = 1.0, 0.025  # Standard error of the top and bottom of a box.
_TOES_M = 0.19
_SHARED = 0.5  # Information of an observation: part of its error is common to the boxes of one person.

_CELLS = 48  # Heights, and pitches, of the grid.
_ZOOM_STEPS, _ZOOM_STDS = 2.0, 6.0
_MAX_FITS = 4  # Changes of the grid for one observation.
_BORDER_MASS = 0.02  # Probability at the border above which the grid is too small.
_MAX_SIGHTS, _MAX_PEOPLE = 12, 80  # Kept observations of one person, and people.
_GAP_S, _MOVED = 0.3, 0.06  # An observation is later than this, and its box has moved by this share of its height.
_COMMON_HEIGHT, _COMMON_PITCH_RAD = 0.06, 0.012  # Errors that all observations share: population, boxes, slopes.

_BASES = ("base_footprint", "base_link")
_BASE_HEIGHT_M, _BASE_PITCH_RAD = 0.25, 0.05  # Errors of a pose above base_link, which may be anywhere in the base.
_UPRIGHT = 0.7
_LOWEST_M = 0.03  # Height of the lowest camera that is not estimated, such as that of a vacuum cleaner.

_FLOOR_POINTS, _FLOOR_SHARE, _FLOOR_TRIALS = 50, 0.1, 200
_FLOOR_LEVEL, _FLOOR_THICKNESS_M = math.cos(math.radians(40)), 0.03
_FLOOR_NEAR_M = 5.0  # Farther depth is too noisy for the floor.
_FLOOR_HEIGHT, _FLOOR_PITCH_RAD = 0.06, 0.02  # Errors of a floor: scale of the depth (share), lens, slope, mounting.
_FLOORS = 15  # Kept floors.
_FLOOR_APART = 13.8  # Squared distance, in standard errors, of another plane than the floor: 99.9 %.


@dataclass
class _Sights:
    """Observations of one person: x, top and bottom of boxes in the image plane at distance 1, and their error."""

    boxes: list[tuple[float, float, float, float]] = field(default_factory=list)
    last_s: float = -math.inf
    likelihood: np.ndarray | None = None  # Log likelihood by height of the person and cell.
    marginal: np.ndarray | float = 0.0  # Log likelihood by cell.


class PoseEstimator:
    """Posterior of the height and pitch of one camera, learnt from boxes of people.

    Args:
        prior: Pose before the first person, with its errors. An error of 0 keeps that value.
        person_height_m: Mean height of adults.
    """

    def __init__(self, prior: CameraPose = ASSUMED, *, person_height_m: float = 1.73) -> None:
        self.prior = prior
        scale = person_height_m / 1.70
        adults, short = np.array(_ADULTS) * scale, np.array(_SHORT) * scale
        weights = np.exp(-((adults - person_height_m) ** 2) / 2 / (_ADULTS_STD * scale) ** 2)
        self._statures = np.concatenate([adults, short])
        share = 1 - _SHORT_SHARE - _OBJECT_SHARE
        self._weights = np.concatenate(
            [share * weights / weights.sum(), np.full(len(short), _SHORT_SHARE / len(short)), [_OBJECT_SHARE]]
        )
        self._stature_std = np.where(self._statures >= adults.min(), _BETWEEN_M, 2 * _BETWEEN_M)
        self._people: dict[str, _Sights] = {}
        self._count = 0
        self._floors: deque[tuple[float, float, float]] = deque(maxlen=_FLOORS)
        self._set_grid(*self._whole_range())
        self._pose = self._by_people = prior

    @property
    def pose(self) -> CameraPose:
        """Mean of the posterior and its error."""
        return self._pose

    @property
    def floors(self) -> int:
        """Number of floors that the pose agrees with."""
        return 0 if self._pose is self._by_people else len(self._floors)

    def see_floor(self, points: np.ndarray) -> bool:
        """Learn from ``points`` in the optical frame of the camera: x right, y down, z forward, m, shape (n, 3).

        Returns:
            Whether a floor was found.
        """
        floor = floor_plane(points[points[:, 2] < _FLOOR_NEAR_M])
        if floor is None:
            return False
        height, pitch, roll = floor
        self._floors.append((math.log(height), pitch, roll))
        self._pose = self._with_floor(self._by_people)
        return True

    def _with_floor(self, pose: CameraPose) -> CameraPose:
        """Combine ``pose`` with the floors seen so far, unless they contradict it: then they were tables."""
        if not self._floors:
            return pose
        floors = np.array(self._floors)
        middle = np.median(floors, axis=0)
        spread = 1.48 * np.median(np.abs(floors - middle), axis=0)
        lift, turn = pose.height_std_m / pose.height_m, pose.pitch_std_rad
        mixed = pose.correlation * lift * turn
        own = np.array([[lift**2, mixed], [mixed, turn**2]])
        both = own + np.diag([_FLOOR_HEIGHT**2 + spread[0] ** 2, _FLOOR_PITCH_RAD**2 + spread[1] ** 2])
        apart = middle[:2] - (math.log(pose.height_m), pose.pitch_rad)
        if apart @ np.linalg.solve(both, apart) > _FLOOR_APART:
            return pose
        gain = own @ np.linalg.inv(both)
        log, pitch = np.array([math.log(pose.height_m), pose.pitch_rad]) + gain @ apart
        rest = own - gain @ own
        lift, turn = math.sqrt(max(rest[0, 0], 0.0)), math.sqrt(max(rest[1, 1], 0.0))
        return msgspec.structs.replace(
            pose,
            height_m=math.exp(log),
            pitch_rad=float(pitch),
            roll_rad=float(middle[2]),
            height_std_m=lift * math.exp(log),
            pitch_std_rad=turn,
            correlation=float(rest[0, 1]) / (lift * turn) if lift and turn else 0.0,
            source="people" if pose.people else "floor",
        )

    def see(self, camera: CameraModel, box: Box, person: str, seconds: float) -> bool:
        """Learn from the ``box`` of a whole ``person`` (x, y, w, h) in an image at the time ``seconds``.

        Boxes like the last one of the same person are not counted again.

        Returns:
            Whether the pose has changed.
        """
        x, y, w, h = box
        column, top = camera.point(x + w / 2, y)
        _, bottom = camera.point(x + w / 2, y + h)
        edge = (_EDGE_PX + _EDGE_SHARE * h) / camera.fy
        sights = self._people.get(person)
        if sights is not None and sights.boxes and not self._differs(sights, column, top, bottom, seconds):
            return False
        if sights is None:
            while len(self._people) >= _MAX_PEOPLE:
                self._total -= self._people.pop(next(iter(self._people))).marginal
            sights = self._people[person] = _Sights()
            self._count += 1
        if len(sights.boxes) >= _MAX_SIGHTS:
            return False
        sights.boxes.append((column, top, bottom, edge))
        sights.last_s = seconds
        self._total -= sights.marginal
        self._add(sights, [sights.boxes[-1]])
        self._total += sights.marginal
        self._update()
        return True

    @staticmethod
    def _differs(sights: _Sights, column: float, top: float, bottom: float, seconds: float) -> bool:
        if 0 <= seconds - sights.last_s < _GAP_S:
            return False
        least = _MOVED * (bottom - top)
        return all(
            abs(bottom - bottom2) > least or abs((bottom - top) - (bottom2 - top2)) > least
            for _, top2, bottom2, _ in sights.boxes
        ) or all(abs(column - column2) > 4 * least for column2, _, _, _ in sights.boxes)

    def _whole_range(self) -> tuple[float, float, float, float]:
        prior = self.prior
        low, high = (math.log(each) for each in HEIGHTS_M)
        spread = prior.height_std_m / prior.height_m
        middle = math.log(prior.height_m)
        low, high = max(low, middle - 5 * spread), min(high, middle + 5 * spread)
        down = max(PITCHES_RAD[0], prior.pitch_rad - 5 * prior.pitch_std_rad)
        up = min(PITCHES_RAD[1], prior.pitch_rad + 5 * prior.pitch_std_rad)
        return min(low, middle), max(high, middle), min(down, prior.pitch_rad), max(up, prior.pitch_rad)

    def _set_grid(self, low: float, high: float, down: float, up: float) -> None:
        """Cells between two log heights and two pitches; all kept observations are evaluated anew."""
        self._logs = np.linspace(low, high, _CELLS if high > low else 1)
        self._pitches = np.linspace(down, up, _CELLS if up > down else 1)
        prior, shape = self.prior, (len(self._logs), len(self._pitches))
        self._log_prior = np.zeros(shape)
        if len(self._logs) > 1:
            spread = prior.height_std_m / prior.height_m
            self._log_prior -= ((self._logs - math.log(prior.height_m)) / spread)[:, None] ** 2 / 2
        if len(self._pitches) > 1:
            self._log_prior -= ((self._pitches - prior.pitch_rad) / prior.pitch_std_rad)[None, :] ** 2 / 2
        self._total = self._log_prior.copy()
        for sights in self._people.values():
            sights.likelihood = None
            self._add(sights, sights.boxes)
            self._total += sights.marginal

    def _add(self, sights: _Sights, boxes: Sequence[tuple[float, float, float, float]]) -> None:
        """Add observations of one person, and integrate over their height."""
        likelihood = _SHARED * np.sum([self._likelihood(box) for box in boxes], axis=0)
        if sights.likelihood is not None:
            likelihood = likelihood + sights.likelihood
        sights.likelihood = likelihood
        most = likelihood.max(axis=0)
        shares = np.exp(likelihood - most)
        sights.marginal = np.log(np.tensordot(self._weights, shares, 1)) + most

    def _likelihood(self, box: tuple[float, float, float, float]) -> np.ndarray:
        """Log likelihood of one box by height of the person (the last: any) and cell."""
        column, top, bottom, edge = box
        cos, sin = np.cos(self._pitches), np.sin(self._pitches)

        def tangent(down: float) -> np.ndarray:
            return (-sin - down * cos) / np.hypot(column, cos - down * sin)

        heads, feet = tangent(top)[None, :], tangent(bottom)[None, :]
        heights = np.exp(self._logs)[:, None]
        below = feet < -1e-3
        safe = np.where(below, feet, -1.0)
        distances = heights / -safe + _TOES_M
        statures = heights + distances * heads
        error = edge * np.hypot(distances, heights * heads / safe**2)
        variance = error**2 + (_GAIT * statures) ** 2 + self._stature_std[:, None, None] ** 2
        usual = np.exp(-((statures - self._statures[:, None, None]) ** 2) / variance / 2) / np.sqrt(variance)
        strange = np.exp(-((statures - 1.4) ** 2) / _OUTLIER_M**2 / 2) / _OUTLIER_M
        each = np.log((1 - _OUTLIER_SHARE) * usual + _OUTLIER_SHARE * strange + 1e-9)
        # The last row is an object of any height, whose observations say nothing.
        # The density of the top of the box, given its bottom, in the image and not in metres.
        each = np.concatenate([each, np.log(strange + 1e-6)[None]]) + np.log(distances)
        return np.where(below, each, np.log(1e-9))

    def _update(self) -> None:
        fits = 0
        while True:
            share = np.exp(self._total - self._total.max())
            share /= share.sum()
            by_height, by_pitch = share.sum(axis=1), share.sum(axis=0)
            height, height_std = _moments(self._logs, by_height)
            pitch, pitch_std = _moments(self._pitches, by_pitch)
            cross = float((self._logs - height) @ share @ (self._pitches - pitch))
            if fits == _MAX_FITS or not self._fit_grid((by_height, by_pitch), (height, height_std), (pitch, pitch_std)):
                break
            fits += 1
        known_height, known_pitch = self.prior.height_std_m == 0, self.prior.pitch_std_rad == 0
        height_std = 0.0 if known_height else math.hypot(height_std, _COMMON_HEIGHT)
        pitch_std = 0.0 if known_pitch else math.hypot(pitch_std, _COMMON_PITCH_RAD)
        value = math.exp(height)
        self._by_people = CameraPose(
            height_m=value,
            pitch_rad=pitch,
            roll_rad=self.prior.roll_rad,
            height_std_m=height_std * value,
            pitch_std_rad=pitch_std,
            correlation=0.0 if known_height or known_pitch else cross / height_std / pitch_std,
            source="people",
            people=self._count,
        )
        self._pose = self._with_floor(self._by_people)

    def _fit_grid(
        self, shares: tuple[np.ndarray, np.ndarray], height: tuple[float, float], pitch: tuple[float, float]
    ) -> bool:
        """Zoom to the posterior where its steps are too wide, or out where it leaves the grid.

        Returns:
            Whether the grid has changed.
        """
        whole = self._whole_range()
        bounds = list(whole)
        coarse = outside = False
        axes = ((self._logs, shares[0], height), (self._pitches, shares[1], pitch))
        for number, (values, share, (mean, std)) in enumerate(axes):
            low, high = whole[2 * number : 2 * number + 2]
            if len(values) < 2:
                continue
            step = values[1] - values[0]
            std = max(std, 0.5 * step)
            bounds[2 * number : 2 * number + 2] = max(low, mean - _ZOOM_STDS * std), min(high, mean + _ZOOM_STDS * std)
            finest = (_COMMON_HEIGHT, _COMMON_PITCH_RAD)[number] / 2
            coarse |= bool(std < _ZOOM_STEPS * step and step > finest)
            outside |= bool(share[0] > _BORDER_MASS and values[0] > low) or bool(
                share[-1] > _BORDER_MASS and values[-1] < high
            )
        if outside or coarse:
            self._set_grid(*(whole if outside else bounds))
        return outside or coarse


def _moments(values: np.ndarray, shares: np.ndarray) -> tuple[float, float]:
    """Mean and standard deviation."""
    mean = float(values @ shares)
    return mean, math.sqrt(max(float((values - mean) ** 2 @ shares), 0.0))


def floor_plane(points: np.ndarray) -> tuple[float, float, float] | None:
    """Fit the floor to ``points`` in the optical frame of a camera: x right, y down, z forward, m, shape (n, 3).

    The floor is the plane with the most points among those that are at most 40 degrees from level and below the camera.

    Returns:
        Height of the camera (m), pitch and roll (rad); None without such a plane.
    """
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < _FLOOR_POINTS:
        return None
    random = np.random.default_rng(0)
    best, most = None, 0
    for _ in range(_FLOOR_TRIALS):
        corners = points[random.choice(len(points), 3, replace=False)]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        length = float(np.linalg.norm(normal))
        if length < 1e-6:
            continue
        normal *= math.copysign(1.0, normal[1]) / length
        height = float(normal @ corners[0])
        if normal[1] < _FLOOR_LEVEL or height < HEIGHTS_M[0]:
            continue
        near = np.abs(points @ normal - height) < _FLOOR_THICKNESS_M
        if near.sum() > most:
            best, most = near, int(near.sum())
    if best is None or most < max(_FLOOR_POINTS, _FLOOR_SHARE * len(points)):
        return None
    centre = points[best].mean(axis=0)
    normal = np.linalg.svd(points[best] - centre, full_matrices=False)[2][2]
    normal *= math.copysign(1.0, normal[1])
    return float(normal @ centre), math.asin(float(np.clip(normal[2], -1, 1))), math.atan2(-normal[0], normal[1])


def base_frames(transforms: TransformTree) -> list[str]:
    """Frames of robot bases, those on the floor first (REP-105, REP-120)."""
    names = sorted(transforms.frames())
    return [name for base in _BASES for name in names if name.rpartition("/")[2] == base]


def camera_placements(
    transforms: TransformTree, frame_id: str, stamp: int
) -> Iterator[tuple[str, float, float, float]]:
    """Yield each base that is connected to a camera, and the height (m), pitch and roll (rad) of the camera there."""
    for base in base_frames(transforms):
        matrix = transforms.lookup(base, frame_id, stamp)
        if matrix is None or frame_id.lstrip("/") == base:
            continue
        if matrix[2, 2] > _UPRIGHT and not OPTICAL.search(frame_id):
            matrix = matrix @ AXES.T  # Some drivers name the body frame of a camera as that of its images.
        pitch = math.asin(float(np.clip(-matrix[2, 2], -1, 1)))
        yield base, float(matrix[2, 3]), pitch, math.atan2(-matrix[2, 0], -matrix[2, 1])


def pose_from_transforms(transforms: TransformTree, frame_id: str, stamp: int) -> CameraPose | None:
    """Pose of the camera ``frame_id`` above the floor at about ``stamp`` (ns), from the transform to a robot base.

    The origin of base_footprint is on the floor. That of base_link may be above it, so its pose has an error.

    Returns:
        The pose; None if no base is connected to the camera, or the transform puts it below the floor.
    """
    for base, height, pitch, roll in camera_placements(transforms, frame_id, stamp):
        exact = base.endswith(_BASES[0])
        lowest = _LOWEST_M if exact else HEIGHTS_M[0]
        if not (lowest <= height <= HEIGHTS_M[1] and abs(roll) < math.pi / 2 and pitch <= PITCHES_RAD[1]):
            continue
        return CameraPose(
            height_m=height,
            pitch_rad=pitch,
            roll_rad=roll,
            height_std_m=0.0 if exact else _BASE_HEIGHT_M,
            pitch_std_rad=0.0 if exact else _BASE_PITCH_RAD,
            source="tf",
        )
    return None


def unusable_placement(transforms: TransformTree, frame_id: str, stamp: int) -> tuple[str, str] | None:
    """Where transforms place a camera whose pose cannot be used, and the remedy; None if they do not place it."""
    for base, height, pitch, roll in camera_placements(transforms, frame_id, stamp):
        turns = f"pitch {round(math.degrees(pitch))}°, roll {round(math.degrees(roll))}°"
        return (
            f"the camera {frame_id!r} {height:.2f} m above {base}, {turns}, which no person detector can use",
            f"correct the URDF, with {_BASES[0]} on the floor, or mount the camera upright and less steep: people must "
            "stand upright in its images",
        )
    return None


def yaw_from_transforms(transforms: TransformTree, frame_id: str, stamp: int) -> float | None:
    """Direction of the camera ``frame_id`` at about ``stamp`` (ns) in the base of a robot: rad, positive to the left.

    None if no base is connected to the camera.
    """
    for base in base_frames(transforms):
        matrix = transforms.lookup(base, frame_id, stamp)
        if matrix is not None and frame_id.lstrip("/") != base:
            optical = matrix[2, 2] <= _UPRIGHT or OPTICAL.search(frame_id)
            ahead = matrix[:2, 2] if optical else matrix[:2, 0]
            return math.atan2(ahead[1], ahead[0])
    return None


def pose_beside(bag: Path) -> Path:
    """The path of the pose file of ``bag``, NAME.camera.json beside it, whether or not it exists."""
    resolved = bag.resolve()
    return resolved.with_name(f"{resolved.stem if resolved.is_file() else resolved.name}.camera.json")


def load_pose(path: Path) -> CameraPose | None:
    """The pose in a file; None if there is no such file. A pose without errors is exact and not refined.

    Raises:
        ParameterError: The file is not a pose.
    """
    try:
        pose = from_json(read_bytes(path), CameraPose)
    except FileNotFoundError:
        return None
    except (OSError, *NO_JSON) as error:
        remedy = "make it with: socialbot calibrate BAG --save FILE"
        raise ParameterError(f"is no pose of a camera: {error}", where=str(path), remedy=remedy) from error
    if not (pose.height_m > 0 and pose.height_std_m >= 0 and pose.pitch_std_rad >= 0):
        raise ParameterError("height_m must be above 0, and errors must not be negative", where=str(path))
    exact = pose.height_std_m == 0 and pose.pitch_std_rad == 0
    return msgspec.structs.replace(pose, source="given" if exact else "file")


def save_pose(pose: CameraPose, path: Path) -> None:
    """Write a pose file, replaced atomically. Raises ParameterError if it cannot be written."""
    with writing(path, ParameterError):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, msgspec.json.format(msgspec.json.encode(pose)) + b"\n", durable=True)
