"""Who belongs to whom: pairs of rows and columns that together cost least."""

from __future__ import annotations

import cv2
import numpy as np

__all__ = ["assign"]


def assign(costs: np.ndarray, limit: float) -> list[tuple[int, int]]:
    """The pairs (row, column) of ``costs``, shape (n, m), with the least sum, each row and column at most once.

    A pair that costs ``limit`` or more is none; staying alone costs as much as ``limit``. Pairs come in the order
    of rows. Infinite costs are allowed.
    """
    rows, columns = costs.shape
    if not rows or not columns:
        return []
    # Moving one heap of earth from each row to some column, in whole heaps, is the assignment problem.
    bounded = np.minimum(costs, limit).astype(np.float32)
    flow = cv2.EMD(_heaps(rows), _heaps(columns), cv2.DIST_USER, bounded)[2]
    return [(int(row), int(column)) for row, column in np.argwhere(flow > 0.5) if costs[row, column] < limit]


def _heaps(count: int) -> np.ndarray:
    """So many heaps of weight 1; where they lie (the second column) does not matter."""
    return np.tile(np.array([1, 0], np.float32), (count, 1))
