"""Watch of a node outside the graph: whether it answers, and whether its lifecycle state is the one that is needed."""

from __future__ import annotations

from typing import Literal, get_args

from socialbot.core.clock import nanoseconds
from socialbot.core.errors import ParameterError
from socialbot.core.messages import Structured
from socialbot.graph.calls import CallResult
from socialbot.graph.node import Node
from socialbot.graph.ports import Delivery, Output, Parameter
from socialbot.graph.services import Client, ServiceCaller

START_S = 5.0  # time for the node to appear; it is not lost before
RETRY_S = 5.0  # time after a failed transition until the next request
MOST_TRANSITIONS = 2  # transitions from any state to the needed one; more of them in a row lead nowhere
TRANSITION_S = 10.0  # time limit for a transition, in which the node may answer nothing else

ForeignState = Literal["running", "unconfigured", "inactive", "active", "finalized", "changing", "lost"]
"""State of a node outside the graph: "running" without lifecycle, "changing" in a transition, "lost" without answer."""

_TRANSITION_IDS = {"configure": 1, "cleanup": 2, "activate": 3, "deactivate": 4}
_NEXT = {
    ("unconfigured", "inactive"): "configure",
    ("unconfigured", "active"): "configure",
    ("inactive", "active"): "activate",
    ("inactive", "unconfigured"): "cleanup",
    ("active", "inactive"): "deactivate",
    ("active", "unconfigured"): "deactivate",
}
"""Next transition by present and needed state."""


class ForeignNodeState(Structured, frozen=True, kw_only=True):
    """State of a node outside the graph, published at each change.

    ``ready`` tells whether it answers and is in the state that the graph needs; ``reason`` says why not.
    """

    node: str
    state: ForeignState
    ready: bool
    reason: str = ""


MESSAGES = (ForeignNodeState,)


class ForeignNode(Node):
    """Watch a node outside the graph, as ``needs`` in a graph file declares it.

    It calls a service of the node each ``period_s``. A node that ends or hangs is lost within ``period_s`` plus
    ``answer_s``. The health of the watch is "failed" for a lost node, and "degraded" in a state that is not needed.
    """

    watches_outside = True

    node = Parameter("", "full name of the node", fixed=True)
    state = Parameter(
        "",
        "lifecycle state that the graph needs; empty for any node that answers",
        choices=("", "unconfigured", "inactive", "active"),
        fixed=True,
    )
    manage = Parameter(False, "whether to request the transitions to that state")
    period_s = Parameter(0.5, "time between an answer and the next call, s", minimum=0.05)
    answer_s = Parameter(1.0, "time limit for an answer, s", minimum=0.05)

    get_state = Client("lifecycle_msgs/srv/GetState", "~/get_state", optional=True, open_to_all=True)
    change_state = Client("lifecycle_msgs/srv/ChangeState", "~/change_state", optional=True, open_to_all=True)
    ping = Client("rcl_interfaces/srv/GetParameterTypes", "~/get_parameter_types", optional=True, open_to_all=True)
    states = Output(ForeignNodeState, "~/state", delivery=Delivery.LATCHED)

    _begun = _retry_at = 0
    _published: ForeignNodeState | None = None
    _failure = ""
    _transitions = 0  # in a row, without the needed state

    def start(self) -> None:
        if not self.node:
            raise ParameterError("no node to watch", where=self.name, remedy="name it under 'needs' in the graph file")
        self._begun = self.clock.now()
        self.report_health("waiting", f"waits for {self.node}")
        self._look()

    def _look(self) -> None:
        caller: ServiceCaller = self.get_state if self.state else self.ping
        caller.call(then=self._on_state, deadline_s=self.answer_s)

    def _on_state(self, result: CallResult) -> None:
        if not result.ok:
            self._on_no_answer(result)
            return
        label = result.message.current_state.label if self.state else "running"
        present: ForeignState = label if label in get_args(ForeignState) else "changing"
        transition = _NEXT.get((present, self.state), "") if self.manage else ""
        if transition and self._transitions >= MOST_TRANSITIONS:
            self._transitions = 0
            self._fail(f"{self.node} is {present} again after its transitions")
        if transition and self.clock.now() >= self._retry_at:
            self._transitions += 1
            self._publish(present, self._failure or f"{self.node} is {present}, not {self.state}")
            request = {"transition": {"id": _TRANSITION_IDS[transition], "label": transition}}
            self.change_state.call(
                request, lambda result: self._on_transition(transition, result), deadline_s=TRANSITION_S
            )
            return
        if self.state and present != self.state:
            ended = f"{self.node} is finalized: start it again"
            other = ended if present == "finalized" else f"{self.node} is {present}, not {self.state}"
            self._publish(present, self._failure or other)
        else:
            self._failure, self._transitions = "", 0
            self._publish(present, "")
        self.call_after(self.period_s, self._look)

    def _on_transition(self, transition: str, result: CallResult) -> None:
        if not result.ok:
            self._on_no_answer(result)
            return
        if not result.message.success:
            self._fail(f"{self.node} failed to {transition}: see its log")
        else:
            self._failure = ""
        self._look()

    def _fail(self, why: str) -> None:
        self._failure, self._retry_at = why, self.clock.now() + nanoseconds(RETRY_S)
        self.log.warning("%s", why)

    def _on_no_answer(self, result: CallResult) -> None:
        if self._published is not None or self.clock.now() >= self._begun + nanoseconds(START_S):
            self._publish("lost", self._reason(result))
        self.call_after(self.period_s, self._look)

    def _reason(self, result: CallResult) -> str:
        if result.outcome == "absent":
            return f"{self.node} is not running, or has no lifecycle" if self.state else f"{self.node} is not running"
        return f"{self.node} ended during a call" if result.outcome == "lost" else f"{self.node} does not answer"

    def _publish(self, state: ForeignState, reason: str) -> None:
        before = self._published
        if before is not None and (before.state, before.reason) == (state, reason):
            return
        self._published = ForeignNodeState(
            stamp=self.clock.now(), node=self.node, state=state, ready=not reason, reason=reason
        )
        self.states.publish(self._published)
        self.report_health("failed" if state == "lost" else "degraded" if reason else "ok", reason)
