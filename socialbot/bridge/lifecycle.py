"""A ROS 2 lifecycle node whose transitions call steps, and the parameters of its socialbot node."""

from __future__ import annotations

import functools
import logging
import threading
from collections.abc import Callable
from typing import Any, Protocol

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node as RosNode

from socialbot.core.errors import ParameterError
from socialbot.graph.node import Node, NodeConfig, Parameter, check_parameters

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = "unconfigured", "inactive", "active", "finalized"


class Steps(Protocol):
    """What is done in each transition. One that raises has failed."""

    def configure(self) -> None: ...

    def activate(self) -> None: ...

    def deactivate(self) -> None: ...

    def clean_up(self) -> None: ...


class LifecycleHost(LifecycleNode):
    """Takes its transitions, in the executor's thread, from services or from `go`.

    Without ``services`` nobody but this process can ask for any.
    """

    def __init__(self, name: str, steps: Steps, *, services: bool, **options: Any) -> None:
        super().__init__(name, enable_communication_interface=services, **options)
        self._steps = steps
        self._log = logging.getLogger(f"socialbot.{name}")
        self.error: Exception | None = None
        """Why the last step that failed did."""
        if services:
            self._service_change_state.callback = self._refusing(self._service_change_state.callback)

    @property
    def state(self) -> str:
        """One of those above, or a transition's such as ``activating``."""
        try:
            return str(self._state_machine.current_state[1])
        except InvalidHandle:
            return FINALIZED

    def go(self, state: str) -> bool:
        """Takes the transitions that lead to ``inactive``, ``active`` or ``finalized``; says whether it got there."""
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
        """Takes the node off the ROS graph; rclpy alone would forget the state machine, which keeps it there."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Does the step."""
        return self._take(self._steps.configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Does the step."""
        return self._take(self._steps.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Does the step."""
        return self._take(self._steps.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Does the step."""
        return self._take(self._steps.clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Does the steps that lead back from ``state``."""
        if state.label == ACTIVE:
            self._take(self._steps.deactivate)
        if state.label in (ACTIVE, INACTIVE):
            self._take(self._steps.clean_up)
        return TransitionCallbackReturn.SUCCESS

    def _take(self, step: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            step()
        except Exception as error:  # noqa: BLE001 - whatever it is, the state stays what it was
            self.error = error
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def _refusing(self, change_state: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """Rclpy lets a request that does not fit the state end the executor."""

        def callback(request: Any, response: Any) -> Any:
            self.error = None
            try:
                response = change_state(request, response)
            except rclpy_implementation.RCLError:
                response.success = False
            if self.error is not None:
                self._log.warning("transition %d refused: %s", request.transition.id, self.error)
            return response

        return callback


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
