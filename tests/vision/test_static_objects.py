from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.vision._static_objects import StaticObjectFilter
from socialbot.vision.tracking import Cut, Track

WIDTH, HEIGHT = 640, 480
Box = tuple[float, float, float, float]
STAND: Box = (300.0, 120.0, 80.0, 240.0)


def patterned(seed: int, width: int, height: int) -> np.ndarray:
    """Something with shapes in it, grey levels as float."""
    coarse = np.random.default_rng(seed).uniform(40, 200, (height // 8 + 1, width // 8 + 1)).astype(np.float32)
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)


ROOM = patterned(1, WIDTH, HEIGHT)
COAT, PERSON = patterned(2, 80, 240), patterned(3, 80, 240)


def with_a_coat() -> np.ndarray:
    """The room with a coat in it that need not be found."""
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
        self.filter = StaticObjectFilter()
        self.count = 0
        self.gain = 1.0
        self.room = ROOM

    def look(self, reported: Box | None = None, skipped: int = 0, **things: tuple[np.ndarray, Box]) -> set[str]:
        """Who is a person, of the ``things``: how each looks, and its box. The last one stands before the others.

        The detector's box is another one if ``reported``. So many pictures have been ``skipped`` before this one.
        """
        picture = self.room.copy()
        for shape, (x, y, w, h) in things.values():
            picture[round(y) : round(y + h), round(x) : round(x + w)] = shape[: round(h), : round(w)]
        noise = np.random.default_rng(self.count).normal(0, 1.5, picture.shape)
        image = np.clip(self.gain * picture + noise, 0, 255).astype(np.uint8)
        self.count += 1 + skipped
        tracks = [Track(name, np.array(reported or box), 0.9, 0.0, Cut()) for name, (_, box) in things.items()]
        kept = self.filter.people(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), self.count * SECOND // 10, tracks)
        return {track.id for track in kept}

    def repeat(self, count: int, **things: Any) -> set[str]:
        return [self.look(**things) for _ in range(count)][-1]


def at(x: float) -> Box:
    return x, 120.0, 80.0, 240.0


def test_static_object_is_removed():
    camera = Camera()
    seen = [camera.look(coat=(COAT, STAND)) for _ in range(30)]
    assert seen[0] == {"coat"}, "at first nobody can tell"
    assert seen[5:] == [set()] * 25


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


def test_object_on_unknown_background_is_soon_removed():
    camera = Camera()
    camera.room = with_a_coat()
    for step in range(20):
        camera.look(walker=(PERSON, at(260 + 2 * step)))
    seen = [camera.look(walker=(COAT, STAND)) for _ in range(60)]
    assert seen[0] == {"walker"}
    assert seen[45:] == [set()] * 15


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


def test_partly_occluded_object_stays_removed():
    camera = Camera()
    camera.room = with_a_coat()
    camera.repeat(30)
    for step in range(17):
        camera.look(walker=(high_up(230 + 5 * step, 75), at(230 + 5 * step)))
    assert camera.look(anew=(COAT, STAND), walker=(high_up(310, 75), at(310))) == {"walker"}


def test_thing_of_which_a_half_is_hidden_is_still_that_thing():
    camera = Camera()
    camera.room = with_a_coat()
    camera.repeat(30, coat=(COAT, STAND))
    for step in range(17):
        seen = camera.look(coat=(COAT, STAND), walker=(high_up(230 + 5 * step, 110), at(230 + 5 * step)))
        assert "coat" not in seen


def test_thing_of_which_only_the_middle_is_to_be_seen_is_still_that_thing():
    camera = Camera()
    camera.room = with_a_coat()
    camera.repeat(30)
    for step in range(20):
        camera.look(walker=(PERSON, at(60 + 10 * step)))
    around = with_a_coat()[120:360, 300:380].copy()
    around[:, :20], around[:, 60:], around[150:] = PERSON[:, :20], PERSON[:, 60:], PERSON[150:]
    assert [camera.look(walker=(around, STAND)) for _ in range(10)] == [set()] * 10


def test_thing_that_was_hidden_from_the_beginning_does_not_move_when_it_appears():
    camera = Camera()
    camera.room = with_a_coat()
    for step in range(30):
        camera.look(walker=(PERSON, at(300 + step % 8)))
    for step in range(6):
        camera.look(walker=(PERSON, at(310 + 12 * step)))
    seen = [camera.look(coat=(COAT, STAND), walker=(PERSON, at(382 + 8 * step))) for step in range(15)]
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


def test_when_everything_changes_at_once_things_stay_things():
    camera = Camera()
    camera.repeat(30, coat=(COAT, STAND))
    camera.room = patterned(4, WIDTH, HEIGHT)
    assert not any(camera.look(coat=(patterned(5, 80, 240), STAND)) for _ in range(30))


def test_other_image_size_resets_the_filter():
    scenery = StaticObjectFilter()
    track = Track("t1", np.array((10.0, 10.0, 20.0, 40.0)), 0.9, 0.0, Cut())
    for step in range(9):
        scenery.people(np.zeros((100, 100, 3), np.uint8), step * SECOND, [track])
    assert scenery.people(np.zeros((80, 100, 3), np.uint8), 9 * SECOND, [track]) == (track,)


def test_shadow_does_not_restore_an_object():
    camera = Camera()
    camera.repeat(20, coat=(COAT, STAND))
    for step in range(20):
        shaded = COAT.copy()
        shaded[10 * step : 10 * step + 60] *= 0.3
        assert camera.look(coat=(shaded, STAND)) == set()


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
    scenery = StaticObjectFilter()
    for step in range(30):
        picture = np.roll(ROOM, 7 * step, axis=1).astype(np.uint8)
        track = Track("t1", np.array(STAND), 0.9, 0.0, Cut())
        image = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
        assert scenery.people(image, step * SECOND // 10, [track]) == (track,)


def test_new_recording_forgets_objects():
    camera = Camera()
    camera.repeat(20, coat=(COAT, STAND))
    camera.count = 0
    assert camera.look(coat=(COAT, STAND)) == {"coat"}


def test_image_without_tracks():
    scenery = StaticObjectFilter()
    for step in range(3):
        assert scenery.people(np.zeros((48, 64, 3), np.uint8), step * SECOND, []) == ()
