"""Announce a run of ``socialbot up`` on its host and over ROS, and end it on request."""

from __future__ import annotations

import logging
import os
import secrets
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, TypeVar

from socialbot.bags.codec import ros_type
from socialbot.bridge.diagnostics import machine
from socialbot.bridge.graph_observer import rounded
from socialbot.bridge.transport import message_class, publisher_qos, subscription_qos, open_transport
from socialbot.core.clock import WallClock
from socialbot.core.errors import MessageError
from socialbot.core.messages import DownRequest, Structured, UpState, UpStatus
from socialbot.graph.node import Delivery

UP_TOPIC, DOWN_TOPIC = "/socialbot/up", "/socialbot/down"

SAY_EVERY_S = 1.0
HEARD_S = 2.0
"""How long the last word waits until those who are connected have it."""

MOST_RUNS = 1000
"""So many runs are noted; a stranger may make up any number."""

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")

S = TypeVar("S", bound=Structured)

log = logging.getLogger("socialbot.presence")


class RunAnnouncer:
    """Tells through the rclpy node ``ros`` that ``graph`` is up, and calls ``ask`` when it is to end.

    Use it as a context manager: leaving it tells that all has ended, and with which error. ``ask`` is called in the
    thread that spins ``ros``.
    """

    def __init__(self, ros: Any, graph: str, ask: Callable[[], None]) -> None:
        self.run = secrets.token_hex(8)
        self._graph = graph
        self._ask = ask
        self._boot = boot()
        self._said_at = 0.0
        self._asked = False
        self._ended = False
        self._speaking = threading.Lock()
        self._publisher = ros.create_publisher(
            message_class(ros_type(UpStatus)), UP_TOPIC, publisher_qos(Delivery.EVERY)
        )
        self._sender = open_transport().sender(self._publisher)
        self._others: set[str] = set()
        self._ear = _Ear(ros, DOWN_TOPIC, DownRequest, self._take)
        self._listening = _Ear(ros, UP_TOPIC, UpStatus, self._hear)

    def __enter__(self) -> RunAnnouncer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        from rclpy.duration import Duration

        self._say("ended", str(error) if error is not None else "")
        self._publisher.wait_for_all_acked(Duration(seconds=HEARD_S))

    @property
    def refused(self) -> int:
        """How many requests to end were not to be believed."""
        return self._ear.refused

    def tell(self) -> None:
        """Says that it is there, if it is time."""
        now = time.monotonic()
        if now >= self._said_at + SAY_EVERY_S:
            self._said_at = now
            self._say("ending" if self._asked else "up")

    def _take(self, request: DownRequest) -> None:
        if request.run != self.run:
            return
        if not self._asked:
            log.warning("asked to end by socialbot down")
        self._asked = True
        self._say("ending")
        self._ask()

    def _hear(self, status: UpStatus) -> None:
        """Tells, once, of another run with the same nodes: it may have been out of reach when this one began."""
        same = (status.graph, status.machine, status.state) == (self._graph, machine(), "up")
        if not same or status.run in self._others | {self.run} or len(self._others) >= MOST_RUNS:
            return
        self._others.add(status.run)
        if rounded(len(self._others)):
            where = f"here, process {status.pid}" if is_here(status) else "on another computer"
            log.error("%s on %s is up twice, the other %s: end one of them", status.graph, status.machine, where)

    def _say(self, state: UpState, reason: str = "") -> None:
        """Says how it is; that it has ended is the last word, even if it is asked once more."""
        status = UpStatus(
            stamp=WallClock().now(),
            run=self.run,
            graph=self._graph,
            machine=machine(),
            boot=self._boot,
            pid=os.getpid(),
            state=state,
            reason=reason,
        )
        with self._speaking:
            if not self._ended:
                self._ended = state == "ended"
                self._sender.publish(status)


class RunListener:
    """The runs of ``socialbot up`` that are heard through the rclpy node ``ros``, each with the last it has said."""

    def __init__(self, ros: Any) -> None:
        self.heard: dict[str, UpStatus] = {}
        self._ros = ros
        self._sender = open_transport().sender(
            ros.create_publisher(message_class(ros_type(DownRequest)), DOWN_TOPIC, publisher_qos(Delivery.EVERY))
        )
        self._ear = _Ear(ros, UP_TOPIC, UpStatus, self.note)

    @property
    def unheard(self) -> bool:
        """Whether somebody is connected who has not been heard yet."""
        live = sum(one.state != "ended" for one in tuple(self.heard.values()))
        return self._ros.count_publishers(UP_TOPIC) > live

    @property
    def refused(self) -> int:
        """How many times somebody said something that is not to be believed."""
        return self._ear.refused

    def ask_to_end(self, run: str) -> None:
        """Asks one of them to end. It may have to be said again: whoever is not connected yet does not hear it."""
        self._sender.publish(DownRequest(stamp=WallClock().now(), run=run))

    def note(self, status: UpStatus) -> None:
        """Takes what one of them says."""
        if status.run in self.heard or len(self.heard) < MOST_RUNS:
            self.heard[status.run] = status


def is_here(status: UpStatus) -> bool:
    """Whether this run is one of the computer that asks."""
    return status.boot == boot()


def is_gone(status: UpStatus, *, vanished: bool = False) -> bool:
    """Whether this run has ended, as it says or has ``vanished``; on this computer its process is gone, too."""
    return (vanished or status.state == "ended") and not (is_here(status) and _lives(status.pid))


def _lives(pid: int) -> bool:
    """Whether a process runs; one that has ended may wait for its parent to take note."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text("utf-8", errors="replace")
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] not in ("Z", "X")


def boot() -> str:
    """What only processes on this computer know, until it starts again."""
    return BOOT_ID.read_text("ascii").strip()


class _Ear(Generic[S]):
    """Hears one topic; what is not to be believed it refuses, counts and logs."""

    def __init__(self, ros: Any, topic: str, kind: type[S], take: Callable[[S], None]) -> None:
        self.refused = 0
        self._topic = topic
        self._kind = kind
        self._take = take
        self._receiver = open_transport().receiver(topic)
        qos = subscription_qos(Delivery.EVERY, outside=False)
        ros.create_subscription(message_class(ros_type(kind)), topic, self._receive, qos)

    def _receive(self, ros_message: Any) -> None:
        try:
            message = self._receiver.decode(self._kind, ros_message)
        except MessageError as error:
            self.refused += 1
            if rounded(self.refused):
                log.warning("%s, refused %d: %s", self._topic, self.refused, error)
            return
        if message is not None:
            self._take(message)
