"""Observe a running graph: its messages, node statistics and connections."""

from __future__ import annotations

import functools
import os
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from socialbot.bridge.diagnostics import (
    DIAGNOSTICS_TOPIC,
    UNCONNECTED,
    Connection,
    DiagnosticsSubscriber,
    OnStatus,
    subscription_connection,
    unconnected,
)
from socialbot.bridge.discovery import readable
from socialbot.bridge.environment import BLOCKED_S, free_domain, ros_domain, spinning_node, steady_timer, wait_for
from socialbot.bridge.qos import observer_qos
from socialbot.bridge.run_announcer import locked_runs
from socialbot.bridge.transport import Subscription, open_transport
from socialbot.core.clock import Clock, WallClock
from socialbot.core.errors import NodeError
from socialbot.core.messages import Message
from socialbot.graph.health import publishers
from socialbot.graph.node import Graph, WireForm

POLL_S = 0.02
SPIN_PERIOD_S = 0.5
DISCOVERY_S = 0.8
LOST_CHECK_S = 1.0
STATUS_PERIOD_S = 2.5  # maximum time between two statuses of a live node


class LatestStatistics:
    """Latest statistics of each node of ``graph``, from /diagnostics."""

    def __init__(self, graph: Graph) -> None:
        self._names = {config.name for config in graph.nodes}
        self.latest: dict[str, dict[str, str]] = {}

    def note(self, name: str, values: dict[str, str]) -> None:
        """Store the statistics of one node; ignore other programs."""
        if name in self._names:
            self.latest[name] = values


class SpinWatch:
    """Watch over the thread that spins the rclpy node ``ros``, which one false RTPS packet can block without end."""

    def __init__(self, ros: Any, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._checked = clock()
        self._silent_s = 0.0
        self._timer = steady_timer(ros, SPIN_PERIOD_S, self._spins)

    def is_blocked(self) -> bool:
        """Whether the thread has not answered for `BLOCKED_S`. Call it often: of a longer pause, a second counts."""
        before, self._checked = self._checked, self._clock()
        self._silent_s += min(self._checked - before, 1.0)
        return self._silent_s >= BLOCKED_S

    def _spins(self) -> None:
        self._silent_s = 0.0


class LostWatch:
    """Watch over ``observer``: how many publishers of ``graph`` it has ``lost``, by topic; see `Listener.lost`."""

    def __init__(self, observer: GraphObserver, graph: Graph) -> None:
        self.lost: Mapping[str, int] = {}
        self._expected = [
            (topic, len(publishers(graph, topic)), each.listener) for topic, each in observer.subscriptions.items()
        ]
        self._expected.append((DIAGNOSTICS_TOPIC, len(graph.nodes), observer.diagnostics.listener))
        self._timer = steady_timer(observer.ros, LOST_CHECK_S, self._check)

    def _check(self) -> None:
        self.lost = {
            topic: lost
            for topic, wanted, listener in self._expected
            if listener is not None and (lost := listener.lost(wanted))
        }


@dataclass(frozen=True)
class GraphObserver:
    """Observing rclpy node, its subscriptions by topic, and that to /diagnostics."""

    ros: Any
    subscriptions: Mapping[str, Subscription[Any]]
    diagnostics: DiagnosticsSubscriber

    def connections(self, graph: Graph, nodes: Collection[str] | None = None) -> list[Connection]:
        return [subscription_connection(graph, topic, one.endpoint, nodes) for topic, one in self.subscriptions.items()]


@contextmanager
def observe_graph(
    topics: Mapping[str, type[Message]],
    observe: Callable[[str, Message], None],
    on_status: OnStatus,
    form: WireForm = "json",
    *,
    latched: Collection[str] = (),
    name: str = "observer",
    clock: Clock | None = None,
) -> Iterator[GraphObserver]:
    """Observe a graph inside the block; one thread calls ``observe`` and ``on_status``.

    The last message of ``latched`` topics is also received if older than the observer. Messages without a stamp get
    the time of ``clock``, by default that of a live graph. Raises InstallationError when ROS, or the message package
    for this ``form``, is not installed.
    """
    now = (clock or WallClock()).now
    with spinning_node(name) as ros:
        transport = open_transport(form=form)
        subscriptions = {}
        for topic, kind in topics.items():
            take, late = functools.partial(observe, topic), topic in latched
            qos = observer_qos(latched=late)
            subscriptions[topic] = transport.subscribe(ros, topic, kind, take, qos=qos, latched=late, now=now)
        yield GraphObserver(ros, subscriptions, DiagnosticsSubscriber(ros, on_status))


def await_graph(
    ros: Any,
    graph: Graph,
    own: list[Connection] | None = None,
    *,
    timeout_s: float,
    ended: Callable[[], bool] = lambda: False,
) -> list[str]:
    """Wait until all nodes of ``graph``, and the ``own`` connections, are connected.

    Returns:
        The missing connections at the timeout, or when ``ended``: such as "head: /head/command".
    """
    lacking = {config.name: "everything" for config in graph.nodes}

    def note(name: str, values: Mapping[str, str]) -> None:
        if UNCONNECTED in values and name in lacking:
            lacking[name] = values[UNCONNECTED]

    DiagnosticsSubscriber(ros, note)

    def missing() -> list[str]:
        both = {**lacking, ros.get_name(): unconnected(own or [])}
        return [f"{name}: {topics}" for name, topics in both.items() if topics]

    wait_for(lambda: not missing(), timeout_s, ended)
    return missing()


def not_connected(missing: Iterable[str], timeout_s: float) -> NodeError:
    """Error for a graph with ``missing`` connections after ``timeout_s``."""
    return NodeError(
        f"the graph is not connected after {timeout_s:.0f} s; missing: {'; '.join(missing)}",
        remedy="read the nodes' logs in the folder of the run; `socialbot doctor` checks the installation",
    )


def expect_free_names(ros: Any, graph: Graph, only: Collection[str] | None = None) -> None:
    """Raise NodeError if another node in this ROS domain has a name from ``graph``, or ``only`` from these names.

    A killed node stays discovered for a while, so only names on /diagnostics count. If keys are set, their status needs
    a valid seal, so that an intruder cannot block the start.
    """
    names = {config.name for config in graph.nodes if only is None or config.name in only}
    others = {run: pid for run, pid in locked_runs().items() if pid != os.getpid()}
    alive: set[str] = set()

    def note(name: str, _: Mapping[str, str]) -> None:
        alive.add(name)

    subscriber = DiagnosticsSubscriber(ros, note)
    begun = time.monotonic()
    wait_s = DISCOVERY_S
    while time.monotonic() - begun < wait_s:
        found = readable(ros.get_node_names)
        known = names if found is None else names.intersection(found)
        if taken := known & alive:
            here = ", ".join(f"process {pid}" for pid in sorted(others.values()))
            raise NodeError(
                f"nodes with these names are running already: {', '.join(sorted(taken))}"
                + (f"; `up` runs here: {here}" if here else ""),
                where=f"ROS domain {ros_domain()}",
                remedy=f"stop them, or write ROS_DOMAIN_ID={free_domain()} before the command",
            )
        wait_s = STATUS_PERIOD_S if known else DISCOVERY_S
        time.sleep(POLL_S)
    subscriber.destroy(ros)
