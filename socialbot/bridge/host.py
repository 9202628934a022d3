"""A host lets one node live in rclpy: topics, parameters, time and a thread of its own.

The executor's thread only receives; the node works in its own thread, so that a slow node never keeps parameters
or time from coming through, and of a stream it always gets the newest message.
"""

from __future__ import annotations

import functools
import logging
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

from rclpy.clock import JumpThreshold, TimeJump
from rclpy.context import Context as RosContext
from rclpy.duration import Duration
from rclpy.node import Node as RosNode
from rclpy.parameter import Parameter as RosParameter
from std_msgs.msg import Header

from socialbot.bridge.codec import decode, encode, ros_type
from socialbot.bridge.inbox import Alarm, Inbox, Line
from socialbot.bridge.parameters import declare_parameters, watch_parameters
from socialbot.bridge.qos import publisher_qos, subscription_qos
from socialbot.bridge.readiness import Connection, publisher_connection, subscription_connection
from socialbot.bridge.ros_types import RclpyTypes, message_class
from socialbot.bridge.statistics import Reporter, Statistics
from socialbot.bridge.timekeeper import KEPT_TOPIC
from socialbot.clock import SECOND
from socialbot.errors import MessageError, NodeError, SocialbotError
from socialbot.graph import Delivery, Graph, Input, Node, Output, Placement, outcome
from socialbot.messages import Message

R = TypeVar("R")


class RosClock:
    """The time of a ROS node: the computer's, or that of /clock."""

    def __init__(self, ros: RosNode) -> None:
        self._clock = ros.get_clock()

    def now(self) -> int:
        return self._clock.now().nanoseconds


class _Context:
    """rclpy as one node sees it."""

    def __init__(self, clock: RosClock, inbox: Inbox) -> None:
        self.clock = clock
        self._inbox = inbox
        self._publishers: dict[str, Any] = {}
        self._types = RclpyTypes()

    def connect(self, port: Output[Any], publisher: Any) -> None:
        self._publishers[port.name] = publisher

    def publish(self, port: Output[Any], message: Message) -> None:
        self._publishers[port.name].publish(encode(message, self._types))

    def call_at(self, time: int, callback: Callable[[], None]) -> Alarm:
        return self._inbox.call_at(time, callback)

    def call_soon(self, callback: Callable[[], None]) -> None:
        self._inbox.call_soon(callback)

    def aside(self, work: Callable[[], R], then: Callable[[R | Exception], None]) -> None:
        def run() -> None:
            self._inbox.call_expected(functools.partial(then, outcome(work)))

        self._inbox.expect()
        threading.Thread(target=run, name="aside", daemon=True).start()


class NodeHost:
    """Hosts the node of one placement. ``failure`` is the error that kept it from starting, if any."""

    def __init__(self, graph: Graph, placement: Placement, *, ros_context: RosContext, sim_time: bool) -> None:
        self.name = placement.name
        self.failure: SocialbotError | None = None
        self._ros = RosNode(
            placement.name,
            context=ros_context,
            parameter_overrides=[RosParameter("use_sim_time", RosParameter.Type.BOOL, sim_time)] if sim_time else [],
        )
        clock = RosClock(self._ros)
        simulated = bool(self._ros.get_parameter("use_sim_time").value)
        self._inbox = Inbox(clock.now, simulated=simulated)
        self._clock = clock
        self._statistics = Statistics()
        context = _Context(clock, self._inbox)
        parameters = declare_parameters(self._ros, placement)
        self.node: Node = placement.type(placement.name, context, parameters)
        watch_parameters(self._ros, self.node)
        connections: list[Connection] = []
        for topic, port in placement.publications:
            kind = message_class(ros_type(port.message_type))
            publisher = self._ros.create_publisher(kind, topic, publisher_qos(port.delivery))
            context.connect(port, publisher)
            connections.append(publisher_connection(graph, topic, publisher))
        for topic, port in placement.subscriptions:
            kind = message_class(ros_type(port.message_type))
            qos = subscription_qos(port.delivery, outside=topic in graph.inputs)
            subscription = self._ros.create_subscription(kind, topic, functools.partial(self._receive, port), qos)
            connections.append(subscription_connection(graph, topic, subscription))
        if simulated:
            every_step = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None, on_clock_change=True)
            self._jumps = self._ros.get_clock().create_jump_callback(every_step, post_callback=self._time_moved)
            self._keeping = self._ros.create_publisher(Header, KEPT_TOPIC, publisher_qos(Delivery.EVERY))
        self._reporter = Reporter(self._ros, self._statistics, self._inbox, connections)
        self._thread = threading.Thread(target=self._work, name=placement.name, daemon=True)
        self._simulated = simulated

    @property
    def ros_node(self) -> RosNode:
        """The rclpy node, for an executor."""
        return self._ros

    @property
    def ended(self) -> bool:
        """Whether the node has stopped by itself, because it could not start."""
        return self.failure is not None

    def start(self) -> None:
        """Starts the node's thread."""
        self._thread.start()

    def stop(self, timeout_s: float = 5.0) -> None:
        """Stops the node in its own thread, and takes it off the ROS graph."""
        self._inbox.close()
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        self._ros.destroy_node()

    def _time_moved(self, _: TimeJump) -> None:
        self._inbox.time_moved()
        if self._keeping.get_subscription_count():
            # What is due at this time comes first, and what was begun aside, as simulated time waits for that.
            self._inbox.call_when_idle(functools.partial(self._keep_time, self._clock.now()))

    def _keep_time(self, time: int) -> None:
        """Tells whoever moves the time that this node has kept up with it."""
        header = Header(frame_id=self.name)
        header.stamp.sec, header.stamp.nanosec = divmod(time, SECOND)
        self._keeping.publish(header)

    def _receive(self, port: Input[Any], ros_message: Any) -> None:
        try:
            self._inbox.put(port, decode(port.message_type, ros_message, stamp=self._clock.now()))
        except MessageError as error:
            self._statistics.refused += 1
            self._report(f"refused a message on {port.topic}", error, self._statistics.refused)

    def _work(self) -> None:
        try:
            if self._simulated:
                self._await_time()
            self.node.start()
        except SocialbotError as error:
            self.failure = error
            return
        except Exception as error:  # noqa: BLE001 - whatever a node raises at its start is told in one message
            self._report("cannot start", error, 1)
            self.failure = NodeError(f"cannot start: {type(error).__name__}: {error}", where=self.name)
            return
        while (item := self._inbox.take()) is not None:
            self._do(item)
        self.node.stop()

    def _await_time(self) -> None:
        """Simulated time begins with the first message on /clock."""
        begun = threading.Event()
        while self._clock.now() == 0 and not begun.wait(0.005):
            if self._inbox.closed:
                return

    def _do(self, item: Callable[[], None] | tuple[Line, Message]) -> None:
        begin = time.perf_counter()
        try:
            if callable(item):
                item()
            else:
                line, message = item
                line.port.deliver(self.node, message)
        except Exception as error:  # noqa: BLE001 - whatever a node raises, the graph goes on
            self._statistics.failures += 1
            self._statistics.first_failure = self._statistics.first_failure or f"{type(error).__name__}: {error}"
            self._report("failed", error, self._statistics.failures)
        seconds = time.perf_counter() - begin
        if not callable(item):
            item[0].charge(seconds)
        self._statistics.note(seconds)

    def _report(self, what: str, error: Exception, count: int) -> None:
        """Logs the first failure, the tenth, the hundredth, ...: a bad stream must not flood the log."""
        if str(count).strip("0") == "1":
            times = f" {count} times" if count > 1 else ""
            expected = isinstance(error, SocialbotError)
            logger = logging.getLogger(f"socialbot.{self.name}")
            logger.warning("%s%s: %s", what, times, error, exc_info=not expected)
