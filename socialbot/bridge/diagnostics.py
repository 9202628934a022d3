"""ROS diagnostics: statistics of each node on /diagnostics, once a second."""

from __future__ import annotations

import itertools
import os
import resource
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from socket import gethostname
from typing import TYPE_CHECKING, Any, cast, get_args

import msgspec
import numpy as np
from msgspec.structs import replace

from socialbot.bridge.environment import steady_timer
from socialbot.bridge.qos import observer_qos
from socialbot.bridge.stream_watch import Note, noting
from socialbot.bridge.transport import Listener, deserialized, log_refusal, message_class, open_transport
from socialbot.core.decoding import json_decoder
from socialbot.core.errors import MessageError
from socialbot.core.messages import NO_JSON, Health, State
from socialbot.graph.node import Graph

if TYPE_CHECKING:
    from rclpy.node import Node as RosNode

    from socialbot.bridge._callback_queue import InputQueue
    from socialbot.bridge.transport import Sender

DIAGNOSTICS_TOPIC = "/diagnostics"
SEAL = "seal"  # key of the sealed copy of name and values
HEALTH, REASON, SILENT = "health", "health_reason", "health_silent"  # keys of the node's health; empty without one
UNCONNECTED = "unconnected"  # key of the topics without a peer; empty if the node is connected
MACHINE_VARIABLE = "SOCIALBOT_MACHINE"  # variable with the name of this machine in a deployment; default: the host name
RESTARTS_VARIABLE = "SOCIALBOT_RESTARTS"  # variable with the number of restarts, set by the supervisor
LAST_ERROR_VARIABLE = "SOCIALBOT_LAST_ERROR"  # variable with the error of the previous process, set by the supervisor
TICK_S = 0.1
TICKS_PER_REPORT = 10
PERCENTILE_WINDOW = 600
MAX_BYTES = 1 << 18  # Python makes an object of each value, at 10 MB/s, and calls nothing else meanwhile
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20

_LEVELS: Mapping[str, str] = {"failed": "ERROR", "degraded": "WARN", "waiting": "WARN"}
"""Level on /diagnostics of a node that is not well, by the state of its health."""

OnStatus = Callable[[str, dict[str, str]], None]  # receives the name of a node and the values of its status
_DECODER = json_decoder(tuple[str, dict[str, str]])


class DiagnosticsPublisher:
    """Publish node statuses through the rclpy node ``ros``, sealed if keys are set."""

    def __init__(self, ros: Any) -> None:
        self._ros = ros
        self._stream = open_transport().stream(DIAGNOSTICS_TOPIC)
        self._array = message_class("diagnostic_msgs/msg/DiagnosticArray")
        self._publisher = ros.create_publisher(self._array, DIAGNOSTICS_TOPIC, 10)

    def publish(self, statuses: list[Any]) -> None:
        for status in statuses:
            self._seal(status)
        array = self._array(status=statuses)
        array.header.stamp = self._ros.get_clock().now().to_msg()
        self._publisher.publish(array)

    def publish_dead(self, nodes: Mapping[str, Mapping[str, str]]) -> None:
        """Publish the values of nodes without a process: ``state``, ``restarts`` and ``last_error``.

        Each has a message of its own, so that none is longer than `MAX_BYTES`.
        """
        for name, values in nodes.items():
            state, error = values["state"], values["last_error"]
            text = f"{state}: the process {error}" if error else state
            self.publish([status_of(name, "STALE" if state == "ended" else "ERROR", text, values)])

    def _seal(self, status: Any) -> None:
        if self._stream is not None:
            text = msgspec.json.encode((status.name, values_of(status))).decode()
            status.values = [*status.values, _key_value(SEAL, self._stream.seal(text))]


class DiagnosticsSubscriber:
    """Subscriber that calls ``on_status`` with each valid status, in the thread that spins ``ros``.

    ``refused`` counts invalid statuses, which are also logged. If keys are set, statuses of other programs are ignored.
    """

    def __init__(self, ros: Any, on_status: OnStatus) -> None:
        self.refused = 0
        self._on_status = on_status
        transport = open_transport()
        self._opener = transport.opener(DIAGNOSTICS_TOPIC)
        if self._opener is not None:
            self._opener.watch.has_foreign = True
        array = message_class("diagnostic_msgs/msg/DiagnosticArray")
        qos = observer_qos(latched=False)

        def subscribe(note: Note) -> Any:
            take = noting(note, lambda cdr, _: self._take(cdr, array))
            return ros.create_subscription(array, DIAGNOSTICS_TOPIC, take, qos, raw=True)

        self.listener = Listener(transport.watched(ros, subscribe, self._opener))

    def destroy(self, ros: Any) -> None:
        """Remove the subscription from the node ``ros``."""
        self.listener.destroy(ros)

    def _take(self, cdr: bytes, array: Any) -> None:
        try:
            if len(cdr) > MAX_BYTES:
                raise MessageError(f"{len(cdr)} bytes are more than {MAX_BYTES}")
            message = deserialized(cdr, array)
        except MessageError as error:
            self._refuse(error)
        else:
            self._receive(message)

    def _refuse(self, error: MessageError) -> None:
        self.refused += 1
        log_refusal(DIAGNOSTICS_TOPIC, self.refused, error)

    def _receive(self, array: Any) -> None:
        for status in array.status:
            try:
                verified = self._verify(status)
            except MessageError as error:
                self._refuse(error)
            else:
                if verified is not None:
                    self._on_status(*verified)

    def _verify(self, status: Any) -> tuple[str, dict[str, str]] | None:
        """Name and values of ``status``; None for an unsealed driver. Raises MessageError if it is forged."""
        values = values_of(status)
        seal = values.pop(SEAL, "")
        if self._opener is None:
            return status.name, values
        if not seal and not is_socialbot_status(values):
            return None
        text = self._opener.open(seal)
        try:
            return None if text is None else _DECODER.decode(text)
        except NO_JSON as error:
            raise MessageError(f"not a valid status: {error}") from error


def is_socialbot_status(values: Mapping[str, str]) -> bool:
    """Whether ``values`` are from socialbot or forged. Drivers publish other keys."""
    return "state" in values and "machine" in values


def values_of(status: Any) -> dict[str, str]:
    """Values of a DiagnosticStatus by key."""
    return {pair.key: pair.value for pair in status.values}


def health_in(name: str, values: Mapping[str, str], stamp: int, outputs: tuple[str, ...]) -> Health | None:
    """Health of a node that publishes ``outputs``, by the values of its status; None if they have none."""
    state = values.get(HEALTH, "")
    if state not in get_args(State):
        return None
    silent = tuple(filter(None, values.get(SILENT, "").split(", ")))
    reason = values.get(REASON, "")
    return Health(stamp=stamp, node=name, state=cast("State", state), reason=reason, silent=silent, outputs=outputs)


def _key_value(key: str, value: object) -> Any:
    return message_class("diagnostic_msgs/msg/KeyValue")(key=key, value=str(value))


@dataclass(frozen=True)
class Connection:
    """Endpoint of a topic, with its expected number of peers and a function that counts them.

    Each endpoint counts its own peers: two endpoints may be visible to others before they discover each other, and
    earlier messages are lost.
    """

    topic: str
    wanted: int
    count: Callable[[], int]
    endpoint: Any


def publisher_connection(graph: Graph, topic: str, publisher: Any) -> Connection:
    """Connection of an rclpy publisher to its subscribers in ``graph``."""
    subscribers = sum(topic == name for node in graph.nodes for name, _ in node.subscriptions)
    return Connection(topic, subscribers, publisher.get_subscription_count, publisher)


def subscription_connection(
    graph: Graph, topic: str, subscription: Any, nodes: Collection[str] | None = None
) -> Connection:
    """Connection of an rclpy subscription to its publishers in ``graph``, or to those of these ``nodes``."""
    publishing = [node for node in graph.nodes if nodes is None or node.name in nodes]
    publishers = sum(topic == name for node in publishing for name, _ in node.publications)
    return Connection(topic, publishers, subscription.get_publisher_count, subscription)


def sender_connections(graph: Graph, topic: str, sender: Sender) -> list[Connection]:
    """Connections of the publishers of ``sender``: of messages, and of detached seals."""
    publishers = [sender.publisher] if sender.seals is None else [sender.publisher, sender.seals]
    return [publisher_connection(graph, topic, each) for each in publishers]


def listener_connections(graph: Graph, topic: str, listener: Listener) -> list[Connection]:
    """Connections of the subscriptions of ``listener``: to messages, and to detached seals."""
    endpoints = [listener.endpoint] if listener.seals is None else [listener.endpoint, listener.seals]
    return [subscription_connection(graph, topic, each) for each in endpoints]


def unconnected(connections: Iterable[Connection]) -> str:
    """Topics without a peer, separated by commas."""
    return ", ".join(dict.fromkeys(one.topic for one in connections if one.count() < one.wanted))


def _last_values() -> deque[float]:
    return deque(maxlen=PERCENTILE_WINDOW)


@dataclass
class NodeStatistics:
    """Call counts of one node since its start, and its last durations (s) and message ages (s).

    The age of a message is measured from its stamp to the end of its callback, by the clock of the node.
    """

    calls: int = 0
    published: int = 0
    failures: int = 0
    refusals: Counter[str] = field(default_factory=Counter)
    """Refused messages by reason."""
    resubscribed: Counter[str] = field(default_factory=Counter)
    """How often the node subscribed again because messages did not arrive, by topic."""
    first_failure: str = ""
    durations: deque[float] = field(default_factory=_last_values)
    ages: deque[float] = field(default_factory=_last_values)
    longest_publication: float = 0.0
    """Longest publish call (s) since the last report."""
    longest_block: float = 0.0
    """Longest time (s) in such a call neither running nor runnable."""

    @property
    def refused(self) -> int:
        return self.refusals.total()

    def count_call(self, seconds: float) -> None:
        self.calls += 1
        self.durations.append(seconds)

    def count_publication(self, seconds: float, blocked: float) -> None:
        """Count a published message with the duration (s) and the blocked time (s) of its call."""
        self.published += 1
        self.longest_publication = max(self.longest_publication, seconds)
        self.longest_block = max(self.longest_block, blocked)

    def take_longest_publication(self) -> tuple[float, float]:
        """Return and reset the longest publication and block (s)."""
        longest = self.longest_publication, self.longest_block
        self.longest_publication = self.longest_block = 0.0
        return longest


def counts(by_name: Mapping[str, int]) -> str:
    """Counts by name as text, such as ``2 forged, 1 late``."""
    return ", ".join(f"{count} {name}" for name, count in sorted(by_name.items()))


def duration_stats(durations: Collection[float]) -> tuple[float, float, float]:
    """Mean, 50th and 99th percentile of durations (s); zeros without any."""
    if not durations:
        return 0.0, 0.0, 0.0
    values = np.fromiter(durations, float)
    p50, p99 = np.percentile(values, (50, 99), method="higher")
    return float(values.mean()), float(p50), float(p99)


def rates(before: Mapping[str, float], after: Mapping[str, float], seconds: float) -> dict[str, float]:
    """Increase of each counter per second."""
    return {name: round((count - before[name]) / seconds, 1) for name, count in after.items()}


class DiagnosticsReporter:
    """Publish the statistics of one node once a second, and whenever its connections or its health change."""

    def __init__(
        self,
        ros: RosNode,
        statistics: NodeStatistics,
        connections: Sequence[Connection],
        inputs: Callable[[], Sequence[InputQueue]],
        state: Callable[[], str],
        health: Callable[[], Health | None],
    ) -> None:
        self._ros = ros
        self._statistics = statistics
        self._connections = connections
        self._inputs = inputs
        self._state = state
        self._health = health
        self._ticks = itertools.count()
        self._shown: tuple[str, Health | None] = ("", None)
        self._counted_at, self._counts = time.monotonic(), self._count()
        self._rates: dict[str, float] = {}
        self._publisher = DiagnosticsPublisher(ros)
        self._timer = steady_timer(ros, TICK_S, self._tick)

    def _tick(self) -> None:
        state = self._state()
        missing = unconnected(self._connections) if state == "active" else state
        health = self._health() if state == "active" else None
        shown = missing, None if health is None else replace(health, stamp=0)
        is_due = next(self._ticks) % TICKS_PER_REPORT == 0
        if is_due:
            now, counts = time.monotonic(), self._count()
            self._rates = rates(self._counts, counts, now - self._counted_at)
            self._counted_at, self._counts = now, counts
        if is_due or shown != self._shown:
            self._shown = shown
            self._publisher.publish([self._current_status(state, missing, health)])

    def _count(self) -> dict[str, float]:
        statistics = self._statistics
        return {"call_hz": statistics.calls, "publish_hz": statistics.published, "cpu_percent": 100 * _cpu_s()}

    def _current_status(self, state: str, missing: str, health: Health | None) -> Any:
        statistics, inputs = self._statistics, self._inputs()
        call_mean, call_p50, call_p99 = duration_stats(statistics.durations)
        age_mean, _, age_p99 = duration_stats(statistics.ages)
        publication, block = statistics.take_longest_publication()
        dropped = counts({one.port.name: one.dropped for one in inputs if one.dropped})
        values: dict[str, Any] = {
            "state": state,
            "restarts": restarts(),
            "last_error": os.environ.get(LAST_ERROR_VARIABLE, ""),
            "calls": statistics.calls,
            "failures": statistics.failures,
            "refused": statistics.refused,
            "refusals": counts(statistics.refusals),
            "resubscribed": counts(statistics.resubscribed),
            "first_failure": statistics.first_failure,
            "received": sum(one.received for one in inputs),
            "skipped": sum(one.skipped for one in inputs),
            "dropped": dropped,
            "call_mean_ms": round(1000 * call_mean, 3),
            "call_p50_ms": round(1000 * call_p50, 3),
            "call_p99_ms": round(1000 * call_p99, 3),
            "age_mean_ms": round(1000 * age_mean, 1),
            "age_p99_ms": round(1000 * age_p99, 1),
            "publish_max_ms": round(1000 * publication, 3),
            "publish_blocked_max_ms": round(1000 * block, 3),
            "pid": os.getpid(),
            **self._rates,
            **process_costs(),
            UNCONNECTED: missing,
            HEALTH: "" if health is None else health.state,
            REASON: "" if health is None else health.reason,
            SILENT: "" if health is None else ", ".join(health.silent),
        }
        summary = "running" if state == "active" else state
        problems = {
            "dropped messages": dropped,
            "missed messages": statistics.resubscribed,
            "refused messages": statistics.refused,
            summary: statistics.failures,
        }
        failing = [text for text, applies in problems.items() if applies]
        level = "WARN" if failing or missing else "OK"
        text = statistics.first_failure or next(iter(failing), summary)
        if health is not None and health.state in _LEVELS:
            level, text = _LEVELS[health.state], health.reason
        return status_of(self._ros.get_name(), level, text, values)


def status_of(name: str, level: str, text: str, values: Mapping[str, Any]) -> Any:
    """Return a DiagnosticStatus with a ``level`` such as "OK" or "ERROR"."""
    kind = message_class("diagnostic_msgs/msg/DiagnosticStatus")
    pairs = [_key_value(key, value) for key, value in {"machine": machine(), **values}.items()]
    return kind(level=getattr(kind, level), name=name, message=text, hardware_id=machine(), values=pairs)


def restarts() -> int:
    """Number of restarts of this process."""
    return int(os.environ.get(RESTARTS_VARIABLE) or 0)


def machine() -> str:
    """The name of this machine."""
    return os.environ.get(MACHINE_VARIABLE) or gethostname()


def _cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def process_costs() -> dict[str, float]:
    """CPU seconds, memory and peak memory (MB) of this process."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    with open("/proc/self/statm", encoding="ascii") as statm:
        rss = int(statm.read().split()[1]) * PAGE_MB
    return {"cpu_s": round(_cpu_s(), 3), "rss_mb": round(rss, 1), "peak_rss_mb": round(peak, 1)}
