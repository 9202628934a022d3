"""Subscriptions that are replaced when the sealed messages of a live publisher do not arrive.

DDS accepts packets from any sender. False HEARTBEATs and GAPs in the name of a publisher stop its messages to the
subscriptions that exist at that time, for good; false ACKNACKs in the name of a subscription stop the repair of lost
ones. A new subscription receives messages again. So idle publishers with keys send sealed beacons, and a subscription
that does not receive those of all its publishers, or loses messages for a time, is replaced.

False packets of discovery can remove a publisher for a process, and its later subscriptions for the publisher. Only a
new DDS participant, so a new process, receives its messages again. So processes count lost publishers.

A publisher of a stranger sends no seals, so it looks like one whose messages never arrive. Such faults are not sure:
their pauses grow.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

from socialbot.bridge import dds_threads

BEACON_S = 2.0
"""Longest period (s) of `Transport.renew`. A publisher that has sealed nothing for half of it sends a beacon."""
SILENT_S = 3 * BEACON_S
"""Time (s) without a sealed message after which a publisher is silent, and first time between two replacements."""
MAX_PAUSE_S = 2 * SILENT_S
"""Longest time (s) between two replacements of a subscription that surely misses messages."""
FOREIGN_PAUSE_S = 300.0
"""Longest time (s) between two replacements because of publishers that may have no key."""
KNOWN_S = 600.0
"""Time (s) for which a silent publisher that was heard before is missed: another one may have taken its place."""
CHECK_S = 1.0
"""Shortest time (s) between two checks."""
OVERLAP_S = BEACON_S
"""Time (s) whose messages the new of two subscriptions must all have received: each publisher sends one."""
COPIES_S = SILENT_S
"""Time (s) after a replaced subscription has ended in which copies of what it delivered may still be queued."""
LOST_S = SILENT_S + BEACON_S
"""Time (s) for which the same number of publishers must be missing: so long that a replacement would have helped."""
MAX_STREAMS = 256
MAX_SAMPLES = 2048
"""Messages of a subscription that are known again: those in the queues of two, at most."""

StreamKey = tuple[str, str]
"""Sender and stream of a sealed message."""


class Watch(Protocol):
    """Watch over what arrives on one subscription.

    Attributes:
        is_copy: Whether the message that arrives has arrived before, on the other of two subscriptions that overlap.
    """

    is_copy: bool

    @property
    def is_sure(self) -> bool:
        """Whether the last fault shows missed messages; else its only cause may be publishers without keys."""
        ...

    def fault(self, publishers: int) -> str:
        """Why the subscription, with a number of matched ``publishers``, misses messages; empty if it does not."""
        ...

    def lost(self, publishers: int, wanted: int) -> int:
        """How many of the ``wanted`` publishers are lost. ``publishers`` are matched."""
        ...

    def begin_again(self) -> None:
        """Forget what arrived: the subscription is replaced."""
        ...


@dataclass(eq=False, kw_only=True)
class StreamWatch:
    """Watch over the sealed messages and beacons of one subscription.

    Attributes:
        clock: Steady clock (s).
        expects_all: Whether each message must arrive; else only silence is a fault.
        keeps_all: Whether the queue is long enough for all; else only beacons show that messages did not arrive.
        has_foreign: Whether publishers without keys are no fault: only publishers that were heard before are expected.
    """

    clock: Callable[[], float] = time.monotonic
    expects_all: bool = True
    keeps_all: bool = True
    has_foreign: bool = False
    is_copy: bool = field(default=False, init=False)
    _heard: dict[StreamKey, tuple[float, int]] = field(default_factory=dict, init=False)
    _lost: int = field(default=0, init=False)
    _losses: tuple[float, float] | None = field(default=None, init=False)
    """Time of the first and the last loss between two messages, of those that followed soon."""
    _known: int = field(default=0, init=False)
    """Number of publishers with keys, as far as they were heard."""
    _complete_at: float = field(default=-math.inf, init=False)
    """Last time when all known publishers were heard."""
    _publishers: int = field(default=0, init=False)
    _is_sure: bool = field(default=False, init=False)
    _missing: tuple[int, float] = field(default=(0, 0.0), init=False)
    """Number of missing publishers, and since when."""

    def note(self, stream: StreamKey, number: int, *, is_beacon: bool) -> None:
        """Record a valid sealed message, the ``number``th of its ``stream``, or a beacon after it."""
        now = self.clock()
        _, last = self._heard.pop(stream, (0.0, number))
        if is_beacon:
            self._lost += max(0, number - last)
        elif number > last + 1 and self.keeps_all:
            soon = self._losses is not None and now - self._losses[1] <= MAX_PAUSE_S
            self._losses = (self._losses[0] if self._losses is not None and soon else now), now
        self._heard[stream] = now, number
        if len(self._heard) > MAX_STREAMS:
            del self._heard[next(iter(self._heard))]

    @property
    def is_sure(self) -> bool:
        return self._is_sure

    def fault(self, publishers: int) -> str:
        heard = self._heard_now()
        self._update_known(heard, publishers)
        self._is_sure = True
        if self.expects_all and self._lost:
            return f"{self._lost} messages did not arrive"
        if self.expects_all and self._losses and (lost_s := self._losses[1] - self._losses[0]) > SILENT_S:
            return f"messages are lost for {lost_s:.0f} s"
        self._is_sure = min(self._known, publishers) > heard
        silent = (min(self._known, publishers) if self.has_foreign else publishers) - heard
        return f"{silent} of {publishers} publishers are silent" if silent > 0 else ""

    def lost(self, publishers: int, wanted: int) -> int:
        now, missing = self.clock(), max(0, wanted - self._heard_now())
        if missing != self._missing[0]:
            self._missing = missing, now
        return missing if now - self._missing[1] >= LOST_S else 0

    def _update_known(self, heard: int, publishers: int) -> None:
        # Where all publishers should have keys, one that leaves while another stays silent may be a stranger.
        left = max(0, self._publishers - publishers) if self.has_foreign else 0
        self._publishers = publishers
        self._known = max(heard, min(self._known - left, publishers))
        now = self.clock()
        if self._known == heard:
            self._complete_at = now
        elif now - self._complete_at > KNOWN_S:
            self._known = heard

    def _heard_now(self) -> int:
        now = self.clock()
        return sum(now - at <= SILENT_S for at, _ in self._heard.values())

    def begin_again(self) -> None:
        self._heard.clear()
        self._lost, self._losses = 0, None


Sample = tuple[int, int | None]
"""Time (ns) and number of a message, both by its publisher. DDS gives them to each subscription."""
Note = Callable[[Sample], None]
"""Gets each message of a subscription when it arrives."""


class _Arrivals:
    """Messages that one subscription received lately."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._times: dict[Sample, float] = {}

    def note(self, sample: Sample) -> None:
        self._times[sample] = self._clock()
        if len(self._times) > MAX_SAMPLES:
            del self._times[next(iter(self._times))]

    def __contains__(self, sample: Sample) -> bool:
        return sample in self._times

    def between(self, begin: float, end: float) -> set[Sample]:
        """Messages that arrived from ``begin`` to ``end``."""
        return {sample for sample, at in self._times.items() if begin <= at <= end}


@dataclass(eq=False)
class Backoff:
    """Pauses between replacements whose cause may be publishers without keys. Each is twice as long as the one before.

    They are short again after a quiet time of `FOREIGN_PAUSE_S`.
    """

    clock: Callable[[], float] = time.monotonic
    _pause_s: float = field(default=SILENT_S, init=False)
    _begun: float = field(default=-math.inf, init=False)

    @property
    def is_over(self) -> bool:
        """Whether no pause is left."""
        return self.clock() - self._begun >= self._pause_s

    def begin(self) -> None:
        """Begin the next pause, unless one has begun just now."""
        passed = self.clock() - self._begun
        if passed < CHECK_S:
            return
        before_s = SILENT_S if passed > self._pause_s + FOREIGN_PAUSE_S else self._pause_s
        self._pause_s = min(2 * before_s, FOREIGN_PAUSE_S)
        self._begun = self.clock()


class WatchedSubscription:
    """Subscription of the rclpy node ``ros`` that can be replaced.

    ``create`` makes an rclpy subscription that calls the given function with each message first. Subscriptions that are
    replaced together share a ``backoff``.
    """

    def __init__(
        self,
        ros: Any,
        create: Callable[[Note], Any],
        watch: Watch,
        clock: Callable[[], float] = time.monotonic,
        backoff: Backoff | None = None,
    ) -> None:
        self._ros = ros
        self._create = create
        self._watch = watch
        self._clock = clock
        self._backoff = backoff or Backoff(clock)
        self._is_unsure = False
        self._replaced: tuple[Any, _Arrivals] | None = None
        self._ended: tuple[_Arrivals, float] | None = None
        self._subscription, self._arrivals = self._created()
        self._replaced_at, self._may_fail = -math.inf, True
        self._publishers = 0
        self._begun = self._since = self._checked = clock()
        self._pause_s = SILENT_S
        self._destroyed = False

    def _created(self) -> tuple[Any, _Arrivals]:
        arrivals = _Arrivals(self._clock)

        def note(sample: Sample) -> None:
            self._watch.is_copy = any(sample in each for each in self._others(arrivals))
            arrivals.note(sample)

        return self._create(note), arrivals

    def _others(self, arrivals: _Arrivals) -> Iterator[_Arrivals]:
        """Arrivals of the subscriptions that exist beside one, or ended shortly before."""
        if self._replaced is not None:
            yield self._arrivals if arrivals is self._replaced[1] else self._replaced[1]
        if self._ended is not None and self._clock() < self._ended[1] + COPIES_S:
            yield self._ended[0]

    @property
    def topic_name(self) -> str:
        return self._subscription.topic_name

    @property
    def overlaps(self) -> bool:
        """Whether it is being replaced, so that two subscriptions receive."""
        return self._replaced is not None

    def get_publisher_count(self) -> int:
        """Number of matched publishers; a new subscription matches them a little later than the replaced one."""
        replaced = 0 if self._replaced is None else self._replaced[0].get_publisher_count()
        return max(self._subscription.get_publisher_count(), replaced)

    def fault(self, *, expects_publishers: bool = False) -> str:
        """Reason to replace the subscription now; empty if there is none, or it is too early, or DDS is busy.

        To match no publisher is one if it ``expects_publishers``.
        """
        now = self._clock()
        if self._destroyed or now - self._checked < CHECK_S:
            return ""
        self._checked = now
        self._check_overlap(now)
        before, self._publishers = self._publishers, self.get_publisher_count()
        if self._publishers > before:
            self._since = now
        deaf = "no publisher is matched" if expects_publishers else ""
        reason = self._watch.fault(self._publishers) if self._publishers else deaf
        if not reason:
            self._pause_s = SILENT_S
        self._is_unsure = bool(reason) and not (self._publishers and self._watch.is_sure)
        if self._is_unsure:
            is_due = now - self._since >= self._pause_s and self._backoff.is_over
        else:
            is_due = now - self._begun >= self._pause_s
        return reason if reason and is_due and not dds_threads.is_busy() else ""

    def lost(self, wanted: int) -> int:
        """How many of the ``wanted`` publishers with keys are lost: only another participant may receive them."""
        return self._watch.lost(self.get_publisher_count(), wanted)

    def replace(self, *, may_fail: bool = True) -> None:
        """Subscribe again, and end one of the two subscriptions at a later check: meanwhile both receive.

        A subscription knows a publisher before the publisher knows it, on a slow link seconds before. So the old one
        ends when the new one has received all its messages of `OVERLAP_S`. After `MAX_PAUSE_S`, the one ends that has
        received fewer messages; the old one, unless the replacement ``may_fail``.
        """
        if self._destroyed:
            return
        if self._replaced is None:
            self._replaced = self._subscription, self._arrivals
            self._subscription, self._arrivals = self._created()
            self._replaced_at, self._may_fail = self._clock(), may_fail
            self._watch.begin_again()
        if self._is_unsure:
            self._backoff.begin()
        self._begun = self._since = self._clock()
        self._publishers = 0
        self._pause_s = min(2 * self._pause_s, MAX_PAUSE_S)

    def destroy(self) -> None:
        """Remove the subscription from its node."""
        self._destroyed = True
        self._end_overlap()
        self._ros.destroy_subscription(self._subscription)

    def _check_overlap(self, now: float) -> None:
        if self._replaced is None:
            return
        old = self._replaced[1].between(now - CHECK_S - OVERLAP_S, now - CHECK_S)
        new = self._arrivals.between(now - 2 * CHECK_S - OVERLAP_S, now)
        has_all = bool(new) and old <= new and now - self._replaced_at >= CHECK_S + OVERLAP_S
        if not has_all and now - self._replaced_at < MAX_PAUSE_S:
            return
        if self._may_fail and len(new) < len(old):
            self._replaced, (self._subscription, self._arrivals) = (self._subscription, self._arrivals), self._replaced
        self._end_overlap()

    def _end_overlap(self) -> None:
        if self._replaced is not None:
            subscription, arrivals = self._replaced
            self._ros.destroy_subscription(subscription)
            self._replaced, self._ended = None, (arrivals, self._clock())


def replace_faulty(subscriptions: Collection[WatchedSubscription]) -> dict[str, str]:
    """Replace all ``subscriptions`` of a node if one misses messages, since false GAPs also work in the future.

    Returns:
        The reasons, by topic.
    """
    reasons = {each.topic_name: reason for each in subscriptions if (reason := each.fault())}
    if reasons:
        for each in subscriptions:
            each.replace()
    return reasons


def noting(note: Note, take: Callable[[Any, Any], None]) -> Callable[[Any, Any], None]:
    """Call ``note`` with each message before ``take``, which also gets the information from rclpy."""

    def receive(message: Any, info: Any) -> None:
        note((info["source_timestamp"], info["publication_sequence_number"]))
        take(message, info)

    return receive
