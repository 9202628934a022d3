"""Measure messages as JSON and as ROS types: ``python -m evaluation.message_forms``.

Prints the size of each message and the processor time for encoding and decoding it, with rclpy's serialisation. Needs
the package socialbot_msgs of this version (``make interfaces``).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple, get_args

from socialbot.bridge.transport import open_transport
from socialbot.core.messages import Message, PersonDetection, PersonDetections, TraceRecord, Utterance
from socialbot.graph.node import WireForm

COUNT, ROUNDS = 2000, 5

PEOPLE = tuple(
    PersonDetection(x=100.0 * n, y=50.0, w=80.0, h=200.0, score=0.9, track_id=f"t{n}", distance_m=3.0) for n in range(3)
)
MESSAGES: dict[str, Message] = {
    "three people": PersonDetections(stamp=1, frame_id="camera", width=640, height=480, persons=PEOPLE),
    "a sentence": Utterance(stamp=1, id="u1", text="Hello! Nice to see you."),
    "a belief in the trace": TraceRecord(
        stamp=1, id="b-1", source="b", kind="belief", what='present("t1")', cause="f", detail={"source": "percept"}
    ),
}


class Cost(NamedTuple):
    """Size of a message in one form, and processor time for encoding and decoding it (microseconds)."""

    message: str
    form: WireForm
    size: int
    encode_us: float
    decode_us: float


class _Publisher:
    """Publisher that serialises messages, as one of rclpy does, and keeps the last."""

    def publish(self, ros_message: Any) -> None:
        from rclpy.serialization import serialize_message

        self.data = serialize_message(ros_message)


def measure(count: int = COUNT, rounds: int = ROUNDS) -> list[Cost]:
    """Return the cost of each message in each form: the fastest of some rounds.

    Raises:
        InstallationError: The package socialbot_msgs is missing, or of another version.
    """
    return [
        _cost(name, message, form, count, rounds) for name, message in MESSAGES.items() for form in get_args(WireForm)
    ]


def _cost(name: str, message: Message, form: WireForm, count: int, rounds: int) -> Cost:
    from rclpy.serialization import deserialize_message

    transport, publisher = open_transport(form=form), _Publisher()
    sender, receiver = transport.sender(publisher), transport.receiver("/measured")
    ros_class = transport.message_class(type(message))
    sender.publish(message)
    data = publisher.data
    encode_us = _fastest_us(lambda: sender.publish(message), count, rounds)
    decode_us = _fastest_us(lambda: receiver.decode(type(message), deserialize_message(data, ros_class)), count, rounds)
    return Cost(name, form, len(data), encode_us, decode_us)


def _fastest_us(call: Callable[[], object], count: int, rounds: int) -> float:
    times = []
    for _ in range(rounds):
        began = time.process_time()
        for _ in range(count):
            call()
        times.append(time.process_time() - began)
    return min(times) / count * 1e6


def main() -> None:
    """Print the costs as a Markdown table."""
    print("| message | form | bytes | encode, µs | decode, µs |\n|---|---|---|---|---|")
    for cost in measure():
        print(f"| {cost.message} | {cost.form} | {cost.size} | {cost.encode_us:.0f} | {cost.decode_us:.0f} |")


if __name__ == "__main__":
    main()
