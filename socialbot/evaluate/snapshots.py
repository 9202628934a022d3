"""Snapshots: the frames in which a detector went wrong most, with what was true and what was found drawn in."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import cv2
import numpy as np

from socialbot.clock import nanoseconds
from socialbot.errors import ImageError
from socialbot.evaluate.evaluation import ClipResult, JudgedFrame
from socialbot.evaluate.sources import Box, Source
from socialbot.evaluate.verdicts import Verdict

__all__ = ["STYLES", "Pictures", "Snapshot", "drawn", "worst"]

APART_S = 1.5
"""Frames nearer to each other show the same error."""
WIDTH = 480
QUALITY = 78

LETTERS = {"false": ("#ffffff", "#b3140c"), "missed": ("#222222", "#ffd60a")}
"""Colour of the letters at a box, and of what is round them."""

STYLES = {"hit": ("#2fd06a", ""), "false": ("#ff3b30", ""), "missed": ("#ffd60a", "7 4"), "spared": ("#9fb4c0", "3 3")}
"""Colour and dashes of each verdict."""


@dataclass(frozen=True)
class Snapshot:
    """A frame worth looking at, of one source."""

    source: Source
    judged: JudgedFrame


def worst(clips: Iterable[ClipResult], count: int) -> list[Snapshot]:
    """The frames with the most errors, worst first, no two of them close together."""
    ranked = sorted(
        (Snapshot(clip.source, judged) for clip in clips for judged in clip.frames if judged.errors),
        key=lambda shot: (-shot.judged.errors, shot.source.name, shot.judged.frame.stamp),
    )
    chosen: list[Snapshot] = []
    for shot in ranked:
        if len(chosen) == count:
            break
        if not any(_same_moment(shot, other) for other in chosen):
            chosen.append(shot)
    return chosen


def _same_moment(one: Snapshot, other: Snapshot) -> bool:
    apart = abs(one.judged.frame.stamp - other.judged.frame.stamp)
    return one.source.footage.consecutive and one.source is other.source and apart < nanoseconds(APART_S)


class Pictures:
    """The pictures of some frames as JPEG in base64; each source is read once."""

    def __init__(self, shots: Sequence[Snapshot]) -> None:
        self._found: dict[tuple[str, int], str] = {}
        wanted: dict[str, tuple[Source, set[int]]] = {}
        for shot in shots:
            wanted.setdefault(shot.source.name, (shot.source, set()))[1].add(shot.judged.frame.stamp)
        for name, (source, stamps) in wanted.items():
            for encoded in source.footage.pictures():
                if encoded.stamp in stamps:
                    try:
                        self._found[name, encoded.stamp] = _jpeg(encoded.bgr())
                    except ImageError:
                        continue

    def of(self, shot: Snapshot) -> str | None:
        """The picture of ``shot``, made small."""
        return self._found.get((shot.source.name, shot.judged.frame.stamp))


def drawn(shot: Snapshot, jpeg: str) -> str:
    """The picture as SVG with boxes: found, false, missed, spared, and dotted what is true."""
    judged = shot.judged
    width, height = judged.found.width, judged.found.height
    unit = max(width, height) / 640
    parts = [f'<image href="data:image/jpeg;base64,{jpeg}" width="{width}" height="{height}"/>']
    verdicts = [verdict for verdict in judged.verdicts if verdict.box[2] > 0]
    parts += [_rectangle(person.box, "#ffffff", "2 4", 1.8 * unit) for person in judged.frame.persons]
    if not verdicts:  # By presence nothing is said of single boxes.
        parts += [
            _rectangle((each.x, each.y, each.w, each.h), "#5ac8fa", "", 2 * unit) for each in judged.found.persons
        ]
    parts += [_rectangle(verdict.box, *STYLES[verdict.kind], 3 * unit) for verdict in verdicts]
    parts += [_label(verdict, unit, width) for verdict in verdicts if verdict.kind in ("false", "missed")]
    label = escape(f"{shot.source.name}, {judged.frame.name}")
    return f'<svg class="frame" viewBox="0 0 {width} {height}" role="img" aria-label="{label}">{"".join(parts)}</svg>'


def _rectangle(box: Box, colour: str, dashes: str, thick: float) -> str:
    x, y, w, h = box
    dash = f' stroke-dasharray="{dashes}"' if dashes else ""
    place = f'x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{h:.1f}" fill="none"'
    # A dark line below keeps the colour visible on anything.
    return (
        f'<rect {place} stroke="#000" stroke-opacity=".55" stroke-width="{2 * thick:.1f}"/>'
        f'<rect {place} stroke="{colour}" stroke-width="{thick:.1f}"{dash}/>'
    )


def _label(verdict: Verdict, unit: float, width: int) -> str:
    text = f"{verdict.cause} {verdict.score:.2f}" if verdict.kind == "false" else "missed"
    colour, round_it = LETTERS[verdict.kind]
    size = 21 * unit
    long = len(text) * size * 0.56
    left, top, _, high = verdict.box
    x = min(max(left, 2.0), max(width - long, 2.0))
    # What was missed is told inside its box, so that it does not cover the word about a false alarm there.
    y = max(top - 3 * unit, size) if verdict.kind == "false" else min(top + size, top + high)
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:.1f}" fill="{colour}" stroke="{round_it}" '
        f'stroke-width="{5 * unit:.1f}" stroke-linejoin="round" paint-order="stroke">{escape(text)}</text>'
    )


def _jpeg(image: np.ndarray) -> str:
    height, width = image.shape[:2]
    if width > WIDTH:
        image = cv2.resize(image, (WIDTH, max(1, round(height * WIDTH / width))), interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return base64.b64encode(data.tobytes()).decode()
