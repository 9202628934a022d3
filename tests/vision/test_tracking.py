from __future__ import annotations

import cProfile
import pstats

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.vision.detector import clip, iou
from tests.vision.scenes import SIZE, Scene, ids

STANDING = (300.0, 100.0, 80.0, 200.0)


def started(**settings: float) -> Scene:
    """A scene in which some time has passed without people: nothing is believed at once any more."""
    scene = Scene(**settings)
    scene.repeat(3)
    return scene


# Beginning


def test_second_detection_confirms_a_track():
    scene = started()
    (track,) = scene.show(STANDING)
    assert (track.id, track.score, track.unseen_s) == ("", 0.7, 0.0)
    (track,) = scene.show(STANDING)
    assert (track.id, track.score, track.unseen_s) == ("t1", 0.7, 0.0)
    assert track.box.tolist() == list(STANDING)


def test_arm_of_a_near_person_is_no_track():
    near, arm = (200.0, 100.0, 220.0, 380.0, 0.9), (195.0, 205.0, 60.0, 275.0)
    scene = started()
    assert [len(scene.show(near, arm)) for _ in range(4)][-1] == 1
    far = (200.0, 205.0, 60.0, 200.0)
    assert len(scene.show(near, far)) == 2, "whose feet are not below the picture may be far"
    beside = started()
    assert [len(beside.show(near, (160.0, 205.0, 60.0, 275.0))) for _ in range(4)][-1] == 2


def test_single_false_positive_gets_no_id():
    scene = started()
    shown = [scene.show(STANDING), *(scene.show() for _ in range(10)), scene.show(STANDING)]
    assert [[track.id for track in tracks] for tracks in shown] == [[""], *[[]] * 10, [""]]


def test_new_track_may_miss_a_frame():
    scene = started()
    assert [ids(scene.show(*found)) for found in ([STANDING], [], [STANDING])] == [[], [], ["t1"]]


def test_certain_detection_is_a_track_at_once():
    assert ids(started().show((*STANDING, 0.9))) == ["t1"]


def test_first_image_and_image_after_a_gap_give_tracks_at_once():
    scene = Scene()
    assert ids(scene.show(STANDING)) == ["t1"]
    assert ids(scene.show((100, 100, 80, 200), after_s=30.0)) == ["t2"]


def test_sparse_images_give_tracks_at_once():
    scene = Scene()
    for number in range(5):
        assert len(scene.show((50.0 + 100 * number, 100, 80, 200), after_s=1.0)) >= 1


def test_weak_boxes_start_no_track():
    scene = Scene()
    assert {scene.show((*STANDING, 0.4)) for _ in range(20)} == {()}


def test_one_of_the_first_two_boxes_may_be_weak():
    for scores, shown in [
        ((0.4, 0.6), [0, 1]),
        ((0.6, 0.4), [0, 1]),
        ((0.55, 0.4, 0.6), [0, 1, 1]),
        ((0.74, 0.6), [0, 1]),
        ((0.4, 0.4, 0.4), [0, 0, 0]),
    ]:
        scene = started()
        assert [len(ids(scene.show((*STANDING, score)))) for score in scores] == shown


def test_weak_start_becomes_a_usual_track():
    scene = started()
    shown = [len(scene.show((*STANDING, score))) for score in (0.2, 0.2, 0.2, 0.9, 0.9, 0.3, 0.3)]
    assert shown == [0, 0, 0, 1, 1, 1, 1]


def test_surrounding_weak_box_does_not_block_a_track():
    around = (*STANDING[:3], 300.0, 0.4)
    assert ids(started().show(around, (*STANDING, 0.9))) == ["t1"]


def test_threshold_may_change():
    scene = started()
    scene.tracker.sure = 0.8
    assert [scene.show(STANDING) for _ in range(3)] == [(), (), ()]
    scene.tracker.sure = 0.6
    assert ids(scene.show(STANDING)) == ["t1"]


# Going on


def test_weak_boxes_keep_a_track_that_is_usually_sure():
    scene = Scene()
    scene.show((*STANDING, 0.9))
    for number in range(1, 30):
        score = 0.3 if number % 4 == 0 else 0.9
        (track,) = scene.show((*STANDING, score))
        assert (track.id, track.unseen_s, track.score) == ("t1", 0.0, score)


def test_weak_boxes_of_a_barely_detected_track_are_not_published():
    scene = Scene(clear=0.75)
    scores = (0.55, 0.6, 0.45, 0.55, 0.4, 0.6)
    assert [len(scene.show((*STANDING, score))) for score in scores] == [1, 1, 0, 1, 0, 1]
    assert ids(scene.show(STANDING)) == ["t1"]


def test_weak_boxes_are_published_where_a_person_was_expected():
    scene = Scene()
    scene.repeat(5, STANDING)
    assert ids(scene.show((305.0, 103.0, 80.0, 195.0, 0.3))) == ["t1"]
    assert scene.show((305.0, 103.0, 80.0, 120.0, 0.3)) == ()
    assert ids(scene.show(STANDING)) == ["t1"]


def test_weak_track_is_not_published_for_long():
    scene = Scene()
    scene.repeat(2, (*STANDING, 0.95))
    assert [len(scene.show((*STANDING, 0.3))) for _ in range(8)] == [1] * 5 + [0] * 3
    assert ids(scene.show(STANDING)) == ["t1"]


def test_boxes_below_weak_are_ignored():
    scene = Scene()
    scene.repeat(5, STANDING)
    (track,) = scene.show((*STANDING, 0.1))
    assert track.unseen_s > 0


def test_distant_weak_box_is_ignored():
    scene = Scene()
    scene.show(STANDING)
    assert [track.box[0] for track in scene.show(STANDING, (400, 100, 80, 200, 0.4))] == [300]


def test_sure_box_has_priority_over_a_weak_one():
    scene = Scene()
    scene.repeat(5, STANDING)
    (track,) = scene.show((304, 100, 80, 200, 0.7), (301, 100, 80, 200, 0.3))
    assert track.box[0] == 304


def test_standing_person_keeps_their_id():
    scene, random = Scene(), np.random.default_rng(1)
    scene.repeat(600, tuple(np.array(STANDING) + random.normal(0, 4, 4)))
    assert ids(scene.show(STANDING)) == ["t1"]


@pytest.mark.parametrize("period_s", [0.033, 0.1, 0.2, 0.3, 0.45])
def test_walk_across_the_image_is_one_track_at_any_rate(period_s):
    scene, seen = Scene(), set()
    for step in range(int(4.0 / period_s)):
        # 130 pixels a second at 180 pixels height: 1.2 m/s.
        seen |= set(ids(scene.show((40 + 130 * step * period_s, 120, 70, 180), after_s=period_s)))
    assert seen == {"t1"}


def test_irregular_frames_keep_ids():
    scene, random, seen, now = Scene(), np.random.default_rng(2), set(), 0.0
    while now < 4.0:
        step = random.uniform(0.01, 0.4)
        now += step
        seen |= set(ids(scene.show((40 + 130 * now, 120, 70, 180), after_s=step)))
    assert seen == {"t1"}


def test_two_images_of_one_moment_are_no_error():
    scene = Scene()
    scene.show(STANDING)
    assert ids(scene.show(STANDING, after_s=0.0)) == ["t1"]


def test_approaching_person_keeps_their_id():
    scene, seen = Scene(), set()
    for distance in np.arange(8.0, 0.6, -0.13):
        height, width = 525 * 1.75 / distance, 525 * 0.55 / distance
        whole = np.array([[320 - width / 2, 235 - 525 * 0.1 / distance, width, height]])
        seen |= set(ids(scene.show(tuple(clip(whole, *SIZE)[0]))))
    assert seen == {"t1"}


# Absence


def test_flicker_is_bridged_with_a_prediction():
    scene = Scene()
    for step in range(10):
        scene.show((100.0 + 10 * step, 100, 80, 200))
    (track,) = scene.show()
    assert (track.id, track.score, track.unseen_s) == ("t1", 0.7, pytest.approx(0.1))
    assert track.box == pytest.approx([200, 100, 80, 200], abs=5)
    assert ids(scene.show((210, 100, 80, 200))) == ["t1"]


def test_bridge_is_no_longer_than_wanted():
    scene = Scene(bridge_s=0.35)
    scene.repeat(10, STANDING)
    assert [len(scene.show()) for _ in range(5)] == [1, 1, 1, 0, 0]


def test_no_predictions_without_a_bridge():
    scene = Scene(bridge_s=0.0)
    scene.repeat(10, STANDING)
    assert scene.show() == ()
    assert ids(scene.show(STANDING)) == ["t1"]


def test_returning_person_keeps_their_id_for_a_while():
    for absent, expected in ((15, "t1"), (30, "t2")):
        scene = Scene()
        for _ in range(10):
            scene.show(STANDING)
        scene.repeat(absent)
        scene.show(STANDING)
        assert ids(scene.show(STANDING)) == [expected]


def test_leaving_person_is_not_predicted():
    scene = Scene()
    for x in range(300, -80, -20):
        scene.show(tuple(clip(np.array([[float(x), 100, 80, 200]]), *SIZE)[0]))
    assert scene.show() == ()


def test_person_at_the_edge_is_predicted():
    scene = Scene()
    scene.repeat(10, (0, 100, 50, 200))
    assert len(scene.show()) == 1


def test_weak_track_is_not_predicted():
    for last, shown in [(0.7, 1), (0.3, 0)]:
        scene = Scene()
        for score in (*[0.8] * 10, last):
            assert len(scene.show((*STANDING, score))) == 1
        assert len(scene.show()) == shown


def test_track_within_another_box_is_not_predicted():
    scene = Scene()
    near, far = (260.0, 60.0, 200.0, 400.0), (300.0, 150.0, 50.0, 130.0)
    shown = [len(scene.show(near, far)) for _ in range(10)]
    assert shown[-1] == 2
    assert [track.box.tolist() for track in scene.show(near)] == [list(near)]


@pytest.mark.parametrize(
    ("bridge_s", "score", "shown"),
    [(0.15, 0.8, [2, 2, 1, 1]), (0.15, 0.7, [1, 1, 1, 1]), (0.35, 0.8, [2, 2, 2, 1]), (0.0, 0.8, [1, 1, 1, 1])],
)
def test_person_who_steps_behind_a_nearer_one_is_predicted(bridge_s, score, shown):
    scene = Scene(bridge_s=bridge_s)
    near, far = (260.0, 60.0, 200.0, 400.0), (300.0, 150.0, 50.0, 130.0)
    first = scene.repeat(10, near, (*far, score))
    seen = [scene.show(near) for _ in shown]
    assert [len(tracks) for tracks in seen] == shown
    assert {track.id for tracks in seen for track in tracks} <= {track.id for track in first}
    assert {track.id for track in scene.show(near, (*far, score))} == {track.id for track in first}


def test_person_before_whom_nobody_steps_is_predicted_no_longer():
    scene = Scene(bridge_s=0.15)
    far_away = (20.0, 60.0, 200.0, 400.0)
    scene.repeat(10, far_away, (*STANDING, 0.8))
    assert [len(scene.show(far_away)) for _ in range(3)] == [2, 1, 1]


def test_predictions_stay_in_the_image():
    scene = Scene(bridge_s=2.0, keep_s=3.0)
    for step in range(10):
        scene.show((300.0, 100, 80 + 4 * step, min(200 + 20 * step, 380)))
    shown = [track for _ in range(15) for track in scene.show()]
    assert shown
    for track in shown:
        assert track.box == pytest.approx(clip(track.box[None], *SIZE)[0])


def test_track_with_few_detections_is_not_predicted():
    scene = Scene()
    scene.show(STANDING)
    scene.show(STANDING)
    assert scene.show() == ()


def test_clock_set_back_starts_new_ids():
    scene = Scene()
    scene.repeat(5, STANDING)
    assert ids(scene.show(STANDING, after_s=-0.3)) == ["t2"]


# Several


def walkers(*people: tuple[float, float, float, float], seconds: float = 4.0, period_s: float = 0.1):
    """Boxes of people (x at the begin, pixels a second, top, height) at each moment: lists of (n, 4)."""
    for now in np.arange(0, seconds, period_s):
        yield np.array([(x + speed * now, top, 0.4 * height, height) for x, speed, top, height in people])


def followed(frames, seen, *, noise: float, seed: int) -> list[dict[int, str]]:
    """Return the nearest track of each true person per frame; boxes are noisy, and exist where ``seen`` is true."""
    scene, random, result = Scene(), np.random.default_rng(seed), []
    for number, boxes in enumerate(frames):
        visible = [index for index in range(len(boxes)) if seen(number, index, boxes)]
        noisy = boxes + random.normal(0, noise, boxes.shape) * boxes[:, 3:]
        tracks = [track for track in scene.show(*map(tuple, noisy[visible])) if not track.unseen_s]
        result.append(
            {
                index: tracks[int(np.argmax(iou(boxes[index], np.array([track.box for track in tracks]))))].id
                for index in visible
                if tracks
            }
        )
    return result


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10**6), st.floats(100, 160), st.floats(100, 160), st.floats(0.7, 0.95), st.floats(0, 0.15))
def test_crossing_people_keep_their_ids(seed, right, left, share, missed):
    """The farther is hidden behind the nearer while they overlap by half; both are missed now and then."""
    random = np.random.default_rng(seed)

    def seen(number: int, index: int, boxes: np.ndarray) -> bool:
        hidden = index == 1 and iou(boxes[0], boxes[1:2])[0] > 0.35
        return not hidden and (number < 4 or random.random() >= missed)

    frames = list(walkers((60, right, 100, 220), (520, -left, 100, 220 * share), seconds=3.0))
    who = followed(frames, seen, noise=0.01, seed=seed)
    begin = {index: next(frame[index] for frame in who[2:] if index in frame) for index in (0, 1)}
    end = {index: next(frame[index] for frame in reversed(who) if index in frame) for index in (0, 1)}
    assert begin == end
    assert begin[0] != begin[1]


@pytest.mark.parametrize("seed", range(10))
def test_overtaken_person_keeps_their_id(seed):
    def seen(number: int, index: int, boxes: np.ndarray) -> bool:
        return index == 0 or iou(boxes[0], boxes[1:2])[0] < 0.35

    frames = list(walkers((40, 140, 90, 230), (140, 70, 100, 200)))
    who = followed(frames, seen, noise=0.01, seed=seed)
    assert who[3] == who[-1]
    assert len(set(who[-1].values())) == 2


def test_person_occluded_for_a_second_keeps_their_id():
    scene = Scene()
    for x in np.arange(0, 640, 20.0):
        hidden = abs(x - 300) < 90
        found = [(x, 60.0, 120.0, 330.0), *([] if hidden else [STANDING])]
        tracks = scene.show(*found)
        if len(found) == 2 and x > 40:
            assert next(track.id for track in tracks if track.box[0] == STANDING[0]) == "t2"


def test_two_boxes_on_one_person_are_not_both_predicted():
    scene = Scene()
    scene.repeat(10, STANDING, (305, 110, 80, 190))
    assert len(scene.show(STANDING)) == 1


def test_upper_half_of_a_person_is_no_track():
    scene = Scene()
    for _ in range(20):
        assert len(scene.show((*STANDING, 0.7), (302, 102, 76, 90, 0.95))) == 1


def test_second_box_on_a_person_gets_no_id():
    scene, seen = Scene(), set()
    scene.repeat(5, STANDING)
    second = (325.0, 104.0, 78.0, 190.0)
    for _ in range(10):
        for found in [(STANDING, second)] * 3 + [(second,)] * 4 + [(STANDING, (*second, 0.3)), (STANDING,)]:
            seen |= set(ids(scene.show(*found)))
    assert seen == {"t1"}


def test_person_close_to_another_is_a_track_after_several_detections():
    scene = Scene()
    scene.repeat(5, STANDING)
    shown = [len(scene.show(STANDING, (330.0, 104.0, 78.0, 190.0))) for _ in range(8)]
    assert shown == sorted(shown)
    assert (shown[2], shown[-1]) == (1, 2)


def test_person_close_to_another_is_a_track_from_a_high_score():
    scene, close = Scene(), (330.0, 104.0, 78.0, 190.0)
    scene.repeat(5, STANDING)
    assert ids(scene.show(STANDING, (*close, 0.55))) == ["t1"]
    assert sorted(ids(scene.show(STANDING, (*close, 0.8)))) == ["t1", "t2"]


def test_near_person_in_front_does_not_take_over_a_track():
    scene, far, near = Scene(), (300.0, 140.0, 80.0, 230.0), (290.0, 10.0, 120.0, 470.0)
    scene.repeat(10, far)
    for _ in range(4):
        assert [track.id for track in scene.show(near) if track.id and track.box[1] < 100] in ([], ["t2"])
    assert sorted(ids(scene.show(far, near))) == ["t1", "t2"]


def test_child_before_a_person_is_a_track():
    scene = Scene()
    shown = [len(ids(scene.show((*STANDING, 0.8), (320, 200, 40, 100, 0.7)))) for _ in range(5)]
    assert shown == [1, 2, 2, 2, 2]


def test_distant_person_behind_a_near_one_is_a_track():
    scene = Scene()
    near, far = (300.0, 100.0, 200.0, 380.0), (310.0, 120.0, 40.0, 120.0)
    assert [len(ids(scene.show(near, far))) for _ in range(4)] == [1, 2, 2, 2]


def test_weak_part_of_a_person_continues_no_other_track():
    scene = Scene()
    for x in range(120, 300, 10):  # Somebody walks behind the one who stands there.
        scene.show(STANDING, (float(x), 100, 60, 150))
    shown = [scene.show(STANDING, (302, 102, 60, 150, 0.3)) for _ in range(10)]
    assert [len(tracks) for tracks in shown[-5:]] == [1] * 5


def test_feet_behind_something_are_noticed():
    scene = Scene()
    scene.repeat(10, STANDING)
    (track,) = scene.show((300, 100, 80, 120))
    assert track.feet_hidden
    (track,) = scene.show(STANDING)
    assert not track.feet_hidden


def test_sitting_down_does_not_hide_the_feet():
    scene = Scene()
    scene.repeat(10, STANDING)
    (track,) = scene.show((300, 170, 80, 130))
    assert not track.feet_hidden


def test_update_with_ten_people_takes_few_calls():
    scene, random = Scene(), np.random.default_rng(3)
    people = np.stack([np.linspace(20, 560, 10), np.full(10, 100), np.full(10, 50), np.full(10, 130)], axis=1)
    with cProfile.Profile() as profile:
        for _ in range(60):
            assert len(scene.show(*map(tuple, people + random.normal(0, 2, people.shape)))) == 10
    assert pstats.Stats(profile).total_calls / 60 < 1000  # type: ignore[attr-defined]


# Turning cameras


def _turned(scene: Scene, offset: float, *found: tuple[float, ...]) -> list[str]:
    """Show boxes after the background has moved by ``offset`` pixels."""
    scene.time_s += 0.1
    turn = np.array([[1.0, 0.0, offset], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    boxes = np.array(found, np.float64).reshape(-1, 4)
    stamp = round(scene.time_s * 1e9)
    return ids(scene.tracker.update(stamp, boxes, np.full(len(boxes), 0.7), SIZE, turn=turn))


@pytest.mark.parametrize(("aside", "expected"), [(0.0, "t1"), (150.0, "t2")])
def test_person_whom_a_turning_camera_left_and_finds_again_keeps_their_id(aside, expected):
    scene = Scene()
    scene.repeat(10, STANDING)
    for _ in range(35):
        _turned(scene, -25.0)
    for _ in range(34):
        _turned(scene, 25.0)
    there = (STANDING[0] - 25.0 + aside, *STANDING[1:])
    shown = [_turned(scene, 0.0, there) for _ in range(3)]
    assert shown[-1] == [expected]


def test_fast_turn_of_the_camera_keeps_tracks():
    scene = Scene()
    scene.repeat(5, STANDING)
    assert _turned(scene, 120.0, (STANDING[0] + 120.0, *STANDING[1:])) == ["t1"]
