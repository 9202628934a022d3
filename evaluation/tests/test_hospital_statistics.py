from __future__ import annotations

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluation.hospital_statistics import (
    Interval,
    binomial,
    fit,
    growth,
    growth_interval,
    mean_interval,
    t_quantile,
    wilson,
)


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    [(30, 30, 0.8865, 1.0), (0, 30, 0.0, 0.1135), (15, 30, 0.3315, 0.6685), (4, 30, 0.0531, 0.2968)],
)
def test_wilsons_interval_is_as_in_the_books(count, of, low, high):
    assert wilson(count, of) == pytest.approx((low, high), abs=1e-4)


@given(st.integers(1, 200).flatmap(lambda of: st.tuples(st.integers(0, of), st.just(of))))
def test_wilsons_interval_holds_the_share_and_is_the_same_from_the_other_side(pair):
    count, of = pair
    low, high = wilson(count, of)
    assert 0.0 <= low <= count / of <= high <= 1.0
    assert wilson(of - count, of) == pytest.approx((1.0 - high, 1.0 - low))


@pytest.mark.parametrize(("count", "of"), [(0, 0), (-1, 5), (6, 5)])
def test_an_invalid_share_is_an_error(count, of):
    with pytest.raises(ValueError, match="no share"):
        wilson(count, of)


@pytest.mark.parametrize(
    ("share", "of", "low", "high"), [(0.0, 30, 0, 0), (1.0, 30, 30, 30), (0.5, 30, 10, 20), (0.1, 30, 0, 7)]
)
def test_counts_to_be_expected(share, of, low, high):
    assert binomial(share, of) == (low, high)


@given(st.floats(0.0, 1.0), st.integers(1, 60))
def test_no_more_than_a_twentieth_of_all_draws_is_outside_what_is_expected(share, of):
    low, high = binomial(share, of)
    weights = [math.comb(of, k) * share**k * (1 - share) ** (of - k) for k in range(of + 1)]
    assert sum(weights[: int(low)]) <= 0.0251
    assert sum(weights[int(high) + 1 :]) <= 0.0251


@pytest.mark.parametrize(("freedom", "t"), [(3, 3.182), (5, 2.571), (10, 2.228), (29, 2.045), (178, 1.973)])
def test_the_quantile_of_students_t_is_two_sided(freedom, t):
    assert t_quantile(freedom) == pytest.approx(t, abs=0.001)


def test_the_interval_of_a_mean():
    assert mean_interval([1.0, 2.0, 3.0]) is None
    found = mean_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    assert found is not None
    assert found == pytest.approx((3.0 - 1.963, 3.0 + 1.963), abs=0.02)


def test_a_line_is_found_with_its_slope_in_the_interval():
    chance = random.Random(1)
    points = [(x, 4.2 + 0.3 * x + chance.gauss(0.0, 0.05)) for x in (0.0, 1.0) for _ in range(50)]
    line = fit(points)
    assert line is not None
    assert 0.3 in line.interval
    assert line.slope in line.interval
    assert line.interval.high - line.interval.low < 0.06
    assert line.start == pytest.approx(4.2, abs=0.03)


def test_a_line_through_points_that_are_on_one_is_exact():
    line = fit([(x, 1.0 + 2.0 * x) for x in range(6)])
    assert line is not None
    assert (line.start, line.slope) == pytest.approx((1.0, 2.0))
    assert line.interval == pytest.approx((2.0, 2.0))


@pytest.mark.parametrize("points", [[(0.0, 1.0)] * 4, [(1.0, 1.0), (1.0, 2.0)] * 3])
def test_there_is_no_line_through_few_points_or_one_above_the_other(points):
    assert fit(points) is None


def test_growth_weighs_missions_with_and_without_a_problem():
    assert growth([4.0, 4.2], [4.5, 4.7], 0.1, 1.0) == pytest.approx(100.0 * (4.6 / (0.9 * 4.1 + 0.1 * 4.6) - 1.0))
    assert growth([4.0], [4.0], 0.1, 1.0) == 0.0


def test_the_interval_of_growth_holds_it_and_is_the_same_each_time():
    without, with_ = [4.2, 4.3, 4.25, 4.22, 4.28], [4.5, 4.6, 4.55, 4.49, 4.61]
    found = growth_interval(without, with_, 0.1, 1.0)
    assert found is not None
    assert growth(without, with_, 0.1, 1.0) in found
    assert found == growth_interval(without, with_, 0.1, 1.0)
    assert found.high - found.low < 3.0
    assert growth_interval(without[:3], with_, 0.1, 1.0) is None


def test_nan_is_in_no_interval():
    assert "a" not in Interval(0.0, 1.0)
