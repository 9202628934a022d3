"""Weights of readings are learned from the records that they reach."""

from __future__ import annotations

import numpy as np

from evaluation.train_questions import Example, learned, measured


def example(columns: list[list[int]], reached: list[bool], known: list[bool]) -> Example:
    rows = [row for row, features in enumerate(columns) for _ in features]
    return Example(
        "list", "", np.array(rows), np.array([one for features in columns for one in features]),
        np.ones(len(rows)), np.array(reached), np.array(known), np.arange(len(reached)),
    )  # fmt: skip


# Feature 0: the right deed, 1: another deed, 2: the refusal, 3: an unexplained word
RIGHT = example([[0], [1], [2]], [True, False, False], [True, True, False])
REFUSED = example([[0, 3], [1, 3], [2, 3]], [False, False, True], [True, True, False])


def test_readings_that_reach_the_record_become_most_likely():
    weights = learned([RIGHT] * 5, 4)
    assert weights[0] > weights[2] > weights[1]
    assert measured([RIGHT], weights) == (1, 0)


def test_wrong_answers_cost_more_than_a_refusal():
    weights = learned([RIGHT, REFUSED] * 3, 4)
    doubtful = example([[1], [2]], [False, False], [True, False])
    assert measured([doubtful], weights) == (0, 0)


def test_questions_without_a_reading_that_reaches_teach_nothing():
    lost = example([[0], [2]], [False, False], [True, False])
    assert (learned([RIGHT, RIGHT, lost], 4) == learned([RIGHT, RIGHT], 4)).all()
