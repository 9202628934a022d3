"""Services and actions of one hosted node over rclpy: its servers, and the channels of its clients.

rclpy works in the executor thread: it takes requests and answers there. The node gets them in its own thread.
"""

from __future__ import annotations

import functools
import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rclpy.action.server import ActionServer as RosActionServer
from rclpy.action.server import CancelResponse, GoalResponse
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node as RosNode
from rclpy.task import Future

from socialbot.bridge._service_clients import (
    CHECK_PERIOD_S,
    ActionChannel,
    NoChannel,
    RosChannel,
    ServiceChannel,
    expect_valid,
    in_executor,
)
from socialbot.bridge.driver_domain import DriverNode
from socialbot.bridge.environment import KEYS_VARIABLE, executor_of, reach, steady_timer
from socialbot.bridge.transport import Transport, is_power_of_ten, message_class
from socialbot.core.errors import InstallationError, ParameterError
from socialbot.graph.calls import SERVER_WAIT_S, Channel, GoalHandle, Outcome
from socialbot.graph.node import NodeConfig
from socialbot.graph.services import ActionServer, ClientPort, ServerPort, Service

if TYPE_CHECKING:
    from socialbot.bridge._node_thread import NodeThread

WATCH_PERIOD_S = 1.0  # period to look for the servers of clients
CANCEL_SENT_S = 2.0  # longest time that the end of a node waits until its goals are cancelled


class HostedServices:
    """Servers and clients of the node ``config``.

    ``thread`` returns the thread of the node; None while it is not active. ``transport`` knows what needs no seal.
    """

    def __init__(
        self, ros: RosNode, config: NodeConfig, thread: Callable[[], NodeThread | None], transport: Transport
    ) -> None:
        self._ros = ros
        self._config = config
        self._thread = thread
        self._transport = transport
        self._driver: DriverNode | None = None
        """Node of the clients in the domain of drivers, which has a thread of its own."""
        self._channels: dict[str, RosChannel] = {}
        self._servers: list[_RosService | _RosAction] = []
        self._absent_since: dict[str, float] = {}
        """Time (monotonic s) since which a server is missing; minus infinity after it was there."""
        self._timer = steady_timer(ros, WATCH_PERIOD_S, self._watch) if config.clients else None

    def _watch(self) -> None:
        """Notify the node of servers that go away or do not appear."""
        thread = self._thread()
        for topic, port in self._config.clients if thread is not None else ():
            channel = self._channels.get(port.name)
            if channel is None or port.optional or thread is None:
                continue
            now = time.monotonic()
            if channel.has_server():
                self._absent_since[topic] = -math.inf
                thread.note_server(port, topic, present=True)
            elif now - self._absent_since.setdefault(topic, now) > SERVER_WAIT_S:
                thread.note_server(port, topic, present=False)

    def open(self) -> None:
        """Create the clients and servers of rclpy.

        Raises:
            InstallationError: A type is not installed.
            ParameterError: A service would be offered or called without a signature in a graph with keys.
        """
        for topic, port in self._config.clients:
            try:
                kind = message_class(port.interface.name)
                ros = self._caller(topic, port)
            except (InstallationError, ParameterError) as error:
                if not port.optional:
                    raise
                self._ros.get_logger().info(f"the client {port.name} is not used: {error.what}")
                continue
            make = ActionChannel if port.interface.is_action else ServiceChannel
            self._channels[port.name] = make(ros, topic, kind, self._report)
        for topic, port in self._config.servers:
            if self._transport.sealed:
                expect_open(topic, port)
            kind = message_class(port.interface.name)
            offer = _RosService if isinstance(port, Service) else _RosAction
            self._servers.append(offer(self._ros, topic, kind, port, self._thread))

    def _caller(self, topic: str, port: ClientPort) -> RosNode:
        """The rclpy node for a client: that of the domain of drivers, or that of the node.

        Raises:
            ParameterError: Anybody in the network could answer.
        """
        name = self._ros.resolve_service_name(topic)
        drivers = self._transport.drivers
        in_drivers = drivers is not None and name in drivers.topics
        # DDS of a process has one profile. If that is open to the network, so is its part in the domain of drivers.
        if not (port.open_to_all or self._transport.is_open(name) or (in_drivers and not reach())):
            raise ParameterError(
                f"the answers of {name} cannot be signed, so anybody in the network could give them",
                where=KEYS_VARIABLE,
                remedy="name it among the drivers of a graph on one machine, or among what is open to all: see "
                "docs/security.md",
            )
        if drivers is not None and in_drivers:
            if self._driver is None:
                self._driver = drivers.node(self._ros)
                self._driver.spin()
            return self._driver.ros
        return self._ros

    def channel(self, port: ClientPort) -> Channel:
        channel = self._channels.get(port.name)
        return NoChannel(self._config.topic(port)) if channel is None else channel

    def stop_goals(self) -> None:
        """Abort the goals that the node works on."""
        for server in self._servers:
            server.stop_goals()

    def cancel_goals(self) -> None:
        """Ask the servers to cancel the goals of the node."""
        for channel in self._channels.values():
            if self._driver is not None and channel.ros is self._driver.ros:
                self._driver.call(channel.cancel_all)
            else:
                channel.cancel_all()

    def await_cancels(self) -> None:
        """Wait a moment until the servers have got what `cancel_goals` asks; the executor of the node has ended."""
        if not any(channel.is_cancelling for channel in self._channels.values()):
            return
        asked = time.monotonic()
        end = asked + CANCEL_SENT_S
        with executor_of(self._ros) as executor:
            while any(channel.is_cancelling for channel in self._channels.values()) and time.monotonic() < end:
                executor.spin_once(timeout_sec=CHECK_PERIOD_S)
                if time.monotonic() - asked > CHECK_PERIOD_S:
                    # The server may have got the goal only after it was asked to cancel it, and answers can be lost.
                    self.cancel_goals()
                    asked = time.monotonic()

    def close(self) -> None:
        """Destroy the clients and servers."""
        for each in (*self._channels.values(), *self._servers):
            each.close()
        self._channels.clear()
        self._servers.clear()
        if self._driver is not None:
            self._driver.close()
            self._driver = None

    def _report(self, callback: Callable[..., None], *arguments: Any) -> None:
        thread = self._thread()
        if thread is not None:
            thread.queue.call_soon(functools.partial(callback, *arguments))


def expect_open(topic: str, port: ServerPort) -> None:
    """Raise ParameterError unless a service may be offered in a graph with keys."""
    if not port.open_to_all:
        raise ParameterError(
            f"{topic} cannot be signed, so anybody in the network could call it",
            where=KEYS_VARIABLE,
            remedy="write open_to_all=True at the service to offer it anyway, or unset the variable",
        )


RESULT_S = 60
"""Time (s) for which the result of a goal is kept; rclpy keeps those of 15 minutes, whatever their number."""

MAX_REQUESTS = 100
"""Most requests or goals of a server that wait for its node. Further goals are rejected, and requests not answered."""


class _Waiting:
    """Requests on a topic that wait for a node, in each of its threads."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._refused = 0
        self._thread: NodeThread | None = None
        self._places = threading.Semaphore()

    def place(self, thread: NodeThread) -> threading.Semaphore | None:
        """Take a place, to be released when the request is handled; None if there is none."""
        if thread is not self._thread:
            self._thread, self._places = thread, threading.Semaphore(MAX_REQUESTS)
        if self._places.acquire(blocking=False):
            return self._places
        self._refused += 1
        if is_power_of_ten(self._refused):
            text = "%s: %d requests refused, as %d wait"
            logging.getLogger(f"socialbot.{thread.name}").warning(text, self._topic, self._refused, MAX_REQUESTS)
        return None


class _RosService:
    """Service of a node, which answers in its own thread."""

    def __init__(
        self, ros: RosNode, topic: str, kind: Any, port: ServerPort, thread: Callable[[], NodeThread | None]
    ) -> None:
        assert isinstance(port, Service)
        self._ros = ros
        self._port = port
        self._thread = thread
        self._waiting = _Waiting(topic)
        # rclpy passes the result of the callback to send_response at once. Here it is the request, answered later.
        self._service = ros.create_service(kind, topic, lambda request, _: request)
        self._send = self._service.send_response
        self._service.send_response = self._take  # type: ignore[method-assign]

    def stop_goals(self) -> None: ...

    def close(self) -> None:
        self._ros.destroy_service(self._service)

    def _take(self, request: Any, header: Any) -> None:
        thread = self._thread()
        if thread is not None and (place := self._waiting.place(thread)) is not None:
            thread.queue.call_soon(functools.partial(self._answer, thread, place, request, header))

    def _answer(self, thread: NodeThread, place: threading.Semaphore, request: Any, header: Any) -> None:
        place.release()
        response = self._port.answer(thread.node, request)
        expect_valid(response, self._port.topic)
        try:
            self._send(response, header)
        except rclpy_implementation.RCLError as error:
            logging.getLogger(f"socialbot.{thread.name}").info("the client of %s is gone: %s", self._port.topic, error)


class _RosAction:
    """Action of a node, which works on goals in its own thread."""

    def __init__(
        self, ros: RosNode, topic: str, kind: Any, port: ServerPort, thread: Callable[[], NodeThread | None]
    ) -> None:
        assert isinstance(port, ActionServer)
        self._ros = ros
        self._kind = kind
        self._port = port
        self._thread = thread
        self._waiting = _Waiting(topic)
        self._new: dict[int, _RosGoal] = {}
        """Goals that the node has accepted, by the id of their message."""
        self._goals: dict[bytes, _RosGoal] = {}
        self._server = RosActionServer(
            ros,
            kind,
            topic,
            self._never,
            goal_callback=self._decide,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_S,
        )

    def stop_goals(self) -> None:
        for each in (*self._new.values(), *self._goals.values()):
            each.goal.abort()

    def close(self) -> None:
        self.stop_goals()
        self._server.destroy()

    def _never(self, handle: Any) -> Any:
        raise NotImplementedError("goals end when the node says so")

    async def _decide(self, request: Any) -> GoalResponse:
        thread = self._thread()
        if thread is None or (place := self._waiting.place(thread)) is None:
            return GoalResponse.REJECT
        made = self._new[id(request)] = _RosGoal(self._ros, self._port.topic)
        made.goal = GoalHandle(self._port.interface, request, made)
        thread.queue.call_soon(functools.partial(self._start, thread, place, made))
        await made.decided
        if made.goal.rejected:
            del self._new[id(request)]
            return GoalResponse.REJECT
        in_executor(self._ros, self._settle, made)
        return GoalResponse.ACCEPT

    def _settle(self, made: _RosGoal) -> None:
        """Begin or cancel a goal of which rclpy has not told that it is accepted.

        Its client is gone, or another goal with its id was accepted while the node decided.
        """
        request = made.goal.request
        if id(request) not in self._new:
            return
        handle = next((each for each in self._server._goal_handles.values() if each.request is request), None)
        if handle is not None:
            self._on_accepted(handle)
            return
        del self._new[id(request)]
        made.drop()
        if made.goal.active:
            self._pass_on_cancel(made)

    def _start(self, thread: NodeThread, place: threading.Semaphore, made: _RosGoal) -> None:
        place.release()
        try:
            self._port.start(thread.node, made.goal)
        finally:
            in_executor(self._ros, made.decided.set_result, None)

    def _on_accepted(self, handle: Any) -> None:
        made = self._new.pop(id(handle.request))
        self._goals[bytes(handle.goal_id.uuid)] = made

        async def result(_: Any) -> Any:
            await made.ended
            del self._goals[bytes(handle.goal_id.uuid)]
            return made.result

        handle.execute(result)
        made.begin(handle)

    def _on_cancel(self, handle: Any) -> CancelResponse:
        made = self._goals.get(bytes(handle.goal_id.uuid))
        if made is None or not made.goal.active:
            return CancelResponse.REJECT
        # The goal is cancelling only after this has returned.
        in_executor(self._ros, self._pass_on_cancel, made)
        return CancelResponse.ACCEPT

    def _pass_on_cancel(self, made: _RosGoal) -> None:
        thread = self._thread()
        if thread is not None:
            thread.queue.call_soon(functools.partial(self._port.cancel, thread.node, made.goal))


@dataclass(eq=False)
class _RosGoal:
    """`GoalChannel` of one goal. Its reports before the acceptance wait for it."""

    ros: RosNode
    topic: str
    goal: GoalHandle = field(init=False)
    result: Any = None
    decided: Future = field(default_factory=Future)
    ended: Future = field(default_factory=Future)
    _handle: Any = None
    _early: list[Callable[[], None]] = field(default_factory=list)
    _is_dropped: bool = False

    def drop(self) -> None:
        """Ignore all reports: there is no client."""
        self._is_dropped = True
        self._early.clear()

    def begin(self, handle: Any) -> None:
        """Send what waits. Called in the executor thread, as are all reports."""
        self._handle = handle
        for report in self._early:
            report()
        self._early.clear()

    def feedback(self, message: Any) -> None:
        expect_valid(message, self.topic)
        in_executor(self.ros, self._report, lambda: self._handle.publish_feedback(message))

    def end(self, outcome: Outcome, result: Any) -> None:
        expect_valid(result, self.topic)
        in_executor(self.ros, self._report, functools.partial(self._end, outcome, result))

    def _report(self, report: Callable[[], None]) -> None:
        if self._is_dropped:
            return
        if self._handle is None:
            self._early.append(report)
        else:
            report()

    def _end(self, outcome: Outcome, result: Any) -> None:
        self.result = result
        change = {
            "succeeded": self._handle.succeed,
            "aborted": self._handle.abort,
            "cancelled": self._handle.canceled,
        }[outcome]
        change()
        self.ended.set_result(None)
