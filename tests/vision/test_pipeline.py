from __future__ import annotations

from dataclasses import replace

import cv2
import msgspec
import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetection
from socialbot.vision.camera import CameraModel, CameraPose
from socialbot.vision.detector import Detections
from socialbot.vision.detectors import DETECTORS, DetectorSpec
from socialbot.vision.distance import FACE_HEIGHT_M, PERSON_HEIGHT_M, Figure, Stature, head_direction, measure
from socialbot.vision.faces import Face
from socialbot.vision.motion import cut_off
from socialbot.vision.pipeline import PersonPipeline, TrackState
from tests.vision.test_distance import box_of

CAMERA = CameraModel(525, 525, 320, 240, 640, 480, CameraPose(height_m=1.62, pitch_rad=0.052))
BLANK = np.zeros((480, 640, 3), np.uint8)
SPEC = DetectorSpec("scripted", 0.5, 0.2, lambda settings: Scripted())

Found = list[tuple[tuple[float, float, float, float], float]]


class Scripted:
    """Detector with given boxes."""

    box_width_m = 0.5

    def __init__(self) -> None:
        self.threshold, self.horizon = 0.5, 0.5
        self.camera_height: float | None = None
        self.found: Found = []

    def detect(self, image: np.ndarray) -> Detections:
        best = sorted((one for one in self.found if one[1] >= self.threshold), key=lambda one: -one[1])
        boxes = np.array([box for box, _ in best], np.float64).reshape(-1, 4)
        return Detections(boxes, np.array([score for _, score in best]))


class Rig:
    """Pipeline with a scripted detector, for ten black images a second."""

    def __init__(self, *, hide_still: bool = False, **how) -> None:
        self.detector = Scripted()
        self.finder = PersonPipeline(SPEC, self.detector, hide_still=hide_still, **how)
        self.stamp = 0
        self.image = BLANK

    def find(self, *found, after_s: float = 0.1) -> tuple[PersonDetection, ...]:
        self.stamp += round(after_s * SECOND)
        self.detector.found = list(found)
        return self.finder.find(self.image, self.stamp, CAMERA)

    def show_whole_people(self) -> None:
        """Let people pass who show that the pose of the camera is right."""
        for step in range(12):
            self.find(at(4.0, bearing=0.3 - 0.02 * step))
        self.find(after_s=11.0)

    def repeat(self, count: int, *found) -> tuple[PersonDetection, ...]:
        return [self.find(*found) for _ in range(count)][-1]


def at(distance: float, score: float = 0.7, bearing: float = 0.0, **how: float):
    """Box and score of a person ``distance`` m away."""
    return box_of(CAMERA, distance, bearing, **how), score


def metres(person: PersonDetection) -> tuple[float, float]:
    """Distance and standard error."""
    assert person.distance_m is not None
    assert person.distance_std_m is not None
    return person.distance_m, person.distance_std_m


def test_images_are_independent_without_a_tracker():
    rig = Rig(tracker="none")
    assert rig.detector.threshold == 0.5
    found = at(4.0)
    for _ in range(2):
        (person,) = rig.find(found, at(8.0, 0.4))
        x, y, w, h = found[0]
        seen = measure(CAMERA, found[0], Stature.of_people(PERSON_HEIGHT_M, 0.5 * PERSON_HEIGHT_M / 1.70))
        assert seen is not None
        distance = seen.distance
        bearing, elevation = head_direction(
            CAMERA, found[0], cut_off(np.array(found[0]), 640, 480), distance.value, PERSON_HEIGHT_M
        )
        assert person == PersonDetection(
            x=x, y=y, w=w, h=h, score=0.7, distance_m=distance.value, distance_std_m=distance.std,
            bearing_rad=bearing, elevation_rad=elevation, distance_source="image", posture=seen.posture,
        )  # fmt: skip
    assert rig.find() == ()


def test_weak_boxes_continue_known_tracks_only():
    rig = Rig()
    assert rig.find(at(4.0, 0.3)) == ()
    assert rig.detector.threshold == 0.2
    rig.find(at(4.0, 0.9))
    (before,) = rig.find(at(4.0, 0.9))
    (after,) = rig.find(at(4.0, 0.3), at(8.0, 0.3, -0.3))
    assert before.track_id == after.track_id != ""
    assert after.score == 0.3


def test_bridged_person_is_unseen_and_less_certain():
    rig = Rig()
    before = rig.repeat(8, at(4.0))[0]
    (bridged,) = rig.find()
    assert bridged.track_id == before.track_id
    assert (before.unseen_s, bridged.unseen_s) == (0.0, pytest.approx(0.1))
    assert metres(bridged)[0] == pytest.approx(metres(before)[0], rel=0.02)
    assert metres(bridged)[1] > metres(before)[1]


def test_bridge_may_be_turned_off():
    rig = Rig(bridge_s=0.0)
    rig.repeat(8, at(4.0))
    assert rig.find() == ()


def test_learnt_stature_improves_near_distances():
    rig, alone = Rig(), Rig(tracker="none")
    walk = [at(distance, tall=1.85, wide=0.68) for distance in np.arange(8.0, 1.35, -0.1)]
    followed, single = ([finder.find(seen) for seen in walk][-1][0] for finder in (rig, alone))
    assert metres(single)[0] < 1.25
    assert metres(followed)[0] == pytest.approx(1.4, abs=0.12)
    assert metres(followed)[1] < metres(single)[1]


def test_leaving_at_the_side_does_not_increase_the_distance():
    rig = Rig()
    rig.repeat(10, at(1.5))
    found = [rig.find(at(1.5, 0.7, bearing)) for bearing in np.arange(0.0, 0.6, 0.03)]
    cut = [metres(people[0])[0] for people in found if people and people[0].x < 1]
    assert len(cut) > 4
    assert max(cut) < 1.8


def test_width_bounds_the_distance_at_the_side():
    rig = Rig()
    found = [rig.find(at(1.5, 0.9, bearing)) for bearing in np.arange(0.6, 0.3, -0.05)]
    assert any(found)
    assert all(metres(people[0])[0] < 4.0 for people in found if people)


def test_stated_turn_of_the_camera_keeps_neighbours_apart():
    rig = Rig()

    def ids(yaw: float) -> list[str]:
        rig.detector.found = [at(4.0, bearing=bearing - yaw) for bearing in (0.1, -0.1)]
        rig.stamp += SECOND // 5
        camera = replace(CAMERA, yaw_rad=yaw)
        people = rig.finder.find(BLANK, rig.stamp, camera)
        known = [person for person in people if not person.tentative]
        return [person.track_id for person in sorted(known, key=lambda person: person.x)]

    assert [ids(yaw) for yaw in (0.0, 0.0, 0.2, 0.0, -0.2, 0.0)] == [["t1", "t2"]] * 6


def _dress(image: np.ndarray, box: tuple[float, ...], *, striped: bool) -> None:
    """Draw the clothes of a person, who looks a bit different with stripes."""
    x, y, w, h = box
    person = image[round(y) : round(y + h), round(x) : round(x + w)]
    person[:] = (60, 50, 190)
    stripe = round(h / 36)
    for row in range(0, len(person), 6 * stripe) if striped else ():
        person[row : row + stripe] = (70, 150, 60)


def found_after_a_turn(there: tuple[float, float], step_rad: float = 0.15, base_turns: float = 0.0) -> set[str]:
    """Ids of a person 4 m ahead whom a camera leaves for 3 s, and who is then at a distance and bearing.

    ``step_rad`` is the stated turn of the camera in each image, ``base_turns`` (rad) one of the base, not stated.
    """
    rig, yaw, striped = Rig(), 0.0, False
    room = np.kron(np.random.default_rng(0).integers(60, 150, (24, 400)), np.ones((20, 20))).astype(np.uint8)

    def ids(*found: tuple[float, float]) -> list[str]:
        rig.detector.found = [at(distance, bearing=bearing - yaw) for distance, bearing in found]
        rig.stamp += SECOND // 5
        left = round(4000 - 525 * (yaw + base_turns * rig.stamp / SECOND * 5))
        image = cv2.cvtColor(np.ascontiguousarray(room[:, left : left + 640]), cv2.COLOR_GRAY2BGR)
        for box, _ in rig.detector.found:
            _dress(image, box, striped=striped)
        people = rig.finder.find(image, rig.stamp, replace(CAMERA, yaw_rad=yaw))
        return [person.track_id for person in people if not person.tentative]

    for _ in range(10):
        ids((4.0, 0.0))
    striped = True  # The person looks a bit different from the other side.
    for step in range(16):
        yaw += step_rad if step < 8 else -step_rad
        ids()
    return {each for _ in range(5) for each in ids(there)}


@pytest.mark.parametrize(("there", "expected"), [((4.0, 0.0), "t1"), ((4.1, 0.22), "t1"), ((10.0, 0.0), "t2")])
def test_person_out_of_view_is_expected_near_their_place(there: tuple[float, float], expected: str):
    assert found_after_a_turn(there) == {expected}


def test_places_are_forgotten_when_the_base_turns():
    assert found_after_a_turn((4.1, 0.22), step_rad=0.05) == {"t1"}
    assert found_after_a_turn((4.1, 0.22), step_rad=0.05, base_turns=0.04) == {"t2"}


@pytest.mark.parametrize(("step_px", "expected"), [(0, "t1"), (40, "t2")])
def test_place_of_a_person_counts_while_a_camera_without_transforms_stands_still(step_px: int, expected: str):
    rig = Rig()
    room = np.kron(np.random.default_rng(0).integers(60, 150, (24, 400)), np.ones((20, 20))).astype(np.uint8)

    def ids(left: int, *, striped: bool, seen: bool = True) -> list[str]:
        rig.detector.found = [at(4.0)] if seen else []
        rig.stamp += SECOND // 5
        image = cv2.cvtColor(np.ascontiguousarray(room[:, left : left + 640]), cv2.COLOR_GRAY2BGR)
        for box, _ in rig.detector.found:
            _dress(image, box, striped=striped)
        found = rig.finder.find(image, rig.stamp, CAMERA)
        return [person.track_id for person in found if not person.tentative]

    for _ in range(10):
        ids(4000, striped=False)
    for step in range(16):
        ids(4000 + step_px * step, striped=False, seen=False)
    again = {each for _ in range(5) for each in ids(4000 + step_px * 15, striped=True)}
    assert again == {expected}


def test_new_recording_resets_the_tracks():
    rig = Rig()
    for distance in np.arange(8.0, 1.4, -0.1):
        rig.find(at(distance, tall=1.85, wide=0.68))
    (again,) = rig.find(at(1.5, tall=1.85, wide=0.68), after_s=-3.0)
    fresh = Rig()
    (first,) = fresh.find(at(1.5, tall=1.85, wide=0.68))
    assert again.distance_m == first.distance_m
    assert again.track_id != first.track_id == "t1"


def test_cut_off_person_is_measured_by_the_box_width_of_the_detector():
    rig = Rig(tracker="none")
    near = at(1.4)
    (narrow,) = rig.find(near)
    rig.detector.box_width_m = 0.68
    (wide,) = rig.find(near)
    assert metres(wide)[0] > 1.2 * metres(narrow)[0]


def test_assumed_height_may_change():
    rig = Rig(tracker="none")
    (before,) = rig.find(at(5.0))
    rig.finder.person_height_m = 1.9
    (after,) = rig.find(at(5.0))
    assert metres(after)[0] > metres(before)[0]


def test_detector_learns_where_the_horizon_is():
    rig = Rig()
    rig.find()
    assert rig.detector.horizon == pytest.approx(CAMERA.horizon)
    rig.finder.find(BLANK, 10**10, CameraModel(525, 525, 320, 240, 640, 480, CameraPose(height_m=1.62, pitch_rad=1.0)))
    assert rig.detector.horizon == 0.0


def test_detector_learns_how_high_the_camera_is_above_the_floor():
    rig = Rig(person_height_m=1.8)
    rig.find()
    assert rig.detector.camera_height == pytest.approx(CAMERA.pose.height_m / 1.8)


def test_in_single_images_people_may_stand_anywhere():
    rig = Rig(tracker="none")
    rig.find()
    assert rig.detector.camera_height is None


@pytest.mark.parametrize(("sure", "weak"), [(0.6, 0.2), (0.1, 0.1)])
def test_threshold_may_change(sure, weak):
    rig = Rig()
    rig.finder.set_threshold(sure)
    rig.find(at(4.0, sure))
    assert len(rig.find(at(4.0, sure))) == 1
    assert rig.detector.threshold == weak
    assert rig.finder.tracker is not None
    assert (rig.finder.tracker.sure, rig.finder.tracker.weak) == (sure, weak)


def test_threshold_takes_the_place_of_the_detector_s_own():
    rig = Rig(threshold=0.8)
    rig.find()
    assert [rig.find(at(4.0, 0.79)) for _ in range(3)] == [(), (), ()]
    assert len(rig.repeat(2, at(4.0, 0.8))) == 1


def test_certain_detection_gets_an_id_at_once():
    rig = Rig()
    rig.find()
    (tentative,) = rig.find(at(4.0, 0.72))
    assert (tentative.track_id, tentative.tentative) == ("", True)
    assert tentative.distance_m == pytest.approx(4.0, rel=0.2)
    certain = [person for person in rig.find(at(8.0, 0.73, 0.3)) if not person.tentative]
    assert [person.track_id for person in certain] == ["t1"]


def test_detections_without_a_tracker_are_not_tentative():
    rig = Rig(tracker="none")
    (person,) = rig.find(at(4.0, 0.72))
    assert (person.track_id, person.tentative) == ("", False)


def test_state_of_lost_tracks_is_deleted():
    rig = Rig(tracker="kalman")
    for number in range(200):
        rig.find(at(4.0, 0.9, 0.3 * (-1) ** number), after_s=3.0)
    assert len(rig.finder._known) < 10


def test_weak_score_of_every_detector_is_below_the_sure_one():
    for name, spec in DETECTORS.items():
        assert spec.name == name
        assert spec.weak < spec.sure


def test_same_images_give_the_same_people():
    def play() -> list[tuple[PersonDetection, ...]]:
        rig, random = Rig(), np.random.default_rng(5)
        return [
            rig.find(*(at(random.uniform(1, 9), random.uniform(0.2, 0.9), random.uniform(-0.4, 0.4)) for _ in range(3)))
            for _ in range(40)
        ]

    assert play() == play()


def test_finder_can_be_made_of_any_detector():
    finder = PersonPipeline(SPEC, Scripted(), tracker="none")
    assert finder.find(BLANK, 1, CAMERA) == ()


def test_static_objects_are_removed_on_request():
    for how, expected in (({}, 0), ({"hide_still": False}, 1), ({"tracker": "none"}, 1)):
        rig = Rig(**{"hide_still": True, **how})
        noise = np.random.default_rng(1)
        room = noise.integers(60, 190, (60, 80, 3)).astype(np.uint8)
        found = ()
        for _ in range(20):
            picture = cv2.resize(room, (640, 480), interpolation=cv2.INTER_CUBIC).astype(float)
            rig.image = np.clip(picture + noise.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)
            found = rig.find(at(4.0, score=0.6))
        assert len(found) == expected


def test_occluded_person_is_extended_to_the_floor():
    rig = Rig()
    rig.show_whole_people()
    x, y, w, h = box_of(CAMERA, 5.0, 0.0)
    near = box_of(CAMERA, 1.5, -0.05)
    _, hidden = rig.repeat(5, (near, 0.9), ((x, y, w, h / 2), 0.7))
    assert (hidden.y, hidden.x, hidden.w) == (y, pytest.approx(x, abs=2), pytest.approx(w, abs=4))
    assert hidden.h == pytest.approx(h, rel=0.15)


@pytest.mark.parametrize(("tracker", "share"), [("kalman", 1.0), ("none", 0.4)])
def test_half_hidden_person_is_extended_behind_the_nearer_one(tracker, share):
    rig = Rig(tracker=tracker)
    x, y, w, h = box_of(CAMERA, 5.0, 0.0)
    near = (x + 0.4 * w, y - 40, 2 * w, h + 120)
    _, strip = rig.repeat(5, (near, 0.9), ((x, y, 0.4 * w, h), 0.7))
    assert (strip.x, strip.y) == (pytest.approx(x), pytest.approx(y))
    assert strip.w == pytest.approx(share * w, rel=0.15)


def extended(pose: CameraPose, *seen: tuple[float, float, float, float]) -> bool:
    """Whether the box of an occluded person is extended to the floor after an image of the boxes ``seen``."""
    rig, camera = Rig(), CAMERA.at(pose)
    x, y, w, h = box_of(CAMERA, 5.0, 0.0)
    near = box_of(CAMERA, 1.5, -0.05)
    rig.detector.found = [(box, 0.9) for box in seen]
    rig.finder.find(BLANK, 0, camera)
    rig.detector.found = [(near, 0.9), ((x, y, w, h / 2), 0.7)]
    found = [rig.finder.find(BLANK, 12 * SECOND + step * SECOND // 10, camera) for step in range(5)]
    _, hidden = found[-1]
    return hidden.h > 1.1 * h / 2


def test_stated_pose_is_trusted_until_people_contradict_it():
    estimated = msgspec.structs.replace(CAMERA.pose, height_std_m=0.05, pitch_std_rad=0.01, source="people")
    wrong = msgspec.structs.replace(CAMERA.pose, height_m=1.2)
    whole = [box_of(CAMERA, 4.0, bearing) for bearing in (-0.3, 0.0, 0.3)]
    assert extended(CAMERA.pose)
    assert extended(msgspec.structs.replace(CAMERA.pose, source="tf"))
    assert not extended(estimated)
    assert extended(CAMERA.pose, *whole)
    assert extended(wrong, *whole[:2])
    assert not extended(wrong, *whole)


def test_person_who_is_not_occluded_keeps_their_height():
    rig = Rig()
    x, y, w, h = box_of(CAMERA, 5.0, 0.0)
    child = (x, y, 0.6 * w, h / 2)
    for other in (box_of(CAMERA, 1.5, -0.5), (x, y, w, h * 0.4)):
        heights = {person.h for _ in range(5) for person in rig.find((other, 0.9), (child, 0.7))}
        assert h / 2 in heights


@pytest.mark.parametrize(("mount_height_m", "pitch_rad"), [(0.8, 0.0), (3.0, 0.3), (1.62, -0.1)])
def test_boxes_are_the_detector_s_with_a_wrong_camera_pose(mount_height_m, pitch_rad):
    rig = Rig()
    wrong = CameraModel(525, 525, 320, 240, 640, 480, CameraPose(height_m=mount_height_m, pitch_rad=pitch_rad))
    whole, (x, y, w, h) = box_of(CAMERA, 4.0, 0.4), box_of(CAMERA, 5.0, 0.0)
    near, short = box_of(CAMERA, 1.5, -0.05), (x, y, w, 0.45 * h)
    found = ()
    for step in range(30):
        rig.detector.found = [(whole, 0.8), (near, 0.9), (short, 0.7)]
        found = rig.finder.find(BLANK, step * SECOND // 10, wrong)
    assert {(person.x, person.y, person.w, person.h) for person in found} == {whole, near, short}


@pytest.mark.parametrize("distance", [3.5, 5.0, 8.0])
def test_person_behind_a_trolley_is_extended_to_the_floor(distance):
    rig = Rig()
    rig.show_whole_people()
    x, y, w, h = box_of(CAMERA, distance, 0.0)
    (pushing,) = rig.repeat(5, ((x, y, w, 0.45 * h), 0.7))
    assert (pushing.x, pushing.y, pushing.w) == (pytest.approx(x, abs=3), y, pytest.approx(w, abs=6))
    assert pushing.h == pytest.approx(h, rel=0.2)
    assert metres(pushing)[0] == pytest.approx(distance, rel=0.2)


def test_person_beside_their_trolley_keeps_their_height():
    rig = Rig()
    x, y, w, h = box_of(CAMERA, 5.0, 0.0)
    rig.repeat(5, ((x, y, w, 0.45 * h), 0.7))
    (whole,) = rig.repeat(5, ((x, y, w, h), 0.7))
    assert (whole.y, whole.h) == (y, h)


def test_boxes_are_unchanged_without_a_tracker():
    rig = Rig(tracker="none")
    for box in ((300.0, 200.0, 20.0, 180.0), (300.0, 200.0, 90.0, 100.0)):
        (person,) = rig.find((box, 0.7))
        assert (person.x, person.y, person.w, person.h) == box


def test_box_does_not_reach_beyond_the_image():
    rig = Rig()
    rig.show_whole_people()
    found = (box_of(CAMERA, 1.5, -0.05), 0.9), ((300.0, 150.0, 160.0, 200.0), 0.7)
    near, hidden = rig.repeat(5, *found)
    assert near.y + near.h == pytest.approx(CAMERA.height)
    assert hidden.y + hidden.h == pytest.approx(CAMERA.height)


class Looking:
    """Finds the same face of everybody in every third image."""

    def __init__(self, height: float) -> None:
        self.height, self.count = height, 0

    def look(self, image, stamp, tracks, known):
        self.count += 1
        for attention in known.values():
            attention.face = Face((300.0, 20.0, self.height, self.height), 0.9, 0.0) if self.count % 3 == 0 else None


def test_face_gives_the_distance_of_a_person_whose_feet_are_below_the_image(monkeypatch):
    def distances(height: float) -> list[float]:
        rig = Rig()
        if height:
            monkeypatch.setattr(rig.finder, "_faces", Looking(height))
        x, y, w, _ = box_of(CAMERA, 1.6, 0.0)
        return [metres(rig.find(((x, y, w, 480 - y), 0.9))[0])[0] for _ in range(20)]

    alone, near = distances(0.0)[-1], distances(FACE_HEIGHT_M * CAMERA.fy / 1.2)[5:]
    assert max(near) < 0.9 * alone
    assert max(near) < 1.1 * min(near), "also in images without a search"


def test_face_counts_for_a_moment_after_its_image():
    state = TrackState(Figure(Stature.of_people()), None, 0)
    state.attention.face = Face((300.0, 20.0, 40.0, 40.0), 0.9, 0.0)
    assert state.face_height(10 * SECOND) == 40.0
    state.attention.face = None
    heights = [state.face_height(10 * SECOND + tenths * SECOND // 10) for tenths in (1, 4, 5, -1)]
    assert heights == [40.0, 40.0, 0.0, 0.0]
