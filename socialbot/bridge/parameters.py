"""The parameters of a node as ROS parameters, with their ranges and descriptions."""

from __future__ import annotations

import functools
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node as RosNode

from socialbot.errors import ParameterError
from socialbot.graph import Node, Parameter, Placement, check_parameters

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
        for name, value in ours.items():
            node.context.call_soon(functools.partial(node.set_parameter, name, value))
        return SetParametersResult(successful=True)

    ros.add_on_set_parameters_callback(changed)


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
