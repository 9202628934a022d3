"""Actions of an agent that a ROS action or service executes."""

from __future__ import annotations

from typing import Any, ClassVar

from socialbot.bdi import Failed, LongAction, Sensor
from socialbot.bdi.sensors import Sensed
from socialbot.core.errors import RuleError
from socialbot.graph.calls import CallResult, PendingCall
from socialbot.graph.node import Node
from socialbot.graph.services import ActionCaller, ServiceCaller


class RosAction(LongAction):
    """Durative action that a ROS action or service executes.

    ::

        class Robot(AgentNode):
            navigate = ActionClient("nav2_msgs/action/NavigateToPose", "/navigate_to_pose")

        class drive_to(RosAction):
            \"\"\"Drive to a position in the map.\"\"\"

            client = "navigate"

            def goal(self, x: float, y: float):
                return {"pose": {"header": {"frame_id": "map"}, "pose": {"position": {"x": x, "y": y}}}}

            def feedback(self, feedback):
                return [distance_left(feedback.distance_remaining)]

    The action succeeds or fails with its goal. A failure has the outcome as its reason: ``error("aborted")``. A dropped
    intention, or the time limit of ``drive_to(1, 2).within(30)``, cancels the goal, and waits until its server has
    stopped.
    """

    client: ClassVar[str]
    """Name of the `ActionClient` or `Client` of the agent's node."""

    _call: PendingCall

    def goal(self, *args: Any, **kwargs: Any) -> Any:
        """Return the goal, or the request of a service, for the arguments of the action: a mapping or a message."""
        return None

    def feedback(self, feedback: Any) -> Sensed:
        """Return the changes of beliefs that follow from feedback, as `Sensor.sense` does."""
        return None

    def result(self, result: Any) -> Sensed:
        """Return the changes of beliefs that follow from a result or response; `PlanFailed` fails the action."""
        return None

    def start(self, *args: Any) -> None:
        robot = getattr(self.engine, "robot", None)
        caller = getattr(robot, self.client, None)
        if not isinstance(robot, Node) or not isinstance(caller, (ActionCaller, ServiceCaller)):
            raise RuleError(
                f"the agent has no client {self.client!r}",
                where=f"action {self.functor}",
                remedy=f"write {self.client} = ActionClient(...) in its node",
            )
        goal = self.goal(*args)
        if isinstance(caller, ActionCaller):
            self._call = caller.send_goal(goal, self._on_result, feedback=self._on_feedback)
        else:
            self._call = caller.call(goal, self._on_result)

    def cancel(self) -> None:
        self._call.cancel()

    def _on_feedback(self, feedback: Any) -> None:
        self.engine.perceive(_RosFeedback(self.feedback), feedback, cause=self.id)

    def _on_result(self, result: CallResult) -> None:
        if result.outcome == "cancelled":
            self.cancelled()
        elif not result.ok:
            self.failed(Failed(result.outcome, result.reason))
        else:
            try:
                changes = self.result(result.message)
            except Exception as error:  # noqa: BLE001 - an error of a user's method fails the action, as in `start`
                self.failed(error)
                return
            self.engine.perceive(_RosFeedback(lambda _: changes), result.message, cause=self.id)
            self.done()


class _RosFeedback(Sensor):
    """Sensor for the answers to one goal."""

    def __init__(self, sense: Any) -> None:
        super().__init__()
        self.sense = sense
