"""Channels of the clients of services and actions of one hosted node, over rclpy."""

from __future__ import annotations

import functools
import threading
import uuid
from collections import deque
from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.action.client import ActionClient as RosActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.node import Node as RosNode
from rclpy.qos import qos_profile_system_default
from rclpy.serialization import serialize_message
from rclpy.service_introspection import ServiceIntrospectionState
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

from socialbot.bridge.discovery import Pace, readable
from socialbot.bridge.environment import steady_timer
from socialbot.core.errors import MessageError
from socialbot.graph.calls import Outcome, PendingCall

CHECK_PERIOD_S = 0.05  # period to look for servers while a call is in progress

MAX_FEEDBACK = 16
"""Most messages of feedback of a goal that wait for the node; older ones are dropped."""

_OUTCOMES: dict[int, Outcome] = {
    GoalStatus.STATUS_SUCCEEDED: "succeeded",
    GoalStatus.STATUS_CANCELED: "cancelled",
    GoalStatus.STATUS_ABORTED: "aborted",
    GoalStatus.STATUS_UNKNOWN: "lost",
}


class NoChannel:
    """Channel of an optional client whose type is not installed."""

    def __init__(self, topic: str) -> None:
        self.topic = topic

    def send(self, call: PendingCall) -> None:
        """The call ends without a server."""

    def cancel(self, call: PendingCall) -> None: ...


class RosChannel:
    """Channel that sends calls once there is a server, and notices when it goes away.

    All methods but `send` and `cancel` run in the executor thread of ``ros``.
    """

    def __init__(self, ros: RosNode, topic: str, watched: str, report: Callable[..., None]) -> None:
        self.topic = topic
        self.ros = ros
        self._watched = watched
        self._report = report
        self._waiting: list[PendingCall] = []
        self._sent: dict[PendingCall, frozenset[bytes] | None] = {}
        """Calls in progress, with the servers that got them; None while a name among the servers is no text."""
        self._pace = Pace()
        self._timer = steady_timer(ros, CHECK_PERIOD_S, self._check, autostart=False)

    def send(self, call: PendingCall) -> None:
        expect_valid(call.message, self.topic)
        in_executor(self.ros, self._open, call)

    def cancel(self, call: PendingCall) -> None:
        in_executor(self.ros, self._cancel, call)

    def close(self) -> None:
        self.ros.destroy_timer(self._timer)

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
        found = readable(self._endpoints)
        self._sent[call] = None if found is None else frozenset(found)
        self._report(call.on_sent)
        self._request(call)

    def _check(self) -> None:
        self._waiting = [call for call in self._waiting if call.result is None]
        self._sent = {call: servers for call, servers in self._sent.items() if call.result is None}
        if self._waiting and self.has_server():
            waiting, self._waiting = self._waiting, []
            for call in waiting:
                self._transmit(call)
        if self._sent and self._pace.is_due:
            with self._pace.looking():
                present = readable(self._endpoints)
            if present is not None:
                self._end_lost(present)
        if not self._waiting and not self._sent:
            self._timer.cancel()

    def _end_lost(self, present: dict[bytes, str]) -> None:
        """End the calls whose servers are not ``present``; send those that no server has heard to the present ones."""
        for call, known in list(self._sent.items()):
            servers = self._sent[call] = frozenset(present) if known is None else known
            # A killed process stays discovered for a while, but its successor has the same name.
            successors = {node for server, node in present.items() if server not in servers}
            if any(server in servers and node not in successors for server, node in present.items()):
                continue
            if present and self._is_unheard(call):
                self._transmit(call)
            else:
                self._report(call.end, "lost")

    def _endpoints(self) -> dict[bytes, str]:
        """The node of each server by its id. The name of a new node may be unknown at first."""
        found = self.ros.get_publishers_info_by_topic(self._watched, no_mangle=True)
        return {bytes(one.endpoint_gid): f"{one.node_namespace}/{one.node_name}" for one in found}

    def _cancel(self, call: PendingCall) -> None:
        if call in self._waiting:
            self._waiting.remove(call)

    def _is_unheard(self, call: PendingCall) -> bool:
        """Whether no server seems to have got a call that was sent. Of a service, nobody can know."""
        return False

    def has_server(self) -> bool:
        raise NotImplementedError

    def _request(self, call: PendingCall) -> None:
        raise NotImplementedError


def in_executor(ros: RosNode, callback: Callable[..., None], *arguments: Any) -> None:
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


def expect_valid(message: Any, where: str) -> None:
    """Raise MessageError if rclpy cannot send ``message``."""
    try:
        serialize_message(message)
    except Exception as error:
        raise MessageError(f"not a valid {type(message).__name__}: {error}", where=where) from error


class ServiceChannel(RosChannel):
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
        self.ros.destroy_client(self._client)

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


class _Feedback:
    """Feedback of a goal for a node, in whose thread `pass_on` is called."""

    def __init__(self, call: PendingCall, report: Callable[..., None]) -> None:
        self._call = call
        self._report = report
        self._lock = threading.Lock()
        self._waiting: deque[Any] = deque(maxlen=MAX_FEEDBACK)

    def take(self, message: Any) -> None:
        """Keep a message in place of the oldest, if as many wait: a server may send without end."""
        with self._lock:
            is_new = len(self._waiting) < MAX_FEEDBACK
            self._waiting.append(message.feedback)
        if is_new:
            self._report(self.pass_on)

    def pass_on(self) -> None:
        with self._lock:
            message = self._waiting.popleft()
        self._call.on_feedback(message)


class ActionChannel(RosChannel):
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
        goal = self._goals[call] = ClientGoalHandle(self._client, identity, None)
        future = self._client.send_goal_async(
            call.message,
            feedback_callback=functools.partial(self._on_feedback, call, goal, _Feedback(call, self._report)),
            goal_uuid=identity,
        )
        future.add_done_callback(functools.partial(self._on_answer, call, goal))

    def _is_unheard(self, call: PendingCall) -> bool:
        return call in self._goals and call not in self._answered and call not in self._unwanted

    def _is_repeated(self, call: PendingCall, sent: ClientGoalHandle) -> bool:
        """Whether the goal of ``sent`` was sent again since, to another server."""
        return self._goals.get(call, sent) is not sent

    def _on_answer(self, call: PendingCall, sent: ClientGoalHandle, future: Any) -> None:
        if self._is_repeated(call, sent):
            return
        goal = future.result()
        if not goal.accepted:
            self._forget(call)
            self._report(call.end, "rejected")
            return
        self._on_known(call)

    def _on_feedback(self, call: PendingCall, sent: ClientGoalHandle, feedback: _Feedback, message: Any) -> None:
        if self._is_repeated(call, sent):
            return
        # The answer of a server that has not discovered the client yet is lost; feedback shows that it has the goal.
        self._on_known(call)
        feedback.take(message)

    def _on_known(self, call: PendingCall) -> None:
        """The server has the goal; ignored if it is known, or was cancelled before and has ended."""
        if call not in self._goals or call in self._answered:
            return
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
