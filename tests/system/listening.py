"""Subscribe to each topic as viewers and libhri do, and print one message: ``python -m tests.system.listening``.

A process of its own, for types whose libraries have to be found before Python starts. The arguments are a limit (s) and
TOPIC=TYPE; ``<id>`` in a topic stands for every voice, body or person that is listed.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile

from socialbot.bridge.environment import spinning_node
from socialbot.bridge.transport import message_class
from tests.system.running import eventually

ID = "<id>"
LISTS = ("/humans/voices/tracked", "/humans/bodies/tracked", "/humans/persons/tracked")
"""Topics that list ids; the last ones list the same."""
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
    followed: set[tuple[str, str]] = set()
    with spinning_node("listener") as ros:

        def subscribe(topic: str, kind: str, one: str = "") -> None:
            def hear(message: Any) -> None:
                if topic in LISTS:
                    follow(topic, message.ids)
                if topic not in heard and tells(told := plain(message)):
                    heard[topic] = told

            static = DurabilityPolicy.TRANSIENT_LOCAL if topic.endswith("static") else DurabilityPolicy.VOLATILE
            qos = QoSProfile(depth=1, durability=static)
            ros.create_subscription(message_class(kind), topic.replace(ID, one), hear, qos)

        def follow(listed: str, names: list[str]) -> None:
            ours = [topic for topic in types if ID in topic and ("/voices/" in topic) == ("/voices/" in listed)]
            for topic, name in ((topic, name) for topic in ours for name in names):
                if (topic, name) not in followed:
                    followed.add((topic, name))
                    subscribe(topic, types[topic], name)

        for topic, kind in types.items():
            if ID not in topic:
                subscribe(topic, kind)
        eventually(lambda: len(heard) == len(types), limit_s)
    return heard


if __name__ == "__main__":
    limit, *topics = sys.argv[1:]
    print(json.dumps(listen(dict(one.split("=") for one in topics), float(limit))))
