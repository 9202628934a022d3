"""An rclpy context of its own, and ``--ros-args``."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from socialbot.core.errors import ParameterError

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node


_LOOKS_AGAIN_S = 0.5
"""So long an executor waits at most until it asks its node again what there is to wait for."""


@contextmanager
def ros_context(args: list[str] | None = None) -> Iterator[Context]:
    """A context of its own, with signals left to the caller. Raises ParameterError for ``args`` that ROS refuses."""
    require_ros()
    import rclpy
    from rclpy.context import Context
    from rclpy.impl.implementation_singleton import rclpy_implementation as rcl
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import try_shutdown

    prepare()
    warn_if_open()
    context = Context()
    try:
        rclpy.init(args=args, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except (rcl.RCLError, rcl.RCLInvalidROSArgsError, rcl.UnknownROSArgsError) as error:
        if not args:
            raise
        remedy = "write -p NAME:=VALUE, -r FROM:=TO or --params-file FILE"
        raise ParameterError(f"ROS cannot use them: {error}", where="--ros-args", remedy=remedy) from error
    try:
        yield context
    finally:
        try_shutdown(context=context)


@contextmanager
def spinning_node(name: str, args: list[str] | None = None) -> Iterator[Node]:
    """A node of its own, without parameters to set, whose callbacks run in a thread.

    Raises ParameterError for ``args`` that ROS refuses.
    """
    require_ros()
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    with ros_context(args) as context:
        node = Node(name, context=context, start_parameter_services=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        ended = threading.Event()
        thread = threading.Thread(target=_spin, args=(executor, ended), name=name, daemon=True)
        thread.start()
        try:
            yield node
        finally:
            ended.set()
            executor.shutdown()
            thread.join(2.0)
            node.destroy_node()


def _spin(executor: SingleThreadedExecutor, ended: threading.Event) -> None:
    from rclpy.executors import ExternalShutdownException

    # On a busy machine an executor may sleep through what was added to its node as it began to spin, for ever.
    try:
        while not ended.is_set():
            executor.spin_once(timeout_sec=_LOOKS_AGAIN_S)
    except ExternalShutdownException:
        return


BEGIN, END = "--ros-args", "--"


def divided(arguments: Iterable[str]) -> tuple[list[str], list[str]]:
    """The arguments that are ours, and those for ROS: from each ``--ros-args`` to ``--`` or the end."""
    ours: list[str] = []
    ros: list[str] = []
    for argument in arguments:
        inside = bool(ros) and ros[-1] != END
        (ros if inside or argument == BEGIN else ours).append(argument)
    return ours, ros
