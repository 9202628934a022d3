"""Subscribe to each topic as viewers and libhri do, and print one message: ``python -m tests.system.listening``.

A process of its own, for types whose libraries have to be found before Python starts. The arguments are a limit (s) and
TOPIC=TYPE; ``<id>`` in a topic stands for every body that is told of on /humans/bodies/tracked.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile

from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import message_class
from tests.system.running import eventually

TRACKED, ID = "/humans/bodies/tracked", "<id>"
LEAST = {"markers": 1, "detections": 0, "ids": 0, "transforms": 0}


def plain(value: Any) -> Any:
    """A message as JSON knows it."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, (str, int, float)):
        return value
    return [plain(one) for one in value]


def tells(told: dict[str, Any]) -> bool:
    """Whether there is somebody or something in it; the first of markers removes those before."""
    return all(len(told.get(name, "some")) > least for name, least in LEAST.items())


def listen(types: dict[str, str], limit_s: float) -> dict[str, Any]:
    """Return the first message of each topic that is not empty, within the time limit."""
    heard: dict[str, Any] = {}
    followed: set[str] = set()
    with spinning_node("listener") as ros:

        def subscribe(topic: str, kind: str, body: str = "") -> None:
            def hear(message: Any) -> None:
                if topic == TRACKED:
                    follow(message.ids)
                if topic not in heard and tells(told := plain(message)):
                    heard[topic] = told

            static = DurabilityPolicy.TRANSIENT_LOCAL if topic.endswith("static") else DurabilityPolicy.VOLATILE
            qos = QoSProfile(depth=1, durability=static)
            ros.create_subscription(message_class(kind), topic.replace(ID, body), hear, qos)

        def follow(bodies: list[str]) -> None:
            for body in set(bodies) - followed:
                followed.add(body)
                for topic, kind in types.items():
                    if ID in topic:
                        subscribe(topic, kind, body)

        for topic, kind in types.items():
            if ID not in topic:
                subscribe(topic, kind)
        eventually(lambda: len(heard) == len(types), limit_s)
    return heard


if __name__ == "__main__":
    limit, *topics = sys.argv[1:]
    print(json.dumps(listen(dict(one.split("=") for one in topics), float(limit))))
