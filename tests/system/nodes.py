"""Nodes that misbehave."""

from __future__ import annotations

import os

from socialbot.graph import Delivery, Input, Node, Output
from socialbot.messages import Image, PersonDetections


class RaisingDetector(Node):
    """Raises at every second picture."""

    image = Input(Image, "/camera/image_color", Delivery.NEWEST)
    detections = Output(PersonDetections, "/humans/bodies/detections")
    count = 0

    @image
    def on_image(self, image: Image) -> None:
        self.count += 1
        if self.count % 2:
            raise RuntimeError("no idea")
        self.detections.publish(
            PersonDetections(
                stamp=image.stamp, frame_id=image.frame_id, width=image.width, height=image.height, persons=()
            )
        )


class DyingDetector(Node):
    """Takes its process with it at the third picture."""

    image = Input(Image, "/camera/image_color", Delivery.NEWEST)
    detections = Output(PersonDetections, "/humans/bodies/detections")
    count = 0

    @image
    def on_image(self, image: Image) -> None:
        self.count += 1
        if self.count == 3:
            os._exit(9)
        self.detections.publish(
            PersonDetections(stamp=image.stamp, frame_id="", width=image.width, height=image.height, persons=())
        )


class StillbornDetector(Node):
    """Raises before it has begun."""

    image = Input(Image, "/camera/image_color", Delivery.NEWEST)
    detections = Output(PersonDetections, "/humans/bodies/detections")

    def start(self) -> None:
        raise RuntimeError("not today")

    @image
    def on_image(self, image: Image) -> None: ...
