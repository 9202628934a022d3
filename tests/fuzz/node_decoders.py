"""Nodes that get messages of any content, in any order, at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any

import msgspec

from socialbot.agents.hospital.missions import HospitalCoordinator
from socialbot.agents.waldo.head import Head
from socialbot.agents.waldo.nodes import Listener, WaldoNode
from socialbot.bags import codec
from socialbot.core.clock import SECOND
from socialbot.core.errors import SocialbotError
from socialbot.core.messages import (
    ActionRequest,
    HeadCommand,
    Message,
    PersonDetection,
    PersonDetections,
    Structured,
)
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from tests.fuzz.decoder import STAMP, Decoder, StringMessage, text_of
from tests.fuzz.examples import structured


class _Strict(InlineRunner):
    """Nodes may refuse what they get by a SocialbotError; any other exception ends it."""

    def attempt(self, context: Any, callback: Callable[..., None], *arguments: Any, calls: int = 0) -> None:
        if context.alive:
            with suppress(SocialbotError):
                callback(*arguments)


def detections(number: int, distance_m: float = 2.0) -> PersonDetections:
    person = PersonDetection(
        x=10.0, y=5.0, w=20.0, h=60.0, score=0.9, track_id="t1", distance_m=distance_m, distance_std_m=0.1,
        bearing_rad=0.2, elevation_rad=0.1,
    )  # fmt: skip
    stamp = STAMP + number * SECOND // 5
    return PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=(person,) * (number % 3))


def node_decoders() -> Iterator[Decoder]:
    agent = (NodeConfig("waldo", WaldoNode), NodeConfig("listener", Listener), NodeConfig("head", Head))
    seen = [*map(detections, range(12)), HeadCommand(stamp=STAMP, mode="look", pan_rad=0.5, tilt_rad=-0.1)]
    asked = ActionRequest(stamp=STAMP, id="a", agent="waldo", name="speak", arguments=("greet", "hello"))
    yield Decoder("waldo", _fed(agent), (_lines(seen), _lines([*seen[:4], asked, *seen[4:]])))
    coordinator = (NodeConfig("coordinator", HospitalCoordinator),)
    heard = [message for message in structured() if type(message).__name__ in ("AclMessage", "WardState")]
    yield Decoder("coordinator", _fed(coordinator), (_lines(heard * 3),))


def _lines(messages: Iterable[Message]) -> bytes:
    return b"\n".join(map(msgspec.json.encode, messages))


def _fed(configs: tuple[NodeConfig, ...]) -> Callable[[bytes], object]:
    """Send one message per line to the topics of its type; the clock ignores the stamps."""
    topics: Mapping[type[Message], str] = {
        port.message_type: topic for config in configs for topic, port in config.subscriptions
    }

    def decode(data: bytes) -> None:
        runner = _Strict(Graph("fuzz", configs, inputs=frozenset(topics.values())), start=STAMP)
        runner.start()
        for number, line in enumerate(data.split(b"\n")[:100]):
            with suppress(SocialbotError):
                message = codec.decode(Structured, StringMessage(text_of(line)))
                if type(message) in topics:
                    runner.feed(topics[type(message)], message, time=STAMP + number * SECOND // 5)
        runner.advance(runner.clock.now() + 2 * SECOND)
        runner.close()

    return decode
