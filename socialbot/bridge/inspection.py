"""The ROS side of the inspector: commands to agents, and live images."""

from __future__ import annotations

import asyncio
import secrets
import threading
import time
from bisect import bisect_right
from collections import deque
from typing import Any

from socialbot.bags.codec import decode, ros_type
from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.transport import message_class, open_transport, publisher_qos, refusal_reason, subscription_qos
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
)
from socialbot.graph.health import HEALTH_TOPIC
from socialbot.graph.node import Delivery, Graph, WireForm
from socialbot.runs.run import Picture
from socialbot.vision.images import as_jpeg

ANSWER_WITHIN_S = 3.0

AT_ODDS = {
    "sealed": f"the graph has keys and the inspector has none (set {KEYS_VARIABLE}, see docs/security.md)",
    "unsealed": "the inspector has a key and the graph has none",
    "unknown sender": "the inspector does not know the key of the graph",
}
"""By the reason why nothing that a graph says can be read: why it would not listen either."""


class CommandClient:
    """Takes commands to agents by ``ros``, a node that spins; messages have the ``form`` of the graph.

    It is shut as long as it can read nothing of what the nodes say of their health. Raises what `wire` does.
    """

    def __init__(self, ros: Any, form: WireForm = "json") -> None:
        self.shut = ""
        self._understands = False
        self._transport = open_transport(form=form)
        self._clock = WallClock()
        self._waiting: dict[str, tuple[asyncio.AbstractEventLoop, asyncio.Future[AgentAnswer]]] = {}
        self._sender = self._transport.sender(
            ros.create_publisher(
                self._transport.message_class(AgentCommand), AGENT_COMMANDS, publisher_qos(Delivery.EVERY)
            )
        )
        self._receiver = self._transport.receiver(AGENT_ANSWERS)
        ros.create_subscription(
            self._transport.message_class(AgentAnswer),
            AGENT_ANSWERS,
            self._hear,
            subscription_qos(Delivery.EVERY, outside=False),
        )
        self._health = self._transport.receiver(HEALTH_TOPIC)
        ros.create_subscription(
            self._transport.message_class(Health),
            HEALTH_TOPIC,
            self._try_to_read,
            subscription_qos(Delivery.EVERY, outside=False),
        )

    async def ask(self, agent: str, command: Command, text: str) -> AgentAnswer | None:
        """Asks an agent for something; None when it does not answer in time."""
        loop = asyncio.get_running_loop()
        id = f"person-{secrets.token_hex(4)}"
        answer: asyncio.Future[AgentAnswer] = loop.create_future()
        self._waiting[id] = loop, answer
        asked = AgentCommand(stamp=self._clock.now(), id=id, agent=agent, command=command, text=text)
        try:
            await loop.run_in_executor(None, self._sender.publish, asked)
            return await asyncio.wait_for(answer, ANSWER_WITHIN_S)
        except asyncio.TimeoutError:
            return None
        finally:
            del self._waiting[id]

    def _hear(self, ros_message: Any) -> None:
        try:
            answer = self._receiver.decode(AgentAnswer, ros_message)
        except MessageError:
            return  # it is logged by those who answer for the graph
        if answer is not None and (waiting := self._waiting.get(answer.id)) is not None:
            loop, future = waiting
            loop.call_soon_threadsafe(_settle, future, answer)

    def _try_to_read(self, ros_message: Any) -> None:
        if self._understands:  # whatever strangers say then
            return
        try:
            self._health.decode(Health, ros_message)
        except MessageError as error:
            self.shut = AT_ODDS.get(refusal_reason(error), self.shut)
        else:
            self._understands, self.shut = True, ""


def _settle(future: asyncio.Future[AgentAnswer], answer: AgentAnswer) -> None:
    if not future.done():
        future.set_result(answer)


MOST_HZ = 10.0
UNWATCHED_S = 3.0
"""When nobody has asked for so long, nothing is subscribed to any more."""

FIRST_WITHIN_S = 1.0
"""So long the first picture is waited for."""

KEPT = 600
"""So many pictures are kept: a minute of them."""


class LiveImages:
    """The pictures on ``topic``, heard by ``ros``, a node that spins, as long as they are asked for."""

    def __init__(self, ros: Any, topic: str, kind: type[Image] | type[CompressedImage]) -> None:
        self._ros = ros
        self._topic = topic
        self._kind = kind
        self._ros_class = message_class(ros_type(kind))
        self._subscription: Any = None
        self._asked = 0.0
        self._made = 0.0
        self._kept: deque[Picture] = deque(maxlen=KEPT)
        self._came = threading.Condition()
        ros.create_timer(1.0, self._rest)

    def at(self, stamp: int) -> Picture | None:
        """The newest picture that is kept and not later than ``stamp`` (ns)."""
        with self._came:
            self._asked = time.monotonic()
            if self._subscription is None:
                self._subscription = self._ros.create_subscription(
                    self._ros_class, self._topic, self._take, subscription_qos(Delivery.NEWEST, outside=True), raw=True
                )
                self._came.wait(FIRST_WITHIN_S)
            kept = list(self._kept)
        # What is to be shown now may have come after the last record.
        count = bisect_right([picture.stamp for picture in kept], stamp + SECOND // 2)
        return kept[count - 1] if count else None

    def _take(self, data: bytes) -> None:
        """Makes a JPEG of a picture, unless one was made just before."""
        from rclpy.serialization import deserialize_message

        now = time.monotonic()
        if now - self._made < 1.0 / MOST_HZ:
            return
        self._made = now
        try:
            message = decode(self._kind, deserialize_message(data, self._ros_class))
            picture = Picture(message.stamp, as_jpeg(message))
        except (ImageError, MessageError):
            return
        with self._came:
            if not self._kept or picture.stamp > self._kept[-1].stamp:
                self._kept.append(picture)
            self._came.notify_all()

    def _rest(self) -> None:
        with self._came:
            if self._subscription is not None and time.monotonic() - self._asked > UNWATCHED_S:
                self._ros.destroy_subscription(self._subscription)
                self._subscription = None


def live_image_topic(graph: Graph) -> tuple[str, type[Image] | type[CompressedImage]] | None:
    """A topic of ``graph`` with pictures: those of its own nodes first, compressed ones first; None without any."""
    published = {topic for placement in graph.placements for topic, _ in placement.publications}
    found: list[tuple[str, type[Image] | type[CompressedImage]]] = []
    for topic, kind in graph.topics().items():
        if issubclass(kind, (Image, CompressedImage)):
            found.append((topic, kind))
    return min(found, key=lambda each: (each[0] not in published, each[1] is Image), default=None)
