"""Ground truth of a simulated place: boxes, distances, visible shares, and who faces and talks to whom."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np

from socialbot.robots.simulation.figure import Figure
from socialbot.robots.simulation.people import Crowd
from socialbot.robots.simulation.place import Furniture, Place, placed
from socialbot.robots.simulation.posture import Frame, Stance

CAMERA_HEIGHT_M, LENS_AHEAD_M = 1.25, 0.06
"""Height of the tilt axis of the head, and how far the lens lies ahead of it."""
FACES_RAD = 0.35
"""Largest angle between the direction of a head and another one whom it faces."""
_NEAR_M = 0.05
_AXIS = np.array([0.0, 0.0, CAMERA_HEIGHT_M])
_MASK = 4  # Pixels of the image in a pixel of the masks for visible shares.
_LEAST_VISIBLE = 0.05

_PERSON_M, _FURNITURE_M = 1.2, 2.0  # Nothing of a person, or of a piece of furniture, is farther from its middle.


@dataclass(frozen=True)
class HeadCamera:
    """Camera in a head that pans and tilts: pixels, field of view (rad), and pose of the head (rad, tilt up)."""

    width: int = 640
    height: int = 480
    hfov_rad: float = 1.09
    pan_rad: float = 0.0
    tilt_rad: float = 0.0

    @property
    def focal_px(self) -> float:
        return self.width / 2 / math.tan(self.hfov_rad / 2)

    def seen(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels, shape (n, 2), and depths (m) of points of the world, shape (n, 3)."""
        cp, sp = math.cos(self.pan_rad), math.sin(self.pan_rad)
        ct, st = math.cos(self.tilt_rad), math.sin(self.tilt_rad)
        # Rows: ahead, left and up of the lens.
        axes = np.array([[ct * cp, ct * sp, st], [-sp, cp, 0.0], [-st * cp, -st * sp, ct]])
        own = (points - _AXIS) @ axes.T
        depth = own[:, 0] - LENS_AHEAD_M
        pixels = own[:, 1:] * (-self.focal_px / np.maximum(depth, _NEAR_M))[:, None]
        return np.add(pixels, (self.width / 2, self.height / 2)), depth

    def may_show(self, x: float, y: float, radius_m: float) -> bool:
        """Whether a thing of this radius, on the floor at x and y, may reach into the image."""
        away = math.hypot(x, y)
        if away <= radius_m:
            return True
        aside = abs(math.remainder(math.atan2(y, x) - self.pan_rad, math.tau))
        return aside <= self.hfov_rad / 2 + math.asin(radius_m / away)


@dataclass(frozen=True)
class Sight:
    """What the camera sees of one person.

    Attributes:
        box: x, y, w, h in the image, px.
        visible: Share of the outline that is in the image and not covered.
        distance_m: Along the floor, from below the camera to the pelvis.
        bearing_rad: Direction of the head from the camera's, positive to the left.
        elevation_rad: Direction of the head above the horizon.
        facing_rad: Angle between the direction of the head and that to the camera.
    """

    person: str
    stance: Stance
    box: tuple[float, float, float, float]
    visible: float
    distance_m: float
    bearing_rad: float
    elevation_rad: float
    facing_rad: float


class _Cover(NamedTuple):
    """Something that covers pixels: a person by name, or furniture; with its distance and its share in front."""

    distance_m: float
    name: str
    polygons: list[np.ndarray]
    box: tuple[float, float, float, float] | None = None
    share: float = 1.0


class Watcher:
    """Tells what a camera sees of the people in a place.

    Args:
        place: Room and furniture.
        figures: People by id.
    """

    def __init__(self, place: Place, figures: Mapping[str, Figure]) -> None:
        self._place, self._figures = place, figures
        self._furniture = [(piece.at, math.hypot(*piece.at), *_corners(piece)) for piece in place.furniture]

    def sights(
        self, camera: HeadCamera, stances: Mapping[str, Stance], frames: Mapping[str, Mapping[str, Frame]]
    ) -> list[Sight]:
        """Return what ``camera`` sees of all people who are visible, the nearest first."""
        covers = list(self._of_furniture(camera))
        for name, stance in stances.items():
            if self.may_show(camera, stance):
                covers += self._of_person(camera, name, stance, frames[name])
        covers.sort(key=lambda cover: cover.distance_m)
        covered = np.zeros((-(-camera.height // _MASK), -(-camera.width // _MASK)), np.uint8)
        found = []
        for cover in covers:
            mask = np.zeros_like(covered)
            for polygon in cover.polygons:
                cv2.fillConvexPoly(mask, polygon, 255)
            if cover.name and cover.box is not None:
                free = cv2.countNonZero(cv2.bitwise_and(mask, cv2.bitwise_not(covered)))
                share = min(cover.share * free / max(_whole_area(cover.polygons), 1), 1.0)
                if share >= _LEAST_VISIBLE:
                    stance, body = stances[cover.name], self._figures[cover.name]
                    found.append(_sight(camera, cover.name, stance, body, cover.box, share))
            covered |= mask
        return found

    def may_show(self, camera: HeadCamera, stance: Stance) -> bool:
        """Whether a person may be in the image: in the room, and not far beside the view."""
        return self._is_inside(stance.x, stance.y, 0.3) and camera.may_show(stance.x, stance.y, _PERSON_M)

    def _is_inside(self, x: float, y: float, margin: float) -> bool:
        x0, x1, y0, y1 = self._place.size
        return x0 - margin <= x <= x1 + margin and y0 - margin <= y <= y1 + margin

    def _of_furniture(self, camera: HeadCamera) -> Iterator[_Cover]:
        for (x, y), distance, corners, counts in self._furniture:
            if not camera.may_show(x, y, _FURNITURE_M):
                continue
            pixels, depths = camera.seen(corners)
            begins = range(0, len(corners), counts)
            polygons = [
                _hull(pixels[begin : begin + counts])
                for begin in begins
                if depths[begin : begin + counts].min() > _NEAR_M
            ]
            if polygons:
                yield _Cover(distance, "", polygons)

    def _of_person(
        self, camera: HeadCamera, name: str, stance: Stance, frames: Mapping[str, Frame]
    ) -> Iterator[_Cover]:
        """The person in the image, as far as in front of the camera and not behind a wall."""
        outline = self._figures[name].outline
        world = np.vstack([points @ frames[part][0].T + frames[part][1] for part, points in outline.items()])
        pixels, depths = camera.seen(world)
        x0, x1, y0, y1 = self._place.size
        x, y = world[:, 0], world[:, 1]
        good = (depths > _NEAR_M) & (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
        polygons, begin = [], 0
        for points in outline.values():
            end = begin + len(points)
            if good[begin:end].sum() >= 3:
                polygons.append(_hull(pixels[begin:end][good[begin:end]]))
            begin = end
        if not polygons:
            return
        kept = pixels[good]
        left, top = np.clip(kept.min(axis=0), 0, (camera.width, camera.height))
        right, bottom = np.clip(kept.max(axis=0), 0, (camera.width, camera.height))
        box = (float(left), float(top), float(right - left), float(bottom - top))
        distance = math.hypot(stance.x, stance.y)
        yield _Cover(distance, name, polygons, box if min(box[2:]) > 1 else None, float(good.mean()))


_CORNERS = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=float)


def _corners(piece: Furniture) -> tuple[np.ndarray, int]:
    """Corners of the blocks of a piece of furniture in the room, and their number for each block."""
    found = []
    for block, at, _ in placed(piece):
        a, b, c = block.size if block.shape != "cylinder" else (block.size[0], block.size[0], block.size[1])
        shrunk = 0.85 if block.shape == "ellipsoid" else 1.0
        turn = piece.heading if block.shape == "box" else 0.0
        cos, sin = math.cos(turn), math.sin(turn)
        found.append(_CORNERS * (a, b, c) * shrunk @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) + at)
    return np.vstack(found), len(_CORNERS)


def _hull(pixels: np.ndarray) -> np.ndarray:
    """Convex outline of points, in pixels of the masks."""
    limited = np.minimum(np.maximum(pixels / _MASK, -2000), 2000)
    return np.rint(cv2.convexHull(limited.astype(np.float32))[:, 0]).astype(np.int32)


def _whole_area(polygons: Sequence[np.ndarray]) -> int:
    """Pixels of the mask of a whole person, also those outside of the image."""
    every = np.vstack(polygons)
    low, high = every.min(axis=0), every.max(axis=0)
    size = np.minimum(high - low + 1, 1500)
    mask = np.zeros((int(size[1]), int(size[0])), np.uint8)
    for polygon in polygons:
        cv2.fillConvexPoly(mask, polygon - low, 255)
    return cv2.countNonZero(mask)


def _sight(
    camera: HeadCamera, name: str, stance: Stance, body: Figure, box: tuple[float, float, float, float], visible: float
) -> Sight:
    lens_x, lens_y = LENS_AHEAD_M * math.cos(camera.pan_rad), LENS_AHEAD_M * math.sin(camera.pan_rad)
    dx, dy = stance.x - lens_x, stance.y - lens_y
    head_m = (1.60 - 0.42 * stance.seated) * body.scale
    away = math.hypot(dx, dy)
    return Sight(
        person=name,
        stance=stance,
        box=box,
        visible=visible,
        distance_m=away,
        bearing_rad=math.remainder(math.atan2(dy, dx) - camera.pan_rad, math.tau),
        elevation_rad=math.atan2(head_m - CAMERA_HEIGHT_M, away),
        facing_rad=abs(math.remainder(math.atan2(-dy, -dx) - stance.gaze_rad, math.tau)),
    )


def faces(stances: Mapping[str, Stance]) -> dict[str, str]:
    """Return whom each person faces: ``robot``, the nearest person ahead, or nobody."""
    found = {}
    for name, stance in stances.items():
        ahead = []
        for other, x, y in (("robot", 0.0, 0.0), *((o, s.x, s.y) for o, s in stances.items() if o != name)):
            angle = math.remainder(math.atan2(y - stance.y, x - stance.x) - stance.gaze_rad, math.tau)
            if abs(angle) <= FACES_RAD:
                ahead.append((math.hypot(x - stance.x, y - stance.y), other))
        found[name] = min(ahead)[1] if ahead else ""
    return found


def truth_frame(
    stamp: int,
    crowd: Crowd,
    time_s: float,
    camera: HeadCamera,
    seen: Sequence[Sight],
    stances: Mapping[str, Stance],
    *,
    image_topic: str,
    frame_id: str,
) -> dict[str, Any]:
    """Return the ground truth of one image as a `socialbot/truth_frame`.

    Beside the fields that are scored, each person has ``at`` (x, y; m), ``heading_rad``, ``faces`` (robot, an id, or
    nobody), ``activity``, ``aim`` and ``talks_to``. ``others`` are people whom the camera does not see,
    ``camera`` is its pose and size.
    """
    facing = faces(stances)
    visible = {sight.person for sight in seen}

    def doing(name: str) -> dict[str, Any]:
        stance, episode = stances[name], crowd.motions[name].episode(time_s)
        talks = episode.partner if episode is not None and episode.activity == "talk" else ""
        return {
            "id": name,
            "at": [round(stance.x, 3), round(stance.y, 3)],
            "heading_rad": round(math.remainder(stance.heading_rad, math.tau), 3),
            "faces": facing[name],
            "activity": "walk" if episode is None else episode.activity,
            "aim": "" if episode is None else episode.aim,
            "talks_to": talks if talks in stances else "",
        }

    persons = []
    for sight in seen:
        x, y, w, h = (round(value, 2) for value in sight.box)
        posture = "seated" if sight.stance.seated > 0.5 else "standing"
        measured = {
            "x": x, "y": y, "w": w, "h": h, "visible": round(sight.visible, 3),
            "distance_m": round(sight.distance_m, 3), "facing_rad": round(min(sight.facing_rad, math.pi), 3),
            "posture": posture, "bearing_rad": round(sight.bearing_rad, 4),
            "elevation_rad": round(sight.elevation_rad, 4),
        }  # fmt: skip
        persons.append(doing(sight.person) | measured)
    return {
        "schema": "socialbot/truth_frame",
        "version": 1,
        "stamp": stamp,
        "image_topic": image_topic,
        "scene": crowd.script.place,
        "light": "lamps",
        "camera": {
            "frame_id": frame_id,
            "width": camera.width,
            "height": camera.height,
            "hfov_rad": camera.hfov_rad,
            "yaw_rad": round(camera.pan_rad, 5),
            "pitch_rad": round(-camera.tilt_rad, 5),
        },
        "persons": persons,
        "others": [doing(name) for name in stances if name not in visible],
        "objects": [],
    }
