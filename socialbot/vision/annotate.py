"""Draw detections, ground truth and captions into images, for videos and reports, and blur people in them."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

import cv2
import numpy as np

from socialbot.core.messages import PersonDetection, PersonDetections
from socialbot.vision.detectors import DETECTORS, DetectorSettings
from socialbot.vision.metrics.truth import TruthPerson

Colour = tuple[int, int, int]
Point = tuple[int, int]

_COLOURS: tuple[Colour, ...] = (
    (80, 200, 80), (60, 170, 255), (240, 170, 60), (200, 110, 220), (60, 220, 230), (150, 130, 250),
)  # fmt: skip
"""Blue, green, red; a track keeps its colour."""
_TRUTH: Colour = (255, 255, 255)
_DARK: Colour = (28, 24, 20)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_STRIP_OPACITY = 0.72


def draw(
    image_bgr: np.ndarray,
    detections: PersonDetections | None,
    truth: Sequence[TruthPerson] = (),
    caption: Sequence[str] = (),
) -> np.ndarray:
    """A copy of ``image_bgr``, shape (height, width, 3), uint8, with boxes and lines of text.

    Detections have frames with track id, distance with its standard error, and score; the frames of predictions are
    dashed. True persons have dashed white frames. ``caption`` is on a dark strip at the bottom, in ASCII.
    """
    image = image_bgr.copy()
    unit = max(image.shape[0] / 480, 0.5)
    for person in truth:
        _draw_dashed(image, person, _TRUTH, 1, unit)
    coloured = []
    for index, person in enumerate(detections.persons if detections else ()):
        number = sum(person.track_id.encode()) if person.track_id else index
        coloured.append((person, _COLOURS[number % len(_COLOURS)]))
    coloured.sort(key=lambda pair: -(pair[0].distance_m or 0.0))  # the nearest on top
    for person, colour in coloured:
        _draw_frame(image, person, colour, unit)
    for person, colour in coloured:
        _draw_label(image, person, colour, unit)
    if caption:
        _draw_caption(image, caption, unit)
    return image


def _corners(person: PersonDetection | TruthPerson) -> tuple[Point, Point]:
    return (round(person.x), round(person.y)), (round(person.x + person.w), round(person.y + person.h))


def _draw_frame(image: np.ndarray, person: PersonDetection, colour: Colour, unit: float) -> None:
    corner, opposite = _corners(person)
    thick = max(1, round(2 * unit))
    if person.unseen_s > 0:
        _draw_dashed(image, person, colour, thick, unit)
        return
    # The dark outline keeps the frame visible on a background of its own colour.
    cv2.rectangle(image, corner, opposite, _DARK, round(4 * unit), cv2.LINE_AA)
    cv2.rectangle(image, corner, opposite, colour, thick, cv2.LINE_AA)


def _draw_dashed(
    image: np.ndarray, person: PersonDetection | TruthPerson, colour: Colour, thick: int, unit: float
) -> None:
    (left, top), (right, bottom) = _corners(person)
    dash = max(2, round(6 * unit))
    for x in range(left, right, 2 * dash):
        for y in (top, bottom):
            cv2.line(image, (x, y), (min(x + dash, right), y), colour, thick)
    for y in range(top, bottom, 2 * dash):
        for x in (left, right):
            cv2.line(image, (x, y), (x, min(y + dash, bottom)), colour, thick)


def _draw_label(image: np.ndarray, person: PersonDetection, colour: Colour, unit: float) -> None:
    """Draw the label above the box, or inside it at the upper edge of the image."""
    score = "" if person.unseen_s > 0 else f"{person.score:.2f}"
    error = "" if person.distance_std_m is None else f"+-{person.distance_std_m:.1f}"
    distance = "" if person.distance_m is None else f"{person.distance_m:.1f}{error} m"
    text = "  ".join(filter(None, (_plain(person.track_id), distance, score)))
    scale, margin = 0.45 * unit, round(4 * unit)
    (width, height), base = cv2.getTextSize(text, _FONT, scale, 1)
    (left, top), _ = _corners(person)
    tall = height + base + margin
    left = min(max(left, 0), max(image.shape[1] - width - 2 * margin, 0))
    top = top - tall if top >= tall else max(top, 0)
    cv2.rectangle(image, (left, top), (left + width + 2 * margin, top + tall), colour, cv2.FILLED)
    cv2.putText(image, text, (left + margin, top + height + margin // 2), _FONT, scale, _DARK, 1, cv2.LINE_AA)


def _draw_caption(image: np.ndarray, lines: Sequence[str], unit: float) -> None:
    scale, line_height, margin = 0.5 * unit, round(20 * unit), round(10 * unit)
    height, width = image.shape[:2]
    top = max(height - line_height * len(lines) - margin, 0)
    strip = image[top:]
    strip[:] = cv2.addWeighted(strip, 1 - _STRIP_OPACITY, np.full_like(strip, _DARK), _STRIP_OPACITY, 0)
    for number, line in enumerate(lines, 1):
        text = _fitted(_plain(line), scale, width - 2 * margin)
        baseline = top + number * line_height
        cv2.putText(image, text, (margin, baseline), _FONT, scale, (240, 240, 240), 1, cv2.LINE_AA)


def _fitted(text: str, scale: float, width: int) -> str:
    """``text``, cut to ``width`` pixels."""
    cut = ""
    while text and cv2.getTextSize(text + cut, _FONT, scale, 1)[0][0] > width:
        text, cut = text[:-1], "..."
    return text + cut


def _plain(text: str) -> str:
    """``text`` in the letters that OpenCV's font has."""
    decomposed = unicodedata.normalize("NFKD", text.replace("ß", "ss"))
    return "".join(each for each in decomposed if not unicodedata.combining(each)).encode("ascii", "replace").decode()


FLOOR_SCORE = 0.15  # Detections from here are blurred: a false one costs some pixels, a missed one a face.
NEAR_NS = 500_000_000
"""A box also blurs images this near in time (ns), which covers those in which the detector misses a person."""
_HEAD_SHARE, _ABOVE, _BESIDE = 0.38, 0.12, 0.08  # Region of a head, and its margins: shares of the height of a box.
_UPRIGHT = 0.5  # A box wider than this share of its height may show the upper body only: it is blurred whole.
_BLOCKS = 6  # Blocks across a blurred region: its mean colours are all that is left.


def regions_of(boxes: np.ndarray, *, whole: bool) -> np.ndarray:
    """Return the regions to blur, (n, 4): heads with a margin, or whole people."""
    x, y, w, h = np.asarray(boxes, np.float64).reshape(-1, 4).T
    tall = h * (1.0 if whole else _HEAD_SHARE)
    tall = np.where(w > _UPRIGHT * h, h, tall)
    return np.stack([x - _BESIDE * h, y - _ABOVE * h, w + 2 * _BESIDE * h, tall + _ABOVE * h], axis=1)


def blurred(pixels: np.ndarray, boxes: np.ndarray, *, whole: bool = False) -> np.ndarray:
    """Return a copy of BGR ``pixels`` with people in ``boxes`` blurred beyond recognition."""
    image = pixels.copy()
    height, width = image.shape[:2]
    for x, y, w, h in regions_of(boxes, whole=whole):
        left, top = max(0, int(x)), max(0, int(y))
        right, bottom = min(width, int(np.ceil(x + w))), min(height, int(np.ceil(y + h)))
        if right <= left or bottom <= top:
            continue
        part = pixels[top:bottom, left:right]
        blocks = (min(_BLOCKS, right - left), min(_BLOCKS, bottom - top))
        small = cv2.resize(part, blocks, interpolation=cv2.INTER_AREA)
        image[top:bottom, left:right] = cv2.resize(small, (right - left, bottom - top), interpolation=cv2.INTER_LINEAR)
    return image


class PeopleFinder:
    """Person detector with a low threshold: a false person costs less than a missed one."""

    def __init__(self) -> None:
        """Load the detector. Raises InstallationError."""
        self._detector = DETECTORS["nanodet"].make(DetectorSettings())
        self._detector.threshold = FLOOR_SCORE

    def find(self, pixels: np.ndarray) -> np.ndarray:
        """Return the boxes in BGR ``pixels``, (n, 4) as x, y, w, h in pixels."""
        return self._detector.detect(pixels).boxes
