"""ROS domain of the drivers of a robot, which cannot verify seals.

A node of the graph publishes its commands for such a driver twice: sealed in the domain of the graph, and plain in the
domain of the drivers, on this machine only. The driver, bound to the loopback interface of that domain, receives the
commands of that node alone. Clients of the services and actions of drivers are in that domain only: in a
graph that is not open to the network, they get no answers of others.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from socialbot.bridge.environment import (
    DRIVERS_VARIABLE,
    HIGHEST_DOMAIN,
    SPIN_TIMEOUT_S,
    DomainNumber,
    domain_number,
    ros_domain,
    spin,
)
from socialbot.core.errors import ParameterError
from socialbot.graph.ports import TOPIC_NAME

_LOCAL = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": "", "ROS_DISCOVERY_SERVER": ""}
"""Variables of a participant that other machines neither find nor are looked for."""

CALL_S = 2.0  # longest time (s) to wait for the thread of a node

_changing = threading.Lock()


@dataclass(frozen=True)
class DriverDomain:
    """ROS domain of drivers, and the fully qualified names of their commands: topics, services and actions."""

    domain: DomainNumber
    topics: frozenset[str]

    def text(self) -> str:
        """Return the value of `DRIVERS_VARIABLE`."""
        return ":".join([str(self.domain), *sorted(self.topics)])

    def node(self, ros: Any, *publisher: Any) -> DriverNode:
        """Make a node in this domain beside the rclpy node ``ros``, with whose context it ends.

        ``publisher`` is the type, the topic and the quality of service of its publisher, if it has one.
        """
        import rclpy
        from rclpy.context import Context
        from rclpy.signals import SignalHandlerOptions

        from socialbot.bridge.wait_sets import FilteredNode

        context = Context()
        with _variables(_LOCAL):
            rclpy.init(context=context, domain_id=self.domain, signal_handler_options=SignalHandlerOptions.NO)
            node = FilteredNode(
                f"{ros.get_name()}_drivers",
                context=context,
                start_parameter_services=False,
                enable_rosout=False,
            )
        made = DriverNode(context, node, node.create_publisher(*publisher) if publisher else None)
        ros.context.on_shutdown(made.close)
        return made


@dataclass(eq=False)
class DriverNode:
    """Node in the domain of the drivers, with an rclpy context of its own."""

    context: Any
    ros: Any
    publisher: Any = None
    _executor: Any = None
    _thread: threading.Thread | None = None

    def spin(self) -> None:
        """Spin the node in a thread of its own until it is closed."""
        from socialbot.bridge.wait_sets import OneThreadExecutor

        self._executor = OneThreadExecutor(context=self.context)
        self._executor.add_node(self.ros)
        self._thread = threading.Thread(target=spin, args=(self._executor,), name=self.ros.get_name(), daemon=True)
        self._thread.start()

    def call(self, callback: Callable[[], None]) -> None:
        """Run ``callback`` in the thread that spins the node, and wait for it for `CALL_S` at most."""
        done = threading.Event()

        def run() -> None:
            try:
                callback()
            finally:
                done.set()

        self._executor.create_task(run)
        done.wait(CALL_S)

    def close(self) -> None:
        """Remove the node from the domain."""
        if not self.context.ok():
            return
        if self._thread is not None:
            self._executor.shutdown()
            self._thread.join(2 * SPIN_TIMEOUT_S)
        self.ros.destroy_node()
        self.context.try_shutdown()


def driver_domain(environment: Mapping[str, str] = os.environ) -> DriverDomain | None:
    """The domain of `DRIVERS_VARIABLE`, such as ``43:/head_controller/joint_trajectory``; None if it is unset.

    Raises:
        ParameterError: The domain is invalid or that of the graph, or a topic has no full name.
    """
    text = environment.get(DRIVERS_VARIABLE)
    if not text:
        return None
    number, *topics = text.split(":")
    domain = domain_number(number)
    if domain is None or domain == ros_domain(environment):
        raise ParameterError(
            f"{number!r} is not another ROS domain",
            where=DRIVERS_VARIABLE,
            remedy=f"begin with a number from 0 to {HIGHEST_DOMAIN} that is not ROS_DOMAIN_ID",
        )
    wrong = [topic for topic in topics if not TOPIC_NAME.fullmatch(topic)]
    if wrong or not topics:
        raise ParameterError(
            f"{wrong[0]!r} is not a full topic name" if wrong else "no topics",
            where=DRIVERS_VARIABLE,
            remedy=f"write {number}:/head_controller/joint_trajectory",
        )
    return DriverDomain(domain, frozenset(topics))


@contextmanager
def _variables(changes: Mapping[str, str]) -> Iterator[None]:
    """Change variables of this process within the block; DDS reads them when a participant is made."""
    with _changing:
        before = {name: os.environ.get(name) for name in changes}
        os.environ.update(changes)
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value
