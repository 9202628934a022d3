"""Perception pipeline: detector, tracker, static object filter, distance and direction.

The node and the evaluation share it, so the evaluation measures the code that runs.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np

from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetection
from socialbot.vision._occlusion import feet_are_hidden, with_hidden_side
from socialbot.vision._static_objects import StaticObjectFilter
from socialbot.vision.appearance import looks_of
from socialbot.vision.camera import ASSUMED, CameraModel, CameraPose
from socialbot.vision.camera_pose import PoseEstimator
from socialbot.vision.depth import Ranged, RangeImage, Source, measure_people
from socialbot.vision.detector import Detections, Detector, shared_area
from socialbot.vision.detectors import DetectorSpec
from socialbot.vision.distance import (
    HIDDEN_SHARE,
    PERSON_HEIGHT_M,
    Estimate,
    Figure,
    Posture,
    Range,
    Stature,
    head_direction,
    height_on_floor,
    measure,
    shared_error,
    whole_height,
)
from socialbot.vision.faces import Attention, FaceFinder
from socialbot.vision.motion import CameraMotion, Cut, cut_off
from socialbot.vision.reidentification import REMEMBER_S, Locate
from socialbot.vision.tracking import Track, Tracker
from socialbot.vision.whereabouts import FloorPoint, LastSeen

log = logging.getLogger("socialbot.depth")

TRACKERS = ("kalman", "none")
_WIDEST = 0.5  # A box wider than this share of its height is cut off at the feet.
# Shares of people whose feet are hidden, among those with a wide box, and those behind another person. Detectors mostly
# guess the feet of the latter.
_HIDDEN_LEGS, _HIDDEN_BEHIND = 0.7, 0.2
# The pose of the camera is trusted if whole people have the usual height by it: so many, of such a median error.
_LEAST_WHOLE, _MOST_WHOLE, _POSE_ERROR = 8, 60, 0.12
_LEAST_AGAINST = 3  # So many whole people can contradict a stated pose, which is trusted until then.
_RANGED_NS = SECOND // 2  # For this long, a prediction from depth is better than the distance from the image.
_IN_RANGE_M, _MANY_BOXES, _FEW_MEASURED = 5.0, 50, 0.05  # Sensors are judged by so many boxes of people in range.
_FACE_NS = 4 * SECOND // 10  # A face gives the distance for this long.
_TOUCHING = 0.1  # Share of a box that another one covers.
_PERSON_ASPECT = (0.15, 0.6)  # Widths of people who stand, as shares of their height.
_FLOOR_NS = SECOND  # Pause between two searches for the floor, which cost some milliseconds.
_LEARNT_PER_IMAGE = 3  # People from whom the pose is learnt in one image; each costs some milliseconds.
_SURE_HEIGHT = 0.15  # Relative error of the camera height from which the detector may use it.
_LASTING = 0.6  # Share of the error of a distance that all images of a person have in common.
_REMEMBERED_S = 10.0  # The state of a lost track is kept for this long.


@dataclass
class TrackState:
    """Learned state of one track; ``stamp`` (ns) is that of its last image, ``ranged`` of its last depth.

    ``whole`` is whether the last box showed a whole standing person, ``face`` the stamp (ns) and the height (px) of the
    last face.
    ``least`` is the relative error of distances from images that more images do not reduce: that of the height of the
    person and of the camera's pose. ``hidden`` is the probability that the feet are hidden.
    """

    figure: Figure
    range: Range | None
    stamp: int
    attention: Attention = field(default_factory=Attention)
    ranged: int = -(2**62)
    source: Source = "depth"
    posture: Posture = "unknown"
    whole: bool = False
    least: float = math.inf
    face: tuple[int, float] = (-(2**62), 0.0)
    hidden: float = HIDDEN_SHARE

    def face_height(self, stamp_ns: int) -> float:
        """Height in pixels of the face found in this image or shortly before; 0 if there is none."""
        if self.attention.face is not None:
            self.face = stamp_ns, self.attention.face.box[3]
        stamp, height = self.face
        return height if 0 <= stamp_ns - stamp <= _FACE_NS else 0.0


class PersonPipeline:
    """Detects and tracks the people in the images of one camera.

    Boxes of people with a hidden side are extended behind the person who hides it. Those with hidden feet are extended
    to the floor, if the pose of the camera fits the people seen so far.

    Args:
        spec: Description of the detector, with its score thresholds.
        detector: Detector, whose threshold the pipeline sets.
        tracker: Name of the tracker (`TRACKERS`); "none" treats each image alone.
        threshold: Score from which a detection counts alone; default: that of ``spec``.
        bridge_s: Longest time to publish a lost track, s; default: that of ``spec``.
        person_height_m: Usual height of a person, m.
        hide_still: Whether tracks that never move are removed; needs a tracker.
        remember_s: How long a lost person is recognised by colours and keeps the id, s; 0 turns this off.
        faces: Whether faces of tracked people are searched; detectors without ``spec.faces`` never do.
    """

    def __init__(
        self,
        spec: DetectorSpec,
        detector: Detector,
        *,
        tracker: str = "kalman",
        threshold: float | None = None,
        bridge_s: float | None = None,
        person_height_m: float = PERSON_HEIGHT_M,
        hide_still: bool = True,
        remember_s: float = REMEMBER_S,
        faces: bool = False,
    ) -> None:
        self.person_height_m = person_height_m
        self.tracker = None
        if tracker == "kalman":
            clear = spec.certain if math.isfinite(spec.certain) else None
            self.tracker = Tracker(spec.sure, spec.weak, clear=clear, remember_s=remember_s)
        self.hide_still = hide_still
        self._faces = FaceFinder() if faces and spec.faces and tracker != "none" else None
        self._camera_motion = CameraMotion()
        self._is_direction_stated = False
        self._static_objects = StaticObjectFilter(spec.certain)
        self._spec = spec
        self._detector = detector
        self._known: dict[str, TrackState] = {}
        self._errors: deque[float] = deque(maxlen=_MOST_WHOLE)
        self._stamp = 0
        self._floor_stamp = -(2**62)
        self._in_range: tuple[int, int] | None = (0, 0)
        """Numbers of measured and of all boxes of people in range of the sensors; None once these are judged."""
        self._estimator: PoseEstimator | None = None
        self._pose = ASSUMED
        self.set_threshold(threshold)
        self.set_bridge(bridge_s)

    def set_threshold(self, threshold: float | None) -> None:
        """Set the score from which a detection counts alone (None: the default); may be called between images."""
        sure = self._spec.sure if threshold is None else threshold
        self.threshold = sure
        if self.tracker is not None:
            self.threshold = min(self._spec.weak, sure)
            self.tracker.sure, self.tracker.weak = sure, self.threshold

    def set_bridge(self, bridge_s: float | None) -> None:
        """Set the longest time to publish a lost track (None: the default); may be called between images."""
        if self.tracker is not None:
            self.tracker.bridge_s = self._spec.bridge_s if bridge_s is None else bridge_s

    @property
    def pose(self) -> CameraPose:
        """Pose of the camera: as given, or as estimated from the people so far."""
        return self._pose

    @property
    def searches_faces(self) -> bool:
        """Whether faces of tracked people are searched."""
        return self._faces is not None

    @property
    def sees_floor(self) -> bool:
        """Whether the floor in depth images has contributed to the pose."""
        return self._estimator is not None and self._estimator.floors > 0

    def _located(self, camera: CameraModel) -> CameraModel:
        """The camera at its estimated pose, unless its pose is known."""
        given = camera.pose
        if _is_known(given):
            self._pose = given
            return camera
        if self.tracker is None or self._estimator is None or self._estimator.prior != given:
            self._estimator = PoseEstimator(given, person_height_m=self.person_height_m)
        self._pose = self._estimator.pose
        return camera.at(self._pose)

    def _learn_pose(
        self, tracks: Sequence[Track], camera: CameraModel, stamp_ns: int, depth: Sequence[RangeImage] = ()
    ) -> CameraModel:
        """Learn the pose of the camera from people who are wholly visible, and from the floor."""
        if _is_known(camera.pose) or self._estimator is None:
            return camera
        if depth and not 0 <= stamp_ns - self._floor_stamp < _FLOOR_NS:
            self._floor_stamp = stamp_ns
            self._estimator.see_floor(depth[0].cloud(camera))
        boxes = np.array([track.box for track in tracks]).reshape(-1, 4)
        left = _LEARNT_PER_IMAGE
        for number, track in enumerate(tracks):
            x, y, w, h = track.box.tolist()
            whole = not (any(track.cut) or track.feet_hidden or track.unseen_s) and track.score >= self._spec.sure
            others = np.delete(boxes, number, axis=0)
            if left and whole and _PERSON_ASPECT[0] < w / h < _PERSON_ASPECT[1] and not _touched(track.box, others):
                name = track.id or f"{stamp_ns}.{number}"
                left -= self._estimator.see(camera, (x, y, w, h), name, stamp_ns / SECOND)
        self._pose = self._estimator.pose
        return camera.at(self._pose)

    def find(
        self, image_bgr: np.ndarray, stamp_ns: int, camera: CameraModel, depth: Sequence[RangeImage] = ()
    ) -> tuple[PersonDetection, ...]:
        """Find the people in an image (height, width, 3), uint8, BGR, best first.

        A stamp before the last one starts a new recording. ``depth`` are measurements at the same time.
        """
        return self.follow(self.detect(image_bgr, camera, self.threshold), image_bgr, stamp_ns, camera, depth)

    def detect(self, image_bgr: np.ndarray, camera: CameraModel, threshold: float) -> Detections:
        """Run the detector alone, with a score ``threshold``."""
        self._detector.threshold = threshold
        camera = self._located(camera)
        self._detector.horizon = min(max(camera.horizon, 0.0), 1.0)
        if self.tracker is not None:
            sure = camera.pose.height_std_m < _SURE_HEIGHT * camera.pose.height_m
            self._detector.camera_height = camera.pose.height_m / self.person_height_m if sure else None
        return self._detector.detect(image_bgr)

    def follow(
        self,
        found: Detections,
        image_bgr: np.ndarray,
        stamp_ns: int,
        camera: CameraModel,
        depth: Sequence[RangeImage] = (),
    ) -> tuple[PersonDetection, ...]:
        """Track the people ``found`` in an image, and measure their distance."""
        if self.tracker is None:
            return self.measured(found, camera, depth)
        grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
        turn = self._camera_motion.follow(grey, found.boxes, camera)
        camera = self._located(camera)
        looks = looks_of(image_bgr, found.boxes) if self.tracker.remember_s > 0 else None
        size = image_bgr.shape[1], image_bgr.shape[0]
        # A camera without a stated direction looks into the same one until the image shows a motion.
        stated, moved = camera.yaw_rad is not None, turn is not None
        if self._camera_motion.contradicted or stated is not self._is_direction_stated or (moved and not stated):
            self.tracker.forget_places()
        self._is_direction_stated = stated
        tracks = self.tracker.update(stamp_ns, found.boxes, found.scores, size, looks, turn, self._locate(camera))
        if stamp_ns < self._stamp:
            self._known = {}
            self._errors.clear()
        self._stamp = stamp_ns
        oldest = stamp_ns - round(_REMEMBERED_S * SECOND)
        self._known = {name: person for name, person in self._known.items() if person.stamp >= oldest}
        for track in tracks:
            if track.id and track.id not in self._known:
                self._known[track.id] = TrackState(Figure(self._anybody()), None, stamp_ns)
        attention = {name: person.attention for name, person in self._known.items()}
        if self._faces is not None:
            self._faces.look(image_bgr, stamp_ns, tracks, attention)
        if self.hide_still:
            people = {name for name, each in attention.items() if each.is_person(stamp_ns)}
            tracks = self._static_objects.people(grey, stamp_ns, tracks, self.tracker.doubtful, people)
        tracks = self._with_hidden_feet(tracks)
        return self._persons(tracks, stamp_ns, self._learn_pose(tracks, camera, stamp_ns, depth), depth)

    def _locate(self, camera: CameraModel) -> Locate:
        """Locate boxes of people on the floor."""

        def locate(box: np.ndarray, cut: Cut) -> FloorPoint | None:
            x, y, w, h = box.tolist()
            seen = measure(camera, (x, y, w, h), self._anybody(), cut)
            bearing, _ = camera.direction(x + w / 2, y)
            return seen and FloorPoint.at(seen.distance, bearing + (camera.yaw_rad or 0.0))

        return locate

    def measured(
        self, found: Detections, camera: CameraModel, depth: Sequence[RangeImage] = ()
    ) -> tuple[PersonDetection, ...]:
        """Measure the distance of the people ``found``, without tracking them.

        Without a tracker, images may be unrelated: an unknown pose of the camera is estimated from these people alone,
        of whom weaker ones than the threshold do not count.
        """
        tracks = [
            Track("", box, score, 0.0, cut_off(box, camera.width, camera.height))
            for box, score in zip(found.boxes, found.scores.tolist(), strict=True)
        ]
        camera = self._located(camera)
        if self.tracker is None:
            good = [track for track in tracks if track.score >= self.threshold]
            camera = self._learn_pose(good, camera, 0)
        return self._persons(tracks, 0, camera, depth)

    def _with_hidden_feet(self, tracks: Sequence[Track]) -> tuple[Track, ...]:
        """Mark tracks whose feet may be hidden, and keep the probability of it.

        They are occluded from below, or too wide to be whole: a low object, such as a trolley, hides their feet.
        """
        boxes = np.array([track.box for track in tracks]).reshape(-1, 4)
        marked: list[Track] = []
        for track in tracks:
            _, _, w, h = track.box
            wide = not (track.cut.top or track.cut.bottom) and w > _WIDEST * h
            behind = not track.cut.bottom and feet_are_hidden(track.box, boxes)
            if track.id:
                self._known[track.id].hidden = _HIDDEN_LEGS if wide else _HIDDEN_BEHIND if behind else HIDDEN_SHARE
            marked.append(replace(track, feet_hidden=True) if wide or behind else track)
        return tuple(marked)

    def _persons(
        self, tracks: Sequence[Track], stamp_ns: int, camera: CameraModel, depth: Sequence[RangeImage]
    ) -> tuple[PersonDetection, ...]:
        ranged: dict[int, Ranged | None] = {}
        if depth:
            # The box of a lost track is a prediction, and may show somebody else.
            seen = [number for number, track in enumerate(tracks) if not track.unseen_s]
            boxes = [tuple(tracks[number].box.tolist()) for number in seen]
            expected = [self._expected(tracks[number], stamp_ns, camera) for number in seen]
            ranged = dict(zip(seen, measure_people(depth, camera, boxes, expected), strict=True))
            self._tell_unmeasured(list(ranged.values()), expected, depth)
        shown = np.array([track.box for track in tracks]).reshape(-1, 4)
        return tuple(
            self._person(track, stamp_ns, camera, ranged.get(number), shown) for number, track in enumerate(tracks)
        )

    def _tell_unmeasured(
        self, ranged: Sequence[Ranged | None], expected: Sequence[Estimate | None], depth: Sequence[RangeImage]
    ) -> None:
        """Log once that sensors measure hardly anybody, as with other units than millimetres or wrong transforms."""
        if self._in_range is None:
            return
        near = [each for each, guess in zip(ranged, expected, strict=True) if guess and guess.value < _IN_RANGE_M]
        measured, boxes = self._in_range
        self._in_range = measured, boxes = measured + sum(map(bool, near)), boxes + len(near)
        if boxes < _MANY_BOXES:
            return
        self._in_range = None
        if measured < _FEW_MEASURED * boxes:
            log.warning(
                "%s measures nearly none of the people within %g m, %d of %d boxes: check that depth is in mm (16UC1) "
                "or m (32FC1), and registered to the images or placed by the right transforms",
                " and ".join(dict.fromkeys(each.source for each in depth)),
                _IN_RANGE_M,
                measured,
                boxes,
            )

    def _expected(self, track: Track, stamp_ns: int, camera: CameraModel) -> Estimate | None:
        """Distance of a person from the last depth, or else from the image."""
        known = self._known.get(track.id)
        if known is not None and known.range is not None and stamp_ns - known.ranged < _RANGED_NS:
            return known.range.estimate
        stature, hidden = self._anybody(), HIDDEN_SHARE
        if known is not None:
            stature, hidden = known.figure.stature, known.hidden
        seen = measure(camera, tuple(track.box.tolist()), stature, track.cut, hidden=hidden)
        return seen and seen.distance

    def _person(
        self, track: Track, stamp_ns: int, camera: CameraModel, ranged: Ranged | None, shown: np.ndarray
    ) -> PersonDetection:
        x, y, w, h = box = tuple(track.box.tolist())
        if track.id:
            distance, height_m, posture = self._followed(track, box, stamp_ns, camera, ranged)
        else:
            stature = self._anybody()
            seen = measure(camera, box, stature, track.cut)
            distance = ranged.estimate if ranged is not None else seen and seen.distance
            height_m, posture = stature.height.value, seen.posture if seen else "unknown"
        bearing, elevation = head_direction(camera, box, track.cut, distance and distance.value, height_m)
        if track.feet_hidden and distance is not None and self._is_pose_trusted():
            h = min(max(h, whole_height(camera, box, distance.value)), camera.height - y)
        if self.tracker is not None and not (track.cut.left or track.cut.right):
            x, w = with_hidden_side(track.box, h, shown)
        attention = self._known[track.id].attention if track.id else Attention()
        if track.id and distance is not None and not track.unseen_s:
            direction = bearing + (camera.yaw_rad or 0.0)
            attention.walk(stamp_ns, distance, direction)
            if self.tracker is not None:
                point = FloorPoint.at(distance, direction)
                self.tracker.place(track.id, LastSeen(stamp_ns, point, attention.velocity or (0.0, 0.0)))
        return PersonDetection(
            x=x,
            y=y,
            w=w,
            h=h,
            score=track.score,
            track_id=track.id,
            tentative=bool(track.key) and not track.id,
            distance_m=distance and distance.value,
            distance_std_m=distance and distance.std,
            distance_source="unknown" if distance is None else self._source(track, stamp_ns, ranged),
            posture=posture,
            bearing_rad=bearing,
            elevation_rad=elevation,
            unseen_s=track.unseen_s,
            face=attention.face.box if attention.face is not None else (),
            facing_rad=attention.facing_rad(stamp_ns),
            approach_mps=attention.approach_mps(),
        )

    def _source(self, track: Track, stamp_ns: int, ranged: Ranged | None) -> Literal["image", "depth", "lidar"]:
        """Source of the distance of a person: a prediction has that of its last measurement."""
        if ranged is not None:
            return ranged.source
        known = self._known.get(track.id)
        return known.source if known is not None and stamp_ns - known.ranged < _RANGED_NS else "image"

    def _is_pose_trusted(self) -> bool:
        if len(self._errors) < (_LEAST_AGAINST if _is_known(self._pose) else _LEAST_WHOLE):
            return _is_known(self._pose)
        return float(np.median(self._errors)) <= _POSE_ERROR

    def _anybody(self) -> Stature:
        return Stature.of_people(self.person_height_m, self._detector.box_width_m * self.person_height_m / 1.70)

    def _followed(
        self, track: Track, box: tuple[float, ...], stamp_ns: int, camera: CameraModel, ranged: Ranged | None
    ) -> tuple[Estimate | None, float, Posture]:
        """Distance, height and posture of a tracked person."""
        known = self._known[track.id]
        seconds = (stamp_ns - known.stamp) / SECOND
        known.stamp = stamp_ns
        if known.range is not None:
            known.range.pass_(seconds)
        if ranged is not None:
            if known.range is None or stamp_ns - known.ranged >= _RANGED_NS:
                known.range = Range(ranged.estimate, ranged.source)
            else:
                known.range.see(ranged.estimate, ranged.source, seconds)
            known.ranged, known.source = stamp_ns, ranged.source
        elif not track.unseen_s and stamp_ns - known.ranged >= _RANGED_NS:
            face = known.face_height(stamp_ns)
            kind = (track.cut, face > 0)
            expected = known.range and known.range.expected(kind)
            seen = measure(
                camera, box, known.figure.stature, track.cut, hidden=known.hidden, face=face, expected=expected
            )
            now = seen and seen.distance
            known.posture, known.whole = (seen.posture, seen.whole) if seen else ("unknown", False)
            if now is not None:
                known.least = min(known.least, _LASTING * now.std / now.value)
            # A box cut off at the bottom and a side measures little; the prediction is better.
            sides = track.cut.left or track.cut.right
            vague = sides and (track.cut.bottom or track.feet_hidden)
            if now is not None and known.range is None:
                known.range = Range(now, kind)
            elif now is not None and known.range is not None and not (vague and known.range.estimate.std < now.std):
                known.range.see(now, kind, seconds)
        if not (track.unseen_s or any(track.cut) or track.feet_hidden):
            if known.whole:
                known.figure.learn(camera, box, seconds)
            self._errors.append(abs(math.log(max(height_on_floor(camera, box), 0.1) / self.person_height_m)))
        distance = known.range and known.range.estimate
        if distance is not None and ranged is None:
            own = max(distance.std, known.least * distance.value)
            shared = shared_error(camera, distance.value) * distance.value
            distance = Estimate(distance.value, math.hypot(own, shared))
        return distance, known.figure.stature.height.value, known.posture


def _is_known(pose: CameraPose) -> bool:
    """Whether a pose is exact; any other is refined with people."""
    return pose.source == "given" or not (pose.height_std_m or pose.pitch_std_rad)


def _touched(box: np.ndarray, others: np.ndarray) -> bool:
    """Whether one of ``others`` (n, 4) overlaps ``box``, so that its edges are less certain."""
    return bool((shared_area(box, others) > _TOUCHING * box[2] * box[3]).any())
