"""Faulty and slow nodes, and a graph for them."""

from __future__ import annotations

import ctypes
import json
import os
import time
from pathlib import Path

from socialbot.core.messages import (
    HeadCommand,
    Health,
    Image,
    JointTrajectory,
    PersonDetections,
    SpeechStatus,
    Utterance,
)
from socialbot.graph.node import Node
from socialbot.graph.ports import Delivery, Input, Output, Parameter


class Detector(Node):
    """Publishes empty detections for each image, and counts the images."""

    image = Input(Image, "/camera/image_color", Delivery.NEWEST)
    detections = Output(PersonDetections, "/humans/bodies/detections")
    count = 0

    @image
    def on_image(self, image: Image) -> None:
        self.count += 1
        self.look(image)
        self.detections.publish(
            PersonDetections(
                stamp=image.stamp, frame_id=image.frame_id, width=image.width, height=image.height, persons=()
            )
        )

    def look(self, image: Image) -> None: ...


class Talker(Node):
    """Publishes a sentence each half second."""

    say = Output(Utterance, "/speech/say")
    count = 0

    def start(self) -> None:
        self.call_after(0.5, self.start)
        self.count += 1
        self.say.publish(Utterance(stamp=self.clock.now(), id=f"{self.clock.now()}", text=f"word {self.count}"))


class Hearer(Node):
    """Records the topic and number of each message, also of what the robot does: the word it says, where it looks."""

    say = Input(Utterance, "/speech/say")
    look = Input(HeadCommand, "/head/command")
    seen = Input(PersonDetections, "/seen")
    healths = Input(Health, "/healths")
    joints = Input(JointTrajectory, "/joints")
    spoken = Input(SpeechStatus, "/speech/status")
    moved = Input(JointTrajectory, "/head_controller/joint_trajectory")

    record = Parameter("", "output file, a line for each message")

    def note(self, topic: str, number: object) -> None:
        with Path(self.record).open("a", encoding="utf-8") as file:
            file.write(f"{topic} {number}\n")

    @say
    def on_say(self, message: Utterance) -> None:
        self.note("/speech/say", message.id)

    @look
    def on_look(self, message: HeadCommand) -> None:
        self.note("/head/command", message.cause)

    @seen
    def on_seen(self, message: PersonDetections) -> None:
        self.note("/seen", message.frame_id)

    @healths
    def on_health(self, message: Health) -> None:
        self.note("/healths", message.reason)

    @joints
    def on_joints(self, message: JointTrajectory) -> None:
        self.note("/joints", message.joint_names[0])

    @spoken
    def on_spoken(self, message: SpeechStatus) -> None:
        if message.state == "started":
            self.note("/speech/status", message.utterance_id)

    @moved
    def on_moved(self, message: JointTrajectory) -> None:
        self.note("/head_controller/joint_trajectory", message.positions[0])


class RaisingDetector(Detector):
    """Raises for every second image."""

    def look(self, image: Image) -> None:
        if self.count % 2:
            raise RuntimeError("no idea")


class DyingDetector(Detector):
    """Ends its process at the third image."""

    def look(self, image: Image) -> None:
        if self.count == 3:
            os._exit(9)


class StillbornDetector(Detector):
    """Raises at its start."""

    def start(self) -> None:
        raise RuntimeError("not today")


class SlowDetector(Detector):
    """Needs the time in which ``newer`` images arrive for each one, and records how many waited behind it."""

    newer = Parameter(3, "number of images that arrive meanwhile")
    end = Parameter(0, "stamp of the last image, ns")
    record = Parameter("", "output file, a line for each image")

    def look(self, image: Image) -> None:
        (queue,) = self.context.queue.inputs  # type: ignore[attr-defined]  # that of a node over ROS
        with Path(self.record).open("a", encoding="utf-8") as file:
            is_slower = queue.cost_s > queue.spacing_s > 0
            look = {"stamp": image.stamp, "is_slower": is_slower, "waiting": len(queue.waiting)}
            file.write(json.dumps(look) + "\n")
        enough = queue.arrived + self.newer
        while queue.arrived < enough and self.clock.now() < self.end:
            time.sleep(0.005)


class DetectorThatCannotLeave(Detector):
    """Its process never leaves DDS, and keeps Python's lock, as after a deadlock of Fast DDS."""

    def stop(self) -> None:
        from rclpy.node import Node as RosNode

        def destroy_node(self: RosNode) -> None:
            ctypes.PyDLL(None).sleep(3600)

        RosNode.destroy_node = destroy_node


def deadlock() -> None:
    """Wait without end, and keep Python's lock, as a library that blocks."""
    mutex, lock = ctypes.create_string_buffer(64), ctypes.PyDLL(None).pthread_mutex_lock
    lock(mutex)
    lock(mutex)


class BlockedDetector(Detector):
    """Blocks its process once the file BLOCKED exists."""

    def start(self) -> None:
        if Path(os.environ["BLOCKED"]).exists():
            deadlock()
        self.call_after(0.05, self.start)


def detector_graph(detector: str, folder: Path) -> Path:
    """Write the file of a graph with the class ``detector`` of this module."""
    graph = folder / "graph.yaml"
    graph.write_text(
        f"name: {detector}\n"
        "inputs: [/camera/image_raw, /camera/image_raw/compressed]\n"
        "paced_by: /humans/bodies/detections\n"
        "nodes:\n"
        "  image_converter: {type: image_converter}\n"
        f"  detector: {{type: 'tests.system.nodes:{detector}'}}\n"
    )
    return graph


class LeakingDetector(Detector):
    """Takes another 50 MB with each image."""

    def look(self, image: Image) -> None:
        self.taken = [*getattr(self, "taken", []), bytearray(b"x" * 50_000_000)]
