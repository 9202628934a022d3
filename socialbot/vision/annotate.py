"""Draw detections, ground truth and captions into images, for videos and reports."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

import cv2
import numpy as np

from socialbot.core.messages import PersonDetection, PersonDetections
from socialbot.vision.metrics.truth import TruthPerson

__all__ = ["draw"]

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

    Detections are framed and labelled with track id, distance with its standard error, and score; the frames
    of those that are only predicted are dashed. True persons have dashed white frames. ``caption`` stands on a
    dark strip at the bottom, its letters in their plainest form (ASCII).
    """
    picture = image_bgr.copy()
    unit = max(picture.shape[0] / 480, 0.5)
    for person in truth:
        _dashed(picture, person, _TRUTH, 1, unit)
    coloured = [
        (person, _colour(person, index)) for index, person in enumerate(detections.persons if detections else ())
    ]
    coloured.sort(key=lambda pair: -(pair[0].distance_m or 0.0))  # the nearest on top
    for person, colour in coloured:
        _framed(picture, person, colour, unit)
    for person, colour in coloured:
        _labelled(picture, person, colour, unit)
    if caption:
        _captioned(picture, caption, unit)
    return picture


def _colour(person: PersonDetection, index: int) -> Colour:
    number = sum(person.track_id.encode()) if person.track_id else index
    return _COLOURS[number % len(_COLOURS)]


def _corners(person: PersonDetection | TruthPerson) -> tuple[Point, Point]:
    return (round(person.x), round(person.y)), (round(person.x + person.w), round(person.y + person.h))


def _framed(picture: np.ndarray, person: PersonDetection, colour: Colour, unit: float) -> None:
    corner, opposite = _corners(person)
    thick = max(1, round(2 * unit))
    if person.unseen_s > 0:
        _dashed(picture, person, colour, thick, unit)
        return
    # The dark outline keeps the frame visible on a background of its own colour.
    cv2.rectangle(picture, corner, opposite, _DARK, round(4 * unit), cv2.LINE_AA)
    cv2.rectangle(picture, corner, opposite, colour, thick, cv2.LINE_AA)


def _dashed(
    picture: np.ndarray, person: PersonDetection | TruthPerson, colour: Colour, thick: int, unit: float
) -> None:
    (left, top), (right, bottom) = _corners(person)
    dash = max(2, round(6 * unit))
    for x in range(left, right, 2 * dash):
        for y in (top, bottom):
            cv2.line(picture, (x, y), (min(x + dash, right), y), colour, thick)
    for y in range(top, bottom, 2 * dash):
        for x in (left, right):
            cv2.line(picture, (x, y), (x, min(y + dash, bottom)), colour, thick)


def _labelled(picture: np.ndarray, person: PersonDetection, colour: Colour, unit: float) -> None:
    """The label above the box, or inside it where there is no room above."""
    score = "" if person.unseen_s > 0 else f"{person.score:.2f}"
    text = "  ".join(word for word in (_plain(person.track_id), _distance(person), score) if word)
    scale, margin = 0.45 * unit, round(4 * unit)
    (width, height), base = cv2.getTextSize(text, _FONT, scale, 1)
    (left, top), _ = _corners(person)
    tall = height + base + margin
    left = min(max(left, 0), max(picture.shape[1] - width - 2 * margin, 0))
    top = top - tall if top >= tall else max(top, 0)
    cv2.rectangle(picture, (left, top), (left + width + 2 * margin, top + tall), colour, cv2.FILLED)
    cv2.putText(picture, text, (left + margin, top + height + margin // 2), _FONT, scale, _DARK, 1, cv2.LINE_AA)


def _distance(person: PersonDetection) -> str:
    if person.distance_m is None:
        return ""
    error = "" if person.distance_std_m is None else f"+-{person.distance_std_m:.1f}"
    return f"{person.distance_m:.1f}{error} m"


def _captioned(picture: np.ndarray, lines: Sequence[str], unit: float) -> None:
    scale, line_height, margin = 0.5 * unit, round(20 * unit), round(10 * unit)
    height, width = picture.shape[:2]
    top = max(height - line_height * len(lines) - margin, 0)
    strip = picture[top:]
    strip[:] = cv2.addWeighted(strip, 1 - _STRIP_OPACITY, np.full_like(strip, _DARK), _STRIP_OPACITY, 0)
    for number, line in enumerate(lines, 1):
        text = _fitted(_plain(line), scale, width - 2 * margin)
        baseline = top + number * line_height
        cv2.putText(picture, text, (margin, baseline), _FONT, scale, (240, 240, 240), 1, cv2.LINE_AA)


def _fitted(text: str, scale: float, width: int) -> str:
    """``text``, cut to ``width`` pixels."""
    if cv2.getTextSize(text, _FONT, scale, 1)[0][0] <= width:
        return text
    while text and cv2.getTextSize(text + "...", _FONT, scale, 1)[0][0] > width:
        text = text[:-1]
    return text + "..."


def _plain(text: str) -> str:
    """``text`` in the letters that OpenCV's font has."""
    decomposed = unicodedata.normalize("NFKD", text.replace("ß", "ss"))
    return (
        "".join(letter for letter in decomposed if not unicodedata.combining(letter))
        .encode("ascii", "replace")
        .decode()
    )
