"""Simulated time of a graph in steps, with the same results on a busy machine.

DDS keeps no order between topics: a time could overtake messages that were published before. So a step has rounds. In
the first one nodes call their timers. In the next ones they handle the messages of the round before. They hold later
messages. A round starts when all nodes are idle and all messages have arrived. The step ends when there are none.

Nodes report the number of messages that they have sent and got on each topic, and the clock compares them.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, TypeVar

import msgspec

from socialbot.bridge.qos import observer_qos
from socialbot.bridge.transport import Sender, Subscription, log_refusals, open_transport
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.decoding import from_json
from socialbot.core.errors import MessageError, NodeError
from socialbot.core.messages import NO_JSON, Structured
from socialbot.graph.ports import Delivery

T = TypeVar("T", bound="_ClockMessage")

log = logging.getLogger("socialbot.sim_clock")

CLOCK_TOPIC = "/clock"

KEPT_TOPIC = "/clock_kept"
"""Topic of the reports of nodes (std_msgs/String with a `StepReport`)."""

ROUND_TOPIC = "/clock_round"
"""Topic of the rounds of a simulation clock (std_msgs/String with a `Round`)."""

CLOCK_STEP_S = 0.1
STEP_TIMEOUT_S = 30.0  # real time (s) that a node has for the work of one step
DELIVERY_TIMEOUT_S = 5.0  # real time (s) that a message may be in transit
REPEAT_S = 0.25  # real time (s) after which time and round are published again, for a new node; doubles each time
MAX_REPEAT_S = 2.0


class _ClockMessage(msgspec.Struct, frozen=True):
    def encode(self) -> str:
        return msgspec.json.encode(self).decode()

    @classmethod
    def decode(cls: type[T], text: str) -> T:
        """Decode a message. Raises MessageError if it is invalid."""
        try:
            return from_json(text, cls)
        except NO_JSON as error:
            raise MessageError(f"not a valid message of a simulation clock: {error}") from error


class Round(_ClockMessage, frozen=True):
    """Start of a round.

    Attributes:
        number: Nodes handle the messages that they hold if it is higher than before.
        repeat: Nodes report again if it is higher than before.
        arrived: Number of messages, by node, that had arrived before the round. Later ones belong to the next round:
            another node sent them when it learned of this round earlier.
    """

    number: int
    repeat: int
    arrived: Mapping[str, int]


class StepReport(_ClockMessage, frozen=True):
    """Report of a node that has no work left.

    Attributes:
        node: Its name.
        instance: Id that changes when the node restarts.
        time: The time (ns) up to which its timers were called.
        sent: Number of messages that it has published by topic.
        taken: Number of messages that it has got by topic, for reliable subscriptions.
        held: Number of those that wait for the next round.
        round: Number of the last round.
        repeat: The last request to report again.
        arrived: Number of all messages that it has got.
    """

    node: str
    instance: str
    time: int
    sent: Mapping[str, int]
    taken: Mapping[str, int]
    held: int
    round: int
    repeat: int
    arrived: int


class SimClock:
    """Clock of a graph, published through the rclpy node ``ros``, which another thread spins.

    ``now`` is the time (ns), which changes only in `advance` and `until`. ``awaited`` are the names of the nodes to
    wait for: remove a node that leaves, add one that joins.

    Args:
        start: The first time (ns).
        step_s: The longest step.
        senders: Senders of this process to the graph, whose messages the nodes must have handled.
        subscriptions: Subscriptions of this process, which must have got the messages of the nodes.
    """

    def __init__(
        self,
        ros: Any,
        nodes: Iterable[str],
        *,
        start: int = SECOND,
        step_s: float = CLOCK_STEP_S,
        senders: Iterable[Sender] = (),
        subscriptions: Iterable[Subscription[Any]] = (),
    ) -> None:
        from rosgraph_msgs.msg import Clock
        from std_msgs.msg import String

        self.now = start
        self.awaited = set(nodes)
        self._name = ros.get_name()
        self._step = nanoseconds(step_s)
        self._senders = tuple(senders)
        self._subscriptions = tuple(subscriptions)
        self._balance = MessageBalance()
        self._changed = threading.Condition()
        self._refuse = log_refusals(KEPT_TOPIC)
        self._published = -1
        self._round, self._repeat = 0, 1
        self._arrived: dict[str, int] = {}  # messages of each node before the round
        self._awaited_state = self._is_settled
        self._working: set[str] = set()  # nodes that had messages for this round
        self._string_type = String
        self._clock_type = Clock
        transport = open_transport()
        self._clock = transport.advertise_class(ros, CLOCK_TOPIC, Clock, standard=True)
        self._rounds = transport.advertise(ros, ROUND_TOPIC, Structured, Delivery.LATCHED)
        self._receiver = transport.receiver(KEPT_TOPIC, latched=True)
        self._reports = ros.create_subscription(String, KEPT_TOPIC, self._note, observer_qos(latched=True))
        for subscription in self._subscriptions:
            subscription.on_taken = self._notify
        self._publish_round()

    def advance(self, seconds: float) -> None:
        """Advance the time. Raises NodeError when a node does not finish its work."""
        end = self.now + nanoseconds(seconds)
        self._step_nodes()
        while self.now < end:
            self.now = min(self.now + self._step, end)
            self._step_nodes()

    def until(self, holds: Callable[[], bool], *, limit_s: float) -> bool:
        """Advance the time until ``holds`` returns true, or by ``limit_s``; return whether it did."""
        end = self.now + nanoseconds(limit_s)
        while not holds():
            if self.now >= end:
                return False
            self.advance(min(self._step, end - self.now) / SECOND)
        return True

    def _note(self, message: Any) -> None:
        try:
            opened = self._receiver.open(message)
            if opened is None:
                return
            report = StepReport.decode(opened.data)
        except MessageError as error:
            self._refuse(error)
            return
        with self._changed:
            self._balance.note(report)
        self._notify()

    def _notify(self) -> None:
        with self._changed:
            if self._awaited_state():
                self._changed.notify()

    def _step_nodes(self) -> None:
        self._await(self._is_known)
        with self._changed:
            is_reported = self.now == self._published and self._has_been_reported()
        if not is_reported:
            self._publish_time()
        self._await(self._is_settled)
        with self._changed:
            self._balance.close_step(self._subscribers)

    def _await(self, state: Callable[[], bool]) -> None:
        """Wait for a state, and repeat the last messages for nodes that join or may have lost them."""
        begun, asked, repeat_s = time.monotonic(), 0, REPEAT_S
        while not self._wait(state, repeat_s):
            waited = time.monotonic() - begun
            repeat_s = min(2 * repeat_s, MAX_REPEAT_S)
            with self._changed:
                late = self._unknown() or self._late(asked)
                if not late and asked:
                    self._balance.give_up(self._subscribers, DELIVERY_TIMEOUT_S)
                    continue
            if late and waited > STEP_TIMEOUT_S:
                raise NodeError(
                    f"the work due at {self.now / SECOND:.3f} s is not done after {STEP_TIMEOUT_S:.0f} s",
                    where=", ".join(sorted(late)),
                    remedy="see the log of the node",
                )
            if late or waited > DELIVERY_TIMEOUT_S:
                self._repeat += 1
                self._publish_round()
                if state == self._is_settled:
                    self._publish_time()
            if waited > DELIVERY_TIMEOUT_S:
                asked = asked or self._repeat

    def _wait(self, state: Callable[[], bool], timeout_s: float) -> bool:
        with self._changed:
            self._awaited_state = state
            try:
                return self._changed.wait_for(state, timeout_s)
            finally:
                self._awaited_state = self._is_settled

    def _has_been_reported(self) -> bool:
        return all(self._balance.reports[name].time >= self.now for name in self.awaited)

    def _publish_time(self) -> None:
        self._published = self.now
        message = self._clock_type()
        message.clock.sec, message.clock.nanosec = divmod(self.now, SECOND)
        self._clock.publish_encoded(message)

    def _publish_round(self) -> None:
        self._rounds.forward(self._string_type(data=Round(self._round, self._repeat, self._arrived).encode()))

    @property
    def _subscribers(self) -> set[str]:
        return self.awaited | {self._name}

    def _unknown(self) -> set[str]:
        return self.awaited - self._balance.reports.keys()

    def _is_known(self) -> bool:
        return not self._unknown()

    def _is_settled(self) -> bool:
        """Whether the step is done. If only messages are left, start the next round."""
        if self._late():
            return False
        sent = {sender.publisher.topic_name: sender.sent for sender in self._senders}
        taken = {one.endpoint.topic_name: one.taken for one in self._subscriptions}
        self._balance.note(StepReport(self._name, "", self.now, sent, taken, 0, 0, 0, 0))
        if any(self._balance.missing(self._subscribers)):
            return False
        self._working = {name for name in self.awaited if self._balance.reports[name].held}
        if self._working:
            self._round += 1
            self._arrived = {name: report.arrived for name, report in self._balance.reports.items()}
            self._publish_round()
        return not self._working

    def _late(self, repeat: int = 0) -> list[str]:
        """Nodes that have work left, or have not reported since a request."""
        late = []
        for name in self.awaited:
            report = self._balance.reports.get(name)
            if (
                report is None
                or report.time < self.now
                or report.repeat < repeat
                or (name in self._working and report.round < self._round)
            ):
                late.append(name)
        return late


class MessageBalance:
    """Comparison of the messages that nodes have sent with those that others have taken.

    A subscriber of a topic must have taken as many messages as were sent. Its ``_offsets`` count the messages that it
    has got from outside the graph (positive), or was not there for (negative).
    """

    def __init__(self) -> None:
        self.reports: dict[str, StepReport] = {}
        self._has_begun = False
        self._sent_before: Counter[str] = Counter()  # by earlier instances of nodes
        self._offsets: Counter[tuple[str, str]] = Counter()
        self._surplus: dict[tuple[str, str], int] = {}
        self._given_up: dict[tuple[str, str], int] = {}

    def note(self, report: StepReport) -> None:
        """Record a report. A node that joins later or again starts from now."""
        before = self.reports.get(report.node)
        self.reports[report.node] = report
        if before is None and not self._has_begun:
            return
        if before is None or before.instance != report.instance:
            if before is not None:
                self._sent_before.update(before.sent)
            sent = self._sent()
            for topic, taken in report.taken.items():
                self._offsets[report.node, topic] = taken - sent[topic]

    def missing(self, subscribers: Iterable[str]) -> Iterator[tuple[str, str, int]]:
        """Yield the node and topic of each subscription that lacks messages, and their number."""
        for pair, more in self._differences(subscribers):
            if more < 0 and pair not in self._given_up:
                yield *pair, -more

    def give_up(self, subscribers: Iterable[str], after_s: float) -> None:
        """Wait no longer for missing messages, and for none of these subscriptions until it gets one."""
        for node, topic, count in list(self.missing(subscribers)):
            log.warning("%s: %d messages on %s were not delivered in %.0f s", node, count, topic, after_s)
            self._offsets[node, topic] -= count
            self._given_up[node, topic] = self.reports[node].taken[topic]

    def close_step(self, subscribers: Iterable[str]) -> None:
        """Count messages that are still more than were sent after another step as messages from outside."""
        self._has_begun = True
        surplus = {pair: more for pair, more in self._differences(subscribers) if more > 0}
        for pair in surplus.keys() & self._surplus.keys():
            outside = min(surplus[pair], self._surplus[pair])
            self._offsets[pair] += outside
            surplus[pair] -= outside
        self._surplus = surplus

    def _differences(self, subscribers: Iterable[str]) -> Iterator[tuple[tuple[str, str], int]]:
        sent = self._sent()
        for node in subscribers:
            for topic, taken in self.reports[node].taken.items():
                if self._given_up.get((node, topic), taken) < taken:
                    del self._given_up[node, topic]
                    self._offsets[node, topic] = taken - sent[topic]
                yield (node, topic), taken - sent[topic] - self._offsets[node, topic]

    def _sent(self) -> Counter[str]:
        total = Counter(self._sent_before)
        for report in self.reports.values():
            total.update(report.sent)
        return total
