"""Monitor of expectations on a running graph."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import Health, Message
from socialbot.runs.expectations._observation import Observation
from socialbot.runs.expectations.checking import Instance, Verdict, judge
from socialbot.runs.expectations.expectations import Expectation
from socialbot.runs.history import MOST_BYTES, History, size_of
from socialbot.runs.record import trace_record

LATE_S = 0.5
"""Messages may arrive this much later than their stamps."""

KEPT_S = 3600.0
MOST_RECORDS = 50_000
RECENT_S = 60.0


@dataclass
class MonitorState:
    """State of one expectation: violations so far, the last of them, and the verdict now."""

    violations: int = 0
    last: Instance | None = None
    verdict: Verdict | None = None


@dataclass(frozen=True)
class Violation:
    """Violation that was not known before."""

    verdict: Verdict
    instance: Instance


@dataclass
class BehaviourMonitor:
    """Checks expectations while messages arrive.

    `observe` may be called from any thread, all else from one thread. Records older than one hour are discarded,
    and so is the older half of more than `MOST_RECORDS` records or `MOST_BYTES`.

    Attributes:
        expectations: The expectations.
        states: State of each one by name.
        history: Records of the run, for reasons.
    """

    expectations: list[Expectation]
    history: History = field(default_factory=History, init=False)
    states: Mapping[str, MonitorState] = field(init=False)
    _latest: int = field(default=0, init=False)
    _received: deque[tuple[str, Message]] = field(default_factory=deque, init=False)
    _decided: set[tuple[str, str, int | None]] = field(default_factory=set, init=False)
    _forgotten: int = field(default=0, init=False)
    _bytes: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.states = {each.name: MonitorState() for each in self.expectations}
        self._begin(None)

    def _begin(self, start: int | None) -> None:
        self.history = History(start=start)
        self._observation = Observation([each.formula for each in self.expectations], self.history, complete=False)

    @property
    def topics(self) -> frozenset[str]:
        """Topics whose messages the expectations name."""
        return self._observation.topics

    def observe(self, topic: str, message: Message) -> None:
        """Receive a message of the graph."""
        self._received.append((topic, message))

    def poll(self, now: int) -> list[Violation]:
        """Check everything up to ``now`` (ns), less `LATE_S`; return new violations.

        Where messages have simulated time, their latest stamp is the time.
        """
        for _ in range(len(self._received)):  # those that arrive meanwhile wait, or a flood would never let go
            self._take(*self._received.popleft())
        if not self._latest:
            return []
        now = self.time(now)
        self._observation.read(max(0, now - self.history.start - nanoseconds(LATE_S)))
        found = [violation for each in self.expectations for violation in self._check(each)]
        self._forget(now)
        return found

    def time(self, now: int) -> int:
        """Return the time (ns) of the graph, where the time of this process is ``now``."""
        return now if abs(now - self._latest) < nanoseconds(KEPT_S) else self._latest

    def is_violated(self, name: str, now: int) -> bool:
        """Whether an expectation was violated in the last `RECENT_S`."""
        last = self.states[name].last
        return last is not None and self.time(now) - self.history.start - last.at < nanoseconds(RECENT_S)

    def _take(self, topic: str, message: Message) -> None:
        if not self._latest:
            self._begin(message.stamp)
        self._latest = max(self._latest, message.stamp)
        record = trace_record(topic, message)
        if record is not None:
            self.history.append(record)
            self._bytes += size_of(record)
            self._observation.take_record(record)
        elif isinstance(message, Health):
            self._observation.take_health((message.stamp - self.history.start) / SECOND, message)
        if topic in self._observation.topics:
            self._observation.take_message(topic, message)

    def _check(self, expectation: Expectation) -> Iterable[Violation]:
        state = self.states[expectation.name]
        verdict = state.verdict = judge(expectation, self._observation)
        for instance in verdict.instances:
            failed = instance.outcome == "failed"
            if instance.outcome == "open" or (expectation.when == "throughout" and not failed):
                continue
            # A decision is final: without the forgotten events, another one might follow from the rest.
            key = expectation.name, instance.text, None if expectation.when == "begin" else instance.at
            if key in self._decided or (failed and instance.at < self._forgotten):
                continue
            self._decided.add(key)
            if failed:
                state.violations += 1
                state.last = instance
                yield Violation(verdict, instance)

    def _forget(self, now: int) -> None:
        history = self.history
        before = now - history.start - nanoseconds(KEPT_S)
        if self._bytes > MOST_BYTES:
            before = max(before, history[len(history) // 2].stamp - history.start)
        if before > 0:
            self._forgotten = before
            self._observation.forget(before)
            self._decided = {key for key in self._decided if key[2] is None or key[2] >= before}
        if len(history) > MOST_RECORDS or self._bytes > MOST_BYTES:
            history.forget(len(history) // 2)
            self._bytes = sum(map(size_of, history))
