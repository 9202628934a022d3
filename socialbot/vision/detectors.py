"""The detectors by name: what each is made from, and which of its scores are to be believed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from socialbot.core.errors import ParameterError
from socialbot.vision.detector import Detector
from socialbot.vision.hog import HogDetector
from socialbot.vision.network import LAYOUTS, OnnxModel, fitting, whole
from socialbot.vision.network_detector import NetworkDetector, nanodet

__all__ = ["DETECTORS", "DetectorSettings", "DetectorSpec"]

_FREE = 640 * 480
"""Pixels that a network gets to see which takes pictures of any size."""


@dataclass(frozen=True)
class DetectorSettings:
    """What detectors are made from; each takes what concerns it.

    ``threads`` bounds the processor threads of a detector. All others are for ``onnx``: ``model`` is the path
    of its file, ``layout`` how its answers are laid out. Where ``input_width`` and ``input_height`` (pixels) are 0 the
    model says them; where ``channels`` ("bgr" or "rgb") and ``pixels`` ("0-255", "0-1" or "imagenet") are empty
    they are as usual for the layout. The model knows ``classes`` kinds of things, of which people are
    number ``person_class``.
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
    """A kind of detector.

    A detection that scores ``sure`` is believed alone; one that scores ``weak`` may go on a track that is
    already known. ``make`` gives a detector with ``threshold`` at ``sure``; it raises InstallationError when a part of
    it is not installed and ParameterError when the settings do not fit.
    """

    name: str
    sure: float
    weak: float
    make: Callable[[DetectorSettings], Detector]


def _hog(settings: DetectorSettings) -> Detector:
    return HogDetector(DETECTORS["hog"].sure, threads=settings.threads)


def _nanodet(settings: DetectorSettings) -> Detector:
    return nanodet(DETECTORS["nanodet"].sure, threads=settings.threads)


def _onnx(settings: DetectorSettings) -> Detector:
    if not settings.model:
        raise ParameterError("no model is named", where="detector onnx", remedy="set the path of an ONNX file")
    if settings.layout not in LAYOUTS:
        raise ParameterError(
            f"there is no layout {settings.layout!r}", where="detector onnx", remedy=f"one of {', '.join(LAYOUTS)}"
        )
    layout = LAYOUTS[settings.layout]
    network = OnnxModel(Path(settings.model).expanduser(), threads=settings.threads)
    canvas = _canvas(settings, network)

    def views(width: int, height: int, horizon: float):
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
    """Width and height of the pictures for ``network``; None where neither settings nor network say them."""
    wanted = (settings.input_width, settings.input_height)
    for want, fixed in zip(wanted, network.size, strict=True):
        if want and fixed and want != fixed:
            raise ParameterError(
                f"the model takes {network.input}, not pictures of {' x '.join(str(side or 'any') for side in wanted)} "
                "pixels",
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
        DetectorSpec("nanodet", 0.45, 0.25, _nanodet),
        DetectorSpec("hog", 0.55, 0.3, _hog),
        DetectorSpec("onnx", 0.4, 0.2, _onnx),
    )
}
"""The detectors by name, the default first.

The scores of nanodet are those that its authors and real pictures ask for (0.40 to 0.45), with several views a little
higher. Those of hog allow for a tracker, which lets a mistake live on: single pictures are best from about 0.5 on.
"""
