"""A tracker with images for it."""

from __future__ import annotations

import numpy as np

from socialbot.core.clock import SECOND
from socialbot.vision.tracking import Track, Tracker

SIZE = (640, 480)


class Scene:
    """A tracker that gets ten images a second."""

    def __init__(self, **settings: float) -> None:
        self.tracker = Tracker(0.5, 0.15, **settings)  # type: ignore[arg-type]
        self.time_s = 0.0

    def show(self, *found: tuple[float, ...], after_s: float = 0.1) -> tuple[Track, ...]:
        """Show an image with boxes x, y, w, h and perhaps a score."""
        self.time_s += after_s
        boxes = np.array([one[:4] for one in found], np.float64).reshape(-1, 4)
        scores = np.array([one[4] if len(one) > 4 else 0.7 for one in found])
        return self.tracker.update(round(self.time_s * SECOND), boxes, scores, SIZE)

    def repeat(self, count: int, *found: tuple[float, ...]) -> tuple[Track, ...]:
        """Show the same boxes in several images; the last tracks."""
        return [self.show(*found) for _ in range(count)][-1]


def ids(tracks: tuple[Track, ...]) -> list[str]:
    """Ids of the tracks that have one."""
    return [track.id for track in tracks if track.id]
