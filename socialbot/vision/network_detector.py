"""People by a neural network that looks at one or several views of a picture."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from socialbot.errors import ParameterError
from socialbot.vision.detector import Detections, select
from socialbot.vision.layouts import LAYOUTS, Answers, Layout, Misfit
from socialbot.vision.network import Network
from socialbot.vision.views import View

__all__ = ["PIXELS", "NetworkDetector", "Views"]

PIXELS: Mapping[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "0-255": ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    "0-1": ((0.0, 0.0, 0.0), (255.0, 255.0, 255.0)),
    "imagenet": ((123.675, 116.28, 103.53), (58.395, 57.12, 57.375)),
}
"""What networks want pixels to be: less a mean, divided by a deviation; both for red, green and blue."""

Views = Callable[[int, int, float], Sequence[View]]
"""The views of a picture of a width and height, pixels, with the horizon at a share of its height."""

_BRIGHT, _BRIGHT_SHARE, _LARGEST_GAIN = 140.0, 95.0, 8.0
"""Pictures in which ``_BRIGHT_SHARE`` percent of the values are below ``_BRIGHT`` are made brighter until they are not.

Networks are trained on pictures in daylight; of far people in a picture ten times as dark they find a tenth.
"""
_LARGEST_SCORE = 1.001
"""Scores beyond 1, but for rounding, are none: the answers mean something else."""
_SAMPLE = 8
"""Every so many rows and columns are enough to tell how bright a picture is."""
_BLANK = (640, 480)
"""Width and height of the picture that a new detector is tried with."""


class NetworkDetector:
    """Runs ``network`` on each of the ``views`` of a picture and reads its answers by ``layout``.

    ``threshold`` is the least score (0 to 1). Of two detections the weaker goes whose IoU is above ``overlap``, or who
    have one head and lie in each other by more than the share ``within`` (see `suppress`).
    The network knows ``classes`` kinds of things, of which people are number ``person``. ``channels`` and
    ``pixels`` are as usual for the layout where they are empty. ``threads`` views are looked at side by side, beside
    the threads of the network itself; the result does not depend on it.
    """

    box_width_m = 0.55
    """Tight boxes, arms included."""

    def __init__(
        self,
        network: Network,
        layout: Layout,
        views: Views,
        *,
        threshold: float,
        overlap: float = 0.6,
        within: float = 1.0,
        person: int = 0,
        classes: int = 80,
        channels: str = "",
        pixels: str = "",
        threads: int = 1,
    ) -> None:
        """Tries the network once; raises ParameterError when its answers are not of the layout."""
        self.threshold = threshold
        self.horizon = 0.5
        self.camera_height: float | None = None
        self.overlap = overlap
        self.within = within
        self._network = network
        self._layout = layout
        self._views = views
        self._person = person
        self._classes = classes
        self._red_first = _choice("channels", channels or layout.channels, ("bgr", "rgb")) == "rgb"
        self._pixels = _choice("pixels", pixels or layout.pixels, tuple(PIXELS))
        self._pool = ThreadPoolExecutor(threads, "view") if threads > 1 else None
        self.detect(np.zeros((*_BLANK[::-1], 3), np.uint8))

    def detect(self, image: np.ndarray) -> Detections:
        """The people in ``image``, shape (height, width, 3), uint8, blue first."""
        height, width = image.shape[:2]
        look = functools.partial(self._look, image, _table(self._pixels, _gain(image)), self.threshold)
        # The views come back in order, so threads change nothing but the time.
        found = list((self._pool.map if self._pool else map)(look, self._views(width, height, self.horizon)))
        boxes = np.vstack([boxes for boxes, _ in found])
        scores = np.concatenate([scores for _, scores in found])
        return select(boxes, scores, width=width, height=height, overlap=self.overlap, within=self.within)

    def _look(
        self, image: np.ndarray, table: np.ndarray, threshold: float, view: View
    ) -> tuple[np.ndarray, np.ndarray]:
        """Boxes (n, 4) in pixels of ``image`` and scores (n,) of the people in ``view``, unsuppressed."""
        picture = cv2.LUT(view.cut(image), table).transpose(2, 0, 1)
        arrays = self._network.run(picture[::-1] if self._red_first else picture)
        answers = Answers(
            arrays, self._network.outputs, view.width, view.height, self._person, self._classes, threshold
        )
        try:
            boxes, scores = self._layout.read(answers)
            if scores.max(initial=0.0) > _LARGEST_SCORE:
                raise Misfit(f"scores from 0 to 1, not {scores.max():.3g}")
        except Misfit as misfit:
            raise self._misfit(arrays, misfit) from None
        boxes = view.back(boxes)
        trusted = view.trusted(boxes, image.shape[1], image.shape[0])
        return boxes[trusted], scores[trusted]

    def _misfit(self, arrays: Sequence[np.ndarray], misfit: Misfit) -> ParameterError:
        said = "; ".join(
            f"{port.name} {' x '.join(map(str, array.shape))} {array.dtype}"
            for port, array in zip(self._network.outputs, arrays, strict=True)
        )
        return ParameterError(
            f"the model answers {said}; layout {self._layout.name} expects {misfit}",
            where=self._network.where,
            remedy=f"choose the layout it was exported in ({', '.join(LAYOUTS)}) and the index of people",
        )


def _gain(image: np.ndarray) -> float:
    """How many times brighter a dark ``image`` is to become; 1 for others."""
    bright = float(np.percentile(image[::_SAMPLE, ::_SAMPLE], _BRIGHT_SHARE))
    return min(max(_BRIGHT / max(bright, 1.0), 1.0), _LARGEST_GAIN)


def _table(pixels: str, gain: float) -> np.ndarray:
    """What each of the 256 values of blue, green and red becomes: float32 (1, 256, 3)."""
    mean, deviation = (np.array(each[::-1]) for each in PIXELS[pixels])
    values = np.minimum(np.arange(256) * gain, 255.0)
    return ((values[None, :, None] - mean) / deviation).astype(np.float32)


def _choice(name: str, value: str, choices: Sequence[str]) -> str:
    if value not in choices:
        raise ParameterError(f"{value!r} is not one of {', '.join(choices)}", where=name)
    return value
