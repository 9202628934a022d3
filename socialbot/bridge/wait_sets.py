"""An executor of rclpy nodes for a single thread, which keeps its wait set.

rclpy makes a wait set for each message, with all entities of its nodes and two event handlers of each publisher and
subscription, and a task for each callback. It then wakes itself, for other threads that may wait. Here a wait set is
kept until entities are created or destroyed, and messages and timers call their callbacks directly.

Messages are taken as bytes. Fast DDS 2.14 can free a message in the queue of a reliable subscription: a GAP about a
message of which only parts have come removes it from one of two lists. Reading it never ends. Its bytes are empty.
"""

from __future__ import annotations

import inspect
import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable
from contextlib import ExitStack
from typing import Any
from weakref import WeakKeyDictionary

from rclpy.event_handler import EventHandler, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor, TimeoutObject
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.utilities import timeout_sec_to_nsec

from socialbot.bridge._endpoints import is_power_of_ten
from socialbot.bridge.packet_filter import protect_names

log = logging.getLogger("socialbot.security")

POLL_PERIOD_S = 1.0
"""Shortest time (s) between two looks for QoS events, which are rare, for instance an incompatible QoS."""

REPLACEMENT_S = 6.0
"""Shortest time (s) between two replacements of a damaged subscription, which strangers can cause."""

KEPT_SAMPLES = 1000
"""Latched messages of a subscription that are known again after its replacement."""

DAMAGED_PAUSE_S = 0.002
"""Pause (s) after each empty message until the replacement: DDS returns it at once, again and again."""

EVENT_PAUSE_S = 0.005
"""Pause (s) after a wait that ends although nothing is ready: a QoS event ends each one at once until the next look."""

RESUMED_S = 0.1
"""Longest time (s) until a suspended coroutine goes on, if what it awaits has ended in another thread."""

TRANSIENT_LOCAL = DurabilityPolicy.TRANSIENT_LOCAL

KINDS = {
    "timer": "timers",
    "subscription": "subscriptions",
    "guard_condition": "guards",
    "client": "clients",
    "service": "services",
}
"""Kinds of entities as a wait set names them, and as a node does."""


_RESUMED_NS = round(RESUMED_S * 1e9)

_Sample = tuple[int, int]
"""Time (ns) and number of a message, both by its publisher."""

_Ready = tuple[str, Any, Any]
"""Kind, entity and node; a task has the kind ``task`` and may have no node."""


class _WaitSet:
    """Entities of nodes in a wait set of rcl. Their handles stay valid until `close`, also if they are destroyed.

    Args:
        nodes: The nodes.
        guards: Guard conditions that only wake the thread.
        context: The context of the wait set.
        of_events: Whether it has the handlers of QoS events and nothing else, or all but them.
    """

    def __init__(self, nodes: Collection[Node], guards: Iterable[Any], context: Any, *, of_events: bool) -> None:
        self.nodes = frozenset(nodes)
        self._opened = ExitStack()
        self._entities: dict[str, dict[int, tuple[Any, Node]]] = {}
        for kind, name in KINDS.items():
            each = ((entity, node) for node in nodes for entity in getattr(node, name) if not of_events)
            self._entities[kind] = {one.handle.pointer: (one, node) for one, node in each if self._holds(one.handle)}
        self._waitables = [
            (waitable, node)
            for node in nodes
            for waitable in node.waitables
            if isinstance(waitable, EventHandler) == of_events and self._holds(waitable)
        ]
        wakes = [guard.handle for guard in guards if self._holds(guard.handle)]
        inner = [waitable.get_num_entities() for waitable, _ in self._waitables]
        self._waits = waits = _rclpy.WaitSet(
            len(self._entities["subscription"]) + sum(each.num_subscriptions for each in inner),
            len(self._entities["guard_condition"]) + len(wakes) + sum(each.num_guard_conditions for each in inner),
            len(self._entities["timer"]) + sum(each.num_timers for each in inner),
            len(self._entities["client"]) + sum(each.num_clients for each in inner),
            len(self._entities["service"]) + sum(each.num_services for each in inner),
            sum(each.num_events for each in inner),
            context.handle,
        )
        # A wait removes the entities that are not ready, so all are added again before the next one.
        self._adds: list[tuple[Callable[[Any], object], Any]] = [
            (getattr(waits, f"add_{kind}"), entity.handle)
            for kind, entities in self._entities.items()
            for entity, _ in entities.values()
        ]
        self._adds += [(waits.add_guard_condition, handle) for handle in wakes]
        self._adds += [(waitable.add_to_wait_set, waits) for waitable, _ in self._waitables]
        for guard, _ in self._entities["guard_condition"].values():
            if guard._executor_triggered:  # taken by rcl, but its callback was not called
                guard.trigger()

    def _holds(self, handle: Any) -> bool:
        try:
            self._opened.enter_context(handle)
        except InvalidHandle:  # it was destroyed
            return False
        return True

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to wait for."""
        return not self._adds

    def close(self) -> None:
        """Let go of the entities."""
        self._opened.close()

    def wait(self, timeout_ns: int) -> None:
        """Wait until an entity is ready, or for ``timeout_ns``; negative: without limit."""
        self._waits.clear_entities()
        for add, entity in self._adds:
            add(entity)
        self._waits.wait(timeout_ns)

    def ready(self) -> list[_Ready]:
        """Kind, entity and node of all that were ready at the end of the last `wait`."""
        found: list[_Ready] = [("waitable", *each) for each in self._waitables if each[0].is_ready(self._waits)]
        for kind, entities in self._entities.items():
            if entities:
                pointers = self._waits.get_ready_entities(kind)
                found += [(kind, *entities[pointer]) for pointer in pointers if pointer in entities]
        for kind, entity, _ in found:
            if kind == "guard_condition":
                entity._executor_triggered = True
        return found


class FilteredNode(Node):
    """rclpy node of a process whose lists of nodes get no GAP from others; see `socialbot.bridge.packet_filter`."""

    _is_filtered = False

    def create_publisher(self, *args: Any, **options: Any) -> Any:
        if not self._is_filtered:  # rclpy makes its own first publisher here, as soon as the sockets are open
            protect_names()
            self._is_filtered = True
        return super().create_publisher(*args, **options)


class OneThreadExecutor(SingleThreadedExecutor):
    """Executor that a single thread spins; others may add nodes and entities, create tasks, and shut it down.

    QoS events are handled up to `POLL_PERIOD_S` later. Callback groups have no effect, as no two callbacks run at once.

    Args:
        clock: Steady clock (s).
        options: Those of rclpy.
    """

    def __init__(self, *, clock: Callable[[], float] = time.monotonic, **options: Any) -> None:
        super().__init__(**options)
        self._steady_s = clock
        self._polled_s = clock() - POLL_PERIOD_S
        self._replaced_s: WeakKeyDictionary[Any, float] = WeakKeyDictionary()
        self._replacements = 0
        self._empty: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()
        """The last empty message of each subscription that had one, as its information."""
        self._latched: WeakKeyDictionary[Any, deque[_Sample]] = WeakKeyDictionary()
        """Messages of subscriptions that would get them again after a replacement."""
        self._spinning = 0
        self._suspended: set[Any] = set()
        """Tasks that await something."""
        self._resumed_s = time.monotonic()
        self._may_go_on = False
        """Whether something was done since, so that they may go on."""
        self._is_changed = True
        self._ready: deque[_Ready] = deque()
        self._kept: tuple[_WaitSet, _WaitSet] | None = None
        self._waiting = threading.Lock()
        guard: Any = self._guard
        trigger = guard.trigger

        def from_another_thread() -> None:
            if threading.get_ident() != self._spinning:
                trigger()

        guard.trigger = from_another_thread

    def wake(self) -> None:
        self._is_changed = True
        super().wake()
        self._close_unless_waiting()

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        is_done = super().shutdown(timeout_sec)
        self._close_unless_waiting()
        return is_done

    def _close_unless_waiting(self) -> None:
        """Let go of destroyed entities at once, for instance for a subscription of another type to the same topic."""
        if self._waiting.acquire(blocking=False):  # the thread that waits would close the wait sets afterwards
            try:
                self._close()
            finally:
                self._waiting.release()

    def _spin_once_impl(
        self, timeout_sec: float | TimeoutObject | None = None, wait_condition: Callable[[], bool] = lambda: False
    ) -> None:
        self._spinning = threading.get_ident()
        timeout_ns = timeout_sec_to_nsec(timeout_sec.timeout if isinstance(timeout_sec, TimeoutObject) else timeout_sec)
        end_ns = time.monotonic_ns() + timeout_ns
        while not self._is_shutdown and not wait_condition():
            if self._is_changed:
                self._ready.clear()  # entities may be destroyed; the next wait finds the others again
                self._may_go_on = True
            if self._ready:
                self._handle(*self._ready.popleft())
                return
            self._ready += self._unfinished()
            left_ns = timeout_ns if timeout_ns < 0 else max(0, end_ns - time.monotonic_ns())
            if self._suspended and not 0 <= left_ns < _RESUMED_NS:
                left_ns = _RESUMED_NS
            self._ready += self._wait(0 if self._ready else left_ns)
            if not self._ready and timeout_ns >= 0 and end_ns <= time.monotonic_ns():
                return
            if not (self._ready or self._is_changed) and left_ns and len(self._tasks) == len(self._suspended):
                time.sleep(EVENT_PAUSE_S)

    def _unfinished(self) -> list[_Ready]:
        if not self._tasks:
            return []
        with self._tasks_lock:
            self._tasks = [each for each in self._tasks if not each[0].done() and not each[0].cancelled()]
            found: list[_Ready] = [("task", task, node) for task, _, node in self._tasks if not task.executing()]
        self._suspended.intersection_update(task for _, task, _ in found)
        if self._may_go_on or time.monotonic() - self._resumed_s >= RESUMED_S:
            self._may_go_on, self._resumed_s = False, time.monotonic()
            return found
        return [each for each in found if each[1] not in self._suspended]

    def _wait(self, timeout_ns: int) -> list[_Ready]:
        """Wait for entities of all nodes, and look for QoS events once in `POLL_PERIOD_S`; return what is ready."""
        found: list[_Ready] = []
        with self._waiting:
            if not self._is_shutdown:
                entities, events = self._wait_sets()
                context: Any = self._context.handle
                with context:
                    now_s = self._steady_s()
                    if now_s - self._polled_s >= POLL_PERIOD_S and not events.is_empty:
                        self._polled_s = now_s
                        events.wait(0)
                        found += events.ready()
                    entities.wait(0 if found else timeout_ns)
                    found += entities.ready()
            if self._is_shutdown:
                self._close()
                return []
        if not self._context.ok():
            raise ExternalShutdownException
        return found

    def _wait_sets(self) -> tuple[_WaitSet, _WaitSet]:
        if self._is_changed or not self._kept or self._kept[0].nodes != self._nodes:
            self._is_changed = False  # before the look at the nodes: what changes later is found in the next wait
            self._close()
            nodes = self.get_nodes()
            wakes = [guard for guard in (self._guard, self._sigint_gc) if guard is not None]
            self._kept = (
                _WaitSet(nodes, wakes, self._context, of_events=False),
                _WaitSet(nodes, (), self._context, of_events=True),
            )
        return self._kept

    def _close(self) -> None:
        for each in self._kept or ():
            each.close()
        self._kept = None

    def _handle(self, kind: str, entity: Any, node: Any) -> None:
        if kind == "subscription":
            self._receive(entity, node)
        elif kind == "timer":
            self._call_timer(entity)
        else:
            # A handler of rclpy would be called again and again while another one of its callback group is suspended.
            taken = entity if kind == "task" else getattr(self, f"_take_{kind}")(entity)
            if taken is not None:
                self._run(entity if kind == "task" else self.create_task(taken))
                return
        self._may_go_on = True

    def _run(self, task: Any) -> None:
        was_suspended = task in self._suspended
        task()
        if task.done():
            self._suspended.discard(task)
        else:
            self._suspended.add(task)
        self._may_go_on |= task.done() or not was_suspended
        task.result()  # raises the exception of the callback

    def _receive(self, subscription: Any, node: Node) -> None:
        try:
            with subscription.handle:
                taken = subscription.handle.take_message(subscription.msg_type, True)
        except InvalidHandle:
            return
        if taken is None:
            return
        message, info = taken
        if not message:
            if self._empty.get(subscription) == info:  # another sender's empty message comes once
                self._replace_damaged(subscription, node)
            self._empty[subscription] = info
            return
        if subscription.qos_profile.durability is TRANSIENT_LOCAL and self._was_taken(subscription, info):
            return
        if not subscription.raw:
            try:
                message = deserialize_message(message, subscription.msg_type)
            except _rclpy.RMWError:  # it is none of the type
                return
        is_alone = subscription._callback_type is Subscription.CallbackType.MessageOnly
        self._finish(subscription.callback(message) if is_alone else subscription.callback(message, info))

    def _was_taken(self, subscription: Any, info: Any) -> bool:
        """Whether a message was taken before ``subscription`` was replaced; note it if not."""
        sample = info["source_timestamp"], info["publication_sequence_number"]
        taken = self._latched.setdefault(subscription, deque(maxlen=KEPT_SAMPLES))
        if subscription in self._replaced_s and sample in taken:
            return True
        taken.append(sample)
        return False

    def _replace_damaged(self, subscription: Any, node: Node) -> None:
        """Give ``subscription`` a new queue. Its owners keep the object."""
        now_s = self._steady_s()
        if now_s - self._replaced_s.get(subscription, -math.inf) < REPLACEMENT_S:
            time.sleep(DAMAGED_PAUSE_S)
            return
        self._replaced_s[subscription] = now_s
        self._replacements += 1
        if is_power_of_ten(self._replacements):
            text = "%s: the middleware holds an empty message in its queue; subscribed again (%d)"
            log.warning(text, subscription.topic_name, self._replacements)
        made: Any = node.create_subscription(
            subscription.msg_type,
            subscription.topic,
            subscription.callback,
            subscription.qos_profile,
            callback_group=subscription.callback_group,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=subscription.raw,
        )
        events = [
            EventHandler(
                callback_group=each.callback_group,
                callback=each.callback,
                event_type=each.event_type,
                parent_impl=made.handle,
            )
            for each in subscription.event_handlers
        ]
        for each in events:
            node.add_waitable(each)
        damaged, subscription._Subscription__subscription = subscription.handle, made.handle
        made._Subscription__subscription = damaged
        made.event_handlers, subscription.event_handlers = subscription.event_handlers, events
        node.destroy_subscription(made)

    def _call_timer(self, timer: Any) -> None:
        try:
            with timer.handle:
                if not timer.handle.is_timer_ready():  # it was cancelled
                    return
                timer.handle.call_timer()
        except InvalidHandle:
            return
        self._finish(timer.callback())

    def _finish(self, result: object) -> None:
        """Run the coroutine that a callback may have returned."""
        if inspect.iscoroutine(result):
            self.create_task(result)
