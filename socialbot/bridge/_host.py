"""Host of one node in rclpy: topics, parameters, time, lifecycle and thread.

The executor thread only receives messages. A slow node runs in its own thread, so it delays neither parameters nor
time, and always gets the newest message of a stream.
"""

from __future__ import annotations

import functools
import time
import uuid
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Any

import msgspec
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import JumpThreshold, TimeJump
from rclpy.context import Context as RosContext
from rclpy.duration import Duration
from rclpy.node import Node as RosNode
from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock as RosClock
from std_msgs.msg import String

from socialbot.bridge import discovery
from socialbot.bridge._callback_queue import IdleState
from socialbot.bridge._lifecycle import (
    ACTIVE,
    FINALIZED,
    INACTIVE,
    LifecycleHost,
    declare_parameters,
    parameter_values,
    watch_parameters,
)
from socialbot.bridge._node_thread import NodeThread, log_failure, report_start_failure
from socialbot.bridge._services import HostedServices
from socialbot.bridge.diagnostics import (
    Connection,
    DiagnosticsReporter,
    NodeStatistics,
    listener_connections,
    sender_connections,
)
from socialbot.bridge.environment import steady_timer
from socialbot.bridge.qos import QUEUE_DEPTH, subscription_qos
from socialbot.bridge.sim_clock import CLOCK_TOPIC, KEPT_TOPIC, ROUND_TOPIC, Round, StepReport
from socialbot.bridge.transport import Listener, Receiver, Sender, Transport, open_transport, refusal_reason
from socialbot.core.clock import SECOND, Clock, ForwardClock, WallClock
from socialbot.core.errors import InstallationError, MessageError, NodeError, SocialbotError
from socialbot.core.messages import Health, JointTrajectory, Message, Structured, Transforms
from socialbot.graph.health import health_topics, publishers
from socialbot.graph.node import Graph, Node, NodeConfig
from socialbot.graph.ports import Delivery, Input, Output

if TYPE_CHECKING:
    from socialbot.bridge.process import SupervisorChannel

MOST_TYPES = 3  # types of a topic that are named
OUTSIDE_S = 2.0  # period of the look at publishers outside the graph
HEARTBEAT_S = 0.5  # period of the state reports to a supervisor
LAST_MESSAGES_S = 1.0  # longest time that the end of a node waits for the delivery of its last messages
DDS_HOLD_S = 1.0  # time to keep a topic on DDS after its last outside subscriber, so that messages stay in order


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

    def deliver(self, publisher: Publisher, message: Message, number: int) -> bool:
        """Deliver ``message``, the ``number``th, to all subscribers; return False if DDS has to deliver it."""
        topic = publisher.topic_name
        targets = self._targets.get(topic, ())
        active = [host for host, port in targets if host.active_thread and isinstance(message, port.message_type)]
        now = time.monotonic()
        if len(active) < len(targets) or publisher.get_subscription_count() != len(active):
            self._dds_until[topic] = now + DDS_HOLD_S
            return False
        if now < self._dds_until.get(topic, 0.0):
            return False
        for host, port in targets:
            host.put(port, message, number)
        return True


class NodeHost:
    """Host of a node as a ROS 2 lifecycle node.

    Configuration builds the node, activation starts it, and deactivation stops it. The next activation builds another.

    With ``sim_time`` the time comes from /clock. A ``supervisor`` commands activation, and receives the state.
    """

    def __init__(
        self,
        graph: Graph,
        config: NodeConfig,
        *,
        ros_context: RosContext,
        sim_time: bool,
        supervisor: SupervisorChannel | None = None,
        intra_process: IntraProcess | None = None,
    ) -> None:
        self.name = config.name
        self.statistics = NodeStatistics()
        self._graph = graph
        self._config = config
        self._supervisor = supervisor
        self._intra_process = intra_process or IntraProcess()
        self._is_finished = False
        self._transport = self._open_transport()
        self._clock_transport = open_transport()
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
        doc = ParameterDescriptor(description="whether the node configures and activates itself", read_only=True)
        self._autostart = bool(self._ros.declare_parameter("autostart", True, doc).value)
        self._simulated = bool(self._ros.get_parameter("use_sim_time").value)
        ros_clock = self._ros.get_clock()
        # Neither clock goes back when the system time is set.
        self._clock: Clock = ForwardClock(lambda: ros_clock.now().nanoseconds) if self._simulated else WallClock()
        self._error: SocialbotError | None = None
        self._senders: dict[str, Sender] = {}
        """Senders by output; with one topic per receiver, by topic."""
        self._health_senders: list[Sender] = []
        self._connections: list[Connection] = []
        self._listeners: list[Listener] = []
        self._expected: list[tuple[str, int, Listener]] = []
        """Topic of each listener, and the number of publishers in the graph."""
        self._lost: dict[str, int] = {}
        """Number of lost publishers by topic."""
        self._latched: dict[Input[Any], Message] = {}
        self._ports = list(config.type.inputs())
        self._reliable: dict[Input[Any], str] = {}
        """Topics of inputs that get every message."""
        self._outside: dict[Input[Any], tuple[str, str, QoSProfile]] = {}
        """Topic, ROS type and quality of service of the inputs from outside."""
        self._mismatches: dict[Input[Any], str] = {}
        self._outside_pace = discovery.Pace()
        self._outside_timer = steady_timer(self._ros, OUTSIDE_S, self._check_outside)
        self._early: deque[tuple[Input[Any], Message]] = deque(maxlen=QUEUE_DEPTH[Delivery.EVERY])
        self._thread: NodeThread | None = None
        self._services = HostedServices(self._ros, config, lambda: self.active_thread, self._transport)
        self._unwatch: Callable[[], None] | None = None
        if self._simulated:
            every_step = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None, on_clock_change=True)
            self._jumps = ros_clock.create_jump_callback(every_step, post_callback=self._time_changed)
            self._time = self._listen_to_clock() if sealed else None
            self._reports = self._clock_transport.advertise(self._ros, KEPT_TOPIC, Structured, Delivery.LATCHED)
            receiver = self._clock_transport.receiver(ROUND_TOPIC, latched=True)
            self._rounds = self._ros.create_subscription(
                String, ROUND_TOPIC, functools.partial(self._start_round, receiver), subscription_qos(Delivery.LATCHED)
            )
            self._has_rounds = False
        self._instance = uuid.uuid4().hex
        self._sent: Counter[str] = Counter()
        self._passed_over: Counter[Input[Any]] = Counter()
        """Number of received messages that did not reach the present node."""
        self._reporter = DiagnosticsReporter(
            self._ros,
            self.statistics,
            self._connections,
            self._inputs,
            lambda: self._ros.state,
            lambda: None if self._thread is None else self._thread.health,
        )
        if supervisor is not None:
            self._heartbeat = steady_timer(self._ros, HEARTBEAT_S, self._beat)

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
            self._error = report_start_failure(self.name, self._ros.error)

    def stop(self) -> None:
        """Stop the node, and remove it from the ROS graph."""
        self.finish()
        self._services.close()  # rclpy destroys no actions, and they would keep the node
        self._ros.destroy_node()

    def finish(self) -> None:
        """Stop the node; it stays in the ROS graph until `stop`."""
        if self._is_finished:
            return
        self._is_finished = True
        self._outside_timer.cancel()
        self._intra_process.remove(self)
        before = Counter(self._sent)
        if self._thread is not None:
            self._thread.stop()
        self._services.cancel_goals()
        self._await_last_messages(before)
        self._services.await_cancels()

    def _await_last_messages(self, before: Counter[str]) -> None:
        """Wait a moment until subscribers have what the node published at its end, such as the stop of an actuator."""
        end = time.monotonic() + LAST_MESSAGES_S
        for sender in self._senders.values():
            publisher = sender.publisher
            left_s = end - time.monotonic()
            if left_s > 0 and self._sent[publisher.topic_name] > before[publisher.topic_name]:
                publisher.wait_for_all_acked(Duration(nanoseconds=int(left_s * SECOND)))

    def configure(self) -> None:
        """Build the node and its publishers and subscriptions."""
        self._build()
        for topic in health_topics(self._graph, self.name):
            self._health_senders.append(self._transport.advertise(self._ros, topic, Health))
        for topic, port in self._config.publications:
            self._connections += sender_connections(self._graph, topic, self._advertise(topic, port))
        for topic, port in self._config.subscriptions:
            # /tf_static is latched by every driver; other sensors may be volatile.
            outside = topic in self._graph.inputs or (port.optional and port.message_type is not Transforms)
            qos = subscription_qos(port.delivery, outside=outside)
            name = self._ros.resolve_topic_name(topic)
            try:
                listener = self._transport.listen(
                    self._ros,
                    name,
                    port.message_type,
                    functools.partial(self._receive, port),
                    functools.partial(self._refuse, port),
                    qos=qos,
                    latched=port.delivery is Delivery.LATCHED,
                    now=self._clock.now,
                )
            except InstallationError as error:
                if not port.optional:
                    raise
                self._ros.get_logger().info(f"the input {port.name} is not used: {error.what}")
                continue
            self._listeners.append(listener)
            self._expected.append((topic, len(publishers(self._graph, topic)), listener))
            self._connections += listener_connections(self._graph, topic, listener)
            if outside:
                ros_class = self._transport.message_class(port.message_type)
                package = ros_class.__module__.partition(".")[0]
                self._outside[port] = name, f"{package}/msg/{ros_class.__name__}", qos
            self._intra_process.add(name, self, port)
            if qos.reliability is ReliabilityPolicy.RELIABLE:
                self._reliable[port] = name
        self._services.open()

    def _advertise(self, topic: str, port: Output[Any]) -> Sender:
        key = topic if port.addressed_by else port.name
        sender = self._senders[key] = self._transport.advertise(self._ros, topic, port.message_type, port.delivery)
        return sender

    def activate(self) -> None:
        """Start the node with the latched messages and those received while inactive."""
        thread = self._thread or self._build()
        for port, message in (*self._latched.items(), *self._early):
            thread.queue.put(port, message)
        self._early.clear()
        thread.start()

    def deactivate(self) -> None:
        self._services.stop_goals()
        if self._thread is not None:
            self._thread.stop()
        self._services.cancel_goals()
        self._forget_thread()

    def clean_up(self) -> None:
        """Destroy the publishers and subscriptions."""
        self._forget_thread()
        self._services.close()
        self._intra_process.remove(self)
        for endpoint in (*self._listeners, *self._senders.values(), *self._health_senders):
            endpoint.destroy(self._ros)
        for kept in (
            self._health_senders,
            self._listeners,
            self._expected,
            self._connections,
            self._senders,
            self._latched,
            self._outside,
            self._mismatches,
            self._reliable,
        ):
            kept.clear()
        self._transport.end_renewal()
        self._transport = self._open_transport()

    def _open_transport(self) -> Transport:
        transport = open_transport(form=self._graph.wire)
        transport.resubscribed = self.statistics.resubscribed
        return transport

    def _build(self) -> NodeThread:
        thread = self._thread = NodeThread(
            self._config,
            parameter_values(self._ros, self._config),
            clock=self._clock,
            simulated=self._simulated,
            on_idle=self._report_idle if self._simulated else None,
            publish=self._publish,
            channel=self._services.channel,
            connections=self._connections,
            statistics=self.statistics,
            publish_health=self._publish_health,
            on_alive=self._report_active,
        )
        self._unwatch = watch_parameters(self._ros, thread.node, thread.call)
        return thread

    def _forget_thread(self) -> None:
        self._passed_over.update(port for port, _ in self._early)
        self._passed_over.update({queue.port: queue.arrived for queue in self._inputs()})
        self._thread = None
        self._early.clear()
        if self._unwatch is not None:
            self._unwatch()
            self._unwatch = None

    def _publish(self, port: Output[Any], message: Message) -> None:
        sender = self._senders[port.name] if not port.addressed_by else self._sender_to(port, message)
        topic = sender.publisher.topic_name
        number = self._sent[topic] + 1
        on_dds = port.delivery is Delivery.LATCHED or sender.drivers is not None
        if on_dds or not self._intra_process.deliver(sender.publisher, message, number):
            sender.publish(self._at_once(message))
        self._sent[topic] = number

    def _at_once(self, message: Message) -> Message:
        """Remove the stamp of a motion in real time, so that the controller begins it when it arrives.

        A controller whose clock differs would refuse a motion that ends in its past, and wait for one in its future.
        """
        if isinstance(message, JointTrajectory) and not self._simulated:
            return msgspec.structs.replace(message, stamp=0)
        return message

    def _sender_to(self, port: Output[Any], message: Message) -> Sender:
        """The sender on the topic of the receiver of ``message``, which may be outside the graph."""
        topic = self._config.topic(port, port.receiver(message))
        return self._senders.get(topic) or self._advertise(topic, port)

    def put(self, port: Input[Any], message: Message, number: int) -> None:
        """Pass a message to the active node: at once, or in the next round of a simulation clock."""
        if (thread := self.active_thread) is not None:
            # The declared order of inputs comes first, then that of each publisher.
            thread.queue.put(port, message, (self._ports.index(port.name), number) if self._is_stepped() else None)

    def _is_stepped(self) -> bool:
        """Whether a simulation clock says when messages are handled. A publisher without valid rounds is none."""
        return self._simulated and self._has_rounds and self._rounds.get_publisher_count() > 0

    def _refuse(self, port: Input[Any], error: MessageError) -> None:
        self._count_refusal(port.topic, error)
        self._pass_over(port)

    def _count_refusal(self, topic: str, error: MessageError) -> None:
        reason = refusal_reason(error)
        self.statistics.refusals[reason] += 1
        log_failure(self.name, f"refused a message on {topic}", error, self.statistics.refusals[reason])

    def _check_outside(self) -> None:
        if not self._outside_pace.is_due:
            return
        with self._outside_pace.looking():
            found = {port: discovery.publishers(self._ros, topic) for port, (topic, _, _) in self._outside.items()}
        for port, (topic, kind, qos) in self._outside.items():
            reason = _mismatch(found[port], topic, kind, qos, port.name)
            if reason != self._mismatches.get(port, "") and self._thread is not None:
                self._mismatches[port] = reason
                self._thread.note_mismatch(port, reason)

    def _receive(self, port: Input[Any], message: Message, info: Any) -> None:
        if port.delivery is Delivery.LATCHED:
            self._latched[port] = message
        if self.active_thread is not None:
            self.put(port, message, info["publication_sequence_number"])
        elif self._thread is not None and port.delivery is Delivery.EVERY:
            self._early.append((port, message))
        else:
            self._pass_over(port)

    def _pass_over(self, port: Input[Any]) -> None:
        self._passed_over[port] += 1
        if self._thread is not None:
            self._thread.queue.recheck()

    def _time_changed(self, _: TimeJump) -> None:
        if self._thread is not None:
            self._thread.queue.recheck()

    def _listen_to_clock(self) -> Listener:
        """Subscribe to /clock with seals, in place of the subscription of rclpy."""
        source = self._ros._time_source
        if source._clock_sub is not None:
            self._ros.destroy_subscription(source._clock_sub)

        def take(cdr: bytes, _: Any) -> None:
            source.clock_callback(deserialize_message(cdr, RosClock))

        qos = subscription_qos(Delivery.NEWEST)
        refuse = functools.partial(self._count_refusal, CLOCK_TOPIC)
        listener = self._clock_transport.listen_bytes(self._ros, CLOCK_TOPIC, RosClock, take, refuse, qos=qos)
        source._clock_sub = listener.endpoint
        return listener

    def _start_round(self, receiver: Receiver, message: String) -> None:
        try:
            opened = receiver.open(message)
            if opened is None:
                return
            round = Round.decode(opened.data)
        except MessageError as error:
            self._count_refusal(ROUND_TOPIC, error)
            return
        self._has_rounds = True
        if self._thread is not None:
            self._thread.queue.release(round.number, round.repeat, arrived=round.arrived.get(self.name))
        if self._thread is None or self._clock.now() == 0:
            # The thread does not work yet. The clock starts when it knows of all nodes.
            self._publish_report(IdleState(0, {}, 0, 0, round.repeat))

    def _report_idle(self, idle: IdleState) -> None:
        if self._is_stepped():
            self._publish_report(idle)

    def _publish_report(self, idle: IdleState) -> None:
        """Report to the simulation clock that the work of a step is done, as far as messages have arrived."""
        taken: dict[str, int] = {}
        for port, topic in self._reliable.items():
            count = self._passed_over[port] + idle.arrived.get(port, 0)
            taken[topic] = min(count, taken.get(topic, count))
        report = StepReport(
            self.name, self._instance, idle.time, self._sent, taken, idle.held, idle.round, idle.repeat, idle.total
        )
        self._reports.forward(String(data=report.encode()))

    def _publish_health(self, health: Health, to_all: bool) -> None:
        # The first topic is that of all nodes.
        for sender in self._health_senders[0 if to_all else 1 :]:
            if sender.publisher.get_subscription_count():
                sender.publish(health)
                self._sent[sender.publisher.topic_name] += 1

    def _inputs(self) -> Any:
        return self._thread.queue.inputs if self._thread is not None else ()

    def _beat(self) -> None:
        self._lost = {topic: lost for topic, wanted, one in self._expected if (lost := one.lost(wanted))}
        if (thread := self.active_thread) is not None:
            thread.check_alive()
        elif self._supervisor is not None:
            self._supervisor.send(self.name, self._ros.state)

    def _report_active(self) -> None:
        if self._supervisor is not None:
            self._supervisor.send(self.name, ACTIVE, self._lost)


def _mismatch(found: Collection[Any], topic: str, kind: str, qos: QoSProfile, port: str) -> str:
    """Return the reason why none of the publishers ``found`` matches an input; empty if one does, or there is none."""
    fitting = [each for each in found if each.topic_type == kind]
    if found and not fitting:
        kinds = sorted({each.topic_type for each in found})
        return f"{topic} is {', '.join(kinds[:MOST_TYPES])}, not {kind}"
    weak = [each for each in fitting if each.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT]
    if fitting and weak == fitting and qos.reliability is ReliabilityPolicy.RELIABLE:
        return f"the publisher of {topic} is best effort: nothing arrives; give the input {port} Delivery.NEWEST"
    return ""
