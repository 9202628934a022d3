"""Frames worth looking at: those at the turning points of a run, with who was seen drawn in."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from itertools import islice
from typing import Any

import cv2
import numpy as np

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.runs.run import Picture, Run

SHOWN = 8
"""So many frames are shown of a run, at most."""
WORDS = 6
"""So many of them are of what was said."""
APART_S = 0.5
"""Frames nearer to each other show the same."""
LOOKED_BACK = 500
"""Among so many records before a moment its frame is looked for."""
WIDTH, QUALITY = 480, 72
DARK = "#10161c"
STYLES = {"seen": ("#35d07f", ""), "missed": ("#ffd60a", "7 4"), "false": ("#ff5a4f", "")}
"""Colour and dashes of a box by its kind."""


@dataclass(frozen=True)
class Shot:
    """A frame (the record of who was seen in it) and why it is shown."""

    detection: TraceRecord
    why: str


@dataclass(frozen=True)
class Box:
    """A box in a picture (pixels) with a word at it. ``kind``: seen, missed, or false if it fits nobody."""

    x: float
    y: float
    w: float
    h: float
    text: str
    kind: str = "seen"


def shots_of(run: Run) -> list[Shot]:
    """The frames that led to something said, and those with the first, the most and the last people; by time."""
    chosen: list[Shot] = []
    for shot in (*islice(_led_to_words(run), WORDS), *_first_and_most(run)):
        near = (abs(shot.detection.stamp - other.detection.stamp) < APART_S * SECOND for other in chosen)
        if len(chosen) < SHOWN and not any(near):
            chosen.append(shot)
    return sorted(chosen, key=lambda shot: shot.detection.stamp)


def figures(run: Run, shots: Sequence[Shot]) -> str:
    """The frames as figures (HTML), as far as there are pictures of them."""
    found = (_figure(run, shot) for shot in shots)
    shown = "".join(filter(None, found))
    return f'<div class="frames">{shown}</div>' if shown else ""


def frame_of(run: Run, stamp: int, why: str) -> str:
    """The frame at ``stamp`` (ns) as a figure; empty where there is no picture of it."""
    detection = _last_frame(run, stamp)
    return "" if detection is None else _figure(run, Shot(detection, why))


def figure(picture: Picture, boxes: Sequence[Box], caption: str) -> str:
    """A picture with ``boxes`` and a ``caption``. Empty for a damaged picture."""
    shown = _drawn(picture, boxes, caption)
    return f"<figure>{shown}<figcaption>{escape(caption)}</figcaption></figure>" if shown else ""


def _drawn(picture: Picture, boxes: Sequence[Box], label: str) -> str:
    image = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        return ""
    height, width = image.shape[:2]
    if width > WIDTH:
        image = cv2.resize(image, (WIDTH, max(1, round(height * WIDTH / width))), interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    source = f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}"
    return (
        f'<svg class="frame" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(label)}">'
        f'<image href="{source}" width="{width}" height="{height}"/>{"".join(_box(box, width) for box in boxes)}</svg>'
    )


def _figure(run: Run, shot: Shot) -> str:
    picture = run.picture(shot.detection.stamp)
    caption = f"{run.history.seconds(shot.detection.stamp):.2f} s: {shot.why}"
    people = shot.detection.detail.get("persons", ())
    return "" if picture is None else figure(picture, [_seen(person) for person in people], caption)


def _first_and_most(run: Run) -> Iterator[Shot]:
    seen = [record for record in run.history if record.kind == "detection" and record.detail.get("persons")]
    if seen:
        most = max(seen, key=lambda record: len(record.detail["persons"]))
        yield Shot(seen[0], "somebody comes into view")
        if len(most.detail["persons"]) > 1:
            yield Shot(most, f"{len(most.detail['persons'])} people at once, the most there were")
        yield Shot(seen[-1], "the last time that somebody is in view")


def _led_to_words(run: Run) -> Iterator[Shot]:
    for record in run.history:
        if record.kind == "utterance":
            frame = next((each for each in run.history.chain(record) if each.kind == "detection"), None)
            frame = frame or _last_frame(run, record.stamp)
            if frame is not None:
                yield Shot(frame, f"leads to “{record.what}”")


def _last_frame(run: Run, stamp: int) -> TraceRecord | None:
    """Who was seen last at ``stamp`` (ns)."""
    until = run.history.until(stamp)
    before = reversed(run.history.part(max(until - LOOKED_BACK, 0), until))
    return next((record for record in before if record.kind == "detection"), None)


def _seen(person: dict[str, Any]) -> Box:
    distance = person.get("distance_m")
    text = " ".join(filter(None, (str(person.get("track_id") or ""), "" if distance is None else f"{distance:.1f} m")))
    x, y, w, h = (float(person[side]) for side in "xywh")
    return Box(x, y, w, h, text)


def _box(box: Box, width: int) -> str:
    unit = width / 640
    place = f'x="{box.x:.1f}" y="{box.y:.1f}" width="{box.w:.1f}" height="{box.h:.1f}" fill="none"'
    colour, dashes = STYLES[box.kind]
    dash = f' stroke-dasharray="{dashes}"' if dashes else ""
    size = 19 * unit
    return (
        f'<rect {place} stroke="{DARK}" stroke-opacity=".6" stroke-width="{5 * unit:.1f}"/>'
        f'<rect {place} stroke="{colour}" stroke-width="{2.5 * unit:.1f}"{dash}/>'
        f'<text x="{max(box.x, 2):.1f}" y="{max(box.y - 5 * unit, size):.1f}" font-size="{size:.1f}" fill="{colour}" '
        f'stroke="{DARK}" stroke-width="{4 * unit:.1f}" stroke-linejoin="round" paint-order="stroke">'
        f"{escape(box.text)}</text>"
    )
