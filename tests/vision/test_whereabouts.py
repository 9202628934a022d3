from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.core.clock import SECOND
from socialbot.vision.distance import Estimate
from socialbot.vision.whereabouts import FloorPoint, LastSeen


def misfit(
    x: float, y: float, seconds: float, velocity: tuple[float, float] | None = None, std_m: float = 0.1
) -> float:
    """Misfit of a place, of somebody who was seen 4 m ahead before so many ``seconds``."""
    seen = LastSeen(SECOND, FloorPoint(4.0, 0.0, std_m), velocity or (0.0, 0.0))
    found = seen.misfit(round((1 + seconds) * SECOND), FloorPoint(x, y, std_m))
    assert found is not None
    return found


def test_place_is_in_the_base():
    place = FloorPoint.at(Estimate(2.0, 0.3), math.pi / 2)
    assert (place.x, place.y, place.std_m) == pytest.approx((0.0, 2.0, 0.3))


def test_place_of_long_ago_says_nothing():
    seen, here = LastSeen(SECOND, FloorPoint(1.0, 0.0, 0.1)), FloorPoint(1.0, 0.0, 0.1)
    assert seen.misfit(31 * SECOND, here) == 0
    assert seen.misfit(32 * SECOND, here) is None


def test_who_stood_is_expected_where_they_were():
    away = [misfit(4.0, y, 3.0) for y in (0.0, 0.5, 1.0, 2.0, 4.0)]
    assert away[0] == 0
    assert all(first < second for first, second in pairwise(away))
    assert away[2] < 1 < away[3]


def test_who_walked_is_expected_on_their_way():
    walking = (0.0, 1.2)
    assert misfit(4.0, 0.0, 3.0, walking) == pytest.approx(0), "they may have stopped"
    assert misfit(4.0, 3.6, 3.0, walking) == pytest.approx(0), "or have gone on"
    assert misfit(4.0, 3.6, 3.0) > 1
    assert misfit(4.0, -2.5, 3.0, walking) > 1, "but have hardly turned round"
    assert misfit(4.0, 15.0, 20.0, walking) > 1, "and nobody goes on for so long"


def test_search_widens_with_time_up_to_a_limit():
    away = [misfit(4.0, 2.0, seconds) for seconds in (2.0, 4.0, 5.25, 8.0, 20.0)]
    assert away[0] > away[1] > away[2] == away[3] == away[4]


def test_uncertain_distances_widen_the_search():
    assert misfit(6.0, 0.0, 2.0, std_m=0.8) < 1 < misfit(6.0, 0.0, 2.0, std_m=0.1)


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 10), st.floats(-math.pi, math.pi), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_nobody_is_farther_than_people_run(seconds, direction, across, along):
    reach = 2.5 * seconds + 1.1
    x, y = 4.0 + reach * math.cos(direction), reach * math.sin(direction)
    assert misfit(x, y, seconds, (across, along)) == math.inf
    assert misfit(4.0 + 0.9 * (x - 4.0) * seconds / 11, 0.9 * y * seconds / 11, seconds) < math.inf
