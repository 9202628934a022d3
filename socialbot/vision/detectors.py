"""Detectors by name: HOG, NanoDet and any ONNX model, with the scores from which they are believed."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from socialbot.core.errors import ParameterError
from socialbot.vision._hog import HogDetector
from socialbot.vision.detector import LEAST_FUSED, Detections, Detector, select
from socialbot.vision.network import (
    LAYOUTS,
    LayoutMismatch,
    ModelOutput,
    OnnxModel,
    OutputLayout,
    View,
    band,
    fitting,
    included_model,
    whole,
)

PIXELS: Mapping[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "0-255": ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    "0-1": ((0.0, 0.0, 0.0), (255.0, 255.0, 255.0)),
    "imagenet": ((123.675, 116.28, 103.53), (58.395, 57.12, 57.375)),
}
"""Pixel ranges of models: mean and deviation for red, green and blue."""

Views = Callable[[int, int, float], Sequence[View]]
"""Views of an image by width, height and horizon."""

_BRIGHT, _BRIGHT_SHARE, _LARGEST_GAIN = 140.0, 95.0, 8.0
"""Images are brightened until the percentile ``_BRIGHT_SHARE`` reaches ``_BRIGHT``.

Models are trained on daylight: in an image ten times as dark they find a tenth of the distant people.
"""
_LARGEST_SCORE = 1.001  # Larger values are not scores.
_SAMPLE = 8  # Step of the rows and columns sampled for the brightness.
_BLANK = (640, 480)  # Size of the image for a first test.


class NetworkDetector:
    """Runs ``network`` on the ``views`` of an image and decodes its output by ``layout``.

    Args:
        network: ONNX model.
        layout: Format of its output.
        views: Regions and sizes in which the model sees an image.
        threshold: Least score, 0 to 1.
        overlap: IoU above which the weaker of two detections is suppressed.
        within: Share for the suppression of boxes with the same head, see `suppress`.
        fused: IoU above which boxes are averaged; 1 turns this off.
        person: Index of the class "person".
        classes: Number of classes.
        channels: Order of the colours; empty: that of the layout.
        pixels: Range of the pixel values; empty: 0 to 255 if the network takes bytes, else that of the layout.
        threads: Parallel views; the result does not depend on it.
    """

    box_width_m = 0.60

    def __init__(
        self,
        network: OnnxModel,
        layout: OutputLayout,
        views: Views,
        *,
        threshold: float,
        overlap: float = 0.6,
        within: float = 1.0,
        fused: float = 1.0,
        person: int = 0,
        classes: int = 80,
        channels: str = "",
        pixels: str = "",
        threads: int = 1,
    ) -> None:
        """Run the model once; raises ParameterError if its output does not have the layout."""
        self.threshold = threshold
        self.horizon = 0.5
        self.camera_height: float | None = None
        self.overlap = overlap
        self.within = within
        self.fused = fused
        self._network = network
        self._layout = layout
        self._views = views
        self._person = person
        self._classes = classes
        self._red_first = _choice("channels", channels or layout.channels, ("bgr", "rgb")) == "rgb"
        usual = "0-255" if network.takes_bytes else layout.pixels
        self._pixels = _choice("pixels", pixels or usual, tuple(PIXELS))
        self._pool = ThreadPoolExecutor(threads, "view") if threads > 1 else None
        self.detect(np.zeros((*_BLANK[::-1], 3), np.uint8))

    def detect(self, image: np.ndarray) -> Detections:
        """The people in ``image``, shape (height, width, 3), uint8, blue first."""
        height, width = image.shape[:2]
        least = min(self.threshold, LEAST_FUSED) if self.fused < 1 else self.threshold
        look = functools.partial(self._look, image, _table(self._pixels, _gain(image)), least)
        parts = list((self._pool.map if self._pool else map)(look, self._views(width, height, self.horizon)))
        boxes = np.vstack([boxes for boxes, _ in parts])
        scores = np.concatenate([scores for _, scores in parts])
        found = select(
            boxes, scores, width=width, height=height, overlap=self.overlap, within=self.within, fused=self.fused
        )
        good = found.scores >= self.threshold
        return Detections(found.boxes[good], found.scores[good])

    def _look(
        self, image: np.ndarray, table: np.ndarray, threshold: float, view: View
    ) -> tuple[np.ndarray, np.ndarray]:
        """Boxes (n, 4) in image pixels and scores (n,) of one view, before suppression."""
        data = cv2.LUT(view.cut(image), table).transpose(2, 0, 1)
        arrays = self._network.run(data[::-1] if self._red_first else data)
        answers = ModelOutput(
            arrays, self._network.outputs, view.width, view.height, self._person, self._classes, threshold
        )
        try:
            boxes, scores = self._layout.read(answers)
            if scores.max(initial=0.0) > _LARGEST_SCORE:
                raise LayoutMismatch(f"scores from 0 to 1, not {scores.max():.3g}")
        except LayoutMismatch as error:
            shapes = (
                f"{port.name} {' x '.join(map(str, array.shape))} {array.dtype}"
                for port, array in zip(self._network.outputs, arrays, strict=True)
            )
            raise ParameterError(
                f"the model answers {'; '.join(shapes)}; layout {self._layout.name} expects {error}",
                where=self._network.where,
                remedy=f"choose the layout it was exported in ({', '.join(LAYOUTS)}) and the index of people",
            ) from None
        boxes = view.back(boxes)
        trusted = view.trusted(boxes, image.shape[1], image.shape[0])
        return boxes[trusted], scores[trusted]


def _gain(image: np.ndarray) -> float:
    """Brightness factor for a dark ``image``; 1 for others."""
    bright = float(np.percentile(image[::_SAMPLE, ::_SAMPLE], _BRIGHT_SHARE))
    return min(max(_BRIGHT / max(bright, 1.0), 1.0), _LARGEST_GAIN)


def _table(pixels: str, gain: float) -> np.ndarray:
    """Lookup table of the model input for the 256 values of blue, green and red: float32 (1, 256, 3)."""
    mean, deviation = (np.array(each[::-1]) for each in PIXELS[pixels])
    values = np.rint(np.minimum(np.arange(256) * gain, 255.0))
    return ((values[None, :, None] - mean) / deviation).astype(np.float32)


def _choice(name: str, value: str, choices: Sequence[str]) -> str:
    if value not in choices:
        raise ParameterError(f"{value!r} is not one of {', '.join(choices)}", where=name)
    return value


SHA256 = "ae9dea474b1358085dd22489bbf0da190972562ad35230cbb4270e115b74adf3"
"""Checksum of the NanoDet weights."""
FILE = "nanodet.onnx"
_WHOLES = ((416 * 320, 0), (256 * 192, 48), (160 * 120, 70))
"""Views of the whole image: pixels, and least height of a box.

The first has the scale of the training images. Small boxes of the others are inaccurate and merge people.
"""
_BAND = (640 * 160, 800 * 200)
"""Least and most pixels of the view of the band; between them it has the full resolution."""
_OVERLAP, _WITHIN, _FUSED = 0.55, 0.65, 0.6  # The model adds weak boxes around a person and half of a neighbour.


def nanodet(threshold: float, *, threads: int = 1, network: OnnxModel | None = None) -> NetworkDetector:
    """Build the NanoDet detector with a score ``threshold`` (0 to 1); ``network`` replaces the included weights.

    Raises:
        InstallationError: onnxruntime or the weights are missing.
    """
    # Parallel views are faster than parallel operators: 22 ms against 30 with two threads.
    side_by_side = min(threads, len(_WHOLES) + 1)
    network = network or OnnxModel(
        included_model(FILE, SHA256), threads=threads // side_by_side, where=f"socialbot/vision/models/{FILE}"
    )
    return NetworkDetector(
        network,
        LAYOUTS["nanodet"],
        _views,
        threshold=threshold,
        overlap=_OVERLAP,
        within=_WITHIN,
        fused=_FUSED,
        classes=1,
        pixels="0-255",
        threads=side_by_side,
    )


def _views(width: int, height: int, horizon: float) -> Sequence[View]:
    """The views of an image, the most expensive first."""
    wholes = [fitting((0, 0, width, height), pixels, least=least) for pixels, least in _WHOLES]
    far = band(width, height, horizon)
    return [wholes[0], fitting(far, min(max(far[2] * far[3], _BAND[0]), _BAND[1])), *wholes[1:]]


_FREE = 640 * 480  # Input size (pixels) of a model without a fixed one.


@dataclass(frozen=True)
class DetectorSettings:
    """Settings of a detector, as in the parameters of the node `PersonDetector`; all but ``threads`` are for ``onnx``.

    ``layout`` is a key of `LAYOUTS`, ``pixels`` one of `PIXELS`, ``channels`` is "bgr" or "rgb". Empty texts and sizes
    of 0 mean the defaults of the layout and of the model.
    """

    threads: int = 1
    model: str = ""
    layout: str = "yolov8"
    input_width: int = 0
    input_height: int = 0
    channels: str = ""
    pixels: str = ""
    classes: int = 80
    person_class: int = 0


@dataclass(frozen=True)
class DetectorSpec:
    """Registered kind of detector.

    Args:
        name: Name in parameters.
        sure: Score from which a detection counts alone.
        weak: Score from which a detection continues a track.
        make: Builds the detector with its threshold at ``sure``. It raises InstallationError for a missing package
            and ParameterError for invalid settings.
        certain: Score from which a box shows a person even if it never moves; infinite where no score says so. The
            default suits scores from 0 to 1.
        faces: Whether the faces of its people are searched, which needs onnxruntime.
        bridge_s: Longest time to publish a lost track by default, s. A detector that rarely misses a person has lost
            one who is gone.
    """

    name: str
    sure: float
    weak: float
    make: Callable[[DetectorSettings], Detector]
    certain: float = 0.8
    faces: bool = True
    bridge_s: float = 0.15


def _hog(settings: DetectorSettings) -> Detector:
    return HogDetector(DETECTORS["hog"].sure, threads=settings.threads)


def _nanodet(settings: DetectorSettings) -> Detector:
    return nanodet(DETECTORS["nanodet"].sure, threads=settings.threads)


def _onnx(settings: DetectorSettings) -> Detector:
    if not settings.model:
        raise ParameterError("no model is named", where="detector onnx", remedy="set the path of an ONNX file")
    layout = LAYOUTS[_choice("layout", settings.layout, tuple(LAYOUTS))]
    network = OnnxModel(Path(settings.model).expanduser(), threads=settings.threads)
    canvas = _canvas(settings, network)

    def views(width: int, height: int, horizon: float) -> Sequence[View]:
        if canvas is None:
            return [fitting((0, 0, width, height), _FREE, fill=layout.fill)]
        return [whole(width, height, canvas, centred=layout.centred, fill=layout.fill)]

    return NetworkDetector(
        network,
        layout,
        views,
        threshold=DETECTORS["onnx"].sure,
        person=settings.person_class,
        classes=settings.classes,
        channels=settings.channels,
        pixels=settings.pixels,
    )


def _canvas(settings: DetectorSettings, network: OnnxModel) -> tuple[int, int] | None:
    """Input size for ``network``; None if neither settings nor model define it."""
    wanted = (settings.input_width, settings.input_height)
    if any(want and fixed and want != fixed for want, fixed in zip(wanted, network.size, strict=True)):
        size = " x ".join(str(side or "any") for side in wanted)
        raise ParameterError(
            f"the model takes {network.input}, not images of {size} pixels",
            where=network.where,
            remedy="leave the input size to the model: set it to 0",
        )
    width, height = (want or fixed for want, fixed in zip(wanted, network.size, strict=True))
    if bool(width) != bool(height):
        raise ParameterError(
            f"the model takes {network.input}: of its input size only one side is known",
            where=network.where,
            remedy="set both input_width and input_height",
        )
    return (width, height) if width else None


DETECTORS: Mapping[str, DetectorSpec] = {
    spec.name: spec
    for spec in (
        DetectorSpec("nanodet", 0.45, 0.25, _nanodet, certain=0.78),
        DetectorSpec("hog", 0.55, 0.3, _hog, certain=math.inf, faces=False, bridge_s=0.3),
        DetectorSpec("onnx", 0.4, 0.2, _onnx, certain=0.7),
    )
}
"""Detectors by name, the default first.

The score of nanodet is slightly above that of its authors (0.40), because it uses several views. The scores of hog suit
the tracker; single images need about 0.5.
"""
