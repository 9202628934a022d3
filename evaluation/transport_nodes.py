"""Nodes of the transport benchmark: camera, busy-waiting detector and answering agent."""
# ruff: noqa: N801 - beliefs and actions are written as in agents

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

import cv2
import msgspec
import numpy as np

from socialbot.agents.base.agent_node import AgentNode
from socialbot.bdi import Action, Engine, Reactor, Sensed, Sensor, variables
from socialbot.core.clock import nanoseconds
from socialbot.core.messages import Image, PersonDetections, Structured
from socialbot.graph.node import Context, Node
from socialbot.graph.ports import Delivery, Input, Output, Parameter

HEIGHT, WIDTH = 480, 640


class Begin(Structured, frozen=True, kw_only=True):
    """Start command for the camera."""


class Look(msgspec.Struct, frozen=True):
    """Processed frame: its stamp, and begin and end of processing (ns)."""

    stamp: int
    began: int
    ended: int


class Camera(Node):
    """Camera that publishes noise images at a steady rate after its start command."""

    begin = Input(Begin, "/evaluation/begin")
    image_raw = Output(Image, "/camera/image_raw", Delivery.NEWEST)

    rate_hz = Parameter(30.0, "pictures a second", minimum=0.1, maximum=1000.0)
    frames = Parameter(900, "how many pictures to take", minimum=1)
    record = Parameter("", "file to write the stamps to, after the last picture")

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        # A few alternating images in rgb8, which the converter must convert.
        self._pictures = np.random.default_rng(0).integers(0, 256, (4, HEIGHT * WIDTH * 3), np.uint8)
        self._stamps: list[int] = []
        self._due = 0

    @begin
    def on_begin(self, begin: Begin) -> None:
        self._due = self.clock.now()
        self._take()

    def _take(self) -> None:
        stamp = self.clock.now()
        data = self._pictures[len(self._stamps) % len(self._pictures)]
        self.image_raw.publish(
            Image(
                stamp=stamp, frame_id="camera", height=HEIGHT, width=WIDTH, encoding="rgb8", step=3 * WIDTH, data=data
            )
        )
        self._stamps.append(stamp)
        if len(self._stamps) == self.frames:
            Path(self.record).write_bytes(msgspec.json.encode(self._stamps))
            return
        # The rate does not drift, and a delayed camera does not send bursts.
        self._due = max(self._due + nanoseconds(1 / self.rate_hz), stamp)
        self.context.call_at(self._due, self._take)


class ImageTimes(Node):
    """Records the stamp and the arrival (ns) of each image."""

    image = Input(Image, "/camera/image_raw", Delivery.NEWEST)
    record = Parameter("", "output file, a line for each image")

    @image
    def on_image(self, image: Image) -> None:
        with Path(self.record).open("a", encoding="utf-8") as file:
            file.write(f"{image.stamp} {self.clock.now()}\n")


class IdleDetector(Node):
    """Detector that keeps the processor busy for ``busy_s`` per image and finds no persons."""

    image = Input(Image, "/camera/image_color", Delivery.NEWEST)
    detections = Output(PersonDetections, "/humans/bodies/detections")

    busy_s = Parameter(0.0, "how long to work on a picture, s", minimum=0.0, maximum=10.0)
    record = Parameter("", "file to write the `Look` at each frame to, at the end")

    def __init__(self, name: str, context: Context, parameters: Mapping[str, object] | None = None) -> None:
        super().__init__(name, context, parameters)
        self._looks: list[Look] = []

    def start(self) -> None:
        cv2.setNumThreads(1)

    @image
    def on_image(self, image: Image) -> None:
        began = self.clock.now()
        self._work(image.bgr())
        self._looks.append(Look(image.stamp, began, self.clock.now()))
        self.detections.publish(
            PersonDetections(
                stamp=image.stamp, frame_id=image.frame_id, width=image.width, height=image.height, persons=()
            )
        )

    def stop(self) -> None:
        Path(self.record).write_bytes(msgspec.json.encode(self._looks))

    def _work(self, pixels: np.ndarray) -> None:
        until = time.perf_counter() + self.busy_s
        while time.perf_counter() < until:
            cv2.blur(pixels, (5, 5))


class looked(Reactor):
    """Processed frame with this stamp."""


class answer(Action):
    """Answer to the frame with this stamp."""

    def execute(self, stamp: int) -> None:
        self.engine.robot.act(self, stamp)


class FrameSensor(Sensor):
    """Sensor of processed frames."""

    def sense(self, percept: PersonDetections) -> Sensed:
        return +looked(percept.stamp)


class Answerer(AgentNode):
    """Agent that answers every frame."""

    detections = Input(PersonDetections, "/humans/bodies/detections")

    def build(self) -> Engine:
        self._sensor = FrameSensor()
        engine = Engine(self.name, self.clock, robot=self, sink=self.record, wake=self.wake)
        (stamp,) = variables("stamp")
        engine.add_rules(+looked(stamp) >> [answer(stamp)])
        return engine

    @detections
    def on_detections(self, message: PersonDetections) -> None:
        self.engine.perceive(self._sensor, message, cause=message.id, since=message.stamp)
