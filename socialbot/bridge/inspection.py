"""ROS side of the inspector: commands to agents, and live images."""

from __future__ import annotations

import asyncio
import secrets
import threading
import time
from bisect import bisect_right
from collections import deque
from concurrent.futures import Future
from typing import Any

from socialbot.bags.codec import decode, ros_type
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.qos import subscription_qos
from socialbot.bridge.transport import Listener, log_refusals, message_class, open_transport, refusal_reason
from socialbot.core.clock import SECOND, WallClock
from socialbot.core.errors import ImageError, MessageError
from socialbot.core.messages import (
    AGENT_ANSWERS,
    AGENT_COMMANDS,
    AgentAnswer,
    AgentCommand,
    Command,
    CompressedImage,
    Health,
    Image,
    Utterance,
)
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.node import Graph
from socialbot.graph.ports import Delivery
from socialbot.runs.narration import PERSON
from socialbot.runs.run import Picture
from socialbot.vision.images import as_jpeg

ANSWER_TIMEOUT_S = 3.0

_KEY_MISMATCHES = {
    "sealed": f"the graph has keys and the inspector has none (set {KEYS_VARIABLE}, see docs/security.md)",
    "unsealed": "the inspector has a key and the graph has none",
    "unknown sender": "the inspector does not know the key of the graph",
}
"""Explanation of key mismatches by the refusal reason of health messages."""


class CommandClient:
    """Send commands to agents of ``graph``, by a spinning rclpy node; wait for their answers.

    ``shut`` is the mismatch of the keys of the graph and of this process, which blocks commands; empty without one.
    """

    def __init__(self, ros: Any, graph: Graph) -> None:
        self.shut = ""
        self._keys_fit = False
        transport = open_transport(form=graph.wire)
        spoken = {topic for each in graph.nodes for topic, port in each.subscriptions if port.message_type is Utterance}
        self._speech = [transport.advertise(ros, topic, Utterance) for topic in sorted(spoken)]
        self._clock = WallClock()
        self._waiting: dict[str, Future[AgentAnswer]] = {}
        self._sender = transport.advertise(ros, AGENT_COMMANDS, AgentCommand)
        transport.subscribe(ros, AGENT_ANSWERS, AgentAnswer, self._on_answer)
        self._health = transport.receiver(HEALTH_TOPIC)
        qos = subscription_qos(Delivery.EVERY)
        ros.create_subscription(transport.message_class(Health), HEALTH_TOPIC, self._check_keys, qos)

    async def ask(self, agent: str, command: Command, text: str) -> AgentAnswer | None:
        """Send a command to an agent; None if it does not answer in time."""
        id = f"{PERSON}{secrets.token_hex(4)}"
        answer = self._waiting[id] = Future()
        asked = AgentCommand(stamp=self._clock.now(), id=id, agent=agent, command=command, text=text)
        try:
            await asyncio.to_thread(self._sender.publish, asked)
            return await asyncio.wait_for(asyncio.wrap_future(answer), ANSWER_TIMEOUT_S)
        except asyncio.TimeoutError:
            return None
        finally:
            del self._waiting[id]

    async def say(self, text: str) -> str:
        """Have every speech node of the graph say a sentence; return the reason of a refusal, or an empty text."""
        if not text.strip() or not self._speech:
            return "there is nothing to say" if self._speech else "no node of this graph speaks"
        id = f"{PERSON}{secrets.token_hex(4)}"
        said = Utterance(stamp=self._clock.now(), id=id, text=text.strip(), cause=id)
        for sender in self._speech:
            await asyncio.to_thread(sender.publish, said)
        return ""

    def _on_answer(self, answer: AgentAnswer) -> None:
        waiting = self._waiting.get(answer.id)
        if waiting is not None and not waiting.done() and waiting.set_running_or_notify_cancel():
            waiting.set_result(answer)

    def _check_keys(self, ros_message: Any) -> None:
        if self._keys_fit:
            return
        try:
            self._health.decode(Health, ros_message)
        except MessageError as error:
            self.shut = _KEY_MISMATCHES.get(refusal_reason(error), self.shut)
        else:
            self._keys_fit, self.shut = True, ""


MAX_RATE_HZ = 10.0
UNWATCHED_S = 3.0  # time without requests that ends the subscription
FIRST_IMAGE_TIMEOUT_S = 1.0
MAX_IMAGES = 600  # number of stored images: one minute


class LiveImages:
    """JPEG images of ``topic``. The spinning node ``ros`` subscribes to it while images are requested."""

    def __init__(self, ros: Any, topic: str, kind: type[Image] | type[CompressedImage]) -> None:
        self._ros = ros
        self._topic = topic
        self._kind = kind
        self._ros_class = message_class(ros_type(kind))
        self._transport = open_transport()
        self._subscription: Listener | None = None
        self._refuse = log_refusals(topic)
        self._requested_at = 0.0
        self._converted_at = 0.0
        self._images: deque[Picture] = deque(maxlen=MAX_IMAGES)
        self._changed = threading.Condition()
        ros.create_timer(1.0, self._unsubscribe_if_unwatched)

    def at(self, stamp: int) -> Picture | None:
        """Newest stored image not later than ``stamp`` (ns)."""
        with self._changed:
            self._requested_at = time.monotonic()
            if self._subscription is None:
                self._subscription = self._transport.listen_bytes(
                    self._ros,
                    self._ros.resolve_topic_name(self._topic),
                    self._ros_class,
                    self._take,
                    self._refuse,
                    qos=subscription_qos(Delivery.NEWEST, outside=True),
                )
                self._changed.wait(FIRST_IMAGE_TIMEOUT_S)
            images = list(self._images)
        # An image for "now" may be newer than the last record.
        count = bisect_right([image.stamp for image in images], stamp + SECOND // 2)
        return images[count - 1] if count else None

    def _take(self, data: bytes, _: Any) -> None:
        from rclpy.serialization import deserialize_message

        now = time.monotonic()
        if now - self._converted_at < 1.0 / MAX_RATE_HZ:
            return
        self._converted_at = now
        try:
            message = decode(self._kind, deserialize_message(data, self._ros_class))
            picture = Picture(message.stamp, as_jpeg(message))
        except (ImageError, MessageError):
            return
        with self._changed:
            if not self._images or picture.stamp > self._images[-1].stamp:
                self._images.append(picture)
            self._changed.notify_all()

    def _unsubscribe_if_unwatched(self) -> None:
        with self._changed:
            if self._subscription is not None and time.monotonic() - self._requested_at > UNWATCHED_S:
                self._subscription.destroy(self._ros)
                self._subscription = None


def live_image_topic(graph: Graph) -> tuple[str, type[Image] | type[CompressedImage]] | None:
    """Image topic of ``graph``: preferably of one of its own nodes, and compressed."""
    published = {topic for config in graph.nodes for topic, _ in config.publications}
    found: list[tuple[str, type[Image] | type[CompressedImage]]] = []
    for topic, kind in graph.topics().items():
        if kind is Image or kind is CompressedImage:
            found.append((topic, kind))
    return min(found, key=lambda each: (each[0] not in published, each[1] is Image), default=None)
