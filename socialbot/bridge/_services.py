"""Services and actions of one hosted node over rclpy.

rclpy works in the executor thread: it takes requests and answers there. The node gets them in its own thread.
"""

from __future__ import annotations

import functools
import logging
import math
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.action.client import ActionClient as RosActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.action.server import ActionServer as RosActionServer
from rclpy.action.server import CancelResponse, GoalResponse
from rclpy.clock import Clock as SteadyClock
from rclpy.clock_type import ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node as RosNode
from rclpy.qos import qos_profile_system_default
from rclpy.serialization import serialize_message
from rclpy.service_introspection import ServiceIntrospectionState
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

from socialbot.bridge.environment import KEYS_VARIABLE
from socialbot.bridge.transport import message_class
from socialbot.core.errors import InstallationError, MessageError, ParameterError
from socialbot.graph.calls import SERVER_WAIT_S, Channel, GoalHandle, Outcome, PendingCall
from socialbot.graph.node import NodeConfig
from socialbot.graph.services import ActionServer, ClientPort, ServerPort, Service

if TYPE_CHECKING:
    from socialbot.bridge._node_thread import NodeThread

WATCH_PERIOD_S = 1.0  # period to look for the servers of clients
CANCEL_SENT_S = 2.0  # longest time that the end of a node waits until its goals are cancelled
CHECK_PERIOD_S = 0.05  # period to look for servers while a call is in progress

_OUTCOMES: dict[int, Outcome] = {
    GoalStatus.STATUS_SUCCEEDED: "succeeded",
    GoalStatus.STATUS_CANCELED: "cancelled",
    GoalStatus.STATUS_ABORTED: "aborted",
    GoalStatus.STATUS_UNKNOWN: "lost",
}


class HostedServices:
    """Servers and clients of the node ``config``.

    ``thread`` returns the thread of the node; None while it is not active.
    """

    def __init__(
        self, ros: RosNode, config: NodeConfig, thread: Callable[[], NodeThread | None], *, sealed: bool
    ) -> None:
        self._ros = ros
        self._config = config
        self._thread = thread
        self._sealed = sealed
        self._channels: dict[str, _RosChannel] = {}
        self._servers: list[_RosService | _RosAction] = []
        self._absent_since: dict[str, float] = {}
        """Time (monotonic s) since which a server is missing; minus infinity after it was there."""
        clock = SteadyClock(clock_type=ClockType.STEADY_TIME)
        self._timer = ros.create_timer(WATCH_PERIOD_S, self._watch, clock=clock) if config.clients else None

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
            ParameterError: A service would be offered without a signature in a graph with keys.
        """
        for topic, port in self._config.clients:
            try:
                kind = message_class(port.interface.name)
            except InstallationError as error:
                if not port.optional:
                    raise
                self._ros.get_logger().info(f"the client {port.name} is not used: {error.what}")
                continue
            make = _ActionChannel if port.interface.is_action else _ServiceChannel
            self._channels[port.name] = make(self._ros, topic, kind, self._report)
        for topic, port in self._config.servers:
            if self._sealed:
                expect_open(topic, port)
            kind = message_class(port.interface.name)
            offer = _RosService if isinstance(port, Service) else _RosAction
            self._servers.append(offer(self._ros, topic, kind, port, self._thread))

    def channel(self, port: ClientPort) -> Channel:
        """The channel of a client."""
        channel = self._channels.get(port.name)
        return _NoChannel(self._config.topic(port)) if channel is None else channel

    def stop_goals(self) -> None:
        """Abort the goals that the node works on."""
        for server in self._servers:
            server.stop_goals()

    def cancel_goals(self) -> None:
        """Ask the servers to cancel the goals of the node."""
        for channel in self._channels.values():
            channel.cancel_all()

    def await_cancels(self) -> None:
        """Wait a moment until the servers have got what `cancel_goals` asks; the executor of the node has ended."""
        if not any(channel.is_cancelling for channel in self._channels.values()):
            return
        executor = SingleThreadedExecutor(context=self._ros.context)
        executor.add_node(self._ros)
        asked = time.monotonic()
        end = asked + CANCEL_SENT_S
        while any(channel.is_cancelling for channel in self._channels.values()) and time.monotonic() < end:
            executor.spin_once(timeout_sec=CHECK_PERIOD_S)
            if time.monotonic() - asked > CHECK_PERIOD_S:
                # The server may have got the goal only after it was asked to cancel it, and answers can be lost.
                self.cancel_goals()
                asked = time.monotonic()
        executor.shutdown()

    def close(self) -> None:
        """Destroy the clients and servers."""
        for each in (*self._channels.values(), *self._servers):
            each.close()
        self._channels.clear()
        self._servers.clear()

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


class _NoChannel:
    """Channel of an optional client whose type is not installed."""

    def __init__(self, topic: str) -> None:
        self.topic = topic

    def send(self, call: PendingCall) -> None:
        """The call ends without a server."""

    def cancel(self, call: PendingCall) -> None: ...


class _RosChannel:
    """Channel that sends calls once there is a server, and notices when it goes away.

    All methods but `send` and `cancel` run in the executor thread.
    """

    def __init__(self, ros: RosNode, topic: str, watched: str, report: Callable[..., None]) -> None:
        self.topic = topic
        self._ros = ros
        self._watched = watched
        self._report = report
        self._waiting: list[PendingCall] = []
        self._sent: dict[PendingCall, frozenset[bytes]] = {}
        clock = SteadyClock(clock_type=ClockType.STEADY_TIME)
        self._timer = ros.create_timer(CHECK_PERIOD_S, self._check, clock=clock, autostart=False)

    def send(self, call: PendingCall) -> None:
        _expect_valid(call.message, self.topic)
        _in_executor(self._ros, self._open, call)

    def cancel(self, call: PendingCall) -> None:
        _in_executor(self._ros, self._cancel, call)

    def close(self) -> None:
        self._ros.destroy_timer(self._timer)

    @property
    def is_cancelling(self) -> bool:
        """Whether a server has not yet answered that a goal shall be cancelled."""
        return False

    def cancel_all(self) -> None:
        """Cancel the goals that were sent, at once: at the end of a node the executor has no time for it."""

    def _open(self, call: PendingCall) -> None:
        if self.has_server():
            self._transmit(call)
        else:
            self._waiting.append(call)
        self._timer.reset()

    def _transmit(self, call: PendingCall) -> None:
        self._sent[call] = frozenset(self._endpoints())
        self._report(call.on_sent)
        self._request(call)

    def _check(self) -> None:
        self._waiting = [call for call in self._waiting if call.result is None]
        self._sent = {call: servers for call, servers in self._sent.items() if call.result is None}
        if self._waiting and self.has_server():
            waiting, self._waiting = self._waiting, []
            for call in waiting:
                self._transmit(call)
        present = self._endpoints() if self._sent else {}
        for call, servers in self._sent.items():
            # A killed process stays discovered for a while, but its successor has the same name.
            successors = {node for server, node in present.items() if server not in servers}
            if not any(server in servers and node not in successors for server, node in present.items()):
                self._report(call.end, "lost")
        if not self._waiting and not self._sent:
            self._timer.cancel()

    def _endpoints(self) -> dict[bytes, str]:
        """The node of each server by its id. The name of a new node may be unknown at first."""
        found = self._ros.get_publishers_info_by_topic(self._watched, no_mangle=True)
        return {bytes(one.endpoint_gid): f"{one.node_namespace}/{one.node_name}" for one in found}

    def _cancel(self, call: PendingCall) -> None:
        if call in self._waiting:
            self._waiting.remove(call)

    def has_server(self) -> bool:
        raise NotImplementedError

    def _request(self, call: PendingCall) -> None:
        raise NotImplementedError


def _in_executor(ros: RosNode, callback: Callable[..., None], *arguments: Any) -> None:
    """Call ``callback`` in the executor thread, which then resumes its coroutines. Errors are logged."""

    def run() -> None:
        try:
            callback(*arguments)
        except Exception as error:  # noqa: BLE001 - it would end the executor, and the process
            ros.get_logger().warning(f"{type(error).__name__}: {error}")

    executor = ros.executor
    if executor is not None and executor._is_shutdown:
        run()  # the node stops, and nothing else works any more
    elif executor is not None:
        executor.create_task(run)


def _expect_valid(message: Any, where: str) -> None:
    """Raise MessageError if rclpy cannot send ``message``."""
    try:
        serialize_message(message)
    except Exception as error:
        raise MessageError(f"not a valid {type(message).__name__}: {error}", where=where) from error


class _ServiceChannel(_RosChannel):
    def __init__(self, ros: RosNode, topic: str, kind: Any, report: Callable[..., None]) -> None:
        super().__init__(ros, topic, f"rr{ros.resolve_service_name(topic)}Reply", report)
        self._client = ros.create_client(kind, topic)
        # The events make a recording of the run complete: a replay answers from them.
        self._client.configure_introspection(
            ros.get_clock(), qos_profile_system_default, ServiceIntrospectionState.CONTENTS
        )
        self._futures: dict[PendingCall, Future] = {}

    def close(self) -> None:
        super().close()
        self._ros.destroy_client(self._client)

    def has_server(self) -> bool:
        return self._client.service_is_ready()

    def _request(self, call: PendingCall) -> None:
        future = self._futures[call] = self._client.call_async(call.message)
        future.add_done_callback(functools.partial(self._on_response, call))

    def _on_response(self, call: PendingCall, future: Any) -> None:
        if self._futures.pop(call, None) is not None:
            self._report(call.end, "succeeded", future.result())

    def _cancel(self, call: PendingCall) -> None:
        super()._cancel(call)
        future = self._futures.pop(call, None)
        if future is not None:
            self._client.remove_pending_request(future)


class _ActionChannel(_RosChannel):
    def __init__(self, ros: RosNode, topic: str, kind: Any, report: Callable[..., None]) -> None:
        super().__init__(ros, topic, f"rt{ros.resolve_service_name(topic)}/_action/status", report)
        self._client = RosActionClient(ros, kind, topic)
        self._goals: dict[PendingCall, ClientGoalHandle] = {}
        """Handle of each sent goal."""
        self._answered: set[PendingCall] = set()
        """Goals that the server has accepted, as far as the executor knows."""
        self._unwanted: set[PendingCall] = set()

    def close(self) -> None:
        super().close()
        self._client.destroy()

    def has_server(self) -> bool:
        return self._client.server_is_ready()

    def _request(self, call: PendingCall) -> None:
        identity = UUID(uuid=list(uuid.uuid4().bytes))
        self._goals[call] = ClientGoalHandle(self._client, identity, None)
        future = self._client.send_goal_async(
            call.message,
            feedback_callback=lambda message: self._report(call.on_feedback, message.feedback),
            goal_uuid=identity,
        )
        future.add_done_callback(functools.partial(self._on_answer, call))

    def _on_answer(self, call: PendingCall, future: Any) -> None:
        goal = future.result()
        if not goal.accepted:
            self._forget(call)
            self._report(call.end, "rejected")
            return
        if call not in self._goals:
            return  # it was cancelled before this answer, and has ended
        self._on_accepted(call)
        if call in self._unwanted:
            self._ask_to_cancel(call)

    def _on_accepted(self, call: PendingCall) -> None:
        if call in self._answered:
            return
        self._answered.add(call)
        self._report(call.on_accepted)
        self._goals[call].get_result_async().add_done_callback(functools.partial(self._on_result, call))

    def _on_result(self, call: PendingCall, future: Any) -> None:
        self._forget(call)
        answer = future.result()
        outcome = _OUTCOMES.get(answer.status, "aborted")
        self._report(call.end, outcome, None if outcome == "lost" else answer.result)

    def _forget(self, call: PendingCall) -> None:
        self._goals.pop(call, None)
        self._answered.discard(call)
        self._unwanted.discard(call)

    def _cancel(self, call: PendingCall) -> None:
        super()._cancel(call)
        if call in self._goals:
            self._ask_to_cancel(call)

    @property
    def is_cancelling(self) -> bool:
        return bool(self._unwanted)

    def cancel_all(self) -> None:
        for call in self._goals:
            self._ask_to_cancel(call)

    def _ask_to_cancel(self, call: PendingCall) -> None:
        self._unwanted.add(call)
        # By its id, a goal can be cancelled before the answer that it is accepted has arrived.
        future = self._goals[call].cancel_goal_async()
        future.add_done_callback(functools.partial(self._on_cancel_answer, call, call not in self._answered))

    def _on_cancel_answer(self, call: PendingCall, early: bool, future: Any) -> None:
        answer = future.result()
        if call not in self._unwanted or (early and not answer.goals_canceling):
            return  # an answer has decided it, or the server may not have had the goal yet
        self._unwanted.discard(call)
        if answer.goals_canceling:
            self._on_accepted(call)
        elif answer.return_code != CancelGoal.Response.ERROR_GOAL_TERMINATED:
            self._report(call.on_cancel_refused)


class _RosService:
    """Service of a node, which answers in its own thread."""

    def __init__(
        self, ros: RosNode, topic: str, kind: Any, port: ServerPort, thread: Callable[[], NodeThread | None]
    ) -> None:
        assert isinstance(port, Service)
        self._ros = ros
        self._port = port
        self._thread = thread
        # rclpy passes the result of the callback to send_response at once. Here it is the request, answered later.
        self._service = ros.create_service(kind, topic, lambda request, _: request)
        self._send = self._service.send_response
        self._service.send_response = self._take  # type: ignore[method-assign]

    def stop_goals(self) -> None: ...

    def close(self) -> None:
        self._ros.destroy_service(self._service)

    def _take(self, request: Any, header: Any) -> None:
        thread = self._thread()
        if thread is not None:
            thread.queue.call_soon(functools.partial(self._answer, thread, request, header))

    def _answer(self, thread: NodeThread, request: Any, header: Any) -> None:
        response = self._port.answer(thread.node, request)
        _expect_valid(response, self._port.topic)
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
        if thread is None:
            return GoalResponse.REJECT
        made = self._new[id(request)] = _RosGoal(self._ros, self._port.topic)
        made.goal = GoalHandle(self._port.interface, request, made)
        thread.queue.call_soon(functools.partial(self._start, thread, made))
        await made.decided
        if made.goal.rejected:
            del self._new[id(request)]
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _start(self, thread: NodeThread, made: _RosGoal) -> None:
        try:
            self._port.start(thread.node, made.goal)
        finally:
            _in_executor(self._ros, made.decided.set_result, None)

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
        _in_executor(self._ros, self._pass_on_cancel, made)
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

    def begin(self, handle: Any) -> None:
        """Send what waits. Called in the executor thread, as are all reports."""
        self._handle = handle
        for report in self._early:
            report()
        self._early.clear()

    def feedback(self, message: Any) -> None:
        _expect_valid(message, self.topic)
        _in_executor(self.ros, self._report, lambda: self._handle.publish_feedback(message))

    def end(self, outcome: Outcome, result: Any) -> None:
        _expect_valid(result, self.topic)
        _in_executor(self.ros, self._report, functools.partial(self._end, outcome, result))

    def _report(self, report: Callable[[], None]) -> None:
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
