"""Inline runner: a whole graph in one thread and simulated time, in the order of stamps.

The output is deterministic, byte for byte: no wall clock, no threads, no dropped messages.
"""

from __future__ import annotations

import copy
import functools
import heapq
import itertools
import logging
import queue
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from socialbot.core.clock import SECOND, Clock, ManualClock, nanoseconds
from socialbot.core.errors import NodeError
from socialbot.core.messages import Health, Message
from socialbot.graph.calls import SERVER_WAIT_S, Channel, GoalHandle, Outcome, PendingCall
from socialbot.graph.health import HEALTH_TOPIC, HealthMonitor, ended, own_health_topic
from socialbot.graph.node import (
    Graph,
    Node,
    NodeConfig,
    Timer,
    checked_callback,
    failure_text,
    make_node,
    outcome,
    start_failure,
)
from socialbot.graph.ports import EVERYBODY, Delivery, Input, Output
from socialbot.graph.services import ActionServer, ClientPort, ServerPort, Service

log = logging.getLogger("socialbot.graph.inline")

R = TypeVar("R")

MOST_AT_ONCE = 300_000
"""Most timers or messages of one moment: more would keep the time still without an end."""

Tap = Callable[[str, Message], None]

Recorded = Callable[[Clock, Callable[[int, Callable[[], None]], object]], Channel]
"""Factory of a channel with recorded answers, from the clock and the timers of a node."""


@dataclass
class Faults:
    """Call and failure counts of a node, and its first error."""

    calls: int = 0
    failures: int = 0
    first: str = ""

    def count(self, error: Exception) -> None:
        self.failures += 1
        self.first = self.first or failure_text(error)


class _Context:
    def __init__(self, runner: InlineRunner, config: NodeConfig) -> None:
        self.name = config.name
        self.alive = True
        self._next_check: int | None = None
        self._runner = runner
        self.health_monitor = HealthMonitor(config, runner.clock, self._publish_health)
        self._config = config
        self._topics = {port.name: config.topic(port) for port in config.type.outputs().values()}
        self._channels: dict[str, Channel] = {}
        self._clients = {port.name: topic for topic, port in config.clients}
        self._health_topics = (HEALTH_TOPIC, own_health_topic(config.name))
        self._last = config.type.is_simulator

    @property
    def clock(self) -> ManualClock:
        return self._runner.clock

    def publish(self, port: Output[Any], message: Message) -> None:
        if self.alive:
            by_receiver = port.addressed_by
            topic = self._config.topic(port, port.receiver(message)) if by_receiver else self._topics[port.name]
            self._runner.take(topic, message, port.delivery)

    def call_at(self, time: int, callback: Callable[[], None]) -> Timer:
        return self._runner.call_at(time, self._guarded(callback), last=self._last)

    def channel(self, port: ClientPort) -> Channel:
        channel = self._channels.get(port.name)
        if channel is None:
            topic = self._clients[port.name]
            recorded = self._runner.recorded.get(topic)
            channel = self._channels[port.name] = (
                LocalChannel(self._runner.services, self, topic)
                if recorded is None
                else recorded(self.clock, self.call_at)
            )
        return channel

    def begin_health(self, node: Node) -> None:
        """Start the health monitor. It publishes only on topics with a listener."""
        self.health_monitor.begin(node, self._call_beat)
        self._runner.services.begin(self.name, [(self._clients[port.name], port) for port in node.clients().values()])
        self.watch()

    def watch(self) -> None:
        """Notify the node of changed inputs, and schedule the next check."""
        while self.alive and self.health_monitor.pending:
            self._runner.attempt(self, self.health_monitor.look)
        due = self.health_monitor.due()
        if due is not None and (self._next_check is None or due < self._next_check):
            self._next_check = due
            self._runner.call_at(due, functools.partial(self._watch_again, due))

    def _watch_again(self, due: int) -> None:
        if self.alive and due == self._next_check:
            self._next_check = None
            self.watch()

    def _call_beat(self, time: int, beat: Callable[[], None]) -> None:
        # Without a listener the node publishes no heartbeats.
        if self.alive and not self._runner.heard.isdisjoint(self._health_topics):
            self._runner.call_at(time, beat)

    def _publish_health(self, health: Health, to_all: bool) -> None:
        # The first topic is that of all nodes.
        for topic in self._health_topics[0 if to_all else 1 :]:
            if self.alive and topic in self._runner.heard:
                self._runner.enqueue(topic, health)

    def call_soon(self, callback: Callable[[], None]) -> None:
        self._runner.posted.put(self._guarded(callback))

    def run_in_background(self, work: Callable[[], R], then: Callable[[R | Exception], None]) -> None:
        self.call_soon(functools.partial(checked_callback(then), outcome(checked_callback(work))))

    def _guarded(self, callback: Callable[[], None]) -> Callable[[], None]:
        checked_callback(callback)
        return lambda: self._runner.guard(self, callback)


class InlineRunner:
    """Runner of ``graph`` in simulated time from ``start`` (ns).

    It logs the first exception of a node, counts all in ``faults``, and continues. Calls of the services in
    ``recorded`` are answered by these channels instead of by nodes.
    """

    def __init__(self, graph: Graph, *, start: int = 0, recorded: Mapping[str, Recorded] | None = None) -> None:
        self.recorded = dict(recorded or {})
        self.services = LocalServices(self)
        self.clock = ManualClock(start)
        self.started = False
        self.nodes: dict[str, Node] = {}
        self.faults: dict[str, Faults] = {}
        self.posted: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._configs = {config.name: config for config in graph.nodes}
        self._contexts: dict[str, _Context] = {}
        self._listeners: dict[str, list[tuple[str, Input[Any]]]] = {}
        self._addressed: dict[str, str] = {}
        """Attribute with the receiver, by topic with inputs for addressed messages."""
        self._receivers: dict[tuple[str, str], list[tuple[str, Input[Any]]]] = {}
        """Listeners of such a topic by receiver; an empty one stands for other receivers."""
        self._latched: dict[str, Message] = {}
        self._taps: dict[str, list[Tap]] = {}
        self._queue: deque[tuple[str, Message]] = deque()
        self.heard: set[str] = set()
        """Topics with a listener."""
        self._timers: list[tuple[int, bool, int, Timer]] = []
        self._sequence = itertools.count()
        for config in graph.nodes:
            self._make(config)
            self.faults[config.name] = Faults()
            for topic, port in config.subscriptions:
                self._listeners.setdefault(topic, []).append((config.name, port))
            for topic, server in config.servers:
                self.services.offer(topic, config.name, server)
        self.heard.update(self._listeners)
        self._address()

    def start(self) -> None:
        """Start the nodes and deliver their first messages. Raises NodeError, or the error of a node."""
        self.started = True
        for node in self.nodes.values():
            _start(node)
        for name, node in self.nodes.items():
            self._contexts[name].begin_health(node)
        self._drain()

    def kill(self, name: str) -> None:
        """Simulate a crash of the node's process: drop the node and its timers without `Node.stop`."""
        self._contexts.pop(name).alive = False
        del self.nodes[name]
        self.services.on_kill(name)

    def restart(self, name: str) -> None:
        """Create and start a node again after `kill`. Raises the same errors as `start`."""
        config = self._configs[name]
        node = self._make(config)
        _start(node)
        self._contexts[name].begin_health(node)
        for topic, port in config.subscriptions:
            if port.delivery is Delivery.LATCHED and topic in self._latched:
                self.guard(self._contexts[name], port.deliver, node, self._latched[topic])
        self.services.on_start(name)
        self._drain()

    def context_of(self, name: str) -> _Context | None:
        """Context of a node; None after `kill`."""
        return self._contexts.get(name)

    def close(self) -> None:
        for name, node in self.nodes.items():
            try:
                node.stop()
            except Exception as error:  # noqa: BLE001 - one that cannot stop keeps no other from stopping
                self.faults[name].count(error)
                log.warning("%s: cannot stop: %s", name, failure_text(error))

    def tap(self, topic: str, callback: Tap) -> None:
        """Pass every message on ``topic`` to ``callback``, before the nodes receive it."""
        self._taps.setdefault(topic, []).append(callback)
        self.heard.add(topic)

    def feed(self, topic: str, message: Message, *, time: int | None = None) -> None:
        """Advance to ``time`` (by default the stamp), then deliver ``message`` and all messages that follow from it."""
        self._feed(message.stamp if time is None else time, [(topic, message)])

    def run(self, messages: Iterable[tuple[str, Message]], *, tail_s: float = 0.0) -> None:
        """Feed ``messages``, those with equal stamps together, then advance by ``tail_s``.

        Silence during the tail is no fault.
        """
        topics: dict[str, None] = {}
        for stamp, together in itertools.groupby(messages, key=lambda each: each[1].stamp):
            moment = list(together)
            topics.update(dict.fromkeys(topic for topic, _ in moment))
            self._feed(stamp, moment)
        if HEALTH_TOPIC in self.heard:
            self.enqueue(HEALTH_TOPIC, ended("bag", tuple(topics), self.clock.now()))
        self.advance(self.clock.now() + nanoseconds(tail_s))

    def _feed(self, time: int, messages: Iterable[tuple[str, Message]]) -> None:
        self.advance(max(time, self.clock.now()))
        self._queue.extend(messages)
        self._drain()

    def advance(self, time: int) -> None:
        """Advance time to ``time`` (ns) and fire the timers that are due."""
        self._drain()
        fired = 0
        while self._timers and self._timers[0][0] <= time:
            due, _, _, timer = heapq.heappop(self._timers)
            if timer.callback is not None:
                fired = 0 if due > self.clock.now() else fired + 1
                if fired > MOST_AT_ONCE:
                    remedy = "let call_after in the callback of a timer wait for more than 0 s"
                    raise NodeError(f"{MOST_AT_ONCE} timers follow each other {self._moment}", remedy=remedy)
                self.clock.set(max(due, self.clock.now()))
                timer.callback()
                self._drain()
        self.clock.set(time)

    @property
    def _moment(self) -> str:
        return f"at {self.clock.now() / SECOND:.3f} s, and time stands still"

    def call_at(self, time: int, callback: Callable[[], None], *, last: bool = False) -> Timer:
        """Call ``callback`` at ``time`` (ns) of simulated time.

        Timers with equal times fire in order of creation, those of simulators ``last``, as `run` feeds a bag after
        timers.
        """
        timer = Timer(callback)
        heapq.heappush(self._timers, (time, last, next(self._sequence), timer))
        return timer

    def enqueue(self, topic: str, message: Message) -> None:
        """Queue ``message`` for the subscribers of ``topic``."""
        self._queue.append((topic, message))

    def take(self, topic: str, message: Message, delivery: Delivery) -> None:
        """Queue a message of a node, and keep it for later subscribers if it is latched."""
        if delivery is Delivery.LATCHED:
            self._latched[topic] = message
        self._queue.append((topic, message))

    def guard(self, context: _Context, callback: Callable[..., None], *arguments: Any) -> None:
        """Call into a live node; count the call, and count and log an exception."""
        if context.alive:
            self.attempt(context, callback, *arguments, calls=1)

    def attempt(self, context: _Context, callback: Callable[..., None], *arguments: Any, calls: int = 0) -> None:
        """Call into a node; count and log an exception."""
        faults = self.faults[context.name]
        faults.calls += calls
        try:
            callback(*arguments)
        except Exception as error:  # noqa: BLE001 - whatever a node raises, the graph goes on
            faults.count(error)
            if faults.failures == 1:
                log.warning("%s: %s", context.name, faults.first)

    def _make(self, config: NodeConfig) -> Node:
        context = self._contexts[config.name] = _Context(self, config)
        try:
            node = self.nodes[config.name] = make_node(config, context, config.parameters)
        except Exception as error:
            raise start_failure(config.name, error) from error
        return node

    def _address(self) -> None:
        for topic, listeners in self._listeners.items():
            by = {port.addressed_by for _, port in listeners} - {""}
            if len(by) == 1:
                self._addressed[topic] = by.pop()
                addressed: dict[str, list[int]] = {"": []}
                for place, (name, port) in enumerate(listeners):
                    addressed.setdefault(name if port.addressed_by else "", []).append(place)
                for receiver, places in addressed.items():
                    both = sorted({*places, *addressed[""]})
                    self._receivers[topic, receiver] = [listeners[place] for place in both]

    def _listeners_of(self, topic: str, message: Message) -> Iterable[tuple[str, Input[Any]]]:
        """The listeners of a topic that may take a message, in the order of the graph."""
        attribute = self._addressed.get(topic)
        if attribute is None:
            return self._listeners.get(topic, ())
        receiver = getattr(message, attribute)
        if receiver == EVERYBODY:
            return self._listeners[topic]
        return self._receivers.get((topic, receiver), self._receivers[topic, ""])

    def _endless(self) -> NodeError:
        last = f", the last on {self._queue[-1][0]}" if self._queue else ""
        remedy = (
            "let rules that repeat themselves wait, and a node not answer each message on a topic that it publishes"
        )
        return NodeError(f"{MOST_AT_ONCE} messages or calls follow each other {self._moment}{last}", remedy=remedy)

    def _drain(self) -> None:
        passed, most = 0, len(self._queue) + MOST_AT_ONCE
        while self._queue or not self.posted.empty():
            while not self.posted.empty():
                self.posted.get()()
                passed += 1
                if passed + len(self._queue) > most:
                    raise self._endless()
            if self._queue:
                topic, message = self._queue.popleft()
                passed += 1
                for tap in self._taps.get(topic, ()):
                    tap(topic, message)
                for name, port in self._listeners_of(topic, message):
                    context = self._contexts.get(name)
                    if context is not None and context.alive:
                        if context.health_monitor.came(port, message):
                            context.watch()
                        self.attempt(context, port.deliver, self.nodes[name], message, calls=1)
                if passed > most:
                    raise self._endless()


def _start(node: Node) -> None:
    try:
        node.start()
    except Exception as error:
        raise start_failure(node.name, error) from error


# Services and actions between nodes, in a fixed order


class LocalServices:
    """Servers of the nodes of ``runner``, the calls in progress, and those that wait for a server to start."""

    def __init__(self, runner: InlineRunner) -> None:
        self._runner = runner
        self._servers: dict[str, tuple[str, ServerPort]] = {}
        self._open: list[_LocalCall] = []
        self._clients: dict[str, list[tuple[str, ClientPort]]] = {}

    def begin(self, name: str, clients: Sequence[tuple[str, ClientPort]]) -> None:
        """Notify a node of servers that are absent after `SERVER_WAIT_S`, and from then on of changes."""
        self._clients[name] = [(topic, port) for topic, port in clients if not port.optional]
        if self._clients[name]:
            time = self._runner.clock.now() + nanoseconds(SERVER_WAIT_S)
            self._runner.call_at(time, functools.partial(self._note, name))

    def _note(self, name: str) -> None:
        context = self._runner.context_of(name)
        if context is not None:
            for topic, port in self._clients.get(name, ()):
                server, _ = self._servers.get(topic, ("", None))
                there = topic in self._runner.recorded or self._runner.context_of(server) is not None
                note = functools.partial(context.health_monitor.note_server, port, topic, present=there)
                self._runner.attempt(context, note)

    def offer(self, topic: str, node: str, port: ServerPort) -> None:
        self._servers[topic] = node, port

    def on_kill(self, name: str) -> None:
        """End the calls that the node works on."""
        for call in [each for each in self._open if each.server == name]:
            self.close(call)
            call.report(call.call.end, "lost")
        for client in self._clients:
            self._note(client)

    def on_start(self, name: str) -> None:
        """Send the calls that wait for the node."""
        for call in [each for each in self._open if not each.server]:
            if self._servers.get(call.call.topic, ("", None))[0] == name:
                self._send(call)
        for client in self._clients:
            self._note(client)

    def open(self, call: _LocalCall) -> None:
        """Send a call, or keep it until its server starts."""
        self._open.append(call)
        name, _ = self._servers.get(call.call.topic, ("", None))
        if self._runner.context_of(name) is not None:
            self._send(call)

    def close(self, call: _LocalCall) -> None:
        if call in self._open:
            self._open.remove(call)

    def post(self, name: str, callback: Callable[..., None], *arguments: Any) -> None:
        """Call into the node ``name`` after the present callback, if it is still alive then."""
        self._runner.posted.put(functools.partial(self._attempt, name, callback, *arguments))

    def _attempt(self, name: str, callback: Callable[..., None], *arguments: Any) -> None:
        context = self._runner.context_of(name)
        if context is not None:
            self._runner.guard(context, callback, *arguments)

    def _send(self, call: _LocalCall) -> None:
        name, port = self._servers[call.call.topic]
        call.server = name
        call.report(call.call.on_sent)
        serve = self._answer if isinstance(port, Service) else self._start
        self.post(name, serve, call, port)

    def _answer(self, call: _LocalCall, port: Service) -> None:
        if call.call.result is None:
            response = port.answer(self._runner.nodes[call.server], copy.deepcopy(call.call.message))
            self.close(call)
            call.report(call.call.end, "succeeded", response)

    def _start(self, call: _LocalCall, port: ActionServer) -> None:
        if call.call.result is not None:
            return
        goal = call.goal = GoalHandle(port.interface, copy.deepcopy(call.call.message), call)
        try:
            port.start(self._runner.nodes[call.server], goal)
        finally:
            if goal.rejected:
                self.close(call)
                call.report(call.call.end, "rejected")
            else:
                call.accept()

    def cancel(self, call: _LocalCall) -> None:
        goal, (_, port) = call.goal, self._servers.get(call.call.topic, ("", None))
        if goal is None or not isinstance(port, ActionServer):
            self.close(call)
        else:
            self.post(call.server, lambda: port.cancel(self._runner.nodes[call.server], goal))


class LocalChannel:
    """`Channel` of a client to a node of the same runner."""

    def __init__(self, services: LocalServices, context: _Context, topic: str) -> None:
        self.topic = topic
        self._services = services
        self._client = context.name
        self._calls: dict[PendingCall, _LocalCall] = {}

    def send(self, call: PendingCall) -> None:
        self._calls = {each: local for each, local in self._calls.items() if each.result is None}
        local = self._calls[call] = _LocalCall(self._services, self._client, call)
        self._services.post(self._client, self._services.open, local)

    def cancel(self, call: PendingCall) -> None:
        if call in self._calls:
            self._services.cancel(self._calls[call])


@dataclass(eq=False)
class _LocalCall:
    """Call from one node to another, and `GoalChannel` of its goal."""

    services: LocalServices
    client: str
    call: PendingCall
    server: str = ""
    goal: GoalHandle | None = None
    accepted: bool = False
    early: list[Callable[[], None]] = field(default_factory=list)
    """Reports of the server before it has accepted the goal."""

    def report(self, callback: Callable[..., None], *arguments: Any) -> None:
        self.services.post(self.client, callback, *arguments)

    def accept(self) -> None:
        self.accepted = True
        self.report(self.call.on_accepted)
        for report in self.early:
            report()
        self.early.clear()

    def feedback(self, message: Any) -> None:
        self._when_accepted(functools.partial(self.report, self.call.on_feedback, copy.deepcopy(message)))

    def end(self, outcome: Outcome, result: Any) -> None:
        self.services.close(self)
        self._when_accepted(functools.partial(self.report, self.call.end, outcome, copy.deepcopy(result)))

    def _when_accepted(self, report: Callable[[], None]) -> None:
        if self.accepted:
            report()
        else:
            self.early.append(report)
