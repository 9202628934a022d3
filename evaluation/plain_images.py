"""Images as ROS programs send them: CompressedImage, best effort, the last one is kept.

``python -m evaluation.plain_images send|receive FILM RECORD`` publishes the film at 30 Hz as JPEG of quality 80, or
receives and decodes it. Both write a line of stamp and time (ns) for each image.
"""

from __future__ import annotations

import itertools
import sys
import time
from pathlib import Path
from typing import TextIO

import cv2
import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage

from socialbot.core.clock import SECOND

RATE_HZ, JPEG_QUALITY = 30.0, 80
TOPIC = "/camera/image_raw/compressed"
QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def main(role: str, film: Path, record: Path) -> None:
    """Send or receive until the process is terminated."""
    rclpy.init()
    node = Node(role)
    with record.open("a", buffering=1) as file:
        _send(node, film, file) if role == "send" else _receive(node, file)
        rclpy.spin(node)


def _send(node: Node, film: Path, file: TextIO) -> None:
    capture, pictures = cv2.VideoCapture(str(film)), []
    while (read := capture.read())[0]:
        pictures.append(read[1])
    publisher, endless = node.create_publisher(CompressedImage, TOPIC, QOS), itertools.cycle(pictures)

    def publish() -> None:
        message, stamp = CompressedImage(format="jpeg"), time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
        file.write(f"{stamp} {stamp}\n")
        message.data = cv2.imencode(".jpg", next(endless), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
        publisher.publish(message)

    node.create_timer(1 / RATE_HZ, publish)


def _receive(node: Node, file: TextIO) -> None:
    def receive(message: CompressedImage) -> None:
        if cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR) is not None:
            stamp = message.header.stamp
            file.write(f"{stamp.sec * SECOND + stamp.nanosec} {time.time_ns()}\n")

    node.create_subscription(CompressedImage, TOPIC, receive, QOS)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
