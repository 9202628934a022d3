from __future__ import annotations

import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import PersonDetection
from socialbot.vision.camera import CameraModel
from socialbot.vision.detector import Detections
from socialbot.vision.detectors import DETECTORS, DetectorSpec
from socialbot.vision.distance import Stature, head_direction, measure
from socialbot.vision.pipeline import PersonPipeline, make_pipeline
from socialbot.vision.tracking import cut_off
from tests.vision.test_distance import box_of

CAMERA = CameraModel(525, 525, 320, 240, 640, 480, 1.62, 0.052)
BLANK = np.zeros((480, 640, 3), np.uint8)
SPEC = DetectorSpec("told", 0.5, 0.2, lambda settings: Told())

Found = list[tuple[tuple[float, float, float, float], float]]


class Told:
    """A detector that finds what it was told, and notes what it was asked for."""

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
    """A finder on such a detector, ten pictures a second, all of them black: nothing in them moves."""

    def __init__(self, *, hide_still: bool = False, **how) -> None:
        self.detector = Told()
        self.finder = make_pipeline(SPEC, self.detector, hide_still=hide_still, **how)
        self.stamp = 0

    def find(self, *found, after_s: float = 0.1) -> tuple[PersonDetection, ...]:
        self.stamp += round(after_s * SECOND)
        self.detector.found = list(found)
        return self.finder.find(BLANK, self.stamp, CAMERA)


def at(distance: float, score: float = 0.7, bearing: float = 0.0, **how: float):
    """What a detector finds of somebody who stands ``distance`` m away."""
    return box_of(CAMERA, distance, bearing, **how), score


def metres(person: PersonDetection) -> tuple[float, float]:
    """Distance and standard error."""
    assert person.distance_m is not None
    assert person.distance_std_m is not None
    return person.distance_m, person.distance_std_m


def test_without_a_tracker_each_picture_stands_alone():
    rig = Rig(tracker="none")
    assert rig.detector.threshold == 0.5
    found = at(4.0)
    for _ in range(2):
        (person,) = rig.find(found, at(8.0, 0.4))
        x, y, w, h = found[0]
        distance = measure(CAMERA, found[0], Stature.of_people(1.70, 0.5))
        assert distance is not None
        bearing, elevation = head_direction(
            CAMERA, found[0], cut_off(np.array(found[0]), 640, 480), distance.value, 1.70
        )
        assert person == PersonDetection(
            x=x, y=y, w=w, h=h, score=0.7, distance_m=distance.value, distance_std_m=distance.std,
            bearing_rad=bearing, elevation_rad=elevation,
        )  # fmt: skip
    assert rig.find() == ()


def test_with_a_tracker_weak_boxes_are_asked_for_and_used_on_known_tracks_only():
    rig = Rig()
    assert rig.detector.threshold == 0.2
    assert rig.find(at(4.0, 0.3)) == ()
    rig.find(at(4.0))
    (before,) = rig.find(at(4.0))
    (after,) = rig.find(at(4.0, 0.3), at(8.0, 0.3, -0.3))
    assert before.track_id == after.track_id != ""
    assert after.score == 0.3


def test_who_is_not_seen_for_a_moment_is_said_to_be_unseen_and_less_sure():
    rig = Rig()
    before = [rig.find(at(4.0)) for _ in range(8)][-1][0]
    (bridged,) = rig.find()
    assert bridged.track_id == before.track_id
    assert (before.unseen_s, bridged.unseen_s) == (0.0, pytest.approx(0.1))
    assert metres(bridged)[0] == pytest.approx(metres(before)[0], rel=0.02)
    assert metres(bridged)[1] > metres(before)[1]


def test_bridges_are_as_long_as_asked_for():
    rig = Rig(bridge_s=0.0)
    for _ in range(8):
        rig.find(at(4.0))
    assert rig.find() == ()


def test_what_was_learnt_of_somebody_helps_when_they_come_near():
    rig, alone = Rig(), Rig(tracker="none")
    walk = [at(distance, tall=1.85, wide=0.68) for distance in np.arange(8.0, 1.35, -0.1)]
    followed, single = ([finder.find(seen) for seen in walk][-1][0] for finder in (rig, alone))
    assert metres(single)[0] < 1.25
    assert metres(followed)[0] == pytest.approx(1.4, abs=0.12)
    assert metres(followed)[1] < metres(single)[1]


def test_who_walks_out_at_the_side_does_not_seem_to_go_away():
    rig = Rig()
    for _ in range(10):
        rig.find(at(1.5))
    found = [rig.find(at(1.5, 0.7, bearing)) for bearing in np.arange(0.0, 0.6, 0.03)]
    cut = [metres(people[0])[0] for people in found if people and people[0].x < 1]
    assert len(cut) > 4
    assert max(cut) < 1.8


def test_who_comes_in_at_the_side_is_no_farther_than_they_are_wide():
    rig = Rig()
    found = [rig.find(at(1.5, 0.9, bearing)) for bearing in np.arange(0.6, 0.3, -0.05)]
    assert any(found)
    assert all(metres(people[0])[0] < 4.0 for people in found if people)


def test_a_recording_that_begins_anew_knows_nobody():
    rig = Rig()
    for distance in np.arange(8.0, 1.4, -0.1):
        rig.find(at(distance, tall=1.85, wide=0.68))
    (again,) = rig.find(at(1.5, tall=1.85, wide=0.68), after_s=-3.0)
    fresh = Rig()
    (first,) = fresh.find(at(1.5, tall=1.85, wide=0.68))
    assert again.distance_m == first.distance_m
    assert again.track_id != first.track_id == "t1"


def test_somebody_cut_off_is_as_wide_as_the_detector_s_boxes():
    rig = Rig(tracker="none")
    near = at(1.4)
    (narrow,) = rig.find(near)
    rig.detector.box_width_m = 0.68
    (wide,) = rig.find(near)
    assert metres(wide)[0] > 1.2 * metres(narrow)[0]


def test_people_may_be_taken_to_be_taller():
    rig = Rig(tracker="none")
    (before,) = rig.find(at(5.0))
    rig.finder.person_height_m = 1.9
    (after,) = rig.find(at(5.0))
    assert metres(after)[0] > metres(before)[0]


def test_the_detector_learns_where_the_horizon_is():
    rig = Rig()
    rig.find()
    assert rig.detector.horizon == pytest.approx(CAMERA.horizon)
    rig.finder.find(BLANK, 10**10, CameraModel(525, 525, 320, 240, 640, 480, 1.62, 1.0))
    assert rig.detector.horizon == 0.0


def test_the_detector_learns_how_high_the_camera_is_above_the_floor():
    rig = Rig(person_height_m=1.8)
    rig.find()
    assert rig.detector.camera_height == pytest.approx(CAMERA.mount_height_m / 1.8)


def test_in_single_pictures_people_may_stand_anywhere():
    rig = Rig(tracker="none")
    rig.find()
    assert rig.detector.camera_height is None


@pytest.mark.parametrize(("sure", "weak", "asked"), [(0.6, 0.3, 0.3), (0.1, 0.3, 0.1)])
def test_what_is_believed_may_change(sure, weak, asked):
    rig = Rig()
    rig.finder.set_thresholds(sure, weak)
    assert rig.detector.threshold == asked
    assert rig.finder.tracker is not None
    assert (rig.finder.tracker.sure, rig.finder.tracker.weak) == (sure, min(sure, weak))
    rig.find(at(4.0, sure))
    assert len(rig.find(at(4.0, sure))) == 1


def test_a_threshold_takes_the_place_of_the_detector_s_own():
    rig = Rig(threshold=0.8)
    rig.find()
    assert [rig.find(at(4.0, 0.79)) for _ in range(3)] == [(), (), ()]
    assert len([rig.find(at(4.0, 0.8)) for _ in range(2)][-1]) == 1


def test_who_is_certain_is_there_at_once():
    rig = Rig()
    rig.find()
    assert rig.find(at(4.0, 0.79)) == ()
    assert len(rig.find(at(8.0, 0.8, 0.3))) == 1


def test_what_is_remembered_of_people_does_not_pile_up():
    rig = Rig(tracker="kalman")
    for number in range(200):
        rig.find(at(4.0, 0.9, 0.3 * (-1) ** number), after_s=3.0)
    assert len(rig.finder._known) < 10


def test_every_detector_has_a_weak_score_below_its_sure_one():
    for name, spec in DETECTORS.items():
        assert spec.name == name
        assert spec.weak < spec.sure


def test_the_same_pictures_give_the_same_people():
    def play() -> list[tuple[PersonDetection, ...]]:
        rig, random = Rig(), np.random.default_rng(5)
        return [
            rig.find(*(at(random.uniform(1, 9), random.uniform(0.2, 0.9), random.uniform(-0.4, 0.4)) for _ in range(3)))
            for _ in range(40)
        ]

    assert play() == play()


def test_a_finder_can_be_made_of_any_detector():
    finder = PersonPipeline(Told(), sure=0.5, weak=0.2)
    assert finder.find(BLANK, 1, CAMERA) == ()


def test_what_never_moves_is_left_out_if_asked_for():
    rig = Rig(hide_still=True)
    seen = [len(rig.find(at(4.0))) for _ in range(10)]
    assert seen[:2] == [1, 1]
    assert seen[5:] == [0] * 5
    assert len(rig.find(at(4.0), at(8.0, bearing=0.3), after_s=0.5)) == 0
    alone = Rig(hide_still=True, tracker="none")
    assert [len(alone.find(at(4.0))) for _ in range(10)] == [1] * 10, "single pictures do not move"


def test_who_stands_behind_somebody_reaches_down_to_the_floor():
    rig = Rig()
    x, y, w, h = box_of(CAMERA, 5.0, 0.0)
    near = box_of(CAMERA, 1.5, -0.05)
    _, hidden = [rig.find((near, 0.9), ((x, y, w, h / 2), 0.7)) for _ in range(5)][-1]
    assert (hidden.y, hidden.x, hidden.w) == (y, pytest.approx(x, abs=2), pytest.approx(w, abs=4))
    assert hidden.h == pytest.approx(h, rel=0.15)


def test_who_stands_beside_somebody_or_before_them_is_as_high_as_was_seen():
    rig = Rig()
    x, y, w, h = box_of(CAMERA, 5.0, 0.0)
    child = (x, y, 0.6 * w, h / 2)
    for other in (box_of(CAMERA, 1.5, -0.5), (x, y, w, h * 0.4)):
        heights = {person.h for _ in range(5) for person in rig.find((other, 0.9), (child, 0.7))}
        assert h / 2 in heights


def test_of_who_stands_half_behind_somebody_a_side_may_be_hidden_too():
    rig = Rig()
    x, y, w, h = box_of(CAMERA, 5.0, 0.0)
    near = box_of(CAMERA, 1.5, -0.05)
    _, hidden = [rig.find((near, 0.9), ((x, y, w / 2, h / 2), 0.7)) for _ in range(5)][-1]
    assert hidden.w == pytest.approx(0.3 * hidden.h)
    assert hidden.x + hidden.w / 2 == pytest.approx(x + w / 4), "nobody knows which side it is"


def test_who_comes_out_from_behind_a_door_frame_is_as_wide_as_people_are():
    rig = Rig()
    x, y, w, h = box_of(CAMERA, 5.0, 0.0)
    (half,) = [rig.find(((x, y, w / 2, h), 0.7)) for _ in range(5)][-1]
    assert half.w == pytest.approx(0.3 * h)
    assert half.x + half.w / 2 == pytest.approx(x + w / 4)
    assert (half.y, half.h) == (y, h)
    (whole,) = [rig.find(((x, y, w, h), 0.7)) for _ in range(5)][-1]
    assert (whole.x, whole.w) == (pytest.approx(x, abs=2), pytest.approx(w, abs=2))


def test_who_comes_into_the_picture_at_its_side_is_as_wide_as_can_be_seen():
    rig = Rig()
    for x in (0.0, CAMERA.width - 20.0):
        (slim,) = [rig.find(((x, 200.0, 20.0, 180.0), 0.7)) for _ in range(5)][-1]
        assert (slim.x, slim.w) == (x, 20.0)


@pytest.mark.parametrize("distance", [3.5, 5.0, 8.0])
def test_who_pushes_something_reaches_down_to_the_floor_and_is_where_they_are(distance):
    rig = Rig()
    x, y, w, h = box_of(CAMERA, distance, 0.0)
    (pushing,) = [rig.find(((x, y, w, 0.45 * h), 0.7)) for _ in range(5)][-1]
    assert (pushing.x, pushing.y, pushing.w) == (pytest.approx(x, abs=3), y, pytest.approx(w, abs=6))
    assert pushing.h == pytest.approx(h, rel=0.15)
    assert metres(pushing)[0] == pytest.approx(distance, rel=0.15)


def test_who_leaves_what_they_pushed_is_as_high_as_was_seen_again():
    rig = Rig()
    x, y, w, h = box_of(CAMERA, 5.0, 0.0)
    for _ in range(5):
        rig.find(((x, y, w, 0.45 * h), 0.7))
    (whole,) = [rig.find(((x, y, w, h), 0.7)) for _ in range(5)][-1]
    assert (whole.y, whole.h) == (y, h)


def test_without_a_tracker_boxes_are_what_was_seen():
    rig = Rig(tracker="none")
    for box in ((300.0, 200.0, 20.0, 180.0), (300.0, 200.0, 90.0, 100.0)):
        (person,) = rig.find((box, 0.7))
        assert (person.x, person.y, person.w, person.h) == box


@pytest.mark.parametrize("x", [5.0, CAMERA.width - 25.0])
def test_a_box_that_is_made_wider_stays_in_the_picture(x):
    rig = Rig()
    near = (min(x, CAMERA.width - 205.0), 80.0, 200.0, 400.0)
    _, hidden = [rig.find((near, 0.9), ((x, 200.0, 20.0, 100.0), 0.7)) for _ in range(5)][-1]
    assert hidden.w > 21
    assert hidden.x >= 0
    assert hidden.x + hidden.w <= CAMERA.width


def test_a_box_does_not_reach_beyond_the_picture():
    rig = Rig()
    found = (box_of(CAMERA, 1.5, -0.05), 0.9), ((300.0, 150.0, 160.0, 200.0), 0.7)
    near, hidden = [rig.find(*found) for _ in range(5)][-1]
    assert near.y + near.h == pytest.approx(CAMERA.height)
    assert hidden.y + hidden.h == pytest.approx(CAMERA.height)
