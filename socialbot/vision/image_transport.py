"""Nodes at the two ends of a network link: send a camera's images as JPEG, receive and republish them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import cv2

from socialbot.core.clock import SECOND
from socialbot.core.errors import ImageError
from socialbot.core.messages import CompressedImage, Image, PictureAck
from socialbot.graph.health import SILENT_S
from socialbot.graph.node import Context, Delivery, Input, Node, Output, Parameter, Timer
from socialbot.vision.image_link import ImageLink, StaleImageFilter
from socialbot.vision.images import bgr_from_compressed, bgr_from_image

__all__ = ["ImageReceiver", "ImageSender"]


class ImageSender(Node):
    """Publishes pictures for a `ImageReceiver` on another machine; stamps are kept.

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
        self.pictures = ImageLink(
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


LIFE_S = 0.25
"""How often it gives a sign of life while no picture comes."""


class ImageReceiver(Node):
    """Publishes the pictures of a `ImageSender` as bgr8, with their stamps.

    What has waited for a link that was down is answered, and dropped. A damaged picture is answered, and raises
    ImageError.
    """

    link = Input(CompressedImage, "/camera/image_raw/link", deadline_s=SILENT_S)
    ack = Output(PictureAck, "/camera/image_raw/link/ack")
    image = Output(Image, "/camera/image_raw/received", Delivery.NEWEST)

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._last = PictureAck(stamp=0, arrived=0)
        self._said = 0
        self._backlog = StaleImageFilter()
        self._timer: Timer | None = None

    def start(self) -> None:
        self._live()

    def stop(self) -> None:
        if self._timer:
            self._timer.cancel()

    @link
    def on_picture(self, picture: CompressedImage) -> None:
        now = self.clock.now()
        self._answer(PictureAck(stamp=picture.stamp, arrived=now))
        if not self._backlog.has_kept(picture.stamp, now):
            pixels = bgr_from_compressed(picture)
            self.image.publish(Image.from_bgr(pixels, stamp=picture.stamp, frame_id=picture.frame_id))

    def _live(self) -> None:
        self._timer = self.call_after(LIFE_S, self._live)
        if self.clock.now() - self._said >= LIFE_S * SECOND:
            self._answer(self._last)

    def _answer(self, ack: PictureAck) -> None:
        self._last, self._said = ack, self.clock.now()
        self.ack.publish(ack)
