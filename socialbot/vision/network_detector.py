"""Person detection by a neural network on one or several views of an image; NanoDet, the model that is included."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib import resources

import cv2
import numpy as np

from socialbot.core.errors import InstallationError, ParameterError
from socialbot.vision.detector import Detections, select
from socialbot.vision.network import LAYOUTS, LayoutMismatch, ModelOutput, OnnxModel, OutputLayout, View, band, fitting

__all__ = ["NetworkDetector", "PIXELS", "SHA256", "Views", "nanodet", "weights"]


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
        network: OnnxModel,
        layout: OutputLayout,
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
        answers = ModelOutput(
            arrays, self._network.outputs, view.width, view.height, self._person, self._classes, threshold
        )
        try:
            boxes, scores = self._layout.read(answers)
            if scores.max(initial=0.0) > _LARGEST_SCORE:
                raise LayoutMismatch(f"scores from 0 to 1, not {scores.max():.3g}")
        except LayoutMismatch as misfit:
            raise self._misfit(arrays, misfit) from None
        boxes = view.back(boxes)
        trusted = view.trusted(boxes, image.shape[1], image.shape[0])
        return boxes[trusted], scores[trusted]

    def _misfit(self, arrays: Sequence[np.ndarray], misfit: LayoutMismatch) -> ParameterError:
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


SHA256 = "093cbca46692a6ea044d76dac09d42e201f387c3bd2edaba530976dc64820a42"
"""Of the file with the weights."""
_FILE = "nanodet.onnx"
_WHOLES = ((416 * 320, 0), (256 * 192, 48), (160 * 120, 70))
"""The views of the whole: how many pixels, and from what height on its boxes are believed.

At 4:3 the first has the scale of the pictures it was trained with. Small boxes of the others are rough, and take two
people for one.
"""
_BAND = 640 * 160
"""Pixels of the view of the band."""
_OVERLAP = 0.55
"""Of boxes round one person, seen in different sizes."""
_WITHIN = 0.65
"""Of boxes with one head: the network likes to draw a weaker one round somebody and half of their neighbour."""


def nanodet(threshold: float, *, threads: int = 1) -> NetworkDetector:
    """The detector of people who score ``threshold`` (0 to 1) or more, working with so many ``threads``.

    Raises InstallationError when onnxruntime or the weights are missing.
    """
    # Views side by side are faster than one view by several threads: 22 ms against 30 with two.
    side_by_side = min(threads, len(_WHOLES) + 1)
    network = OnnxModel(weights(), threads=threads // side_by_side, where=f"socialbot/vision/models/{_FILE}")
    return NetworkDetector(
        network,
        LAYOUTS["nanodet"],
        _views,
        threshold=threshold,
        overlap=_OVERLAP,
        within=_WITHIN,
        classes=1,
        threads=side_by_side,
    )


def weights() -> bytes:
    """The file with the network. Raises InstallationError when it is missing or not the one that belongs here."""
    file = resources.files("socialbot.vision") / "models" / _FILE
    remedy = "reinstall socialbot: pip install --force-reinstall socialbot"
    try:
        data = file.read_bytes()
    except OSError as error:
        raise InstallationError(error.strerror or str(error), where=str(file), remedy=remedy) from error
    digest = hashlib.sha256(data).hexdigest()
    if digest != SHA256:
        raise InstallationError(
            f"these are not the weights that belong here: {len(data)} bytes with sha256 {digest}, expected {SHA256}",
            where=str(file),
            remedy=remedy,
        )
    return data


def _views(width: int, height: int, horizon: float) -> Sequence[View]:
    """The views of a picture, the most expensive first."""
    wholes = [fitting((0, 0, width, height), pixels, least=least) for pixels, least in _WHOLES]
    return [wholes[0], fitting(band(width, height, horizon), _BAND), *wholes[1:]]
