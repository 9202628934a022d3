"""The parameters of a node as ROS parameters, with their ranges and descriptions."""

from __future__ import annotations

import threading
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node as RosNode

from socialbot.errors import ParameterError
from socialbot.graph import Node, Parameter, Placement, check_parameters

PATIENCE_S = 2.0
"""How long a node may take to say whether it takes a new value."""

UNBOUNDED = 1e308
UNBOUNDED_INTEGER = 2**62


def declare_parameters(ros: RosNode, placement: Placement) -> dict[str, object]:
    """Declares all parameters of the placed node and returns their values.

    The graph's values are the defaults; ROS (``--ros-args -p name:=value``) overrides them. Raises
    ParameterError when one does not fit.
    """
    values = check_parameters(placement.type, placement.parameters, where=placement.name)
    declared: dict[str, object] = {}
    for name, parameter in placement.type.parameters().items():
        try:
            declared[name] = ros.declare_parameter(name, values[name], _descriptor(parameter)).value
        except Exception as error:
            raise ParameterError(str(error), where=f"{placement.name}.{name}", remedy=parameter.doc) from error
    return declared


def watch_parameters(ros: RosNode, node: Node) -> None:
    """Lets changes from ROS through to ``node``, in its own thread, when they fit."""

    def changed(parameters: list[Any]) -> SetParametersResult:
        ours = {one.name: one.value for one in parameters if one.name in node.parameters()}
        try:
            check_parameters(type(node), ours, where=node.name)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        objection = _apply(node, ours)
        return SetParametersResult(successful=not objection, reason=objection)

    ros.add_on_set_parameters_callback(changed)


def _apply(node: Node, values: dict[str, object]) -> str:
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

    node.context.call_soon(apply)
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
