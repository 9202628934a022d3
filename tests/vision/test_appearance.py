"""People are distinguished by their colours, and recognised when they return."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.clock import SECOND
from socialbot.vision.appearance import Appearance, looks_of, noise_of
from socialbot.vision.detector import clip
from socialbot.vision.tracking import Track, Tracker
from tests.vision.scenes import SIZE, ids

RED, GREEN, BLUE = (60, 50, 190), (70, 150, 60), (170, 80, 50)
BLACK, BEIGE = (35, 32, 30), (150, 185, 205)
ANNA, BEN, CLEO = (RED, BLACK), (GREEN, BEIGE), (BLUE, BLACK)
BLANK = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
NOISE = np.random.default_rng(0).normal(0, 6, (2 * SIZE[1], SIZE[0], 3)).astype(np.float32)
Clothes = tuple[tuple[int, int, int], tuple[int, int, int]]


def picture(*people: tuple[tuple[float, ...], Clothes], light: float = 1.0, seed: int = 0) -> np.ndarray:
    """An image of people as coloured rectangles with noise; the last one is in front."""
    image = np.full((SIZE[1], SIZE[0], 3), 120.0, np.float32)
    for (x, y, w, h), (shirt, trousers) in people:
        left, right = max(0, round(x + 0.15 * w)), max(0, round(x + 0.85 * w))
        image[max(0, round(y)) : max(0, round(y + 0.5 * h)), left:right] = shirt
        image[max(0, round(y + 0.5 * h)) : max(0, round(y + h)), left:right] = trousers
    return np.clip(light * image + NOISE[seed : seed + SIZE[1]], 0, 255).astype(np.uint8)


class Room:
    """A tracker that gets ten images a second of people in clothes."""

    def __init__(self, **how: float) -> None:
        self.tracker = Tracker(0.5, 0.15, **how)  # type: ignore[arg-type]
        self.time_s = 0.0
        self.show(after_s=0.1)

    def show(
        self, *people: tuple[tuple[float, ...], Clothes], after_s: float = 0.1, light: float = 1.0
    ) -> tuple[Track, ...]:
        """Show an image; people behind others by more than a half are not detected."""
        self.time_s += after_s
        boxes = np.array([box for box, _ in people], float).reshape(-1, 4)
        image = picture(*people, light=light, seed=round(10 * self.time_s) % SIZE[1]) if people else BLANK
        visible = [
            not any(abs(box[0] - other[0]) < 0.5 * box[2] for other in boxes[number + 1 :])
            for number, box in enumerate(boxes)
        ]
        boxes = boxes[np.array(visible, bool)]
        scores = np.full(len(boxes), 0.7)
        return self.tracker.update(round(self.time_s * SECOND), boxes, scores, SIZE, looks_of(image, boxes))

    def stay(self, *people: tuple[tuple[float, ...], Clothes], seconds: float, light: float = 1.0) -> list[str]:
        """Show the same people for some time; the ids in the last image, from left to right."""
        tracks: tuple[Track, ...] = ()
        for _ in range(round(10 * seconds)):
            tracks = self.show(*people, light=light)
        return ids(tuple(sorted(tracks, key=lambda track: track.box[0])))


def at(x: float, y: float = 120.0, h: float = 240.0) -> tuple[float, ...]:
    return x, y, 0.4 * h, h


@pytest.mark.parametrize("away_s", [1.0, 5.0, 20.0, 80.0])
def test_person_who_returns_elsewhere_keeps_the_id(away_s):
    room = Room()
    room.stay((at(100), ANNA), seconds=2)
    for _ in range(round(away_s / 0.4)):
        room.show(after_s=0.4)
    assert room.stay((at(450, h=180), ANNA), seconds=1) == ["t1"]


def test_person_who_returns_later_than_remembered_is_new():
    room = Room(remember_s=10.0)
    room.stay((at(100), ANNA), seconds=2)
    room.stay(seconds=12)
    assert room.stay((at(450), ANNA), seconds=1) == ["t2"]


def test_another_person_gets_a_new_id():
    room = Room()
    assert room.stay((at(300), ANNA), seconds=2) == ["t1"]
    room.stay(seconds=4)
    assert room.stay((at(300), BEN), seconds=2) == ["t2"]
    room.stay(seconds=4)
    assert room.stay((at(300), CLEO), seconds=2) == ["t3"], "the trousers alone are those of t1"


def test_another_person_at_the_same_door_at_once_gets_a_new_id():
    room = Room()
    room.stay((at(300), ANNA), seconds=2)
    room.stay(seconds=0.6)
    assert room.stay((at(300), BEN), seconds=2) == ["t2"]


def test_light_of_another_level_is_no_other_person():
    room = Room()
    room.stay((at(300), ANNA), seconds=2)
    assert room.stay((at(300), ANNA), seconds=2, light=0.7) == ["t1"]
    room.stay(seconds=5)
    assert room.stay((at(100), ANNA), seconds=2, light=1.2) == ["t1"]


def test_people_who_cross_keep_their_ids():
    room = Room()
    before = room.stay((at(100, h=220), ANNA), (at(500, y=110, h=260), BEN), seconds=0.5)
    for step in range(41):
        room.show((at(100 + 10 * step, h=220), ANNA), (at(500 - 10 * step, y=110, h=260), BEN))
    assert room.stay((at(500, h=220), ANNA), (at(100, y=110, h=260), BEN), seconds=1) == before[::-1]


def test_people_who_meet_and_turn_back_keep_their_ids():
    room = Room()
    before = room.stay((at(100, h=220), ANNA), (at(480, y=110, h=260), BEN), seconds=0.5)
    for step in [*range(20), *reversed(range(20))]:
        room.show((at(100 + 10 * step, h=220), ANNA), (at(480 - 10 * step, y=110, h=260), BEN))
    assert room.stay((at(100, h=220), ANNA), (at(480, y=110, h=260), BEN), seconds=1) == before


def test_person_who_steps_out_from_behind_another_takes_no_foreign_id():
    room = Room()
    before = room.stay((at(300, h=220), ANNA), (at(420, y=110, h=260), BEN), seconds=1)
    for step in range(12):
        room.show((at(300, h=220), ANNA), (at(420 - 10 * step, y=110, h=260), BEN))
    room.stay((at(300, h=220), ANNA), (at(302, y=110, h=260), BEN), seconds=1)
    assert room.stay((at(300, h=220), ANNA), seconds=1) == before[:1]


def test_two_people_in_the_same_clothes_keep_two_ids():
    room = Room()
    assert room.stay((at(100), ANNA), (at(400), ANNA), seconds=2) == ["t1", "t2"]
    room.stay((at(100), ANNA), seconds=3)
    assert room.stay((at(100), ANNA), (at(400), ANNA), seconds=2)[0] == "t1"
    room.stay(seconds=3)
    back = room.stay((at(100), ANNA), (at(400), ANNA), seconds=2)
    assert len(set(back)) == 2


def test_person_in_clothes_of_two_others_is_not_guessed():
    room = Room()
    room.stay((at(100), ANNA), (at(400), ANNA), seconds=2)
    room.stay(seconds=3)
    assert room.stay((at(250), ANNA), seconds=1) == ["t3"]


def test_without_looks_nobody_is_recognised():
    room = Room()
    room.stay((at(100), ANNA), seconds=2)
    room.stay(seconds=5)
    boxes, tracks = np.array([at(100)]), ()
    for _ in range(3):
        room.time_s += 0.1
        tracks = room.tracker.update(round(room.time_s * SECOND), boxes, np.array([0.9]), SIZE)
    assert ids(tracks) == ["t2"]


def test_new_recording_forgets_everybody():
    room = Room()
    room.stay((at(100), ANNA), seconds=2)
    room.time_s = 0.0
    assert room.stay((at(100), ANNA), seconds=1) == ["t2"]


def test_memory_is_bounded():
    room, random = Room(remember_s=600.0), np.random.default_rng(5)
    for _ in range(45):
        shirt, trousers = random.integers(20, 235, (2, 3)).tolist()
        room.stay((at(float(random.uniform(50, 500))), (tuple(shirt), tuple(trousers))), seconds=0.4)
        room.show(after_s=2.5)
    assert len(room.tracker._lost.people) <= 32
    assert all(len(person.met) <= 33 and len(person.appearance._exemplars) <= 6 for person in room.tracker._lost.people)


def test_mostly_covered_cut_off_dark_and_small_people_show_no_colours():
    people = [(at(200), ANNA), (at(210, y=140), BEN), (at(-80), CLEO), (at(500, h=24), ANNA)]
    boxes = np.array([box for box, _ in people])
    boxes[2] = (0, 120, 16, 240)
    looks = looks_of(picture(*people), boxes)
    assert np.isnan(looks).all(axis=(1, 2)).tolist() == [True, False, True, True]
    assert np.isnan(looks_of(picture((at(200), ANNA), light=0.1), boxes[:1])).all()


@pytest.mark.parametrize("beside", [60.0, -60.0])
def test_partly_covered_person_shows_the_colours_of_the_free_side(beside):
    people = [(at(200), ANNA), (at(200 + beside, y=140), BEN)]
    anna, ben = looks_of(picture(*people), np.array([box for box, _ in people]))
    (whole,) = looks_of(picture(people[0]), np.array([people[0][0]]))
    own, other = Appearance([whole]).distances(np.stack([anna, ben]))
    assert own < 0.1 < 0.5 < other


@pytest.mark.parametrize("x", [-48.0, SIZE[0] - 48.0])
def test_person_at_the_edge_shows_the_colours_of_the_visible_side(x):
    box = clip(np.array([at(x)]), *SIZE)
    (look,) = looks_of(picture((at(x), ANNA)), box)
    (whole,) = looks_of(picture((at(300), ANNA)), np.array([at(300)]))
    assert Appearance([whole]).distances(look[None])[0] < 0.02


def test_box_with_covered_colours_must_fit_a_track_better():
    (look,) = looks_of(picture((at(300), ANNA)), np.array([at(300)]))

    def goes_on(shift: float, last: np.ndarray) -> bool:
        tracker = Tracker(0.5, 0.15)
        for step in range(10):
            tracker.update(step * SECOND // 10, np.array([at(300)]), np.array([0.7]), SIZE, look[None])
        tracks = tracker.update(SECOND, np.array([at(300 + shift)]), np.array([0.7]), SIZE, last[None])
        return any(track.id == "t1" and track.unseen_s == 0 for track in tracks)

    shifts = range(20, 120, 4)
    own, covered = (sum(goes_on(shift, last) for shift in shifts) for last in (look, np.full_like(look, np.nan)))
    assert 0 < covered < own


def test_people_who_come_back_in_another_order_keep_their_ids_from_the_edge_on():
    room = Room()

    def enter(who: Clothes) -> list[str]:
        """The ids of a person who walks in from the left."""
        seen = [ids(room.show((at(x), who))) for x in range(-40, 200, 9)]
        return [each for shown in seen for each in shown]

    first = [set(enter(who)) for who in (ANNA, BEN, CLEO) if room.stay(seconds=3) == []]
    assert [len(each) for each in first] == [1, 1, 1]
    again = [set(enter(who)) for who in (CLEO, ANNA, BEN) if room.stay(seconds=3) == []]
    assert again == [first[2], first[0], first[1]]


def test_track_that_shows_somebody_in_similar_clothes_gets_another_id():
    room, dark_red = Room(), (75, 60, 135)
    room.stay((at(300), (RED, BLACK)), seconds=2)
    for _ in range(2):
        room.show()
    assert room.stay((at(300), (dark_red, BLACK)), seconds=1) == ["t2"]


def test_person_in_similar_clothes_is_not_recognised():
    room, other_red = Room(), (66, 55, 175)
    room.stay((at(300), (RED, BLACK)), seconds=2)
    room.stay(seconds=5)
    assert room.stay((at(300), (other_red, BLACK)), seconds=1) == ["t2"]


def test_second_person_in_other_clothes_close_to_one_gets_an_id_with_two_detections():
    room = Room()
    room.stay((at(300), ANNA), seconds=1)
    pair = (at(300), ANNA), (at(350, y=130), BEN)
    assert [sum(bool(track.id) for track in room.show(*pair)) for _ in range(3)] == [1, 2, 2]


def test_person_cut_off_at_the_waist_shows_the_upper_body():
    box, image = (200.0, 240.0, 200.0, 240.0), picture(((200.0, 240.0, 200.0, 500.0), ANNA))
    (look,) = looks_of(image, np.array([box]))
    assert np.isnan(look).all(axis=1).tolist() == [False, True]
    (whole,) = looks_of(picture((at(100), ANNA)), np.array([at(100)]))
    assert Appearance([whole]).distances(look[None])[0] < 0.1


def test_boxes_between_two_pixels_are_rounded():
    image = picture((at(100), ANNA))
    boxes = [(100.0, y, 14.0, height) for height in np.arange(31.0, 34.0, 0.25) for y in (100.0, 100.5, 101.75)]
    assert all(not np.isnan(looks_of(image, np.array([box]))).any() for box in boxes)


def test_looks_do_not_depend_on_the_order_of_boxes():
    image = picture((at(100), ANNA), (at(400), BEN))
    boxes = np.array([at(100), at(400)])
    assert np.array_equal(looks_of(image, boxes), looks_of(image, boxes[::-1])[::-1])
    assert looks_of(image, boxes[:0]).shape[0] == 0


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(st.floats(-80, 640), st.floats(-80, 480), st.floats(1, 300), st.floats(1, 500)), max_size=5))
def test_looks_of_any_boxes_are_unit_vectors_or_unknown(found):
    boxes = np.array(found, float).reshape(-1, 4)
    image = np.random.default_rng(1).integers(0, 255, (480, 640, 3), np.uint8)
    looks = looks_of(image, boxes)
    norms = np.linalg.norm(looks, axis=2)
    assert np.all(np.isnan(norms) | (np.abs(norms - 1) < 1e-3))
    for look in looks:
        far = float(Appearance(look[None]).distances(look[None])[0])
        assert far < 1e-3 or np.isinf(far), "a look equals itself, unless nothing is known of it"


def test_same_images_give_the_same_ids():
    def run() -> list[list[str]]:
        room, random, seen = Room(), np.random.default_rng(2), []
        for _ in range(40):
            who = [each for each in (ANNA, BEN, CLEO) if random.random() < 0.7]
            seen.append(ids(room.show(*[(at(float(random.uniform(0, 560))), each) for each in who])))
        return seen

    assert run() == run()


def looks_of_one(clothes: Clothes) -> np.ndarray:
    """The looks of one whole person, shape (1, 2, bins)."""
    return looks_of(picture((at(300), clothes)), np.array([at(300)]))


class Street:
    """A tracker of one box at a time, with any look."""

    def __init__(self) -> None:
        self.tracker, self.step = Tracker(0.5, 0.15), 0

    def show(self, x: float, look: np.ndarray, skipped: int = 0) -> list[str]:
        """The ids of detected tracks in the next image, a tenth of a second later."""
        self.step += 1 + skipped
        box, score = np.array([at(x)]), np.array([0.9])
        tracks = self.tracker.update(self.step * SECOND // 10, box, score, SIZE, look)
        return [track.id for track in tracks if not track.unseen_s]


def test_person_who_steps_in_front_of_another_does_not_take_the_track():
    street = Street()
    assert [street.show(300, looks_of_one(ANNA)) for _ in range(10)] == [["t1"]] * 10
    assert street.show(330, looks_of_one(BEN)) != ["t1"]


def test_light_that_changes_all_colours_ends_no_track():
    street = Street()
    for _ in range(10):
        street.show(300, looks_of_one(ANNA))
    assert [street.show(300, looks_of_one(BEN)) for _ in range(10)] == [["t1"]] * 10


def test_person_who_comes_back_at_the_edge_has_no_other_id_before():
    street, anna = Street(), looks_of_one(ANNA)
    for _ in range(10):
        street.show(300, anna)
    seen = [street.show(-40, np.full_like(anna, np.nan), skipped=40), street.show(-30, np.full_like(anna, np.nan))]
    seen += [street.show(-20 + 10 * step, anna) for step in range(5)]
    assert [each for each in seen if each != [""]] == [["t1"]] * 5


def test_unknown_person_at_the_edge_waits_for_an_id_at_most_a_moment():
    street, anna = Street(), looks_of_one(ANNA)
    for _ in range(10):
        street.show(300, anna)
    seen = [street.show(-40, np.full_like(anna, np.nan), skipped=40)]
    seen += [street.show(-40, np.full_like(anna, np.nan)) for _ in range(9)]
    assert seen[:6] == [[""]] * 6
    assert seen[7:] == [["t2"]] * 3


def continues(height: float, look: np.ndarray, last: np.ndarray, shift: float) -> bool:
    """Whether a track of boxes of a ``height`` goes on with the look ``last``, moved by this share of the width."""
    tracker, box = Tracker(0.5, 0.15), at(300, h=height)
    for step in range(10):
        tracker.update(step * SECOND // 10, np.array([box]), np.array([0.7]), SIZE, look[None])
    moved = np.array([at(300 + 0.4 * height * shift, h=height)])
    tracks = tracker.update(SECOND, moved, np.array([0.7]), SIZE, last[None])
    return any(track.id == "t1" and track.unseen_s == 0 for track in tracks)


def unlike(look: np.ndarray, far: float) -> np.ndarray:
    """A look at the distance ``far`` of another one, (2, bins)."""
    rest = np.zeros_like(look)
    rest[np.arange(len(look)), np.argmin(look, axis=1)] = 1.0
    return ((1 - far) * look + np.sqrt(1 - (1 - far) ** 2) * rest).astype(np.float32)


def test_colours_of_fewer_pixels_count_less():
    (look,) = looks_of_one(ANNA)
    limits = []
    for height in (240.0, 80.0, 40.0, 32.0):
        goes_on = [continues(height, look, unlike(look, far), shift=0.4) for far in np.arange(0.2, 0.6, 0.02)]
        assert goes_on == sorted(goes_on, reverse=True), "the more unlike, the less it continues"
        limits.append(sum(goes_on))
    assert 0 < limits[0] < limits[1] < limits[2] < limits[3]


def test_colours_that_a_few_pixels_would_not_show_are_no_evidence():
    (look,) = looks_of_one(ANNA)
    unknown, shifts = np.full_like(look, np.nan), np.arange(0, 2, 0.05)

    def lost(height: float) -> int:
        """For how many shifts a track goes on with its own colours only."""
        own, hidden = (sum(continues(height, look, last, shift) for shift in shifts) for last in (look, unknown))
        return own - hidden

    assert lost(240.0) > lost(36.0) > lost(28.0) == 0


@pytest.mark.parametrize("height", [50.0, 80.0, 240.0])
def test_few_pixels_explain_the_distance_between_looks_of_one_person(height):
    box = np.array([at(300, h=height)])
    looks = [looks_of(picture((at(300, h=height), ANNA), seed=seed), box)[0] for seed in range(30)]
    far = Appearance(looks[:1]).distances(np.array(looks[1:]))
    assert np.quantile(far, 0.9) <= noise_of(box)[0]


def test_person_who_shows_little_at_first_is_not_taken_for_another_for_long():
    street, dark, bright = Street(), looks_of_one((BLACK, BLACK)), looks_of_one((BEIGE, BLUE))
    hair = dark.copy()
    hair[:, 1] = np.nan
    for _ in range(10):
        street.show(300, dark)
    first = [street.show(200, hair, skipped=40), *(street.show(200, hair) for _ in range(3))]
    assert first[-1] == ["t1"]
    assert [street.show(200, bright) for _ in range(10)][-1] not in ([], ["t1"])
    assert [street.show(400, dark, skipped=40), *(street.show(400, dark) for _ in range(10))][-1] == ["t1"]
