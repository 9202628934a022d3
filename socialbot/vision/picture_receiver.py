"""The node at the far end of a link: it answers each picture, and publishes it as a camera would."""

from __future__ import annotations

from collections.abc import Mapping

from socialbot.clock import SECOND
from socialbot.graph import Context, Delivery, Input, Node, Output, Timer
from socialbot.health import SILENT_S
from socialbot.messages import CompressedImage, Image, PictureAck
from socialbot.vision.encodings import bgr_from_compressed
from socialbot.vision.picture_link import Backlog

__all__ = ["PictureReceiver"]

LIFE_S = 0.25
"""How often it gives a sign of life while no picture comes."""


class PictureReceiver(Node):
    """Publishes the pictures of a `PictureSender` as bgr8, with their stamps.

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
        self._backlog = Backlog()
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
