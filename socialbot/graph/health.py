"""How nodes are: which of their inputs are silent, what they say of themselves, and where a silence begins.

An input with a deadline is silent when nothing has come for that long by the node's clock, or for `PERIODS` of its
usual periods where these are longer: a detector that takes its time is not silent. As long as the usual period is not
known, and before the first message, patience lasts `FIRST_S`.
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
from socialbot.graph.node import Graph, Input, Node, NodeConfig

HEALTH_TOPIC = "/health"
"""Where all nodes say how they are; each says it on `own_health_topic` as well if its graph listens there."""

BEAT_S = 0.15
"""How often a node gives a sign of life."""

SILENT_S = 0.35
"""The deadline of pictures and of what is seen in them: what is done about a silence is done within half a second."""

BEATLESS_S = 0.45
"""The deadline for signs of life."""

FIRST_S = 2.0
PERIODS = 2.5
LEAST_PERIODS = 3
PERIODS_KEPT = 9

AT_ONCE_S = 0.5
"""Nodes that vanish within this time have vanished together."""

LINK = "link"
"""What is silent when several nodes have vanished at once."""

_A_WHILE = nanoseconds(FIRST_S)

WORSE: Sequence[State] = ("ok", "ended", "waiting", "paused", "degraded", "failed")


@dataclass
class Watch:
    """Notices that an input, with those that may stand in for it, falls silent, and that it is back."""

    port: Input[Any]
    """The one that was heard last."""
    node: Node
    begun: int
    last: int | None = None
    told: bool = False
    """Whether the node knows that it is silent."""
    deadline: int = 0
    """The deadline (ns) when it was last asked for."""
    _periods: deque[int] = field(default_factory=lambda: deque(maxlen=PERIODS_KEPT))
    _returned: bool = False

    def came(self, port: Input[Any], now: int) -> None:
        """Notes a message; safe from any thread."""
        if self.last is not None:
            self._periods.append(now - self.last)
        self._returned = self.told
        self.port, self.last = port, now

    def due(self) -> int | None:
        """When (ns) it is silent if nothing comes; None when it is, or has no deadline."""
        self.deadline = patience = nanoseconds(self.node.deadline_s(self.port))
        if self.told or patience <= 0:
            return None
        if len(self._periods) < LEAST_PERIODS:
            patience = max(patience, nanoseconds(FIRST_S))
        else:
            patience = max(patience, round(PERIODS * median(tuple(self._periods))))
        return (self.begun if self.last is None else self.last) + patience

    def next_check(self, now: int) -> int | None:
        """When (ns) to check again; no later than `due`, also if later messages make the usual period shorter."""
        due = self.due()
        earliest = (self.begun if self.last is None else self.last) + self.deadline
        return due if due is None or earliest <= now else earliest

    def returned(self) -> bool:
        """Whether the node has to be told that it is back: something has come, or there is no deadline any more."""
        return self.told and (self._returned or self.node.deadline_s(self.port) <= 0)

    def turn(self) -> bool:
        """Becomes silent, or not silent any more; says which."""
        self.told, self._returned = not self.told, False
        return self.told


class HealthMonitor:
    """How one node is. The runner reports what comes (`came`) and asks when to look again (`due`).

    ``publish`` sends a `Health`; before `begin` none is sent but by `wait`.
    """

    def __init__(self, placement: NodeConfig, clock: Clock, publish: Callable[[Health], None]) -> None:
        self._name = placement.name
        self._clock = clock
        self._publish = publish
        self._topics = {port.name: topic for topic, port in placement.subscriptions}
        self._outputs = tuple(topic for topic, _ in placement.publications)
        self._watches: dict[str, Watch] = {}
        self._watch_of: dict[str, Watch] = {}
        self._next_check: int | None = None
        self._said: tuple[State, str] = ("ok", "")
        self._shown: Health | None = None
        self._node: Node | None = None

    def topic(self, port: Input[Any]) -> str:
        """The topic that ``port`` of this node is connected to."""
        return self._topics[port.name]

    def begin(self, node: Node, call_at: Callable[[int, Callable[[], None]], object]) -> None:
        """Begins to watch the inputs of ``node``, and to give signs of life by the timer ``call_at``."""
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
            self._show(again=True)
            call_at(self._clock.now() + nanoseconds(BEAT_S), beat)

        beat()

    def wait(self, lacking: str) -> None:
        """Says, before `begin`, that the node waits for the topics it is ``lacking``."""
        self._publish(
            Health(
                stamp=self._clock.now(),
                node=self._name,
                state="waiting",
                reason=f"nobody at the other end of {lacking} yet",
                outputs=self._outputs,
            )
        )

    def came(self, port: Input[Any], message: Message) -> bool:
        """Note that ``message`` was received; True if `look` or an earlier `due` may follow. Safe from any thread."""
        watch = self._watch_of.get(port.name)
        if watch is None or not watch.node.counts(port, message):
            return False
        now = self._clock.now()
        watch.came(port, now)
        return watch.told or self._next_check is None or self._next_check > now + watch.deadline

    def due(self) -> int | None:
        """When (ns) to check for silent inputs again; None if no input has a deadline or all are silent."""
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
        """Whether an input is back, and the node does not know it."""
        return any(watch.returned() for watch in self._watches.values() if watch.told)

    @property
    def pending(self) -> bool:
        """Whether `look` has a change to report to the node."""
        now = self._clock.now()
        for watch in self._watches.values():
            if watch.told:
                if watch.returned():
                    return True
            elif (due := watch.due()) is not None and due <= now:
                return True
        return False

    def look(self) -> None:
        """Tells the node of one input that is silent or back, if there is one; for the node's own thread."""
        now = self._clock.now()
        for watch in self._watches.values():
            if watch.last is not None and watch.last > now:
                watch.last = now  # the clock was set back
            due = watch.due()
            if watch.returned() or (due is not None and due <= now):
                silent = watch.turn()
                self._show()
                if silent:
                    watch.node.on_silence(watch.port, watch.last)
                else:
                    watch.node.on_return(watch.port)
                return

    def say(self, state: State, reason: str) -> None:
        """Takes what the node says of itself."""
        self._said = (state, reason)
        self._show()

    def health(self) -> Health:
        """How the node is now: the worst of what it says and what its inputs do."""
        state, reason = self._said
        silent = ()
        for watch in self._watches.values():
            if watch.told:
                silent = (*silent, self.topic(watch.port))
                its_state, its_reason = self._silence(watch)
                if WORSE.index(its_state) > WORSE.index(state):
                    state = its_state
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
            return "waiting", f"nothing on {topic} yet"
        return "degraded", f"nothing on {topic} since {time_of_day(watch.last)}"

    def _show(self, *, again: bool = False) -> None:
        if self._node is None:
            return
        health, before = self.health(), self._shown
        if again or before is None or (health.state, health.reason) != (before.state, before.reason):
            self._shown = health
            self._publish(health)


def own_health_topic(node: str) -> str:
    """Where the node of this name alone says how it is: little to hear for who needs no other's signs of life."""
    return f"/{node}{HEALTH_TOPIC}"


def health_topics(graph: Graph, node: str) -> list[str]:
    """The topics on which the node of this name says how it is."""
    own = own_health_topic(node)
    return [HEALTH_TOPIC, own] if own in graph.topics() else [HEALTH_TOPIC]


def ended(player: str, topics: tuple[str, ...], now: int) -> Health:
    """What the player of a recording says when it is over: that nothing comes on ``topics`` any more is no fault."""
    return Health(stamp=now, node=player, state="ended", reason="the recording is over", outputs=topics)


class FaultSource(NamedTuple):
    """``who`` is silent, a node, a topic that no node publishes, or `LINK`; ``source`` has noticed it."""

    who: str
    source: str
    reason: str


class Healths:
    """What the nodes of a graph have said of themselves, and when."""

    def __init__(self) -> None:
        self._said: dict[str, tuple[Health, int]] = {}
        self._ended: set[str] = set()

    def note(self, health: Health, now: int) -> None:
        """Take the health of a node at the time ``now`` (ns)."""
        self._said[health.node] = (health, now)
        (self._ended.add if health.state == "ended" else self._ended.discard)(health.node)

    @property
    def over(self) -> bool:
        """Whether a recording is over, so that no silence needs another reason."""
        return bool(self._ended)

    def goes_on(self, now: int) -> None:
        """Takes note that pictures come: a recording that was over some time ago is no reason any more why not."""
        for name in tuple(self._ended):
            if now - self._said[name][1] > _A_WHILE:
                del self._said[name]
                self._ended.discard(name)

    def silent_above(self, topic: str) -> bool:
        """Whether a node that publishes ``topic`` says that nothing comes to itself."""
        return any(health.silent for health, _ in self._publishers(topic))

    def blame(self, topic: str, now: int, *, source: str) -> FaultSource:
        """Where the silence of ``topic`` begins, which ``source`` has noticed: silent topics are followed upwards."""
        passed: set[str] = set()
        reason = ""
        while found := self._publishers(topic):
            health, heard = max(found, key=lambda said: said[1])
            if health.silent and health.node not in passed and not self._vanished(heard, now):
                passed.add(health.node)
                topic, source, reason = health.silent[0], health.node, health.reason
                continue
            if self._vanished_together(heard, now):
                return FaultSource(LINK, source, reason)
            return FaultSource(health.node, source, health.reason or reason)
        return FaultSource(topic, source, reason)

    def _publishers(self, topic: str) -> list[tuple[Health, int]]:
        return [said for said in self._said.values() if topic in said[0].outputs]

    def _vanished(self, heard: int, now: int) -> bool:
        return now - heard > nanoseconds(BEATLESS_S)

    def _vanished_together(self, heard: int, now: int) -> bool:
        others = [one for health, one in self._said.values() if health.state != "ended"]
        gone = [one for one in others if self._vanished(one, now) and abs(one - heard) < nanoseconds(AT_ONCE_S)]
        return self._vanished(heard, now) and len(gone) > 1


def time_of_day(time: int) -> str:
    """``time`` (ns) as a clock at UTC shows it, with tenths of a second."""
    moment = datetime.fromtimestamp(time / SECOND, timezone.utc)
    return f"{moment:%H:%M:%S}.{moment.microsecond // 100_000}"
