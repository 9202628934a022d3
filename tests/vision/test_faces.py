"""Faces in the committed bag, and the direction that people face."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from socialbot.bags.reader import open_bag
from socialbot.core.clock import SECOND
from socialbot.core.messages import CompressedImage
from socialbot.vision.distance import Estimate
from socialbot.vision.faces import SHA256, Attention, Face, FaceDetector, FaceFinder
from socialbot.vision.images import bgr_from_compressed
from socialbot.vision.metrics.truth import Person, load_truth
from socialbot.vision.motion import Cut
from socialbot.vision.network import included_model
from socialbot.vision.tracking import Track
from tests.vision.drawn import corridor as empty_room

FRONT = Face((10.0, 10.0, 30.0, 30.0), 0.9, 0.1)


@pytest.fixture(scope="module")
def detector() -> FaceDetector:
    return FaceDetector()


@pytest.fixture(scope="module")
def heads(corridor) -> list[tuple[np.ndarray, Person, float]]:
    """Images with a near person of the committed bag, and how far the person walks in the next half second."""
    truth = load_truth(corridor.with_suffix(".truth.json"))
    people = {frame.stamp: frame.persons for frame in truth.frames}
    later = {(frame.stamp, person.id): person.distance_m for frame in truth.frames for person in frame.persons}
    with open_bag(corridor) as bag:
        topic = bag.choose_image_topic()
        images = [image for _, image in bag.messages({topic.name: topic.type}) if isinstance(image, CompressedImage)]
    found = []
    for image, after in itertools.islice(zip(images, images[5:], strict=False), 0, None, 5):
        for person in people.get(image.stamp, ()):
            end = later.get((after.stamp, person.id))
            if person.visible > 0.9 and person.h > 160 and end is not None and person.distance_m is not None:
                found.append((bgr_from_compressed(image), person, end - person.distance_m))
    return found


def box(person: Person) -> np.ndarray:
    return np.array([person.x, person.y, person.w, person.h])


def test_faces_of_people_who_look_are_found_and_backs_have_none(detector, heads):
    looking = [detector.find(image, box(person)) for image, person, path in heads if path < 0.1]
    leaving = [detector.find(image, box(person)) for image, person, path in heads if path > 0.25]
    faces = [face for face in looking if face is not None]
    assert len(looking) > 10
    assert len(faces) >= 0.6 * len(looking)
    assert np.median([abs(face.turn_rad) for face in faces]) < 0.35
    assert sum(face is not None for face in leaving) <= 0.2 * len(leaving)


def test_a_face_is_in_the_upper_part_of_its_person(detector, heads):
    for image, person, _ in heads:
        face = detector.find(image, box(person))
        if face is not None:
            x, y, w, h = face.box
            assert person.x < x + w / 2 < person.x + person.w
            assert person.y - 0.05 * person.h < y < y + h < person.y + 0.4 * person.h


def test_a_mirrored_face_turns_to_the_other_side(detector, heads):
    pairs = []
    for image, person, _ in heads:
        mirrored = np.array([image.shape[1] - person.x - person.w, person.y, person.w, person.h])
        faces = detector.find(image, box(person)), detector.find(np.ascontiguousarray(image[:, ::-1]), mirrored)
        pairs += [tuple(face.turn_rad for face in faces if face is not None)] if None not in faces else []
    assert len(pairs) > 5
    assert np.median([abs(one + other) for one, other in pairs]) < 0.25


@pytest.mark.parametrize(
    "person", [(-300, -300, 80, 200), (635, 400, 80, 200), (-60, -150, 90, 200), (10, 10, 0, 0), (0, 0, 640, 480)]
)
def test_there_is_no_face_in_an_empty_room(detector, person):
    assert detector.find(empty_room(), np.array(person, np.float64)) is None


def test_the_notice_names_the_weights():
    import socialbot.vision.network as module

    folder = module.resources.files("socialbot.vision") / "models"
    assert SHA256 in (folder / "NOTICE").read_text()
    assert len(included_model("blazeface.onnx", SHA256)) < 300_000


CLEAR, LARGE = 30.0, 60.0
WEAK = Face((10.0, 10.0, 30.0, 30.0), 0.7, 0.1)


def looked(*faces: Face | None, head_px: float = CLEAR) -> tuple[Attention, int]:
    """Attention after five searches a second, and the time of the last."""
    attention, stamp = Attention(), 0
    for number, face in enumerate(faces):
        stamp = round(number * 0.2 * SECOND)
        attention.see(stamp, face, head_px=head_px)
    return attention, stamp


def test_a_face_says_where_a_person_faces_for_a_second():
    attention, stamp = looked(FRONT)
    assert attention.facing_rad(stamp) == pytest.approx(0.1)
    assert attention.facing_rad(stamp + SECOND) == pytest.approx(0.1)
    assert attention.facing_rad(stamp + SECOND + 1) is None


def test_some_faces_show_a_person_for_a_while():
    attention = Attention()
    for number in range(3):
        assert not attention.is_person(number * SECOND)
        attention.see(number * SECOND, Face((10.0, 10.0 + number, 30.0, 30.0), 0.9, 0.1), head_px=CLEAR)
    assert attention.is_person(20 * SECOND)
    assert not attention.is_person(60 * SECOND)


def test_printed_face_that_stays_where_it_is_shows_nobody():
    attention = Attention()
    for number in range(20):
        attention.see(number * SECOND, Face((10.0 + 0.4 * (number % 2), 10.0, 30.0, 30.0), 0.9, 0.1), head_px=CLEAR)
    assert not attention.is_person(20 * SECOND)


def test_turns_are_smoothed_with_their_signs():
    attention, stamp = looked(FRONT, Face(FRONT.box, 0.9, -0.1))
    assert attention.facing_rad(stamp) == pytest.approx(0.0)


@pytest.mark.parametrize(("head_px", "count"), [(CLEAR, 5), (LARGE, 3)])
def test_a_head_without_a_face_for_long_is_turned_away(head_px: float, count: int):
    attention, stamp = looked(*[None] * count, head_px=head_px)
    assert attention.facing_rad(stamp) == pytest.approx(2.5)
    attention, stamp = looked(*[None] * (count - 1), head_px=head_px)
    assert attention.facing_rad(stamp) is None


@pytest.mark.parametrize("head_px", [0.0, 24.0])
def test_a_small_head_without_a_face_tells_nothing(head_px: float):
    attention, stamp = looked(*[None] * 20, head_px=head_px)
    assert attention.facing_rad(stamp) is None


def test_hair_that_looks_like_a_face_now_and_then_is_the_back_of_a_head():
    attention, stamp = looked(*[None] * 6, head_px=LARGE)
    for number in range(30):
        stamp += SECOND // 5
        attention.see(stamp, (None, None, WEAK, None, WEAK)[number % 5], head_px=LARGE)
        assert attention.facing_rad(stamp) == pytest.approx(2.5), number
    attention.see(stamp, FRONT, head_px=LARGE)
    assert attention.facing_rad(stamp) is None


def test_a_person_who_turns_round_faces_the_camera_within_a_second():
    attention, stamp = looked(*[None] * 20, *[FRONT] * 4)
    assert attention.facing_rad(stamp) == pytest.approx(0.1)
    attention, stamp = looked(*[FRONT] * 20, *[None] * 5)
    assert attention.facing_rad(stamp) is None


def walked(
    start: tuple[float, float], speed: tuple[float, float], seconds: float = 1.2, std_m: float = 0.1
) -> tuple[Attention, int]:
    attention, stamp = Attention(), 0
    for number in range(round(seconds * 10) + 1):
        stamp = round(number * 0.1 * SECOND)
        x, y = (place + each * number * 0.1 for place, each in zip(start, speed, strict=True))
        attention.walk(stamp, Estimate(math.hypot(x, y), std_m), math.atan2(y, x))
    return attention, stamp


@pytest.mark.parametrize(
    ("speed", "facing", "approach"), [((-1.0, 0.0), 0.0, 1.0), ((1.0, 0.0), math.pi, -1.0), ((0.0, 1.0), None, None)]
)
def test_people_face_where_they_walk(speed, facing, approach):
    attention, stamp = walked((5.0, 0.0), speed)
    there = attention.facing_rad(stamp)
    assert there is not None
    if facing is None:
        assert there == pytest.approx(math.pi / 2, abs=0.3)
    else:
        assert there == pytest.approx(facing, abs=0.05)
        assert attention.approach_mps() == pytest.approx(approach, abs=0.05)


@pytest.mark.parametrize(("speed", "std_m", "facing"), [(1.0, 0.1, math.pi), (1.0, 1.0, 0.1), (-1.0, 0.1, 0.1)])
def test_a_face_of_a_person_who_certainly_walks_away_is_none(speed: float, std_m: float, facing: float):
    attention, stamp = walked((3.0, 0.0), (speed, 0.0), std_m=std_m)
    attention.see(stamp, FRONT, head_px=LARGE)
    assert attention.facing_rad(stamp) == pytest.approx(facing, abs=0.05)


def test_who_stands_or_was_seen_shortly_has_no_walking_direction():
    attention, stamp = walked((5.0, 0.0), (0.2, 0.0))
    assert attention.facing_rad(stamp) is None
    attention, stamp = walked((5.0, 0.0), (1.0, 0.0), seconds=0.4)
    assert attention.facing_rad(stamp) is None
    assert attention.approach_mps() is None


def test_heads_take_turns_and_small_ones_are_left_out(monkeypatch):
    finder, asked = FaceFinder(), []
    monkeypatch.setattr(finder._detector, "find", lambda image, person: asked.append(person[0]))
    tracks = [
        Track(name, np.array([x, 10.0, 100.0, h]), 0.9, 0.0, Cut())
        for name, x, h in (("t1", 0.0, 300.0), ("t2", 200.0, 300.0), ("t3", 400.0, 100.0))
    ]
    known = {track.id: Attention() for track in tracks}
    for number in range(6):
        finder.look(empty_room(), round((1 + number * 0.1) * SECOND), tracks, known)
    assert asked == [0.0, 200.0, 0.0, 200.0, 0.0, 200.0]
    assert known["t3"].looked is None


def test_a_near_person_whose_legs_are_out_of_the_image_is_searched(monkeypatch):
    finder, sizes = FaceFinder(), []
    monkeypatch.setattr(finder._detector, "find", lambda image, person: None)
    monkeypatch.setattr(Attention, "see", lambda self, stamp, face, *, head_px: sizes.append(head_px))
    box = np.array([100.0, 108.0, 76.0, 132.0])  # at 1.8 m in an image of 320x240
    finder.look(empty_room(), SECOND, [Track("t1", box, 0.9, 0.0, Cut(bottom=True))], {"t1": Attention()})
    finder.look(empty_room(), 2 * SECOND, [Track("t2", box, 0.9, 0.0, Cut())], {"t2": Attention()})
    assert sizes == [pytest.approx(33.0, abs=1.0)], "but not a child whose feet are in the image"
