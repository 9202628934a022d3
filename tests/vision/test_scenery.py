from __future__ import annotations

import cv2
import numpy as np
import pytest

from socialbot.clock import SECOND
from socialbot.vision.motion import Cut
from socialbot.vision.scenery import Scenery
from socialbot.vision.tracking import Track

WIDTH, HEIGHT = 640, 480
Box = tuple[float, float, float, float]
STAND: Box = (300.0, 120.0, 80.0, 240.0)


def patterned(seed: int, width: int, height: int) -> np.ndarray:
    """Something with shapes in it, grey levels as float."""
    coarse = np.random.default_rng(seed).uniform(40, 200, (height // 8 + 1, width // 8 + 1)).astype(np.float32)
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)


ROOM = patterned(1, WIDTH, HEIGHT)
COAT, PERSON = patterned(2, 80, 240), patterned(3, 80, 240)


class Camera:
    """Takes a picture every tenth of a second; what stands in it is a track."""

    def __init__(self) -> None:
        self.scenery = Scenery()
        self.count = 0
        self.gain = 1.0

    def look(self, reported: Box | None = None, **things: tuple[np.ndarray, Box]) -> set[str]:
        """Who is a person, of the ``things``: how each looks, and its box. The last one stands before the others.

        The detector's box is another one if ``reported``.
        """
        picture = ROOM.copy()
        for shape, (x, y, w, h) in things.values():
            picture[round(y) : round(y + h), round(x) : round(x + w)] = shape[: round(h), : round(w)]
        noise = np.random.default_rng(self.count).normal(0, 1.5, picture.shape)
        image = np.clip(self.gain * picture + noise, 0, 255).astype(np.uint8)
        self.count += 1
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
    for step in range(20):
        camera.look(walker=(PERSON, at(20 + 10 * step)))
    stands = [camera.look(walker=(PERSON, at(220))) for _ in range(350)]
    assert stands[:300] == [{"walker"}] * 300
    assert stands[320:] == [set()] * 30, "nobody stands like a stone for so long"


def test_a_small_movement_is_enough():
    camera = Camera()
    seen = [camera.look(waiting=(PERSON, at(300 + step // 4 % 2 * 4))) for step in range(60)]
    assert seen == [{"waiting"}] * 60


def test_who_passes_does_not_bring_a_thing_to_life():
    camera = Camera()
    for _ in range(20):
        camera.look(coat=(COAT, STAND))
    for step in range(60):
        assert "coat" not in camera.look(coat=(COAT, STAND), walker=(PERSON, at(10 + 9 * step)))
    assert camera.look(coat=(COAT, STAND)) == set()


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
    scenery = Scenery()
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
    scenery = Scenery()
    for step in range(3):
        assert scenery.people(np.zeros((48, 64, 3), np.uint8), step * SECOND, []) == ()
