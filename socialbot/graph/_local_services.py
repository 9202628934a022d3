"""Services and actions between the nodes of an inline runner, in simulated time and in a fixed order."""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from socialbot.core.clock import nanoseconds
from socialbot.graph.calls import SERVER_WAIT_S, GoalHandle, Outcome, PendingCall
from socialbot.graph.services import ActionServer, ClientPort, ServerPort, Service

if TYPE_CHECKING:
    from socialbot.graph.inline import InlineRunner, _Context


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
            self._runner.schedule(time, functools.partial(self._note, name))

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
