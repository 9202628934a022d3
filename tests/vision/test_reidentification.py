"""Lost people are known again by where they were and by their colours."""

from __future__ import annotations

import numpy as np
import pytest

from socialbot.core.clock import SECOND
from socialbot.vision.motion import Cut
from socialbot.vision.tracking import Tracker
from socialbot.vision.whereabouts import FloorPoint, LastSeen
from tests.vision.scenes import SIZE, ids

TURN = np.array([[1.0, 0.0, -80.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
UNKNOWN = np.full((2, 256), np.nan, np.float32)


def look(*shares: float) -> np.ndarray:
    """A look with these shares of the colours."""
    each = np.zeros(256, np.float32)
    each[: len(shares)] = np.sqrt(np.array(shares) / sum(shares))
    return np.array([each, each])


RED, GREEN = look(1.0), look(0.0, 1.0)


def unlike(far: float) -> np.ndarray:
    """A look at the distance ``far`` of `RED`."""
    return look((1 - far) ** 2, 0.0, 1 - (1 - far) ** 2)


class TurningView:
    """Tracker of a camera that turns, with five images a second."""

    def __init__(self, *, turns: bool = True, knows_places: bool = True) -> None:
        self.tracker = Tracker(0.5, 0.15)
        self.turns, self.knows_places = turns, knows_places
        self.stamp = 0

    def show(self, *people: tuple[float, np.ndarray, float], turn: np.ndarray | None = None) -> list[str]:
        """Show people: x in the image, their look, and how far they are to the left of a point 4 m ahead (m).

        Returns:
            Their ids, from left to right.
        """
        self.stamp += SECOND // 5
        boxes = np.array([(x, 120.0, 96.0, 240.0) for x, _, _ in people]).reshape(-1, 4)
        points = {x: FloorPoint(4.0, left_m, 0.1) for x, _, left_m in people}

        def locate(box: np.ndarray, cut: Cut) -> FloorPoint:
            return points[box[0]]

        tracks = self.tracker.update(
            self.stamp,
            boxes,
            np.full(len(boxes), 0.7),
            SIZE,
            np.array([each for _, each, _ in people]).reshape(-1, *UNKNOWN.shape),
            turn,
            locate if self.knows_places else None,
        )
        seen = [each for each in tracks if not each.unseen_s]
        for track in seen if self.knows_places else ():
            self.tracker.place(track.id, LastSeen(self.stamp, points[track.box[0]]))
        return ids(tuple(sorted(seen, key=lambda track: track.box[0])))

    def stay(self, *people: tuple[float, np.ndarray, float], images: int = 10) -> list[str]:
        return [self.show(*people) for _ in range(images)][-1]

    def look_away(self, images: int = 15) -> None:
        for _ in range(images):
            self.show(turn=TURN if self.turns else None)


def found_again(far: float, left_m: float, **how: bool) -> str:
    """Id of somebody whose look has the distance ``far`` from that of a person t1, who was left for 3 s."""
    view = TurningView(**how)
    view.stay((300, RED, 0.0))
    view.look_away()
    return view.stay((100, unlike(far), left_m))[0]


@pytest.mark.parametrize(
    ("far", "left_m", "expected"),
    [
        (0.17, 0.2, "t1"),
        (0.17, 2.3, "t2"),
        (0.24, 1.5, "t2"),
        (0.3, 0.2, "t2"),
        (0.02, 2.3, "t1"),
        (0.02, 20.0, "t2"),
    ],
)
@pytest.mark.parametrize("turns", [True, False])
def test_lost_person_is_known_by_place_and_look(far: float, left_m: float, expected: str, turns: bool):
    assert found_again(far, left_m, turns=turns) == expected


@pytest.mark.parametrize(("far", "expected"), [(0.02, "t1"), (0.17, "t2")])
def test_look_alone_counts_without_places(far: float, expected: str):
    assert found_again(far, 0.2, knows_places=False) == expected


def test_second_box_around_a_person_that_outlives_the_first_one_keeps_the_id():
    view = TurningView(knows_places=False)
    view.stay((300, RED, 0.0))
    assert view.show((300, RED, 0.0), (360, RED, 0.0)) == ["t1"]
    assert [view.show((x, RED, 0.0)) for x in (380, 400, 420, 440)][1:] == [["t1"]] * 3


def test_neighbour_in_the_same_clothes_keeps_their_own_id():
    view = TurningView(knows_places=False)
    view.stay((100, RED, 0.0))
    assert view.show((100, RED, 0.0), (360, RED, 0.0)) == ["t1"]
    assert [view.show((x, RED, 0.0)) for x in (380, 400, 420, 440)][1:] == [["t2"]] * 3


@pytest.mark.parametrize("turns", [True, False])
def test_person_without_known_colours_is_not_taken_for_a_lost_one_nearby(turns: bool):
    view = TurningView(turns=turns)
    view.stay((300, RED, 0.0))
    view.look_away()
    assert view.stay((100, UNKNOWN, 0.2)) == ["t2"]


def test_look_of_another_lost_person_counts_more_than_a_place():
    view = TurningView()
    assert view.stay((100, RED, 0.0), (400, unlike(0.22), 5.0)) == ["t1", "t2"]
    view.look_away()
    assert view.stay((300, unlike(0.22), 0.2)) == ["t2"]


def test_newcomer_does_not_take_the_place_of_a_lost_person_along():
    view = TurningView()
    view.stay((300, RED, 0.0))
    view.look_away()
    assert view.stay((100, unlike(0.2), 1.0), images=2) == ["t1"]
    assert view.stay((100, GREEN, 6.0), images=8) == ["t2"]
    view.look_away(10)
    assert view.stay((100, unlike(0.2), 0.1)) == ["t1"]


def test_person_known_by_place_may_turn_round_later():
    view = TurningView()
    view.stay((300, RED, 0.0))
    view.look_away()
    assert view.stay((100, unlike(0.2), 0.2), images=7) == ["t1"]
    for far in (0.28, 0.36, 0.44, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5):
        assert view.show((100, unlike(far), 0.2)) == ["t1"]


def test_proof_of_a_recognition_goes_on_in_the_next_track():
    view = TurningView()
    view.stay((300, RED, 0.0))
    view.look_away()
    assert view.stay((100, unlike(0.2), 0.2), images=2) == ["t1"]
    # A jump in the image begins a new track, which is known by its look alone.
    seen = [view.show((420, unlike(far), 0.2)) for far in (*[0.2] * 4, 0.35, 0.5, 0.65, *[0.8] * 6)]
    assert seen[1:] == [["t1"]] * 12


def test_person_known_by_place_who_soon_looks_otherwise_gets_a_new_id():
    view = TurningView()
    view.stay((300, RED, 0.0))
    view.look_away()
    assert view.stay((100, unlike(0.2), 0.2), images=2) == ["t1"]
    assert view.stay((100, unlike(0.36), 0.2), images=5) == ["t2"]


def test_places_are_unknown_after_the_base_has_moved():
    view = TurningView()
    view.stay((300, RED, 0.0))
    view.look_away()
    view.tracker.forget_places()
    assert view.stay((100, unlike(0.17), 0.2)) == ["t2"]
