"""A host lets one node live in rclpy: topics, parameters, time, states and a thread of its own.

The executor's thread only receives; the node works in its own thread, so that a slow node never keeps parameters
or time from coming through, and of a stream it always gets the newest message.
"""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock as SteadyClock
from rclpy.clock import JumpThreshold, TimeJump
from rclpy.clock_type import ClockType
from rclpy.context import Context as RosContext
from rclpy.duration import Duration
from rclpy.node import Node as RosNode
from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher
from std_msgs.msg import Header

from socialbot.bridge.diagnostics import (
    Connection,
    DiagnosticsReporter,
    NodeStatistics,
    publisher_connection,
    subscription_connection,
)
from socialbot.bridge.lifecycle import (
    ACTIVE,
    FINALIZED,
    INACTIVE,
    LifecycleHost,
    declare_parameters,
    parameter_values,
    watch_parameters,
)
from socialbot.bridge.node_thread import NodeThread, report
from socialbot.bridge.sim_clock import KEPT_TOPIC
from socialbot.bridge.transport import QUEUE_DEPTH, Receiver, Sender, publisher_qos, refusal_reason, subscription_qos, open_transport
from socialbot.core.clock import SECOND, Clock, ForwardClock, WallClock
from socialbot.core.errors import MessageError, NodeError, SocialbotError
from socialbot.core.messages import Health, Message
from socialbot.graph.health import health_topics
from socialbot.graph.node import Delivery, Graph, Input, Node, NodeConfig

AUTOSTART = "autostart"
AUTOSTART_DOC = "whether the node configures and activates itself, or somebody else does"

HEARTBEAT_S = 0.5
"""The period of the state reports to a supervisor."""

STEADY = SteadyClock(clock_type=ClockType.STEADY_TIME)


def clock_of(ros: RosNode, *, simulated: bool) -> Clock:
    """The time of the node in ``ros``: the time of day, or that of /clock. Neither goes back, whoever sets them."""
    if not simulated:
        return WallClock()
    source = ros.get_clock()
    return ForwardClock(lambda: source.now().nanoseconds)


class SupervisorLink(Protocol):
    """The connection to the process that supervises this one."""

    def send(self, node: str, word: str, /) -> None:
        """Report the state of a node; callable from any thread, never blocks."""
        ...

    def wait(self) -> tuple[str, str] | None:
        """Wait for a command: a node and its wanted state. None when the supervisor is gone."""
        ...


class NodeHost:
    """Hosts the node of one placement as a ROS 2 lifecycle node.

    It is built when that is configured, started when it is activated, and stopped when it is deactivated; what is
    activated then is built anew. ``failure`` is the error that kept it from starting, if any. With a ``supervisor`` a
    supervisor decides when it is activated, and hears how it is.
    """

    def __init__(
        self,
        graph: Graph,
        placement: NodeConfig,
        *,
        ros_context: RosContext,
        sim_time: bool,
        supervisor: SupervisorLink | None = None,
    ) -> None:
        self.name = placement.name
        self.statistics = NodeStatistics()
        self._graph = graph
        self._placement = placement
        self._supervisor = supervisor
        self._transport = open_transport(form=self._graph.wire)
        sealed = self._transport.sealed  # then there are no services: anybody could call them
        self._ros = LifecycleHost(
            placement.name,
            self,
            services=not sealed,
            start_parameter_services=not sealed,
            context=ros_context,
            parameter_overrides=[RosParameter("use_sim_time", RosParameter.Type.BOOL, sim_time)] if sim_time else [],
        )
        declare_parameters(self._ros, placement)
        doc = ParameterDescriptor(description=AUTOSTART_DOC, read_only=True)
        self._autostart = bool(self._ros.declare_parameter(AUTOSTART, True, doc).value)
        self._simulated = bool(self._ros.get_parameter("use_sim_time").value)
        self._clock = clock_of(self._ros, simulated=self._simulated)
        self._error: SocialbotError | None = None
        self._senders: dict[str, Sender] = {}
        self._healths: list[tuple[Publisher, Sender]] = []
        self._connections: list[Connection] = []
        self._latched: dict[Input[Any], Message] = {}
        self._early: deque[tuple[Input[Any], Message]] = deque(maxlen=QUEUE_DEPTH[Delivery.EVERY])
        self._life: NodeThread | None = None
        self._unwatch: Callable[[], None] | None = None
        if self._simulated:
            every_step = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None, on_clock_change=True)
            self._jumps = self._ros.get_clock().create_jump_callback(every_step, post_callback=self._time_moved)
            self._keeping = self._ros.create_publisher(Header, KEPT_TOPIC, publisher_qos(Delivery.EVERY))
        self._reporter = DiagnosticsReporter(
            self._ros, self.statistics, self._connections, self._lines, lambda: self._ros.state
        )
        if sealed:
            self._renewing = self._ros.create_timer(self._transport.renewal_s, lambda: self._transport.renew(), clock=STEADY)
        if supervisor is not None:
            self._beating = self._ros.create_timer(HEARTBEAT_S, self._beat, clock=STEADY)

    @property
    def ros_node(self) -> RosNode:
        """The rclpy node, for an executor."""
        return self._ros

    @property
    def node(self) -> Node:
        """The node as it lives now. Raises NodeError when there is none."""
        if self._life is None:
            raise NodeError(f"it is {self._ros.state}", where=self.name)
        return self._life.node

    @property
    def failure(self) -> SocialbotError | None:
        """The error that kept the node from starting, if any."""
        return self._error or (None if self._life is None else self._life.failure)

    @property
    def ended(self) -> bool:
        """Whether the node has stopped by itself: because it could not start, or was shut down."""
        return self.failure is not None or self._ros.state == FINALIZED

    def start(self) -> None:
        """Configures and activates the node, unless somebody else is to do that."""
        if self._supervisor is not None:
            self.transition_to(INACTIVE)
            self._beat()
        elif self._autostart:
            self.transition_to(ACTIVE)

    def go(self, state: str) -> None:
        """Takes the node to one of the states of a managed node; a node that cannot go there has failed."""
        if self._ros.transition_to(state) or self._ros.error is None:
            return
        error = self._ros.error
        if not isinstance(error, SocialbotError):
            report(self.name, "cannot start", error, 1)
            error = NodeError(f"cannot start: {type(error).__name__}: {error}", where=self.name)
        self._error = error

    def stop(self) -> None:
        """Stops the node in its own thread, and takes it off the ROS graph."""
        if self._life is not None:
            self._life.stop()
        self._ros.destroy_node()

    # The steps of a managed node

    def configure(self) -> None:
        """Builds the node and what connects it."""
        self._build()
        for topic in health_topics(self._graph, self.name):
            kind = self._transport.message_class(Health)
            publisher = self._ros.create_publisher(kind, topic, publisher_qos(Delivery.EVERY))
            self._healths.append((publisher, self._transport.sender(publisher)))
        for topic, port in self._placement.publications:
            kind = self._transport.message_class(port.message_type)
            publisher = self._ros.create_publisher(kind, topic, publisher_qos(port.delivery))
            self._senders[port.name] = self._transport.sender(publisher, latched=port.delivery is Delivery.LATCHED)
            self._connections.append(publisher_connection(self._graph, topic, publisher))
        for topic, port in self._placement.subscriptions:
            kind = self._transport.message_class(port.message_type)
            qos = subscription_qos(port.delivery, outside=topic in self._graph.inputs)
            receiver = self._transport.receiver(self._ros.resolve_topic_name(topic), latched=port.delivery is Delivery.LATCHED)
            receive = functools.partial(self._receive, port, receiver)
            subscription = self._ros.create_subscription(kind, topic, receive, qos)
            self._connections.append(subscription_connection(self._graph, topic, subscription))

    def activate(self) -> None:
        """Starts the node, with what is latched and what was sent to it while it waited to be started."""
        life = self._life or self._build()
        for port, message in (*self._latched.items(), *self._early):
            life.inbox.put(port, message)
        self._early.clear()
        life.start()

    def deactivate(self) -> None:
        """Stops the node."""
        if self._life is not None:
            self._life.stop()
        self._forget_life()

    def clean_up(self) -> None:
        """Takes down what connects the node."""
        self._forget_life()
        for connection in self._connections:
            if isinstance(connection.end, Publisher):
                self._ros.destroy_publisher(connection.end)
            else:
                self._ros.destroy_subscription(connection.end)
        for publisher, _ in self._healths:
            self._ros.destroy_publisher(publisher)
        self._healths.clear()
        self._connections.clear()
        self._senders.clear()
        self._latched.clear()
        self._transport = open_transport(form=self._graph.wire)

    def _build(self) -> NodeThread:
        life = self._life = NodeThread(
            self._placement,
            parameter_values(self._ros, self._placement),
            clock=self._clock,
            simulated=self._simulated,
            senders=self._senders,
            connections=self._connections,
            statistics=self.statistics,
            say_health=self._say_health,
            well=self._well,
        )
        self._unwatch = watch_parameters(self._ros, life.node, life.call)
        return life

    def _forget_life(self) -> None:
        self._life = None
        self._early.clear()
        if self._unwatch is not None:
            self._unwatch()
            self._unwatch = None

    # What comes in

    def _receive(self, port: Input[Any], receiver: Receiver, ros_message: Any) -> None:
        try:
            message = receiver.decode(port.message_type, ros_message, stamp=self._clock.now())
        except MessageError as error:
            reason = refusal_reason(error)
            self.statistics.refusals[reason] += 1
            report(self.name, f"refused a message on {port.topic}", error, self.statistics.refusals[reason])
            return
        if message is None:
            return
        if port.delivery is Delivery.LATCHED:
            self._latched[port] = message
        if self._life is not None and self._life.started:
            self._life.inbox.put(port, message)
        elif self._life is not None and port.delivery is Delivery.EVERY:
            self._early.append((port, message))

    def _time_moved(self, _: TimeJump) -> None:
        if self._life is None:
            return
        self._life.inbox.time_moved()
        if self._keeping.get_subscription_count():
            # What is due at this time comes first, and what was begun aside, as simulated time waits for that.
            self._life.inbox.call_when_idle(functools.partial(self._keep_time, self._clock.now()))

    def _keep_time(self, time: int) -> None:
        """Tells whoever moves the time that this node has kept up with it."""
        header = Header(frame_id=self.name)
        header.stamp.sec, header.stamp.nanosec = divmod(time, SECOND)
        self._keeping.publish(header)

    # How it is

    def _say_health(self, health: Health) -> None:
        """Says how the node is, if anybody listens."""
        for publisher, sender in self._healths:
            if publisher.get_subscription_count():
                sender.publish(health)

    def _lines(self) -> Any:
        return self._life.inbox.lines if self._life is not None else ()

    def _beat(self) -> None:
        if self._life is not None and self._life.started:
            self._life.ask()
        elif self._supervisor is not None:
            self._supervisor.send(self.name, self._ros.state)

    def _well(self) -> None:
        if self._supervisor is not None:
            self._supervisor.send(self.name, ACTIVE)
