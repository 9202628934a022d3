"""ROS 2 lifecycle node with a callback per transition, and the parameters of its socialbot node.

It has the five services and the event of a managed node (https://design.ros2.org, managed nodes).
"""

from __future__ import annotations

import functools
import logging
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node as RosNode

from socialbot.bridge.wait_sets import FilteredNode
from socialbot.core.errors import ParameterError
from socialbot.graph.node import Node, NodeConfig, check_parameters
from socialbot.graph.ports import Parameter

if TYPE_CHECKING:
    from socialbot.bridge._host import NodeHost

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = "unconfigured", "inactive", "active", "finalized"

SET_PARAMETER_TIMEOUT_S = 7.0  # timeout to apply a parameter; a starting node may be waiting for its connections
UNBOUNDED = 1e308
UNBOUNDED_INTEGER = 2**62


class LifecycleHost(FilteredNode, LifecycleNode):
    """Lifecycle node that runs the steps of ``host`` in the executor thread, by services or `transition_to`.

    An exception makes a transition fail; ``error`` is the last one. Without ``services`` only this process can request
    transitions.
    """

    def __init__(self, name: str, host: NodeHost, *, services: bool, **options: Any) -> None:
        super().__init__(name, enable_communication_interface=services, **options)
        self._host = host
        self._log = logging.getLogger(f"socialbot.{name}")
        self.error: Exception | None = None
        if services:
            self._service_change_state.callback = self._refusing(self._service_change_state.callback)

    @property
    def state(self) -> str:
        """One of the four states, or a transition state such as ``activating``."""
        try:
            return str(self._state_machine.current_state[1])
        except InvalidHandle:
            return FINALIZED

    def transition_to(self, state: str) -> bool:
        """Take the transitions to ``inactive``, ``active`` or ``finalized``; return whether they succeeded."""
        if state == FINALIZED and self.state != FINALIZED:
            self.trigger_shutdown()
        if state in (INACTIVE, ACTIVE) and self.state == UNCONFIGURED:
            self.trigger_configure()
        if state == ACTIVE and self.state == INACTIVE:
            self.trigger_activate()
        if state == INACTIVE and self.state == ACTIVE:
            self.trigger_deactivate()
        return self.state == state

    def destroy_node(self) -> None:
        """Remove the node from the ROS graph; rclpy alone leaves its state machine there."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._run(self._host.configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._run(self._host.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._run(self._host.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._run(self._host.clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        if state.label == ACTIVE:
            self._run(self._host.deactivate)
        if state.label in (ACTIVE, INACTIVE):
            self._run(self._host.clean_up)
        return TransitionCallbackReturn.SUCCESS

    def _run(self, step: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            step()
        except Exception as error:  # noqa: BLE001 - any failure keeps the state
            self.error = error
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def _refusing(self, change_state: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """Refuse requests that do not fit the state. In rclpy they end the executor."""

        def callback(request: Any, response: Any) -> Any:
            self.error = None
            try:
                response = change_state(request, response)
            except rclpy_implementation.RCLError:
                response.success = False
            if self.error is not None:
                self._log.warning("transition %d failed: %s", request.transition.id, self.error)
            return response

        return callback


def declare_parameters(ros: RosNode, config: NodeConfig) -> None:
    """Declare the parameters of a node with the values of the graph as defaults.

    ROS arguments (``--ros-args -p name:=value``) override them.

    Raises:
        ParameterError: A value does not fit.
    """
    values = check_parameters(config.type, config.parameters, where=config.name)
    for name, parameter in config.type.parameters().items():
        try:
            ros.declare_parameter(name, values[name], _descriptor(parameter))
        except Exception as error:
            raise ParameterError(str(error), where=f"{config.name}.{name}", remedy=parameter.doc) from error


def parameter_values(ros: RosNode, config: NodeConfig) -> dict[str, object]:
    """Current values of the declared parameters."""
    return {name: ros.get_parameter(name).value for name in config.type.parameters()}


def watch_parameters(ros: RosNode, node: Node, call: Callable[[Callable[[], None]], None]) -> Callable[[], None]:
    """Apply valid changes from ROS to ``node``; return a function that ends this.

    ``call`` runs a function in the thread of the node.
    """

    def changed(parameters: list[Any]) -> SetParametersResult:
        values = {one.name: one.value for one in parameters if one.name in node.parameters()}
        try:
            check_parameters(type(node), values, where=node.name)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        objection = _apply(node, values, call)
        return SetParametersResult(successful=not objection, reason=objection)

    ros.add_on_set_parameters_callback(changed)
    return functools.partial(ros.remove_on_set_parameters_callback, changed)


def _apply(node: Node, values: dict[str, object], call: Callable[[Callable[[], None]], None]) -> str:
    """Set ``values`` in the thread of the node; return the error of the node, if any."""
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
    if not done.wait(SET_PARAMETER_TIMEOUT_S):
        return f"{node.name} did not apply the change within {SET_PARAMETER_TIMEOUT_S} s: it is busy"
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
        bounds = -UNBOUNDED if low is None else float(low), UNBOUNDED if high is None else float(high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=bounds[0], to_value=bounds[1])]
    else:
        limits = -UNBOUNDED_INTEGER if low is None else int(low), UNBOUNDED_INTEGER if high is None else int(high)
        descriptor.integer_range = [IntegerRange(from_value=limits[0], to_value=limits[1], step=1)]
    return descriptor
