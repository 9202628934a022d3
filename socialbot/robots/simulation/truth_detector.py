"""Detections made from the ground truth, with a stated model of errors: a fast stand-in for camera and detector."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetection, PersonDetections, RosMessage
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Input, Output, Parameter

_LEAST_PX = 36.0
_FACE_M, _FACE_RAD = 4.5, 1.0  # Faces are found up to this distance and angle.
_WALKING_MPS, _PATH_S = 0.4, 0.6
_REMEMBERED_S = 30.0


@dataclass
class _Known:
    """What is known of one person: track, places with their times (s), and errors that last."""

    track: str
    seen_s: float
    places: list[tuple[float, float, float]]
    distance_error: float = 0.0
    missing_until: float = 0.0


class TruthDetector(Node):
    """Person detector that takes people from the ground truth of a simulated place.

    Errors of each person and image, independent of the load of the machine:

    * missed with ``miss`` (twice that when half hidden or small), for 0.1 to 0.6 s at a time;
    * never seen below a quarter visible or 36 px;
    * edges with a standard deviation of 2 % of the height, directions of ``bearing_std_rad``;
    * distances with ``distance_std``, nearly all of it constant for a second or two;
    * ``facing_rad`` from faces up to 4.5 m and 1 rad (error 0.2 rad), else from the path of walkers, else unknown,
      or 2.1 for who turned the back for a second;
    * after an absence of 2 s a new track with the probability ``new_track``;
    * ghosts: a false person for 0.3 s, on average every ``ghost_s``.
    """

    truth = Input("std_msgs/msg/String", "/ground_truth/persons")
    detections = Output(PersonDetections, "/humans/bodies/detections")

    seed = Parameter(0, "random seed of the errors", fixed=True)
    miss = Parameter(0.02, "probability that a person is missed from an image on", minimum=0.0, maximum=1.0)
    distance_std = Parameter(0.05, "relative error of distances", minimum=0.0, maximum=0.5)
    bearing_std_rad = Parameter(0.008, "error of directions, rad", minimum=0.0, maximum=0.5)
    new_track = Parameter(0.15, "probability of a new track after an absence", minimum=0.0, maximum=1.0)
    ghost_s = Parameter(60.0, "mean time between false people, s; 0: none", minimum=0.0)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._rng = random.Random(self.seed)
        self._known: dict[str, _Known] = {}
        self._tracks = 0
        self._last_s: float | None = None
        self._ghost: tuple[float, PersonDetection] | None = None

    @truth
    def on_truth(self, message: RosMessage) -> None:
        frame = json.loads(message.data)
        stamp, camera = int(frame["stamp"]), frame["camera"]
        now = stamp / SECOND
        found = [one for person in frame["persons"] if (one := self._detect(person, camera, now)) is not None]
        found += self._false(camera, now)
        self._last_s = now
        self.detections.publish(
            PersonDetections(
                stamp=stamp, frame_id=camera["frame_id"], width=camera["width"], height=camera["height"],
                persons=tuple(found), camera_yaw_rad=camera["yaw_rad"],
                camera_hfov_rad=camera["hfov_rad"],
            )
        )  # fmt: skip

    def _detect(self, person: Mapping[str, Any], camera: Mapping[str, Any], now: float) -> PersonDetection | None:
        rng = self._rng
        if person["visible"] < 0.25 or person["h"] < _LEAST_PX:
            return None
        known = self._known.get(person["id"])
        away = math.inf if known is None else now - known.seen_s
        if known is None or away > _REMEMBERED_S or (away > 2.0 and rng.random() < self.new_track):
            self._tracks += 1
            known = self._known[person["id"]] = _Known(f"p{self._tracks}", now, [])
        if now < known.missing_until:
            return None
        hard = 2.0 if person["visible"] < 0.5 or person["h"] < 2 * _LEAST_PX else 1.0
        if rng.random() < hard * self.miss:
            known.missing_until = now + rng.uniform(0.1, 0.6)
            return None
        step = min(now - known.seen_s, 1.0)
        if away > 0.5:
            known.places.clear()
        known.seen_s = now
        keep = math.exp(-step / 1.5)
        known.distance_error = keep * known.distance_error + math.sqrt(1 - keep**2) * rng.gauss(0, 1)
        error = self.distance_std * (0.97 * known.distance_error + 0.24 * rng.gauss(0, 1))
        distance = person["distance_m"] * (1 + error)
        bearing = person["bearing_rad"] + rng.gauss(0, self.bearing_std_rad)
        direction = bearing + camera["yaw_rad"]
        known.places.append(
            (now, person["distance_m"] * math.cos(direction), person["distance_m"] * math.sin(direction))
        )
        known.places = [place for place in known.places if now - place[0] <= 1.0]
        facing, approach = self._facing(person, known)
        edges = [rng.gauss(0, 0.02) * person["h"] for _ in range(4)]
        return PersonDetection(
            x=person["x"] + edges[0],
            y=person["y"] + edges[1],
            w=max(person["w"] + edges[2], 1.0),
            h=max(person["h"] + edges[3], 1.0),
            score=min(max(rng.gauss(0.78, 0.08) * (0.6 + 0.4 * person["visible"]), 0.46), 0.99),
            track_id=known.track,
            distance_m=distance,
            distance_std_m=self.distance_std * distance,
            bearing_rad=bearing,
            elevation_rad=person["elevation_rad"] + rng.gauss(0, self.bearing_std_rad),
            facing_rad=facing,
            approach_mps=approach,
            posture=person["posture"],
            distance_source="image",
        )

    def _facing(self, person: Mapping[str, Any], known: _Known) -> tuple[float | None, float | None]:
        """Direction that a person faces, and speed of approach, as far as the detector would know them."""
        (begin, x0, y0), (end, x1, y1) = known.places[0], known.places[-1]
        approach, walking = None, None
        if end - begin >= _PATH_S:
            vx, vy = (x1 - x0) / (end - begin), (y1 - y0) / (end - begin)
            speed, away = math.hypot(vx, vy), max(math.hypot(x1, y1), 1e-6)
            approach = -(vx * x1 + vy * y1) / away
            if speed >= _WALKING_MPS:
                walking = math.acos(min(max(approach / speed, -1.0), 1.0))
        if person["facing_rad"] <= _FACE_RAD and person["distance_m"] <= _FACE_M:
            return abs(person["facing_rad"] + self._rng.gauss(0, 0.2)), approach
        if walking is not None:
            return walking, approach
        turned = person["facing_rad"] > 1.75 and person["distance_m"] <= _FACE_M and end - begin >= 0.9
        return (2.1 if turned else None), approach

    def _false(self, camera: Mapping[str, Any], now: float) -> list[PersonDetection]:
        rng = self._rng
        if self._ghost is not None and now < self._ghost[0]:
            return [self._ghost[1]]
        self._ghost = None
        step = 0.0 if self._last_s is None else now - self._last_s
        if not self.ghost_s or rng.random() >= step / self.ghost_s:
            return []
        self._tracks += 1
        high, x = rng.uniform(60, 200), rng.uniform(0, camera["width"] - 60)
        ghost = PersonDetection(
            x=x, y=camera["height"] * 0.4, w=high * 0.35, h=high, score=0.5, track_id=f"p{self._tracks}",
            distance_m=rng.uniform(2.5, 8.0), bearing_rad=rng.uniform(-0.5, 0.5), elevation_rad=0.0,
            distance_source="image",
        )  # fmt: skip
        self._ghost = now + 0.3, ghost
        return [ghost]
