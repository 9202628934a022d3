from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.vision._static_objects import StaticObjectFilter
from socialbot.vision.motion import Cut
from socialbot.vision.tracking import Track

WIDTH, HEIGHT = 640, 480
CERTAIN = 0.78
Box = tuple[float, float, float, float]
STAND: Box = (300.0, 120.0, 80.0, 240.0)


def patterned(seed: int, width: int, height: int) -> np.ndarray:
    """Something with shapes in it, grey levels as float."""
    coarse = np.random.default_rng(seed).uniform(40, 200, (height // 8 + 1, width // 8 + 1)).astype(np.float32)
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)


ROOM = patterned(1, WIDTH, HEIGHT)
NOISES = np.random.default_rng(0).normal(0, 1, (32, HEIGHT, WIDTH)).astype(np.float32)
COAT, PERSON = patterned(2, 80, 240), patterned(3, 80, 240)


def with_a_coat() -> np.ndarray:
    """Image of the corridor with a coat that may be missed."""
    room = ROOM.copy()
    x, y, w, h = (round(each) for each in STAND)
    room[y : y + h, x : x + w] = COAT
    return room


def high_up(x: int, rows: int) -> np.ndarray:
    """Somebody at ``x`` who takes up no more than the first ``rows`` of their box."""
    shape = with_a_coat()[120:360, x : x + 80].copy()
    shape[:rows] = PERSON[:rows]
    return shape


class Camera:
    """Takes a picture every tenth of a second; what stands in it is a track."""

    def __init__(self) -> None:
        self.filter = StaticObjectFilter(CERTAIN)
        self.count = 0
        self.gain = 1.0
        self.score = 0.6
        self.noise = 1.5
        self.keys: dict[str, int] = {}
        self.people: set[str] = set()
        self.room = ROOM

    def look(self, reported: Box | None = None, skipped: int = 0, **things: tuple[np.ndarray, Box]) -> set[str]:
        """Return which of ``things`` (appearance, box) count as people. The last one occludes the others.

        The detector's box is another one if ``reported``. So many pictures have been ``skipped`` before this one.
        """
        picture = self.room.copy()
        for shape, (x, y, w, h) in things.values():
            picture[round(y) : round(y + h), round(x) : round(x + w)] = shape[: round(h), : round(w)]
        noise = self.noise * NOISES[self.count % len(NOISES)]
        image = np.clip(self.gain * picture + noise, 0, 255).astype(np.uint8)
        self.count += 1 + skipped
        tracks = [
            Track(
                name, np.array(reported or box), self.score, 0.0, Cut(), key=self.keys.setdefault(name, len(self.keys))
            )
            for name, (_, box) in things.items()
        ]
        kept = self.filter.people(image, self.count * SECOND // 10, tracks, people=self.people)
        return {track.id for track in kept}

    def key(self, name: str) -> int:
        return self.keys.setdefault(name, len(self.keys))

    def repeat(self, count: int, **things: Any) -> set[str]:
        return [self.look(**things) for _ in range(count)][-1]


def at(x: float) -> Box:
    return x, 120.0, 80.0, 240.0


def test_static_object_is_removed():
    camera = Camera()
    seen = [camera.look(coat=(COAT, STAND)) for _ in range(30)]
    assert seen[:5] == [{"coat"}] * 5, "people may stand still for so long"
    assert seen[12:] == [set()] * 18


def test_walking_person_is_kept_from_the_first_image():
    camera = Camera()
    camera.repeat(10)
    assert all(camera.look(walker=(PERSON, at(20 + 10 * step))) == {"walker"} for step in range(40))


def test_person_who_stops_is_kept():
    camera = Camera()
    camera.repeat(25)
    for step in range(20):
        camera.look(walker=(PERSON, at(20 + 10 * step)))
    stands = [camera.look(walker=(PERSON, at(220)), skipped=4) for _ in range(70)]
    assert stands[:60] == [{"walker"}] * 60
    assert stands[64:] == [set()] * 6, "nobody stands like a stone for so long"


def test_object_that_people_hide_again_and_again_is_removed():
    camera = Camera()
    seen = [camera.look(coat=(COAT, STAND), walker=(PERSON, at(20 + 10 * step))) for step in range(10)]
    assert seen == [{"coat", "walker"}] * 10
    seen = []
    for _ in range(12):
        seen += [camera.look(coat=(COAT, STAND)) for _ in range(8)]
        camera.look(walker=(PERSON, at(310)))
        camera.look(coat=(COAT, STAND), walker=(PERSON, at(345)))
    assert seen[:8] == [{"coat"}] * 8
    assert seen[-48:] == [set()] * 48


def test_object_that_was_touched_is_removed_later():
    camera = Camera()
    camera.room = with_a_coat()
    for step in range(20):
        camera.look(walker=(PERSON, at(260 + 2 * step)))
    seen = [camera.look(walker=(COAT, STAND), skipped=9) for _ in range(40)]
    assert seen[:25] == [{"walker"}] * 25, "a person may stand still after a walk"
    assert seen[35:] == [set()] * 5


@pytest.mark.parametrize("score", [0.8, 0.9])
def test_high_score_keeps_a_still_person(score):
    camera = Camera()
    camera.score = score
    assert all(camera.look(sitting=(PERSON, STAND), skipped=9) == {"sitting"} for _ in range(40))


def test_where_no_score_is_certain_a_thing_is_removed():
    camera = Camera()
    camera.score = 3.0
    assert camera.repeat(30, coat=(COAT, STAND)) == {"coat"}
    camera = Camera()
    camera.filter, camera.score = StaticObjectFilter(math.inf), 3.0
    assert camera.repeat(30, coat=(COAT, STAND)) == set()


def test_person_with_a_face_is_kept():
    camera = Camera()
    camera.repeat(12, sitting=(PERSON, STAND))
    assert camera.look(sitting=(PERSON, STAND)) == set()
    camera.people = {"sitting"}
    assert all(camera.look(sitting=(PERSON, STAND), skipped=9) == {"sitting"} for _ in range(40))


def swaying(step: int) -> np.ndarray:
    """A person who sways by half a pixel of the compared images."""
    shift = np.array([[1, 0, np.sin(step / 3)], [0, 1, 0]], np.float32)
    return cv2.warpAffine(PERSON, shift, (80, 240), borderMode=cv2.BORDER_REPLICATE)


def test_standing_people_are_kept_beside_moving_ones():
    camera = Camera()
    for step in range(80):
        still: dict[str, Any] = {f"p{number}": (swaying(step), at(20 + 100 * number)) for number in range(4)}
        assert camera.look(walker=(COAT, at(400 + 2 * step % 60)), **still) >= set(still)


@pytest.mark.parametrize(("score", "after_s"), [(0.6, 3.0), (0.74, 3.0)])
def test_large_object_beside_moving_people_is_removed_when_they_would_have_swayed(score, after_s):
    camera = Camera()
    camera.room, camera.score = with_a_coat(), score
    seen = [camera.look(coat=(COAT, STAND), walker=(PERSON, at(400 + 2 * step))) for step in range(80)]
    assert seen[: round(10 * after_s)] == [{"coat", "walker"}] * round(10 * after_s)
    assert seen[round(10 * after_s) + 10 :] == [{"walker"}] * (70 - round(10 * after_s))


def test_person_with_a_likely_score_who_leans_slowly_is_kept():
    camera = Camera()
    camera.room, camera.score = with_a_coat(), 0.74
    for step in range(80):
        shift = np.array([[1, 0, 0.025 * step], [0, 1, 0]], np.float32)
        shape = cv2.warpAffine(PERSON, shift, (80, 240), borderMode=cv2.BORDER_REPLICATE)
        seen = camera.look(leaning=(shape, STAND), walker=(COAT, at(400 + 2 * step)))
        assert seen == {"leaning", "walker"}


def test_person_before_an_object_is_not_learnt_as_background():
    camera = Camera()
    seen = []
    for step in range(80):
        people: dict[str, Any] = {"waiting": (swaying(step), at(340)), "walker": (PERSON, at(430 + 2 * (step % 60)))}
        seen.append(camera.look(coat=(COAT, STAND), **people))
    assert seen[50:] == [{"waiting", "walker"}] * 30


@pytest.mark.parametrize(("score", "after_s"), [(0.6, 7.0), (0.55, 4.0)])
def test_small_object_beside_moving_people_is_removed_later(score, after_s):
    camera = Camera()
    camera.score = score
    small = (320.0, 300.0, 20.0, 60.0)
    seen = [camera.look(coat=(COAT, small), walker=(PERSON, at(400 + 2 * (step % 40)))) for step in range(100)]
    first = round(10 * after_s)
    assert seen[:first] == [{"coat", "walker"}] * first
    assert seen[first + 20 :] == [{"walker"}] * (80 - first)


def test_small_object_of_a_detector_whose_scores_are_never_certain_is_removed_after_8_s():
    camera = Camera()
    camera.filter, camera.score = StaticObjectFilter(math.inf), 3.0
    small = (320.0, 300.0, 20.0, 60.0)
    seen = [camera.look(coat=(COAT, small), walker=(PERSON, at(400 + 2 * (step % 40)))) for step in range(100)]
    assert seen[:70] == [{"coat", "walker"}] * 70
    assert seen[90:] == [{"walker"}] * 10


@pytest.mark.parametrize(("score", "height", "kept"), [(0.7, 60.0, True), (0.7, 240.0, False), (0.55, 60.0, False)])
def test_person_whose_sway_would_not_be_visible_is_kept_from_the_first_image_on(score, height, kept):
    camera = Camera()
    camera.score = score
    far = (320.0, 420.0 - height, height / 3, height)
    shape = patterned(3, round(height / 3), round(height))
    seen = camera.repeat(30, sitting=(shape, far))
    assert seen == ({"sitting"} if kept else set())


def test_time_that_the_camera_is_off_counts_if_nothing_has_changed():
    camera = Camera()
    for step in range(8):
        assert camera.look(coat=(COAT, STAND), walker=(PERSON, at(400 + 4 * step))) == {"coat", "walker"}
    camera.look(coat=(COAT, STAND))
    assert camera.look(again=(COAT, STAND), skipped=600) == set()


def test_person_in_the_place_of_a_lost_one_has_no_history():
    camera = Camera()
    for step in range(8):
        camera.look(coat=(COAT, STAND), walker=(PERSON, at(400 + 4 * step)))
    assert camera.look(other=(patterned(7, 80, 240), STAND), skipped=600) == {"other"}


def test_object_that_a_person_passes_closely_does_not_live():
    camera = Camera()
    camera.room = with_a_coat()
    for step in range(20):
        shaded = COAT.copy()
        shaded[:, :: 1 + step % 3] *= 0.6  # The shadow of the person moves over the object.
        camera.look(coat=(shaded, STAND), walker=(PERSON, at(370 + step % 5)))
    seen = [camera.look(coat=(COAT, STAND), walker=(PERSON, at(420 + 4 * (step % 20)))) for step in range(60)]
    assert seen[50:] == [{"walker"}] * 10


def test_paused_video_removes_nobody():
    camera = Camera()
    camera.noise = 0.0
    assert all(camera.look(sitting=(PERSON, STAND)) == {"sitting"} for _ in range(30))


def test_pixels_that_the_codec_skips_say_nothing():
    camera = Camera()
    shape = PERSON.astype(np.uint8)
    for _ in range(30):
        frame = np.clip(ROOM + np.random.default_rng(camera.count).normal(0, 2, ROOM.shape), 0, 255).astype(np.uint8)
        x, y, w, h = map(round, STAND)
        frame[y : y + h, x : x + w] = shape
        camera.count += 1
        track = Track("t1", np.array(STAND), 0.6, 0.0, Cut(), key=1)
        assert camera.filter.people(frame, camera.count * SECOND // 10, [track]) == (track,)


def test_swaying_by_a_pixel_is_enough():
    camera = Camera()
    for step in range(40):
        shift = np.array([[1, 0, 0.8 * np.sin(step / 4)], [0, 1, 0]], np.float32)
        shape = cv2.warpAffine(PERSON, shift, (80, 240), borderMode=cv2.BORDER_REPLICATE)
        assert camera.look(waiting=(shape, STAND)) == {"waiting"}


def test_object_that_sways_after_all_is_a_person():
    camera = Camera()
    assert camera.repeat(15, waiting=(PERSON, STAND)) == set()
    seen = [camera.look(waiting=(PERSON, at(300 + step // 3 % 7))) for step in range(40)]
    assert seen[30:] == [{"waiting"}] * 10


def test_uncertain_box_is_not_learnt_as_background():
    camera = Camera()
    x, y, w, h = map(round, STAND)
    seen = []
    for step in range(61):
        room = ROOM.copy()
        room[y : y + h, x : x + w] = swaying(step)
        noise = np.random.default_rng(step).normal(0, 1.5, room.shape)
        frame = np.clip(room + noise, 0, 255)
        frame[100:340, 4 * step : 4 * step + 60] = 90  # Somebody walks.
        walker = Track("t1", np.array((4.0 * step, 100.0, 60.0, 240.0)), 0.8, 0.0, Cut(), key=2)
        doubtful = Track("", np.array(STAND), 0.3, 0.0, Cut(), key=1)
        seated = Track("t2", np.array(STAND), 0.5, 0.0, Cut(), key=1)
        who = ([walker, seated], []) if step == 60 else ([walker], [doubtful])
        seen.append(camera.filter.people(frame.astype(np.uint8), step * SECOND // 10, *who))
    assert [track.id for track in seen[-1]] == ["t1", "t2"]


def test_small_movement_is_enough():
    camera = Camera()
    seen = [camera.look(waiting=(PERSON, at(300 + step // 4 % 2 * 4))) for step in range(60)]
    assert seen[5:] == [{"waiting"}] * 55


def test_slow_person_is_kept():
    camera = Camera()
    assert all(camera.look(slow=(PERSON, at(200 + step))) == {"slow"} for step in range(60))


def test_passing_person_does_not_restore_an_object():
    camera = Camera()
    camera.repeat(30, coat=(COAT, STAND))
    for step in range(60):
        x = 10.0 + 9 * step
        walker = (PERSON, at(x))
        if abs(x - STAND[0]) < 30:
            camera.look(walker=walker)
        else:
            assert camera.look(coat=(COAT, STAND), walker=walker) == {"walker"}
    assert camera.look(coat=(COAT, STAND)) == set()


def test_object_stays_removed_after_occlusion():
    camera = Camera()
    camera.room = with_a_coat()
    camera.repeat(30)
    for step in range(40):
        camera.look(walker=(PERSON, at(250 + step)))
    assert camera.look(anew=(COAT, STAND), walker=(PERSON, at(380))) == {"walker"}


def test_track_that_jumps_to_an_object_is_removed():
    camera = Camera()
    camera.room = with_a_coat()
    camera.repeat(30)
    for step in range(25):
        assert camera.look(walker=(PERSON, at(40 + 8 * step))) == {"walker"}
    assert all(camera.look(walker=(COAT, STAND)) == set() for _ in range(20))


def test_object_with_a_new_track_is_removed_when_it_is_free():
    camera = Camera()
    camera.room = with_a_coat()
    camera.repeat(30)
    for step in range(17):
        camera.look(walker=(high_up(230 + 5 * step, 75), at(230 + 5 * step)))
    camera.look(anew=(COAT, STAND), walker=(high_up(310, 75), at(310)))
    for step in range(12):
        camera.look(anew=(COAT, STAND), walker=(high_up(310 + 7 * step, 75), at(310 + 7 * step)))
    assert camera.look(anew=(COAT, STAND)) == set()


def test_thing_of_which_a_half_is_hidden_is_still_that_thing():
    camera = Camera()
    camera.room = with_a_coat()
    camera.repeat(30, coat=(COAT, STAND))
    for step in range(17):
        seen = camera.look(coat=(COAT, STAND), walker=(high_up(230 + 5 * step, 110), at(230 + 5 * step)))
        assert "coat" not in seen


def test_thing_that_was_hidden_from_the_beginning_is_removed_in_time():
    camera = Camera()
    camera.room = with_a_coat()
    for step in range(30):
        camera.look(walker=(PERSON, at(300 + step % 8)))
    for step in range(6):
        camera.look(walker=(PERSON, at(310 + 12 * step)))
    seen = [camera.look(coat=(COAT, STAND), walker=(PERSON, at(382 + 2 * step))) for step in range(88)]
    assert seen[-1] == {"walker"}


def test_moving_part_before_known_background_is_kept():
    camera = Camera()
    camera.repeat(30)
    x, y, w, h = (round(each) for each in STAND)
    there = ROOM[y : y + h, x : x + w]
    seen = []
    for step in range(36):
        waving = there.copy()
        up = 5 * (step % 12)
        waving[up : up + 70] = PERSON[:70]
        seen.append(camera.look(waving=(waving, STAND)))
    assert seen[20:] == [{"waving"}] * 16


def test_person_who_appears_in_a_box_of_background_is_kept():
    """Nobody can say whether the box moves, since a person stood before it a second ago."""
    camera = Camera()
    camera.repeat(30)
    camera.repeat(12, walker=(PERSON, STAND))
    x, y, w, h = (round(each) for each in STAND)
    wall = ROOM[y : y + h, x : x + w]
    assert camera.look(new=(wall, STAND), walker=(PERSON, at(450))) == {"walker"}
    assert camera.look(new=(patterned(7, 80, 240), STAND), walker=(PERSON, at(460))) == {"new", "walker"}


def test_when_everything_changes_at_once_things_stay_things():
    camera = Camera()
    camera.repeat(30, coat=(COAT, STAND))
    camera.room = patterned(4, WIDTH, HEIGHT)
    assert not any(camera.look(coat=(patterned(5, 80, 240), STAND)) for _ in range(30))


def test_other_image_size_resets_the_filter():
    scenery = StaticObjectFilter(CERTAIN)
    track = Track("t1", np.array((10.0, 10.0, 20.0, 40.0)), 0.9, 0.0, Cut())
    for step in range(9):
        scenery.people(np.zeros((100, 100), np.uint8), step * SECOND, [track])
    assert scenery.people(np.zeros((80, 100), np.uint8), 9 * SECOND, [track]) == (track,)


def test_object_stays_removed_after_a_shadow():
    camera = Camera()
    camera.repeat(20, coat=(COAT, STAND))
    for step in range(6):
        shaded = COAT.copy()
        shaded[30 * step : 30 * step + 60] *= 0.3
        camera.look(coat=(shaded, STAND))
    assert camera.repeat(15, coat=(COAT, STAND)) == set()


def test_object_that_moves_is_kept():
    camera = Camera()
    camera.repeat(20, waiting=(PERSON, at(300)))
    seen = [camera.look(waiting=(PERSON, at(300 + 10 * step))) for step in range(1, 20)]
    assert seen[5:] == [{"waiting"}] * 14


def test_object_with_a_new_track_stays_removed():
    camera = Camera()
    camera.repeat(20, coat=(COAT, STAND))
    assert camera.look(again=(COAT, STAND), reported=(302.0, 122.0, 78.0, 236.0)) == set()


@pytest.mark.parametrize("gain", [0.5, 1.4])
def test_switched_lamp_does_not_restore_an_object(gain):
    camera = Camera()
    camera.repeat(20, coat=(COAT, STAND))
    camera.gain = gain
    assert not any(camera.look(coat=(COAT, STAND)) for _ in range(30))


def test_switched_lamp_removes_nobody():
    camera = Camera()
    for step in range(20):
        camera.look(walker=(PERSON, at(20 + 10 * step)))
    camera.gain = 0.6
    assert all(camera.look(walker=(PERSON, at(220))) == {"walker"} for _ in range(30))


def test_turning_camera_removes_nobody():
    scenery = StaticObjectFilter(CERTAIN)
    for step in range(30):
        picture = np.roll(ROOM, 7 * step, axis=1).astype(np.uint8)
        track = Track("t1", np.array(STAND), 0.9, 0.0, Cut())
        assert scenery.people(picture, step * SECOND // 10, [track]) == (track,)


def test_scores_count_while_the_camera_turns():
    camera, far = Camera(), (300.0, 200.0, 24.0, 60.0)
    camera.score = 0.35
    for step in range(22):
        camera.room = np.roll(ROOM, 6 * step, axis=1)
        camera.look(person=(PERSON, far))
        camera.score = 0.72
    seen = [camera.look(person=(PERSON, far)) for _ in range(30)]
    assert seen == [{"person"}] * 30, "a person whose first box was uncertain"


def test_person_beside_walkers_is_kept_when_a_turning_camera_stops():
    camera, far = Camera(), (300.0, 200.0, 24.0, 60.0)
    camera.score = 0.5
    for step in range(22):
        camera.room = np.roll(ROOM, 6 * step, axis=1)
        camera.look(person=(PERSON, far), walker=(PERSON, at(10 * step)))
    seen = [camera.look(person=(PERSON, far), walker=(PERSON, at(400.0))) for _ in range(40)]
    assert all("person" in each for each in seen)


def test_first_score_counts_no_more_than_later_ones():
    camera = Camera()
    camera.score = 0.4
    camera.look(person=(PERSON, (300.0, 200.0, 24.0, 60.0)))
    camera.score = 0.72
    seen = [camera.look(person=(PERSON, (300.0, 200.0, 24.0, 60.0))) for _ in range(30)]
    assert seen == [{"person"}] * 30


def test_new_recording_forgets_objects():
    camera = Camera()
    camera.repeat(20, coat=(COAT, STAND))
    camera.count = 0
    assert camera.look(coat=(COAT, STAND)) == {"coat"}


def test_image_without_tracks():
    scenery = StaticObjectFilter(CERTAIN)
    for step in range(3):
        assert scenery.people(np.zeros((48, 64), np.uint8), step * SECOND, []) == ()
