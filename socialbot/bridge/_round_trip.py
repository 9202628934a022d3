"""Test the middleware: send images between two processes, best effort, as a camera driver does."""

from __future__ import annotations

import array
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, MutableMapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from socialbot.bridge import environment
from socialbot.core.errors import NodeError

TOPIC = "/socialbot_trial/image"
PICTURES = 30
RATE_HZ = 30.0
WIDTH, HEIGHT = 640, 480
DOMAINS = range(80, 101)
MEET_S = 8.0
"""Discovery timeout (s)."""
LIMIT_S = 25.0
LONGEST_CAUSE = 300
_LOOK_S = 0.05
_SETTLE_S = 0.3
_SETTINGS_OF_NETWORKS = ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "ROS_LOCALHOST_ONLY")


@dataclass(frozen=True)
class Trial:
    """Result of a round trip: the numbers of images sent and received."""

    sent: int
    received: int

    @property
    def share(self) -> float:
        """Received fraction of the images, from 0 to 1."""
        return self.received / self.sent if self.sent else 0.0


def try_round_trip() -> Trial:
    """Send ``PICTURES`` images of 0.9 MB between two processes of this computer, in an unused domain.

    Raises:
        NodeError: A process failed.
    """
    variables = dict(os.environ)
    for name in _SETTINGS_OF_NETWORKS:
        variables.pop(name, None)
    variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    environment.prepare(variables, domain=free_domain())
    with ExitStack() as stack:
        listener, sender = (stack.enter_context(_Part(part, variables)) for part in ("listen", "send"))
        deadline = time.monotonic() + LIMIT_S
        return Trial(sent=sender.count(deadline), received=listener.count(deadline))


def free_domain(domains: Sequence[int] = DOMAINS) -> int:
    """Return an unused one of ``domains``. Raises NodeError when there is none."""
    for domain in domains:
        # Each participant binds the discovery port of its domain.
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", 7400 + 250 * domain))
            except OSError:
                continue
            return domain
    raise NodeError(f"the domains {domains[0]} to {domains[-1]} are all in use", remedy="end other ROS programs")


class _Part:
    """Sender or receiver process, which prints a count and ends. Leaving the context kills it."""

    def __init__(self, part: str, variables: MutableMapping[str, str]) -> None:
        self._part = part
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__, part],
            env=variables,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> _Part:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def count(self, deadline: float) -> int:
        """Return the count that the process prints."""
        try:
            out, complaint = self._process.communicate(timeout=max(0.1, deadline - time.monotonic()))
        except subprocess.TimeoutExpired as error:
            raise NodeError(f"the process hangs ({self._part})") from error
        # Fast DDS logs errors to stdout, too.
        said = out.split()
        if self._process.returncode or not said or not said[-1].isdecimal():
            raise NodeError(f"cannot {self._part}: {cause(complaint, self._process.returncode)}")
        return int(said[-1])


def cause(complaint: str, exit_code: int) -> str:
    """Return the line of ``complaint``, the stderr of a process, that best explains its exit."""
    lines = [line.strip() for line in complaint.splitlines() if line.strip()]
    if not lines:
        return f"signal {-exit_code}" if exit_code < 0 else f"exit code {exit_code}"
    # Of a chain of exceptions, the first is the cause.
    return next((line for line in lines if re.match(r"[\w.]*(Error|Exception)\b", line)), lines[-1])[:LONGEST_CAUSE]


def listen() -> int:
    """Count images until all have arrived, or the sender has left."""
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import Image

    from socialbot.bridge.environment import spinning_node

    arrived: list[int] = []

    def arrive(picture: Image) -> None:
        arrived.append(picture.width)

    with spinning_node("trial_listener") as ros:
        qos = QoSProfile(depth=PICTURES, reliability=ReliabilityPolicy.BEST_EFFORT)
        ros.create_subscription(Image, TOPIC, arrive, qos)
        _wait(lambda: ros.count_publishers(TOPIC) > 0, MEET_S)
        _wait(lambda: len(arrived) >= PICTURES or not ros.count_publishers(TOPIC), MEET_S + PICTURES / RATE_HZ)
    return len(arrived)


def send() -> int:
    """Send the images as soon as a subscriber is connected."""
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import Image

    from socialbot.bridge.environment import spinning_node

    data = array.array("B", bytes(3 * WIDTH * HEIGHT))
    picture = Image(height=HEIGHT, width=WIDTH, encoding="bgr8", step=3 * WIDTH, data=data)
    with spinning_node("trial_sender") as ros:
        publisher = ros.create_publisher(Image, TOPIC, QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT))
        if not _wait(lambda: publisher.get_subscription_count() > 0, MEET_S):
            return PICTURES
        # Discovery may finish at different times on the two sides.
        time.sleep(_SETTLE_S)
        for _ in range(PICTURES):
            publisher.publish(picture)
            time.sleep(1 / RATE_HZ)
        time.sleep(_SETTLE_S)
    return PICTURES


def _wait(condition: Callable[[], bool], timeout_s: float) -> bool:
    deadline = time.monotonic() + timeout_s
    while not (met := condition()) and time.monotonic() < deadline:
        time.sleep(_LOOK_S)
    return met


if __name__ == "__main__":
    print({"listen": listen, "send": send}[sys.argv[1]]())
