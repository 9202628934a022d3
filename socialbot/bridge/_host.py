"""Host of one node in rclpy: topics, parameters, time, lifecycle and thread.

The executor thread only receives messages. A slow node runs in its own thread, so it delays neither parameters nor
time, and always gets the newest message of a stream.
"""

from __future__ import annotations

import functools
import time
from collections import defaultdict, deque
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

from socialbot.bridge._lifecycle import (
    ACTIVE,
    FINALIZED,
    INACTIVE,
    LifecycleHost,
    declare_parameters,
    parameter_values,
    watch_parameters,
)
from socialbot.bridge._node_thread import NodeThread, log_failure, start_failure
from socialbot.bridge.diagnostics import (
    Connection,
    DiagnosticsReporter,
    NodeStatistics,
    publisher_connection,
    subscription_connection,
)
from socialbot.bridge.sim_clock import KEPT_TOPIC
from socialbot.bridge.transport import (
    QUEUE_DEPTH,
    Receiver,
    Sender,
    open_transport,
    publisher_qos,
    refusal_reason,
    subscription_qos,
)
from socialbot.core.clock import SECOND, Clock, ForwardClock, WallClock
from socialbot.core.errors import MessageError, NodeError, SocialbotError
from socialbot.core.messages import Health, Message
from socialbot.graph.health import health_topics
from socialbot.graph.node import Delivery, Graph, Input, Node, NodeConfig, Output

AUTOSTART = "autostart"
AUTOSTART_DOC = "whether the node configures and activates itself"

HEARTBEAT_S = 0.5
"""Period of the state reports to a supervisor."""

DDS_HOLD_S = 1.0
"""Time to keep a topic on DDS after its last outside subscriber, so that messages stay in order."""

STEADY = SteadyClock(clock_type=ClockType.STEADY_TIME)


def node_clock(ros: RosNode, *, simulated: bool) -> Clock:
    """Wall clock, or the time of /clock. Neither goes back when the system time is set."""
    if not simulated:
        return WallClock()
    source = ros.get_clock()
    return ForwardClock(lambda: source.now().nanoseconds)


class SupervisorLink(Protocol):
    """Connection to the supervisor of this process."""

    def send(self, node: str, word: str, /) -> None:
        """Report the state of a node, from any thread and without blocking."""
        ...

    def wait(self) -> tuple[str, str] | None:
        """Wait for a command: a node and its target state. None when the supervisor is gone."""
        ...


class IntraProcess:
    """In-process delivery of messages as objects, without DDS.

    It applies if all subscribers of a topic are active nodes of this process. Otherwise, and for latched topics, DDS
    delivers to all of them.
    """

    def __init__(self) -> None:
        self._targets: dict[str, list[tuple[NodeHost, Input[Any]]]] = defaultdict(list)
        self._dds_until: dict[str, float] = {}

    def add(self, topic: str, host: NodeHost, port: Input[Any]) -> None:
        """Register a subscription to the fully qualified ``topic``."""
        self._targets[topic].append((host, port))

    def remove(self, host: NodeHost) -> None:
        for topic, targets in self._targets.items():
            self._targets[topic] = [target for target in targets if target[0] is not host]

    def deliver(self, publisher: Publisher, message: Message) -> bool:
        """Deliver ``message`` to all subscribers; return False if DDS has to deliver it."""
        topic = publisher.topic_name
        targets = self._targets.get(topic, ())
        threads = [(host.active_thread, port) for host, port in targets if isinstance(message, port.message_type)]
        now = time.monotonic()
        if (
            len(threads) < len(targets)
            or publisher.get_subscription_count() != len(threads)
            or any(thread is None for thread, _ in threads)
        ):
            self._dds_until[topic] = now + DDS_HOLD_S
            return False
        if now < self._dds_until.get(topic, 0.0):
            return False
        for thread, port in threads:
            assert thread is not None
            thread.queue.put(port, message)
        return True


class NodeHost:
    """Host of a node as a ROS 2 lifecycle node.

    Configuration builds the node, activation starts it, and deactivation stops it. The next activation builds another.

    Args:
        graph: The graph.
        config: The node to host.
        ros_context: The rclpy context.
        sim_time: Whether the time comes from /clock.
        supervisor: Commands activation, and receives the state.
        intra_process: The other nodes of this process.
    """

    def __init__(
        self,
        graph: Graph,
        config: NodeConfig,
        *,
        ros_context: RosContext,
        sim_time: bool,
        supervisor: SupervisorLink | None = None,
        intra_process: IntraProcess | None = None,
    ) -> None:
        self.name = config.name
        self.statistics = NodeStatistics()
        self._graph = graph
        self._config = config
        self._supervisor = supervisor
        self._intra_process = intra_process or IntraProcess()
        self._transport = open_transport(form=graph.wire)
        sealed = self._transport.sealed  # disables services, which have no seals
        self._ros = LifecycleHost(
            config.name,
            self,
            services=not sealed,
            start_parameter_services=not sealed,
            context=ros_context,
            parameter_overrides=[RosParameter("use_sim_time", RosParameter.Type.BOOL, sim_time)] if sim_time else [],
        )
        declare_parameters(self._ros, config)
        doc = ParameterDescriptor(description=AUTOSTART_DOC, read_only=True)
        self._autostart = bool(self._ros.declare_parameter(AUTOSTART, True, doc).value)
        self._simulated = bool(self._ros.get_parameter("use_sim_time").value)
        self._clock = node_clock(self._ros, simulated=self._simulated)
        self._error: SocialbotError | None = None
        self._publications: dict[str, tuple[Publisher, Sender]] = {}
        self._health_publications: list[tuple[Publisher, Sender]] = []
        self._connections: list[Connection] = []
        self._latched: dict[Input[Any], Message] = {}
        self._early: deque[tuple[Input[Any], Message]] = deque(maxlen=QUEUE_DEPTH[Delivery.EVERY])
        self._thread: NodeThread | None = None
        self._unwatch: Callable[[], None] | None = None
        if self._simulated:
            every_step = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None, on_clock_change=True)
            self._jumps = self._ros.get_clock().create_jump_callback(every_step, post_callback=self._time_changed)
            self._kept_publisher = self._ros.create_publisher(Header, KEPT_TOPIC, publisher_qos(Delivery.EVERY))
        self._reporter = DiagnosticsReporter(
            self._ros, self.statistics, self._connections, self._inputs, lambda: self._ros.state
        )
        if sealed:
            self._renewal = self._ros.create_timer(
                self._transport.renewal_s, lambda: self._transport.renew(), clock=STEADY
            )
        if supervisor is not None:
            self._heartbeat = self._ros.create_timer(HEARTBEAT_S, self._beat, clock=STEADY)

    @property
    def ros_node(self) -> RosNode:
        """The rclpy node, for an executor."""
        return self._ros

    @property
    def node(self) -> Node:
        """The current node. Raises NodeError when it is not configured."""
        if self._thread is None:
            raise NodeError(f"the node is {self._ros.state}", where=self.name)
        return self._thread.node

    @property
    def active_thread(self) -> NodeThread | None:
        """Thread of the node while it is active."""
        thread = self._thread
        return thread if thread is not None and thread.started else None

    @property
    def failure(self) -> SocialbotError | None:
        return self._error or (None if self._thread is None else self._thread.failure)

    @property
    def ended(self) -> bool:
        """Whether the node failed to start or was shut down."""
        return self.failure is not None or self._ros.state == FINALIZED

    def start(self) -> None:
        """Configure and activate the node, unless a supervisor or lifecycle tool does."""
        if self._supervisor is not None:
            self.transition_to(INACTIVE)
            self._beat()
        elif self._autostart:
            self.transition_to(ACTIVE)

    def transition_to(self, state: str) -> None:
        """Bring the node to a lifecycle state; set `failure` on error."""
        if not self._ros.transition_to(state) and self._ros.error is not None:
            self._error = start_failure(self.name, self._ros.error)

    def stop(self) -> None:
        """Stop the node, and remove it from the ROS graph."""
        self._intra_process.remove(self)
        if self._thread is not None:
            self._thread.stop()
        self._ros.destroy_node()

    def configure(self) -> None:
        """Build the node and its publishers and subscriptions."""
        self._build()
        for topic in health_topics(self._graph, self.name):
            self._health_publications.append(self._publication(topic, Health, Delivery.EVERY))
        for topic, port in self._config.publications:
            publication = self._publication(topic, port.message_type, port.delivery)
            self._publications[port.name] = publication
            self._connections.append(publisher_connection(self._graph, topic, publication[0]))
        for topic, port in self._config.subscriptions:
            kind = self._transport.message_class(port.message_type)
            qos = subscription_qos(port.delivery, outside=topic in self._graph.inputs)
            name = self._ros.resolve_topic_name(topic)
            receiver = self._transport.receiver(name, latched=port.delivery is Delivery.LATCHED)
            receive = functools.partial(self._receive, port, receiver)
            subscription = self._ros.create_subscription(kind, topic, receive, qos)
            self._connections.append(subscription_connection(self._graph, topic, subscription))
            self._intra_process.add(name, self, port)

    def activate(self) -> None:
        """Start the node with the latched messages and those received while inactive."""
        thread = self._thread or self._build()
        for port, message in (*self._latched.items(), *self._early):
            thread.queue.put(port, message)
        self._early.clear()
        thread.start()

    def deactivate(self) -> None:
        if self._thread is not None:
            self._thread.stop()
        self._forget_thread()

    def clean_up(self) -> None:
        """Destroy the publishers and subscriptions."""
        self._forget_thread()
        self._intra_process.remove(self)
        for connection in self._connections:
            if not isinstance(connection.endpoint, Publisher):
                self._ros.destroy_subscription(connection.endpoint)
        for publisher, _ in (*self._publications.values(), *self._health_publications):
            self._ros.destroy_publisher(publisher)
        self._health_publications.clear()
        self._connections.clear()
        self._publications.clear()
        self._latched.clear()
        self._transport = open_transport(form=self._graph.wire)

    def _publication(self, topic: str, kind: type[Message], delivery: Delivery) -> tuple[Publisher, Sender]:
        publisher = self._ros.create_publisher(self._transport.message_class(kind), topic, publisher_qos(delivery))
        return publisher, self._transport.sender(publisher, latched=delivery is Delivery.LATCHED)

    def _build(self) -> NodeThread:
        thread = self._thread = NodeThread(
            self._config,
            parameter_values(self._ros, self._config),
            clock=self._clock,
            simulated=self._simulated,
            publish=self._publish,
            connections=self._connections,
            statistics=self.statistics,
            publish_health=self._publish_health,
            on_alive=self._report_active,
        )
        self._unwatch = watch_parameters(self._ros, thread.node, thread.call)
        return thread

    def _forget_thread(self) -> None:
        self._thread = None
        self._early.clear()
        if self._unwatch is not None:
            self._unwatch()
            self._unwatch = None

    def _publish(self, port: Output[Any], message: Message) -> None:
        publisher, sender = self._publications[port.name]
        if port.delivery is Delivery.LATCHED or not self._intra_process.deliver(publisher, message):
            sender.publish(message)

    def _receive(self, port: Input[Any], receiver: Receiver, ros_message: Any) -> None:
        try:
            message = receiver.decode(port.message_type, ros_message, stamp=self._clock.now())
        except MessageError as error:
            reason = refusal_reason(error)
            self.statistics.refusals[reason] += 1
            log_failure(self.name, f"refused a message on {port.topic}", error, self.statistics.refusals[reason])
            return
        if message is None:
            return
        if port.delivery is Delivery.LATCHED:
            self._latched[port] = message
        if self._thread is not None and self._thread.started:
            self._thread.queue.put(port, message)
        elif self._thread is not None and port.delivery is Delivery.EVERY:
            self._early.append((port, message))

    def _time_changed(self, _: TimeJump) -> None:
        if self._thread is None:
            return
        self._thread.queue.time_changed()
        if self._kept_publisher.get_subscription_count():
            # Timers that are due now, and work in the background, come first: simulated time waits for them.
            self._thread.queue.call_when_idle(functools.partial(self._publish_kept, self._clock.now()))

    def _publish_kept(self, time: int) -> None:
        """Report to the simulation clock that the work up to ``time`` (ns) is done."""
        header = Header(frame_id=self.name)
        header.stamp.sec, header.stamp.nanosec = divmod(time, SECOND)
        self._kept_publisher.publish(header)

    def _publish_health(self, health: Health) -> None:
        for publisher, sender in self._health_publications:
            if publisher.get_subscription_count():
                sender.publish(health)

    def _inputs(self) -> Any:
        return self._thread.queue.inputs if self._thread is not None else ()

    def _beat(self) -> None:
        if self._thread is not None and self._thread.started:
            self._thread.check_alive()
        elif self._supervisor is not None:
            self._supervisor.send(self.name, self._ros.state)

    def _report_active(self) -> None:
        if self._supervisor is not None:
            self._supervisor.send(self.name, ACTIVE)
