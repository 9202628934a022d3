"""The inline runner: a whole graph in one thread, in the order of stamps, in simulated time.

What goes in decides what comes out, byte for byte: no wall clock, no threads, no dropped messages.
"""

from __future__ import annotations

import functools
import heapq
import itertools
import logging
import queue
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from socialbot.clock import ManualClock, nanoseconds
from socialbot.errors import NodeError, SocialbotError
from socialbot.graph import Graph, Input, Node, Output
from socialbot.messages import Message

log = logging.getLogger("socialbot.inline")

Tap = Callable[[str, Message], None]


@dataclass
class Faults:
    """How often a node was called, how often that failed, and how it failed first."""

    calls: int = 0
    failures: int = 0
    first: str = ""

    def count(self, error: Exception) -> None:
        """Notes one failure."""
        self.failures += 1
        self.first = self.first or f"{type(error).__name__}: {error}"


class _Timer:
    def __init__(self, callback: Callable[[], None]) -> None:
        self.callback: Callable[[], None] | None = callback

    def cancel(self) -> None:
        self.callback = None


class _Context:
    """The inline runner as one node sees it."""

    def __init__(self, runner: InlineRunner, topics: dict[str, str]) -> None:
        self._runner = runner
        self._topics = topics

    @property
    def clock(self) -> ManualClock:
        return self._runner.clock

    def publish(self, port: Output[Any], message: Message) -> None:
        self._runner.enqueue(self._topics[port.name], message)

    def call_at(self, time: int, callback: Callable[[], None]) -> _Timer:
        return self._runner.call_at(time, self._guarded(callback))

    def call_soon(self, callback: Callable[[], None]) -> None:
        self._runner.posted.put(self._guarded(callback))

    def _guarded(self, callback: Callable[[], None]) -> Callable[[], None]:
        return lambda: self._runner.guard(self, callback)


class InlineRunner:
    """Runs ``graph`` in simulated time that begins at ``start`` (ns).

    A node that raises is logged for the first time, and counted in ``faults``; the stream goes on.
    """

    def __init__(self, graph: Graph, *, start: int = 0) -> None:
        self.clock = ManualClock(start)
        self.nodes: dict[str, Node] = {}
        self.faults: dict[str, Faults] = {}
        self.posted: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._names: dict[_Context, str] = {}
        self._listeners: dict[str, list[tuple[_Context, Node, Input[Any]]]] = {}
        self._taps: dict[str, list[Tap]] = {}
        self._queue: deque[tuple[str, Message]] = deque()
        self._timers: list[tuple[int, int, _Timer]] = []
        self._sequence = itertools.count()
        for placement in graph.placements:
            topics = {port.name: topic for topic, port in placement.publications}
            context = _Context(self, topics)
            node = placement.type(placement.name, context, placement.parameters)
            self._names[context] = placement.name
            self.nodes[placement.name] = node
            self.faults[placement.name] = Faults()
            for topic, port in placement.subscriptions:
                self._listeners.setdefault(topic, []).append((context, node, port))

    def start(self) -> None:
        """Starts the nodes, and lets what they send at once arrive. Raises NodeError, or the node's own error."""
        for node in self.nodes.values():
            try:
                node.start()
            except SocialbotError:
                raise
            except Exception as error:
                raise NodeError(f"cannot start: {type(error).__name__}: {error}", where=node.name) from error
        self._drain()

    def close(self) -> None:
        """Stops the nodes."""
        for name, node in self.nodes.items():
            try:
                node.stop()
            except Exception as error:  # noqa: BLE001 - one that cannot stop keeps no other from stopping
                self.faults[name].count(error)
                log.warning("%s: cannot stop: %s: %s", name, type(error).__name__, error)

    def tap(self, topic: str, callback: Tap) -> None:
        """Shows every message on ``topic`` to ``callback`` before the nodes get it."""
        self._taps.setdefault(topic, []).append(callback)

    def feed(self, topic: str, message: Message, *, time: int | None = None) -> None:
        """Moves to ``time`` (the message's stamp if not given) and delivers ``message`` and all that follows."""
        self.advance(max(message.stamp if time is None else time, self.clock.now()))
        self.enqueue(topic, message)
        self._drain()

    def run(self, messages: Iterable[tuple[str, Message]], *, tail_s: float = 0.0) -> None:
        """Feeds all ``messages`` and lets ``tail_s`` seconds pass afterwards."""
        for topic, message in messages:
            self.feed(topic, message)
        self.advance(self.clock.now() + nanoseconds(tail_s))

    def advance(self, time: int) -> None:
        """Lets time pass until ``time`` (ns); timers fire at their own moments on the way."""
        self._drain()
        while self._timers and self._timers[0][0] <= time:
            due, _, timer = heapq.heappop(self._timers)
            if timer.callback is not None:
                self.clock.set(max(due, self.clock.now()))
                timer.callback()
                self._drain()
        self.clock.set(time)

    def call_at(self, time: int, callback: Callable[[], None]) -> _Timer:
        """Calls back when simulated time reaches ``time``; timers of one moment fire in order of creation."""
        timer = _Timer(callback)
        heapq.heappush(self._timers, (time, next(self._sequence), timer))
        return timer

    def enqueue(self, topic: str, message: Message) -> None:
        """Puts ``message`` in line for everybody who listens to ``topic``."""
        self._queue.append((topic, message))

    def guard(self, context: _Context, callback: Callable[[], None]) -> None:
        """Calls into a node; its exceptions are counted and logged, and end nothing."""
        faults = self.faults[self._names[context]]
        faults.calls += 1
        try:
            callback()
        except Exception as error:  # noqa: BLE001 - whatever a node raises, the graph goes on
            faults.count(error)
            if faults.failures == 1:
                log.warning("%s: %s: %s", self._names[context], type(error).__name__, error)

    def _drain(self) -> None:
        while self._queue or not self.posted.empty():
            while not self.posted.empty():
                self.posted.get()()
            if self._queue:
                topic, message = self._queue.popleft()
                for tap in self._taps.get(topic, ()):
                    tap(topic, message)
                for context, node, port in self._listeners.get(topic, ()):
                    self.guard(context, functools.partial(port.deliver, node, message))
