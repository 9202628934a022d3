"""ROS domain of the drivers of actuators, which cannot verify seals.

A node of the graph publishes its commands for such a driver twice: sealed in the domain of the graph, and plain in the
domain of the drivers, on this machine only. The driver, bound to the loopback interface of that domain, receives the
commands of that node alone.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from socialbot.bridge.environment import DRIVERS_VARIABLE, HIGHEST_DOMAIN, TOPIC_NAME, domain_number, ros_domain
from socialbot.core.errors import ParameterError

_LOCAL = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": "", "ROS_DISCOVERY_SERVER": ""}
"""Variables of a participant that other machines neither find nor are looked for."""

_changing = threading.Lock()


@dataclass(frozen=True)
class DriverDomain:
    """ROS domain of drivers, and the fully qualified topics of their commands."""

    domain: int
    topics: frozenset[str]

    def text(self) -> str:
        """Return the value of `DRIVERS_VARIABLE`."""
        return ":".join([str(self.domain), *sorted(self.topics)])

    def publisher(self, ros: Any, topic: str, ros_class: Any, qos: Any) -> DriverPublisher:
        """Make the publisher of commands beside that of the rclpy node ``ros``, with whose context it ends."""
        import rclpy
        from rclpy.context import Context
        from rclpy.node import Node
        from rclpy.signals import SignalHandlerOptions

        context = Context()
        with _variables(_LOCAL):
            rclpy.init(context=context, domain_id=self.domain, signal_handler_options=SignalHandlerOptions.NO)
            node = Node(
                f"{ros.get_name()}_drivers",
                context=context,
                start_parameter_services=False,
                enable_rosout=False,
            )
        made = DriverPublisher(context, node, node.create_publisher(ros_class, topic, qos))
        ros.context.on_shutdown(made.close)
        return made


@dataclass(eq=False)
class DriverPublisher:
    """Publisher in the domain of the drivers, with an rclpy context of its own."""

    context: Any
    node: Any
    publisher: Any

    def publish(self, ros_message: Any) -> None:
        """Publish a message, or a serialised one."""
        self.publisher.publish(ros_message)

    def close(self) -> None:
        """Remove the publisher from the domain."""
        if self.context.ok():
            self.node.destroy_node()
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
