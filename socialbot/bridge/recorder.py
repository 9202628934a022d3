"""Record ROS topics into a bag, as serialized bytes.

With keys, seals are opened, so that a bag holds verified payloads and no refused messages.
"""

from __future__ import annotations

import functools
import itertools
import logging
import math
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from socialbot.bags.writer import BagWriter
from socialbot.bridge import discovery, environment
from socialbot.bridge.adaptive_subscriptions import DEPTH, AdaptiveSubscription, verified_subscriptions
from socialbot.bridge.stream_watch import Backoff
from socialbot.bridge.topics import is_hidden, observer_node
from socialbot.bridge.transport import is_power_of_ten, message_class, open_transport, refusal_reason
from socialbot.core.clock import Clock, WallClock
from socialbot.core.errors import InstallationError, MessageError

log = logging.getLogger("socialbot.recorder")

DISCOVERY_PERIOD_S = 0.2
LOOKUPS = 50
"""Largest number of topics that are looked up again in a period: each takes time for all endpoints of the domain."""
FLUSH_PERIOD_S = 0.5  # maximum time of a message in memory, where it would be lost with a killed process
_SPIN_S = 0.05


@dataclass(frozen=True)
class Recording:
    """Result of a recording: message counts by topic, and the reasons for missing or incomplete topics."""

    path: Path
    duration_s: float
    counts: Mapping[str, int]
    refused: Mapping[str, str]


def record(
    out: str | Path,
    *,
    topics: Collection[str] = (),
    duration_s: float | None = None,
    storage: str = "mcap",
    clock: Clock | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Recording:
    """Record topics to the new bag ``out`` for ``duration_s``, or until ``stopped`` returns true.

    Args:
        out: The bag folder to create.
        topics: The topics; by default all but hidden ones (``/rosout``, ``/_name``), including later ones, and the
            answers of services and actions.
        storage: "mcap" or "sqlite3".
        clock: The clock for the times of reception.

    Raises:
        BagError: ``out`` exists or cannot be written.
        InstallationError: ROS is not installed.
    """
    environment.require_ros()
    with (
        BagWriter(out, storage=storage) as bag,
        observer_node("bag_recorder") as node,
        environment.executor_of(node) as executor,
    ):
        recorder = _TopicRecorder(node, bag, topics, clock or WallClock())
        began = time.monotonic()
        scanned = flushed = -math.inf
        while not stopped() and (duration_s is None or time.monotonic() - began < duration_s):
            if time.monotonic() - scanned >= DISCOVERY_PERIOD_S:
                scanned = time.monotonic()
                recorder.subscribe_new()
            if time.monotonic() - flushed >= FLUSH_PERIOD_S:
                flushed = time.monotonic()
                bag.flush()
            executor.spin_once(timeout_sec=_SPIN_S)
        _take_received(executor)
        recorder.close()
        return Recording(bag.path, time.monotonic() - began, dict(bag.counts), recorder.refusals())


def _take_received(executor: Any) -> None:
    """Call the callbacks of all messages that have arrived, of which each subscription holds at most `DEPTH`."""
    from rclpy.executors import TimeoutException

    for _ in range(DEPTH):
        ready = 0
        with suppress(TimeoutException):  # raised after one callback of each subscription
            while True:
                callback, *_ = executor.wait_for_ready_callbacks(0.0)
                ready += 1
                callback()
                callback.result()  # raises the exception of the callback
        if not ready:
            return


T = TypeVar("T")


def _next(turns: deque[T]) -> list[T]:
    """Return the next `LOOKUPS` of ``turns``, and put them last."""
    chosen = list(itertools.islice(turns, LOOKUPS))
    turns.rotate(-len(chosen))
    return chosen


TRIAL_S = 3.0
"""Time (s) after which a topic without valid messages is recorded under another of its types, if it has one."""

MOST_TOPICS = 10_000
"""Limit of topics that are recorded without being named."""

ANSWERS = ("/_service_event", "/_action/status", "/_action/feedback")
"""Ends of hidden topics with the answers of services and actions, from which a replay answers."""


@dataclass(frozen=True)
class _Trial:
    """Subscriptions to a topic under one of its types, since a time (s)."""

    type_name: str
    subscriptions: tuple[AdaptiveSubscription, ...]
    begun: float
    backoff: Backoff

    def is_over(self) -> bool:
        """Whether another type may be tried, if no message has arrived."""
        return time.monotonic() - self.begun >= TRIAL_S and self.backoff.is_over


class _TopicRecorder:
    """Subscribe to each topic once it has a publisher."""

    def __init__(self, node: Any, bag: BagWriter, topics: Collection[str], clock: Clock) -> None:
        self._refused: dict[str, str] = {}
        self._invalid: dict[str, Counter[str]] = {}
        self._transport = open_transport()
        self._node = node
        self._bag = bag
        self._topics = {topic if topic.startswith("/") else f"/{topic}" for topic in topics}
        self._clock = clock
        self._is_limited = False
        self._known: set[tuple[str, str]] = set()
        """Topics with their types that have been looked up."""
        self._waiting: deque[tuple[str, str]] = deque()
        """Those without a publisher, and all subscriptions: next ones to look up first."""
        self._subscriptions: deque[AdaptiveSubscription] = deque()
        self._trials: dict[str, _Trial] = {}
        """Type under which each topic is recorded now."""

    def close(self) -> None:
        """Refuse the messages that still wait for a seal."""
        self._transport.close()

    def refusals(self) -> dict[str, str]:
        """Missing or incomplete topics, with the reason."""
        invalid = {
            topic: ", ".join(f"{count} {reason}" for reason, count in reasons.items())
            for topic, reasons in self._invalid.items()
        }
        return self._refused | invalid

    def subscribe_new(self) -> None:
        """Subscribe to new topics, and adapt subscriptions to weaker publishers, `LOOKUPS` of them at a time."""
        for subscription in _next(self._subscriptions):
            subscription.adapt()
        for topic, type_name in _next(self._waiting):
            self._waiting.remove((topic, type_name))
            if not self._subscribe(topic, type_name):
                self._waiting.append((topic, type_name))
        for topic, type_names in discovery.topics(self._node):
            if topic in self._topics or (not self._topics and (not is_hidden(topic) or topic.endswith(ANSWERS))):
                for type_name in type_names:
                    if (topic, type_name) not in self._known and not self._is_full(topic):
                        self._known.add((topic, type_name))
                        if not self._subscribe(topic, type_name):
                            self._waiting.append((topic, type_name))

    def _is_full(self, topic: str) -> bool:
        """Whether there are too many topics to record another one: anybody can announce any number."""
        if len(self._known) < MOST_TOPICS or topic in self._topics:
            return False
        if not self._is_limited:
            self._is_limited = True
            log.warning("more than %d topics: further ones are not recorded, unless they are named", MOST_TOPICS)
        return True

    def _subscribe(self, topic: str, type_name: str) -> bool:
        """Subscribe to a topic that has a publisher; return whether that is settled."""
        found = [each for each in discovery.publishers(self._node, topic) if each.topic_type == type_name]
        if not found:
            return False
        try:
            kind = message_class(type_name)
        except InstallationError as error:
            self._refuse(topic, error.what)
            return True
        if (trial := self._trials.get(topic)) is not None:
            if self._bag.counts.get(topic):
                self._refuse(topic, f"also of the type {type_name}, but recorded as {trial.type_name}")
                return True
            if not trial.is_over():
                return False
            self._end(topic, trial)
        type_hash = str(found[0].topic_type_hash)

        def write(data: bytes) -> None:
            now, latched = self._clock.now(), subscription.latched
            self._bag.write_raw(topic, type_name, data, now, latched=latched, type_hash=type_hash)

        refuse = functools.partial(self._count_invalid, topic)
        *seals, subscription = verified_subscriptions(self._node, self._transport, topic, kind, write, refuse)
        for each in (*seals, subscription):
            each.adapt()
        self._subscriptions += (*seals, subscription)
        backoff = Backoff() if trial is None else trial.backoff
        self._trials[topic] = _Trial(type_name, (*seals, subscription), time.monotonic(), backoff)
        log.info("recording %s (%s)", topic, type_name)
        return True

    def _end(self, topic: str, trial: _Trial) -> None:
        """Record a topic under another type: DDS takes one at a time, and a stranger may have announced the first."""
        trial.backoff.begin()
        for each in trial.subscriptions:
            each.destroy()
            self._subscriptions.remove(each)
        self._waiting.append((topic, trial.type_name))

    def _refuse(self, topic: str, reason: str) -> None:
        self._refused[topic] = reason
        if is_power_of_ten(len(self._refused)):
            log.warning("%s is not recorded: %s (%d topics)", topic, reason, len(self._refused))

    def _count_invalid(self, topic: str, error: MessageError) -> None:
        reasons = self._invalid.setdefault(topic, Counter())
        if not reasons:
            log.warning("%s is not recorded in full: %s", topic, error)
        reasons[refusal_reason(error)] += 1
