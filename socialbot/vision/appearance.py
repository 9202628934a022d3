"""Appearance of people: colours of the upper body and of the legs, to tell people apart for a minute or two."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from socialbot.vision.detector import shared_area

LIKE, UNLIKE, OTHER = 0.1, 0.25, 0.33
"""Distances of looks: one person usually stays below the first, other people above the second.

From the third, a box shows somebody else.
"""

_PARTS = ((0.17, 0.5), (0.5, 0.86))  # Rows of upper body and legs as shares of the height of a whole person.
_MIDDLE = (0.2, 0.8)  # Columns of a box that mostly show the person.
_SPREAD = 0.3  # The middle counts most: standard deviation of the weights, as a share of these columns.
_ROWS, _COLUMNS = 36, 12  # Pixels to which a whole person is reduced.
_FINE = 3  # Of larger images of a person, not every pixel is read.
_LEAST_PX = 8  # Narrower middles of boxes show no colours.
_TALL = 2.2  # A whole standing person is at least this many times as high as wide.
_SPACE_PX = 2  # Boxes this near to the left or right edge are cut off there:
_INNER = 0.6  # this part of their width, from the edge, shows the person,
_LEAST_ASPECT = 0.2  # unless they are narrower than this share of their height.
_NEARER = 0.02  # A box that ends lower by this share of its height is nearer, and covers the other one.
_SLIM = 0.7  # It covers this share of its width: arms and legs reach farther only in places.
_LEAST_FREE = 0.3  # Boxes cover the rest; a part shows colours if this share of its weight is free.

_NOISE_PX = 50.0  # Noise, the edges of a box and its background: distance of looks, times the area of the box.

_BINS = (4, 8, 8)  # Of CIE L*, a* and b*;
_LOW, _HIGH = (0.0, -32.0, -32.0), (100.0, 32.0, 32.0)  # their range.
_USUAL_GREY, _LEAST_GREY = 110.0, 20.0  # Images are scaled to this mean; darker ones show no colours.
_STEP = 8  # The mean is that of each such row and column.


def looks_of(image_bgr: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Colours of the people in ``boxes``, (n, 4) as x, y, w, h, in an image (height, width, 3), uint8.

    Pixels that a nearer box covers do not count.

    Returns:
        Square roots of soft histograms in CIE L*a*b*, (n, 2, bins): upper body and legs. They are NaN where a part is
        outside the image, mostly covered, too small or too dark.
    """
    looks = np.full((len(boxes), len(_PARTS), _SIZE), np.nan, np.float32)
    if not len(boxes):
        return looks
    width = image_bgr.shape[1]
    sample = image_bgr[::_STEP, ::_STEP].transpose(2, 0, 1).copy()  # by colour: its sum is found faster
    grey = int(sample.sum()) / sample.size
    if grey < _LEAST_GREY:
        return looks
    for number, box in enumerate(boxes):
        columns = _columns(box, width)
        if columns[1] > columns[0]:
            nearer = boxes[:, 1] + boxes[:, 3] > box[1] + (1 + _NEARER) * box[3]
            inner = boxes[nearer]
            if len(inner):
                inner = inner[shared_area(box, inner) > 0]
                inner = inner * (1, 1, _SLIM, 1) + inner[:, 2:3] * ((1 - _SLIM) / 2, 0, 0, 0)
            _describe(image_bgr, box, columns, inner, _USUAL_GREY / grey, looks[number])
    return looks


def noise_of(boxes: np.ndarray) -> np.ndarray:
    """Distance between looks of one person that few pixels cause, for ``boxes`` (n, 4) as x, y, w, h: shape (n,)."""
    return _NOISE_PX / np.maximum(boxes[:, 2] * boxes[:, 3], 1.0)


def clarity_of(boxes: np.ndarray) -> np.ndarray:
    """How much the colours in ``boxes`` (n, 4) can tell, from 0 for a few pixels to 1: shape (n,)."""
    return np.maximum(0.0, 1 - noise_of(boxes) / (UNLIKE - LIKE))


def _columns(box: np.ndarray, width: int) -> tuple[int, int]:
    """First and last column that mostly show the person in ``box``; empty if too little of them is in the image."""
    left, right = box[0] < _SPACE_PX, box[0] + box[2] > width - _SPACE_PX
    x = max(float(box[0]), 0.0)
    w = min(float(box[0] + box[2]), width) - x
    if (left and right) or ((left or right) and w < _LEAST_ASPECT * box[3]):
        return 0, 0
    first, last = (0.0, _INNER) if left else (1 - _INNER, 1.0) if right else _MIDDLE
    return max(0, round(x + first * w)), round(x + last * w)


def _describe(
    image_bgr: np.ndarray,
    box: np.ndarray,
    columns: tuple[int, int],
    nearer: np.ndarray,
    gain: float,
    look: np.ndarray,
) -> None:
    """Fill in the ``look`` (2, bins) of one person in ``columns`` of the image; boxes ``nearer`` (n, 4) cover them."""
    _, y, w, h = box.tolist()
    full = max(h, _TALL * w)
    left, right = columns
    part = image_bgr[max(0, round(y)) : round(y + h), left:right]
    if part.shape[1] < _LEAST_PX or part.shape[0] < _LEAST_PX:
        return
    rows = min(_ROWS, max(1, round(_ROWS * part.shape[0] / full)))
    step = max(1, part.shape[0] // (_FINE * _ROWS))
    small = cv2.resize(part[::step, ::step], (_COLUMNS, rows), interpolation=cv2.INTER_AREA).astype(np.float32)
    lab = cv2.cvtColor(np.minimum(small * np.float32(gain / 255), 1), cv2.COLOR_BGR2LAB)
    weights = np.tile(_WEIGHTS, (rows, 1))
    if len(nearer):
        scale = np.array([_COLUMNS / part.shape[1], rows / part.shape[0]])
        corners = np.hstack([nearer[:, :2], nearer[:, :2] + nearer[:, 2:]]) - np.tile([left, max(0, round(y))], 2)
        for x0, y0, x1, y1 in np.clip(np.rint(corners * np.tile(scale, 2)), 0, None).astype(int).tolist():
            weights[y0:y1, x0:x1] = 0.0
    histograms = _histograms(lab, weights.ravel())
    for number, (first, end) in enumerate(_ENDS):
        if end <= rows and weights[first:end].sum() >= _LEAST_FREE * (end - first) * _WEIGHTS.sum():
            look[number] = np.sqrt(histograms[number] / histograms[number].sum())


_ENDS = tuple((round(first * _ROWS), round(last * _ROWS)) for first, last in _PARTS)
_PART_OF = np.full(_ROWS, len(_PARTS))  # Number of the part in each row; further ones are left out.
for _number, (_start, _end) in enumerate(_ENDS):
    _PART_OF[_start:_end] = _number
_WEIGHTS = np.exp(-((((np.arange(_COLUMNS) + 0.5) / _COLUMNS - 0.5) / _SPREAD) ** 2) / 2)
_LOWEST = np.array(_LOW)[:, None]
_SCALE = np.array(_BINS)[:, None] / (np.array(_HIGH)[:, None] - _LOWEST)
_LAST = np.array(_BINS)[:, None] - 1.001
_SIZE = int(np.prod(_BINS))
_STRIDES = np.array([_BINS[1] * _BINS[2], _BINS[2], 1])
_FIRST_BIN = np.repeat(_PART_OF * _SIZE, _COLUMNS)  # of the part at each pixel
_CORNERS = (np.indices((2, 2, 2)).reshape(3, -1).T @ _STRIDES)[:, None]


def _histograms(lab: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Histograms of the parts in an image (rows, columns, 3), shape (parts + 1, bins), with a weight for each pixel.

    Each value is shared between its nearest bins.
    """
    rows = len(lab)
    places = np.minimum(np.maximum((lab.reshape(-1, 3).T.copy() - _LOWEST) * _SCALE - 0.5, 0), _LAST)
    first = places.astype(np.intp)
    above = places - first
    light, red, yellow = np.stack([1 - above, above], axis=1)
    shares = (weights * light)[:, None, None] * red[:, None] * yellow
    bins = _STRIDES @ first + _FIRST_BIN[: rows * _COLUMNS] + _CORNERS
    size = (len(_PARTS) + 1) * _SIZE
    return np.bincount(bins.ravel(), shares.ravel(), size).reshape(-1, _SIZE)


_ALIKE = 0.12  # Looks closer than this are one exemplar.
_EXEMPLARS = 6
_MEMORY = 20.0  # An exemplar is a mean over about so many looks.


class Appearance:
    """Looks of one person as a few exemplars, for example the front and the back."""

    __slots__ = ("_counts", "_exemplars", "_usual")

    def __init__(self, looks: Iterable[np.ndarray] = ()) -> None:
        self._exemplars: list[np.ndarray] = []
        self._counts: list[int] = []
        self._usual: np.ndarray | None = None
        for look in looks:
            self.see(look)

    def __len__(self) -> int:
        """Number of looks so far, but for forgotten exemplars."""
        return sum(self._counts)

    def see(self, look: np.ndarray) -> None:
        """Learn a look, (2, bins); one without any colours is ignored."""
        if np.isnan(look[:, 0]).all():
            return
        self._usual = None
        if self._exemplars:
            far = _distances(np.array(self._exemplars), look[None])[:, 0]
            nearest = int(np.argmin(far))
            if far[nearest] < _ALIKE:
                self._counts[nearest] += 1
                mean, share = self._exemplars[nearest], 1 / min(self._counts[nearest], _MEMORY)
                blended = mean + np.float32(share) * (look - mean)
                self._exemplars[nearest] = np.where(np.isnan(mean), look, np.where(np.isnan(look), mean, blended))
                return
        if len(self._exemplars) == _EXEMPLARS:
            rarest = int(np.argmin(self._counts))
            del self._exemplars[rarest], self._counts[rarest]
        self._exemplars.append(look.copy())
        self._counts.append(1)

    def distances(self, looks: np.ndarray) -> np.ndarray:
        """Distance of each look (n, 2, bins) to the nearest exemplar, 0 to 1; infinite if nothing can be compared."""
        usual = self._find_usual()
        return _distances(usual, looks).min(axis=0) if len(usual) and len(looks) else np.full(len(looks), np.inf)

    def distance_to(self, other: Appearance) -> float:
        """Least distance of the exemplars of two people, 0 to 1; infinite if nothing can be compared."""
        return float(self.distances(other._find_usual()).min(initial=np.inf))

    def learn(self, other: Appearance) -> None:
        """Add the exemplars of another track of the same person."""
        for look in other._exemplars:
            self.see(look)

    def _find_usual(self) -> np.ndarray:
        """Exemplars that were seen more than once, if there are such, (n, 2, bins); kept until the next look."""
        if self._usual is None:
            often = [each for each, count in zip(self._exemplars, self._counts, strict=True) if count > 1]
            self._usual = np.array(often or self._exemplars)
        return self._usual


def _distances(some: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Squared Hellinger distances of looks (n, 2, bins) and (m, 2, bins): the mean of parts that both show; (n, m)."""
    shared = np.einsum("npb,mpb->nmp", some, others)
    shown = ~np.isnan(shared)
    if shown.all():
        return np.maximum(0.0, 1 - shared.sum(axis=2) / shared.shape[2])
    count = shown.sum(axis=2)
    near = np.where(shown, shared, 0.0).sum(axis=2) / np.maximum(count, 1)
    return np.where(count > 0, np.maximum(0.0, 1 - near), np.inf)
