"""NanoDet: the neural network for people that comes with socialbot.

It is NanoDet-g (RangiLyu, 2021), trained on the COCO pictures, reduced to the class of people; ``models/NOTICE``
tells where it comes from.

It knows people best who are 40 to 130 pixels high, and hardly sees those of about 160 and 310: its layers hand
over to each other there. So it looks at each picture several times: at the whole in three sizes, so that nobody is of a
bad size in all of them and bodies that fill the picture are small in one; and at the band along the horizon in full
resolution, where far people are.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from importlib import resources

from socialbot.errors import InstallationError
from socialbot.vision.layouts import LAYOUTS
from socialbot.vision.network import Network
from socialbot.vision.network_detector import NetworkDetector
from socialbot.vision.views import View, band, fitting

__all__ = ["SHA256", "nanodet", "weights"]

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
    network = Network(weights(), threads=threads // side_by_side, where=f"socialbot/vision/models/{_FILE}")
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
