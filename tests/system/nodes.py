"""Nodes that misbehave."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

from socialbot.core.clock import SECOND
from socialbot.core.messages import Image, PersonDetections
from socialbot.graph.node import Delivery, Input, Node, Output, Parameter


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


class SlowDetector(Node):
    """Takes ``look_s`` for each picture, and writes down which it looked at and how old they were by then (s)."""

    image = Input(Image, "/camera/image_color", Delivery.NEWEST)
    detections = Output(PersonDetections, "/humans/bodies/detections")
    look_s = Parameter(0.35, "how long a picture takes, s")
    record = Parameter("", "file to write to, a line a picture")

    @image
    def on_image(self, image: Image) -> None:
        age_s = (self.clock.now() - image.stamp) / SECOND
        with Path(self.record).open("a", encoding="utf-8") as file:
            file.write(json.dumps({"stamp": image.stamp, "age_s": age_s}) + "\n")
        time.sleep(self.look_s)
        self.detections.publish(
            PersonDetections(
                stamp=image.stamp, frame_id=image.frame_id, width=image.width, height=image.height, persons=()
            )
        )


class Watch(Node):
    """Writes down the stamp of each picture, and when it came (ns)."""

    image = Input(Image, "/camera/image_raw", Delivery.NEWEST)
    record = Parameter("", "file to write to, a line a picture")

    @image
    def on_image(self, image: Image) -> None:
        with Path(self.record).open("a", encoding="utf-8") as file:
            file.write(f"{image.stamp} {self.clock.now()}\n")
