from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from socialbot.vision.tracking import assign


def least(costs: np.ndarray, limit: float) -> float:
    """The least sum of all assignments, found by trying every one; who stays alone costs ``limit``."""
    rows, columns = costs.shape
    if rows > columns:
        return least(costs.T, limit)
    bounded = np.minimum(costs, limit)
    return min(
        sum(bounded[row, column] for row, column in enumerate(order))
        for order in itertools.permutations(range(columns), rows)
    )


@settings(deadline=None, max_examples=300)
@given(arrays.arrays(np.float64, st.tuples(st.integers(1, 5), st.integers(1, 5)), elements=st.integers(0, 8)))
def test_no_other_assignment_costs_less(eighths):
    costs = eighths / 8
    pairs = assign(costs, 0.8)
    alone = min(costs.shape) - len(pairs)
    assert abs(sum(costs[pair] for pair in pairs) + 0.8 * alone - least(costs, 0.8)) < 1e-6


@settings(deadline=None)
@given(arrays.arrays(np.float64, st.tuples(st.integers(0, 30), st.integers(0, 30)), elements=st.floats(0, 2)))
def test_each_row_and_column_is_assigned_once_below_the_limit(costs):
    pairs = assign(costs, 1.0)
    assert len({row for row, _ in pairs}) == len({column for _, column in pairs}) == len(pairs)
    assert all(costs[pair] < 1.0 for pair in pairs)
    assert pairs == sorted(pairs)


def test_one_good_pair_beats_two_bad_pairs():
    costs = np.array([[0.1, 0.9], [0.95, np.inf]])
    assert assign(costs, 1.0) == [(0, 0)]


def test_two_fair_pairs_are_better_than_one_good_pair_and_a_bad_one():
    assert assign(np.array([[0.1, 0.2], [0.2, 0.9]]), 1.0) == [(0, 1), (1, 0)]


def test_no_pairs_above_the_limit():
    assert assign(np.full((3, 2), np.inf), 1.0) == []
    assert assign(np.ones((1, 1)), 1.0) == []


def test_equal_costs_assign_all_rows():
    assert len(assign(np.full((20, 20), 0.5), 1.0)) == 20
