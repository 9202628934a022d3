"""The node that makes bgr8 of whatever a camera sends."""

from __future__ import annotations

import numpy as np

from socialbot.graph import Delivery, Input, Node, Output
from socialbot.health import SILENT_S
from socialbot.messages import CompressedImage, Image
from socialbot.vision.encodings import bgr_from_compressed, bgr_from_image

__all__ = ["ImageConverter"]


class ImageConverter(Node):
    """Publishes each raw or compressed picture as bgr8, with the same stamp and frame.

    A picture that cannot be converted raises ImageError; the next one is looked at afresh.
    """

    image_raw = Input(Image, "/camera/image_raw", Delivery.NEWEST, deadline_s=SILENT_S)
    image_compressed = Input(
        CompressedImage, "/camera/image_raw/compressed", Delivery.NEWEST, deadline_s=SILENT_S, instead_of=image_raw
    )
    image_color = Output(Image, "/camera/image_color", Delivery.NEWEST)

    @image_raw
    def on_image(self, image: Image) -> None:
        self._publish(bgr_from_image(image), image)

    @image_compressed
    def on_compressed(self, image: CompressedImage) -> None:
        self._publish(bgr_from_compressed(image), image)

    def _publish(self, pixels: np.ndarray, source: Image | CompressedImage) -> None:
        self.image_color.publish(Image.from_bgr(pixels, stamp=source.stamp, frame_id=source.frame_id))
