"""Recorder of the messages on one machine of a deployment, with arrival times.

``python -m evaluation.faults_watch DEPLOYMENT MACHINE FILE TOPIC...`` adds a line of JSON to FILE for each message on
the topics and for /diagnostics. Images are taken as bytes, for their stamps only. The separate process delays no node,
and its load counts for none.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from socialbot.bags.codec import ros_type
from socialbot.bridge import environment
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.core.clock import SECOND
from socialbot.core.messages import Health, Image, Message
from socialbot.core.process import keep_freed_memory
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.ports import Delivery
from socialbot.runtime.deployment import Deployment, load_deployment

DIAGNOSTICS = "/diagnostics"
STAMP_ENDS = 12
"""End offset of the stamp in an image message; it starts after the four encoding bytes."""


class Heard(msgspec.Struct, frozen=True):
    """Message with its arrival time (ns), topic, stamp (ns) and, except for images, its content."""

    at: int
    topic: str
    stamp: int
    said: dict[str, Any] = {}


def heard(file: Path) -> Iterator[Heard]:
    """Yield the messages in ``file`` without an incomplete last line."""
    if not file.exists():
        return
    decoder = msgspec.json.Decoder(Heard)
    for line in file.read_bytes().split(b"\n")[:-1]:
        yield decoder.decode(line)


def stamp_of(data: bytes) -> int:
    """Return the stamp (ns) of a serialized message with a header."""
    order = "little" if data[1] & 1 else "big"
    seconds, rest = int.from_bytes(data[4:8], order, signed=True), int.from_bytes(data[8:STAMP_ENDS], order)
    return seconds * SECOND + rest


def watch(deployment: Deployment, topics: list[str], file: Path, end: threading.Event) -> None:
    """Record ``topics`` until ``end`` is set; the environment must be prepared."""
    from socialbot.bridge.graph_observer import observe_graph
    from socialbot.bridge.qos import subscription_qos
    from socialbot.bridge.transport import message_class

    encoder = msgspec.json.Encoder()
    kinds: dict[str, type[Message]] = {HEALTH_TOPIC: Health, **deployment.graph.topics()}
    pictures = [topic for topic in topics if kinds[topic] is Image]

    with file.open("ab", buffering=0) as out:

        def write(topic: str, stamp: int, said: dict[str, Any]) -> None:
            out.write(encoder.encode(Heard(time.time_ns(), topic, stamp, said)) + b"\n")

        def observe(topic: str, message: Message) -> None:
            write(topic, message.stamp, msgspec.to_builtins(message))

        def note(node: str, values: dict[str, str]) -> None:
            write(DIAGNOSTICS, 0, {"node": node, **values})

        with observe_graph(
            {topic: kinds[topic] for topic in topics if topic not in pictures}, observe, note
        ) as onlooker:
            for topic in pictures:
                onlooker.ros.create_subscription(
                    message_class(ros_type(Image)),
                    topic,
                    lambda data, topic=topic: write(topic, stamp_of(data), {}),
                    subscription_qos(Delivery.NEWEST, outside=False),
                    raw=True,
                )
            end.wait()


def main(deployment: str, machine: str, file: str, *topics: str) -> None:
    """Record messages until SIGINT or SIGTERM."""
    keep_freed_memory()
    end = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: end.set())
    found = load_deployment(Path(deployment))
    environment.prepare(domain=found.domain, across=found.across(machine), raw_pictures=True)
    if found.keys is not None:
        os.environ[KEYS_VARIABLE] = f"{found.keys}:{machine}"
    watch(found, list(topics), Path(file), end)


if __name__ == "__main__":
    main(*sys.argv[1:])
