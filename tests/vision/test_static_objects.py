from __future__ import annotations

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
        self.scenery = StaticObjectFilter()
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
        kept = self.scenery.people(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), self.count * SECOND // 10, tracks)
        return {track.id for track in kept}


def at(x: float) -> Box:
    return x, 120.0, 80.0, 240.0


def test_what_never_moves_is_no_person():
    camera = Camera()
    seen = [camera.look(coat=(COAT, STAND)) for _ in range(30)]
    assert seen[0] == {"coat"}, "at first nobody can tell"
    assert seen[5:] == [set()] * 25


def test_who_walks_is_a_person_from_the_first_picture_on():
    camera = Camera()
    for _ in range(10):
        camera.look()
    assert all(camera.look(walker=(PERSON, at(20 + 10 * step))) == {"walker"} for step in range(40))


def test_who_comes_and_stands_stays_a_person():
    camera = Camera()
    for _ in range(25):
        camera.look()
    for step in range(20):
        camera.look(walker=(PERSON, at(20 + 10 * step)))
    stands = [camera.look(walker=(PERSON, at(220)), skipped=4) for _ in range(70)]
    assert stands[:60] == [{"walker"}] * 60
    assert stands[64:] == [set()] * 6, "nobody stands like a stone for so long"


def test_what_looks_like_somebody_who_passed_is_soon_a_thing_where_nobody_knows_the_place():
    camera = Camera()
    camera.room = with_a_coat()
    for step in range(20):
        camera.look(walker=(PERSON, at(260 + 2 * step)))
    seen = [camera.look(walker=(COAT, STAND)) for _ in range(60)]
    assert seen[0] == {"walker"}
    assert seen[45:] == [set()] * 15


def test_a_small_movement_is_enough():
    camera = Camera()
    seen = [camera.look(waiting=(PERSON, at(300 + step // 4 % 2 * 4))) for step in range(60)]
    assert seen[5:] == [{"waiting"}] * 55


def test_who_moves_slowly_is_never_left_out():
    camera = Camera()
    assert all(camera.look(slow=(PERSON, at(200 + step))) == {"slow"} for step in range(60))


def test_who_passes_does_not_bring_a_thing_to_life():
    camera = Camera()
    for _ in range(30):
        camera.look(coat=(COAT, STAND))
    for step in range(60):
        x = 10.0 + 9 * step
        walker = (PERSON, at(x))
        if abs(x - STAND[0]) < 30:
            camera.look(walker=walker)
        else:
            assert camera.look(coat=(COAT, STAND), walker=walker) == {"walker"}
    assert camera.look(coat=(COAT, STAND)) == set()


def test_a_thing_that_comes_out_from_behind_somebody_is_still_that_thing():
    camera = Camera()
    camera.room = with_a_coat()
    for _ in range(30):
        camera.look()
    for step in range(40):
        camera.look(walker=(PERSON, at(250 + step)))
    assert camera.look(anew=(COAT, STAND), walker=(PERSON, at(380))) == {"walker"}


def test_who_has_passed_does_not_lend_their_life_to_a_thing():
    camera = Camera()
    camera.room = with_a_coat()
    for _ in range(30):
        camera.look()
    for step in range(25):
        assert camera.look(walker=(PERSON, at(40 + 8 * step))) == {"walker"}
    assert all(camera.look(walker=(COAT, STAND)) == set() for _ in range(20))


def test_a_thing_that_is_seen_past_somebody_is_still_that_thing():
    camera = Camera()
    camera.room = with_a_coat()
    for _ in range(30):
        camera.look()
    for step in range(17):
        camera.look(walker=(high_up(230 + 5 * step, 75), at(230 + 5 * step)))
    assert camera.look(anew=(COAT, STAND), walker=(high_up(310, 75), at(310))) == {"walker"}


def test_a_thing_of_which_a_half_is_hidden_is_still_that_thing():
    camera = Camera()
    camera.room = with_a_coat()
    for _ in range(30):
        camera.look(coat=(COAT, STAND))
    for step in range(17):
        seen = camera.look(coat=(COAT, STAND), walker=(high_up(230 + 5 * step, 110), at(230 + 5 * step)))
        assert "coat" not in seen


def test_a_thing_of_which_only_the_middle_is_to_be_seen_is_still_that_thing():
    camera = Camera()
    camera.room = with_a_coat()
    for _ in range(30):
        camera.look()
    for step in range(20):
        camera.look(walker=(PERSON, at(60 + 10 * step)))
    around = with_a_coat()[120:360, 300:380].copy()
    around[:, :20], around[:, 60:], around[150:] = PERSON[:, :20], PERSON[:, 60:], PERSON[150:]
    assert [camera.look(walker=(around, STAND)) for _ in range(10)] == [set()] * 10


def test_a_thing_that_was_hidden_from_the_beginning_does_not_move_when_it_appears():
    camera = Camera()
    camera.room = with_a_coat()
    for step in range(30):
        camera.look(walker=(PERSON, at(300 + step % 8)))
    for step in range(6):
        camera.look(walker=(PERSON, at(310 + 12 * step)))
    seen = [camera.look(coat=(COAT, STAND), walker=(PERSON, at(382 + 8 * step))) for step in range(15)]
    assert seen[-1] == {"walker"}


def test_a_part_that_moves_before_what_is_known_is_somebody():
    camera = Camera()
    for _ in range(30):
        camera.look()
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
    for _ in range(30):
        camera.look(coat=(COAT, STAND))
    camera.room = patterned(4, WIDTH, HEIGHT)
    assert not any(camera.look(coat=(patterned(5, 80, 240), STAND)) for _ in range(30))


def test_pictures_of_another_size_begin_anew():
    scenery = StaticObjectFilter()
    track = Track("t1", np.array((10.0, 10.0, 20.0, 40.0)), 0.9, 0.0, Cut())
    for step in range(9):
        scenery.people(np.zeros((100, 100, 3), np.uint8), step * SECOND, [track])
    assert scenery.people(np.zeros((80, 100, 3), np.uint8), 9 * SECOND, [track]) == (track,)


def test_a_shadow_that_lies_on_a_thing_does_not_bring_it_to_life():
    camera = Camera()
    for _ in range(20):
        camera.look(coat=(COAT, STAND))
    for step in range(20):
        shaded = COAT.copy()
        shaded[10 * step : 10 * step + 60] *= 0.3
        assert camera.look(coat=(shaded, STAND)) == set()


def test_a_thing_that_leaves_its_place_was_somebody():
    camera = Camera()
    for _ in range(20):
        camera.look(waiting=(PERSON, at(300)))
    seen = [camera.look(waiting=(PERSON, at(300 + 10 * step))) for step in range(1, 20)]
    assert seen[5:] == [{"waiting"}] * 14


def test_a_thing_found_anew_is_still_that_thing():
    camera = Camera()
    for _ in range(20):
        camera.look(coat=(COAT, STAND))
    assert camera.look(again=(COAT, STAND), reported=(302.0, 122.0, 78.0, 236.0)) == set()


@pytest.mark.parametrize("gain", [0.5, 1.4])
def test_a_lamp_that_is_switched_does_not_bring_a_thing_to_life(gain):
    camera = Camera()
    for _ in range(20):
        camera.look(coat=(COAT, STAND))
    camera.gain = gain
    assert not any(camera.look(coat=(COAT, STAND)) for _ in range(30))


def test_a_lamp_that_is_switched_hides_nobody():
    camera = Camera()
    for step in range(20):
        camera.look(walker=(PERSON, at(20 + 10 * step)))
    camera.gain = 0.6
    assert all(camera.look(walker=(PERSON, at(220))) == {"walker"} for _ in range(30))


def test_a_camera_that_turns_takes_nobody_for_a_thing():
    scenery = StaticObjectFilter()
    for step in range(30):
        picture = np.roll(ROOM, 7 * step, axis=1).astype(np.uint8)
        track = Track("t1", np.array(STAND), 0.9, 0.0, Cut())
        image = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
        assert scenery.people(image, step * SECOND // 10, [track]) == (track,)


def test_time_that_begins_anew_forgets_the_things():
    camera = Camera()
    for _ in range(20):
        camera.look(coat=(COAT, STAND))
    camera.count = 0
    assert camera.look(coat=(COAT, STAND)) == {"coat"}


def test_a_picture_without_anybody_is_no_trouble():
    scenery = StaticObjectFilter()
    for step in range(3):
        assert scenery.people(np.zeros((48, 64, 3), np.uint8), step * SECOND, []) == ()
