"""The node that gives a camera's pictures to a link: as JPEG, and as many and as good as the link carries."""

from __future__ import annotations

import math
from collections.abc import Mapping

import cv2

from socialbot.errors import ImageError
from socialbot.graph import Context, Delivery, Input, Node, Output, Parameter
from socialbot.messages import CompressedImage, Image, PictureAck
from socialbot.vision.encodings import bgr_from_image
from socialbot.vision.picture_link import PictureLink

__all__ = ["PictureSender"]


class PictureSender(Node):
    """Publishes pictures for a `PictureReceiver` on another machine; stamps are kept.

    While the link is down nothing is sent; the first answer begins anew, with the newest picture. A picture that
    cannot be converted raises ImageError; the next one is looked at afresh.
    """

    image = Input(Image, "/camera/image_raw", Delivery.NEWEST)
    link = Output(CompressedImage, "/camera/image_raw/link")
    ack = Input(PictureAck, "/camera/image_raw/link/ack")

    quality = Parameter(80, "JPEG quality on a link that carries it", minimum=1, maximum=100)
    least_quality = Parameter(30, "JPEG quality below which rather pictures are left out", minimum=1, maximum=100)
    rate_hz = Parameter(0.0, "pictures a second at most; 0: every picture", minimum=0.0, maximum=1000.0)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self.pictures = PictureLink(
            best=self.quality, least=self.least_quality, most_hz=self._most_hz, now=self.clock.now()
        )

    def on_parameter(self, name: str) -> None:
        self.pictures.bound(best=self.quality, least=self.least_quality, most_hz=self._most_hz)

    @image
    def on_image(self, image: Image) -> None:
        was_silent = self.pictures.silent
        if not self.pictures.takes(self.clock.now()):
            if self.pictures.silent and not was_silent:
                self.log.warning("the link is silent: no answer from the receiver of %s", image.frame_id)
                self.say_health("degraded", f"no answer from the receiver of {image.frame_id}")
            return
        jpeg = self._jpeg(image)
        self.pictures.sent(image.stamp, jpeg.data.size, self.clock.now())
        self.link.publish(jpeg)

    @ack
    def on_ack(self, ack: PictureAck) -> None:
        if self.pictures.silent:
            self.log.info("the link answers")
            self.say_health("ok")
        self.pictures.answered(ack.stamp, self.clock.now())

    @property
    def _most_hz(self) -> float:
        return self.rate_hz or math.inf

    def _jpeg(self, image: Image) -> CompressedImage:
        good, data = cv2.imencode(".jpg", bgr_from_image(image), [cv2.IMWRITE_JPEG_QUALITY, self.pictures.quality])
        if not good:
            raise ImageError("cannot be made a JPEG", where=f"image of {image.width}x{image.height}")
        return CompressedImage(
            stamp=image.stamp, frame_id=image.frame_id, format="bgr8; jpeg compressed bgr8", data=data.reshape(-1)
        )
