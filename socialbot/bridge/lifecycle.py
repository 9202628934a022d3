"""A ROS 2 lifecycle node whose transitions are steps of something that is not ROS.

Lifecycle tools see the five services and the event of every managed node (https://design.ros2.org, managed nodes).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, Protocol

from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = "unconfigured", "inactive", "active", "finalized"


class Steps(Protocol):
    """What is done in each transition. One that raises has failed."""

    def configure(self) -> None: ...

    def activate(self) -> None: ...

    def deactivate(self) -> None: ...

    def clean_up(self) -> None: ...


class ManagedNode(LifecycleNode):
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
