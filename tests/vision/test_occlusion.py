"""Boxes of people whom nearer people hide in part."""

from __future__ import annotations

import numpy as np
import pytest

from socialbot.vision._occlusion import with_hidden_side

WHOLE = np.array([100.0, 100.0, 60.0, 200.0])


def extended(box: list[float], *others: list[float], height: float = 200.0) -> tuple[float, float]:
    return with_hidden_side(np.array(box), height, np.array([box, *others]))


@pytest.mark.parametrize("gap", [-10.0, 0.0, 5.0], ids=["over it", "at its edge", "with a gap"])
def test_a_strip_beside_a_nearer_person_is_extended_to_the_usual_width(gap):
    left, top, _, height = WHOLE.tolist()
    strip = [left, top, 25.0, height]
    assert extended(strip, [left + 25.0 + gap, 80.0, 90.0, 300.0]) == (left, 60.0)
    assert extended(strip, [left - 90.0 - gap, 80.0, 90.0, 300.0]) == (left - 35.0, 60.0)


def test_the_person_lies_behind_the_nearer_one():
    assert extended([100.0, 100.0, 25.0, 200.0], [120.0, 80.0, 30.0, 300.0]) == (100.0, 50.0)


def test_the_usual_width_is_that_of_the_whole_height():
    near = [125.0, 80.0, 90.0, 300.0]
    assert extended([100.0, 100.0, 25.0, 150.0], near, height=200.0) == (100.0, 60.0)


@pytest.mark.parametrize(
    "others",
    [
        [],
        [[125.0, 80.0, 90.0, 200.0]],
        [[140.0, 80.0, 90.0, 300.0]],
        [[125.0, 260.0, 90.0, 300.0]],
        [[125.0, 80.0, 90.0, 300.0], [5.0, 80.0, 100.0, 300.0]],
        [[90.0, 80.0, 90.0, 300.0]],
    ],
    ids=["nobody", "farther", "apart", "below", "on both sides", "around it"],
)
def test_a_strip_stays_if_no_nearer_person_hides_one_side(others):
    assert extended([100.0, 100.0, 25.0, 200.0], *others) == (100.0, 25.0)


def test_a_box_of_the_usual_width_stays():
    assert extended([100.0, 100.0, 70.0, 200.0], [160.0, 80.0, 90.0, 300.0]) == (100.0, 70.0)
