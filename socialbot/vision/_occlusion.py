"""Boxes of people whom nearer people hide in part."""

from __future__ import annotations

import numpy as np

# A person occludes the feet of another one who shares this part of their width and whose box ends higher by this share.
_HIDING, _NEARER = 0.5, 0.1
USUAL_ASPECT = 0.3  # Usual width of people who stand, as a share of their height.
_LOWER = 0.02  # The box of a nearer person ends lower by this share of the height,
_ALONG = 0.5  # is beside this share of it,
_GAP = 0.1  # and not farther away than this share of the usual width.


def feet_are_hidden(box: np.ndarray, others: np.ndarray) -> bool:
    """Whether one of ``others`` (n, 4) occludes the lower end of ``box``."""
    right, bottom = others[:, 0] + others[:, 2], others[:, 1] + others[:, 3]
    end = box[1] + box[3]
    shared = np.minimum(box[0] + box[2], right) - np.maximum(box[0], others[:, 0])
    nearer = (others[:, 1] < end) & (bottom > end + _NEARER * box[3])
    return bool((nearer & (shared > _HIDING * box[2])).any())


def with_hidden_side(box: np.ndarray, height: float, others: np.ndarray) -> tuple[float, float]:
    """Extend a narrow box into that of the nearer person who hides one of its sides.

    Args:
        box: Visible part of a person as x, y, w, h in pixels.
        height: Height of the whole person, px.
        others: Boxes of the people in the image (n, 4), which may include ``box``.

    Returns:
        Left edge and width. They are those of ``box`` if nobody, or somebody on each side, hides the person.
    """
    left, top, width, h = box.tolist()
    right, bottom, usual = left + width, top + h, USUAL_ASPECT * height
    ends = others[:, 1] + others[:, 3]
    beside = np.minimum(bottom, ends) - np.maximum(top, others[:, 1])
    nearer = others[(ends > bottom + _LOWER * h) & (beside >= _ALONG * h)]
    first, last, gap = nearer[:, 0], nearer[:, 0] + nearer[:, 2], _GAP * usual
    on_right = last[(left < first) & (first <= right + gap) & (right < last)]
    on_left = first[(last < right) & (left - gap <= last) & (first < left)]
    if width < usual and len(on_right) and not len(on_left):
        return left, max(width, min(usual, float(on_right.max()) - left))
    if width < usual and len(on_left) and not len(on_right):
        left = min(left, max(right - usual, float(on_left.min())))
    return left, right - left
