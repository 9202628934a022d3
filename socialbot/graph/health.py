"""Health monitoring: deadlines of inputs, health of nodes, and the source of a fault.

An input is silent when it receives no message within its deadline. The deadline is at least `PERIODS` times the median
period of the input, so a slow publisher is not silent. It is at least `FIRST_S` until that period is known, and for the
first messages after a silence, when publishers start again or catch up.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from statistics import median
from typing import Any, NamedTuple

from socialbot.core.clock import SECOND, Clock, nanoseconds
from socialbot.core.messages import Health, Message, State
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Input
from socialbot.graph.services import ClientPort

HEALTH_TOPIC = "/health"
"""Health topic of all nodes. Nodes also publish on `own_health_topic` if a node of the graph subscribes to it."""

BEAT_S = 0.15
"""Heartbeat period of a node on its own health topic."""

COMMON_BEATS = 2
"""Only each second heartbeat goes to `HEALTH_TOPIC` too, for slow networks. A change goes there at once."""

SILENT_S = 0.35
"""Deadline of images and detections. It leaves time to react within half a second."""

BEATLESS_S = 0.45
"""Deadline of heartbeats."""

GONE_S = 0.6
"""Time without a heartbeat on `HEALTH_TOPIC` after which a node counts as gone."""

FIRST_S = 2.0
PERIODS = 2.5
LEAST_PERIODS = 3
PERIODS_KEPT = 9

AT_ONCE_S = 0.5
"""Nodes that time out within this interval share one cause."""

LINK = "link"
"""Fault source when several nodes time out at once."""

_UNCONNECTED = "unconnected: "
_A_WHILE = nanoseconds(FIRST_S)

WORSE: Sequence[State] = ("ok", "ended", "waiting", "paused", "degraded", "failed")


@dataclass
class Watch:
    """Deadline watch of an input and its alternatives."""

    port: Input[Any]
    """The input with the newest message."""
    node: Node
    begun: int
    last: int | None = None
    is_silent: bool = False
    """Whether the node was notified of the silence."""
    deadline: int = 0
    """The deadline (ns) at the last check."""
    _periods: deque[int] = field(default_factory=lambda: deque(maxlen=PERIODS_KEPT))
    _normal_gap: int = 0
    """Longest gap (ns) that the median period allows; 0 with too few messages."""
    _returned: bool = False
    _new: int = 0
    """Number of messages at the begin or since the last silence."""

    def came(self, port: Input[Any], now: int) -> None:
        """Record a message; thread-safe."""
        if self.last is not None:
            self._periods.append(now - self.last)
            if len(self._periods) >= LEAST_PERIODS:
                self._normal_gap = round(PERIODS * median(self._periods))
        self._returned = self.is_silent
        self._new = 1 if self.is_silent else self._new + 1
        self.port, self.last = port, now

    def due(self) -> int | None:
        """The time (ns) when the input becomes silent; None if it is silent or has no deadline."""
        self.deadline = patience = nanoseconds(self.node.deadline_s(self.port))
        if self.is_silent or patience <= 0:
            return None
        if self._new <= LEAST_PERIODS:
            patience = max(patience, nanoseconds(FIRST_S))
        return (self.begun if self.last is None else self.last) + max(patience, self._normal_gap)

    def next_check(self, now: int) -> int | None:
        """The time (ns) of the next check. It may precede `due`, since new messages can shorten the median period."""
        due = self.due()
        earliest = (self.begun if self.last is None else self.last) + self.deadline
        return due if due is None or earliest <= now else earliest

    def returned(self) -> bool:
        """Whether a silent input has a new message, or no deadline any more."""
        return self.is_silent and (self._returned or self.node.deadline_s(self.port) <= 0)

    def toggle(self) -> bool:
        """Toggle between silent and not silent; return the new state."""
        self.is_silent, self._returned = not self.is_silent, False
        return self.is_silent


class HealthMonitor:
    """Health monitor of one node, driven by its runner through `came`, `due` and `look`.

    It sends `Health` messages by ``publish``, with True for those to all topics, and False for those to the topic of
    this node only. Before `begin` only `wait` sends any.
    """

    def __init__(self, config: NodeConfig, clock: Clock, publish: Callable[[Health, bool], None]) -> None:
        self._name = config.name
        self._clock = clock
        self._publish = publish
        self._topics = {port.name: topic for topic, port in config.subscriptions}
        self._outputs = tuple(topic for topic, _ in config.publications)
        self._watches: dict[str, Watch] = {}
        self._watch_of: dict[str, Watch] = {}
        self._next_check: int | None = None
        self._reported: tuple[State, str] = ("ok", "")
        self._absent: dict[str, None] = {}
        """Services and actions without a server, in order."""
        self._mismatches: dict[str, str] = {}
        """Reasons why publishers do not match an input, by its name."""
        self._shown: Health | None = None
        self._beats = 0
        """Number of heartbeats."""
        self._node: Node | None = None

    def topic(self, port: Input[Any]) -> str:
        """The topic of ``port``."""
        return self._topics[port.name]

    def begin(self, node: Node, call_at: Callable[[int, Callable[[], None]], object]) -> None:
        """Start to watch the inputs of ``node`` and to publish heartbeats, with ``call_at`` as the timer."""
        self._node = node
        now = self._clock.now()
        for name, port in node.inputs().items():
            if port.deadline_s > 0 and port.alternative_to is None:
                self._watches[name] = Watch(port, node, now)
        for name, port in node.inputs().items():
            watch = self._watches.get(name if port.alternative_to is None else port.alternative_to.name)
            if watch is not None:
                self._watch_of[name] = watch

        def beat() -> None:
            self._show(beat=True)
            self._beats += 1
            call_at(self._clock.now() + nanoseconds(BEAT_S), beat)

        beat()

    def wait(self, lacking: str) -> None:
        """Publish, before `begin`, that the node waits for the topics ``lacking``."""
        self._publish(
            Health(
                stamp=self._clock.now(),
                node=self._name,
                state="waiting",
                reason=f"{_UNCONNECTED}{lacking}",
                outputs=self._outputs,
            ),
            True,
        )

    def came(self, port: Input[Any], message: Message) -> bool:
        """Record a message; thread-safe. Return True if the runner must call `look`, or `due` is earlier now."""
        watch = self._watch_of.get(port.name)
        if watch is None or not watch.node.counts(port, message):
            return False
        now = self._clock.now()
        watch.came(port, now)
        return watch.is_silent or self._next_check is None or self._next_check > now + watch.deadline

    def due(self) -> int | None:
        """The time (ns) of the next check; None if no input has a deadline or all are silent."""
        now = self._clock.now()
        first = None
        for watch in self._watches.values():
            check = watch.next_check(now)
            if check is not None and (first is None or check < first):
                first = check
        self._next_check = first
        return first

    @property
    def returned(self) -> bool:
        """Whether an input is back and the node was not notified."""
        return any(watch.returned() for watch in self._watches.values() if watch.is_silent)

    @property
    def pending(self) -> bool:
        """Whether `look` would notify the node of a change."""
        now = self._clock.now()
        for watch in self._watches.values():
            if watch.is_silent:
                if watch.returned():
                    return True
            elif (due := watch.due()) is not None and due <= now:
                return True
        return False

    def look(self) -> None:
        """Notify the node of at most one input that is silent or back; call it in the thread of the node."""
        now = self._clock.now()
        for watch in self._watches.values():
            if watch.last is not None and watch.last > now:
                watch.last = now  # the clock was set back
            due = watch.due()
            if watch.returned() or (due is not None and due <= now):
                silent = watch.toggle()
                self._show()
                if silent:
                    watch.node.on_silence(watch.port, watch.last)
                else:
                    watch.node.on_return(watch.port)
                return

    def note_server(self, port: ClientPort, topic: str, *, present: bool) -> None:
        """Report and notify the node that the server of a client is absent, or back; call it in its thread."""
        if self._node is None or present == (topic not in self._absent):
            return
        if present:
            del self._absent[topic]
        else:
            self._absent[topic] = None
        self._show()
        self._node.on_server(port, present=present)

    def note_mismatch(self, port: Input[Any], reason: str) -> None:
        """Report why a publisher does not match an input; empty: messages arrive. Call it in the thread of the node."""
        if reason:
            self._mismatches[port.name] = reason
        else:
            self._mismatches.pop(port.name, None)
        self._show()

    def say(self, state: State, reason: str) -> None:
        """Set the state and reason that the node reports."""
        self._reported = (state, reason)
        self._show()

    @property
    def shown(self) -> Health | None:
        """The health that was published last, also for other threads; None before the first."""
        return self._shown

    def health(self) -> Health:
        """The worst of the reported state and the states of the inputs."""
        state, reason = self._reported
        silent = ()
        for watch in self._watches.values():
            if watch.is_silent:
                silent = (*silent, self.topic(watch.port))
                its_state, its_reason = self._silence(watch)
                if WORSE.index(its_state) > WORSE.index(state):
                    state = its_state
                reason = f"{reason}; {its_reason}" if reason else its_reason
        for its_reason in (*(f"no server of {topic}" for topic in self._absent), *self._mismatches.values()):
            if WORSE.index("degraded") > WORSE.index(state):
                state = "degraded"
            reason = f"{reason}; {its_reason}" if reason else its_reason
        return Health(
            stamp=self._clock.now(),
            node=self._name,
            state=state,
            reason=reason,
            silent=silent,
            outputs=self._outputs,
        )

    def _silence(self, watch: Watch) -> tuple[State, str]:
        topic = self.topic(watch.port)
        if watch.last is None:
            return "waiting", f"no message on {topic} yet"
        return "degraded", f"no message on {topic} since {time_of_day(watch.last)}"

    def _show(self, *, beat: bool = False) -> None:
        if self._node is None:
            return
        health, before = self.health(), self._shown
        is_new = before is None or (health.state, health.reason) != (before.state, before.reason)
        if is_new or beat:
            self._shown = health
            self._publish(health, is_new or self._beats % COMMON_BEATS == 0)


def is_unconnected(health: Health) -> bool:
    """Whether a node has not begun yet, because it waits for its connections."""
    return health.state == "waiting" and health.reason.startswith(_UNCONNECTED)


def own_health_topic(node: str) -> str:
    """The health topic of one node, for subscribers that need no other heartbeats."""
    return f"/{node}{HEALTH_TOPIC}"


def health_topics(graph: Graph, node: str) -> list[str]:
    """The topics on which ``node`` publishes its health."""
    own = own_health_topic(node)
    return [HEALTH_TOPIC, own] if own in graph.topics() else [HEALTH_TOPIC]


def publishers(graph: Graph, topic: str) -> list[str]:
    """Names of the nodes that publish on ``topic``, also their health."""
    return [
        config.name
        for config in graph.nodes
        if topic in {name for name, _ in config.publications} or topic in health_topics(graph, config.name)
    ]


def ended(player: str, topics: tuple[str, ...], now: int) -> Health:
    """The health of a bag player at the end of the bag: silence on ``topics`` is then no fault."""
    return Health(stamp=now, node=player, state="ended", reason="the recording is over", outputs=topics)


class FaultSource(NamedTuple):
    """Source of a fault.

    ``who`` is a node, a topic without a publisher, or `LINK`; ``source`` is the node that reported it.
    """

    who: str
    source: str
    reason: str


class HealthReports:
    """Last reported health of the nodes of a graph."""

    def __init__(self) -> None:
        self._reported: dict[str, tuple[Health, int]] = {}
        self._ended: set[str] = set()

    def note(self, health: Health, now: int) -> None:
        """Record the health of a node at the time ``now`` (ns)."""
        self._reported[health.node] = (health, now)
        (self._ended.add if health.state == "ended" else self._ended.discard)(health.node)

    @property
    def over(self) -> bool:
        """Whether a recording has ended, which explains any silence."""
        return bool(self._ended)

    def goes_on(self, now: int) -> None:
        """Record that images arrive; forget recordings that ended some time ago."""
        for name in tuple(self._ended):
            if now - self._reported[name][1] > _A_WHILE:
                del self._reported[name]
                self._ended.discard(name)

    def is_upstream_silent(self, topic: str) -> bool:
        """Whether a publisher of ``topic`` has a silent input itself."""
        return any(health.silent for health, _ in self._publishers(topic))

    def blame(self, topic: str, now: int, *, source: str) -> FaultSource:
        """Trace the silence of ``topic``, which ``source`` noticed, upstream to its cause."""
        passed: set[str] = set()
        reason = ""
        while found := self._publishers(topic):
            health, received = max(found, key=lambda said: said[1])
            if health.silent and health.node not in passed and not self._is_gone(received, now):
                passed.add(health.node)
                topic, source, reason = health.silent[0], health.node, health.reason
                continue
            if self._are_gone_together(received, now):
                return FaultSource(LINK, source, reason)
            return FaultSource(health.node, source, health.reason or reason)
        return FaultSource(topic, source, reason)

    def _publishers(self, topic: str) -> list[tuple[Health, int]]:
        return [said for said in self._reported.values() if topic in said[0].outputs]

    def _is_gone(self, received: int, now: int) -> bool:
        return now - received > nanoseconds(GONE_S)

    def _are_gone_together(self, received: int, now: int) -> bool:
        others = [one for health, one in self._reported.values() if health.state != "ended"]
        gone = [one for one in others if self._is_gone(one, now) and abs(one - received) < nanoseconds(AT_ONCE_S)]
        return self._is_gone(received, now) and len(gone) > 1


def time_of_day(time: int) -> str:
    """Format ``time`` (ns) as UTC time of day with tenths of a second."""
    moment = datetime.fromtimestamp(time / SECOND, timezone.utc)
    return f"{moment:%H:%M:%S}.{moment.microsecond // 100_000}"
