"""The parameters of a node as ROS parameters, with their ranges and descriptions."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node as RosNode

from socialbot.core.errors import ParameterError
from socialbot.graph.node import Node, NodeConfig, Parameter, check_parameters

PATIENCE_S = 7.0
"""How long a node may take to say whether it takes a new value; at first it may be waiting for its connections."""

UNBOUNDED = 1e308
UNBOUNDED_INTEGER = 2**62


def declare_parameters(ros: RosNode, placement: NodeConfig) -> None:
    """Declares all parameters of the placed node.

    The graph's values are the defaults; ROS (``--ros-args -p name:=value``) overrides them. Raises
    ParameterError when one does not fit.
    """
    values = check_parameters(placement.type, placement.parameters, where=placement.name)
    for name, parameter in placement.type.parameters().items():
        try:
            ros.declare_parameter(name, values[name], _descriptor(parameter))
        except Exception as error:
            raise ParameterError(str(error), where=f"{placement.name}.{name}", remedy=parameter.doc) from error


def parameter_values(ros: RosNode, placement: NodeConfig) -> dict[str, object]:
    """The values that the parameters of the placed node have by now."""
    return {name: ros.get_parameter(name).value for name in placement.type.parameters()}


def watch_parameters(ros: RosNode, node: Node, call: Callable[[Callable[[], None]], None]) -> Callable[[], None]:
    """Lets changes from ROS through to ``node`` when they fit; returns how to end that.

    ``call`` has something done in the node's own thread.
    """

    def changed(parameters: list[Any]) -> SetParametersResult:
        ours = {one.name: one.value for one in parameters if one.name in node.parameters()}
        try:
            check_parameters(type(node), ours, where=node.name)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        objection = _apply(node, ours, call)
        return SetParametersResult(successful=not objection, reason=objection)

    ros.add_on_set_parameters_callback(changed)
    return functools.partial(ros.remove_on_set_parameters_callback, changed)


def _apply(node: Node, values: dict[str, object], call: Callable[[Callable[[], None]], None]) -> str:
    """Sets ``values`` in the node's own thread; returns what the node objects, if anything."""
    done = threading.Event()
    objections: list[str] = []

    def apply() -> None:
        try:
            for name, value in values.items():
                node.set_parameter(name, value)
        except Exception as error:  # noqa: BLE001 - any objection refuses the change
            objections.append(str(error))
        done.set()

    call(apply)
    if not done.wait(PATIENCE_S):
        return f"{node.name} has been too busy for {PATIENCE_S} s to take it"
    return "; ".join(objections)


def _descriptor(parameter: Parameter[Any]) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=parameter.doc,
        read_only=parameter.fixed,
        additional_constraints=f"one of {', '.join(parameter.choices)}" if parameter.choices else "",
    )
    low, high = parameter.minimum, parameter.maximum
    if low is None and high is None:
        return descriptor
    if isinstance(parameter.default, float):
        descriptor.floating_point_range = [
            FloatingPointRange(
                from_value=-UNBOUNDED if low is None else float(low),
                to_value=UNBOUNDED if high is None else float(high),
            )
        ]
    else:
        descriptor.integer_range = [
            IntegerRange(
                from_value=-UNBOUNDED_INTEGER if low is None else int(low),
                to_value=UNBOUNDED_INTEGER if high is None else int(high),
                step=1,
            )
        ]
    return descriptor
